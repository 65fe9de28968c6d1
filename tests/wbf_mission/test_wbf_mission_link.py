"""The simulator, upload and download, each its own process over real sockets."""

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from mission.files import read_mission, write_mission
from mission.model import Command, GeoPoint, Mission, MissionItem

LONG_S = 150.0  # a limit against hanging, not a measure


def spawn(*arguments: str, cwd: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "wbf_mission", *arguments]
    pipe = subprocess.PIPE
    return subprocess.Popen(
        command, cwd=cwd, stdout=pipe, stderr=pipe, text=True, env={**os.environ, "COLUMNS": "200"}
    )


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(params=["px4", "ardupilot"])
def simulator(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    port = free_port()
    process = spawn(
        "sim",
        "--autopilot",
        request.param,
        "--listen",
        f"tcpin:127.0.0.1:{port}",
        "--no-camera",
        cwd=tmp_path,
    )
    assert process.stderr is not None
    assert "Ctrl-C ends it" in process.stderr.readline()
    yield f"tcp:127.0.0.1:{port}"
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=LONG_S)
    assert process.returncode == 0, err
    assert "Simulator stopped" in out


def fenced_mission() -> Mission:
    places = [(28.05 + 0.0003 * i, -82.15 + 0.0002 * i) for i in range(40)]
    corners = [(28.04, -82.16), (28.04, -82.14), (28.07, -82.14), (28.07, -82.16)]
    return Mission(
        (
            MissionItem(Command.NAV_TAKEOFF, 3, param4=None, x=28.05, y=-82.15, z=10.0),
            *(MissionItem.waypoint(lat, lon, 10.0, acceptance_radius_m=1.0) for lat, lon in places),
            MissionItem(Command.NAV_RETURN_TO_LAUNCH),
        ),
        home=GeoPoint(28.05, -82.15, 30.0),
        fence=tuple(
            MissionItem(Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, 3, 4.0, x=lat, y=lon)
            for lat, lon in corners
        ),
        rally=(MissionItem(Command.NAV_RALLY_POINT, 3, x=28.051, y=-82.151, z=20.0),),
    )


def test_upload_and_download_through_files(simulator: str, tmp_path: Path) -> None:
    mission = fenced_mission()
    write_mission(mission, tmp_path / "up.plan")
    up = spawn("upload", "up.plan", "--connect", simulator, "--json", cwd=tmp_path)
    out, err = up.communicate(timeout=LONG_S)
    assert up.returncode == 0, err
    report = json.loads(out)
    assert report["verified"]
    assert report["items"] == {"fence": 4, "rally": 1, "mission": 42}
    down = spawn("download", "--connect", simulator, "--out", "down.plan", cwd=tmp_path)
    out, err = down.communicate(timeout=LONG_S)
    assert down.returncode == 0, err
    onboard = read_mission(tmp_path / "down.plan")
    assert [item.command for item in onboard.items] == [item.command for item in mission.items]
    assert [(item.x, item.y) for item in onboard.fence] == [(item.x, item.y) for item in mission.fence]
    assert len(onboard.rally) == 1


@pytest.mark.parametrize(
    ("connect", "says", "code"),
    [
        ("tcp:127.0.0.1:1", "127.0.0.1:1", 3),
        ("udpin:127.0.0.1:0", "no vehicle", 3),
        ("nonsense", "nonsense", 2),
        ("udp:127.0.0.1:99999", "99999", 2),
    ],
)
def test_unreachable_vehicles_are_one_line(tmp_path: Path, connect: str, says: str, code: int) -> None:
    write_mission(fenced_mission(), tmp_path / "up.plan")
    for command in (["upload", "up.plan"], ["download", "--out", "down.plan"]):
        process = spawn(*command, "--connect", connect, "--wait", "0.5", "--quiet", cwd=tmp_path)
        out, err = process.communicate(timeout=LONG_S)
        assert process.returncode == code
        assert out == ""
        assert err.startswith("error: ")
        assert says in err
        assert err.count("\n") == 1
    assert not (tmp_path / "down.plan").exists()


def test_a_port_that_is_taken_is_one_line(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        process = spawn(
            "sim", "--listen", f"tcpin:127.0.0.1:{port}", "--no-camera", "--duration", "1", cwd=tmp_path
        )
        _, err = process.communicate(timeout=LONG_S)
    assert process.returncode == 2
    assert str(port) in err
    assert err.count("\n") == 1
