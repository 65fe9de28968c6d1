"""The choice of the format by suffix, errors that name the file, and the formats for viewing."""

import json
from itertools import pairwise
from xml.etree import ElementTree

import pytest

from mission.errors import MissionFileError
from mission.files import (
    Firmware,
    MissionFormat,
    mission_formats,
    read_mission,
    reader_for,
    register_format,
    write_mission,
    writer_for,
)
from mission.model import GeoPoint, Mission, MissionItem

MISSION = Mission(
    (
        MissionItem(22, 3, param4=None, x=28.05, y=-82.15, z=10.0),
        MissionItem.waypoint(28.051, -82.151, 10.0),
        MissionItem(20),
    ),
    home=GeoPoint(28.05, -82.15, 30.0),
)
SQUARE = [(28.0, -82.0), (28.001, -82.0), (28.001, -81.999), (28.0, -81.999)]
GUARDED = Mission(
    MISSION.items,
    home=MISSION.home,
    fence=tuple(MissionItem(5001, 0, 4.0, x=x, y=y) for x, y in SQUARE),
    rally=(MissionItem(5100, 3, x=28.0, y=-82.0, z=20.0),),
)


def names(folder):
    return [entry.name for entry in folder.iterdir()]


@pytest.mark.parametrize("suffix", [".plan", ".waypoints", ".wpl", ".txt", ".json", ".PLAN", ".Json"])
def test_suffix_chooses_the_format(tmp_path, suffix):
    path = tmp_path / f"mission{suffix}"
    write_mission(MISSION, path)
    assert read_mission(path) == MISSION
    assert read_mission(str(path)) == MISSION
    assert names(tmp_path) == [path.name]


def test_the_formats_differ(tmp_path):
    starts = {
        ".plan": '{\n    "fileType"',
        ".waypoints": "QGC WPL 110\n",
        ".json": '{\n  "format": "wbf-mission"',
    }
    for suffix, start in starts.items():
        write_mission(MISSION, tmp_path / f"mission{suffix}")
        assert (tmp_path / f"mission{suffix}").read_text().startswith(start)


def test_firmware(tmp_path):
    path = tmp_path / "mission.plan"
    write_mission(MISSION, path, firmware=Firmware.ARDUPILOT)
    assert json.loads(path.read_text())["mission"]["firmwareType"] == 3
    assert read_mission(path).items[0].param4 == 0.0


def test_unknown_suffixes_list_the_known_ones(tmp_path):
    for name in ("mission.xyz", "mission", "plan"):
        with pytest.raises(
            MissionFileError, match=r"unknown suffix .*\.plan, \.waypoints, .*\.gpx or \.csv$"
        ):
            read_mission(tmp_path / name)
        with pytest.raises(MissionFileError, match=r"written to \.plan.* or \.wpml\.kmz$"):
            write_mission(MISSION, tmp_path / name)
    with pytest.raises(MissionFileError, match="no reader for DJI WPML files"):
        reader_for("field.wpml.kmz")
    assert names(tmp_path) == []


def test_formats_can_be_added():
    before = mission_formats()
    mine = MissionFormat("mine", (".mine",), lambda _: MISSION)
    register_format(mine)
    try:
        assert mission_formats() == (*before, mine)
        assert reader_for("a.mine")(b"") is MISSION
        with pytest.raises(MissionFileError, match="no writer for mine files"):
            writer_for("a.mine")
    finally:
        from mission.files import formats

        del formats._FORMATS[".mine"]


KML = b'<?xml version="1.0"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"></kml>'


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"", "an empty file"),
        (b"  \n\t", "an empty file"),
        (KML, "a KML file"),
        (b"<gpx></gpx>", "a GPX file"),
        (b"<!DOCTYPE html><html>", "an HTML page"),
        (b"<svg/>", "an XML file"),
        (b"PK\x03\x04rest", "a ZIP archive"),
        (b"\x89PNG\r\n\x1a\n\0\0\0", "a binary file"),
        ("QGC WPL 110".encode("utf-16"), "UTF-16"),
        (b"hello\nworld", "a text file of another kind"),
        (b'{"type": "FeatureCollection", "features": []}', "a GeoJSON file"),
        (b'{"a": 1}', "a JSON file of another kind"),
        (b"[1]", "a JSON file of another kind"),
        (b'{"fileType": "Parameters\\u0007"}', "fileType"),
    ],
)
@pytest.mark.parametrize("suffix", [".plan", ".waypoints", ".json"])
def test_foreign_files_are_recognised(tmp_path, content, found, suffix):
    path = tmp_path / f"mission{suffix}"
    path.write_bytes(content)
    with pytest.raises(MissionFileError) as caught:
        read_mission(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: this is ")
    assert found in text
    assert "give a mission" in text or "rename it to end in" in text
    assert text.isprintable()


TWO_WAY = [".plan", ".waypoints", ".json", ".kml", ".kmz", ".geojson", ".gpx"]


@pytest.mark.parametrize("written", TWO_WAY)
@pytest.mark.parametrize("named", [*TWO_WAY, ".csv"])
def test_wrong_suffix_says_the_right_one(tmp_path, written, named):
    write_mission(MISSION, tmp_path / f"a{written}")
    (tmp_path / f"a{written}").rename(tmp_path / f"b{named}")
    if written == named:
        assert read_mission(tmp_path / f"b{named}") == MISSION
        return
    with pytest.raises(MissionFileError, match=rf"rename it to end in \{written}$"):
        read_mission(tmp_path / f"b{named}")


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "folder.plan").mkdir()
    for name, part in (("missing.plan", "no such file"), ("folder.plan", "a folder"), ("n\0l.plan", "NUL")):
        with pytest.raises(MissionFileError, match="cannot be read") as caught:
            read_mission(tmp_path / name)
        assert part in str(caught.value)


