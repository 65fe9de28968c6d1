"""Flight modes by name, and the flight modes of an operator's maneuvers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from pymavlink import mavutil

from geo.errors import WbfMissionError
from geo.texts import unknown
from mission.autopilots import profile_for
from mission.autopilots.profile import FlightModes
from mission.link.codec.dialect import mavlink as m
from mission.model import Command


class ModeError(WbfMissionError, ValueError):
    """The vehicle does not have this flight mode."""


class Maneuver(Enum):
    """Maneuver that an operator may order in flight."""

    HOLD = "hold"
    RETURN = "return"
    LAND = "land"
    RESUME = "resume"


@dataclass(frozen=True, slots=True)
class VehicleModes:
    """Flight modes of the vehicles of one autopilot (MAV_AUTOPILOT) and MAV_TYPE."""

    autopilot: int
    vehicle_type: int

    @property
    def _known(self) -> FlightModes:
        return profile_for(self.autopilot).modes

    def numbers(self, name: str) -> tuple[float, float, float]:
        """Return the parameters of DO_SET_MODE for a mode; for an unknown name, ModeError lists all modes.

        >>> VehicleModes(3, 2).numbers("rtl"), VehicleModes(12, 2).numbers("MISSION")
        ((1.0, 6.0, 0.0), (29.0, 4.0, 4.0))
        """
        known = dict(self._known.numbers(self.vehicle_type))
        known |= {alias: known[of] for alias, of in self._known.aliases.items()}
        wanted = name.strip().upper()
        if wanted not in known:
            raise ModeError(f"this vehicle: {unknown('mode', name, sorted(known))}")
        return known[wanted]

    def told_name(self, name: str) -> str:
        """Return the name under which a HEARTBEAT shows a mode, from the mode's name or alias.

        >>> VehicleModes(12, 2).told_name("hold"), VehicleModes(3, 2).told_name("guided")
        ('LOITER', 'GUIDED')
        """
        wanted = name.strip().upper()
        return self._known.aliases.get(wanted, wanted)

    @property
    def arming(self) -> str | None:
        """Mode for arming without a radio control, or None if any mode will do."""
        return self._known.arming.get(self.vehicle_type, self._known.arming[None])

    def maneuver(self, kind: Maneuver) -> tuple[int, tuple[float, ...]]:
        """Return the MAV_CMD of a maneuver and its first parameters.

        >>> VehicleModes(3, 2).maneuver(Maneuver.HOLD), VehicleModes(12, 2).maneuver(Maneuver.RETURN)
        ((176, (1.0, 17.0, 0.0)), (20, ()))
        >>> VehicleModes(12, 2).maneuver(Maneuver.RESUME)
        (176, (29.0, 4.0, 4.0))
        """
        if kind is Maneuver.RETURN:
            return int(Command.NAV_RETURN_TO_LAUNCH), ()
        if kind is Maneuver.LAND:
            return int(Command.NAV_LAND), ()
        resumes = kind is Maneuver.RESUME
        mode = self._known.resume if resumes else self._known.hold_of(self.vehicle_type)
        if not mode:
            return int(m.MAV_CMD_DO_PAUSE_CONTINUE), (float(resumes),)
        return int(m.MAV_CMD_DO_SET_MODE), self.numbers(mode)

    def shows(self, kind: Maneuver) -> frozenset[str]:
        """Return the modes that confirm a maneuver; empty if the modes are unknown."""
        hold = self._known.hold_of(self.vehicle_type)
        shown = {
            Maneuver.HOLD: {hold},
            Maneuver.RETURN: {"RTL", "SMART_RTL"},
            Maneuver.LAND: {"LAND"},
            Maneuver.RESUME: self._known.mission,
        }
        return frozenset(shown[kind]) if hold else frozenset()

    def ends(self, last_command: int) -> frozenset[str]:
        """Return the modes in which a mission with this last command may end, besides the mission modes.

        >>> [sorted(VehicleModes(12, 2).ends(command)) for command in (20, 16)], VehicleModes(3, 2).ends(20)
        ([['RTL'], ['LOITER']], frozenset())
        """
        return self._known.ends(self.vehicle_type, last_command)


def mode_name(beat: m.MAVLink_heartbeat_message) -> str:
    """Return the flight mode name of a HEARTBEAT.

    >>> mode_name(m.MAVLink_heartbeat_message(2, 3, 81, 6, 4, 3))
    'RTL'
    """
    modes = profile_for(beat.autopilot).modes
    return (
        str(mavutil.mode_string_v10(beat)) if modes.in_pymavlink else modes.name(beat.custom_mode, beat.type)
    )


def is_in_mission(beat: m.MAVLink_heartbeat_message) -> bool:
    """Whether a HEARTBEAT shows the mission mode.

    >>> [is_in_mission(m.MAVLink_heartbeat_message(2, 3, 81, mode, 4, 3)) for mode in (3, 5)]
    [True, False]
    """
    mission = profile_for(beat.autopilot).modes.mission
    return mode_name(beat) in mission if mission else bool(beat.base_mode & m.MAV_MODE_FLAG_AUTO_ENABLED)
