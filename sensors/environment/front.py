"""The front of an epidemic: which susceptible cells have infected neighbours, and how many.

Only cells near infected ones can change, so the front is kept as a list of cells and updated by the cells
that became infected or were removed; the farm is never scanned. The arrays carry a margin of the kernel's
radius, so that neighbours need no test for the border.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sensors.environment.kernel import DistanceKernel

Cells = NDArray[np.intp]


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
    Cells are given and returned as flat indices of the farm in C order. Memory: three bytes a cell.
    """

    def __init__(self, susceptible: NDArray[np.bool_], kernel: DistanceKernel) -> None:
        width, height = susceptible.shape
        margin = kernel.radius
        self._kernel = kernel
        self._height = height
        self._stride = height + 2 * margin
        self._margin = margin
        padded = np.zeros((width + 2 * margin, self._stride), np.bool_)
        padded[margin : margin + width, margin : margin + height] = susceptible
        self._susceptible = padded.reshape(-1)
        self._infected = np.zeros(padded.size, np.uint8)
        self._listed = np.zeros(padded.size, np.bool_)
        self._front: Cells = np.empty(0, np.intp)
        self._steps = tuple(dx * self._stride + dy for dx, dy in kernel.offsets)

    def _pad(self, cells: Cells) -> Cells:
        x, y = np.divmod(cells, self._height)
        padded: Cells = (x + self._margin) * self._stride + (y + self._margin)
        return padded

    def _unpad(self, padded: Cells) -> Cells:
        x, y = np.divmod(padded, self._stride)
        cells: Cells = (x - self._margin) * self._height + (y - self._margin)
        return cells

    def infect(self, cells: Cells) -> None:
        """Make cells infected; their susceptible neighbours join the front.

        Parameters
        ----------
        cells : intp[n]
            Different cells, in any order.
        """
        centres = self._pad(cells)
        self._susceptible[centres] = False
        self._infected[centres] = 1
        joining = [self._front]
        for step in self._steps:
            near = centres + step
            near = near[~self._listed[near]]
            near = near[self._susceptible[near]]
            self._listed[near] = True
            joining.append(near)
        self._front = np.concatenate(joining)

    def remove(self, cells: Cells) -> None:
        """Make infected cells removed: they no longer infect.

        Parameters
        ----------
        cells : intp[n]
            Cells that were given to `infect`.
        """
        self._infected[self._pad(cells)] = 0

    def exposed(self) -> tuple[Cells, NDArray[np.int64]]:
        """Find the susceptible cells with infected neighbours.

        Returns
        -------
        cells : intp[n]
            Flat indices, ascending.
        total : int64[n]
            Weighted number of infected neighbours in units of the kernel, at least 1.
        """
        front = self._front
        kept = self._susceptible[front]
        front = np.sort(front[kept])
        total = np.zeros(front.size, np.int64)
        ring_count = np.empty(front.size, np.uint8)
        one = np.empty(front.size, np.uint8)
        # A view that starts at the neighbour of padded cell `origin` saves adding an offset to every index.
        origin = self._margin * self._stride + self._margin
        centres = front - origin
        for weight, ring in self._kernel.rings:
            ring_count.fill(0)
            for dx, dy in ring:
                np.take(self._infected[origin + dx * self._stride + dy :], centres, out=one, mode="clip")
                ring_count += one
            total += np.multiply(ring_count, weight, dtype=np.int64)
        alone = total == 0
        self._listed[front[alone]] = False
        self._front = front[~alone]
        return self._unpad(self._front), total[~alone]
