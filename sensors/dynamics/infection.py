"""Infection by distance: distance kernels with exact integer weights, and the front of an epidemic.

An epidemic compares the weighted number of infected neighbours with whole numbers. A floating-point sum of
1/d^2 depends on the order of summation: five neighbours of weight 0.2 may give 1 or slightly less. Therefore
a weight is a whole number of units ``1 / unit``, and sums, floors and comparisons are exact on every machine.

Only cells near infected cells can change. Every cell's weighted number of infected neighbours is stored, and
is updated around cells that become infected or removed. The cost of a day is proportional to the number of
newly infected and removed cells, not to the size of the front or of the farm.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from geo.texts import unknown
from sensors.errors import EnvironmentDataError

Cells = NDArray[np.intp]

FRONT_BYTES_A_CELL = 9
"""Memory that a front takes for each cell of the farm (bytes)."""

KERNEL_SHAPES = ("inverse-square", "exponential", "gaussian")
MAX_KERNEL_SIZE = 51
_ROUNDING_UNIT = 1 << 32
_CENTRES_AT_ONCE = 1024


@dataclass(frozen=True, slots=True)
class DistanceKernel:
    """Weights of a cell's neighbours; neighbours of equal weight form a group.

    The neighbourhood is a square of `size` x `size` cells; `size` is odd.
    """

    size: int
    unit: int
    """Integer that represents the weight 1."""
    rings: tuple[tuple[int, tuple[tuple[int, int], ...]], ...]
    """Pairs of a positive integer weight and the offsets ``(dx, dy)`` with this weight; (0, 0) has no
    weight."""

    @property
    def radius(self) -> int:
        """Largest offset along an axis, cells."""
        return self.size // 2

    @property
    def total(self) -> int:
        """Sum of all weights, in units; this is the count of a cell whose neighbours are all infected."""
        return sum(weight * len(offsets) for weight, offsets in self.rings)

    @property
    def offsets(self) -> tuple[tuple[int, int], ...]:
        """All offsets ``(dx, dy)`` that have a weight."""
        return tuple(offset for _, ring in self.rings for offset in ring)

    def weights(self) -> NDArray[np.float64]:
        """Return the weights as an array, float64[size, size]."""
        array = np.zeros((self.size, self.size))
        for weight, ring in self.rings:
            for dx, dy in ring:
                array[self.radius + dx, self.radius + dy] = weight / self.unit
        return array


def _rings(size: int) -> dict[int, list[tuple[int, int]]]:
    if size < 1 or size % 2 == 0 or size > MAX_KERNEL_SIZE:
        msg = f"infection kernel: size {size} is not an odd number from 1 to {MAX_KERNEL_SIZE}"
        raise EnvironmentDataError(msg)
    radius = size // 2
    rings: dict[int, list[tuple[int, int]]] = {}
    for dx in range(-radius, radius + 1):
        for dy in range(-radius, radius + 1):
            if dx or dy:
                rings.setdefault(dx * dx + dy * dy, []).append((dx, dy))
    return rings


@lru_cache(maxsize=64)
def make_kernel(shape: str, size: int, length_cells: float = 1.0) -> DistanceKernel:
    """Return the distance kernel of a given shape and size.

    Parameters
    ----------
    shape : {"inverse-square", "exponential", "gaussian"}
        Weight at a distance of d cells: ``1/d^2``, ``exp(-d/length)`` or ``exp(-d^2/(2 length^2))``.
        Inverse-square weights are exact up to size 11: their unit is the least common multiple of all d^2.
        Other weights are rounded to multiples of 2^-32.
    size : int
        Side of the square of neighbours, an odd number of cells.
    length_cells : float
        Length of the exponential and the Gaussian shapes, cells.

    Raises
    ------
    EnvironmentDataError
        If the shape is unknown, the size is even or out of range, or the length is not positive.

    Examples
    --------
    >>> make_kernel("inverse-square", 3).weights().tolist()
    [[0.5, 1.0, 0.5], [1.0, 0.0, 1.0], [0.5, 1.0, 0.5]]
    """
    rings = _rings(size)
    if shape == "inverse-square":
        common = math.lcm(1, *rings)
        if common <= _ROUNDING_UNIT:
            exact = tuple((common // d2, tuple(ring)) for d2, ring in sorted(rings.items()))
            return DistanceKernel(size, common, exact)
    if not (math.isfinite(length_cells) and length_cells > 0):
        msg = f"infection kernel: length of {length_cells} cells is not a positive number"
        raise EnvironmentDataError(msg)
    formulas: dict[str, Callable[[int], float]] = {
        "inverse-square": lambda d2: 1.0 / d2,
        "exponential": lambda d2: math.exp(-math.sqrt(d2) / length_cells),
        "gaussian": lambda d2: math.exp(-d2 / (2.0 * length_cells**2)),
    }
    if shape not in formulas:
        raise EnvironmentDataError(f"infection kernel: {unknown('shape', shape, KERNEL_SHAPES)}")
    formula = formulas[shape]
    rounded = ((round(formula(d2) * _ROUNDING_UNIT), tuple(ring)) for d2, ring in sorted(rings.items()))
    return DistanceKernel(size, _ROUNDING_UNIT, tuple((weight, ring) for weight, ring in rounded if weight))


class InfectionFront:
    """The front: susceptible cells near infected cells. A cell is a flat index of the farm in C order."""

    def __init__(self, susceptible: NDArray[np.bool_], kernel: DistanceKernel) -> None:
        width, height = susceptible.shape
        margin = kernel.radius
        self._height = height
        self._stride = height + 2 * margin
        self._margin = margin
        padded = np.zeros((width + 2 * margin, self._stride), np.bool_)
        padded[margin : margin + width, margin : margin + height] = susceptible
        self._susceptible = padded.reshape(-1)
        self._total = np.zeros(padded.size, np.int64)
        self._front: Cells = np.empty(0, np.intp)
        x, y = np.array(kernel.offsets, np.intp).reshape(-1, 2).T
        self._steps = x * self._stride + y
        self._weights = np.array([weight for weight, ring in kernel.rings for _ in ring], np.int64)

    def _pad(self, cells: Cells) -> Cells:
        x, y = np.divmod(cells, self._height)
        return (x + self._margin) * self._stride + (y + self._margin)

    def infect(self, cells: Cells) -> None:
        """Infect the given cells, each given once, and add their susceptible neighbours to the front."""
        centres = self._pad(cells)
        self._susceptible[centres] = False
        self._front = np.concatenate([self._front, *self._add(centres, 1)])

    def remove(self, cells: Cells) -> None:
        """Mark infected cells as removed: from now on they do not infect their neighbours."""
        self._add(self._pad(cells), -1)

    def _add(self, centres: Cells, sign: int) -> list[Cells]:
        """Add (or subtract) the kernel's weights around cells; return neighbours whose sum was zero."""
        joining = []
        for first in range(0, len(centres), _CENTRES_AT_ONCE):
            part = centres[first : first + _CENTRES_AT_ONCE]
            near = (self._steps[:, np.newaxis] + part).ravel()
            joining.append(near[self._total[near] == 0])
            np.add.at(self._total, near, np.repeat(sign * self._weights, len(part)))
        return joining

    def exposed(self) -> tuple[Cells, NDArray[np.int64]]:
        """Return the susceptible cells with infected neighbours, and each cell's count of these neighbours.

        Cells are ascending flat indices. A count is weighted, in units of the kernel, and at least 1.
        """
        front = np.sort(self._front[self._susceptible[self._front]])
        total = self._total.take(front)
        kept = total > 0
        # A cell is listed twice if it lost all its infected neighbours and later got new infected neighbours.
        kept[1:] &= front[1:] != front[:-1]
        self._front = front[kept]
        x, y = np.divmod(self._front, self._stride)
        return (x - self._margin) * self._height + (y - self._margin), total[kept]
