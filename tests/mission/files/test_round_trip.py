"""What is written is what is read, by ourselves, MAVSDK and pymavlink; damaged files are refused politely."""

import math
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mission.errors import MissionFileError
from mission.files import (
    Firmware,
    fitted,
    geojson,
    gpx,
    kml,
    losses,
    native,
    plan,
    read_mission,
    table,
    waypoints,
    write_mission,
)
from mission.files.comparison import differences
from mission.files.drawn import Drawing
from mission.link.codec.dialect import mavlink
from mission.model import Command, Frame, GeoPoint, Mission, MissionItem, has_position

PLANS = Path(__file__).parents[2] / "data" / "plans"
patient = partial(settings, deadline=None)
FLYING = [16, 17, 18, 19, 21, 22, 31, 82, 189, 195, 4501]
DOING = [20, 93, 112, 115, 177, 178, 197, 206, 214, 2000, 2001, 12345]
parameters = st.none() | st.floats(width=32, allow_nan=False, allow_infinity=False)
latitudes = st.integers(-900_000_000, 900_000_000).map(lambda n: n / 1e7)
longitudes = st.integers(-1_800_000_000, 1_800_000_000).map(lambda n: n / 1e7)
altitudes = st.floats(-1000, 10_000, width=32)
flying_items = st.builds(
    MissionItem,
    st.sampled_from(FLYING),
    st.sampled_from([0, 3, 5, 6, 10]),
    parameters,
    parameters,
    parameters,
    parameters,
    latitudes,
    longitudes,
    altitudes,
    st.booleans(),
)
doing_items = st.builds(
    MissionItem,
    st.sampled_from(DOING),
    st.sampled_from([0, 2, 2, 3]),
    parameters,
    parameters,
    parameters,
    parameters,
    st.integers(-1000, 1000).map(float),
    st.integers(-1000, 1000).map(float),
    altitudes,
    st.booleans(),
)
homes = st.builds(GeoPoint, st.floats(0.001, 90), st.floats(-180, 180), st.floats(-500, 9000))


def polygon(inclusion, vertices):
    command = Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION if inclusion else 5002
    return [MissionItem(command, 0, float(len(vertices)), x=x, y=y, autocontinue=False) for x, y in vertices]


def circle(inclusion, radius, place):
    return [MissionItem(5003 if inclusion else 5004, 0, radius, x=place[0], y=place[1], autocontinue=False)]


places = st.tuples(latitudes, longitudes)
polygons = st.builds(polygon, st.booleans(), st.lists(places, min_size=3, max_size=6))
circles = st.builds(circle, st.booleans(), st.floats(1, 1e5, width=32), places)
returns = st.builds(
    lambda x, y, z: [MissionItem(5000, 3, x=x, y=y, z=z, autocontinue=False)],
    latitudes,
    longitudes,
    altitudes,
)
fences = st.builds(
    lambda first, second, third: tuple(item for part in (*first, *second, *third) for item in part),
    st.lists(polygons, max_size=3),
    st.lists(circles, max_size=3),
    st.lists(returns, max_size=1),
)
rallies = st.lists(
    st.builds(
        lambda x, y, z: MissionItem(5100, 3, x=x, y=y, z=z, autocontinue=False),
        latitudes,
        longitudes,
        altitudes,
    ),
    max_size=4,
).map(tuple)


@st.composite
def missions(draw, *, guarded=True):
    items = draw(st.lists(st.one_of(flying_items, doing_items), max_size=12))
    for index, item in enumerate(items):
        if item.command == Command.DO_JUMP:
            items[index] = replace(item, param1=float(draw(st.integers(0, len(items) - 1))))
    return Mission(
        tuple(items),
        home=draw(st.none() | homes),
        fence=draw(fences) if guarded else (),
        rally=draw(rallies) if guarded else (),
        cruise_speed_m_s=draw(st.floats(0, 1000)),
        hover_speed_m_s=draw(st.floats(0, 1000)),
    )


