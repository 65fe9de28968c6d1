"""The command line flies the recorded missions as the real autopilots did, by its own telemetry log."""

import json
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil
from recordings import Flight, compare, load_recording

from wbf_mission.cli.app import main

FLIGHTS = Path(__file__).parents[1] / "data" / "flights"
# In the recorded climbs of PX4 a jump of its estimated height stops the vehicle for five seconds
# (docs/evidence/recorded-flights.md).
BY_CHANCE = "px4-climbs-holds"


def flown(path, recording):
    log = mavutil.mavlink_connection(str(path))
    rows, reached = [], {}
    behind = 1 if recording.autopilot == "ardupilot" else 0
    while (message := log.recv_match(type=["MISSION_ITEM_REACHED", "GLOBAL_POSITION_INT"])) is not None:
        if message.get_type() == "MISSION_ITEM_REACHED":
            reached.setdefault(message.seq - behind, message._timestamp)
            continue
        east, north = recording.frame.from_wgs84(message.lat / 1e7, message.lon / 1e7)
        velocity = message.vy / 100.0, message.vx / 100.0, -message.vz / 100.0
        rows.append((message._timestamp, east, north, message.relative_alt / 1e3, *velocity))
    table = np.array(rows)
    pairs = tuple((time_s, seq) for seq, time_s in reached.items())
    return Flight(table[:, 0], table[:, 1:4], table[:, 4:7], pairs, table[-1, 0])


# Among waypoints of half a metre PX4's errors decide how long it takes: sim_vehicle/motion/test_px4.py.
HALF_METRE = "px4-acceptance-half-metre"
NAMES = sorted(
    path.stem
    for path in FLIGHTS.glob("*.json")
    if json.loads(path.read_text()).get("vehicle", "copter") == "copter" and path.stem != HALF_METRE
)


# The vehicle alone flies all of them in the default suite, too: sim_vehicle/motion and mavlink.
QUICK = {"ardupilot-ground-takeoff-rtl", "px4-random-10"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow) for name in NAMES]
)
def test_a_recorded_mission_from_the_command_line(name, tmp_path, capsys):
    recording = load_recording(FLIGHTS / f"{name}.json")
    plan = FLIGHTS / f"{recording.name}.plan"
    command = ["fly", "--mission", str(plan), "--autopilot", recording.autopilot, "--out", str(tmp_path)]
    # Far from the farm it sees nothing, which the exit code tells.
    if "wind" in name:
        command += ["--wind", "5,270"]
    assert main([*command, "--estimator", "point", "--quiet", "--no-plots"]) == 1
    capsys.readouterr()
    flight = flown(tmp_path / "flight.tlog", recording)
    assert np.diff(flight.time_s).max() < 0.11
    result = compare(recording, flight)
    assert result.mean_m < 1.0
    assert result.p95_m < 2.5
    if name != BY_CHANCE:
        assert abs(result.time_error) < 0.02
        # Over seven minutes in the wind a few seconds of drift leave little of it, and PX4's errors some.
        assert "wind" in name or result.correlation > (0.6 if recording.autopilot == "px4" else 0.8)
