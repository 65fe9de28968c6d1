"""``wbf-mission preflight``, and what goes up only with ``--force``; with our simulator over a socket."""

import json
from dataclasses import replace

import pytest
from command_line import ran
from preflight_plans import at, box, fenced, good

from mission.files import write_mission
from mission.model import Command, MissionItem
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario

ROWS = {"farm": "miniberry-10", "planner": "lawnmower", "budget": "60s"}


@pytest.fixture
def file(tmp_path):
    """A plan where our simulator stands."""
    path = tmp_path / "rows.plan"
    write_mission(plan(Scenario(**ROWS)).mission, path)
    return str(path)


@pytest.fixture
def broken(tmp_path):
    """A plan that leaves its fence."""
    mission = plan(Scenario(**ROWS)).mission
    home = mission.home
    circle = Command.NAV_FENCE_CIRCLE_INCLUSION
    fence = (MissionItem(circle, 0, 2.0, x=home.latitude_deg, y=home.longitude_deg),)
    path = tmp_path / "broken.plan"
    write_mission(replace(mission, fence=fence), path)
    return str(path)


def codes(document):
    return {one["code"] for one in document["findings"]}


def test_the_table_has_what_json_has_at_any_width(tmp_path, capsys, monkeypatch):
    path = tmp_path / "far.plan"
    write_mission(fenced(good(at(60, 0), at(60, 40), at(0, 40)), box(20, -9, 40, 9, inside=False)), path)
    words = ("preflight", str(path), "--camera-interval", "3", "-q")
    (error, warning, note) = json.loads(ran(capsys, *words, "--json", code=1).out)["findings"]
    for columns in (80, 100, 160):
        monkeypatch.setattr("wbf_mission.cli.output.FILE_WIDTH", columns)
        out = ran(capsys, *words, code=1).out
        assert max(map(len, out.splitlines())) <= columns
        cells = [[cell.strip() for cell in line[1:-1].split("│")] for line in out.splitlines() if "│" in line]
        first, item, said = (" ".join(filter(None, column)) for column in zip(*cells, strict=True))
        assert first == "error outside-fence warning camera-too-fast note flight"
        assert item.startswith(f"{error['item']} NAV_WAYPOINT {warning['item']} DO_SET_CAM_TRIGG_DIST")
        for one in (error, warning, note):
            measured = f"{one['measured']} {one['value']:.3g} {one['unit']} ({one['against']}"
            assert f"{one['text']} measured: {measured}" in said
            assert one["fix"] is None or f"to do: {one['fix']}" in said


def test_a_plan_that_cannot_be_flown_is_not_predicted_and_says_so(tmp_path, capsys):
    path = tmp_path / "low.plan"
    write_mission(good(at(60, 0), at(60, 40, -5.0)), path)
    out = ran(capsys, "preflight", str(path), "--json", "-q", code=1).out
    assert "NaN" not in out
    document = json.loads(out)
    assert codes(document) >= {"altitude", "no-prediction"}
    assert document["predicted_time_s"] is document["predicted_energy_wh"] is None
    told = ran(capsys, "preflight", str(path), "-q", code=1).out
    assert "the flight is not predicted" in told


def test_every_error_is_told_once(quick_stand_in, tmp_path, capsys):
    """The last line has the worst; the others stand before it."""
    path = tmp_path / "low.plan"
    circle = at(20, 20, command=Command.NAV_LOITER_TURNS, param1=1.0, param3=10.0)
    write_mission(good(at(60, 0), at(60, 40, -5.0), circle), path)
    with quick_stand_in("px4", speed=6.0) as (url, _):
        err = ran(capsys, "upload", str(path), "--connect", url, "-q", code=2).err
        *others, last = err.splitlines()
        assert last.startswith("error: ") and "(and 1 more error)" in last
        assert [err.count(said) for said in ("altitude -5.0 m", "does not know this command")] == [1, 1]
        assert [line.startswith("warning: preflight error: ") for line in others].count(True) == 1


def test_wind_vehicle_margin_and_camera_are_options(tmp_path, capsys):
    path = tmp_path / "good.plan"
    write_mission(fenced(good(), box(-20, -20, 48, 60)), path)
    words = ("preflight", str(path), "--json", "-q")
    assert codes(json.loads(ran(capsys, *words).out)) == {"flight"}
    assert "near-fence" in codes(json.loads(ran(capsys, *words, "--margin", "12").out))
    assert "camera-too-fast" in codes(json.loads(ran(capsys, *words, "--camera-interval", "1.2").out))
    windy = json.loads(ran(capsys, *words, "--wind", "30,270", code=1).out)
    assert "too-windy" in codes(windy)
    other = json.loads(ran(capsys, *words, "--vehicle", "mini-quad", "--autopilot", "ardupilot", code=0).out)
    assert (other["vehicle"], other["autopilot"]) == ("mini-quad", "ArduPilot")


