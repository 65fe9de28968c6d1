"""What is written is what is read; damaged files are refused politely."""

from dataclasses import replace

import pytest
from any_missions import WHOLE, altitudes, check_damaged, check_kept, missions, patient, refused_or_read
from hypothesis import example, given
from hypothesis import strategies as st
from sweeps import sweep

from mission.files import Firmware
from mission.model import Mission, MissionItem
from wbf_mission.addons.formats import geojson, gpx, kml, table

RECORDS = {"kml": kml, "geojson": geojson, "gpx": gpx, "csv": table}
here = st.builds(
    MissionItem, st.just(22), st.sampled_from([0, 3]), x=st.just(0.0), y=st.just(0.0), z=altitudes
)
local = st.builds(MissionItem, st.just(16), st.just(1), x=st.floats(-9e3, 9e3), y=st.floats(-9e3, 9e3))


@pytest.mark.parametrize("name", RECORDS)
@sweep(few=25, many=100)
@given(missions(), st.lists(here | local, max_size=2))
def test_round_trip_through_records_is_exact(name, mission, odd):
    mission = replace(mission, items=(*mission.items, *odd))
    module = RECORDS[name]
    assert module.loads(module.dumps(mission).encode()) == mission


@pytest.mark.parametrize("name", RECORDS)
def test_a_mission_across_180_degrees_is_exact_and_its_shapes_are_cut(name):
    west, east = MissionItem.waypoint(-17.0, 179.999, 9.0), MissionItem.waypoint(-17.0, -179.999, 9.0)
    places = ((-17.1, 179.9), (-17.1, -179.9), (-16.9, 180.0))
    fence = tuple(MissionItem(5001, 3, param1=3.0, x=x, y=y) for x, y in places)
    mission = Mission((west, east, west), fence=fence)
    text = RECORDS[name].dumps(mission)
    assert RECORDS[name].loads(text.encode()) == mission
    assert "Polygon" not in text and ("MultiLineString" in text) == (name == "geojson")


@pytest.mark.parametrize("suffix", [".kml", ".gpx"])
@sweep(few=10, many=40)
@given(missions(), st.sampled_from([Firmware.PX4, Firmware.ARDUPILOT]))
def test_what_a_format_does_not_keep_is_said(tmp_path_factory, suffix, mission, firmware):
    check_kept(mission, tmp_path_factory.getbasetemp() / f"lossy{suffix}", firmware)


READERS = {name: module.loads for name, module in RECORDS.items()} | {"kmz": kml.kmz_loads}
STARTS = {
    "kml": b"<kml><Document><Placemark><Point><coordinates>",
    "kmz": b"PK\x03\x04",
    "geojson": b'{"type":"Feature","geometry":',
    "gpx": b"<gpx><rte><rtept ",
    "csv": b"lat,lon,alt\n",
}


def written(name, mission):
    return kml.kmz_dumps(mission) if name == "kmz" else RECORDS[name].dumps(mission).encode()


@pytest.mark.parametrize("name", READERS)
@patient()
@given(st.binary(max_size=200), st.booleans())
@example(data=b"\x1c", started=False)  # white space that ends no line
def test_random_bytes_are_refused_politely(name, data, started):
    refused_or_read(READERS[name], STARTS[name] + data if started else data)


@pytest.mark.parametrize("name", READERS)
@sweep(few=60, many=300)
@given(data=st.data())
def test_damaged_files_are_refused_politely(name, data):
    check_damaged(data, READERS[name], written(name, WHOLE))
