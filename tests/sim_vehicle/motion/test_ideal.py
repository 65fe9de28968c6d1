from pathlib import Path

import numpy as np
import pytest

from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.motion.legs import Leg, Route
from sim_vehicle.motion.model import IdealRobot, MotionEvent
from tests.support.ideal_robot import ideal_positions

GOLDEN = Path(__file__).parents[2] / "data" / "golden"
IDEAL = get_vehicle("ideal")
CELL = IDEAL.cell_m


@pytest.mark.parametrize("planner", ["lawnmower", "spiral"])
def test_the_positions_of_the_paper(planner):
    golden = np.load(GOLDEN / f"Miniberry-30_{planner}_AD.npz")
    steps = len(golden["positions"])
    places = ideal_positions(golden["waypoints"], steps)
    np.testing.assert_array_equal(places.astype(np.int32), golden["positions"][:, :2])
    np.testing.assert_array_equal(np.arange(steps), golden["positions"][:, 2])


def route(*cells, z=0.0):
    return Route.through([Leg((x * CELL, y * CELL, z), 1.0, radius_m=0.1) for x, y in cells])


def test_the_motion_model_visits_the_same_cells():
    waypoints = np.load(GOLDEN / "Miniberry-30_lawnmower_AD.npz")["waypoints"]
    robot = IdealRobot(IDEAL)
    robot.fly(route(*waypoints))
    expected = ideal_positions(waypoints, 300, repeat=False)
    for place in expected:
        robot.advance(1)
        assert np.array(robot.position_m[:2]) / CELL == pytest.approx(place, abs=0.06)


def test_heights_take_no_time_and_a_waypoint_here_takes_a_step():
    robot = IdealRobot(IDEAL)
    robot.fly(Route.through([Leg((0.0, 0.0, 5.0), 1.0)]))
    assert robot.advance(10) is MotionEvent.REACHED
    assert (robot.step, robot.position_m) == (0, (0.0, 0.0, 5.0))
    robot.fly(route((0, 0), (1, 0), z=5.0))
    assert robot.advance(10) is MotionEvent.REACHED
    assert robot.step == 1
    assert robot.advance(10) is MotionEvent.REACHED
    assert robot.step == 2
    assert robot.snapshot().velocity_m_s[0] == pytest.approx(CELL)
    assert robot.advance(10) is MotionEvent.RAN
    assert robot.step == 12
    assert robot.snapshot().velocity_m_s[0] == 0.0
