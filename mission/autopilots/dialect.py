"""Data types for the mission items that an autopilot accepts and the values that it stores."""

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
    """The autopilot would refuse the plan, or would not fly the plan."""
    WARNING = "warning"
    """A value is ignored or replaced, with an effect on the flight."""
    NOTE = "note"
    """A value is ignored, with almost no effect."""


class ReadBack(Enum):
    """Change of a value between upload and download."""

    NOTHING = "nothing"
    """Replaced by 0."""
    WHOLE = "whole"
    """Truncated to an integer."""
    SIGN = "sign"
    """-1 for a negative value, otherwise 1."""
    FLAG = "flag"
    """1 for a positive value, otherwise 0."""

    def of(self, value: float | None) -> float:
        """Return the value read back for a sent value (None if unset).

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
    """Replacement of a command that an autopilot does not support."""

    make: Callable[[MissionItem], MissionItem | None]
    """Function that returns the item to send, or None to omit the item."""
    text: str
    """Description of the replacement for the operator."""


@dataclass(frozen=True, slots=True)
class IgnoredField:
    """Item parameter that an autopilot ignores."""

    command: int
    """MAV_CMD."""
    name: str
    """Field of `MissionItem`."""
    text: str
    """Consequence of the ignored parameter, as the operator reads it."""
    fix: str = ""
    """Advice to the operator."""
    severity: Severity = Severity.WARNING
    vehicle_types: frozenset[int] | None = None
    """MAV_TYPEs that ignore the parameter, or None for any."""


@dataclass(frozen=True, slots=True)
class ArmingCondition:
    """Condition that a parameter imposes on the mission; a vehicle whose mission violates it does not arm."""

    parameter: str
    refusing: frozenset[float]
    """Parameter values that impose the condition."""
    usual: float
    """Factory default of the parameter."""
    text: str
    fix: str
    unknown: Severity
    """Severity of the remark if the parameter's value is unknown, and its default imposes the condition."""
    needed: frozenset[int] = frozenset()
    """The mission must contain at least one of these commands; if empty, no command is required."""
    barred: frozenset[int] = frozenset()
    """Commands that the mission must not contain."""
    vehicle_types: frozenset[int] = frozenset({FIXED_WING})
    """MAV_TYPEs with this condition."""


@dataclass(frozen=True, slots=True)
class Dialect:
    """Rules for converting a plan for one autopilot (`mission.transfer.rendering`)."""

    standard_frames: bool = False
    """Whether items without a position are sent in frame MISSION."""
    zero_is_here: bool = True
    """Whether latitude and longitude 0, 0 mean the current position, not a point in the Atlantic."""
    land_start_placed: bool | None = None
    """Whether DO_LAND_START needs a position (True) or must have none (False); None accepts either."""
    yaw_in_waypoints: bool = False
    """Whether waypoints have the heading as a parameter, and CONDITION_YAW is not supported."""
    roi_modes: frozenset[int] | None = None
    """Modes (MAV_ROI) accepted for DO_SET_ROI with a position, or None for any."""
    not_for: Mapping[int, frozenset[int]] = field(default_factory=dict)
    """Commands that vehicles of one MAV_TYPE do not support, although other vehicles of the autopilot do."""
    substitutes: Mapping[int, Substitute] = field(default_factory=dict)
    """Replacements of unsupported commands, by command."""
    instead: Mapping[int, str] = field(default_factory=dict)
    """Advice for unsupported commands without a replacement, by command."""
    defaults: Mapping[int, Mapping[str, float]] = field(default_factory=dict)
    """Values to send for unset parameters that must not be NaN, by command; a missing entry means 0."""
    highest_m: float = float("inf")
    """Altitude limit (m); altitudes of this magnitude or more are refused."""
    most_jumps: int | None = None
    """Number of DO_JUMP items whose repetitions every board can count; boards may skip further jumps."""
    ignored: tuple[IgnoredField, ...] = ()
    conditions: tuple[ArmingCondition, ...] = ()


def _straight(item: MissionItem) -> MissionItem:
    return replace(item, command=Command.NAV_WAYPOINT, param2=0.0, param3=0.0, param4=None)


STRAIGHT = Substitute(_straight, "sent as NAV_WAYPOINT: flown in straight lines")
"""Replacement of a spline waypoint."""

_NOTHING = ReadBack.NOTHING
FIRST_ALONE = {"param2": _NOTHING, "param3": _NOTHING, "param4": _NOTHING}
"""Changes of an item that keeps only its first parameter."""
NO_PARAMETERS = {"param1": _NOTHING, **FIRST_ALONE}
FENCE_READ_BACK: Mapping[int, Mapping[str, ReadBack]] = {
    Command.NAV_FENCE_RETURN_POINT: NO_PARAMETERS,
    Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION: FIRST_ALONE,
    Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION: FIRST_ALONE,
    Command.NAV_FENCE_CIRCLE_INCLUSION: FIRST_ALONE,
    Command.NAV_FENCE_CIRCLE_EXCLUSION: FIRST_ALONE,
}
