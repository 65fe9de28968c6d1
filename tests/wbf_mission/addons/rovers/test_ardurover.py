"""Rovers under ArduPilot's Rover beside recorded drives, and what its law does."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
from flight_measures import turns
from recordings import compare, fly_recording, load_recording

from geo.frame import LocalFrame
from mission.model import MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import flight_procedures, with_autopilot
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.motion.columns import State
from sim_vehicle.motion.legs import Leg, Route
from wbf_mission.addons.rovers.motion.layout import Wheels

FLIGHTS = Path(__file__).parents[3] / "data" / "flights"


HOME = LocalFrame(28.05, -82.15)


def rover(**parameters):
    return replace(with_autopilot(get_vehicle("rover"), "ardupilot", parameters), battery=None)


def motion_of(spec):
    return flight_procedures(spec).motion(spec, None, 0.0)


@pytest.fixture(scope="module", params=["lawnmower-20", "random-10"])
def recorded(request):
    recording = load_recording(FLIGHTS / f"ardurover-{request.param}.json")
    return recording, fly_recording(recording)


def test_it_drives_as_the_recorded_one(recorded):
    recording, flight = recorded
    result = compare(recording, flight)
    assert abs(result.time_error) < 0.005
    assert result.mean_m < 0.2
    assert result.p95_m < 0.4
    assert result.correlation > 0.98
    first, _ = flight.window(recording.items)
    assert first == pytest.approx(recording.flight.window(recording.items)[0] - 3.1, abs=0.5)


def test_it_takes_corners_as_the_recorded_one(recorded):
    recording, flight = recorded
    real, ours = turns((recording.flight, flight), recording.items, recording.frame)
    assert ours.miss_m == pytest.approx(real.miss_m, abs=0.15)
    assert ours.worst_overshoot_m == pytest.approx(real.worst_overshoot_m, abs=0.2)
    assert ours.radius_m == pytest.approx(real.radius_m, rel=0.05)
    assert ours.rate_deg_s == pytest.approx(real.rate_deg_s, rel=0.05)


def test_a_return_has_a_speed_of_its_own():
    spec = rover(RTL_SPEED=0.7)
    executor = MissionExecutor(spec, HOME)
    latitude, longitude = HOME.to_wgs84(0.0, 40.0)
    executor.mission.load((MissionItem(16, 3, 0, 0, 0, 0, latitude, longitude, 0.0), MissionItem(20, 2)))
    executor.arm()
    executor.start()
    speeds = {0: 0.0, 1: 0.0}
    for tick in range(1, 1200):
        executor.advance(0.1 * tick)
        if executor.mission.current_seq in speeds:
            speed = math.hypot(*executor.motion.snapshot().velocity_m_s[:2])
            speeds[executor.mission.current_seq] = max(speeds[executor.mission.current_seq], speed)
    assert speeds[0] == pytest.approx(1.5, abs=0.1)
    # The speed that the waypoint was reached with is behind it.
    assert speeds[1] == pytest.approx(0.7, abs=0.15)


def test_the_lateral_acceleration_is_limited():
    greatest = []
    for share in (0.6, 0.1):
        motion = motion_of(rover(ATC_TURN_MAX_G=share))
        motion.fly(Route.through([Leg((0.0, -30.0, 0.0), 1.5)]))
        lateral = 0.0
        while motion.arrivals[-1] < 0:
            motion.advance(1)
            speed = max(abs(float(motion.state[Wheels.SPEED])), 1.0)
            lateral = max(lateral, abs(float(motion.state[State.HEADING_RATE])) * speed)
        greatest.append(lateral / 9.81)
    # The integrator of the steering may take it a little beyond.
    assert greatest[1] < 1.1 * 0.1 < greatest[0]


def test_placed_under_way_it_keeps_its_speed():
    motion = motion_of(rover())
    motion.place_in_flight((0.0, 10.0, 0.0), (0.0, 1.5, 0.0), 0.0)
    motion.fly(Route.through([Leg((0.0, 60.0, 0.0), 1.5)]))
    slowest = 9.0
    for _ in range(400):
        motion.advance(1)
        slowest = min(slowest, float(motion.state[Wheels.SPEED]))
    assert slowest > 1.3
