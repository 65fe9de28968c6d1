"""KML, GeoJSON and GPX as other programs look at them, and the suffixes that choose them."""

from xml.etree import ElementTree

import pytest
from any_missions import GUARDED, MISSION

from mission.errors import MissionFileError
from mission.files import read_mission, write_mission

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
