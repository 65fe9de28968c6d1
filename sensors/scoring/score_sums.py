"""The compiled sums of the score, kept for each tile, so that only tiles that changed are summed again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sensors.scoring.small_sums import ABSOLUTE, SQUARES, WORSE_ABSOLUTE, WORSE_SQUARES
from sensors.scoring.tiles import TILE_CELLS


@compiled(nogil=True)
def count_cells(mask: NDArray[np.bool_], cells: NDArray[np.int64]) -> None:
    """Count the relevant cells of each tile into `cells`."""
    width, height = mask.shape
    for column in range(cells.shape[0]):
        for row in range(cells.shape[1]):
            count = 0
            for x in range(column * TILE_CELLS, min((column + 1) * TILE_CELLS, width)):
                for y in range(row * TILE_CELLS, min((row + 1) * TILE_CELLS, height)):
                    count += mask[x, y]
            cells[column, row] = count


@compiled(nogil=True)
def sum_errors(
    tiles: NDArray[np.bool_],
    cells: NDArray[np.int64],
    mask: NDArray[np.bool_],
    truth: NDArray[np.floating],
    estimate: NDArray[np.floating],
    sums: NDArray[np.float64],
) -> None:
    """Sum the errors of one field anew in some tiles.

    Parameters
    ----------
    tiles : bool[tiles along x, tiles along y]
        Where to sum.
    cells : int64[tiles along x, tiles along y]
        Relevant cells of each tile.
    mask : bool[W, H]
        The relevant cells; nothing else is looked at.
    truth, estimate : float[W, H]
    sums : float64[tiles along x, tiles along y, SUMS]
        Written: squared and absolute errors, each of all cells and of those where the estimate is above.
    """
    width, height = mask.shape
    for column in range(tiles.shape[0]):
        for row in range(tiles.shape[1]):
            if not tiles[column, row] or cells[column, row] == 0:
                continue
            squares = worse_squares = absolute = worse_absolute = 0.0
            for x in range(column * TILE_CELLS, min((column + 1) * TILE_CELLS, width)):
                for y in range(row * TILE_CELLS, min((row + 1) * TILE_CELLS, height)):
                    if mask[x, y]:
                        error = np.float64(estimate[x, y]) - np.float64(truth[x, y])
                        # A NaN fails the comparison and goes into the plain sums.
                        worse = error if error > 0.0 else 0.0
                        squares += error * error
                        worse_squares += worse * worse
                        absolute += abs(error)
                        worse_absolute += worse
            sums[column, row, SQUARES] = squares
            sums[column, row, WORSE_SQUARES] = worse_squares
            sums[column, row, ABSOLUTE] = absolute
            sums[column, row, WORSE_ABSOLUTE] = worse_absolute


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
    """Find how far the estimate is above and below the truth on each line along x, anew in some tiles.

    Parameters
    ----------
    tiles : bool[tiles along x, tiles along y]
        Where to look.
    lines : int64[H]
        Relevant cells of each line; tiles that no line with any runs through are left out.
    mask : bool[W, H]
        The relevant cells.
    truth, estimate : float[W, H]
    above, below : float64[tiles along x, H]
        Written: the largest difference on the part of each line in each tile; NaN if that of a relevant
        cell is NaN, while a NaN elsewhere is passed over.
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
