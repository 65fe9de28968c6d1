"""The mission model against MAVLink's own definitions."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.errors import MissionError
from mission.link.codec.dialect import mavlink
from mission.model import GLOBAL_FRAMES, Command, Frame, Mission, MissionItem, MissionType, has_position

LOCAL_COMMANDS = {23, 24}


def test_commands_and_frames_are_those_of_mavlink():
    for command in Command:
        assert mavlink.enums["MAV_CMD"][command].name == f"MAV_CMD_{command.name}"
    for frame in Frame:
        assert mavlink.enums["MAV_FRAME"][frame].name == f"MAV_FRAME_{frame.name}"


def test_positions_are_those_of_mavlink():
    located = {c for c, entry in mavlink.enums["MAV_CMD"].items() if getattr(entry, "has_location", False)}
    assert {c for c in range(65536) if has_position(c)} == located - LOCAL_COMMANDS


@pytest.mark.parametrize(
    ("given_frame", "kept"), [(0, 0), (5, 0), (3, 3), (6, 3), (10, 10), (11, 10), (2, 2)]
)
def test_int_frames_are_folded(given_frame, kept):
    assert MissionItem(16, given_frame).frame == kept


@given(st.floats(-90, 90), st.floats(-180, 180), st.floats(-1000, 10000))
def test_place_is_kept_to_what_the_wire_carries(latitude, longitude, altitude):
    item = MissionItem.waypoint(latitude, longitude, altitude)
    assert abs(item.x - latitude) <= 0.51e-7
    assert item.wire_x() == round(item.x * 1e7)
    assert item.wire_y() / 1e7 == item.y
    assert -(2**31) <= item.wire_y() < 2**31


@pytest.mark.parametrize(
    ("values", "part"),
    [
        ({"x": 90.1}, "latitude 90.1"),
        ({"x": math.nan}, "latitude nan"),
        ({"param1": math.inf}, "param1 inf"),
        ({"command": 65536}, "command 65536"),
        ({"frame": 256}, "frame 256"),
    ],
)
def test_bad_values_are_named(values, part):
    with pytest.raises(MissionError) as caught:
        MissionItem(**({"command": 16, "frame": 3} | values))
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("values", [{"x": 3e9}, {"y": math.nan}, {"z": 1e39}])
def test_bad_parameters_five_to_seven(values):
    with pytest.raises(MissionError, match="is not in"):
        MissionItem(Command.DO_JUMP, Frame.MISSION, **values)


def test_nan_is_none():
    assert MissionItem(16, 3, param4=math.nan).param4 is None


@given(st.sampled_from(sorted(Command)), st.integers(0, 20))
def test_standard_frame(command, frame):
    item = MissionItem(command, frame)
    standard = item.in_standard_frame()
    if has_position(command) or item.frame not in GLOBAL_FRAMES:
        assert standard == item
    else:
        assert standard.frame == Frame.MISSION
    assert standard.in_standard_frame() == standard


def test_mission_checks_its_values():
    item = MissionItem.waypoint(1.0, 2.0, 3.0)
    assert Mission([item]).items == (item,)
    assert Mission((), fence=(item,)).plan(MissionType.FENCE) == (item,)
    with pytest.raises(MissionError, match="65536 items"):
        Mission((item,) * 65536)
    for speed in (-1.0, math.nan, math.inf):
        with pytest.raises(MissionError, match="hover_speed_m_s"):
            Mission((), hover_speed_m_s=speed)
