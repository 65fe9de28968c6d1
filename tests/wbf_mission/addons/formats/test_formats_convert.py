"""``wbf-mission convert``: any mission file to any other, and what is said of it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from mission.files import read_mission, write_mission
from mission.model import GeoPoint, Mission, MissionItem
from wbf_mission.cli.app import main

MISSION = Mission(
    (
        MissionItem(22, 3, param4=None, x=28.05, y=-82.15, z=10.0),
        MissionItem.waypoint(28.051, -82.151, 10.0),
        MissionItem(177, 2, 1.0, 2.0),
        MissionItem(20),
    ),
    home=GeoPoint(28.05, -82.15, 30.0),
    fence=(MissionItem(5003, 0, 50.0, x=28.05, y=-82.15, autocontinue=False),),
    rally=(MissionItem(5100, 3, x=28.05, y=-82.15, z=10.0, autocontinue=False),),
)
LINE = "<LineString><coordinates>-82.15,28.05 -82.151,28.051</coordinates></LineString>"
DRAWN = f"""<kml><Document>
<Placemark><name>north</name>{LINE}</Placemark>
<Placemark><name>south</name>{LINE}</Placemark>
</Document></kml>"""
EXACT = (".plan", ".json", ".kml", ".kmz", ".geojson", ".gpx", ".csv")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_mission(MISSION, "field.plan")
    Path("earth.kml").write_text(DRAWN)


def convert(capsys, *arguments, code=0):
    assert main(["convert", *arguments]) == code
    return capsys.readouterr()


def test_a_mission_goes_through_every_format_and_comes_back(capsys):
    name = "field.plan"
    for suffix in (*EXACT[1:], ".plan"):
        out = json.loads(convert(capsys, name, f"again{suffix}", "--json", "--overwrite").out)
        assert out["losses"] == []
        assert (out["items"], out["waypoints"], out["fence"], out["rally"]) == (4, 1, 1, 1)
        assert out["home"] == [28.05, -82.15, 30.0]
        name = out["file"]
        assert read_mission(name) == MISSION
    assert Path("again.plan").read_bytes() == Path("field.plan").read_bytes()


def test_what_is_lost_is_said_and_what_the_vehicle_would_miss_is_a_warning(capsys):
    told = convert(capsys, "field.plan", "field.waypoints")
    assert told.err.splitlines() == [
        "warning: field.waypoints: fence items are not kept (1 of 1)",
        "warning: field.waypoints: rally points are not kept (1 of 1)",
    ]
    assert "2, listed on stderr" in told.out
    assert read_mission("field.waypoints") == replace(MISSION, fence=(), rally=())
    told = convert(capsys, "field.plan", "field.wpml.kmz", "--quiet")
    assert told.err.splitlines() == [
        "warning: field.wpml.kmz: DO_JUMP is not kept (mission item 3)",
        "warning: field.wpml.kmz: fence items are not kept (1 of 1)",
        "warning: field.wpml.kmz: rally points are not kept (1 of 1)",
    ]
    assert "none" in convert(capsys, "field.plan", "field.json").out


def test_a_drawn_path_is_chosen_and_lifted(capsys):
    assert "2 paths: 'north', 'south'" in convert(capsys, "earth.kml", "new.plan", code=2).err
    assert "--altitude METRES" in convert(capsys, "earth.kml", "new.plan", "--path", "south", code=2).err
    assert not Path("new.plan").exists()
    told = convert(capsys, "earth.kml", "new.plan", "--path", "south", "--altitude", "25")
    assert "the 2 points of south are waypoints, altitudes above home; no take-off, landing" in told.err
    assert "home, which is unknown, is written as 28.0500000, -82.1500000, 0 m" in told.err
    assert [item.z for item in read_mission("new.plan").items] == [25.0, 25.0]
    assert (
        "leave --altitude and --path out"
        in convert(capsys, "field.plan", "b.plan", "--altitude", "2", code=2).err
    )


def test_nothing_of_others_is_written_over(capsys):
    mine = Path("earth.kml").read_bytes()
    assert "this is an input file" in convert(capsys, "earth.kml", "earth.kml", code=2).err
    for out in ("earth.kml", "notes.gpx"):
        Path(out).write_bytes(mine)
        assert "--overwrite" in convert(capsys, "field.plan", out, code=2).err
        assert Path(out).read_bytes() == mine
        convert(capsys, "field.plan", out, "--overwrite")
        assert read_mission(out) == MISSION
    for arguments, part in (
        (("field.plan", "new.doc"), "unknown suffix '.doc'; missions are written to"),
        (("gone.plan", "new.plan"), "no such file"),
        (("field.plan", "gone/new.plan"), "there is no folder"),
        (("field.plan", "new.plan", "--altitude", "1_0"), "is not a number"),
    ):
        error = convert(capsys, *arguments, code=2).err
        assert part in error
        assert error.count("\n") == 1
    assert sorted(path.name for path in Path().iterdir()) == ["earth.kml", "field.plan", "notes.gpx"]
