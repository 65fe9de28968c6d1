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


def test_without_repeat_it_stays_and_without_waypoints_too():
    assert ideal_positions([(2, 0)], 4, repeat=False).tolist() == [[1, 0], [2, 0], [2, 0], [2, 0]]
    assert ideal_positions([], 2, start=(3.0, 4.0)).tolist() == [[3, 4], [3, 4]]


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


def test_batches_do_not_matter():
    def fly(steps):
        robot = IdealRobot(IDEAL)
        robot.fly(route((0, 0), (7.3, 2), (7.3, 9), (0, 0)))
        places = {}
        while robot.step < 60:
            robot.advance(min(steps, 60 - robot.step))
            places[robot.step] = robot.position_m
        return places, robot.arrivals.tolist()

    one, arrivals = fly(1)
    for steps in (2, 7, 60):
        many, same = fly(steps)
        assert same == arrivals
        assert all(one[step] == place for step, place in many.items())


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


def test_the_track_has_every_step():
    robot = IdealRobot(IDEAL)
    robot.track, robot.track_every = np.full((40, 3), np.nan), 1
    robot.fly(route((3, 0), (3, 3)))
    while robot.step < 6:
        robot.advance(6 - robot.step, stop_each=False)
    cells = robot.track[: robot.track_points, :2] / CELL
    assert cells == pytest.approx(np.array([(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (3, 2)]))
