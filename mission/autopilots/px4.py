"""Profile of PX4.

Sources: ``mavlink_mission.cpp``/``.h`` (parse_mavlink_mission_item, format_mavlink_mission_item),
``px4_custom_mode.h`` through pymavlink, ``rc.fw_defaults``, the parameter reference 1.14 to 1.17, and tests
with PX4 1.17 (SIH).
"""

from __future__ import annotations

from collections.abc import Mapping

from mission.autopilots.dialect import (
    FENCE_READ_BACK,
    FIXED_WING,
    NO_PARAMETERS,
    ROVER,
    STRAIGHT,
    ArmingCondition,
    Dialect,
    IgnoredField,
    ReadBack,
    Severity,
)
from mission.autopilots.profile import FlightModes, Meaning, Motion, Profile, Questions, VehicleSettings
from mission.link.codec.dialect import mavlink as m
from mission.model import MAX_ITEMS, Command, MissionType

_LANDINGS = frozenset({21, 85})
_TAKEOFFS = frozenset({22, 84})
# These are the commands of parse_mavlink_mission_item in a global frame and in frame MISSION.
_PLACED = frozenset({16, 17, 19, 21, 22, 31, 80, 84, 85, 195, 201, 4501, 5000, 5001, 5002, 5003, 5004, 5100})
_UNPLACED = frozenset(
    {20, 80, 93, 112, 114, 177, 178, 179, 187, 189, 196, 197, 200, 201, 203, 204, 205, 206, 211, 214}
    | {260, 530, 531, 532, 1000, 1001, 2000, 2001, 2003, 2500, 2501, 3000, 42600}
)
_NOTHING, _FLAG = ReadBack.NOTHING, ReadBack.FLAG
_LOSSY: Mapping[int, frozenset[str]] = {
    Command.NAV_WAYPOINT: frozenset({"param3"}),
    Command.NAV_TAKEOFF: frozenset({"param1", "param2", "param3"}),
    Command.NAV_LAND: frozenset({"param1", "param2", "param3"}),
}
_READ_BACK: Mapping[int, Mapping[str, ReadBack]] = {
    Command.NAV_LOITER_UNLIM: {"param1": _NOTHING, "param2": _NOTHING},
    Command.NAV_LOITER_TIME: {"param2": _FLAG, "param4": _FLAG},
    Command.NAV_LOITER_TO_ALT: {"param1": _FLAG, "param3": _NOTHING, "param4": _FLAG},
    Command.DO_SET_ROI_LOCATION: NO_PARAMETERS,
    Command.NAV_RALLY_POINT: NO_PARAMETERS,
    **FENCE_READ_BACK,
}
_DIALECT = Dialect(
    standard_frames=True,
    zero_is_here=False,
    land_start_placed=False,
    yaw_in_waypoints=True,
    roi_modes=frozenset({0, 3}),
    substitutes={
        Command.NAV_SPLINE_WAYPOINT: STRAIGHT,
    },
    instead={
        Command.NAV_LOITER_TURNS: "use NAV_LOITER_TIME, or waypoints around the circle",
        m.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT: "use NAV_LOITER_TO_ALT",
        m.MAV_CMD_NAV_PAYLOAD_PLACE: "use NAV_LAND and DO_GRIPPER",
        Command.CONDITION_YAW: "give the heading, in degrees from north, as param4 of the next waypoint",
        m.MAV_CMD_DO_SET_SERVO: "use DO_SET_ACTUATOR",
        m.MAV_CMD_DO_FENCE_ENABLE: "set the parameter GF_ACTION to switch the fence",
        m.MAV_CMD_JUMP_TAG: "use DO_JUMP with the number of an item",
        m.MAV_CMD_DO_JUMP_TAG: "use DO_JUMP with the number of an item",
    },
    ignored=(
        IgnoredField(
            Command.NAV_WAYPOINT,
            "param3",
            "PX4 does not pass waypoints at a distance (param3): it flies through or near the point",
            severity=Severity.NOTE,
        ),
        IgnoredField(
            Command.NAV_LAND,
            "param1",
            "PX4 ignores the height at which to abort the landing (param1)",
            severity=Severity.NOTE,
        ),
    ),
    conditions=(
        ArmingCondition(
            "MIS_TKO_LAND_REQ",
            frozenset({2.0, 3.0}),
            2.0,
            "PX4 refuses a fixed-wing mission without a landing while MIS_TKO_LAND_REQ is {value:g}",
            "end the mission with DO_LAND_START and NAV_LAND, or set MIS_TKO_LAND_REQ to 0",
            Severity.ERROR,
            needed=_LANDINGS,
        ),
        ArmingCondition(
            "MIS_TKO_LAND_REQ",
            frozenset({1.0, 3.0}),
            2.0,
            "PX4 refuses a fixed-wing mission without a take-off while MIS_TKO_LAND_REQ is {value:g}",
            "begin the mission with NAV_TAKEOFF, or set MIS_TKO_LAND_REQ to 0",
            Severity.ERROR,
            needed=_TAKEOFFS,
        ),
    ),
)
_ANY: Questions = {
    Meaning.ACCEPTANCE_RADIUS: {"NAV_ACC_RAD": 1.0},
    Meaning.RETURN_HEIGHT: {"RTL_RETURN_ALT": 1.0},
    Meaning.LOW_BATTERY: {"COM_LOW_BAT_ACT": 1.0},
    Meaning.LINK_LOST: {"NAV_DLL_ACT": 1.0},
    Meaning.TAKEOFF_AND_LANDING: {"MIS_TKO_LAND_REQ": 1.0},
    Meaning.FENCE_ACTION: {"GF_ACTION": 1.0},
    Meaning.FENCE_CEILING: {"GF_MAX_VER_DIST": 1.0},
    Meaning.FENCE_RADIUS: {"GF_MAX_HOR_DIST": 1.0},
    Meaning.ACCELEROMETER: {"CAL_ACC0_ID": 1.0},
    Meaning.GYROSCOPE: {"CAL_GYRO0_ID": 1.0},
    Meaning.COMPASS: {"CAL_MAG0_ID": 1.0},
}
_COPTER: Questions = {
    Meaning.CRUISE_SPEED: {"MPC_XY_CRUISE": 1.0},
    Meaning.FASTEST: {"MPC_XY_VEL_MAX": 1.0},
    **_ANY,
}
_WING: Questions = {
    Meaning.CRUISE_SPEED: {"FW_AIRSPD_TRIM": 1.0},
    Meaning.FASTEST: {"FW_AIRSPD_MAX": 1.0},
    **_ANY,
}
# These parameters determine how long climbs, return and landing take.
_MOTION: Motion = {
    name: {name: 1.0}
    for name in (
        *("MPC_XY_CRUISE", "NAV_ACC_RAD", "MIS_TAKEOFF_ALT", "MPC_TKO_SPEED"),
        *("MPC_Z_V_AUTO_UP", "MPC_Z_V_AUTO_DN", "MPC_Z_VEL_MAX_UP", "MPC_Z_VEL_MAX_DN"),
        *("RTL_RETURN_ALT", "RTL_CONE_ANG", "RTL_MIN_DIST", "RTL_DESCEND_ALT", "RTL_LAND_DELAY"),
        *("MPC_LAND_SPEED", "MPC_LAND_ALT1", "MPC_LAND_ALT2", "MPC_LAND_ALT3", "MPC_LAND_CRWL"),
        *("LNDMC_TRIG_TIME", "COM_DISARM_LAND"),
    )
}
_HOLD = "LOITER"


