"""Waypoints that make an autopilot fly a path although it turns before it is there."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mission.errors import PlanningError
from mission.planners.cornering import Cornering
from mission.planners.path import distinct

PX4 = Cornering(2.0, overshoots=True)
POINTS = st.lists(st.tuples(st.floats(-30, 30), st.floats(-30, 30)), min_size=1, max_size=15)


def array(*points):
    return np.array(points, dtype=float)


def test_without_leads_the_waypoints_are_the_points():
    path = array((0, 0), (9, 0), (9, 0.001), (9, 9))
    for cornering in (Cornering(), Cornering(2.0), Cornering(0.4, overshoots=True)):
        sent = cornering.waypoints(path, (0.0, -5.0))
        assert sent.points_m.tolist() == [[0, 0], [9, 0], [9, 9]]
        assert sent.of_point.tolist() == [0, 1, 3] and sent.radius_m == cornering.radius_m


def test_a_corner_between_legs_has_two_waypoints():
    sent = PX4.waypoints(array((0, 0), (19, 0), (19, 19)), (-10.0, 0.0))
    assert sent.points_m.tolist() == [[0, 0], [20.5, 0], [19, -1.5], [19, 20.5]]
    assert sent.of_point.tolist() == [0, 1, 1, 2]


def test_no_leg_is_led_into_what_must_not_be_flown_over():
    path = array((0, 0), (20, 0), (20, 20))
    east = PX4.waypoints(path, avoid=shapely.box(20.5, -30, 30, 30))
    assert east.points_m.tolist() == [[-1.5, 0], [20, -1.5], [20, 21.5]]
    around = shapely.box(-50, -50, 70, 70) - shapely.box(-0.5, -0.5, 20.5, 20.5)
    assert PX4.waypoints(path, avoid=around).points_m.tolist() == path.tolist()


@pytest.mark.parametrize("radius_m", [-1.0, math.nan, math.inf])
def test_a_radius_is_finite_and_not_negative(radius_m):
    with pytest.raises(PlanningError, match="acceptance radius"):
        Cornering(radius_m)


@given(POINTS, st.tuples(st.floats(-30, 30), st.floats(-30, 30)) | st.none())
@example([(0.0, 0.0)], None)
@example([(0.0, 0.0), (5.0, 0.0), (0.0, 0.0)], (0.0, 0.0))
@settings(max_examples=200, deadline=None)
def test_each_point_is_still_flown_to(points, start):
    path = array(*points)
    sent = PX4.waypoints(path, start)
    kept = distinct(path)
    # In order, none left out but those that another waypoint coincides with.
    assert (np.diff(sent.of_point) >= 0).all() and set(sent.of_point) <= set(kept)
    assert len(kept) - len(set(sent.of_point)) <= np.sum(np.hypot(*np.diff(path[kept], axis=0).T) < 3.1)
    assert np.isfinite(sent.points_m).all()
    off = np.hypot(*(sent.points_m - path[sent.of_point]).T)
    assert ((off < 1e-9) | (abs(off - PX4.overshoot_m) < 1e-6)).all()
    steps = np.hypot(*np.diff(sent.points_m, axis=0).T)
    assert (steps >= 0.01).all()
    # Each lies on the line of a leg to or from its point.
    lines = [shapely.LineString(pair) for pair in zip(path[kept][:-1], path[kept][1:], strict=True)]
    for place, number in zip(sent.points_m, sent.of_point, strict=True):
        if not np.array_equal(place, path[number]):
            k = int(np.searchsorted(kept, number))
            near = lines[max(k - 1, 0) : k + 1]
            if start is not None and k == 0 and math.dist(start, path[number]) > 0.0:
                near = [*near, shapely.LineString([start, path[number]])]
            assert min(_off_line(one, place) for one in near) < 1e-6


def _off_line(line, place):
    """Distance from the straight line through the two ends."""
    (ax, ay), (bx, by) = line.coords
    length = math.hypot(bx - ax, by - ay)
    return abs((bx - ax) * (place[1] - ay) - (by - ay) * (place[0] - ax)) / length
