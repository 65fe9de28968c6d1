"""What differs between aeroplanes, rovers and copters for their peers: type, modes, parameters.

Sources of the custom modes: ArduPlane ``mode.h`` and Rover ``mode.h``. PX4 has the same numbers for all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from mission.model import Command
from sim_vehicle.autopilot import with_autopilot
from sim_vehicle.autopilot.modes import Mode

if TYPE_CHECKING:
    from mission.transfer.profile import Profile
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.mavlink.persona import Persona

__all__ = ["as_flown", "foreign_parameter"]

_OTHERS = ("fixed-wing", "rover")
_TYPES = {"fixed-wing": int(m.MAV_TYPE_FIXED_WING), "rover": int(m.MAV_TYPE_GROUND_ROVER)}
_PLANE_MODES: Mapping[Mode, int] = MappingProxyType(
    {
        Mode.MANUAL: 0,
        Mode.ALTITUDE: 6,
        Mode.POSITION: 7,
        Mode.MISSION: 10,
        Mode.RTL: 11,
        Mode.HOLD: 12,
        Mode.TAKEOFF: 13,
        Mode.GUIDED: 15,
        Mode.LAND: 26,
    }
)
_PLANE_ALIASES = MappingProxyType(
    {1: Mode.HOLD, 2: Mode.MANUAL, 3: Mode.MANUAL, 4: Mode.MANUAL, 5: Mode.MANUAL, 8: Mode.MANUAL}
)
_ROVER_MODES: Mapping[Mode, int] = MappingProxyType(
    {
        Mode.MANUAL: 0,
        Mode.ALTITUDE: 1,
        Mode.POSITION: 3,
        Mode.HOLD: 4,
        Mode.MISSION: 10,
        Mode.RTL: 11,
        Mode.GUIDED: 15,
        Mode.TAKEOFF: 15,
        Mode.LAND: 4,
    }
)
_ROVER_ALIASES = MappingProxyType({5: Mode.HOLD, 7: Mode.MANUAL, 12: Mode.RTL})
_COPTER_PARAMETERS = (
    "FRAME_",
    "LAND_SPEED",
    "MPC_",
    "PILOT_TKOFF_ALT",
    "RTL_ALT",
    "WPNAV_",
)


def as_flown(spec: VehicleSpec, persona: Persona) -> tuple[VehicleSpec, Persona]:
    """Return the vehicle as the persona's autopilot flies it, and the persona for such a vehicle.

    Copters, whose law of motion need not be that of the persona, stay as they are.

    Examples
    --------
    >>> from sim_vehicle.airframe.spec import get_vehicle
    >>> from sim_vehicle.mavlink.persona import ARDUPILOT
    >>> spec, persona = as_flown(get_vehicle("fixed-wing"), ARDUPILOT)
    >>> spec.autopilot, persona.mav_type, persona.modes[Mode.MISSION], persona.banner
    ('ardupilot', 1, 10, 'ArduPlane V4.7.0')
    """
    if spec.kind not in _OTHERS:
        return spec, persona
    if spec.autopilot != persona.name:
        own = replace(spec, parameters=())
        spec = with_autopilot(own, "ardupilot" if persona.name == "ardupilot" else "px4")
    wing = spec.kind == "fixed-wing"
    persona = replace(persona, mav_type=_TYPES[spec.kind], takes_off=not wing)
    if persona.name != "ardupilot":
        return spec, persona
    if wing:
        persona = replace(
            persona,
            version=(4, 7, 0),
            banner="ArduPlane V4.7.0",
            profile=_keeping_radii(persona.profile),
            modes=_PLANE_MODES,
            aliases=_PLANE_ALIASES,
            after_takeoff=Mode.TAKEOFF,
        )
    else:
        persona = replace(persona, banner="ArduRover V4.6.0", modes=_ROVER_MODES, aliases=_ROVER_ALIASES)
    return spec, persona


def _keeping_radii(profile: Profile) -> Profile:
    """ArduPlane stores the acceptance and pass radii of waypoints, and the pitch of a take-off."""
    lossy = {
        **profile.lossy,
        Command.NAV_WAYPOINT: frozenset({"param4", "autocontinue"}),
        Command.NAV_TAKEOFF: frozenset({"param2", "param3", "param4"}),
    }
    return replace(profile, lossy=lossy)


def foreign_parameter(spec: VehicleSpec, name: str) -> bool:
    """Whether a parameter is one of copters, which a vehicle of another kind has not.

    Examples
    --------
    >>> from sim_vehicle.airframe.spec import get_vehicle
    >>> foreign_parameter(get_vehicle("rover"), "MPC_XY_CRUISE")
    True
    """
    if spec.kind not in _OTHERS:
        return False
    if name in ("RTL_ALTITUDE", "LAND_DISARMDELAY"):
        return False
    return name.startswith(_COPTER_PARAMETERS)
