"""Profile of ArduPilot.

Sources: ``MissionItemProtocol*.cpp``, ``AP_Mission.cpp`` (mavlink_int_to_mission_cmd,
mission_cmd_to_mavlink_int), ``AP_Arming_Plane.cpp``, ``mode.h`` through pymavlink, the parameter references
4.3 to 4.7 (4.7 replaced centimetres by metres: ``WPNAV_SPEED`` became ``WP_SPD``), and tests with ArduCopter
4.7 (SITL).
"""

from __future__ import annotations

from collections.abc import Mapping

from mission.autopilots.dialect import (
    COPTERS,
    FENCE_READ_BACK,
    FIRST_ALONE,
    FIXED_WING,
    NO_PARAMETERS,
    ROVER,
    STRAIGHT,
    ArmingCondition,
    Dialect,
    IgnoredField,
    ReadBack,
    Severity,
    Substitute,
)
from mission.autopilots.profile import (
    CardRoom,
    FlightModes,
    Meaning,
    Motion,
    NeededParameter,
    Profile,
    Questions,
    VehicleSettings,
)
from mission.link.codec.dialect import mavlink as m
from mission.model import Command, MissionItem, has_position

_YAW = frozenset({"param4"})
# mavlink_int_to_mission_cmd has these commands: camera commands since 4.4, DO_RETURN_PATH_START since 4.6.
_PLACED = frozenset(
    {16, 17, 18, 19, 20, 21, 22, 30, 31, 82, 83, 84, 85, 92, 93, 94, 112, 114, 115, 177, 178, 179}
    | {181, 182, 183, 184, 188, 189, 191, 193, 194, 195, 197, 201, 202, 203, 205, 206, 207, 208, 210, 211}
    | {212, 213, 215, 216, 217, 218, 222, 223, 531, 532, 534, 600, 601, 1000, 2000, 2001, 2500, 2501, 3000}
    | {42600, 42702, 42703, 5000, 5001, 5002, 5003, 5004, 5100}
)
_UNPLACED = frozenset(command for command in _PLACED if not has_position(command)) | frozenset(
    {179, 188, 189, 191, 201}
)
_NOTHING, _WHOLE, _SIGN, _FLAG = ReadBack.NOTHING, ReadBack.WHOLE, ReadBack.SIGN, ReadBack.FLAG
_LOSSY: Mapping[int, frozenset[str]] = {
    Command.NAV_WAYPOINT: frozenset({"param2", "param3", "param4"}),
    Command.NAV_TAKEOFF: frozenset({"param1", "param2", "param3", "param4", "x", "y", "frame"}),
    Command.NAV_LAND: frozenset({"param2", "param3", "param4"}),
    Command.NAV_RETURN_TO_LAUNCH: frozenset({"x", "y", "z", "param2", "param3", "param4"}),
    Command.DO_CHANGE_SPEED: frozenset({"param4"}),
    Command.DO_SET_CAM_TRIGG_DIST: frozenset({"param2", "param4"}),
    Command.DO_JUMP: frozenset({"param3", "param4"}),
}
# In a download, fence items have altitude 0 above sea level, and altitudes of rally points are whole metres.
_READ_BACK: Mapping[int, Mapping[str, ReadBack]] = {
    Command.NAV_SPLINE_WAYPOINT: {"param1": _WHOLE, **FIRST_ALONE},
    Command.NAV_LOITER_UNLIM: {**NO_PARAMETERS, "param3": _WHOLE},
    Command.NAV_LOITER_TURNS: {"param1": _WHOLE, "param2": _NOTHING, "param3": _WHOLE, "param4": _FLAG},
    Command.NAV_LOITER_TIME: {"param1": _WHOLE, "param2": _NOTHING, "param3": _SIGN, "param4": _FLAG},
    Command.NAV_LOITER_TO_ALT: {**NO_PARAMETERS, "param2": _WHOLE, "param4": _FLAG},
    Command.NAV_RETURN_TO_LAUNCH: {"param1": _NOTHING},
    Command.NAV_LAND: {"param1": _WHOLE},
    Command.CONDITION_DELAY: FIRST_ALONE,
    Command.CONDITION_DISTANCE: FIRST_ALONE,
    Command.DO_LAND_START: NO_PARAMETERS,
    Command.DO_SET_CAM_TRIGG_DIST: {"param3": _FLAG},
    Command.DO_SET_ROI_LOCATION: FIRST_ALONE,
    Command.DO_SET_ROI: FIRST_ALONE,
    Command.NAV_RALLY_POINT: {**NO_PARAMETERS, "z": _WHOLE},
    **{command: {**known, "z": _NOTHING, "frame": _NOTHING} for command, known in FENCE_READ_BACK.items()},
}


