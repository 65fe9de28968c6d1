"""What an upload tells when an autopilot would not take a plan, or does not: over real sockets."""

import json
from dataclasses import replace

import pytest
from stand_in import stand_in

from mission.files import write_mission
from mission.model import Mission, MissionItem, MissionType
from wbf_mission.cli.app import main
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario

UNKNOWN = (
    "mission item 4 (NAV_LOITER_TURNS): PX4 does not know this command; use NAV_LOITER_TIME, or waypoints"
)
ROWS = Scenario(farm="miniberry-10", planner="lawnmower", budget="60s")


def upload(path, mission, url, *options):
    write_mission(mission, path)
    return main(["upload", str(path), "--connect", url, "--json", "-q", *options])


def with_item(item, number):
    """The planned rows with one more item, which is number `number` as the user counts."""
    made = plan(ROWS).mission
    return Mission((*made.items[: number - 1], item, *made.items[number - 1 :]), made.home)


def held(made):
    return len(made.vehicle.pilot.mission.items)


def turns(mission):
    there = mission.items[2]
    return MissionItem(18, 3, 2.0, x=there.x, y=there.y, z=there.z)


def test_what_px4_would_refuse_is_not_sent(tmp_path, capsys):
    mission = with_item(turns(plan(ROWS).mission), 4)
    with stand_in("px4") as (url, made):
        assert upload(tmp_path / "turns.json", mission, url) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert UNKNOWN in err
        assert err.splitlines()[-1].startswith(f"error: {UNKNOWN}")
        assert "nothing was sent" in err.splitlines()[-1]
        assert held(made) == 0
        # Who wants it all the same hears of the vehicle's refusal, with the item.
        assert upload(tmp_path / "turns.json", mission, url, "--force") == 5
        err = capsys.readouterr().err
        assert "refused at item 4 (NAV_LOITER_TURNS)" in err
        assert "MAV_MISSION_UNSUPPORTED" in err
        assert held(made) == 0


def test_ardupilot_takes_it_and_the_report_has_the_remarks(tmp_path, capsys):
    mission = with_item(turns(plan(ROWS).mission), 4)
    with stand_in("ardupilot") as (url, made):
        assert upload(tmp_path / "turns.json", mission, url) == 0
        report = json.loads(capsys.readouterr().out)
        assert report["verified"]
        assert [one["severity"] for one in report["remarks"]] == ["note"]
        assert report["remarks"][0]["command"] == "NAV_WAYPOINT"
        assert held(made) == len(mission.items)


def test_a_vehicle_that_is_full_is_heard(tmp_path, capsys):
    mission = plan(ROWS).mission
    with stand_in("ardupilot") as (url, made):
        made.vehicle._plans.server._store.capacity[MissionType.MISSION] = 5
        assert upload(tmp_path / "rows.json", mission, url) == 5
        err = capsys.readouterr().err.splitlines()[-1]
        assert "MAV_MISSION_NO_SPACE" in err
        assert err.endswith("the vehicle says: Only 6 items are supported")


def long_mission(number):
    """The planned rows with waypoints in between, so many items in all."""
    made = plan(ROWS).mission
    first = made.items[2]
    latitudes = (first.x + 2e-6 * (k % 2) for k in range(number - len(made.items)))
    between = [replace(first, x=latitude) for latitude in latitudes]
    return Mission((*made.items[:3], *between, *made.items[3:]), made.home)


def set_card(made, kib):
    """Set BRD_SD_MISSION and start the vehicle again, as its operator would."""
    made.vehicle._parameters.change("BRD_SD_MISSION", kib)
    made.vehicle.reboot()


def test_a_mission_for_which_there_is_no_room_is_refused_before_it_is_sent(tmp_path, capsys):
    path, mission = tmp_path / "long.json", long_mission(700)
    with stand_in("ardupilot") as (url, made):
        # Some boards have room without a card, so that it is asked: by the number of items alone.
        assert upload(path, mission, url) == 5
        err = capsys.readouterr().err.splitlines()[-1]
        assert "no space for 701 items (MAV_MISSION_NO_SPACE): set BRD_SD_MISSION to 11 and restart" in err
        assert err.endswith("the vehicle says: Only 650 items are supported")
        set_card(made, 10.0)
        assert upload(path, mission, url) == 2
        err = capsys.readouterr().err.splitlines()[-1]
        assert (
            "700 items: this ArduPilot holds at most 681 (BRD_SD_MISSION 10); set BRD_SD_MISSION to 11" in err
        )
        assert "nothing was sent" in err
        assert held(made) == 0
        set_card(made, 11.0)
        assert upload(path, mission, url) == 0
        assert held(made) == 700


