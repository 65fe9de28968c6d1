"""In which form autopilots take mission items, as data for `mission.transfer.rendering`.

Sources: PX4 ``mavlink_mission.cpp`` (parse_mavlink_mission_item, format_mavlink_mission_item) and
``rc.fw_defaults``, ArduPilot ``AP_Mission.cpp`` and ``AP_Arming_Plane.cpp``, and what PX4 1.17 (SIH) and
ArduCopter 4.7 (SITL) were seen to do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from mission.link.codec.dialect import mavlink
from mission.model import Command, MissionItem
from mission.transfer.remark import Severity

__all__ = ["ARDUPILOT_DIALECT", "PX4_DIALECT", "ArmingCondition", "Dialect", "IgnoredField", "Substitute"]

FIXED_WING = int(mavlink.MAV_TYPE_FIXED_WING)
ROVER = int(mavlink.MAV_TYPE_GROUND_ROVER)
COPTERS = (2, 3, 4, 13, 14, 15, 29, 35)
"""MAV_TYPEs: quadrotor, coaxial, helicopter, hexa-, octo-, tri-, dodecarotor, decarotor."""
_LANDINGS = frozenset({21, 85})
_TAKEOFFS = frozenset({22, 84})


@dataclass(frozen=True, slots=True)
class Substitute:
    """What is sent in place of a command that an autopilot does not know.

    Parameters
    ----------
    make : callable
        Returns the item to send; None leaves it out.
    text : str
        What is done, for the operator.
    """

    make: Callable[[MissionItem], MissionItem | None]
    text: str


@dataclass(frozen=True, slots=True)
class IgnoredField:
    """A parameter that an autopilot does not heed.

    Parameters
    ----------
    command : int
        MAV_CMD.
    name : str
        Field of `MissionItem`.
    text, fix : str
        What happens in its place, and what would be heeded.
    severity : Severity
    vehicle_types : frozenset of int or None
        MAV_TYPEs to which it applies; None for any.
    """

    command: int
    name: str
    text: str
    fix: str = ""
    severity: Severity = Severity.WARNING
    vehicle_types: frozenset[int] | None = None


@dataclass(frozen=True, slots=True)
class ArmingCondition:
    """What a parameter of the vehicle asks of a mission before the vehicle flies it.

    Parameters
    ----------
    parameter : str
    refusing : frozenset of float
        Its values that ask for it.
    usual : float
        Its value as the autopilot comes.
    text, fix : str
    unknown : Severity
        Of the remark when the vehicle's value is not known and the usual one asks for it.
    needed : frozenset of int
        Commands of which the mission needs one; empty for none.
    barred : frozenset of int
        Commands of which the mission may have none.
    vehicle_types : frozenset of int
        MAV_TYPEs to which it applies.
    """

    parameter: str
    refusing: frozenset[float]
    usual: float
    text: str
    fix: str
    unknown: Severity
    needed: frozenset[int] = frozenset()
    barred: frozenset[int] = frozenset()
    vehicle_types: frozenset[int] = frozenset({FIXED_WING})


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a plan has to be written for one autopilot.

    Parameters
    ----------
    standard_frames : bool
        Items without a position go in frame MISSION.
    zero_is_here : bool
        Latitude and longitude 0, 0 mean where the vehicle is. Otherwise they are a place in the Atlantic.
    land_start_placed : bool or None
        DO_LAND_START has a position; False: none; None: as it is.
    yaw_in_waypoints : bool
        A heading is a parameter of the waypoint that is flown to, not of CONDITION_YAW.
    roi_modes : frozenset of int or None
        Modes (MAV_ROI) that DO_SET_ROI with a position may have.
    not_for : mapping of int to frozenset of int
        By MAV_TYPE, commands that other vehicles of this autopilot know.
    substitutes : mapping of int to Substitute
        By command.
    instead : mapping of int to str
        By command, what would be accepted in place of one that has no substitute.
    defaults : mapping of int to mapping of str to float
        By command, what is sent for an unset parameter that may not be NaN; 0 for all others.
    highest_m : float
        Altitudes at least so far from zero are refused.
    most_jumps : int or None
        DO_JUMPs that every board can count; further ones may be passed over.
    ignored : tuple of IgnoredField
    conditions : tuple of ArmingCondition
    """

    standard_frames: bool = False
    zero_is_here: bool = True
    land_start_placed: bool | None = None
    yaw_in_waypoints: bool = False
    roi_modes: frozenset[int] | None = None
    not_for: Mapping[int, frozenset[int]] = field(default_factory=dict)
    substitutes: Mapping[int, Substitute] = field(default_factory=dict)
    instead: Mapping[int, str] = field(default_factory=dict)
    defaults: Mapping[int, Mapping[str, float]] = field(default_factory=dict)
    highest_m: float = float("inf")
    most_jumps: int | None = None
    ignored: tuple[IgnoredField, ...] = ()
    conditions: tuple[ArmingCondition, ...] = ()


def _straight(item: MissionItem) -> MissionItem:
    return replace(item, command=Command.NAV_WAYPOINT, param2=0.0, param3=0.0, param4=None)


