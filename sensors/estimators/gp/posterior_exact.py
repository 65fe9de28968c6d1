"""The exact posterior of a Gaussian process over all cells of a farm, updated observation by observation.

Observations lie on cells, so the rows ``V = L^-1 K(observed, all cells)`` that belong to the growing Cholesky
factor L are also all that is needed to grow it: the new row of L is the column of V at the new cell. Another
observation costs O(observations x cells), and nothing is ever solved again.
"""

from __future__ import annotations

import numpy as np

from sensors.estimators.gp.posterior_by_cell import CellPosterior
from sensors.estimators.gp.rbf import Cells, Floats, RbfKernel, solve_lower

_BLOCK_ROWS = 128
_RESULT_ROWS = 3


def merge_repeated(
    x: Cells, y: Cells, values: Floats, noise: float, weights: Floats | None = None
) -> tuple[Cells, Cells, Floats, Floats]:
    """Merge observations of the same cell: their mean, with the noise variance divided by their number.

    For a Gaussian process this is exact: k looks with independent noise tell the same as their mean.

    Parameters
    ----------
    x, y : int32[n]
    values : float64[n]
    noise : float
        Variance of an observation's noise.
    weights : float64[n], optional
        The part of an observation that each counts for; its noise is `noise` divided by it.

    Returns
    -------
    x, y : int32[m]
        Distinct cells.
    values, noise : float64[m]
        Mean value and variance of its noise.

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
    """Mean and variance over all cells given the observations so far; see `CellPosterior`."""

    def __init__(self, shape: tuple[int, int], kernel: RbfKernel) -> None:
        super().__init__(shape, kernel)
        self._blocks: list[Floats] = []
        self._rows_in_last = _BLOCK_ROWS

    @staticmethod
    def bytes_needed(n_observations: int, shape: tuple[int, int]) -> int:
        """Return the memory that so many observations of different cells take."""
        rows = -(-n_observations // _BLOCK_ROWS) * _BLOCK_ROWS
        return 8 * (rows + _RESULT_ROWS) * shape[0] * shape[1]

    def condition(self, x: Cells, y: Cells, values: Floats, weights: Floats | None = None) -> None:
        """Take further observations, each for a part of one."""
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
        for block in self._filled():
            covariance -= block[:, cells].T @ block
        factor = np.linalg.cholesky(covariance[:, cells] + np.diag(noise))
        rows = solve_lower(factor, covariance)
        surprise = np.stack([values, np.ones_like(values)], axis=1) - self.response[:, cells].T
        weights = solve_lower(factor, np.ascontiguousarray(surprise))
        self.response += weights.T @ rows
        self.variance -= np.einsum("ij,ij->j", rows, rows)
        self._store(rows)

    def _filled(self) -> list[Floats]:
        return [*self._blocks[:-1], self._blocks[-1][: self._rows_in_last]] if self._blocks else []

    def _store(self, rows: Floats) -> None:
        while len(rows):
            if self._rows_in_last == _BLOCK_ROWS:
                self._blocks.append(np.empty((_BLOCK_ROWS, rows.shape[1])))
                self._rows_in_last = 0
            fitting = rows[: _BLOCK_ROWS - self._rows_in_last]
            self._blocks[-1][self._rows_in_last : self._rows_in_last + len(fitting)] = fitting
            self._rows_in_last += len(fitting)
            rows = rows[len(fitting) :]
