"""What is written is what is read; damaged files are refused politely."""

from dataclasses import replace

import pytest
from any_missions import (
    SMALL,
    WHOLE,
    altitudes,
    check_damaged,
    check_kept,
    check_truncated,
    latitudes,
    longitudes,
    missions,
    parameters,
    patient,
    refused_or_read,
)
from hypothesis import example, given
from hypothesis import strategies as st

from mission.files import Firmware
from mission.model import Mission, MissionItem
from wbf_mission.addons.formats import geojson, gpx, kml, table

RECORDS = {"kml": kml, "geojson": geojson, "gpx": gpx, "csv": table}
here = st.builds(
    MissionItem, st.just(22), st.sampled_from([0, 3]), x=st.just(0.0), y=st.just(0.0), z=altitudes
)
local = st.builds(MissionItem, st.just(16), st.just(1), x=st.floats(-9e3, 9e3), y=st.floats(-9e3, 9e3))


@pytest.mark.parametrize("name", RECORDS)
@patient(max_examples=50)
@given(missions(), st.lists(here | local, max_size=2))
def test_round_trip_through_records_is_exact(name, mission, odd):
    mission = replace(mission, items=(*mission.items, *odd))
    module = RECORDS[name]
    assert module.loads(module.dumps(mission).encode()) == mission


@patient(max_examples=30)
@given(missions())
def test_kmz_round_trip_is_exact(mission):
    content = kml.kmz_dumps(mission)
    assert kml.kmz_loads(content) == mission
    assert kml.kmz_dumps(mission) == content


odd_fences = st.lists(
    st.builds(
        MissionItem,
        st.sampled_from([5000, 5001, 5002, 5003]),
        st.sampled_from([0, 3]),
        st.sampled_from([3.0, 4.0]),
        parameters,
        x=latitudes,
        y=longitudes,
        z=altitudes,
        autocontinue=st.booleans(),
    ),
    max_size=5,
)


@pytest.mark.parametrize("name", RECORDS)
@patient(max_examples=30)
@given(odd_fences)
def test_a_fence_that_is_no_polygon_goes_through_records(name, fence):
    mission, module = Mission((), fence=fence, rally=fence), RECORDS[name]
    assert module.loads(module.dumps(mission).encode()) == mission


@pytest.mark.parametrize("suffix", [".kml", ".gpx"])
@patient(max_examples=20)
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
@patient(max_examples=300)
@given(data=st.data())
def test_damaged_files_are_refused_politely(name, data):
    check_damaged(data, READERS[name], written(name, WHOLE))


@pytest.mark.parametrize("name", READERS)
def test_truncated_files_are_refused_politely(name):
    check_truncated(READERS[name], written(name, SMALL))