def _timed_images(item: MissionItem) -> MissionItem:
    """Return an interval in milliseconds as a series of images that never ends, 0 as the end of one."""
    interval_s = (item.param1 or 0.0) / 1e3
    if interval_s <= 0.0:
        return MissionItem(Command.IMAGE_STOP_CAPTURE)
    return MissionItem(Command.IMAGE_START_CAPTURE, param2=interval_s)


def _left_out(_item: MissionItem) -> None:
    return None


PX4_DIALECT = Dialect(
    standard_frames=True,
    zero_is_here=False,
    land_start_placed=False,
    yaw_in_waypoints=True,
    roi_modes=frozenset({0, 3}),
    substitutes={
        Command.NAV_SPLINE_WAYPOINT: Substitute(_straight, "sent as NAV_WAYPOINT: flown in straight lines"),
    },
    instead={
        Command.NAV_LOITER_TURNS: "use NAV_LOITER_TIME, or waypoints around the circle",
        mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT: "use NAV_LOITER_TO_ALT",
        mavlink.MAV_CMD_NAV_PAYLOAD_PLACE: "use NAV_LAND and DO_GRIPPER",
        Command.CONDITION_YAW: "give the heading, in degrees from north, as param4 of the waypoint after it",
        mavlink.MAV_CMD_DO_SET_SERVO: "use DO_SET_ACTUATOR",
        mavlink.MAV_CMD_DO_FENCE_ENABLE: "switch the fence by the parameter GF_ACTION",
        mavlink.MAV_CMD_JUMP_TAG: "use DO_JUMP with the number of an item",
        mavlink.MAV_CMD_DO_JUMP_TAG: "use DO_JUMP with the number of an item",
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
            "PX4 does not heed the height to abort the landing at (param1)",
            severity=Severity.NOTE,
        ),
    ),
    conditions=(
        ArmingCondition(
            "MIS_TKO_LAND_REQ",
            frozenset({2.0, 3.0}),
            2.0,
            "a fixed wing of PX4 flies no mission without a landing while MIS_TKO_LAND_REQ is {value:g}",
            "end it with DO_LAND_START and NAV_LAND, or set MIS_TKO_LAND_REQ to 0",
            Severity.ERROR,
            needed=_LANDINGS,
        ),
        ArmingCondition(
            "MIS_TKO_LAND_REQ",
            frozenset({1.0, 3.0}),
            2.0,
            "a fixed wing of PX4 flies no mission without a take-off while MIS_TKO_LAND_REQ is {value:g}",
            "begin it with NAV_TAKEOFF, or set MIS_TKO_LAND_REQ to 0",
            Severity.ERROR,
            needed=_TAKEOFFS,
        ),
    ),
)

ARDUPILOT_DIALECT = Dialect(
    standard_frames=True,
    land_start_placed=True,
    not_for={FIXED_WING: frozenset({int(Command.NAV_SPLINE_WAYPOINT)})},
    substitutes={
        Command.NAV_SPLINE_WAYPOINT: Substitute(_straight, "sent as NAV_WAYPOINT: flown in straight lines"),
        Command.DO_SET_CAM_TRIGG_INTERVAL: Substitute(
            _timed_images,
            "sent as IMAGE_START_CAPTURE or IMAGE_STOP_CAPTURE, which ArduPilot 4.4 and later know",
        ),
        mavlink.MAV_CMD_SET_CAMERA_MODE: Substitute(
            _left_out, "left out: ArduPilot takes images in any mode of the camera"
        ),
    },
    instead={
        mavlink.MAV_CMD_DO_SET_ACTUATOR: "use DO_SET_SERVO",
        mavlink.MAV_CMD_DO_TRIGGER_CONTROL: "use DO_SET_CAM_TRIGG_DIST",
        mavlink.MAV_CMD_CONDITION_GATE: "use NAV_WAYPOINT",
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
            "ArduPilot does not store the acceptance radius (param2): it has one for all (WPNAV_RADIUS)",
            severity=Severity.NOTE,
            vehicle_types=frozenset({*COPTERS, ROVER}),
        ),
        IgnoredField(
            Command.NAV_WAYPOINT,
            "param3",
            "ArduPilot does not store at which distance to pass (param3)",
            severity=Severity.NOTE,
            vehicle_types=frozenset({*COPTERS, ROVER}),
        ),
        IgnoredField(
            Command.NAV_WAYPOINT,
            "param4",
            "ArduPilot does not heed a waypoint's heading (param4)",
            "put CONDITION_YAW before it",
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
            "ArduPlane stores the side of this circle, not its radius (param3): it is WP_LOITER_RAD",
            vehicle_types=frozenset({FIXED_WING}),
        ),
    ),
    conditions=(
        ArmingCondition(
            "RTL_AUTOLAND",
            frozenset({0.0}),
            0.0,
            "ArduPlane does not arm with this item while RTL_AUTOLAND is {value:g}",
            "set RTL_AUTOLAND to 1 or 2, or leave the item out",
            Severity.WARNING,
            barred=frozenset({188, 189}),
        ),
    ),
)
