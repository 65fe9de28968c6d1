"""Velocity control: within every limit, as told, and the same however it is stepped."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from motion_limits import check_limits
from sweeps import sweep

from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.errors import VehicleError
from sim_vehicle.motion.columns import State
from sim_vehicle.motion.legs import ALONG, KEEP, Heading, Leg, Route
from sim_vehicle.motion.model import IdealRobot, MotionEvent
from sim_vehicle.motion.multirotor.model import Multirotor
from sim_vehicle.weather.wind import Wind

QUAD = replace(get_vehicle("quad"), battery=None)
FALSE_CALM = Wind(3.0, -2.0, gust_m_s=1.0, seed=3)


def aloft(height_m=50.0, wind=None, spec=QUAD):
    vehicle = Multirotor(spec, wind)
    vehicle.fly(Route.through([Leg((0.0, 0.0, height_m), 5.0)]))
    assert vehicle.advance(100_000) is MotionEvent.REACHED
    return vehicle


def run(vehicle, steps):
    states = [vehicle.state.copy()]
    for _ in range(steps):
        if vehicle.advance(1) is MotionEvent.REACHED:
            states.append(vehicle.state.copy())
            break
        states.append(vehicle.state.copy())
    return np.array(states)


SPEED = st.floats(-20.0, 20.0)
ORDER = st.tuples(
    SPEED,
    SPEED,
    st.floats(-6.0, 6.0),
    st.sampled_from([math.nan, 20.0, 55.0]),
    st.sampled_from([ALONG, KEEP, Heading.fixed(1.0), *map(Heading.turning, (0.0, 0.7, -5.0))]),
    st.integers(5, 250),
)


def obey(vehicle, order):
    *velocity, height, heading, _ = order
    vehicle.steer(tuple(velocity), height_m=height, heading=heading)


@example([(0.0, 1.0, 0.0, math.nan, KEEP, 5), (5e-324, 5e-324, 0.0, math.nan, KEEP, 5)], False)
@sweep(few=25, many=120)
@given(st.lists(ORDER, min_size=1, max_size=6), st.booleans())
def test_limits_hold_whatever_velocities_are_told(orders, windy):
    vehicle = aloft(wind=FALSE_CALM if windy else None)
    states = [vehicle.state.copy()[np.newaxis]]
    for order in orders:
        obey(vehicle, order)
        states.append(run(vehicle, order[-1])[1:])
    check_limits(np.vstack(states), QUAD)


# Velocity orders with their steps, and a place: 14.36, 14.11 and 14.02 of 14 m/s where only velocity legs had
# the limit on the sum of their axes. In the second the speed normal to the leg exceeds it, in the third that
# across the leg.
TOO_FAST = [
    ([((7.6, -16.9, 4.3), 180), ((14.0, -14.0, 3.5), 72), ((14.2, -5.1, -1.3), 31)], (25.7, -45.4)),
    ([((-9.8, 10.8, 2.4), 223)], (-12.4, 15.4)),
    ([((1.8, 17.5, -5.2), 196), ((-10.0, -12.8, -4.0), 151), ((-16.2, -5.9, 0.8), 152)], (-39.1, -20.5)),
]


def check_by_turns(orders, place):
    """Fly velocities and a place by turns, and to the place at last."""
    vehicle = aloft()
    states = [vehicle.state.copy()[np.newaxis]]
    for order in orders:
        obey(vehicle, order)
        states.append(run(vehicle, order[-1])[1:])
        vehicle.fly(Route.through([Leg((*place, 30.0), 12.0)]))
        states.append(run(vehicle, 60)[1:])
    states.append(run(vehicle, 6000)[1:])
    check_limits(np.vstack(states), QUAD)
    assert np.linalg.norm(states[-1][-1, :3] - (*place, 30.0)) < 0.06


@sweep(few=15, many=80)
@given(st.lists(ORDER, min_size=1, max_size=3), st.tuples(st.floats(-60, 60), st.floats(-60, 60)))
def test_limits_hold_between_velocities_and_places(orders, place):
    check_by_turns(orders, place)


@pytest.mark.parametrize(("orders", "place"), TOO_FAST)
def test_a_leg_that_begins_in_fast_flight_across_it_keeps_the_speed_limit(orders, place):
    check_by_turns([(*velocity, math.nan, KEEP, steps) for velocity, steps in orders], place)


@settings(max_examples=20, deadline=None)
@given(st.lists(ORDER, min_size=2, max_size=4), st.integers(2, 90))
def test_the_flight_does_not_depend_on_how_it_is_stepped(orders, chunk):
    def end(size):
        vehicle = aloft(wind=FALSE_CALM)
        for order in orders:
            obey(vehicle, order)
            left = order[-1]
            while left > 0:
                before = vehicle.step
                event = vehicle.advance(min(size, left))
                left -= vehicle.step - before
                if event is MotionEvent.REACHED:
                    break
        return vehicle.state.tobytes()

    assert end(chunk) == end(1)


@pytest.mark.parametrize("wanted", [(5.0, 0.0, 0.0), (0.0, -3.0, 1.0), (-4.0, 4.0, -2.0), (0.0, 0.0, 2.0)])
def test_a_velocity_comes_about_and_stays(wanted):
    vehicle = aloft()
    vehicle.steer(wanted)
    states = run(vehicle, 500)
    assert states[-1, 3:6] == pytest.approx(wanted, abs=1e-6)
    speed = np.linalg.norm(states[:, 3:6], axis=1)
    assert speed.max() <= np.linalg.norm(wanted) + 1e-3
    assert states[-1, 9] == pytest.approx(0.0, abs=1e-6), "the heading was to be kept"


def test_the_height_is_kept_while_it_flies_sideways():
    vehicle = aloft()
    vehicle.steer((4.0, 3.0, 99.0), height_m=60.0)
    run(vehicle, 1000)
    now = vehicle.snapshot()
    assert now.position_m[2] == pytest.approx(60.0, abs=1e-3)
    assert now.velocity_m_s == pytest.approx((4.0, 3.0, 0.0), abs=1e-4)


def test_the_ideal_robot_refuses():
    robot = IdealRobot(get_vehicle("ideal"))
    with pytest.raises(VehicleError, match="no velocity control"):
        robot.steer((1.0, 0.0, 0.0))


def test_over_what_it_looks_at_it_keeps_its_heading_however_it_is_stepped():
    def headings(size):
        vehicle = aloft()
        vehicle.look_at((0.0, 5.0))
        vehicle.fly(Route.through([Leg((0.0, 30.0, 50.0), 2.0, heading=Heading.fixed(2.0))]))
        found = []
        while vehicle.position_m[1] < 5.3:
            vehicle.advance(size)
            found.append(vehicle.state[State.HEADING])
        return found

    one_by_one = headings(1)
    np.testing.assert_array_equal(one_by_one[1::2], headings(2)[: len(one_by_one) // 2])
    assert abs((one_by_one[-1] + np.pi) % (2.0 * np.pi) - np.pi) < 0.02


def test_each_leg_of_a_route_has_its_own_time():
    vehicle = aloft()
    vehicle.fly(Route.through([Leg((1.0, 0.0, 50.0), 5.0, radius_m=0.5), Leg((1000.0, 0.0, 50.0), 5.0)]))
    assert vehicle.advance(20_000, stop_each=False) is MotionEvent.REACHED
