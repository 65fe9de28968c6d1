"""The form in which an autopilot takes mission items, and the values that it keeps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum, StrEnum

from mission.link.codec.dialect import mavlink
from mission.model import Command, MissionItem

FIXED_WING = int(mavlink.MAV_TYPE_FIXED_WING)
ROVER = int(mavlink.MAV_TYPE_GROUND_ROVER)
COPTERS = (2, 3, 4, 13, 14, 15, 29, 35)
"""MAV_TYPEs: quadrotor, coaxial, helicopter, hexa-, octo-, tri-, dodecarotor, decarotor."""


class Severity(StrEnum):
    """Severity of a remark."""

    ERROR = "error"
    """The autopilot would refuse the plan, or would not fly it."""
    WARNING = "warning"
    """Something is ignored or sent in another way, which the flight shows."""
    NOTE = "note"
    """Something is ignored that hardly matters."""


class ReadBack(Enum):
    """The value that a number of an item has when it is read back."""

    NOTHING = "nothing"
    """0."""
    WHOLE = "whole"
    """Without its fraction."""
    SIGN = "sign"
    """-1 for less than zero, otherwise 1."""
    FLAG = "flag"
    """1 for more than zero, otherwise 0."""

    def of(self, value: float | None) -> float:
        """Return the number read back for a number sent; None is unset.

        >>> ReadBack.WHOLE.of(-2.7), ReadBack.SIGN.of(0.0), ReadBack.FLAG.of(None)
        (-2.0, 1.0, 0.0)
        """
        number = value or 0.0
        match self:
            case ReadBack.NOTHING:
                return 0.0
            case ReadBack.WHOLE:
                return float(int(number))
            case ReadBack.SIGN:
                return -1.0 if number < 0.0 else 1.0
            case ReadBack.FLAG:
                return float(number > 0.0)


@dataclass(frozen=True, slots=True)
class Substitute:
    """Replacement of a command that an autopilot does not know."""

    make: Callable[[MissionItem], MissionItem | None]
    """Returns the item to send; None leaves it out."""
    text: str
    """The replacement in words, for the operator."""


@dataclass(frozen=True, slots=True)
class IgnoredField:
    """A parameter that an autopilot does not heed."""

    command: int
    """MAV_CMD."""
    name: str
    """Field of `MissionItem`."""
    # What happens in its place, and what would be heeded.
    text: str
    fix: str = ""
    severity: Severity = Severity.WARNING
    vehicle_types: frozenset[int] | None = None
    """MAV_TYPEs to which it applies; None for any."""


@dataclass(frozen=True, slots=True)
class ArmingCondition:
    """Condition that a parameter of the vehicle sets for flying a mission."""

    parameter: str
    refusing: frozenset[float]
    """Its values that ask for it."""
    usual: float
    """Its value as the autopilot comes."""
    text: str
    fix: str
    unknown: Severity
    """Of the remark when the vehicle's value is not known and the usual one asks for it."""
    needed: frozenset[int] = frozenset()
    """Commands of which the mission needs one; empty for none."""
    barred: frozenset[int] = frozenset()
    """Commands of which the mission may have none."""
    vehicle_types: frozenset[int] = frozenset({FIXED_WING})
    """MAV_TYPEs to which it applies."""


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a plan has to be written for one autopilot."""

    standard_frames: bool = False
    """Items without a position go in frame MISSION."""
    zero_is_here: bool = True
    """Latitude and longitude 0, 0 mean where the vehicle is. Otherwise they are a place in the Atlantic."""
    land_start_placed: bool | None = None
    """DO_LAND_START has a position; False: none; None: as it is."""
    yaw_in_waypoints: bool = False
    """A heading is a parameter of the waypoint that is flown to, not of CONDITION_YAW."""
    roi_modes: frozenset[int] | None = None
    """Modes (MAV_ROI) that DO_SET_ROI with a position may have."""
    not_for: Mapping[int, frozenset[int]] = field(default_factory=dict)
    """By MAV_TYPE, commands that other vehicles of this autopilot know."""
    substitutes: Mapping[int, Substitute] = field(default_factory=dict)
    """By command."""
    instead: Mapping[int, str] = field(default_factory=dict)
    """By command without a substitute, the advice of an accepted alternative."""
    defaults: Mapping[int, Mapping[str, float]] = field(default_factory=dict)
    """By command, the value of an unset parameter that may not be NaN; 0 for all others."""
    highest_m: float = float("inf")
    """Altitudes of this magnitude or more are refused."""
    most_jumps: int | None = None
    """DO_JUMPs that every board can count; further ones may be passed over."""
    ignored: tuple[IgnoredField, ...] = ()
    conditions: tuple[ArmingCondition, ...] = ()


def _straight(item: MissionItem) -> MissionItem:
    return replace(item, command=Command.NAV_WAYPOINT, param2=0.0, param3=0.0, param4=None)


STRAIGHT = Substitute(_straight, "sent as NAV_WAYPOINT: flown in straight lines")
"""Of a spline waypoint."""

_NOTHING = ReadBack.NOTHING
FIRST_ALONE = {"param2": _NOTHING, "param3": _NOTHING, "param4": _NOTHING}
"""Read-back of an item that keeps only its first parameter."""
NO_PARAMETERS = {"param1": _NOTHING, **FIRST_ALONE}
FENCE_READ_BACK: Mapping[int, Mapping[str, ReadBack]] = {
    Command.NAV_FENCE_RETURN_POINT: NO_PARAMETERS,
    Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION: FIRST_ALONE,
    Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION: FIRST_ALONE,
    Command.NAV_FENCE_CIRCLE_INCLUSION: FIRST_ALONE,
    Command.NAV_FENCE_CIRCLE_EXCLUSION: FIRST_ALONE,
}
