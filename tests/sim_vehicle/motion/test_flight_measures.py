"""What the comparison with recorded flights reads off a flight, on flights whose answers are known."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest
import side_by_side
from flight_measures import phases, turns
from recordings import Flight, load_recording

from geo.frame import LocalFrame
from mission.model import Command, MissionItem

FLIGHTS = Path(__file__).parents[2] / "data" / "flights"
FRAME = LocalFrame(28.05, -82.15)
SPEED, RADIUS, BEYOND = 5.0, 8.0, 3.0
NAN = float("nan")


def waypoint(east, north):
    return MissionItem.waypoint(*FRAME.to_wgs84(east, north), 10.0)


def north_then_east():
    """Go 100 m north, pass 3 m beyond the corner, turn east with 8 m at 5 m/s."""
    straight = 100.0 + BEYOND - RADIUS
    bend = 0.5 * math.pi * RADIUS
    way = np.arange(0.0, straight + bend + 92.0, 0.1 * SPEED)
    angle = np.clip((way - straight) / RADIUS, 0.0, 0.5 * math.pi)
    after = np.maximum(way - straight - bend, 0.0)
    east = RADIUS * (1.0 - np.cos(angle)) + after
    north = np.minimum(way, straight) + RADIUS * np.sin(angle)
    time_s = way / SPEED
    velocity = SPEED * np.stack([np.sin(angle), np.cos(angle), 0.0 * angle], axis=1)
    reached = ((0.0, 0), (straight / SPEED, 1), (float(time_s[-1]), 2))
    return Flight(time_s, np.stack([east, north, 0.0 * east], axis=1), velocity, reached, NAN)


def test_a_turn_of_known_radius():
    items = waypoint(0.0, 0.0), waypoint(0.0, 100.0), waypoint(100.0, 100.0)
    (found,) = turns([north_then_east()], items, FRAME)
    assert found.radius_m == pytest.approx(RADIUS, rel=0.05)
    assert found.rate_deg_s == pytest.approx(math.degrees(SPEED / RADIUS), rel=0.02)
    assert found.overshoot_m == pytest.approx(BEYOND, abs=0.05)
    assert found.miss_m == pytest.approx(math.hypot(RADIUS, RADIUS - BEYOND) - RADIUS, abs=0.1)


def test_phases_of_a_flight_that_climbs_and_lands():
    # 10 s on the ground, 10 s up to 10 m, 40 s there, down in 20 s, 5 s until it disarms.
    time_s = np.arange(0.0, 85.0, 0.1)
    height = np.interp(time_s, [10.0, 20.0, 60.0, 80.0], [0.0, 10.0, 10.0, 0.0])
    position = np.stack([0.0 * time_s, 0.0 * time_s, height], axis=1)
    flight = Flight(time_s, position, 0.0 * position, ((25.0, 1), (45.0, 2)), 85.0)
    items = MissionItem(Command.NAV_TAKEOFF, 3, z=10.0), waypoint(0.0, 0.0), waypoint(0.0, 5.0)
    found = phases(flight, items, 10.0, flies=True)
    assert found.takeoff == pytest.approx(9.0, abs=0.15)
    assert (found.first, found.mission) == (15.0, 20.0)
    # It counts as descending from two metres below its height.
    assert found.home == pytest.approx(19.0, abs=0.15)
    assert found.landing == pytest.approx(21.0, abs=0.15)


def test_the_command_prints_a_recording_and_draws_its_vehicle(tmp_path, monkeypatch, capsys):
    arguments = ["side_by_side.py", "--only", "ardupilot-climbs", "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", arguments)
    side_by_side.main()
    printed = capsys.readouterr().out
    recording = load_recording(FLIGHTS / "ardupilot-climbs-holds.json")
    first, last = recording.flight.window(recording.items)
    assert f"| ardupilot-climbs-holds | ArduCopter | {last - first:.1f} s" in printed
    assert (tmp_path / "arducopter.png").stat().st_size > 10_000