def filed(mission, firmware=Firmware.PX4):
    """Return the mission as a file of another program keeps it."""
    home = mission.home
    if home is None:
        first = next((item for item in mission.items if item.has_position), None)
        if first is not None and (first.x, first.y) != (0.0, 0.0):
            home = GeoPoint(first.x, first.y)
    items = tuple(item.in_standard_frame() for item in mission.items)
    if firmware == Firmware.ARDUPILOT:
        items = tuple(
            replace(
                item,
                **{
                    name: 0.0 if getattr(item, name) is None else getattr(item, name)
                    for name in ("param1", "param2", "param3", "param4")
                },
            )
            for item in items
        )
    return replace(mission, items=items, home=home)


@patient()
@given(missions(), st.sampled_from(Firmware))
def test_plan_round_trip(mission, firmware):
    assert plan.loads(plan.dumps(mission, firmware).encode()) == filed(mission, firmware)


@patient()
@given(missions(guarded=False), st.sampled_from(Firmware))
def test_waypoints_round_trip(mission, firmware):
    read = waypoints.loads(waypoints.dumps(mission, firmware).encode())
    expected = replace(filed(mission, firmware), cruise_speed_m_s=15.0, hover_speed_m_s=5.0)
    if expected.home is not None:  # home is a row, so it is kept to 1e-7 degree
        home = expected.home
        assert read.home is not None
        assert (abs(read.home.latitude_deg - home.latitude_deg)) <= 0.51e-7
        assert (abs(read.home.longitude_deg - home.longitude_deg)) <= 0.51e-7
        assert read.home.altitude_m == home.altitude_m
        read = replace(read, home=home)
    assert read == expected


@patient()
@given(fences.filter(bool))
def test_fence_as_waypoints_round_trip(fence):
    assert waypoints.loads(waypoints.dumps(Mission((), fence=fence)).encode()) == Mission((), fence=fence)


@patient()
@given(rallies.filter(bool))
def test_rally_as_waypoints_round_trip(rally):
    assert waypoints.loads(waypoints.dumps(Mission((), rally=rally)).encode()) == Mission((), rally=rally)


@patient()
@given(missions())
def test_native_round_trip_is_exact(mission):
    assert native.loads(native.dumps(mission).encode()) == mission


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


@pytest.mark.parametrize("suffix", [".plan", ".waypoints", ".json", ".kml", ".gpx"])
@patient(max_examples=20)
@given(missions(), st.sampled_from([Firmware.PX4, Firmware.ARDUPILOT]))
def test_what_a_format_does_not_keep_is_said(tmp_path_factory, suffix, mission, firmware):
    path = tmp_path_factory.getbasetemp() / f"lossy{suffix}"
    said = losses(mission, path, firmware=firmware)
    write_mission(fitted(mission, path), path, firmware=firmware)
    back = read_mission(path)
    assert bool(said) == bool(differences(mission, back))
    # What the vehicle would fly otherwise is a warning, and nothing else is.
    unset = {"param1": 0, "param2": 0, "param3": 0, "param4": 0}
    before, after = (
        [replace(item.in_standard_frame(), **unset) for item in one.items] for one in (mission, back)
    )
    guarded = (len(back.fence), len(back.rally)) == (len(mission.fence), len(mission.rally))
    assert any(loss.changes_flight for loss in said) == (not (before == after and guarded))


@patient()
@given(missions(guarded=False))
def test_pymavlink_reads_our_waypoints(tmp_path_factory, mission):
    from pymavlink import mavwp

    path = tmp_path_factory.getbasetemp() / "oracle.waypoints"
    path.write_text(waypoints.dumps(mission))
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(path)) == len(mission.items) + 1
    assert (loader.wp(0).frame, loader.wp(0).command) == (0, 16)
    for seq, item in enumerate(filed(mission).items, start=1):
        row = loader.wp(seq)
        assert (row.seq, row.frame, row.command) == (seq, item.frame, item.command)
        assert (row.x, row.y, row.z) == (item.x, item.y, item.z)
        shift = 1.0 if item.command == Command.DO_JUMP else 0.0
        for name in ("param1", "param2", "param3", "param4"):
            value = getattr(item, name)
            if value is None:
                assert math.isnan(getattr(row, name))
            else:
                assert getattr(row, name) == value + (shift if name == "param1" else 0.0)