def _timed_images(item: MissionItem) -> MissionItem:
    """Return IMAGE_START_CAPTURE without end for an image interval above 0, else IMAGE_STOP_CAPTURE."""
    interval_s = (item.param1 or 0.0) / 1e3
    if interval_s <= 0.0:
        return MissionItem(Command.IMAGE_STOP_CAPTURE)
    return MissionItem(Command.IMAGE_START_CAPTURE, param2=interval_s)


_DIALECT = Dialect(
    standard_frames=True,
    land_start_placed=True,
    not_for={FIXED_WING: frozenset({int(Command.NAV_SPLINE_WAYPOINT)})},
    substitutes={
        Command.NAV_SPLINE_WAYPOINT: STRAIGHT,
        Command.DO_SET_CAM_TRIGG_INTERVAL: Substitute(
            _timed_images,
            "sent as IMAGE_START_CAPTURE or IMAGE_STOP_CAPTURE, which ArduPilot 4.4 and later know",
        ),
        m.MAV_CMD_SET_CAMERA_MODE: Substitute(
            lambda _item: None, "left out: ArduPilot takes images in any mode of the camera"
        ),
    },
    instead={
        m.MAV_CMD_DO_SET_ACTUATOR: "use DO_SET_SERVO",
        m.MAV_CMD_DO_TRIGGER_CONTROL: "use DO_SET_CAM_TRIGG_DIST",
        m.MAV_CMD_CONDITION_GATE: "use NAV_WAYPOINT",
    },
    defaults={
        Command.NAV_DELAY: {"param2": -1.0, "param3": -1.0, "param4": -1.0},
        Command.DO_CHANGE_SPEED: {"param2": -1.0, "param3": -1.0},
    },
    highest_m=83_000.0,
    most_jumps=15,
    ignored=(
        IgnoredField(
            Command.NAV_WAYPOINT,
            "param2",
            "ArduPilot does not store the acceptance radius (param2): WPNAV_RADIUS applies to all waypoints",
            severity=Severity.NOTE,
            vehicle_types=frozenset({*COPTERS, ROVER}),
        ),
        IgnoredField(
            Command.NAV_WAYPOINT,
            "param3",
            "ArduPilot does not store the distance at which to pass the waypoint (param3)",
            severity=Severity.NOTE,
            vehicle_types=frozenset({*COPTERS, ROVER}),
        ),
        IgnoredField(
            Command.NAV_WAYPOINT,
            "param4",
            "ArduPilot ignores the heading of a waypoint (param4)",
            "put CONDITION_YAW before the waypoint",
            vehicle_types=frozenset(COPTERS),
        ),
        IgnoredField(
            Command.NAV_WAYPOINT,
            "param1",
            "ArduPlane does not stay at a waypoint (param1)",
            "use NAV_LOITER_TIME",
            vehicle_types=frozenset({FIXED_WING}),
        ),
        IgnoredField(
            Command.NAV_LOITER_TIME,
            "param3",
            "ArduPlane stores only the direction of a circle, not its radius (param3): it uses WP_LOITER_RAD",
            vehicle_types=frozenset({FIXED_WING}),
        ),
    ),
    conditions=(
        ArmingCondition(
            "RTL_AUTOLAND",
            frozenset({0.0}),
            0.0,
            "ArduPlane does not arm with this item while RTL_AUTOLAND is {value:g}",
            "set RTL_AUTOLAND to 1 or 2, or remove the item",
            Severity.WARNING,
            barred=frozenset({188, 189}),
        ),
    ),
)
_ANY: Questions = {
    Meaning.LOW_BATTERY: {"BATT_FS_LOW_ACT": 1.0},
    Meaning.FENCE_ON: {"FENCE_ENABLE": 1.0},
    Meaning.FENCE_ACTION: {"FENCE_ACTION": 1.0},
    Meaning.FENCE_TYPES: {"FENCE_TYPE": 1.0},
    Meaning.FENCE_CEILING: {"FENCE_ALT_MAX": 1.0},
    Meaning.FENCE_RADIUS: {"FENCE_RADIUS": 1.0},
    Meaning.MISSION_CARD: {"BRD_SD_MISSION": 1.0},
}
_COPTER: Questions = {
    Meaning.CRUISE_SPEED: {"WP_SPD": 1.0, "WPNAV_SPEED": 0.01},
    Meaning.ACCEPTANCE_RADIUS: {"WP_RADIUS_M": 1.0, "WPNAV_RADIUS": 0.01},
    Meaning.RETURN_HEIGHT: {"RTL_ALT_M": 1.0, "RTL_ALT": 0.01},
    Meaning.LINK_LOST: {"FS_GCS_ENABLE": 1.0},
    Meaning.LINK_LOST_OPTIONS: {"FS_OPTIONS": 1.0},
    **_ANY,
}
_PLANE: Questions = {
    Meaning.CRUISE_SPEED: {"AIRSPEED_CRUISE": 1.0, "TRIM_ARSPD_CM": 0.01},
    Meaning.FASTEST: {"AIRSPEED_MAX": 1.0, "ARSPD_FBW_MAX": 1.0},
    Meaning.ACCEPTANCE_RADIUS: {"WP_RADIUS": 1.0},
    Meaning.RETURN_HEIGHT: {"RTL_ALTITUDE": 1.0, "ALT_HOLD_RTL": 0.01},
    Meaning.LANDS_AS_MISSION: {"RTL_AUTOLAND": 1.0},
    Meaning.LINK_LOST: {"FS_GCS_ENABL": 1.0, "FS_GCS_ENABLE": 1.0},
    **_ANY,
}
_ROVER: Questions = {
    Meaning.CRUISE_SPEED: {"WP_SPEED": 1.0},
    Meaning.ACCEPTANCE_RADIUS: {"WP_RADIUS": 1.0},
    Meaning.LINK_LOST: {"FS_GCS_ENABLE": 1.0},
    **_ANY,
}
# These parameters determine how long climbs, return and landing take; ArduCopter 4.7 renamed parameters.
_MOTION: Motion = {
    "WPNAV_SPEED": {"WP_SPD": 100.0, "WPNAV_SPEED": 1.0},
    "WPNAV_SPEED_UP": {"WP_SPD_UP": 100.0, "WPNAV_SPEED_UP": 1.0},
    "WPNAV_SPEED_DN": {"WP_SPD_DN": 100.0, "WPNAV_SPEED_DN": 1.0},
    "WPNAV_RADIUS": {"WP_RADIUS_M": 100.0, "WPNAV_RADIUS": 1.0},
    "RTL_ALT": {"RTL_ALT_M": 100.0, "RTL_ALT": 1.0},
    "RTL_SPEED": {"RTL_SPEED_MS": 100.0, "RTL_SPEED": 1.0},
    "RTL_CLIMB_MIN": {"RTL_CLIMB_MIN_M": 100.0, "RTL_CLIMB_MIN": 1.0},
    "RTL_CONE_SLOPE": {"RTL_CONE_SLOPE": 1.0},
    "RTL_LOIT_TIME": {"RTL_LOIT_TIME": 1.0},
    "LAND_SPEED": {"LAND_SPD_MS": 100.0, "LAND_SPEED": 1.0},
    "LAND_SPEED_HIGH": {"LAND_SPD_HIGH_MS": 100.0, "LAND_SPEED_HIGH": 1.0},
    "LAND_ALT_LOW": {"LAND_ALT_LOW_M": 100.0, "LAND_ALT_LOW": 1.0},
}
_BOAT = int(m.MAV_TYPE_SURFACE_BOAT)  # ArduRover, too.
# Copters do not hold in LOITER: with the throttle stick at its lowest position, they would descend.
_HOLD: Mapping[int | None, str] = {FIXED_WING: "LOITER", ROVER: "HOLD", _BOAT: "HOLD", None: "BRAKE"}


