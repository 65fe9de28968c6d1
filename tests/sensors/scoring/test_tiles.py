"""Tiles: which ones boxes touch."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sensors.scoring.information import TILE_CELLS, tile_shape, tiles_of_boxes

shapes = st.tuples(st.integers(1, 300), st.integers(1, 300))
boxes = st.lists(st.tuples(*[st.integers(-100, 400)] * 4), max_size=6)


def painted(shape, corners):
    cells = np.zeros(shape, bool)
    for x0, x1, y0, y1 in corners:
        cells[max(x0, 0) : max(x1, 0), max(y0, 0) : max(y1, 0)] = True
    return cells


@given(shapes, boxes)
def test_the_tiles_are_those_that_hold_a_cell_of_a_box(shape, corners):
    cells = painted(shape, corners)
    tiles = tiles_of_boxes(shape, *np.array(corners, int).reshape(-1, 4).T)
    expected = np.zeros(tile_shape(shape), bool)
    for x, y in np.argwhere(cells):
        expected[x // TILE_CELLS, y // TILE_CELLS] = True
    np.testing.assert_array_equal(tiles, expected)
