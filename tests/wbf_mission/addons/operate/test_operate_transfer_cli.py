"""``wbf-mission upload`` and ``download``, against our simulator over real sockets."""

import json

import pytest
from command_line import ran
from preflight_plans import box, farm_with_obstacle, fenced, good

from geo import save_farm
from mission.files import read_mission, write_mission
from mission.ground.link import upload
from wbf_mission.addons.base import links


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "good.plan"
    write_mission(good(), path)
    return path


def test_an_interrupted_upload_says_what_the_vehicle_may_hold(quick_stand_in, file, monkeypatch, capsys):
    def interrupted(*_given, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr(links, "upload", interrupted)
    with quick_stand_in("ardupilot", speed=6.0) as (url, _):
        err = ran(capsys, "upload", str(file), "--connect", url, "--force", code=130).err
    assert "warning: system 1: the upload is incomplete: it may hold a mixture of the old mission and" in err


def test_what_is_stored_and_then_rejected_is_not_verified(quick_stand_in, tmp_path, capsys):
    path = tmp_path / "broken.plan"
    write_mission(fenced(good(), box(-20, -20, 20, 20)), path)
    with quick_stand_in("px4", speed=6.0) as (url, made):
        out, err = ran(capsys, "upload", str(path), "--connect", url, "--force", code=5)
        assert "verified" not in next(line for line in out.splitlines() if "mission" in line)
        assert "stored, but rejected by the vehicle" in out
        assert "system 1 stored the mission, but would not fly it: Mission rejected: item " in err
        assert "waiting for a vehicle" not in err, "it was heard already"
        assert "uploading to system 1 (PX4)" in err
        document = json.loads(
            ran(capsys, "upload", str(path), "--connect", url, "--force", "--json", "-q", code=5).out
        )
        assert (document["verified"], document["accepted"]) == (False, False)
        assert len(made.vehicle.pilot.mission.items) == document["items"]["mission"]
        report = upload(read_mission(path), url, force=True)
        assert (report.verified, report.accepted) == (False, False)


@pytest.mark.parametrize(("autopilot", "name"), [("px4", "PX4"), ("ardupilot", "ArduPilot")])
def test_what_is_accepted_is_verified_and_the_autopilot_has_its_name(
    quick_stand_in, autopilot, name, file, tmp_path, capsys
):
    held = tmp_path / "held.plan"
    with quick_stand_in(autopilot, speed=6.0) as (url, _):
        document = json.loads(ran(capsys, "upload", str(file), "--connect", url, "--json", "-q").out)
        assert (document["verified"], document["accepted"], document["autopilot"]) == (True, True, name)
        words = ("download", "--connect", url, "--out", str(held))
        document = json.loads(ran(capsys, *words, "--json", "-q").out)
        assert document["autopilot"] == name
        assert "verified" not in document
        assert f"system 1, component 1 ({name})" in ran(capsys, *words).out
    assert len(read_mission(held).items) == len(good().items)


def test_one_of_several_vehicles_is_chosen(quick_stand_in, file, tmp_path, capsys):
    with quick_stand_in("px4", count=2) as (url, _):
        link = ("--connect", url, "--system-id")
        document = json.loads(ran(capsys, "upload", str(file), *link, "2", "--json", "-q").out)
        assert document["system_id"] == 2
        held = [tmp_path / f"{number}.plan" for number in (1, 2)]
        for number, path in enumerate(held, start=1):
            ran(capsys, "download", *link, str(number), "--out", str(path), "-q")
        assert [len(read_mission(path).items) for path in held] == [0, len(good().items)]
        for words in (("upload", str(file)), ("download", "--out", str(tmp_path / "x.plan"))):
            err = ran(capsys, *words, *link, "9", "--wait", "3", "-q", code=3).err
            assert "no vehicle with system id 9 was heard in 3 s, only system 1 (PX4), system 2 (PX4)" in err


def test_farm_and_wind_are_checked_before_an_upload(quick_stand_in, file, tmp_path, capsys):
    barn = tmp_path / "barn.geojson"
    save_farm(farm_with_obstacle(10, -10, 30, 10), barn)
    with quick_stand_in("px4", speed=6.0) as (url, made):
        words = ("upload", str(file), "--connect", url, "--vehicle", "quad", "-q")
        err = ran(capsys, *words, "--wind", "30,270", code=2).err
        assert "quad would be blown away" in err
        assert "nothing was sent" in err
        assert "obstacle" in ran(capsys, *words, "--farm", str(barn), code=2).err
        assert made.vehicle.pilot.mission.size == 0
        assert "nowhere" in ran(capsys, *words, "--farm", "nowhere", code=2).err
        assert "margin -1.0 is out of range" in ran(capsys, *words, "--margin", "-1", code=2).err
        assert "but PX4 is heard" in ran(capsys, *words, "--autopilot", "ardupilot", code=2).err
        ran(capsys, *words, "--farm", "miniberry-10")
        assert made.vehicle.pilot.mission.size == len(good().items)