@pytest.fixture(scope="module")
def mavsdk_importers():
    """MAVSDK's file importers for a PX4 and an ArduPilot, known from a heartbeat each; no sockets."""
    from mavsdk.component_type import ComponentType
    from mavsdk.mavsdk import Configuration, Mavsdk
    from mavsdk.plugins.mission_raw.mission_raw import MissionRaw

    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    assert sdk.add_any_connection("raw://") == 0
    importers = {}
    for system_id, firmware in ((1, Firmware.PX4), (2, Firmware.ARDUPILOT)):
        sender = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=1)
        heartbeat = sender.heartbeat_encode(mavlink.MAV_TYPE_QUADROTOR, int(firmware), 1, 0, 3)
        sdk.pass_received_raw_bytes(heartbeat.pack(sender))
        for _ in range(200):
            found = [system for system in sdk.get_systems() if system.get_system_id() == system_id]
            if found:
                break
            time.sleep(0.02)
        importers[firmware] = MissionRaw(found[0])
    yield importers
    sdk.destroy()


def assert_same_on_the_wire(theirs, item, *, jump_shift=0.0):
    assert (theirs.frame, theirs.command) == (item.frame, item.command)
    assert (theirs.x, theirs.y) == (item.wire_x(), item.wire_y())
    assert theirs.z == np.float32(item.z)
    for name in ("param1", "param2", "param3", "param4"):
        value = getattr(item, name)
        if name == "param1" and item.command == Command.DO_JUMP:
            value += jump_shift
        if value is None:
            assert math.isnan(getattr(theirs, name))
        else:
            assert getattr(theirs, name) == np.float32(value)


def without_terrain(mission):
    # MAVSDK does not scale coordinates of terrain frames (bug), so they cannot be compared.
    return replace(mission, items=tuple(replace(i, frame=3) if i.frame == 10 else i for i in mission.items))


@patient(max_examples=60)
@given(missions().map(without_terrain).filter(lambda mission: mission.items))
def test_mavsdk_reads_our_plan(mavsdk_importers, mission):
    expected = filed(mission)
    theirs = mavsdk_importers[Firmware.PX4].import_qgroundcontrol_mission_from_string(plan.dumps(mission))
    assert len(theirs.mission_items) == len(expected.items)
    for seq, (their, item) in enumerate(zip(theirs.mission_items, expected.items, strict=True)):
        assert their.seq == seq
        assert their.autocontinue == item.autocontinue
        assert_same_on_the_wire(their, item, jump_shift=1.0)  # MAVSDK leaves the doJumpId as it is
    ours = [item for item in expected.fence if item.command != Command.NAV_FENCE_RETURN_POINT]
    assert len(theirs.geofence_items) == len(ours)
    for their, item in zip(theirs.geofence_items, ours, strict=True):
        assert_same_on_the_wire(their, item)
    assert len(theirs.rally_items) == len(expected.rally)
    for their, item in zip(theirs.rally_items, expected.rally, strict=True):
        assert_same_on_the_wire(their, item)


@pytest.mark.parametrize("path", sorted(PLANS.glob("*.plan")), ids=lambda path: path.stem)
def test_mavsdk_reads_recorded_plans_as_we_do(mavsdk_importers, path):
    theirs = mavsdk_importers[Firmware.PX4].import_qgroundcontrol_mission(str(path))
    mission = gpx.loads(gpx.dumps(read_mission(path)).encode())
    assert len(mission.items) > 5
    for their, item in zip(theirs.mission_items, mission.items, strict=True):
        assert_same_on_the_wire(their, item, jump_shift=1.0)


@patient(max_examples=30)
@given(missions().map(without_terrain).filter(lambda mission: mission.items))
def test_mavsdk_reads_our_plan_for_ardupilot(mavsdk_importers, mission):
    expected = filed(mission, Firmware.ARDUPILOT)
    text = plan.dumps(mission, Firmware.ARDUPILOT)
    theirs = mavsdk_importers[Firmware.ARDUPILOT].import_qgroundcontrol_mission_from_string(text)
    home, *items = theirs.mission_items
    if expected.home is not None:
        assert abs(home.x - expected.home.latitude_deg * 1e7) <= 1.0
        assert abs(home.y - expected.home.longitude_deg * 1e7) <= 1.0
    for their, item in zip(items, expected.items, strict=True):
        assert_same_on_the_wire(their, item, jump_shift=1.0)


