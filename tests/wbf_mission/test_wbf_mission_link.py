"""Upload to and download from vehicles that are not there."""

import pytest

from mission.files import write_mission
from mission.model import Mission, MissionItem
from wbf_mission.cli.app import main


@pytest.mark.parametrize(
    ("connect", "says", "code"),
    [
        ("tcp:127.0.0.1:1", "127.0.0.1:1", 3),
        ("udpin:127.0.0.1:0", "no vehicle", 3),
        ("nonsense", "nonsense", 2),
        ("udp:127.0.0.1:99999", "99999", 2),
    ],
)
def test_unreachable_vehicles_are_one_line(tmp_path, monkeypatch, capfd, connect, says, code):
    monkeypatch.chdir(tmp_path)
    write_mission(Mission((MissionItem.waypoint(28.05, -82.15, 10.0),)), tmp_path / "up.plan")
    for command in (["upload", "up.plan"], ["download", "--out", "down.plan"]):
        assert main([*command, "--connect", connect, "--wait", "0.1", "--quiet"]) == code
        out, err = capfd.readouterr()
        assert out == ""
        assert err.startswith("error: ") and says in err and err.count("\n") == 1
    assert not (tmp_path / "down.plan").exists()
