"""The exact posterior of a Gaussian process whose kernel is short against the farm.

As in `sensors.estimators.gp.posterior_exact` each observation adds a row ``V = L^-1 K(observed, all cells)``,
which is the covariance of that observation with all cells, given those before it. Far from the observation it
is nothing, so only a window of it is kept and used: another observation costs what lies within its reach,
however large the farm and however long the flight.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sensors.estimators.append_buffer import GrowingArray
from sensors.estimators.gp.posterior_by_cell import CellPosterior
from sensors.estimators.gp.posterior_exact import merge_repeated
from sensors.estimators.gp.rbf import Cells, Floats, RbfKernel

REACH_LENGTHS = 10.0
"""Observations act through each other a little farther than the kernel does; what lies beyond this loses up
to 4e-4 of the prior deviation of the mean, where tiles lose up to 2e-3. Looks that are repeated act as less
noise: with nine at every cell it is 3e-3, and 4e-3 by tiles."""
LEAST_NOISE = 0.1
"""With noise below this part of the amplitude observations act through each other farther than the window."""
MOST_CELLS = 250_000
"""Larger farms are solved tile by tile, which writes only what has changed."""
GROWING = 2.5
"""An array that grows has room for half as much again, and is copied to another when that is full."""


class WindowedPosterior(CellPosterior):
    """Mean and variance over all cells given the observations so far; see `CellPosterior`."""

    def __init__(self, shape: tuple[int, int], kernel: RbfKernel) -> None:
        super().__init__(shape, kernel)
        reach_x, reach_y = _reach(kernel)
        start = np.zeros(1, np.int32)
        self._along_x = kernel.amplitude * kernel.along_x(start, np.arange(reach_x + 1))[0]
        self._along_y = kernel.along_y(start, np.arange(reach_y + 1))[0]
        self._rows = GrowingArray((2 * reach_x + 1, 2 * reach_y + 1), np.float64)
        self._centres = GrowingArray((2,), np.int32)

    @staticmethod
    def fits(n_observations: int, shape: tuple[int, int], kernel: RbfKernel, most_bytes: float) -> bool:
        """Return whether so many observations can be taken as if exactly, in so much memory."""
        reach_x, reach_y = _reach(kernel)
        needed = 8.0 * n_observations * (2 * reach_x + 1) * (2 * reach_y + 1)
        noisy = kernel.noise >= LEAST_NOISE * kernel.amplitude
        return noisy and needed <= most_bytes and shape[0] * shape[1] <= MOST_CELLS

    def condition(self, x: Cells, y: Cells, values: Floats, weights: Floats | None = None) -> None:
        """Take further observations, each for a part of one.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the covariance of the observations is singular.
        """
        # Compiled code is loaded only if it is used.
        from sensors.estimators.gp.posterior_windowed import take_observations

        x, y, values, noise = merge_repeated(x, y, values, self.kernel.noise, weights)
        used = len(self._rows)
        self._rows.append(np.empty((len(x), *self._rows.array.shape[1:])))
        self._centres.append(np.zeros((len(x), 2), np.int32))
        done = take_observations(
            self._rows.array, self._centres.array, used, x, y, values, noise,
            self._along_x, self._along_y,
            self.response.reshape(2, *self.shape), self.variance.reshape(self.shape),
        )  # fmt: skip
        if not done:
            msg = "the covariance of the observations is singular"
            raise np.linalg.LinAlgError(msg)


def _reach(kernel: RbfKernel) -> tuple[int, int]:
    """Return how many cells a window reaches from its middle."""
    return math.ceil(REACH_LENGTHS * kernel.length_x), math.ceil(REACH_LENGTHS * kernel.length_y)


@compiled(nogil=True)
def take_observations(
    rows: Floats,
    centres: NDArray[np.int32],
    used: int,
    x: NDArray[np.int32],
    y: NDArray[np.int32],
    values: Floats,
    noise: Floats,
    along_x: Floats,
    along_y: Floats,
    response: Floats,
    variance: Floats,
) -> bool:
    """Take observations one after the other; return whether their covariance was positive.

    Parameters
    ----------
    rows : float64[n, 2 rx + 1, 2 ry + 1]
        Of each observation so far its row of V (`sensors.estimators.gp.posterior_exact`) in a window around
        it, with room for the new ones. Changed.
    centres : int32[n, 2]
        Their cells. Changed.
    used : int
        How many there are so far.
    x, y, values, noise
        The new ones, and the variances of their noise.
    along_x, along_y : float64[rx + 1], float64[ry + 1]
        The kernel's factors at distances of 0, 1, ... cells; the amplitude is in the first.
    response, variance : float64[2, W, H], float64[W, H]
        The posterior. Changed.
    """
    reach_x, reach_y = len(along_x) - 1, len(along_y) - 1
    side_x, side_y = 2 * reach_x + 1, 2 * reach_y + 1
    width, height = variance.shape
    for k in range(len(x)):
        at_x, at_y = x[k], y[k]
        row = rows[used]
        for i in range(side_x):
            for j in range(side_y):
                row[i, j] = along_x[abs(i - reach_x)] * along_y[abs(j - reach_y)]
        for n in range(used):
            dx, dy = at_x - centres[n, 0], at_y - centres[n, 1]
            if abs(dx) > reach_x or abs(dy) > reach_y:
                continue
            other = rows[n]
            part = other[reach_x + dx, reach_y + dy]
            low, high = max(0, -dy), min(side_y, side_y - dy)
            for i in range(max(0, -dx), min(side_x, side_x - dx)):
                mine, theirs = row[i, low:high], other[i + dx, low + dy : high + dy]
                for j in range(len(mine)):
                    mine[j] -= part * theirs[j]
        pivot = row[reach_x, reach_y] + noise[k]
        if not pivot > 0.0:
            return False
        scale = 1.0 / math.sqrt(pivot)
        by_value = scale * (values[k] - response[0, at_x, at_y])
        by_constant = scale * (1.0 - response[1, at_x, at_y])
        first_x, first_y = at_x - reach_x, at_y - reach_y
        for i in range(side_x):
            for j in range(side_y):
                row[i, j] *= scale
                cell_x, cell_y = first_x + i, first_y + j
                if 0 <= cell_x < width and 0 <= cell_y < height:
                    response[0, cell_x, cell_y] += by_value * row[i, j]
                    response[1, cell_x, cell_y] += by_constant * row[i, j]
                    variance[cell_x, cell_y] -= row[i, j] ** 2
        centres[used, 0], centres[used, 1] = at_x, at_y
        used += 1
    return True
