"""Disks of cells around observations: radius, shape, and a record of the disks still to paint."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensors.observations import GrowingArray
from sensors.scoring.information import tile_shape, tiles_of_boxes


@dataclass(frozen=True, slots=True, eq=False)
class Disk:
    """The cells of an observation's disk, relative to the observed cell (x, y).

    Row i has the cells ``x + first + i`` by ``[y + low[i], y + high[i])``.
    """

    first: int
    low: NDArray[np.int32]
    high: NDArray[np.int32]


Stamp = Callable[[int], Disk]
"""Function that returns the disk with a given radius."""


def adaptive_radius(n_observations: int, shape: tuple[int, int]) -> int:
    """Return the radius (cells) with which all disks together have about twice the farm's area.

    This is the paper's rule ``int(1 + sqrt(2 W H / (pi n)))``.

    Examples
    --------
    >>> [adaptive_radius(n, (31, 31)) for n in (1, 10, 100, 500, 1000)]
    [25, 8, 3, 2, 1]
    """
    width, height = shape
    return int(1 + math.sqrt(2 * width * height / (math.pi * n_observations)))


def half_widths(radius: int, steps: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return, for each i in `steps`, the largest whole j with ``i^2 + j^2 <= radius^2``."""
    # The floor is reliable, because square roots of perfect squares below 2^53 are exact.
    return np.floor(np.sqrt(radius**2 - steps**2)).astype(np.int32)


def centred_disk(radius: int) -> Disk:
    """Return the disk of all cells that are at most `radius` away from the observed cell.

    Examples
    --------
    >>> disk = centred_disk(1)
    >>> disk.first, disk.low.tolist(), disk.high.tolist()
    (-1, [0, -1, 0], [1, 2, 1])
    """
    half = half_widths(radius, np.arange(-radius, radius + 1))
    return Disk(-radius, -half, half + 1)


@dataclass(frozen=True, slots=True, eq=False)
class Painting:
    """The disks that must be painted to bring a map up to date."""

    tiles: NDArray[np.bool_]
    reset: bool
    """Whether cells outside the disks to paint are reset, because older disks are removed."""
    start: int
    """Index of the first observation to paint; disks of earlier observations are painted already."""
    x: NDArray[np.int32]
    """Observed cells from observation `start` on."""
    y: NDArray[np.int32]
    disk: Disk


class DiskMap:
    """The disks of all observations, and a record of the disks that are painted.

    The disks have the given radius, or by default `adaptive_radius`.
    """

    def __init__(self, shape: tuple[int, int], stamp: Stamp, radius: int | None) -> None:
        self.shape = shape
        self._cells = GrowingArray((2,), np.int32)
        self._stamp = stamp
        self._fixed_radius = radius
        self._radius = 0
        self._painted = 0
        self._covered = np.zeros(tile_shape(shape), np.bool_)

    def append(self, x: NDArray[np.int32], y: NDArray[np.int32]) -> None:
        """Add observations for the next call of `outstanding`."""
        self._cells.append(np.stack([x, y], axis=1))

    def copy(self) -> DiskMap:
        """Return a copy that does not change with this map."""
        other = DiskMap(self.shape, self._stamp, self._fixed_radius)
        other._cells.append(self._cells.array)
        other._radius, other._painted = self._radius, self._painted
        other._covered = self._covered.copy()
        return other

    def repaint(self) -> None:
        """Mark all disks as not painted."""
        self._radius = 0

    def outstanding(self) -> Painting:
        """Return the disks to paint, and mark them as painted.

        After a change of the radius, all disks must be painted, otherwise only the new disks. The tiles to
        paint are the tiles that these disks touch and, after a change, those that the old disks touch.
        """
        n = len(self._cells)
        radius = 0 if n == 0 else self._fixed_radius or adaptive_radius(n, self.shape)
        reset = radius != self._radius
        start = 0 if reset else self._painted
        x, y = self._cells.array[start:].T
        disk = self._stamp(max(radius, 1))
        left = x + disk.first
        tiles = tiles_of_boxes(
            self.shape, left, left + len(disk.low), y + disk.low.min(), y + disk.high.max()
        )
        if reset:
            tiles, self._covered = tiles | self._covered, tiles
        else:
            self._covered |= tiles
        self._radius, self._painted = radius, n
        return Painting(tiles, reset, start, x, y, disk)
