"""Posteriors of a Gaussian process at all cells, updated observation by observation.

Let L be the Cholesky factor of the observations' covariance, and ``V = L^-1 K(observed, all cells)``.
Observations lie on cells. A further observation's row of L is therefore the column of V at the observed cell:
an update costs O(observations x cells), and nothing is solved again.

A row of V is the covariance of an observation with all cells, given the earlier observations. If the
lengthscale is short compared with the farm, a row vanishes far from its observation, and only a window of the
row is stored. The cost of an update then depends only on the window, not on the farm's size or the number of
observations.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from geo.linear_algebra import cholesky, product, solve_lower
from sensors.estimators.gp.rbf import Cells, Floats, RbfKernel
from sensors.observations import GrowingArray


class CellPosterior(ABC):
    """Posterior mean and variance of each cell of a farm.

    `response`, float64[2, W * H], holds two posterior means under a prior mean of zero: one for the observed
    values, the other as if all observed values were 1. Under a constant prior mean m, the posterior mean is
    ``m + response[0] - m * response[1]``. `variance` is the posterior variance of the latent function.
    """

    def __init__(self, shape: tuple[int, int], kernel: RbfKernel) -> None:
        cells = shape[0] * shape[1]
        self.shape = shape
        self.kernel = kernel
        self.response = np.zeros((2, cells))
        self.variance = np.full(cells, kernel.amplitude)

    @abstractmethod
    def condition(self, x: Cells, y: Cells, values: Floats, weights: Floats | None = None) -> None:
        """Update with further observations; `weights` divide the observations' noise variances."""


_BLOCK_ROWS = 128
_RESULT_ROWS = 3


def merge_repeated(
    x: Cells, y: Cells, values: Floats, noise: float, weights: Floats | None = None
) -> tuple[Cells, Cells, Floats, Floats]:
    """Merge observations of the same cell; return x, y, mean value and noise variance of each cell.

    A cell's noise variance is `noise` divided by the cell's number of observations, or by the sum of their
    `weights`. Merging is exact for a Gaussian process: k readings with independent noise are equivalent to
    the mean of the readings.

    Examples
    --------
    >>> cell = np.array([2, 1, 2], np.int32)
    >>> [part.tolist() for part in merge_repeated(cell, cell, np.array([1.0, 3.0, 2.0]), 0.5)]
    [[1, 2], [1, 2], [3.0, 1.5], [0.5, 0.25]]
    """
    keys = (x.astype(np.int64) << 32) | y
    distinct, inverse = np.unique(keys, return_inverse=True)
    count = np.bincount(inverse, weights, minlength=len(distinct))
    weighted = values if weights is None else weights * values
    means = np.bincount(inverse, weighted, minlength=len(distinct)) / count
    return (distinct >> 32).astype(np.int32), (distinct & 0xFFFFFFFF).astype(np.int32), means, noise / count


