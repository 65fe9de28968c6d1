"""Flight modes of autopilots by their names, and those that an operator wants in a hurry.

Names and numbers are pymavlink's: those of PX4's ``px4_custom_mode.h`` and ArduPilot's ``mode.h``.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from pymavlink import mavutil

from geo.errors import WbfMissionError
from mission.link.codec.dialect import mavlink as m
from mission.model import Command

__all__ = [
    "Maneuver",
    "ModeError",
    "ModeNumbers",
    "arming_mode",
    "arming_mode_name",
    "end_modes",
    "is_in_mission",
    "maneuver_command",
    "maneuver_modes",
    "mode_name",
    "mode_named",
]

_CUSTOM = float(m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
_PX4_MISSION, _PX4_HOLD = ("MISSION", "TAKEOFF"), "LOITER"
_ARDUPILOT_MISSION = "AUTO"
_ARDUPILOT_HOLD = {m.MAV_TYPE_FIXED_WING: "LOITER", m.MAV_TYPE_GROUND_ROVER: "HOLD"}
# A copter in LOITER without a stick in the middle sinks.
_COPTER_HOLD = "BRAKE"


class ModeError(WbfMissionError, ValueError):
    """A flight mode that the vehicle does not have."""


class Maneuver(Enum):
    """What an operator may want of a vehicle in flight."""

    HOLD = "hold"
    RETURN = "return"
    LAND = "land"


@dataclass(frozen=True, slots=True)
class ModeNumbers:
    """The parameters of MAV_CMD_DO_SET_MODE.

    Parameters
    ----------
    base, main, sub : float
    """

    base: float
    main: float
    sub: float


def mode_name(autopilot: int, vehicle_type: int, base_mode: int, custom_mode: int) -> str:
    """Return the name of a flight mode as HEARTBEAT tells it.

    Examples
    --------
    >>> mode_name(3, 2, 81, 6), mode_name(12, 2, 29, 4 << 16 | 4 << 24)
    ('RTL', 'MISSION')
    """
    beat = m.MAVLink_heartbeat_message(vehicle_type, autopilot, base_mode, custom_mode, 4, 3)
    return str(mavutil.mode_string_v10(beat))


def mode_named(autopilot: int, vehicle_type: int, name: str) -> ModeNumbers:
    """Return the numbers of a mode.

    Raises
    ------
    ModeError
        If the autopilot has no mode of that name; the text lists those that it has.

    Examples
    --------
    >>> mode_named(3, 2, "rtl"), mode_named(12, 2, "MISSION")
    (ModeNumbers(base=1.0, main=6.0, sub=0.0), ModeNumbers(base=29.0, main=4.0, sub=4.0))
    """
    wanted = name.strip().upper()
    if autopilot == m.MAV_AUTOPILOT_PX4:
        known = {mode: ModeNumbers(*map(float, numbers)) for mode, numbers in mavutil.px4_map.items()}
        known["HOLD"] = known[_PX4_HOLD]
    else:
        table = mavutil.mode_mapping_bynumber(vehicle_type) or {}
        known = {mode: ModeNumbers(_CUSTOM, float(number), 0.0) for number, mode in table.items()}
    if wanted not in known:
        msg = f"mode {name!r} is unknown to this vehicle; it has {', '.join(sorted(known)) or 'none by name'}"
        raise ModeError(msg)
    return known[wanted]


def arming_mode_name(autopilot: int, vehicle_type: int) -> str | None:
    """Return the name of the mode in which a vehicle arms without a stick; None where it may arm in any.

    ArduCopter arms neither in AUTO nor, with the throttle down, in modes that hold the height; PX4 does not
    without a radio control in those that want sticks. QGroundControl chooses in the same way.
    """
    if autopilot == m.MAV_AUTOPILOT_PX4:
        return _PX4_HOLD
    if autopilot == m.MAV_AUTOPILOT_ARDUPILOTMEGA and vehicle_type not in _ARDUPILOT_HOLD:
        return "GUIDED"
    return None


def arming_mode(autopilot: int, vehicle_type: int) -> ModeNumbers | None:
    """Return the numbers of that mode."""
    name = arming_mode_name(autopilot, vehicle_type)
    return None if name is None else mode_named(autopilot, vehicle_type, name)


def maneuver_command(kind: Maneuver, autopilot: int, vehicle_type: int) -> tuple[int, tuple[float, ...]]:
    """Return the command of a maneuver and its first parameters.

    Examples
    --------
    >>> maneuver_command(Maneuver.HOLD, 3, 2), maneuver_command(Maneuver.RETURN, 12, 2)
    ((176, (1.0, 17.0, 0.0)), (20, ()))
    """
    if kind is Maneuver.RETURN:
        return int(Command.NAV_RETURN_TO_LAUNCH), ()
    if kind is Maneuver.LAND:
        return int(Command.NAV_LAND), ()
    if autopilot == m.MAV_AUTOPILOT_PX4:
        mode = mode_named(autopilot, vehicle_type, _PX4_HOLD)
    elif autopilot == m.MAV_AUTOPILOT_ARDUPILOTMEGA:
        mode = mode_named(autopilot, vehicle_type, _ARDUPILOT_HOLD.get(vehicle_type, _COPTER_HOLD))
    else:
        return int(m.MAV_CMD_DO_PAUSE_CONTINUE), (0.0,)
    return int(m.MAV_CMD_DO_SET_MODE), (mode.base, mode.main, mode.sub)


def maneuver_modes(kind: Maneuver, autopilot: int, vehicle_type: int) -> frozenset[str]:
    """Return the names of the modes that show that a maneuver is flown; none where they are not known."""
    if autopilot not in (m.MAV_AUTOPILOT_PX4, m.MAV_AUTOPILOT_ARDUPILOTMEGA):
        return frozenset()
    if kind is Maneuver.RETURN:
        return frozenset({"RTL", "SMART_RTL"})
    if kind is Maneuver.LAND:
        return frozenset({"LAND"})
    if autopilot == m.MAV_AUTOPILOT_PX4:
        return frozenset({_PX4_HOLD})
    return frozenset({_ARDUPILOT_HOLD.get(vehicle_type, _COPTER_HOLD)})


def end_modes(autopilot: int, vehicle_type: int, last_command: int) -> frozenset[str]:
    """Return the names of the modes that a mission leads to when it is over, besides its own.

    PX4 flies a return that ends a mission in the mode for that, and holds after another last item.
    ArduCopter stays in AUTO; ArduPlane returns and ArduRover holds.

    Examples
    --------
    >>> [sorted(end_modes(12, 2, command)) for command in (20, 16)], sorted(end_modes(3, 2, 20))
    ([['RTL'], ['LOITER']], [])
    """
    if autopilot == m.MAV_AUTOPILOT_PX4:
        returns = last_command == Command.NAV_RETURN_TO_LAUNCH
        return frozenset({"RTL"} if returns else {_PX4_HOLD})
    if autopilot == m.MAV_AUTOPILOT_ARDUPILOTMEGA and vehicle_type in _ARDUPILOT_HOLD:
        return frozenset({"RTL", _ARDUPILOT_HOLD[vehicle_type]})
    return frozenset()


def is_in_mission(autopilot: int, vehicle_type: int, base_mode: int, custom_mode: int) -> bool:
    """Return whether HEARTBEAT tells that a vehicle flies its mission by itself.

    Examples
    --------
    >>> is_in_mission(3, 2, 81, 3), is_in_mission(3, 2, 81, 5), is_in_mission(12, 2, 29, 4 << 16 | 2 << 24)
    (True, False, True)
    """
    name = mode_name(autopilot, vehicle_type, base_mode, custom_mode)
    if autopilot == m.MAV_AUTOPILOT_PX4:
        return name in _PX4_MISSION
    if autopilot == m.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return name == _ARDUPILOT_MISSION
    return bool(base_mode & m.MAV_MODE_FLAG_AUTO_ENABLED)
