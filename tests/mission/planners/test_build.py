"""Planned paths, and missions built from paths."""

import math

import numpy as np
import pytest
import shapely

from geo.frame import LocalFrame
from mission.errors import PlanningError
from mission.model import Command, Frame
from mission.planners import LengthBudget, PlannedPath, PlanningRequest, WingPattern, build_mission
from mission.planners.cornering import Cornering

FRAME = LocalFrame(28.05, -82.15, 30.0, rotation_deg=20.0)
ARGUMENTS = {"frame": FRAME, "home_xy_m": (-5.0, -5.0), "altitude_m": 12.0, "speed_m_s": 6.0}


def planned(points, spacing=2.0):
    return PlannedPath(np.array(points, dtype=float), spacing, "test")


def test_the_items_are_in_the_documented_order():
    points = [(0, 0), (50, 0), (50, 0.005), (50, 2), (0, 2)]
    mission = build_mission(planned(points), camera_distance_m=0.5, **ARGUMENTS)
    assert [item.command for item in mission.items] == [22, 178, 16, 206, 16, 16, 16, 206, 20]
    takeoff, speed, first, start, *_, last, stop, _ = mission.items
    home = FRAME.to_wgs84(-5.0, -5.0)
    assert (takeoff.x, takeoff.y) == pytest.approx(home, abs=1e-7)
    assert (mission.home.latitude_deg, mission.home.longitude_deg) == pytest.approx(home, abs=1e-12)
    assert (takeoff.z, takeoff.param4, takeoff.frame) == (12.0, None, Frame.GLOBAL_RELATIVE_ALT)
    assert mission.home.altitude_m == 30.0
    assert (speed.param1, speed.param2, speed.param3) == (1.0, 6.0, -1.0)
    assert (first.param1, first.param2, first.param4, first.z) == (0.0, 0.0, None, 12.0)
    assert (start.param1, start.param3) == (0.5, 1.0)
    assert (stop.param1, stop.param3) == (0.0, 0.0)
    assert FRAME.from_wgs84(last.x, last.y) == pytest.approx((0.0, 2.0), abs=0.012)


@pytest.mark.parametrize("placed_start", [False, True])
@pytest.mark.parametrize("heading_deg", [0.0, 75.0, 200.0])
def test_a_fixed_wing_takes_off_and_lands_into_the_wind(heading_deg, placed_start):
    pattern = WingPattern(math.radians(heading_deg), 150.0, 240.0, 20.0, 60.0, placed_start)
    mission = build_mission(planned([(0, 0), (50, 0)]), pattern=pattern, **ARGUMENTS)
    takeoff, speed, *_, start, circle, land = mission.items
    assert [item.command for item in mission.items] == [22, 178, 16, 16, 189, 31, 21]
    assert (takeoff.z, speed.param1, speed.param2) == (12.0, 0.0, 6.0)

    def along_and_aside(item):
        """Metres ahead of home and to the right of it, seen along the heading."""
        x, y = FRAME.from_wgs84(item.x, item.y)
        turn = math.radians(FRAME.rotation_deg)
        east = (x + 5.0) * math.cos(turn) - (y + 5.0) * math.sin(turn)
        north = (x + 5.0) * math.sin(turn) + (y + 5.0) * math.cos(turn)
        sine, cosine = math.sin(pattern.heading_rad), math.cos(pattern.heading_rad)
        return (east * sine + north * cosine, east * cosine - north * sine)

    assert along_and_aside(takeoff) == pytest.approx((150.0, 0.0), abs=0.05)
    assert along_and_aside(circle) == pytest.approx((-240.0, 60.0), abs=0.05)
    assert along_and_aside(land) == pytest.approx((0.0, 0.0), abs=0.05)
    # Clockwise round a centre to the right: it leaves the circle on the final approach.
    assert (circle.param1, circle.param2, circle.param4, circle.z) == (1.0, 60.0, 1.0, 20.0)
    assert land.z == 0.0
    if placed_start:
        assert along_and_aside(start) == pytest.approx((-240.0, 0.0), abs=0.05)
        assert start.z == 20.0
    else:
        assert (start.x, start.y, start.z) == (0.0, 0.0, 0.0)
    without = build_mission(planned([(0, 0), (50, 0)]), pattern=pattern, return_home=False, **ARGUMENTS)
    assert without.items == mission.items[:-3]


