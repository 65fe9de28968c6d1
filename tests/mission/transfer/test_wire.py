"""Items on the wire, results in words, profiles and the comparison."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.autopilots import ARDUPILOT, GENERIC, PX4, profile_for
from mission.link import FrameReader, FrameWriter
from mission.link.codec.dialect import mavlink
from mission.model import Command, Frame, GeoPoint, MissionItem, MissionType
from mission.transfer import compare_plans, item_from_message, item_to_message, plan_checksum, result_text
from mission.transfer.remarks import count_warning
from mission.transfer.wire import from_wire_order, to_wire_order

parameter = st.one_of(st.none(), st.floats(-1e30, 1e30))
places = st.builds(
    MissionItem,
    st.sampled_from([16, 21, 22, 19, 5001, 5100, 195]),
    st.sampled_from([0, 3, 5, 6, 10, 11]),
    parameter,
    parameter,
    parameter,
    parameter,
    st.floats(-90, 90),
    st.floats(-180, 180),
    st.floats(-1e4, 1e5),
    st.booleans(),
)
items = st.one_of(
    places,
    st.builds(
        MissionItem,
        st.integers(0, 65535),
        st.sampled_from([1, 2, 4]),
        parameter,
        parameter,
        parameter,
        parameter,
        st.integers(-(2**31) + 1, 2**31 - 1).map(float),
        st.integers(-(2**31) + 1, 2**31 - 1).map(float),
        st.floats(-1e30, 1e30),
        st.booleans(),
    ),
)


def cross(item, **options):
    message = item_to_message(item, 7, 0, (1, 1), **options)
    (got,) = FrameReader().feed(FrameWriter(255, 190).encode(message))
    assert got.seq == 7
    return item_from_message(got)


def as_received(item):
    """The item in the numbers of the wire: 32-bit floats, integer x and y where they are no position."""
    numbers = {
        name: None if getattr(item, name) is None else float(np.float32(getattr(item, name)))
        for name in ("param1", "param2", "param3", "param4", "z")
    }
    whole = {} if item.has_position else {"x": float(int(item.x)), "y": float(int(item.y))}
    return replace(item, **numbers, **whole)


@given(items)
def test_an_item_crosses_the_wire(item):
    assert cross(item) == as_received(item)
    assert cross(cross(item)) == cross(item)
    assert compare_plans((item,), (cross(item),)) == ()
    assert plan_checksum((item,)) == plan_checksum((cross(item),)) != 0


@given(places)
def test_the_float_message_is_worse_by_metres_at_most(item):
    got = cross(item, integer=False)
    assert abs(got.x - item.x) < 1e-5
    assert abs(got.y - item.y) < 1e-5
    assert (got.command, got.frame, got.autocontinue) == (item.command, item.frame, item.autocontinue)


def test_the_current_mark():
    item = MissionItem.waypoint(1, 2, 3)
    assert item_to_message(item, 0, 0, (1, 1)).current == 0
    assert item_to_message(item, 0, 0, (1, 1), current=True).current == 1
    assert math.isnan(item_to_message(item, 0, 0, (1, 1)).param4)


def test_checksums():
    one, other = MissionItem.waypoint(1, 2, 3), MissionItem.waypoint(1, 2, 4)
    assert plan_checksum(()) == 0
    assert len({plan_checksum(plan) for plan in ((one,), (other,), (one, other), (other, one))}) == 4


def test_every_result_has_words():
    for value, entry in mavlink.enums["MAV_MISSION_RESULT"].items():
        if entry.name.endswith("ENUM_END"):
            continue
        assert entry.name in result_text(value)
        assert "unknown" not in result_text(value)
    assert "unknown result (result 200)" in result_text(200)


def test_profiles_and_warnings():
    assert (profile_for(12), profile_for(3), profile_for(0)) == (PX4, ARDUPILOT, GENERIC)
    assert count_warning(PX4, MissionType.MISSION, 500) is None
    assert "64" in count_warning(PX4, MissionType.FENCE, 65)
    assert "only 649 without an SD card" in count_warning(ARDUPILOT, MissionType.MISSION, 650)
    assert count_warning(GENERIC, MissionType.MISSION, 60000) is None


@given(st.lists(items, max_size=5))
def test_home_in_front_and_back(plan):
    plan = (*plan, MissionItem(Command.DO_JUMP, 2, 0.0, 3.0))
    home = GeoPoint(28.0, -82.0, 5.0)
    moved = to_wire_order(plan, MissionType.MISSION, ARDUPILOT, home)
    assert moved[-1].param1 == 1.0
    assert from_wire_order(moved, MissionType.MISSION, ARDUPILOT) == (plan, home)
    assert to_wire_order(plan, MissionType.RALLY, ARDUPILOT, home) == plan
    assert to_wire_order(plan, MissionType.MISSION, PX4, home) == plan
    assert to_wire_order((), MissionType.MISSION, ARDUPILOT, home) == ()


WAYPOINT = MissionItem.waypoint(28.05, -82.15, 10.0, hold_s=2.5, acceptance_radius_m=1.0, yaw_deg=350.0)


def changed(**fields):
    values = {
        name: getattr(WAYPOINT, name) for name in ("param1", "param2", "param3", "param4", "x", "y", "z")
    }
    return MissionItem(**({"command": 16, "frame": Frame.GLOBAL_RELATIVE_ALT} | values | fields))


@pytest.mark.parametrize(
    ("fields", "profile", "found"),
    [
        ({}, GENERIC, []),
        ({"frame": 6}, GENERIC, []),
        ({"frame": 0}, GENERIC, ["frame"]),
        ({"x": 28.0500002}, GENERIC, []),
        ({"x": 28.0500005}, GENERIC, ["x"]),
        ({"z": 10.01}, GENERIC, []),
        ({"z": 10.02}, GENERIC, ["z"]),
        ({"param4": -10.0}, GENERIC, []),
        ({"param4": 349.0}, GENERIC, ["param4"]),
        ({"param4": None}, GENERIC, ["param4"]),
        ({"param1": 2.0}, GENERIC, ["param1"]),
        ({"param3": 9e-6}, GENERIC, []),
        ({"param3": 2e-5}, GENERIC, ["param3"]),
        ({"param1": 2.0}, ARDUPILOT, []),
        ({"param1": 4.0}, ARDUPILOT, ["param1"]),
        ({"param2": 0.0, "param4": 0.0, "autocontinue": False}, ARDUPILOT, []),
        ({"param2": 0.0, "autocontinue": False}, PX4, ["autocontinue", "param2"]),
        ({"command": 19}, PX4, ["command"]),
    ],
)
def test_comparison(fields, profile, found):
    differences = compare_plans((WAYPOINT,), (changed(**fields),), profile)
    assert [difference.field for difference in differences] == found
    assert all("item 1" in str(difference) for difference in differences)


NO_PLACE, HIGH, LOITER = (
    MissionItem(203, 2, x=7.6),
    MissionItem.waypoint(1, 2, 5000.0),
    MissionItem(31, 3, param2=None),
)


@pytest.mark.parametrize(
    ("sent", "fields", "profile", "found"),
    [
        (NO_PLACE, {"x": 7.0}, GENERIC, []),  # x and y are whole on the wire
        (NO_PLACE, {"x": 8.0}, GENERIC, ["x"]),
        (HIGH, {"z": 5000.04}, GENERIC, []),
        (HIGH, {"z": 5000.06}, GENERIC, ["z"]),
        (LOITER, {"param2": 0.0}, ARDUPILOT, []),
        (LOITER, {"param2": 5.0}, ARDUPILOT, ["param2"]),
        (LOITER, {"param2": 0.0}, GENERIC, ["param2"]),
    ],
)
def test_comparison_of_other_items(sent, fields, profile, found):
    differences = compare_plans((sent,), (replace(sent, **fields),), profile)
    assert [difference.field for difference in differences] == found


def test_comparison_of_whole_plans():
    assert compare_plans((), ()) == ()
    (difference,) = compare_plans((WAYPOINT,), ())
    assert str(difference) == "1 items were sent, the vehicle holds 0"
    many = compare_plans((WAYPOINT,) * 100, (changed(x=1.0, y=1.0),) * 100, limit=5)
    assert len(many) == 5
