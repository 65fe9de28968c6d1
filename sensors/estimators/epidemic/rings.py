"""Sums over rings of distances around cells, compiled: a row of neighbouring cells takes a few instructions.

Cells are given in C order. Those that follow each other along y share their work, so that all cells of a crop
cost little more than its rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled

REACH = 8
"""Rings lie within so many cells along each axis."""

Cells = NDArray[np.intp]
Floats32 = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Rings:
    """Which neighbours of a cell belong to which ring; the cell itself is in none.

    Parameters
    ----------
    number : intp[REACH + 1, REACH + 1]
        The ring of a neighbour so many cells away along x and along y; -1 for the cell itself.
    scales : float32[rings]
        What sums are multiplied by: one over the root of the ring's size, so that features have similar
        variances.
    """

    number: Cells
    scales: Floats32

    @classmethod
    def that_end_at(cls, ends: tuple[int, ...]) -> Rings:
        """Make rings that end at these squared distances, the last at least ``2 REACH^2``.

        >>> rings = Rings.that_end_at((1, 2, 128))
        >>> rings.number[:2, :3].tolist(), (rings.scales**-2).round().tolist()
        ([[-1, 0, 2], [0, 1, 2]], [4.0, 4.0, 280.0])
        """
        axis = np.arange(REACH + 1)
        squares = axis[:, None] ** 2 + axis**2
        number = np.searchsorted(ends, squares)
        number[0, 0] = -1
        # Each stands for its mirror images.
        images = np.where(axis > 0, 2, 1)
        sizes = np.bincount(number[squares > 0], (images[:, None] * images)[squares > 0], len(ends))
        return cls(number.astype(np.intp), (1.0 / np.sqrt(sizes)).astype(np.float32))

    def counts(self, codes: NDArray[np.uint8], most: int, x: Cells, y: Cells) -> Floats32:
        """Count the neighbours with each of the codes 1..most in each ring, scaled.

        Parameters
        ----------
        codes : uint8[W + 2 REACH, H + 2 REACH]
            A map with a margin.
        most : int
            The largest code that counts.
        x, y : intp[n]
            Cells of the farm.

        Returns
        -------
        float32[most * rings, n]
            The rings of code 1 first.
        """
        out = np.zeros((most, len(self.scales), len(x)), np.float32)
        _count(codes, x, y, self.number, out)
        out *= self.scales[:, None]
        return out.reshape(len(out) * len(self.scales), len(x))

    def sums(self, planes: Floats32, x: Cells, y: Cells) -> Floats32:
        """Sum maps over each ring, scaled.

        Parameters
        ----------
        planes : float32[k, W + 2 REACH, H + 2 REACH]
            Maps with a margin.
        x, y : intp[n]
            Cells of the farm.

        Returns
        -------
        float32[k * rings, n]
            The rings of the first map first.
        """
        out = np.zeros((len(planes), len(self.scales), len(x)), np.float32)
        _sum(planes, x, y, self.number, out)
        out *= self.scales[:, None]
        return out.reshape(len(out) * len(self.scales), len(x))


@compiled(nogil=True)
def _run_end(x: Cells, y: Cells, start: int) -> int:
    """Return where the cells that follow each other along y from `start` end."""
    end = start + 1
    while end < len(x) and x[end] == x[start] and y[end] == y[end - 1] + 1:
        end += 1
    return end


@compiled(nogil=True)
def _add(both: Floats32, number: Cells, out: Floats32) -> None:
    """Add the cells of two columns at one distance along x to the rings of a run of cells.

    `both` begins `REACH` cells before the run, and ends so many after it.
    """
    count = out.shape[1]
    for away in range(REACH + 1):
        ring = number[away]
        if ring < 0:
            continue
        target = out[ring]
        below, above = both[REACH - away :], both[REACH + away :]
        if away == 0:
            for j in range(count):
                target[j] += below[j]
        else:
            for j in range(count):
                target[j] += below[j] + above[j]


@compiled(nogil=True)
def _count(codes: NDArray[np.uint8], x: Cells, y: Cells, number: Cells, out: Floats32) -> None:
    both = np.empty(codes.shape[1], np.float32)
    start = 0
    while start < len(x):
        end = _run_end(x, y, start)
        length = end - start + 2 * REACH
        for away in range(REACH + 1):
            left = codes[x[start] + REACH - away, y[start] :]
            right = codes[x[start] + REACH + away, y[start] :]
            for code in range(len(out)):
                for j in range(length):
                    seen = np.float32(left[j] == code + 1)
                    both[j] = seen if away == 0 else seen + np.float32(right[j] == code + 1)
                _add(both, number[away], out[code, :, start:end])
        start = end


@compiled(nogil=True)
def _sum(planes: Floats32, x: Cells, y: Cells, number: Cells, out: Floats32) -> None:
    both = np.empty(planes.shape[2], np.float32)
    start = 0
    while start < len(x):
        end = _run_end(x, y, start)
        length = end - start + 2 * REACH
        for plane in range(len(planes)):
            for away in range(REACH + 1):
                left = planes[plane, x[start] + REACH - away, y[start] :]
                right = planes[plane, x[start] + REACH + away, y[start] :]
                for j in range(length):
                    both[j] = left[j] if away == 0 else left[j] + right[j]
                _add(both, number[away], out[plane, :, start:end])
        start = end