def test_files_that_cannot_be_written(tmp_path):
    (tmp_path / "folder.plan").mkdir()
    for name in ("folder.plan", "missing/mission.plan", "n\0l.plan", "x" * 300 + ".plan"):
        with pytest.raises(MissionFileError, match="cannot be written"):
            write_mission(MISSION, tmp_path / name)
    assert names(tmp_path) == ["folder.plan"]


def test_failed_writing_keeps_the_older_file(tmp_path):
    path = tmp_path / "mission.waypoints"
    write_mission(MISSION, path)
    with pytest.raises(MissionFileError, match=r"mission\.waypoints: cannot be written: .*holds one plan"):
        write_mission(GUARDED, path)
    assert read_mission(path) == MISSION
    assert names(tmp_path) == [path.name]


def test_too_large_a_file(tmp_path):
    path = tmp_path / "huge.plan"
    with path.open("wb") as file:
        file.truncate(64 * 2**20 + 1)
    with pytest.raises(MissionFileError, match="larger than 64 MiB"):
        read_mission(path)


def test_error_of_a_strange_name_is_one_line(tmp_path):
    with pytest.raises(MissionFileError) as caught:
        read_mission(tmp_path / "a\nb\x1b[31m.plan")
    assert str(caught.value).isprintable()
    with pytest.raises(
        MissionFileError, match=r"^a\\x00b\.plan: cannot be read as a mission: there is a NUL"
    ):
        read_mission("a\0b.plan")


def test_geojson(tmp_path):
    path = tmp_path / "mission.geojson"
    write_mission(GUARDED, path)
    made = json.loads(path.read_text())
    assert made["type"] == "FeatureCollection"
    of_role = {feature["properties"]["role"]: feature for feature in made["features"]}
    assert of_role["mission"]["properties"]["hover_speed_m_s"] == 5.0
    assert of_role["path"]["geometry"]["coordinates"] == [[-82.15, 28.05], [-82.151, 28.051]]
    assert of_role["home"]["geometry"]["coordinates"] == [-82.15, 28.05]
    assert of_role["item"]["properties"]["command"] == 20
    assert of_role["item"]["geometry"] is None
    ring = of_role["fence"]["geometry"]["coordinates"][0]
    assert ring[0] == ring[-1]
    area = sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in pairwise(ring))
    assert area > 0.0  # counterclockwise
    assert of_role["rally"]["properties"]["altitude_m"] == 20.0


ORDER_OF_GPX = {
    "gpx": ("metadata", "wpt", "rte"),
    "metadata": ("extensions",),
    "wpt": ("ele", "name", "extensions"),
    "rte": ("name", "extensions", "rtept"),
    "rtept": ("ele", "name", "extensions"),
    "extensions": ("record",),
    "ele": (),
    "name": (),
    "record": (),
}


def test_gpx_elements_stand_in_the_order_of_the_schema(tmp_path):
    path = tmp_path / "mission.gpx"
    write_mission(GUARDED, path)
    root = ElementTree.fromstring(path.read_text())
    spaces = {"record": "urn:wbf-mission:gpx:1"}
    for node in root.iter():
        space, _, tag = node.tag[1:].partition("}")
        assert space == spaces.get(tag, "http://www.topografix.com/GPX/1/1")
        ranks = [ORDER_OF_GPX[tag].index(child.tag.partition("}")[2]) for child in node]
        assert ranks == sorted(ranks)
    assert (root.get("version"), root.get("creator")) == ("1.1", "wbf-mission")


def test_kml(tmp_path):
    path = tmp_path / "mission.kml"
    write_mission(GUARDED, path)
    root = ElementTree.fromstring(path.read_text())
    space = "{http://www.opengis.net/kml/2.2}"
    assert root.tag == f"{space}kml"
    places = {
        mark.findtext(f"{space}name"): "".join(e.text for e in mark.iter(f"{space}coordinates"))
        for mark in root.iter(f"{space}Placemark")
    }
    assert places["Path"] == "-82.15,28.05,10.0 -82.151,28.051,10.0"
    assert places["Home"] == "-82.15,28.05,30.0"
    assert places["2 NAV_RETURN_TO_LAUNCH"] == ""
    assert len(places["Fence 0 NAV_FENCE_POLYGON_VERTEX_INCLUSION"].split()) == 5
    modes = {e.text for e in root.iter(f"{space}altitudeMode")}
    assert modes == {"relativeToGround", "clampToGround", "absolute"}
