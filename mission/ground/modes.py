"""Flight modes of autopilots by their names, and those that an operator wants in a hurry."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from pymavlink import mavutil

from geo.errors import WbfMissionError
from mission.autopilots.registry import profile_for
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
    "told_name",
]


class ModeError(WbfMissionError, ValueError):
    """A flight mode that the vehicle does not have."""


class Maneuver(Enum):
    """What an operator may want of a vehicle in flight."""

    HOLD = "hold"
    RETURN = "return"
    LAND = "land"


@dataclass(frozen=True, slots=True)
class ModeNumbers:
    """The parameters of MAV_CMD_DO_SET_MODE."""

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
    modes = profile_for(autopilot).modes
    if modes is not None and not modes.in_pymavlink:
        return modes.name(custom_mode, vehicle_type)
    beat = m.MAVLink_heartbeat_message(vehicle_type, autopilot, base_mode, custom_mode, 4, 3)
    return str(mavutil.mode_string_v10(beat))


def mode_named(autopilot: int, vehicle_type: int, name: str) -> ModeNumbers:
    """Return the numbers of a mode; ModeError, which lists the modes there are, if it has none of that name.

    Examples
    --------
    >>> mode_named(3, 2, "rtl"), mode_named(12, 2, "MISSION")
    (ModeNumbers(base=1.0, main=6.0, sub=0.0), ModeNumbers(base=29.0, main=4.0, sub=4.0))
    """
    wanted = name.strip().upper()
    modes = profile_for(autopilot).modes
    known = {} if modes is None else dict(modes.numbers(vehicle_type))
    if modes is not None:
        known |= {alias: known[of] for alias, of in modes.aliases.items()}
    if wanted not in known:
        msg = f"mode {name!r} is unknown to this vehicle; it has {', '.join(sorted(known)) or 'none by name'}"
        raise ModeError(msg)
    return ModeNumbers(*known[wanted])


def told_name(autopilot: int, name: str) -> str:
    """Return how HEARTBEAT's mode is called after a mode was asked for by a name.

    Examples
    --------
    >>> told_name(12, "hold"), told_name(3, "guided")
    ('LOITER', 'GUIDED')
    """
    wanted, modes = name.strip().upper(), profile_for(autopilot).modes
    return wanted if modes is None else modes.aliases.get(wanted, wanted)


def arming_mode_name(autopilot: int, vehicle_type: int) -> str | None:
    """Return the name of the mode in which a vehicle arms without a stick; None where it may arm in any."""
    modes = profile_for(autopilot).modes
    return None if modes is None else modes.arming.get(vehicle_type, modes.arming[None])


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
    modes = profile_for(autopilot).modes
    if modes is None:
        return int(m.MAV_CMD_DO_PAUSE_CONTINUE), (0.0,)
    mode = mode_named(autopilot, vehicle_type, modes.hold_of(vehicle_type))
    return int(m.MAV_CMD_DO_SET_MODE), (mode.base, mode.main, mode.sub)


def maneuver_modes(kind: Maneuver, autopilot: int, vehicle_type: int) -> frozenset[str]:
    """Return the names of the modes that show that a maneuver is flown; none where they are not known."""
    modes = profile_for(autopilot).modes
    if modes is None:
        return frozenset()
    if kind is Maneuver.RETURN:
        return frozenset({"RTL", "SMART_RTL"})
    if kind is Maneuver.LAND:
        return frozenset({"LAND"})
    return frozenset({modes.hold_of(vehicle_type)})


def end_modes(autopilot: int, vehicle_type: int, last_command: int) -> frozenset[str]:
    """Return the names of the modes that a mission leads to when it is over, besides its own.

    Examples
    --------
    >>> [sorted(end_modes(12, 2, command)) for command in (20, 16)], sorted(end_modes(3, 2, 20))
    ([['RTL'], ['LOITER']], [])
    """
    modes = profile_for(autopilot).modes
    return frozenset() if modes is None else modes.ends(vehicle_type, last_command)


def is_in_mission(autopilot: int, vehicle_type: int, base_mode: int, custom_mode: int) -> bool:
    """Return whether HEARTBEAT tells that a vehicle flies its mission by itself.

    Examples
    --------
    >>> is_in_mission(3, 2, 81, 3), is_in_mission(3, 2, 81, 5), is_in_mission(12, 2, 29, 4 << 16 | 2 << 24)
    (True, False, True)
    """
    modes = profile_for(autopilot).modes
    if modes is None:
        return bool(base_mode & m.MAV_MODE_FLAG_AUTO_ENABLED)
    return mode_name(autopilot, vehicle_type, base_mode, custom_mode) in modes.mission
