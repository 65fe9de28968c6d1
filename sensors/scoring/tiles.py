"""The square tiles in which estimators report what changed, and in which the score keeps its sums.

Tile (i, j) holds the cells ``[64 i, 64 (i + 1)) x [64 j, 64 (j + 1))``; those at the far borders are cut off
by the farm's border. A set of tiles is a boolean array with one entry per tile.

>>> tile_shape((6000, 5000))
(94, 79)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TILE_CELLS = 64
SQUARES, WORSE_SQUARES, ABSOLUTE, WORSE_ABSOLUTE = range(4)
SUMS = 4
"""Of a tile: squared and absolute errors, each of all cells and of those where the estimate is above."""


def tile_shape(shape: tuple[int, int]) -> tuple[int, int]:
    """Tell how many tiles a farm of this shape (in cells) has along x and y."""
    width, height = shape
    return -(-width // TILE_CELLS), -(-height // TILE_CELLS)


def tiles_of_boxes(
    shape: tuple[int, int],
    x0: NDArray[np.integer],
    x1: NDArray[np.integer],
    y0: NDArray[np.integer],
    y1: NDArray[np.integer],
) -> NDArray[np.bool_]:
    """Find the tiles that any of the boxes ``[x0, x1) x [y0, y1)`` touches.

    What lies outside the farm is cut off, empty boxes touch nothing.

    Examples
    --------
    >>> one = [np.array([v]) for v in (60, 65, 0, 1)]
    >>> tiles_of_boxes((200, 100), *one).astype(int).tolist()
    [[1, 0], [1, 0], [0, 0], [0, 0]]
    """
    width, height = shape
    x0, x1 = np.clip(x0, 0, width), np.clip(x1, 0, width)
    y0, y1 = np.clip(y0, 0, height), np.clip(y1, 0, height)
    some = (x0 < x1) & (y0 < y1)
    if width <= TILE_CELLS and height <= TILE_CELLS:
        # Small farms are updated after every observation: the sums below would cost more than the update.
        return np.array([[bool(some.any())]])
    left, low = x0[some] // TILE_CELLS, y0[some] // TILE_CELLS
    right, high = (x1[some] - 1) // TILE_CELLS + 1, (y1[some] - 1) // TILE_CELLS + 1
    columns, rows = tile_shape(shape)
    # Corners of the boxes; two running sums turn them into the number of boxes over each tile.
    count = np.zeros((columns + 1, rows + 1), np.int64)
    np.add.at(count, (left, low), 1)
    np.add.at(count, (right, high), 1)
    np.add.at(count, (left, high), -1)
    np.add.at(count, (right, low), -1)
    touched: NDArray[np.bool_] = count.cumsum(axis=0).cumsum(axis=1)[:columns, :rows] > 0
    return touched
