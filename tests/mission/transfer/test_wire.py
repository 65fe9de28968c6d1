"""Items on the wire and their comparison."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.autopilots import ARDUPILOT, GENERIC, PX4
from mission.link import FrameReader, FrameWriter
from mission.model import Command, Frame, GeoPoint, MissionItem, MissionType
from mission.transfer import compare_plans, item_from_message, item_to_message, plan_checksum
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
        ({"frame": 0}, GENERIC, ["frame"]),
        ({"x": 28.0500005}, GENERIC, ["x"]),
        ({"z": 10.02}, GENERIC, ["z"]),
        ({"param4": -10.0}, GENERIC, []),
        ({"param4": 349.0}, GENERIC, ["param4"]),
        ({"param1": 2.0}, GENERIC, ["param1"]),
        ({"param3": 2e-5}, GENERIC, ["param3"]),
        ({"param1": 2.0}, ARDUPILOT, []),
        ({"param2": 0.0, "param4": 0.0, "autocontinue": False}, ARDUPILOT, []),
        ({"param2": 0.0, "autocontinue": False}, PX4, ["autocontinue", "param2"]),
        ({"command": 19}, PX4, ["command"]),
    ],
)
def test_comparison(fields, profile, found):
    differences = compare_plans((WAYPOINT,), (changed(**fields),), profile)
    assert [difference.field for difference in differences] == found
    assert all("item 1" in str(difference) for difference in differences)


def test_comparison_of_other_items():
    no_place, high = MissionItem(203, 2, x=7.6), MissionItem.waypoint(1, 2, 5000.0)
    assert compare_plans((no_place,), (replace(no_place, x=7.0),)) == (), "x and y are whole on the wire"
    assert compare_plans((high,), (replace(high, z=5000.04),)) == ()
    for sent, change in ((no_place, {"x": 8.0}), (high, {"z": 5000.06})):
        (difference,) = compare_plans((sent,), (replace(sent, **change),))
        assert difference.field in change
