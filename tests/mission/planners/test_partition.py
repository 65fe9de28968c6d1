import numpy as np
import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st
from sweeps import sweep

from geo.farm import united
from mission.errors import PlanningError
from mission.planners.partition import PARTITIONS, power_cells, strips

FIELD = shapely.box(0.0, 0.0, 40.0, 30.0)
WITH_POND = FIELD.difference(shapely.box(10.0, 5.0, 30.0, 25.0))
TWO_FIELDS = shapely.MultiPolygon([shapely.box(0.0, 0.0, 10.0, 10.0), shapely.box(20.0, 0.0, 40.0, 10.0)])


@pytest.mark.parametrize("divide", PARTITIONS.values(), ids=PARTITIONS)
@pytest.mark.parametrize("area", [FIELD, WITH_POND, TWO_FIELDS], ids=["field", "pond", "two fields"])
@given(sizes=st.lists(st.floats(0.3, 1.0), min_size=1, max_size=6))
@example(sizes=[0.3046875, 0.8984375, 0.3125])
@example(
    sizes=[0.7303519499821155, 0.9579369764410774, 0.9141787443734557, 0.4903665490343019, 0.5325603194197843]
)
@sweep(few=2, many=12)
def test_parts_are_the_whole_area_without_overlap(divide, area, sizes):
    parts = divide(area, sizes)
    assert len(parts) == len(sizes)
    assert sum(part.area for part in parts) == pytest.approx(area.area, rel=1e-6)
    assert united(parts).symmetric_difference(area).area < 1e-6 * area.area
    if isinstance(area, shapely.Polygon):
        assert all(isinstance(part, shapely.Polygon) for part in parts)


@pytest.mark.parametrize("divide", PARTITIONS.values(), ids=PARTITIONS)
def test_parts_have_their_shares(divide):
    for count in (1, 2, 3, 5, 10):
        areas = np.array([part.area for part in divide(FIELD, [1.0] * count)])
        assert np.abs(areas * count / FIELD.area - 1.0).max() < 0.05
    areas = np.array([part.area for part in divide(FIELD, [0.5, 0.3, 0.2])]) / FIELD.area
    assert areas == pytest.approx([0.5, 0.3, 0.2], abs=0.01)


def test_strips_lie_across_the_longer_side():
    for angle in (0.0, 90.0, 33.0):
        field = shapely.affinity.rotate(shapely.box(0.0, 0.0, 90.0, 30.0), angle)
        parts = strips(field, [1.0, 1.0, 1.0])
        for part in parts:
            sides = np.hypot(*np.diff(shapely.get_coordinates(shapely.oriented_envelope(part))[:3], axis=0).T)
            assert sides == pytest.approx([30.0, 30.0], abs=1e-6)
        assert parts[0].distance(parts[2]) == pytest.approx(30.0)


def test_cells_are_more_compact_than_strips():
    def border(parts):
        return sum(part.length for part in parts)

    assert border(power_cells(FIELD, [1.0] * 6)) < 0.8 * border(strips(FIELD, [1.0] * 6))


def test_what_cannot_be_divided_is_refused():
    with pytest.raises(PlanningError, match="shares must be finite numbers above zero"):
        strips(FIELD, [1.0, 0.0])
    with pytest.raises(PlanningError, match="shares must be finite"):
        power_cells(FIELD, [1.0, float("nan")])
    with pytest.raises(PlanningError, match="too small for 2 vehicles"):
        strips(shapely.box(0.0, 0.0, 1e-5, 1e-5), [1.0, 1.0])
    with pytest.raises(PlanningError, match="too small for 3 vehicles"):
        strips(shapely.box(0.0, 0.0, 1e-5, 1.0), [1.0, 1.0, 1e-6])
