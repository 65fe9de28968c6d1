"""The older MAVSDK-Python (mavsdk below 4): gRPC and its bundled server, installed beside the present one."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow


@pytest.fixture(scope="session")
def grpc_path(installed):
    return installed("mavsdk<4")


def run_script(path, log, *arguments):
    """Run the script; its server dies with it, also when the script fails."""
    script = Path(__file__).with_name("grpc_script.py")
    with log.open("w") as output:
        process = subprocess.Popen(
            [sys.executable, str(script), *arguments],
            env={**os.environ, "PYTHONPATH": path},
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            return process.wait(60.0)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait(5.0)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_mission_and_a_takeoff(autopilot, grpc_path, fly, tools, tmp_path):
    if autopilot == "ardupilot":
        flying = fly(autopilot, speed=10.0)
        tools.request_streams(flying)
        address = f"tcpout://127.0.0.1:{tools.port_of(flying.urls[0])}"
    else:
        port = tools.free_port()
        flying = fly(autopilot, (f"udpout:127.0.0.1:{port}",), speed=10.0)
        address = f"udpin://127.0.0.1:{port}"
    places = json.dumps([flying.place(x, y) for x, y in ((0, 0), (12, 0), (12, 10), (0, 10))])
    log = tmp_path / "script.log"
    status = run_script(grpc_path, log, address, str(tools.free_port()), autopilot, places)
    assert status == 0, log.read_text()
    assert "landed" in log.read_text()
