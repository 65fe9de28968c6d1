"""Rovers under PX4 beside a recorded drive in its simulator, and what its parameters do."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
from flight_measures import turns
from recordings import compare, fly_recording, load_recording

from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import flight_procedures, with_autopilot
from sim_vehicle.motion.columns import State, record_of
from sim_vehicle.motion.legs import Leg, Route
from wbf_mission.addons.rovers.motion import layout as wheels
from wbf_mission.addons.rovers.motion.kernel import move
from wbf_mission.addons.rovers.motion.layout import Wheels

RECORDING = Path(__file__).parents[3] / "data" / "flights" / "px4-rover-random-10.json"


def rover(**parameters):
    return replace(with_autopilot(get_vehicle("rover"), "px4", parameters), battery=None)


def drive(spec, *ends, speed=1.5):
    motion = flight_procedures(spec).motion(spec, None, 0.0)
    motion.fly(Route.through([Leg((*end, 0.0), speed, 0.5) for end in ends]))
    states = []
    for _ in range(10_000):
        if motion.arrivals[-1] >= 0:
            break
        motion.advance(1)
        states.append(motion.state.copy())
    assert motion.arrivals[-1] >= 0
    return motion, states


@pytest.fixture(scope="module")
def recording():
    return load_recording(RECORDING)


@pytest.fixture(scope="module")
def flight(recording):
    return fly_recording(recording)


def test_it_drives_as_the_recorded_one(recording, flight):
    result = compare(recording, flight)
    assert abs(result.time_error) < 0.01
    assert result.mean_m < 0.3
    assert result.p95_m < 0.6
    first, real = (one.window(recording.items)[0] for one in (flight, recording.flight))
    assert first == pytest.approx(real - 3.0, rel=0.03)


def test_it_takes_the_corner_that_is_recorded_without_gaps_as_that_one(recording, flight):
    real, ours = turns((recording.flight, flight), recording.items, recording.frame)
    assert ours.miss_m == pytest.approx(real.miss_m, abs=0.1)
    assert ours.radius_m == pytest.approx(real.radius_m, rel=0.15)
    # Of the course, of which the recording has no sample for 0.3 s where it turns most quickly.
    assert ours.rate_deg_s == pytest.approx(real.rate_deg_s, rel=0.2)


def test_the_simulated_rover_turns_and_slips_as_its_tyres_let_it(recording):
    spec = recording.spec()
    motion = flight_procedures(spec).motion(spec, None, 0.0)
    motion.fly(Route.through([Leg((0.0, -60.0, 0.0), 3.0, 0.5)]))
    motion.advance(200)
    motion.state[Wheels.STEER] = motion.state[Wheels.STEER_ASKED] = 1.0
    base, angle, stiffness, damping, mass = 0.321, math.radians(30.0), 500.0, 10.0, 20.0
    limits = record_of(motion._limits, wheels.LIMITS)
    limits.drag = limits.friction = 0.0
    for _ in range(300):
        motion.state[Wheels.SPEED] = 2.0
        move(record_of(motion.state, wheels.STATE), limits)
    rate = 2.0 * angle / (base + damping * 2.0 / (stiffness * base))
    assert motion.state[State.HEADING_RATE] == pytest.approx(rate, rel=1e-3)
    # The turn is counted twice in the sideways speed (`sih.cpp`).
    slip = 2.0 * (0.5 * angle - mass * 2.0 * rate / stiffness)
    assert motion.state[Wheels.SIDEWAYS] == pytest.approx(slip, rel=1e-3)


def test_the_simulated_rover_is_faster_across_the_axes_of_the_earth(recording):
    spec = recording.spec()
    speeds = {}
    for bearing in (45.0, 90.0):
        angle = math.radians(bearing)
        _, states = drive(spec, (60.0 * math.sin(angle), 60.0 * math.cos(angle)), speed=3.0)
        speeds[bearing] = float(states[len(states) // 2][Wheels.SPEED])
    # Medians of the recording on legs of about these headings: 3.2 and 2.6 m/s.
    assert speeds[45.0] == pytest.approx(3.2, abs=0.1)
    assert speeds[90.0] == pytest.approx(2.6, abs=0.1)


def test_corners_slow_it_down_as_asked():
    slowest = []
    for share in (-1.0, 0.3, 1.0):
        spec = rover(RO_SPEED_RED=share, RO_YAW_RATE_LIM=30.0, RO_MAX_THR_SPEED=1.5)
        motion, states = drive(spec, (0.0, 20.0), (20.0, 20.0))
        corner = int(motion.arrivals[0])
        slowest.append(min(float(state[Wheels.SPEED]) for state in states[corner - 50 : corner + 50]))
    assert slowest[1] == pytest.approx(1.5 * (1.0 - 0.3 * 0.5), abs=0.1)
    assert slowest[2] == pytest.approx(1.5 * 0.5, abs=0.1)
