from __future__ import annotations

from importlib.metadata import EntryPoint

import numpy as np
import pytest
import shapely

from geo.named import ParameterError
from mission.errors import PlanningError
from mission.planners import LengthBudget, PlanningRequest, make_planner, planner_names
from mission.planners import request as registry
from mission.planners.lawnmower import lawnmower
from mission.planners.spiral import spiral

NAMES = ["adaptive-lawnmower", "lawnmower", "random-waypoint", "spiral"]
REQUEST = PlanningRequest(shapely.box(0, 0, 60, 40), (0, 0), LengthBudget(900.0))


def installed(monkeypatch, *entries):
    points = [EntryPoint(name, value, registry.ENTRY_POINT_GROUP) for name, value in entries]
    monkeypatch.setattr(registry, "entry_points", lambda group: points)


def test_planners_are_found_by_name():
    assert set(NAMES) <= set(planner_names())
    chosen = make_planner(" Spiral ")
    assert (chosen.name, chosen.planner, chosen.parameters) == ("spiral", spiral, {})
    with pytest.raises(PlanningError) as caught:
        make_planner("zigzag")
    assert str(caught.value) == f"unknown planner 'zigzag': choose {', '.join(planner_names())}"


def test_planners_of_other_packages(monkeypatch):
    installed(
        monkeypatch,
        ("gone", "no_such_package.planning:planner"),
        ("empty", "mission.planners.lawnmower:nothing"),
        ("number", "mission.planners.sweep:_MAX_ROWS"),
        ("class", "mission.planners.path:PlannedPath"),
        ("rows", "mission.planners.lawnmower:lawnmower"),
    )
    assert planner_names() == ("class", "empty", "gone", "number", "rows")
    assert make_planner("ROWS").planner is lawnmower
    for name, text in {
        "gone": r"planner gone \(no_such_package.planning:planner\) cannot be loaded: No module named",
        "empty": "planner empty .* cannot be loaded: .* no attribute 'nothing'",
        "number": "planner number .* is not a callable: a planner is called with a PlanningRequest",
        "class": "planner class .* is a class; give an instance of it",
    }.items():
        with pytest.raises(PlanningError, match=text) as caught:
            make_planner(name)
        assert "\n" not in str(caught.value)


def test_parameters_come_from_the_text_or_by_name():
    by_text = make_planner("lawnmower:direction=0.3,min_spacing_m=5")
    by_name = make_planner("lawnmower", direction=0.3, min_spacing_m=5)
    assert by_text == by_name
    assert np.array_equal(by_text(REQUEST).points_m, by_name(REQUEST).points_m)
    assert not np.array_equal(by_text(REQUEST).points_m, make_planner("lawnmower")(REQUEST).points_m)
    changed = make_planner(by_text, direction="x")
    assert changed.parameters == {"direction": "x", "min_spacing_m": 5}
    assert make_planner(changed) == changed


def test_wrong_parameters_are_refused_before_planning():
    with pytest.raises(ParameterError, match=r"planner random-waypoint: unknown .* 'seed': choose waypoints"):
        make_planner("random-waypoint:seed=1")
    with pytest.raises(ParameterError, match="direction is given twice"):
        make_planner("lawnmower:direction=0", direction=1)


@pytest.mark.parametrize("name", ["lawnmower", "adaptive-lawnmower", "spiral"])
def test_the_least_spacing_holds(name):
    request = PlanningRequest(REQUEST.area, (0, 0), LengthBudget(50_000.0))
    assert make_planner(name)(request).spacing_m < 0.4
    assert 4.0 <= make_planner(name, min_spacing_m=4.0)(request).spacing_m < 4.5


@pytest.mark.parametrize("name", ["lawnmower", "spiral"])
def test_the_greatest_spacing_holds_or_the_budget_is_too_small(name):
    for limit in (700.0, 900.0, 1500.0):
        request = PlanningRequest(REQUEST.area, (0, 0), LengthBudget(limit))
        densest = make_planner(name)(request).spacing_m
        wider = make_planner(name, max_spacing_m=1.1 * densest)(request)
        assert wider.spacing_m == pytest.approx(densest, rel=2e-3)
        with pytest.raises(PlanningError, match=f"budget of {limit:g} m is too small: {name} with") as caught:
            make_planner(name, max_spacing_m=0.9 * densest)(request)
        least = float(str(caught.value).split("at least ")[1].split(" m")[0])
        enough = PlanningRequest(REQUEST.area, (0, 0), LengthBudget(least))
        assert make_planner(name, max_spacing_m=0.9 * densest)(enough).spacing_m <= 0.9 * densest


def test_both_limits_leave_room_or_are_refused():
    narrow = make_planner("lawnmower", min_spacing_m=3.0, max_spacing_m=3.01)
    with pytest.raises(
        PlanningError, match=r"rows at most 3\.01 m and at least 3 m apart do not fit into the 7 m"
    ):
        narrow(PlanningRequest(shapely.box(0, 0, 60, 7), (0, 0), LengthBudget(900.0), footprint_m=0.0))
    narrow(PlanningRequest(shapely.box(0, 0, 60, 6), (0, 0), LengthBudget(900.0), footprint_m=0.0))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("lawnmower:min_spacing_m=0", "min_spacing_m 0 is not a distance"),
        ("lawnmower:max_spacing_m=0.1", "max_spacing_m 0.1 is less than the footprint of 0.3048 m"),
        ("spiral:min_spacing_m=2,max_spacing_m=1", "max_spacing_m 1 is less than min_spacing_m of 2 m"),
        ("lawnmower:direction=up", "sweep direction 'up'"),
        ("adaptive-lawnmower:tomato_share=1", "tomato_share must be between 0 and 1, not 1"),
        ("random-waypoint:waypoints=0", "waypoints must be a whole number from 1 to 30000, not 0"),
    ],
)
def test_values_out_of_range_are_refused(text, says):
    with pytest.raises(PlanningError, match=says) as caught:
        make_planner(text)(REQUEST)
    assert "\n" not in str(caught.value)