def _numbers(vehicle_type: int) -> Mapping[str, tuple[float, float, float]]:
    from pymavlink import mavutil  # Late import: mavutil loads a dialect that transfers do not need

    table = mavutil.mode_mapping_bynumber(vehicle_type) or {}
    return {
        mode: (float(m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(number), 0.0)
        for number, mode in table.items()
    }


def _ends(vehicle_type: int, _last_command: int) -> frozenset[str]:
    """Return the modes after a mission: ArduCopter stays in AUTO, ArduPlane returns, ArduRover holds."""
    return frozenset({"RTL", _HOLD[vehicle_type]}) if vehicle_type in _HOLD else frozenset()


_MODES = FlightModes(
    _numbers,
    mission=frozenset({"AUTO"}),
    resume="AUTO",
    hold=_HOLD,
    # ArduCopter does not arm in AUTO. Without a throttle stick it does not arm in altitude-hold modes either.
    arming={FIXED_WING: None, ROVER: None, None: "GUIDED"},
    ends=_ends,
    in_pymavlink=True,
)

ARDUPILOT = Profile(
    "ArduPilot",
    m.MAV_AUTOPILOT_ARDUPILOTMEGA,
    home_at_zero=True,
    atomic=False,
    request_int=False,
    float_answers=True,
    stateless_download=True,
    restart_on_count=True,
    repeats_ack=False,
    answers_unheard=True,
    re_request_s=1.0,
    abort_s=8.0,
    abort_result=m.MAV_MISSION_OPERATION_CANCELLED,
    busy_result=m.MAV_MISSION_DENIED,
    order_result=m.MAV_MISSION_INVALID_SEQUENCE,
    range_result=m.MAV_MISSION_INVALID_SEQUENCE,
    clear_all_types=False,
    frames=frozenset({0, 3, 5, 6, 10, 11}),
    strict_frames=False,
    keeps_frame=False,
    nan_parameters={
        Command.NAV_WAYPOINT: _YAW,
        Command.NAV_LAND: _YAW,
        Command.NAV_TAKEOFF: _YAW,
    },
    checks_jumps=True,
    marks_current=False,
    opaque_ids=False,
    # StorageManager.cpp: 9758 bytes for the mission (15 per item), 560 for the fence (8 per item).
    # Rally points have 690 bytes on copters (15 per point); planes and rovers store 50 points.
    capacity=(649, 70, 50),
    card=CardRoom("BRD_SD_MISSION", 64, 1312),
    fence_card=CardRoom("BRD_SD_FENCE", 64, 84, item_bytes=8, header_bytes=0),
    type_result=m.MAV_MISSION_UNSUPPORTED,
    partial_write=True,
    received_texts=("Flight plan received", "Fence received", "Rally points received"),
    timeout_text="Mission upload timeout",
    usual_limits=(649, 70, 46),
    placed=_PLACED,
    unplaced=_UNPLACED,
    lossy=_LOSSY,
    read_back=_READ_BACK,
    whole_seconds=True,
    keeps_autocontinue=frozenset(),
    dialect=_DIALECT,
    keeps_default=False,
    streams_on_request=True,
    change_modes={
        **dict.fromkeys(COPTERS, (4, 3)),
        FIXED_WING: (15, 10),
        ROVER: (15, 10),
    },
    # With these parameters, a vehicle that loses its ground station continues a mission; else it returns.
    change_failsafe=dict.fromkeys(
        COPTERS,
        (
            # FS_GCS_ENABLE comes last: the option to continue missions must be set before the failsafe.
            NeededParameter("FS_OPTIONS", bits=2),
            NeededParameter("FS_GCS_TIMEOUT", least=90),
            NeededParameter("FS_GCS_ENABLE", good=frozenset({1, 2, 3, 6}), value=1),
        ),
    ),
    modes=_MODES,
    # On old ArduCopters, FS_GCS_ENABLE = 2 lets a mission continue.
    settings=VehicleSettings(
        {FIXED_WING: _PLANE, ROVER: _ROVER, None: _COPTER},
        {FIXED_WING: {}, ROVER: {}, None: _MOTION},
        link_goes_on=frozenset({0.0, 2.0}),
    ),
    takeoff_needs_arming=True,
    takeoff_above_sea=False,
    stays_armed=frozenset({ROVER}),
    estimator_message=m.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
)