class ExactPosterior(CellPosterior):
    """Posterior that stores a row of V, with all cells, for each observation."""

    def __init__(self, shape: tuple[int, int], kernel: RbfKernel) -> None:
        super().__init__(shape, kernel)
        self._blocks: list[Floats] = []
        self._rows_in_last = _BLOCK_ROWS

    @staticmethod
    def bytes_needed(n_observations: int, shape: tuple[int, int]) -> int:
        """Return the bytes that `n_observations` of different cells need."""
        rows = -(-n_observations // _BLOCK_ROWS) * _BLOCK_ROWS
        return 8 * (rows + _RESULT_ROWS) * shape[0] * shape[1]

    def condition(self, x: Cells, y: Cells, values: Floats, weights: Floats | None = None) -> None:
        """Update with further observations; `weights` divide the observations' noise variances."""
        x, y, values, noise = merge_repeated(x, y, values, self.kernel.noise, weights)
        for start in range(0, len(x), _BLOCK_ROWS):
            part = slice(start, start + _BLOCK_ROWS)
            self._condition_block(x[part], y[part], values[part], noise[part])

    def _condition_block(self, x: Cells, y: Cells, values: Floats, noise: Floats) -> None:
        width, height = self.shape
        cells = x.astype(np.intp) * height + y
        factor_x = self.kernel.along_x(x, np.arange(width)) * self.kernel.amplitude
        factor_y = self.kernel.along_y(y, np.arange(height))
        covariance = (factor_x[:, :, None] * factor_y[:, None, :]).reshape(len(x), -1)
        for number, block in enumerate(self._blocks, 1):
            filled = block if number < len(self._blocks) else block[: self._rows_in_last]
            covariance -= product(filled[:, cells].T, filled)
        factor = cholesky(covariance[:, cells] + np.diag(noise))
        rows = solve_lower(factor, covariance)
        surprise = np.stack([values, np.ones_like(values)], axis=1) - self.response[:, cells].T
        weights = solve_lower(factor, np.ascontiguousarray(surprise))
        self.response += product(weights.T, rows)
        self.variance -= (rows * rows).sum(axis=0)
        self._store(rows)

    def _store(self, rows: Floats) -> None:
        while len(rows):
            if self._rows_in_last == _BLOCK_ROWS:
                self._blocks.append(np.empty((_BLOCK_ROWS, rows.shape[1])))
                self._rows_in_last = 0
            fitting = rows[: _BLOCK_ROWS - self._rows_in_last]
            self._blocks[-1][self._rows_in_last : self._rows_in_last + len(fitting)] = fitting
            self._rows_in_last += len(fitting)
            rows = rows[len(fitting) :]


REACH_LENGTHS = 10.0
"""Half the side of a window, in lengthscales. The window must exceed the kernel's range, because observations
also act through other observations. The mean's error is up to 4e-4 prior standard deviations (with tiles,
2e-3); with nine readings of every cell it is up to 3e-3 (with tiles, 4e-3)."""
LEAST_NOISE = 0.1
"""Least ratio of noise to amplitude for `WindowedPosterior`; with less, data act beyond the windows."""
MOST_CELLS = 250_000
"""Most cells for `WindowedPosterior`; on larger farms tiles are faster: they write only changed cells."""
GROWING = 2.5
"""Peak memory of a growing array, in multiples of its rows: a copy with 50 % more room is made beside it."""


class WindowedPosterior(CellPosterior):
    """Posterior that stores a window of a row of V for each observation."""

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
        """Return whether windows are accurate enough and `n_observations` windows fit into `most_bytes`."""
        reach_x, reach_y = _reach(kernel)
        needed = 8.0 * n_observations * (2 * reach_x + 1) * (2 * reach_y + 1)
        noisy = kernel.noise >= LEAST_NOISE * kernel.amplitude
        return noisy and needed <= most_bytes and shape[0] * shape[1] <= MOST_CELLS

    def condition(self, x: Cells, y: Cells, values: Floats, weights: Floats | None = None) -> None:
        """Update with further observations; `weights` divide the observations' noise variances."""
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
            raise np.linalg.LinAlgError("the covariance of the observations is singular")


def _reach(kernel: RbfKernel) -> tuple[int, int]:
    """Return half the side of a window along x and along y, in cells."""
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
    """Update the posterior observation by observation; return False if the covariance is singular.

    Parameters
    ----------
    rows : float64[n, 2 rx + 1, 2 ry + 1]
        For each observation, the window around it of its row of V (see the module), with room for the new
        observations. Changed in place.
    centres : int32[n, 2]
        Cell of each observation. Changed in place.
    used : int
        Number of earlier observations.
    x, y, values, noise
        Cells, values and noise variances of the new observations.
    along_x, along_y : float64[rx + 1], float64[ry + 1]
        Factors of the kernel at distances of 0, 1, ... cells; `along_x` includes the amplitude.
    response, variance : float64[2, W, H], float64[W, H]
        The posterior, see `CellPosterior`. Changed in place.
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
