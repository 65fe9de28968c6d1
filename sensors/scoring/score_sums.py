"""Compiled functions that sum the errors for a score. Only changed tiles are summed again.

Estimators report which tiles they changed. The errors of a tile are added cell by cell, along y and then
along x, so that equal errors have equal sums to the last bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sensors.scoring.information import ABSOLUTE, SQUARES, TILE_CELLS, WORSE_ABSOLUTE, WORSE_SQUARES


@compiled(inline="late", nogil=True, allocates=False)
def add_column(
    mask: NDArray[np.bool_],
    truth: NDArray[np.floating],
    estimate: NDArray[np.floating],
    x: int,
    y0: int,
    y1: int,
    sums: tuple[float, float, float, float],
) -> tuple[float, float, float, float]:
    """Add the errors of a column's relevant cells, from y0 to y1, to the sums, and return the sums."""
    squares, worse_squares, absolute, worse_absolute = sums
    for y in range(y0, y1):
        if mask[x, y]:
            error = np.float64(estimate[x, y]) - np.float64(truth[x, y])
            # A NaN is not > 0, but it is added to the sums over all cells.
            worse = error if error > 0.0 else 0.0
            squares += error * error
            worse_squares += worse * worse
            absolute += abs(error)
            worse_absolute += worse
    return squares, worse_squares, absolute, worse_absolute


@compiled(nogil=True)
def sum_errors(
    tiles: NDArray[np.bool_],
    cells: NDArray[np.int64],
    mask: NDArray[np.bool_],
    truth: NDArray[np.floating],
    estimate: NDArray[np.floating],
    sums: NDArray[np.float64],
) -> None:
    """Sum the errors of a field over the relevant cells (`mask`) in the given tiles.

    `cells` is the number of relevant cells in each tile. The sums are written to `sums`, float64[tiles along
    x, tiles along y, SUMS].
    """
    width, height = mask.shape
    for column in range(tiles.shape[0]):
        for row in range(tiles.shape[1]):
            if not tiles[column, row] or cells[column, row] == 0:
                continue
            added = (0.0, 0.0, 0.0, 0.0)
            y0, y1 = row * TILE_CELLS, min((row + 1) * TILE_CELLS, height)
            for x in range(column * TILE_CELLS, min((column + 1) * TILE_CELLS, width)):
                added = add_column(mask, truth, estimate, x, y0, y1, added)
            sums[column, row, SQUARES] = added[SQUARES]
            sums[column, row, WORSE_SQUARES] = added[WORSE_SQUARES]
            sums[column, row, ABSOLUTE] = added[ABSOLUTE]
            sums[column, row, WORSE_ABSOLUTE] = added[WORSE_ABSOLUTE]


@compiled(nogil=True)
def find_extremes(
    tiles: NDArray[np.bool_],
    lines: NDArray[np.int64],
    mask: NDArray[np.bool_],
    truth: NDArray[np.floating],
    estimate: NDArray[np.floating],
    above: NDArray[np.float64],
    below: NDArray[np.float64],
) -> None:
    """Find, in the given tiles, the largest errors above and below the truth on each line along x.

    Parameters
    ----------
    lines : int64[H]
        Number of relevant cells on each line; tiles without relevant lines are skipped.
    above, below : float64[tiles along x, H]
        Output, the largest difference on each line within each tile. It is NaN if a relevant cell has the
        difference NaN; NaN in other cells is ignored.
    """
    width, height = truth.shape
    for row in range(tiles.shape[1]):
        y0, y1 = row * TILE_CELLS, min((row + 1) * TILE_CELLS, height)
        if not lines[y0:y1].any():
            continue
        for column in range(tiles.shape[0]):
            if not tiles[column, row]:
                continue
            above[column, y0:y1] = -np.inf
            below[column, y0:y1] = -np.inf
            for x in range(column * TILE_CELLS, min((column + 1) * TILE_CELLS, width)):
                for y in range(y0, y1):
                    error = np.float64(estimate[x, y]) - np.float64(truth[x, y])
                    if error != error and not mask[x, y]:
                        continue
                    if error > above[column, y] or error != error:
                        above[column, y] = error
                    if -error > below[column, y] or error != error:
                        below[column, y] = -error
