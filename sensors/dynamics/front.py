"""The front of an epidemic: which susceptible cells have infected neighbours, and how many.

Only cells near infected ones can change. The weighted number of infected neighbours is kept for every cell
and changed around cells that become infected or are removed, so a day costs as much as there are such cells,
however large the front has grown; the farm is never scanned. The arrays carry a margin of the kernel's
radius, so that neighbours need no test for the border.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sensors.dynamics.kernel import DistanceKernel

Cells = NDArray[np.intp]

FRONT_BYTES_A_CELL = 9
"""Memory of a front, by cells of the farm."""


class InfectionFront:
    """Susceptible cells near infected ones.

    Parameters
    ----------
    susceptible : bool[W, H]
        The cells that can be infected.
    kernel : DistanceKernel
        Weights of the neighbours.

    Notes
    -----
    Cells are given and returned as flat indices of the farm in C order. Memory: nine bytes a cell.
    """

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
        """Make cells infected; their neighbours join the front.

        Parameters
        ----------
        cells : intp[n]
            Different cells, in any order.
        """
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
        """Make infected cells removed: they no longer infect.

        Parameters
        ----------
        cells : intp[n]
            Cells that were given to `infect`.
        """
        centres = self._pad(cells)
        near, total = np.empty_like(centres), np.empty(centres.size, np.int64)
        for weight, step in self._steps:
            np.add(centres, step, out=near)
            self._total.take(near, out=total, mode="clip")
            total -= weight
            self._total[near] = total

    def exposed(self) -> tuple[Cells, NDArray[np.int64]]:
        """Find the susceptible cells with infected neighbours.

        Returns
        -------
        cells : intp[n]
            Flat indices, ascending.
        total : int64[n]
            Weighted number of infected neighbours in units of the kernel, at least 1.
        """
        front = np.sort(self._front[self._susceptible[self._front]])
        total = self._total.take(front)
        kept = total > 0
        # A cell that lost its infected neighbours and got new ones since the last call is listed twice.
        kept[1:] &= front[1:] != front[:-1]
        self._front = front[kept]
        return self._unpad(self._front), total[kept]
