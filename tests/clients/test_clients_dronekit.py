"""DroneKit, which flies ArduPilot: a script of its guide, in a process and with packages of its own."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
SCRIPT = Path(__file__).with_name("dronekit_script.py")
STEPS = ("connected", "armable", "parameter set", "guided", "armed", "aloft", "gimbal turned", "under way")
STEPS += ("looks aside under way", "circle", "guided again", "leans", "mission kept", "second waypoint")
STEPS += ("home",)


def test_dronekit_flies_guided_turns_circles_leans_and_flies_a_mission(fly, tools, installed):
    # It imports `past`, of the package `future`, which it does not name.
    packages = installed("--no-deps", "dronekit==2.9.2", "monotonic", "future")
    flying = fly("ardupilot", speed=4.0)
    done = subprocess.run(
        [sys.executable, str(SCRIPT), f"tcp:127.0.0.1:{tools.port_of(flying.urls[0])}"],
        env={**os.environ, "PYTHONPATH": packages, "MAVLINK20": "1"},
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    told = [line for line in done.stdout.splitlines() if line.startswith(STEPS)]
    assert len(told) == len(STEPS), done.stdout
