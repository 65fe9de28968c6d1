"""Legs over uneven ground keep their height at and between the waypoints."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geo.frame import LocalFrame
from mission.errors import PlanningError
from mission.model import Command
from mission.planners import PlannedPath, build_mission
from mission.planners.build import TOLERANCE_M, HeightProfile, slope

HOME = (0.0, 0.0)


def hills(height_m: float, width_m: float, phase: float = 0.0):
    def ground(points: np.ndarray) -> np.ndarray:
        return 50.0 + height_m * np.sin(points[:, 0] / width_m + phase) * np.cos(points[:, 1] / width_m)

    return ground


def profile(ground, **more: float) -> HeightProfile:
    given = {"height_m": 30.0, "step_m": 1.0, "climb": 10.0, "descent": 10.0, **more}
    return HeightProfile(ground, home_m=HOME, **given)


def densely(points: np.ndarray, altitudes: np.ndarray, step_m: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """Return places along straight legs and the altitudes there, linear between waypoints."""
    places, heights = [], []
    for k in range(len(points) - 1):
        count = max(2, math.ceil(math.dist(points[k], points[k + 1]) / step_m))
        share = np.linspace(0.0, 1.0, count)
        places.append(points[k] + share[:, None] * (points[k + 1] - points[k]))
        heights.append(altitudes[k] + share * (altitudes[k + 1] - altitudes[k]))
    return np.vstack(places), np.concatenate(heights)


ways = st.lists(st.tuples(st.floats(-300, 300), st.floats(-300, 300)), min_size=2, max_size=6)


@settings(max_examples=40, deadline=None)
@given(ways, st.floats(0.0, 15.0), st.floats(20.0, 80.0), st.floats(0.0, 6.0))
def test_the_height_is_kept_within_a_metre_everywhere(way, height, width, phase) -> None:
    ground = hills(height, width, phase)
    path = np.vstack((HOME, np.array(way)))
    points, altitudes, owner = profile(ground).follow(path)
    places, z = densely(points, altitudes)
    above = z + ground(np.array([HOME]))[0] - ground(places)
    assert np.abs(above - 30.0).max() <= TOLERANCE_M
    last = np.append(np.diff(owner) > 0, True)
    assert np.allclose(points[last], path, rtol=0.0, atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(ways, st.floats(5.0, 25.0), st.floats(0.05, 0.3), st.floats(0.05, 0.3))
def test_steep_ground_is_flown_over_higher_and_never_lower(way, height, climb, descent) -> None:
    ground = hills(height, 30.0)
    path = np.vstack((HOME, np.array(way)))
    points, altitudes, _ = profile(ground, climb=climb, descent=descent).follow(path)
    places, z = densely(points, altitudes)
    assert (z + ground(np.array([HOME]))[0] - ground(places)).min() >= 30.0 - TOLERANCE_M
    steps = np.hypot(*np.diff(points, axis=0).T)
    rise = np.diff(altitudes)
    assert (rise <= climb * steps + 1e-6).all()
    assert (-rise <= descent * steps + 1e-6).all()


def test_a_mission_follows_the_ground_from_home_and_back() -> None:
    ground = hills(8.0, 40.0)
    path = PlannedPath(np.array([(100.0, 0.0), (100.0, 150.0), (0.0, 150.0)]), None, "test")
    frame = LocalFrame(28.05, -82.15)
    mission = build_mission(
        path, frame=frame, home_xy_m=HOME, altitude_m=30.0, speed_m_s=5.0, camera_distance_m=2.0,
        heights=profile(ground),
    )  # fmt: skip
    commands = [one.command for one in mission.items]
    assert commands[:2] == [Command.NAV_TAKEOFF, Command.DO_CHANGE_SPEED]
    assert commands[-1] == Command.NAV_RETURN_TO_LAUNCH
    on, off = [k for k, one in enumerate(commands) if one == Command.DO_SET_CAM_TRIGG_DIST]
    assert commands[on - 1] == commands[on + 1] == commands[off - 1] == Command.NAV_WAYPOINT
    waypoints = [(k, one) for k, one in enumerate(mission.items) if one.command == Command.NAV_WAYPOINT]
    xy = np.column_stack(frame.from_wgs84(*np.array([(one.x, one.y) for _, one in waypoints]).T))
    z = np.array([one.z for _, one in waypoints])
    # The camera comes on at the path's first point, and goes off at its last.
    assert xy[[k for k, _ in waypoints].index(on - 1)] == pytest.approx((100.0, 0.0), abs=0.01)
    assert xy[[k for k, _ in waypoints].index(off - 1)] == pytest.approx((0.0, 150.0), abs=0.01)
    assert xy[-1] == pytest.approx(HOME, abs=0.01)
    places, heights = densely(np.vstack((HOME, xy)), np.append(30.0, z))
    above = heights + ground(np.array([HOME]))[0] - ground(places)
    assert np.abs(above - 30.0).max() <= TOLERANCE_M


def test_impossible_slopes_and_endless_paths_are_refused() -> None:
    flat = lambda points: np.zeros(len(points))  # noqa: E731
    with pytest.raises(PlanningError, match="must be above zero"):
        profile(flat, climb=0.0).follow(np.array([HOME, (5.0, 0.0)]))
    with pytest.raises(PlanningError, match="too long for samples of the ground"):
        profile(flat, step_m=0.001).follow(np.array([HOME, (1e6, 0.0)]))
    assert slope(3.0, 0.0) == math.inf
