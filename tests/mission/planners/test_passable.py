"""Paths lead through passable land; rows are laid over the area that is to be seen."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from mission.errors import PlanningError
from mission.planners import LengthBudget, PlanningRequest, make_planner
from mission.planners.path import path_length

FIELD = shapely.box(0, 0, 90, 60)
POND = shapely.box(40, 20, 60, 40)
PLANNERS = ("lawnmower", "spiral", "adaptive-lawnmower", "random-waypoint")


def request(area: shapely.Polygon, limit_m: float = 900.0, **more: object) -> PlanningRequest:
    return PlanningRequest(area, (0.0, 0.0), LengthBudget(limit_m), 2.0, **more)  # type: ignore[arg-type]


def line(points: np.ndarray) -> shapely.LineString:
    return shapely.LineString(points)


@pytest.mark.parametrize("name", PLANNERS)
def test_without_more_land_the_path_is_the_same(name: str) -> None:
    area = FIELD - POND
    alone = make_planner(name)(request(area, seed=3))
    same = make_planner(name)(request(area, seed=3, passable=area))
    assert np.array_equal(alone.points_m, same.points_m)


@pytest.mark.parametrize("name", PLANNERS)
def test_paths_stay_in_the_passable_land_and_lead_over_what_is_not_to_be_seen(name: str) -> None:
    area, passable = FIELD - POND, FIELD
    path = make_planner(name)(request(area, seed=3, passable=passable))
    assert shapely.covers(shapely.buffer(passable, 1e-6), line(path.points_m))
    if name == "random-waypoint":
        assert line(path.points_m).intersects(shapely.buffer(POND, -1))


def test_rows_lead_over_a_small_pond_but_not_over_a_long_lake() -> None:
    lake = shapely.box(8, 5, 82, 55)
    for gap, over in ((shapely.box(44, 28, 46, 32), True), (lake, False)):
        path = make_planner("lawnmower")(request(FIELD - gap, 700.0, passable=FIELD))
        assert line(path.points_m).intersects(shapely.buffer(gap, -0.5)) is over


def test_fields_apart_are_reached_over_the_land_between() -> None:
    left, right = shapely.box(0, 0, 20, 40), shapely.box(60, 0, 80, 40)
    wall = shapely.box(39, -50, 41, 38)
    passable = shapely.box(-5, -5, 90, 45) - wall
    path = make_planner("spiral")(request(shapely.MultiPolygon([left, right]), 600.0, passable=passable))
    assert not line(path.points_m).intersects(shapely.buffer(wall, -0.01))
    assert path_length(path.points_m) <= 600.0


def test_the_passable_land_holds_the_area() -> None:
    with pytest.raises(PlanningError, match="outside the passable land"):
        request(FIELD, passable=FIELD - POND)
    with pytest.raises(PlanningError, match="row_spacing_m"):
        request(FIELD, row_spacing_m=0.0)