def test_an_own_flight_has_the_card_that_its_mission_needs(tmp_path, capsys):
    path = tmp_path / "long.json"
    write_mission(long_mission(700), path)
    words = "--farm miniberry-10 --autopilot ardupilot --estimator point --no-files --json"
    assert main(["fly", "--mission", str(path), *words.split()]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["outcome"] == "completed"
    assert "many ArduPilot boards hold only 649 without an SD card; set BRD_SD_MISSION to 11" in err


def test_what_the_vehicle_says_of_a_plan_that_it_stores_and_rejects_is_shown(tmp_path, capsys):
    """PX4 takes a position that it cannot reach, and says so in words only."""
    mission = with_item(MissionItem.waypoint(29.0, -82.15, 10.0), 4)
    path = tmp_path / "far.json"
    write_mission(mission, path)
    with stand_in("px4") as (url, made):
        assert main(["upload", str(path), "--connect", url, "--json", "--force"]) == 5
        out, err = capsys.readouterr()
        report = json.loads(out)
        assert held(made) == len(mission.items)
        assert not report["verified"]
        assert report["accepted"] is False
        (said,) = report["texts"]
        assert said.startswith("Mission rejected: item 4")
        assert f"the vehicle says: {said}" in err


def test_ardupilot_that_refuses_an_item_tells_what_it_holds_now(tmp_path, capsys):
    """It knows the take-off of a VTOL; this vehicle is none."""
    there = plan(ROWS).mission.items[2]
    mission = with_item(MissionItem(84, 3, x=there.x, y=there.y, z=there.z), 6)
    with stand_in("ardupilot") as (url, _):
        assert upload(tmp_path / "vtol.json", mission, url, "--force") == 5
        err = capsys.readouterr().err.splitlines()[-1]
        assert "refused at item 6 (NAV_VTOL_TAKEOFF)" in err
        assert "the vehicle now holds 5 items, all as sent" in err


def test_a_flight_is_refused_before_it_begins(tmp_path, capsys):
    mission = with_item(turns(plan(ROWS).mission), 4)
    path = tmp_path / "turns.json"
    write_mission(mission, path)
    given = ["fly", "--farm", "miniberry-10", "--mission", str(path), "--no-files"]
    assert main(given) == 2
    assert "error: mission item 4 (NAV_LOITER_TURNS)" in capsys.readouterr().err
    with stand_in("px4") as (url, made):
        assert main([*given, "--connect", url, "--yes"]) == 2
        assert UNKNOWN in capsys.readouterr().err
        assert held(made) == 0


@pytest.mark.parametrize(
    ("options", "severity", "says"),
    [
        (
            ("--vehicle", "wing", "--autopilot", "ardupilot"),
            "note",
            "(DO_LAND_START): ArduPlane does not arm",
        ),
        (
            ("--vehicle", "wing", "--autopilot", "ardupilot", "--param", "RTL_AUTOLAND=0"),
            "error",
            "does not arm with this item while RTL_AUTOLAND is 0; set RTL_AUTOLAND to 1 or 2",
        ),
        (("--vehicle", "wing", "--autopilot", "px4"), None, ""),
        (("--autopilot", "ardupilot"), None, ""),
        ((), None, ""),
    ],
)
def test_plan_tells_what_the_autopilot_would_not_arm(options, severity, says, capsys):
    assert main(["plan", "--farm", "miniberry-100", "--budget", "2km", "--json", *options]) == 0
    out, err = capsys.readouterr()
    made = json.loads(out)
    assert [one["severity"] for one in made["remarks"]] == ([] if severity is None else [severity])
    assert says in err
    assert bool(made["warnings"]) is (severity == "error")
