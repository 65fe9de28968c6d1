"""Compiled code that paints disks of cells, tile by tile.

The newest disk is painted first, so that each cell is written only once. In a tile of 64 x 64 cells, a row is
a 64-bit word with a bit for each cell that a newer disk has taken. A few bit operations per row find the
cells that remain for an older disk. A tile whose cells are all taken needs no older disks. The work is
therefore proportional to the number of observations plus the number of cells, not to the product of the two.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sensors.scoring.information import TILE_CELLS

_ALL = np.uint64(0xFFFFFFFFFFFFFFFF)
_ONE = np.uint64(1)
_ZERO = np.uint64(0)


class Strokes(NamedTuple):
    """Input of `paint`: the disks of n observations, newer disks over older disks, and the tiles to paint."""

    tiles: NDArray[np.bool_]  # Tiles to paint, bool[tiles along x, tiles along y].
    reset: bool  # Whether cells outside all disks get the default and uncertainty 1.
    x: NDArray[np.int32]  # Observed cells in order of time, int32[n].
    y: NDArray[np.int32]
    first: int  # Row i of a disk is the cells (x + first + i, y + low[i]..y + high[i] - 1).
    low: NDArray[np.int32]
    high: NDArray[np.int32]
    table: NDArray[np.float32]  # Value of each field in each disk, float32[fields, n].
    doubts: NDArray[np.float32]  # Uncertainty in each disk, float32[planes, n].
    defaults: NDArray[np.float32]  # Default value of each field, float32[fields].
    fields: NDArray[np.int64]  # Index of each field in the array of values.
    planes: NDArray[np.int64]  # Indices of the planes in the array of uncertainty.


@compiled(nogil=True)
def paint(
    strokes: Strokes,
    value: NDArray[np.float32],
    uncertainty: NDArray[np.float32],
    changed: NDArray[np.bool_],
) -> None:
    """Paint disks into the chosen tiles of the maps.

    Parameters
    ----------
    strokes : Strokes
        The disks and tiles.
    value, uncertainty : float32[fields, W, H], float32[1 or fields, W, H]
        Maps that are changed in place.
    changed : bool[tiles along x, tiles along y]
        Set to True for tiles with a changed cell.
    """
    tiles, reset, x, y, first, low, high, table, doubts, defaults, fields, planes = strokes
    width, height = value.shape[1], value.shape[2]
    rows = len(low)
    lowest, highest = 0, 0
    for i in range(rows):
        lowest, highest = min(lowest, low[i]), max(highest, high[i])
    taken = np.empty(TILE_CELLS, np.uint64)
    owner = np.empty((TILE_CELLS, TILE_CELLS), np.int32)
    near = np.empty(len(x), np.int32)
    for column in range(tiles.shape[0]):
        if not tiles[column].any():
            continue
        x0 = column * TILE_CELLS
        x1 = min(x0 + TILE_CELLS, width)
        # Collect the disks that overlap this column of tiles, newest first.
        count = 0
        for index in range(len(x) - 1, -1, -1):
            if x[index] + first < x1 and x[index] + first + rows > x0:
                near[count] = index
                count += 1
        for row in range(tiles.shape[1]):
            if not tiles[column, row]:
                continue
            y0 = row * TILE_CELLS
            size = min(TILE_CELLS, height - y0)
            full = _ALL >> np.uint64(TILE_CELLS - size)
            open_rows = x1 - x0
            taken[:open_rows] = _ZERO
            for position in range(count):
                index = near[position]
                centre = y[index] - y0
                if centre + lowest >= size or centre + highest <= 0:
                    continue
                left = x[index] + first
                for cell in range(max(left, x0), min(left + rows, x1)):
                    before = taken[cell - x0]
                    start = max(centre + low[cell - left], 0)
                    stop = min(centre + high[cell - left], size)
                    if before == full or start >= stop:
                        continue
                    span = (_ALL >> np.uint64(TILE_CELLS - (stop - start))) << np.uint64(start)
                    free = span & ~before
                    if free == _ZERO:
                        continue
                    taken[cell - x0] = before | span
                    if before | span == full:
                        open_rows -= 1
                    for j in range(start, stop):
                        if (free >> np.uint64(j)) & _ONE:
                            owner[cell - x0, j] = index
                if open_rows == 0:
                    break
            differs = False
            for cell in range(x0, x1):
                word = taken[cell - x0]
                if word == _ZERO and not reset:
                    continue
                for k in range(len(fields)):
                    target = value[fields[k], cell]
                    for j in range(size):
                        if (word >> np.uint64(j)) & _ONE:
                            new = table[k, owner[cell - x0, j]]
                        elif reset:
                            new = defaults[k]
                        else:
                            continue
                        differs |= target[y0 + j] != new
                        target[y0 + j] = new
                for p in range(len(planes)):
                    doubt = uncertainty[planes[p], cell]
                    for j in range(size):
                        if (word >> np.uint64(j)) & _ONE:
                            unsure = doubts[p, owner[cell - x0, j]]
                        elif reset:
                            unsure = np.float32(1.0)
                        else:
                            continue
                        differs |= doubt[y0 + j] != unsure
                        doubt[y0 + j] = unsure
            if differs:
                changed[column, row] = True
