"""What a new user does: start ``wbf-mission sim`` with its defaults, connect on the default ports, fly."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow


def skip_unless_free(*ports):
    for kind, port in ports:
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                pytest.skip(f"port {port} is in use: another simulator or ground station is running")


def take_off_and_land(system, tools, *, ardupilot=False):
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.telemetry import Telemetry

    telemetry, action = Telemetry(system), Action(system)
    if ardupilot:
        for name in ("health", "position", "landed_state", "home"):
            getattr(telemetry, f"set_rate_{name}")(4.0)
    tools.wait_until(telemetry.health_all_ok, what="health all ok")
    action.set_takeoff_altitude(3.0)
    action.arm()
    action.takeoff()
    tools.wait_until(lambda: telemetry.position().relative_altitude_m > 2.8, "takeoff")
    action.land()
    tools.wait_until(lambda: not telemetry.armed(), "landing")


def test_px4_by_default(sim, mavsdk_system, tools):
    """MAVSDK on the API port and a ground station on the other, at once."""
    from pymavlink import mavutil

    skip_unless_free((socket.SOCK_DGRAM, 14540), (socket.SOCK_DGRAM, 14550), (socket.SOCK_DGRAM, 18570))
    sim()
    station = mavutil.mavlink_connection("udpin:127.0.0.1:14550")
    assert station.wait_heartbeat(timeout=10) is not None
    assert station.recv_match(type="GLOBAL_POSITION_INT", blocking=True, timeout=10) is not None
    take_off_and_land(mavsdk_system("udpin://0.0.0.0:14540"), tools)
    station.close()


def test_ardupilot_by_default(sim, mavsdk_system, tools):
    skip_unless_free((socket.SOCK_STREAM, 5760))
    sim("--autopilot", "ardupilot")
    take_off_and_land(mavsdk_system("tcpout://127.0.0.1:5760"), tools, ardupilot=True)


EXAMPLES = (
    "mission.py",
    "takeoff_and_land.py",
    "asyncio/mission.py",
    "asyncio/takeoff_and_land.py",
    "asyncio/telemetry.py",
)


@pytest.mark.parametrize("example", EXAMPLES)
def test_examples_of_mavsdk_as_they_are(example, sim):
    """Unchanged, from a copy of MAVSDK's sources: MAVSDK_EXAMPLES=.../MAVSDK/py/mavsdk/examples."""
    script = Path(os.environ.get("MAVSDK_EXAMPLES", "MAVSDK_EXAMPLES")) / example
    if not script.exists():
        pytest.skip("MAVSDK_EXAMPLES does not name a directory with MAVSDK's examples")
    skip_unless_free((socket.SOCK_DGRAM, 14540), (socket.SOCK_DGRAM, 14550))
    sim("--home", "47.397742,8.545594,488", "--speed", "5", "--no-camera")
    arguments = ["udpin://0.0.0.0:14540"] if "mission" in example else []
    done = subprocess.run(
        [sys.executable, "-u", script, *arguments], capture_output=True, text=True, timeout=110
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Disarmed" in done.stdout or "Mission complete!" in done.stdout