@patient(max_examples=60)
@given(missions(guarded=False).map(without_terrain))
def test_mavsdk_reads_our_waypoints(mavsdk_importers, mission):
    text = waypoints.dumps(mission)
    theirs = mavsdk_importers[Firmware.PX4].import_mission_planner_mission_from_string(text)
    home, *items = theirs.mission_items
    assert (home.frame, home.command, home.current) == (0, 16, 1)
    for their, item in zip(items, filed(mission).items, strict=True):
        assert_same_on_the_wire(their, item, jump_shift=1.0)


FORMATS = {"plan": plan, "waypoints": waypoints, "native": native, **RECORDS}
READERS = {name: module.loads for name, module in FORMATS.items()} | {"kmz": kml.kmz_loads}
WRITERS = {name: module.dumps for name, module in FORMATS.items()} | {"kmz": kml.kmz_dumps}
STARTS = {
    "kml": b"<kml><Document><Placemark><Point><coordinates>",
    "kmz": b"PK\x03\x04",
    "geojson": b'{"type":"Feature","geometry":',
    "gpx": b"<gpx><rte><rtept ",
    "csv": b"lat,lon,alt\n",
    "plan": b'{"fileType":"Plan","mission":',
    "waypoints": b"QGC WPL 110\n",
    "native": b'{"format":"wbf-mission",',
}


def written(name, mission):
    content = WRITERS[name](mission, Firmware.PX4)
    return content.encode() if isinstance(content, str) else content


def refused_or_read(loads, data):
    try:
        mission = loads(data)
        if isinstance(mission, Drawing):
            mission, _ = mission.mission(30.0)
    except MissionFileError as error:
        assert str(error)
        return
    assert isinstance(mission, Mission)
    for item in (*mission.items, *mission.fence, *mission.rally):
        assert math.isfinite(item.x)
        if has_position(item.command) and item.frame in {0, 3, 10}:
            assert abs(item.x) <= 90


@pytest.mark.parametrize("name", READERS)
@patient()
@given(st.binary(max_size=200), st.booleans())
@example(data=b"\x1c", started=False)  # white space that ends no line
def test_random_bytes_are_refused_politely(name, data, started):
    refused_or_read(READERS[name], STARTS[name] + data if started else data)


SMALL = Mission(
    (
        MissionItem(22, 3, x=28.05, y=-82.15, z=10.0),
        MissionItem(178, 2, 1.0, 5.0),
        MissionItem(177, 2, 0.0, 2.0),
        MissionItem(20, Frame.MISSION),
    ),
    home=GeoPoint(28.05, -82.15, 30.0),
)
WHOLE = replace(
    SMALL,
    fence=(*polygon(True, [(0, 0), (0, 1), (1, 1)]), *circle(False, 5.0, (1, 1))),
    rally=(MissionItem(5100, 3, x=1.0, y=2.0, z=3.0),),
)
TOKENS = [
    b"null",
    b"NaN",
    b"-1",
    b"1e400",
    b"65536",
    b'"a"',
    b"[",
    b"]",
    b"{",
    b"}",
    b"true",
    b"\t",
    b"\n",
    b"\xff",
]


@pytest.mark.parametrize("name", READERS)
@patient(max_examples=300)
@given(data=st.data())
def test_damaged_files_are_refused_politely(name, data):
    content = bytearray(written(name, SMALL if name == "waypoints" else WHOLE))
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(content) - 1))
        length = data.draw(st.integers(0, 12))
        content[start : start + length] = data.draw(st.sampled_from(TOKENS) | st.binary(max_size=3))
        if not content:
            break
    refused_or_read(READERS[name], bytes(content))


@pytest.mark.parametrize("name", READERS)
def test_truncated_files_are_refused_politely(name):
    content = written(name, SMALL)
    for end in range(0, len(content), 1 + len(content) // 800):
        refused_or_read(READERS[name], content[:end])
