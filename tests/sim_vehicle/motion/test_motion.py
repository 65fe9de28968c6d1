import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from motion_limits import check_limits, check_steps
from sweeps import sweep

from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.motion.legs import ALONG, KEEP, Heading, Leg, Route
from sim_vehicle.motion.model import MotionEvent
from sim_vehicle.motion.multirotor.kernel import stopping_distance
from sim_vehicle.motion.multirotor.model import Multirotor
from sim_vehicle.weather.wind import Wind

REAL = get_vehicle("quad")
# Some legs here are longer than a battery.
QUAD = replace(REAL, battery=None)


def fly(legs, *, wind=None, spec=QUAD, chunk=1, vehicle=None, limit=400_000):
    """Fly the legs; return the vehicle and its states float64[n, STATE] after each call."""
    vehicle = vehicle or Multirotor(spec, wind)
    vehicle.fly(Route.through(legs))
    states = [vehicle.state.copy()]
    while vehicle.step < limit:
        event = vehicle.advance(chunk)
        states.append(vehicle.state.copy())
        if event is MotionEvent.STALLED or (event is MotionEvent.REACHED and vehicle.arrivals[-1] >= 0):
            return vehicle, np.array(states), event
    pytest.fail("the legs were never flown")


def leg(size, low, high):
    coordinate = st.floats(-size, size)
    radius = st.sampled_from([0.0, 0.1, 0.5, 1.0, 3.0])
    heading = st.sampled_from([ALONG, KEEP, *map(Heading.fixed, (0.0, 2.0, -7.0))])
    end = st.tuples(coordinate, coordinate, st.floats(low, high))
    return st.builds(Leg, end, st.floats(0.5, 20.0), radius, heading)


FARMS = st.one_of(
    st.lists(leg(5.0, 2.0, 3.0), min_size=1, max_size=8),
    st.lists(leg(60.0, 2.0, 40.0), min_size=1, max_size=6),
    st.lists(leg(400.0, 10.0, 11.0), min_size=1, max_size=3),
)


@sweep(few=20, many=100)
@given(FARMS)
def test_limits_hold_and_every_leg_is_flown(legs):
    vehicle, states, event = fly(legs)
    assert event is MotionEvent.REACHED
    check_limits(states, QUAD)
    for leg, when in zip(legs[:-1], vehicle.arrivals, strict=False):
        assert np.linalg.norm(states[when, :3] - leg.end_m) <= max(leg.radius_m, 0.05) + 1e-9
    assert np.linalg.norm(states[-1, :3] - legs[-1].end_m) <= 0.05
    assert np.all(np.diff(states[:, 11]) > 0.0)


@sweep(few=15, many=100)
@given(FARMS, FARMS, st.integers(1, 600))
def test_limits_hold_when_the_target_changes_on_the_way(first, second, steps):
    vehicle = Multirotor(QUAD)
    vehicle.fly(Route.through(first))
    for _ in range(steps):
        vehicle.advance(1)
    _, states, event = fly(second, vehicle=vehicle)
    assert event is MotionEvent.REACHED
    check_limits(states, QUAD)


@sweep(few=8, many=40)
@given(FARMS, st.booleans(), st.integers(2, 400))
def test_the_flight_does_not_depend_on_how_it_is_stepped(legs, gusts, chunk):
    wind = Wind(2.0, -1.0, gust_m_s=1.0 if gusts else 0.0, seed=7)
    check_steps(lambda: Multirotor(QUAD, wind), legs, chunk, 3000)


@pytest.mark.parametrize(
    ("distance", "speed"), [*itertools.product([0.02, 1.0, 60.0], [0.5, 5.0, 13.3]), (1500.0, 13.3)]
)
def test_a_stop_is_not_overshot(distance, speed):
    vehicle, states, _ = fly([Leg((distance, 0.0, 0.0), speed)])
    for _ in range(200):
        vehicle.advance(1)
        states = np.vstack([states, vehicle.state])
    assert states[:, 0].max() <= distance + 0.002
    assert vehicle.position_m[0] == pytest.approx(distance, abs=1e-3)
    assert states[:, 3].min() > -0.02
    assert np.abs(states[:, 1]).max() == 0.0


def test_a_long_leg_takes_the_time_of_its_profile():
    vehicle, states, _ = fly([Leg((1500.0, 0.0, 0.0), 10.0)])
    tangential, jerk = 0.8 * QUAD.acceleration_m_s2, 0.8 * QUAD.jerk_m_s3
    expected = 1500.0 / 10.0 + 10.0 / tangential + tangential / jerk
    assert vehicle.time_s == pytest.approx(expected, abs=0.5)
    assert states[:, 3].max() == pytest.approx(10.0, abs=1e-6)