def _numbers(_vehicle_type: int) -> Mapping[str, tuple[float, float, float]]:
    from pymavlink import mavutil  # Late import: mavutil loads a dialect that transfers do not need

    table = mavutil.px4_map.items()
    return {name: (float(base), float(main), float(sub)) for name, (base, main, sub) in table}


def _ends(_vehicle_type: int, last_command: int) -> frozenset[str]:
    """Return the modes after a mission: RTL if the last command is a return, otherwise hold."""
    return frozenset({"RTL" if last_command == Command.NAV_RETURN_TO_LAUNCH else _HOLD})


_MODES = FlightModes(
    _numbers,
    mission=frozenset({"MISSION", "TAKEOFF"}),
    # The mode resumes at the current item; the command MISSION_START would restart at the first item.
    resume="MISSION",
    hold={None: _HOLD},
    # Without a radio control, PX4 refuses to arm in manual modes.
    arming={None: _HOLD},
    ends=_ends,
    aliases={"HOLD": _HOLD},
    in_pymavlink=True,
)

PX4 = Profile(
    "PX4",
    m.MAV_AUTOPILOT_PX4,
    float_answers=True,
    frames=frozenset({0, 2, 3, 5, 6}),
    int_frames=True,
    range_checked=False,
    space_text=None,
    item_text="IGN MISSION_ITEM: Invalid item",
    placed=_PLACED,
    unplaced=_UNPLACED,
    capacity=(MAX_ITEMS - 1, MAX_ITEMS, MAX_ITEMS),
    partial_result=None,
    checks_stored_mission=True,
    empty_hold_s=5.0,
    text_prefix="WPM: ",
    usual_limits=(500, 64, 32),
    lossy=_LOSSY,
    read_back=_READ_BACK,
    keeps_autocontinue=frozenset({MissionType.MISSION}),
    dialect=_DIALECT,
    modes=_MODES,
    settings=VehicleSettings(
        {FIXED_WING: _WING, ROVER: _ANY, None: _COPTER},
        {FIXED_WING: {}, ROVER: {}, None: _MOTION},
        fence_off=frozenset({0.0}),
        fence_tells=frozenset({1.0}),
    ),
    bytewise=True,
    start_arms=True,
    item_command=False,
    radius_in_space=True,
)
