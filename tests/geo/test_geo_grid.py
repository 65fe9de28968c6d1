"""Scan conversion against shapely, point by point."""

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from sweeps import sweep

from geo import FarmError, FarmGrid
from geo import grid as grid_module
from geo.grid import rasterise

SIZE = 24


def covered(polygon, width=SIZE, height=SIZE):
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5, indexing="ij")
    return shapely.intersects_xy(polygon, x, y)


def near_edge(polygon):
    x, y = np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5, indexing="ij")
    return shapely.distance(polygon.boundary, shapely.points(x, y)) < 1e-7


def painted(polygon, cell_size_m=1.0):
    return rasterise([(polygon, 1, True)], (SIZE, SIZE), cell_size_m).crop == 1


def star(centre, radii, snap):
    angles = np.linspace(0.0, 2 * np.pi, len(radii), endpoint=False)
    xy = np.array(centre) + np.array(radii)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    return shapely.Polygon(np.round(xy / snap) * snap if snap else xy)


STARS = st.builds(
    star,
    st.tuples(st.floats(-2.0, SIZE + 2.0), st.floats(-2.0, SIZE + 2.0)),
    st.lists(st.floats(0.5, 16.0), min_size=3, max_size=40),
    st.none(),
)
SNAPPED = st.builds(
    star,
    st.tuples(st.integers(0, SIZE).map(float), st.integers(0, SIZE).map(float)),
    st.lists(st.floats(1.0, 12.0), min_size=3, max_size=16),
    st.sampled_from([0.5, 0.25, 1.0]),
)


@given(STARS)
@sweep(few=50, many=150)
def test_any_polygon_as_shapely_sees_it_in_blocks_of_any_size(polygon):
    assume(polygon.is_valid)
    whole = painted(polygon)
    assert not ((whole != covered(polygon)) & ~near_edge(polygon)).any()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(grid_module, "_CROSSINGS_AT_ONCE", 3)
        np.testing.assert_array_equal(painted(polygon), whole)


@given(SNAPPED)
@sweep(few=60, many=200)
def test_centres_on_the_boundary_are_covered_exactly(polygon):
    assume(polygon.is_valid and polygon.area > 0)
    np.testing.assert_array_equal(painted(polygon), covered(polygon))


@given(
    st.tuples(st.integers(6, 18).map(float), st.integers(6, 18).map(float)),
    st.lists(st.floats(9.0, 14.0), min_size=8, max_size=12),
    st.lists(st.floats(2.0, 5.0), min_size=3, max_size=9),
    st.sampled_from([0.5, 0.25, 1.0]),
)
@sweep(few=50, many=300)
def test_holes(centre, outer_radii, inner_radii, snap):
    outer, inner = star(centre, outer_radii, snap), star(centre, inner_radii, snap)
    polygon = shapely.Polygon(outer.exterior, [inner.exterior])
    assume(polygon.is_valid)
    np.testing.assert_array_equal(painted(polygon), covered(polygon))


def test_near_upright_edge_through_a_centre():
    edge = shapely.Polygon([(10.4995, 0.5), (10.5005, 10000.5), (0, 10000.5), (0, 0.5)])
    cells = rasterise([(edge, 1, True)], (12, 10001), 1.0).crop
    assert cells[10, 5000] == 1
    assert cells[10, 4999] == 0
    assert cells[10, 5001] == 1
    assert cells[9].all()


def test_last_painted_wins_and_ownership_follows():
    grid = rasterise(
        [
            (shapely.box(0, 0, 4, 4), 1, True),
            (shapely.box(2, 0, 4, 4), 2, False),
            (shapely.box(3, 3, 9, 9), 4, True),
        ],
        (5, 4),
        1.0,
    )
    assert grid.crop[:, 0].tolist() == [1, 1, 2, 2, 0]
    assert grid.owned[:, 3].tolist() == [True, True, False, True, True]
    assert grid.crop[4, 3] == 4


def test_masks():
    crop = np.array([[0, 1, 2], [3, 1, 2]], np.int8)
    owned = np.array([[True, True, True], [True, False, False]])
    grid = FarmGrid((2, 3), 0.3048, crop, owned)
    assert grid.strawberry.tolist() == [[False, True, False], [False, False, False]]
    assert grid.tomato.tolist() == [[False, False, True], [False, False, False]]
    assert grid.planted.tolist() == [[False, True, True], [False, False, False]]
    assert grid.tomato is grid.tomato
    for array in (grid.crop, grid.owned, grid.tomato, grid.planted):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1
    crop[0, 0] = 1


def test_arrays_of_another_shape_are_refused():
    with pytest.raises(FarmError, match="do not fit"):
        FarmGrid((3, 2), 1.0, np.zeros((2, 3), np.int8), np.zeros((2, 3), bool))