def holds(mission):
    return [item.param1 for item in mission.items if item.command == Command.NAV_WAYPOINT]


def test_points_named_again_are_loiters_of_a_camera_that_counts_time():
    points = [(0, 0), (0, 0), (0, 0), (5, 0), (5, 0), (9, 0)]
    by_time = build_mission(planned(points), camera_interval_s=2.0, **ARGUMENTS)
    # The camera comes on at the first point, to which the vehicle is sent once more: that takes an interval.
    assert [item.command for item in by_time.items] == [22, 178, 16, 214, 16, 16, 16, 214, 20]
    assert holds(by_time) == [0.0, 2.0, 2.0, 0.0]
    before = build_mission(planned(points), camera_interval_s=2.0, camera_on_approach=True, **ARGUMENTS)
    assert holds(before) == [4.0, 2.0, 0.0]
    by_distance = build_mission(planned(points), camera_distance_m=0.5, **ARGUMENTS)
    assert holds(by_distance) == [0.0, 0.0, 0.0]


def test_waypoints_have_the_radius_and_the_leads_that_the_autopilot_wants():
    path = planned([(0, 0), (30, 0), (30, 1), (0, 1)])
    mission = build_mission(path, cornering=Cornering(2.0, overshoots=True), **ARGUMENTS)
    waypoints = [item for item in mission.items if item.command == Command.NAV_WAYPOINT]
    assert {item.param2 for item in waypoints} == {2.0}
    x, y = FRAME.from_wgs84(*np.array([(item.x, item.y) for item in waypoints]).T)
    # From home it comes another way than along the first row.
    expected = [(1.06, 1.06), (-1.5, 0), (31.5, 0), (31.5, 1), (-1.5, 1)]
    assert np.column_stack((x, y)) == pytest.approx(np.array(expected), abs=0.02)
    wall = shapely.box(30.5, -5.0, 40.0, 5.0)
    around = build_mission(path, cornering=Cornering(2.0, overshoots=True), avoid=wall, **ARGUMENTS)
    assert max(FRAME.from_wgs84(item.x, item.y)[0] for item in around.items[2:7]) < 30.1


def test_a_mission_has_at_most_65535_items():
    x = np.arange(65535.0)
    fits = planned(np.column_stack((x, x))[:65532])
    assert len(build_mission(fits, **ARGUMENTS).items) == 65535
    with pytest.raises(PlanningError, match="65535"):
        build_mission(planned(np.column_stack((x, x))[:65533]), **ARGUMENTS)


@pytest.mark.parametrize(
    ("name", "value"), [("altitude_m", 0.0), ("speed_m_s", -1.0), ("camera_interval_s", float("nan"))]
)
def test_numbers_out_of_range_are_refused(name, value):
    with pytest.raises(PlanningError, match="above zero") as caught:
        build_mission(planned([(0, 0), (1, 0)]), **{**ARGUMENTS, name: value})
    assert "\n" not in str(caught.value)


def test_only_one_way_to_fire_the_camera():
    with pytest.raises(PlanningError, match="one of"):
        build_mission(planned([(0, 0)]), camera_distance_m=1.0, camera_interval_s=1.0, **ARGUMENTS)


@pytest.mark.parametrize("points", [[], [(0.0, 1.0, 2.0)], [(0.0, float("nan"))]])
def test_paths_are_finite_pairs(points):
    with pytest.raises(PlanningError, match=r"a path (needs one or more|must be finite)"):
        planned(points)
    with pytest.raises(PlanningError, match="spacing"):
        planned([(0, 0)], -1.0)


BOW = shapely.Polygon([(0, 0), (10, 10), (10, 0), (0, 10)])


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"area": shapely.Polygon()}, "empty"),
        ({"area": BOW}, "valid"),
        ({"area": shapely.LineString([(0, 0), (1, 1)])}, "Polygon"),
        ({"start_xy_m": (float("nan"), 0.0)}, "start"),
        ({"footprint_m": -1.0}, "footprint"),
    ],
)
def test_requests_that_make_no_sense(changes, text):
    good = {"area": shapely.box(0, 0, 9, 9), "start_xy_m": (0.0, 0.0), "budget": LengthBudget(100.0)}
    PlanningRequest(**good)
    with pytest.raises(PlanningError, match=text) as caught:
        PlanningRequest(**{**good, **changes})
    assert "\n" not in str(caught.value)
