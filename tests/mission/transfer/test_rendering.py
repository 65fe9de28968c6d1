"""A plan as PX4 and ArduPilot take it, and what is said of it, after what real ones were seen to do."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.autopilots import ARDUPILOT, GENERIC, PX4
from mission.model import Command, GeoPoint, Mission, MissionItem, MissionType
from mission.transfer import LocalTransferError, refuse_errors, render
from mission.transfer.storage import validate_item

COPTER, PLANE, ROVER = 2, 1, 10
HOME = GeoPoint(28.05, -82.15, 30.0)
TAKEOFF = MissionItem(Command.NAV_TAKEOFF, 3, param4=None, x=28.05, y=-82.15, z=10.0)
THERE = MissionItem.waypoint(28.051, -82.15, 10.0)
BACK = MissionItem(Command.NAV_RETURN_TO_LAUNCH)
LAND = MissionItem(Command.NAV_LAND, 3, x=28.05, y=-82.15)
POSITION = {"x": 28.05, "y": -82.15, "z": 10.0}


def rendered(*items, profile=PX4, vehicle_type=COPTER, home=HOME, **more):
    return render(Mission((TAKEOFF, THERE, *items), home), profile, vehicle_type, **more)


def told(found):
    """Severity and item (from 1) of each remark."""
    return [(one.severity.value, None if one.item is None else one.item + 1) for one in found.remarks]


def of(command, frame=3, *params, **more):
    return MissionItem(command, frame, *params, **({**POSITION, **more} if frame != 2 else more))


@pytest.mark.parametrize(
    ("item", "profile", "vehicle_type", "says"),
    [
        # PX4 1.17: waypoint in frame 2 UNSUPPORTED; terrain and local frames UNSUPPORTED_FRAME.
        (MissionItem(16, 2, x=28.0, y=-82.0, z=10.0), PX4, COPTER, "frame 2 (MISSION)"),
        (of(16, 10), PX4, COPTER, "does not take frame 10 (GLOBAL_TERRAIN_ALT); give altitudes above home"),
        # Commands that fail the whole upload, and what would be accepted.
        (of(18, 3, 2.0), PX4, COPTER, "does not know this command; use NAV_LOITER_TIME"),
        (of(179, 3, 0.0), PX4, COPTER, "only without a position; give the command in frame 2"),
        (of(201, 3, 4.0), PX4, COPTER, "DO_SET_ROI of mode 4"),
        (MissionItem(177, 2, 9.0, 1.0), PX4, COPTER, "jumps to item 10; give an item from 1 to 3"),
        # ArduCopter 4.7: bad DO_JUMP ERROR, unknown command UNSUPPORTED, bad frame UNSUPPORTED_FRAME.
        (MissionItem(177, 2, 3.0, 1.0), ARDUPILOT, COPTER, "jumps to item 4"),
        (of(16, 3, z=90_000.0), ARDUPILOT, COPTER, "accepts altitudes below 83000 m"),
    ],
)
def test_what_would_be_refused_is_an_error_with_what_would_be_accepted(item, profile, vehicle_type, says):
    found = rendered(item, profile=profile, vehicle_type=vehicle_type)
    (error,) = found.errors
    assert (error.plan, error.item, error.command) == (MissionType.MISSION, 2, item.command)
    assert says in str(error)
    assert str(error).startswith("mission item 3 (")
    assert found.mission.items[2] == item  # for who wants it all the same
    with pytest.raises(LocalTransferError, match="mission item 3"):
        refuse_errors(found)


@pytest.mark.parametrize(
    ("home", "first", "expected"),
    [(HOME, THERE, (28.05, -82.15)), (None, THERE, (28.051, -82.15)), (None, BACK, None)],
)
def test_px4_gets_a_take_off_with_real_coordinates(home, first, expected):
    """One at 0, 0 is taken and never progresses."""
    nowhere = replace(TAKEOFF, x=0.0, y=0.0)
    found = render(Mission((nowhere, first), home), PX4)
    item = found.mission.items[0]
    if expected is None:
        assert told(found) == [("error", 1)]
    else:
        assert (item.x, item.y) == expected
        assert told(found) == [("warning", 1)]
    assert render(Mission((nowhere, first), home), ARDUPILOT).mission.items[0] == nowhere


def test_what_is_equal_is_sent_in_its_place():
    spline = rendered(of(82, 3, 2.0)).mission.items[2]
    assert (spline.command, spline.param1, spline.x) == (16, 2.0, 28.05)
    assert rendered(of(82, 3, 2.0), profile=ARDUPILOT).mission.items[2].command == 82
    assert rendered(of(82), profile=ARDUPILOT, vehicle_type=PLANE).mission.items[2].command == 16
    timed = rendered(MissionItem(214, 2, 1500.0), THERE, MissionItem(214, 2, 0.0), profile=ARDUPILOT)
    start, _, stop = timed.mission.items[2:]
    assert (start.command, start.param2, start.param3) == (2000, 1.5, 0.0)
    assert stop.command == 2001
    assert told(timed) == [("warning", 3)]
    assert timed.remarks[0].others == (4,)
    assert not rendered(MissionItem(214, 2, 1500.0)).remarks
    assert rendered(MissionItem(201, 3, 0.0)).mission.items[2].command == Command.DO_SET_ROI_NONE


def test_px4_turns_by_the_heading_of_the_waypoint():
    found = rendered(MissionItem(115, 2, 90.0), MissionItem(178, 2, 1.0, 3.0), THERE, BACK)
    assert [item.command for item in found.mission.items] == [22, 16, 178, 16, 20]
    assert found.mission.items[3].param4 == 90.0
    assert found.origins == (0, 1, 3, 4, 5)
    assert told(found) == [("warning", 3)]
    for bad in (
        (MissionItem(115, 2, 90.0, 0.0, 1.0, 1.0), THERE),  # relative
        (MissionItem(115, 2, 90.0), replace(THERE, param4=10.0)),  # it has a heading
        (MissionItem(115, 2, 90.0), LAND),
        (MissionItem(115, 2, 90.0),),
    ):
        found = rendered(*bad)
        assert told(found) == [("error", 3)]
        assert found.mission.items[2] == bad[0]


def test_the_landing_begins_with_a_position_or_without():
    loiter = of(31, 3, 1.0, 60.0, z=30.0, x=28.06)
    placed = replace(loiter, command=189, param1=0.0, param2=0.0)
    bare = MissionItem(Command.DO_LAND_START)
    for start in (placed, bare):
        px4 = rendered(start, loiter, LAND, vehicle_type=PLANE)
        assert px4.mission.items[2] == bare
        ardupilot = rendered(start, loiter, LAND, profile=ARDUPILOT, vehicle_type=PLANE)
        sent = ardupilot.mission.items[2]
        assert (sent.frame, sent.x, sent.y, sent.z) == (3, 28.06, -82.15, 30.0)
        assert not px4.errors
        assert not ardupilot.errors


@pytest.mark.parametrize(
    ("item", "expected"),
    [
        (MissionItem(93, 2, 5.0, None, None, None), (5.0, -1.0, -1.0, -1.0)),
        (MissionItem(178, 2, 1.0, None, None, None), (1.0, -1.0, -1.0, 0.0)),
        (of(19, 3, None, None, None, None), (0.0, 0.0, 0.0, 0.0)),
        (of(16, 3, None, None, None, None), (0.0, 0.0, 0.0, None)),
        (of(21, 3, None, None, None, None), (0.0, 0.0, 0.0, None)),
    ],
)
def test_unset_parameters_become_defaults_where_nan_is_refused(item, expected):
    ours = rendered(item, profile=ARDUPILOT).mission.items[2]
    assert (ours.param1, ours.param2, ours.param3, ours.param4) == expected
    assert rendered(item).mission.items[2] == item


def test_jumps_lead_to_where_they_led():
    found = rendered(MissionItem(530, 2, 0.0, 0.0), THERE, MissionItem(177, 2, 3.0, 2.0), profile=ARDUPILOT)
    assert found.origins == (0, 1, 3, 4)
    assert found.mission.items[3].param1 == 2.0
    assert found.mission.items[2] == THERE
    assert [found.index_of(k) for k in range(5)] == [0, 1, 2, 2, 3]
    many = rendered(*[MissionItem(177, 2, 1.0, 1.0)] * 16, profile=ARDUPILOT)
    assert told(many) == [("warning", None)]


@pytest.mark.parametrize(
    ("item", "profile", "vehicle_type", "severity", "says"),
    [
        (replace(THERE, param2=1.0), ARDUPILOT, COPTER, "note", "WPNAV_RADIUS"),
        (replace(THERE, param3=1.0), PX4, COPTER, "note", "param3"),
        (replace(THERE, param4=90.0), ARDUPILOT, COPTER, "warning", "put CONDITION_YAW before the waypoint"),
        (replace(THERE, param1=5.0), ARDUPILOT, PLANE, "warning", "use NAV_LOITER_TIME"),
        (of(19, 3, 5.0, 0.0, 60.0), ARDUPILOT, PLANE, "warning", "WP_LOITER_RAD"),
        (replace(THERE, autocontinue=False), ARDUPILOT, COPTER, "warning", "use NAV_LOITER_UNLIM"),
    ],
)
def test_what_is_ignored_is_told(item, profile, vehicle_type, severity, says):
    items = (LAND,) if vehicle_type == PLANE else ()
    found = rendered(item, item, *items, profile=profile, vehicle_type=vehicle_type)
    if severity is None:
        assert not found.remarks
        return
    (remark,) = found.remarks
    assert (remark.severity.value, remark.item) == (severity, 2)
    assert says in str(remark)
    assert remark.count == remark.summary()["count"] == 2
    assert re.match(r"mission item 3 \(\w+\) and 1 more: ", str(remark))


def test_what_a_fixed_wing_needs_to_be_armed():
    px4 = rendered(BACK, vehicle_type=PLANE)
    (error,) = px4.errors
    assert error.item is None
    assert "MIS_TKO_LAND_REQ is 2" in error.text
    assert not rendered(LAND, vehicle_type=PLANE).remarks
    free = {"MIS_TKO_LAND_REQ": 0.0}
    assert not rendered(BACK, vehicle_type=PLANE, parameters=free).remarks
    assert told(rendered(BACK, vehicle_type=PLANE, planned=free)) == [("note", None)]
    with pytest.raises(LocalTransferError, match="without a landing"):
        refuse_errors(px4)
    refuse_errors(px4, arming=False)
    assert not rendered(BACK).remarks
    landing = (MissionItem(189), LAND)
    plane = {"profile": ARDUPILOT, "vehicle_type": PLANE}
    assert told(rendered(*landing, **plane)) == [("warning", 3)]
    assert told(rendered(*landing, **plane, parameters={"RTL_AUTOLAND": 0.0})) == [("error", 3)]
    (note,) = rendered(*landing, **plane, planned={"RTL_AUTOLAND": 2.0}).remarks
    assert (note.severity.value, note.item, note.parameter) == ("note", 2, "RTL_AUTOLAND")
    assert "make sure that RTL_AUTOLAND is 2 on the vehicle, as the plan assumes" in str(note)
    told_by_vehicle = {"RTL_AUTOLAND": 2.0}
    assert not rendered(*landing, **plane, parameters=told_by_vehicle, planned={"RTL_AUTOLAND": 0.0}).remarks
    assert told(rendered(*landing, **plane, planned={"RTL_AUTOLAND": 0.0})) == [("error", 3)]
    assert not rendered(LAND, **plane).remarks


def corner(corners, frame=3, command=5001):
    return MissionItem(command, frame, float(corners), x=28.05, y=-82.15)


@pytest.mark.parametrize(
    ("fence", "rally", "expected"),
    [
        ((corner(3),) * 3 + (corner(4, command=5002),) * 4, (), []),
        ((corner(2),) * 2, (), [(1, 0)]),
        ((corner(3),) * 2 + (corner(3, command=5002),) * 3, (), [(1, 0)]),
        ((corner(50, command=5003), corner(0, command=5004)), (), [(1, 1)]),
        ((corner(50, 10, 5003),), (), [(1, 0)]),
        ((), (MissionItem(5100, 2), of(5100)), [(2, 0)]),
    ],
)
def test_fence_and_rally_points(fence, rally, expected):
    found = render(Mission((TAKEOFF, THERE), HOME, fence=fence, rally=rally), PX4)
    assert [(one.plan, one.item) for one in found.errors] == expected
    assert len(found.remarks) == len(expected)
    assert not render(Mission((TAKEOFF, THERE), HOME, fence=fence, rally=rally), GENERIC).remarks


@pytest.mark.parametrize(
    ("profile", "count", "severity"),
    [
        (PX4, 500, None),
        (PX4, 501, "warning"),
        (ARDUPILOT, 649, None),
        (ARDUPILOT, 650, "warning"),
        (ARDUPILOT, 4368, "error"),
    ],
)
def test_how_many_items_an_autopilot_holds(profile, count, severity):
    found = render(Mission((TAKEOFF,) + (THERE,) * (count - 1), HOME), profile)
    assert told(found) == ([] if severity is None else [(severity, None)])


@pytest.mark.parametrize(
    ("kib", "count", "severity"), [(0, 1311, "warning"), (0, 1312, "error"), (11, 750, "error")]
)
def test_how_many_items_a_vehicle_holds_that_told_of_its_card(kib, count, severity):
    mission = Mission((TAKEOFF,) + (THERE,) * (count - 1), HOME)
    found = render(mission, ARDUPILOT, parameters={"BRD_SD_MISSION": float(kib)})
    assert told(found) == ([] if severity is None else [(severity, None)])
    if severity == "error":
        assert f"(BRD_SD_MISSION {kib})" in found.errors[0].text
        assert found.errors[0].fix.startswith(f"set BRD_SD_MISSION to {20 if kib == 0 else 12} and restart")


KNOWN = st.sampled_from([16, 17, 18, 19, 20, 21, 22, 31, 82, 93, 112, 115, 177, 178, 189, 195, 201, 206, 214])
NUMBER = st.one_of(st.none(), st.floats(0.0, 20.0, width=32))
ITEMS = st.lists(
    st.builds(
        MissionItem,
        KNOWN,
        st.sampled_from([0, 2, 3, 10]),
        NUMBER,
        NUMBER,
        NUMBER,
        NUMBER,
        st.sampled_from([0.0, 28.05]),
        st.sampled_from([0.0, -82.15]),
        st.floats(0.0, 100.0, width=32),
        st.booleans(),
    ),
    max_size=8,
)


def test_a_spline_that_is_sent_as_a_waypoint_takes_the_heading_before_it():
    items = (MissionItem(115, 0, 90.0), MissionItem(82, 3, x=28.05, y=-82.15, z=9.0))
    found = render(Mission(items, HOME), PX4, COPTER)
    assert [(item.command, item.param4) for item in found.mission.items] == [(16, 90.0)]
    assert not found.errors


@given(ITEMS, st.sampled_from([PX4, ARDUPILOT]), st.sampled_from([COPTER, PLANE, ROVER]))
def test_what_is_no_error_would_be_taken(items, profile, vehicle_type):
    """Judged as the vehicle's side does it, item by item."""
    found = render(Mission(tuple(items), HOME), profile, vehicle_type)
    bad = {number for remark in found.errors for number in (remark.item, *remark.others)}
    sent = found.mission.items
    for item, origin in zip(sent, found.origins, strict=True):
        on_wire = item
        if item.command == Command.DO_JUMP and item.param1 is not None and profile.home_at_zero:
            on_wire = replace(item, param1=item.param1 + 1)
        count = len(sent) + int(profile.home_at_zero)
        if origin not in bad:
            assert validate_item(on_wire, count, profile) == 0
    # Nothing is changed twice.
    again = render(found.mission, profile, vehicle_type)
    assert again.mission == found.mission
