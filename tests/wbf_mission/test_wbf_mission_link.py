"""Upload and download over real sockets."""

import json
import socket
from pathlib import Path

import pytest
from stand_in import stand_in

from mission.files import read_mission, write_mission
from mission.model import Command, GeoPoint, Mission, MissionItem
from wbf_mission.cli.app import main


@pytest.fixture
def in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder of one's own, at a wide terminal."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    return tmp_path


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


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_upload_and_download_through_files(
    autopilot: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    mission = fenced_mission()
    up, down = tmp_path / "up.plan", tmp_path / "down.plan"
    write_mission(mission, up)
    with stand_in(autopilot) as (url, _):
        assert main(["upload", str(up), "--connect", url, "--json"]) == 0
        report = json.loads(capfd.readouterr().out)
        assert main(["download", "--connect", url, "--out", str(down)]) == 0
    assert report["verified"]
    assert report["items"] == {"fence": 4, "rally": 1, "mission": 42}
    onboard = read_mission(down)
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
def test_unreachable_vehicles_are_one_line(
    in_folder: Path, capfd: pytest.CaptureFixture[str], connect: str, says: str, code: int
) -> None:
    write_mission(fenced_mission(), in_folder / "up.plan")
    for command in (["upload", "up.plan"], ["download", "--out", "down.plan"]):
        assert main([*command, "--connect", connect, "--wait", "0.5", "--quiet"]) == code
        out, err = capfd.readouterr()
        assert out == ""
        assert err.startswith("error: ")
        assert says in err
        assert err.count("\n") == 1
    assert not (in_folder / "down.plan").exists()


def test_a_port_that_is_taken_is_one_line(capfd: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        code = main(["sim", "--listen", f"tcpin:127.0.0.1:{port}", "--no-camera", "--duration", "1"])
    err = capfd.readouterr().err
    assert code == 2
    assert str(port) in err
    assert err.count("\n") == 1