def test_coverage_is_the_plans_own_with_its_camera(tmp_path, capsys):
    survey = plan(
        Scenario(
            farm="miniberry-100",
            planner="survey",
            camera_model="dji-mavic-3m-rgb",
            altitude_m=8.0,
            budget="unlimited",
        )
    )
    path = tmp_path / "survey.plan"
    write_mission(survey.mission, path)
    words = ("preflight", str(path), "--farm", "miniberry-100", "--json", "-q")
    assert survey.coverage > 0.9
    leaf = json.loads(ran(capsys, *words).out)
    assert leaf["coverage"] < 0.1
    assert "images of the leaf camera show" in leaf["findings"][-1]["text"]
    for more in ((), ("--gsd", str(survey.summary()["camera"]["gsd_cm"]))):
        told = json.loads(ran(capsys, *words, "--camera", "dji-mavic-3m-rgb", *more).out)
        assert told["coverage"] == pytest.approx(survey.coverage, abs=0.002)
        assert "images of dji-mavic-3m-rgb at 8.0 m show" in told["findings"][-1]["text"]
    higher = json.loads(ran(capsys, *words, "--camera", "dji-mavic-3m-rgb", "--gsd", "0.1").out)
    assert higher["coverage"] < survey.coverage


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("absent.plan",), "absent.plan"),
        (("FILE", "--margin", "nan"), "margin"),
        (("FILE", "--camera-interval", "0"), "--camera-interval 0 is out of range"),
        (("FILE", "--vehicle", "quad,quad"), "name only one"),
        (("FILE", "--system-id", "3"), "--system-id needs --connect"),
    ],
)
def test_bad_input_is_one_line(words, text, file, capsys):
    out, err = ran(capsys, "preflight", *(file if one == "FILE" else one for one in words), code=2)
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert text in err


def test_nobody_to_ask(file, capsys):
    err = ran(capsys, "preflight", file, "--connect", "udpin:127.0.0.1:0", "--wait", "0.2", "-q", code=3).err
    assert "no vehicle was heard" in err


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_vehicle_is_asked(quick_stand_in, autopilot, file, capsys):
    with quick_stand_in(autopilot, speed=6.0) as (url, made):
        words = ("preflight", file, "--vehicle", "quad", "--connect", url, "--json", "-q")
        document = json.loads(ran(capsys, *words).out)
        assert document["system_id"] == 1
        assert "firmware" in codes(document)
        made.vehicle.pilot.arming.block = "the propellers are off"
        ill = json.loads(ran(capsys, *words, code=1).out)
        (found,) = [one for one in ill["findings"] if one["severity"] == "error"]
        assert found["code"] == "not-ready"
        assert "the propellers are off" in found["text"]


def test_an_autopilot_that_is_not_heard(quick_stand_in, file, capsys):
    with quick_stand_in("px4", speed=6.0) as (url, _):
        words = ("preflight", file, "--connect", url, "-q")
        assert "but PX4 is heard" in ran(capsys, *words, "--autopilot", "ardupilot", code=2).err
        assert "a multirotor is heard" in ran(capsys, *words, "--vehicle", "rover", code=2).err


def test_an_upload_with_an_error_is_refused_and_forced(quick_stand_in, broken, capsys):
    with quick_stand_in("px4", speed=6.0) as (url, made):
        out, err = ran(capsys, "upload", broken, "--connect", url, "-q", code=2)
        assert out == ""
        assert err.splitlines()[-1].startswith("error: mission item ")
        assert "leaves the fence" in err
        assert "nothing was sent, --force does it nevertheless" in err
        assert made.vehicle.pilot.mission.items == ()
        words = ("upload", broken, "--connect", url, "--json", "-q", "--force")
        document = json.loads(ran(capsys, *words, code=5).out)
        assert not document["accepted"], "the vehicle finds the same"
        assert "outside-fence" in codes(document)
        assert len(made.vehicle.pilot.mission.items) > 0


def test_what_only_matters_for_a_start_does_not_hinder_an_upload(quick_stand_in, file, capsys):
    with quick_stand_in("ardupilot", speed=6.0) as (url, made):
        made.vehicle.pilot.arming.block = "the propellers are off"
        document = json.loads(ran(capsys, "upload", file, "--connect", url, "--json", "-q").out)
        assert document["verified"]
        assert not [one for one in document["findings"] if one["severity"] == "error"]


def test_a_live_flight_with_an_error_does_not_begin(quick_stand_in, broken, capsys, tmp_path):
    with quick_stand_in("px4", speed=6.0) as (url, made):
        words = ("fly", "--farm", "miniberry-10", "--mission", broken, "--connect", url, "--yes")
        err = ran(capsys, *words, "--no-files", "-q", code=2).err
        assert "nothing was sent" in err
        assert made.vehicle.pilot.mission.items == ()
        assert not made.vehicle.pilot.armed


def test_a_policy_is_checked_too(quick_stand_in, capsys):
    with quick_stand_in("px4", speed=6.0, policy="greedy") as (url, made):
        words = ("fly", "--farm", "miniberry-10", "--policy", "greedy", "--budget", "60s", "--wind", "30,270")
        err = ran(capsys, *words, "--connect", url, "--yes", "--no-files", "-q", code=2).err
        assert "would be blown away" in err
        assert made.vehicle.pilot.mission.items == ()


def test_the_table_is_plain_text_for_hostile_names(tmp_path, capsys):
    path = tmp_path / "[red]x\x1b.plan"
    write_mission(good(), path)
    out = ran(capsys, "preflight", str(path)).out
    assert "[red]x" in out
    assert "\x1b" not in out