@pytest.mark.parametrize("turn_deg", [20, 90, 150, 180])
@pytest.mark.parametrize("radius", [0.1, 2.0])
@pytest.mark.parametrize("speed", [3.0, 12.0])
def test_corners_are_flown_near_the_acceptance_radius(turn_deg, radius, speed):
    turn = math.radians(turn_deg)
    corner = np.array([80.0, 0.0])
    out = np.array([math.cos(turn), math.sin(turn)])
    end = corner + 80.0 * out
    legs = [Leg((*corner, 0.0), speed, radius), Leg((*end, 0.0), speed)]
    vehicle, states, _ = fly(legs)
    when = int(vehicle.arrivals[0])
    after = states[when:, :2] - corner
    aside = out[0] * after[:, 1] - out[1] * after[:, 0]
    # The vehicle leaves the first leg on the inner side of the corner and never swings out of the radius.
    assert np.abs(aside).max() <= radius * 1.05
    along = np.einsum("ij,j->i", after, out)
    assert along.min() >= -radius * 1.6
    assert np.hypot(states[when, 3], states[when, 4]) > 0.0
    check_limits(states, QUAD)


def test_the_vehicle_looks_along_the_path():
    _, states, _ = fly([Leg((0.0, 50.0, 0.0), 5.0, radius_m=1.0), Leg((50.0, 50.0, 0.0), 5.0)])
    assert states[-1, 9] == pytest.approx(math.pi / 2.0, abs=1e-3)
    _, west, _ = fly([Leg((-50.0, 0.0, 0.0), 5.0)])
    assert west[-1, 9] == pytest.approx(1.5 * math.pi, abs=1e-3)
    # The short way round: over north, not over south.
    assert not np.any((west[:, 9] > 0.1) & (west[:, 9] < 1.5 * math.pi - 0.1))
    _, fixed, _ = fly([Leg((-50.0, 0.0, 0.0), 5.0, heading=Heading.fixed(1.0))])
    assert fixed[-1, 9] == pytest.approx(1.0, abs=1e-3)
    _, kept, _ = fly([Leg((-50.0, 0.0, 0.0), 5.0, heading=KEEP)])
    assert np.all(kept[:, 9] == 0.0)


@given(st.floats(0.0, 15.0), st.floats(-3.0, 3.0), st.floats(0.5, 4.0), st.floats(0.5, 10.0))
def test_the_stopping_distance_is_that_of_the_braking_manoeuvre(v, a, limit, jerk):
    a = max(-limit, min(limit, a))
    if v < 0.1 or (a < 0.0 and v < 0.5 * a * a / jerk):
        return
    expected = stopping_distance(v, a, 0.0, limit, jerk)
    # The same by brute force: brake as hard as still allows to end without acceleration.
    x, dt = 0.0, 1e-3
    while v > 1e-4:
        braking = v + a * dt > 0.5 * a * a / jerk if a < 0.0 else True
        change = -jerk * dt if braking else jerk * dt
        a_next = max(-limit, min(a + change, limit))
        x += v * dt
        v += 0.5 * (a + a_next) * dt
        a = a_next
        if a >= 0.0 and v < 1e-2:
            break
    assert x == pytest.approx(expected, rel=0.03, abs=0.05)


def test_a_strong_wind_slows_the_way_against_it():
    there = [Leg((-200.0, 0.0, 0.0), 12.0)]
    calm, *_ = fly(there)
    against, states, event = fly(there, wind=Wind(10.0, 0.0))
    assert event is MotionEvent.REACHED
    assert against.time_s > 1.5 * calm.time_s
    air = np.hypot(states[5:, 3] - 10.0, states[5:, 4])
    assert air.max() <= QUAD.airspeed_limit_m_s + 1e-6
    across, *_ = fly(there, wind=Wind(0.0, 10.0))
    assert calm.time_s <= across.time_s < against.time_s
    assert calm.energy_j < against.energy_j


@pytest.mark.parametrize("wind", [Wind(17.0, 0.0), Wind(40.0, 0.0), Wind(0.0, 20.0), Wind(15.9, 3.0)])
def test_a_wind_that_is_too_strong_ends_in_a_stall_not_in_a_hang(wind):
    vehicle, _, event = fly([Leg((-200.0, 0.0, 0.0), 12.0)], wind=wind)
    assert event is MotionEvent.STALLED
    assert vehicle.time_s < 200.0


def test_the_stopping_point_is_where_it_stops():
    vehicle = Multirotor(QUAD)
    vehicle.fly(Route.through([Leg((300.0, 100.0, 20.0), 10.0)]))
    vehicle.advance(400)
    point = vehicle.stopping_point()
    _, states, _ = fly([Leg(point, 13.0, heading=KEEP)], vehicle=vehicle)
    assert np.linalg.norm(states[-1, :3] - point) < 0.05
    check_limits(states, QUAD)
    farthest = np.linalg.norm(states[:, :3] - states[0, :3], axis=1).max()
    assert farthest <= math.dist(point, states[0, :3]) + 0.01
