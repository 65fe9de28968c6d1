"""Stamping disks on a farm: for every cell, the latest observation whose disk covers it.

Both adaptive disk estimators work on this owner map and look values up in it. The disks' total area is about
twice the farm's whatever their number, and a stamp is one masked copy: a map costs O(observations + cells).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sensors.estimators.growing import GrowingArray

Stamp = tuple[NDArray[np.bool_], int]
"""A disk as a square mask, and where the mask's first row and column lie relative to the observed cell."""


def adaptive_radius(n_observations: int, shape: tuple[int, int]) -> int:
    """Return the radius, in cells, at which all disks together have about twice the farm's area.

    The paper's rule, ``int(1 + sqrt(2 W H / (pi n)))``.

    Examples
    --------
    >>> [adaptive_radius(n, (31, 31)) for n in (1, 10, 100, 500, 1000)]
    [25, 8, 3, 2, 1]
    """
    width, height = shape
    return int(1 + math.sqrt(2 * width * height / (math.pi * n_observations)))


def centred_disk(radius: int) -> Stamp:
    """Return the cells at most `radius` from the observed one.

    Examples
    --------
    >>> centred_disk(1)[0].astype(int).tolist()
    [[0, 1, 0], [1, 1, 1], [0, 1, 0]]
    """
    mask = np.zeros((2 * radius + 1, 2 * radius + 1), np.bool_)
    for i in range(-radius, radius + 1):
        half = math.isqrt(radius * radius - i * i)
        mask[radius + i, radius - half : radius + half + 1] = True
    return mask, -radius


class DiskMap:
    """The latest observation that covers each cell, kept up to date while observations arrive.

    Parameters
    ----------
    shape : tuple of int
        Width and height of the farm in cells.
    stamp : callable
        Radius in, `Stamp` out.
    radius : int or None
        A fixed radius in cells, or None for `adaptive_radius`.

    """

    def __init__(self, shape: tuple[int, int], stamp: Callable[[int], Stamp], radius: int | None) -> None:
        self.shape = shape
        self._cells = GrowingArray((2,), np.int32)
        self._make_stamp = stamp
        self._fixed_radius = radius
        self._radius = -1
        self._stamp = stamp(0)
        self._stamped = 0
        self._owner = np.full(shape, -1, np.int32)

    def append(self, x: NDArray[np.int32], y: NDArray[np.int32]) -> None:
        """Take further observations; they are stamped when the map is next asked for."""
        self._cells.append(np.stack([x, y], axis=1))

    def copy(self) -> DiskMap:
        """Return a map of the same observations that grows on its own."""
        other = DiskMap(self.shape, self._make_stamp, self._fixed_radius)
        other.append(*self._cells.array.T)
        return other

    def owner(self) -> NDArray[np.int32]:
        """Return the index of each cell's latest observation, -1 where no disk reaches.

        Returns
        -------
        int32[W, H]
            Not a copy: it changes with the next call.
        """
        n = len(self._cells)
        if n > self._stamped:
            radius = self._fixed_radius or adaptive_radius(n, self.shape)
            if radius != self._radius:
                self._owner.fill(-1)
                self._radius, self._stamp, self._stamped = radius, self._make_stamp(radius), 0
            x, y = self._cells.array[self._stamped :].T
            _stamp_all(self._owner, x, y, self._stamped, *self._stamp)
            self._stamped = n
        return self._owner


def _stamp_all(
    owner: NDArray[np.int32],
    x: NDArray[np.int32],
    y: NDArray[np.int32],
    first: int,
    mask: NDArray[np.bool_],
    offset: int,
) -> None:
    width, height = owner.shape
    side = len(mask)
    left, low = x + offset, y + offset
    # All clipping is done on the arrays at once; the loop itself only slices and copies.
    windows = zip(
        np.clip(left, 0, width).tolist(),
        np.clip(left + side, 0, width).tolist(),
        np.clip(low, 0, height).tolist(),
        np.clip(low + side, 0, height).tolist(),
        left.tolist(),
        low.tolist(),
        strict=True,
    )
    for index, (x0, x1, y0, y1, i, j) in enumerate(windows, first):
        np.copyto(owner[x0:x1, y0:y1], index, where=mask[x0 - i : x1 - i, y0 - j : y1 - j])
