"""What an upload tells when an autopilot would not take a plan, or does not: over real sockets."""

import json

import pytest

from mission.files import write_mission
from mission.model import Mission, MissionItem
from wbf_mission.cli.app import main
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario

ROWS = Scenario(farm="miniberry-10", planner="lawnmower", budget="60s")


def upload(path, mission, url, *options):
    write_mission(mission, path)
    return main(["upload", str(path), "--connect", url, "--json", "-q", *options])


def with_item(item, number):
    """The planned rows with one more item, which is number `number` as the user counts."""
    made = plan(ROWS).mission
    return Mission((*made.items[: number - 1], item, *made.items[number - 1 :]), made.home)


def turns(mission):
    there = mission.items[2]
    return MissionItem(18, 3, 2.0, x=there.x, y=there.y, z=there.z)


def test_a_flight_is_refused_before_it_begins(tmp_path, capsys):
    mission = with_item(turns(plan(ROWS).mission), 4)
    path = tmp_path / "turns.json"
    write_mission(mission, path)
    given = ["fly", "--farm", "miniberry-10", "--mission", str(path), "--no-files"]
    assert main(given) == 2
    assert "error: mission item 4 (NAV_LOITER_TURNS)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "severity", "says"),
    [
        ((), "note", "(DO_LAND_START): ArduPlane does not arm"),
        (("--param", "RTL_AUTOLAND=0"), "error", "while RTL_AUTOLAND is 0; set RTL_AUTOLAND to 1 or 2"),
    ],
)
def test_plan_tells_what_the_autopilot_would_not_arm(options, severity, says, capsys):
    plan = ["plan", "--farm", "miniberry-100", "--vehicle", "wing", "--autopilot", "ardupilot"]
    assert main([*plan, "--budget", "2km", "--json", *options]) == 0
    out, err = capsys.readouterr()
    made = json.loads(out)
    assert [one["severity"] for one in made["remarks"]] == [severity]
    assert says in err
    assert bool(made["warnings"]) is (severity == "error")
