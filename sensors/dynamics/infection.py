"""Infection by distance: kernels in exact integers, and the front of an epidemic.

The epidemic compares a weighted number of infected neighbours with whole numbers. Sums of 1/d^2 in floating
point depend on the order of summation: five neighbours of weight 0.2 may make 1 or just less than 1.
Therefore weights are integers in multiples of ``1 / unit``, and sums, floors and comparisons are exact
everywhere.

Only cells near infected ones can change. Their weighted number of infected neighbours is kept for every cell
and changed around cells that become infected or are removed, so a day costs as much as there are such cells,
however large the front has grown; the farm is never scanned.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sensors.errors import EnvironmentDataError

Cells = NDArray[np.intp]

FRONT_BYTES_A_CELL = 9
"""Memory of a front, by cells of the farm."""

KERNEL_SHAPES = ("inverse-square", "exponential", "gaussian")
MAX_KERNEL_SIZE = 51
_ROUNDING_UNIT = 1 << 32


@dataclass(frozen=True, slots=True)
class DistanceKernel:
    """Weights of the neighbours of a cell, grouped by equal weight.

    The square of neighbours has an odd number of cells, `size`, on a side.
    """

    size: int
    unit: int
    """The integer that stands for weight 1."""
    rings: tuple[tuple[int, tuple[tuple[int, int], ...]], ...]
    """Pairs of a positive integer weight and the offsets ``(dx, dy)`` that have it; the centre has none."""

    @property
    def radius(self) -> int:
        """Largest offset along an axis, cells."""
        return self.size // 2

    @property
    def total(self) -> int:
        """Sum of all weights in units: what a cell sees when every neighbour is infected."""
        return sum(weight * len(offsets) for weight, offsets in self.rings)

    @property
    def offsets(self) -> tuple[tuple[int, int], ...]:
        """All offsets with a weight."""
        return tuple(offset for _, ring in self.rings for offset in ring)

    def weights(self) -> NDArray[np.float64]:
        """Return the kernel as an array."""
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
    """Make the kernel of a shape.

    Parameters
    ----------
    shape : {"inverse-square", "exponential", "gaussian"}
        With the distance d in cells: ``1/d^2``; ``exp(-d/length)``; ``exp(-d^2/(2 length^2))``.
        Inverse-square is exact up to size 11 (the unit is the least common multiple of all d^2); the others,
        and larger sizes, are rounded to multiples of 2^-32.
    size : int
        Side of the square of neighbours, odd, cells.
    length_cells : float
        Length of the exponential and the Gaussian shape, cells.

    EnvironmentDataError if the shape is unknown, the size is not a small odd number or the length not
    positive.

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
        msg = f"infection kernel: unknown shape {shape!r}; known: {', '.join(KERNEL_SHAPES)}"
        raise EnvironmentDataError(msg)
    formula = formulas[shape]
    rounded = ((round(formula(d2) * _ROUNDING_UNIT), tuple(ring)) for d2, ring in sorted(rings.items()))
    return DistanceKernel(size, _ROUNDING_UNIT, tuple((weight, ring) for weight, ring in rounded if weight))


class InfectionFront:
    """Susceptible cells near infected ones, given and returned as flat indices of the farm in C order."""

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
        self._steps = tuple(
            (weight, dx * self._stride + dy) for weight, ring in kernel.rings for dx, dy in ring
        )

    def _pad(self, cells: Cells) -> Cells:
        x, y = np.divmod(cells, self._height)
        padded: Cells = (x + self._margin) * self._stride + (y + self._margin)
        return padded

    def _unpad(self, padded: Cells) -> Cells:
        x, y = np.divmod(padded, self._stride)
        cells: Cells = (x - self._margin) * self._height + (y - self._margin)
        return cells

    def infect(self, cells: Cells) -> None:
        """Make different cells infected; their neighbours join the front."""
        centres = self._pad(cells)
        self._susceptible[centres] = False
        joining = [self._front]
        near, total = np.empty_like(centres), np.empty(centres.size, np.int64)
        for weight, step in self._steps:
            # Different centres have different neighbours at one step, so plain indexing adds them all.
            np.add(centres, step, out=near)
            self._total.take(near, out=total, mode="clip")
            joining.append(near[total == 0])
            total += weight
            self._total[near] = total
        self._front = np.concatenate(joining)

    def remove(self, cells: Cells) -> None:
        """Make infected cells removed: they no longer infect."""
        centres = self._pad(cells)
        near, total = np.empty_like(centres), np.empty(centres.size, np.int64)
        for weight, step in self._steps:
            np.add(centres, step, out=near)
            self._total.take(near, out=total, mode="clip")
            total -= weight
            self._total[near] = total

    def exposed(self) -> tuple[Cells, NDArray[np.int64]]:
        """Find the susceptible cells with infected neighbours.

        Flat indices, ascending, and weighted numbers in units of the kernel, at least 1.
        """
        front = np.sort(self._front[self._susceptible[self._front]])
        total = self._total.take(front)
        kept = total > 0
        # A cell that lost its infected neighbours and got new ones since the last call is listed twice.
        kept[1:] &= front[1:] != front[:-1]
        self._front = front[kept]
        return self._unpad(self._front), total[kept]
