"""What is written is what is read, by ourselves, MAVSDK and pymavlink; damaged files are refused politely."""

import math
from dataclasses import replace

import numpy as np
import pytest
from any_missions import (
    SMALL,
    WHOLE,
    check_damaged,
    check_kept,
    check_truncated,
    fences,
    missions,
    patient,
    rallies,
    refused_or_read,
)
from hypothesis import example, given
from hypothesis import strategies as st
from processes import wait_until
from sweeps import sweep

from mission.files import Firmware, native, plan, waypoints
from mission.link.codec.dialect import mavlink
from mission.model import Command, GeoPoint, Mission

PARAMETERS = ("param1", "param2", "param3", "param4")


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
            replace(item, **{name: getattr(item, name) or 0.0 for name in PARAMETERS}) for item in items
        )
    return replace(mission, items=items, home=home)


@sweep(few=30, many=200)
@given(missions(), st.sampled_from(Firmware))
def test_plan_round_trip(mission, firmware):
    assert plan.loads(plan.dumps(mission, firmware).encode()) == filed(mission, firmware)


@sweep(few=40, many=200)
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


@given(fences.filter(bool))
def test_fence_as_waypoints_round_trip(fence):
    assert waypoints.loads(waypoints.dumps(Mission((), fence=fence)).encode()) == Mission((), fence=fence)


@given(rallies.filter(bool))
def test_rally_as_waypoints_round_trip(rally):
    assert waypoints.loads(waypoints.dumps(Mission((), rally=rally)).encode()) == Mission((), rally=rally)


@sweep(few=30, many=200)
@given(missions())
def test_native_round_trip_is_exact(mission):
    assert native.loads(native.dumps(mission).encode()) == mission


@pytest.mark.parametrize("suffix", [".plan", ".waypoints", ".json"])
@patient(max_examples=20)
@given(missions(), st.sampled_from([Firmware.PX4, Firmware.ARDUPILOT]))
def test_what_a_format_does_not_keep_is_said(tmp_path_factory, suffix, mission, firmware):
    check_kept(mission, tmp_path_factory.getbasetemp() / f"lossy{suffix}", firmware)


@sweep(few=40, many=200)
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
        for name in PARAMETERS:
            value = getattr(item, name)
            if value is None:
                assert math.isnan(getattr(row, name))
            else:
                assert getattr(row, name) == value + (shift if name == "param1" else 0.0)


@pytest.fixture(scope="module")
def mavsdk():
    """MAVSDK's file importer for a PX4, known from a heartbeat; no sockets."""
    from mavsdk.component_type import ComponentType
    from mavsdk.mavsdk import Configuration, Mavsdk
    from mavsdk.plugins.mission_raw.mission_raw import MissionRaw

    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    assert sdk.add_any_connection("raw://") == 0
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    heartbeat = sender.heartbeat_encode(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 1, 0, 3)
    sdk.pass_received_raw_bytes(heartbeat.pack(sender))
    yield MissionRaw(wait_until(sdk.get_systems)[0])
    sdk.destroy()


def assert_same_on_the_wire(theirs, item, *, jump_shift=0.0):
    assert (theirs.frame, theirs.command) == (item.frame, item.command)
    assert (theirs.x, theirs.y) == (item.wire_x(), item.wire_y())
    assert theirs.z == np.float32(item.z)
    for name in PARAMETERS:
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


@sweep(few=30, many=200)
@given(missions().map(without_terrain).filter(lambda mission: mission.items))
def test_mavsdk_reads_our_plan(mavsdk, mission):
    expected = filed(mission)
    theirs = mavsdk.import_qgroundcontrol_mission_from_string(plan.dumps(mission))
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


@patient(max_examples=60)
@given(missions(guarded=False).map(without_terrain))
def test_mavsdk_reads_our_waypoints(mavsdk, mission):
    theirs = mavsdk.import_mission_planner_mission_from_string(waypoints.dumps(mission))
    home, *items = theirs.mission_items
    assert (home.frame, home.command, home.current) == (0, 16, 1)
    for their, item in zip(items, filed(mission).items, strict=True):
        assert_same_on_the_wire(their, item, jump_shift=1.0)


FORMATS = {"plan": plan, "waypoints": waypoints, "native": native}
STARTS = {
    "plan": b'{"fileType":"Plan","mission":',
    "waypoints": b"QGC WPL 110\n",
    "native": b'{"format":"wbf-mission",',
}


@pytest.mark.parametrize("name", FORMATS)
@given(st.binary(max_size=200), st.booleans())
@example(data=b"\x1c", started=False)  # white space that ends no line
def test_random_bytes_are_refused_politely(name, data, started):
    refused_or_read(FORMATS[name].loads, STARTS[name] + data if started else data)


@pytest.mark.parametrize("name", FORMATS)
@sweep(few=80, many=600)
@given(data=st.data())
def test_damaged_files_are_refused_politely(name, data):
    mission = SMALL if name == "waypoints" else WHOLE
    check_damaged(data, FORMATS[name].loads, FORMATS[name].dumps(mission).encode())


@pytest.mark.parametrize("name", FORMATS)
def test_truncated_files_are_refused_politely(name):
    check_truncated(FORMATS[name].loads, FORMATS[name].dumps(SMALL).encode())
