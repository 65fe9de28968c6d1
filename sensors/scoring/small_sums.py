"""The sums of the score in numpy, for farms of one tile: loading compiled code takes longer than the sums.

The same as `sensors.scoring.score_sums` to the last bit: cells are added one after the other, in order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["SUMS", "count_cells", "find_extremes", "sum_errors"]

SQUARES, WORSE_SQUARES, ABSOLUTE, WORSE_ABSOLUTE = range(4)
SUMS = 4


def count_cells(mask: NDArray[np.bool_], cells: NDArray[np.int64]) -> None:
    """Count the relevant cells of the only tile into `cells`."""
    cells[0, 0] = np.count_nonzero(mask)


def sum_errors(
    tiles: NDArray[np.bool_],
    cells: NDArray[np.int64],
    mask: NDArray[np.bool_],
    truth: NDArray[np.floating],
    estimate: NDArray[np.floating],
    sums: NDArray[np.float64],
) -> None:
    """Sum the errors of one field in its only tile: see `sensors.scoring.score_sums.sum_errors`."""
    if not tiles[0, 0] or cells[0, 0] == 0:
        return
    error = estimate[mask].astype(np.float64) - truth[mask]
    worse = np.where(error > 0.0, error, 0.0)
    terms = np.empty((SUMS, len(error)))
    terms[SQUARES], terms[WORSE_SQUARES] = error * error, worse * worse
    terms[ABSOLUTE], terms[WORSE_ABSOLUTE] = np.abs(error), worse
    sums[0, 0] = np.cumsum(terms, axis=1)[:, -1]


def find_extremes(
    tiles: NDArray[np.bool_],
    lines: NDArray[np.int64],
    mask: NDArray[np.bool_],
    truth: NDArray[np.floating],
    estimate: NDArray[np.floating],
    above: NDArray[np.float64],
    below: NDArray[np.float64],
) -> None:
    """Find how far the estimate is off on each line: see `sensors.scoring.score_sums.find_extremes`."""
    if not tiles[0, 0] or not lines.any():
        return
    error = estimate.astype(np.float64) - truth
    unknown = np.isnan(error) & ~mask
    if unknown.any():
        above[0] = np.where(unknown, -np.inf, error).max(axis=0)
        below[0] = np.where(unknown, -np.inf, -error).max(axis=0)
        return
    above[0] = error.max(axis=0)
    below[0] = -error.min(axis=0)
