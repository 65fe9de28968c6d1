"""Which autopilot the vehicle plays: identity, mode numbers, capabilities, rates.

Sources: PX4 ``px4_custom_mode.h`` and the common message set; ArduCopter ``mode.h``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from mission.link.codec.dialect import mavlink as m
from mission.transfer import profile as transfer_profile
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.errors import VehicleError

__all__ = ["ARDUPILOT", "PX4", "Persona", "get_persona", "persona_names"]

_COMMON_CAPABILITIES = (
    m.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
    | m.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | m.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | m.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | m.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | m.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | m.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
)
_PX4_RATES_HZ = MappingProxyType(
    {
        m.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
        m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
        m.MAVLINK_MSG_ID_ATTITUDE: 10.0,
        m.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 5.0,
        m.MAVLINK_MSG_ID_VFR_HUD: 5.0,
        m.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0,
        m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
        m.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
        m.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
        m.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
        m.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
        m.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    }
)


@dataclass(frozen=True, slots=True)
class Persona:
    """One autopilot as its peers see it.

    Parameters
    ----------
    name : str
        Name on the command line.
    autopilot : int
        MAV_AUTOPILOT of the heartbeat.
    version : tuple of int
        Major, minor, patch that AUTOPILOT_VERSION tells.
    modes : mapping of Mode to int
        The custom mode number of each mode that the autopilot has.
    aliases : mapping of int to Mode
        Further custom modes that are accepted, flown as another mode.
    boot_mode : Mode
        Mode after the start.
    capabilities : int
        MAV_PROTOCOL_CAPABILITY bits.
    parameter_encoding : {"bytewise", "cast"}
        How integer parameters travel in a float.
    profile : mission.transfer.profile.Profile
        Habits in the mission transfer.
    split_mode : bool
        DO_SET_MODE carries main and sub mode in parameters 2 and 3 (PX4), not the custom mode in parameter 2.
    takes_off : bool
        A mission that begins on the ground needs no take-off item (PX4).
    after_takeoff : Mode
        The mode that follows an ordered take-off.
    data_streams : bool
        REQUEST_DATA_STREAM changes rates (ArduPilot); otherwise it is ignored.
    reached_repeats : int
        How often MISSION_ITEM_REACHED is sent again, once a second, after it happened.
    reached_merged : bool
        Of items that end together (a place, the commands after it, and a return that follows) only the last
        is reported.
    current_lag_s : float
        How long after an item was reached MISSION_CURRENT tells the next one.
    refused_result : int
        MAV_RESULT of a command that cannot be done now.
    unsupported : frozenset of int
        MAV_CMDs that the autopilot does not take, though the vehicle could.
    int_only : frozenset of int
        MAV_CMDs that are only taken as COMMAND_INT.
    rates_hz : mapping of int to float
        Message id to rate after the start.
    truth_message : int
        What its simulators send to tell the true state of the vehicle.
    mav_type : int
        MAV_TYPE of the heartbeat.
    banner : str
        What it says of itself when all parameters are asked for (ArduPilot); empty for nothing.
    """

    name: str
    autopilot: int
    version: tuple[int, int, int]
    modes: Mapping[Mode, int]
    aliases: Mapping[int, Mode]
    boot_mode: Mode
    capabilities: int
    parameter_encoding: Literal["bytewise", "cast"]
    profile: transfer_profile.Profile
    split_mode: bool
    takes_off: bool
    after_takeoff: Mode
    data_streams: bool
    reached_repeats: int
    rates_hz: Mapping[int, float]
    reached_merged: bool = False
    current_lag_s: float = 0.1
    refused_result: int = int(m.MAV_RESULT_TEMPORARILY_REJECTED)
    unsupported: frozenset[int] = frozenset()
    int_only: frozenset[int] = frozenset()
    truth_message: int = int(m.MAVLINK_MSG_ID_HIL_STATE_QUATERNION)
    mav_type: int = int(m.MAV_TYPE_QUADROTOR)
    banner: str = ""

    def mode_of(self, custom_mode: int) -> Mode | None:
        """Return the mode with this custom number, None if the autopilot has none or it is not flown here."""
        for mode, number in self.modes.items():
            if number == custom_mode:
                return mode
        return self.aliases.get(custom_mode)

    @property
    def flight_sw_version(self) -> int:
        """The version as AUTOPILOT_VERSION packs it, an official release (255)."""
        major, minor, patch = self.version
        return major << 24 | minor << 16 | patch << 8 | 255


def _px4(main: int, sub: int = 0) -> int:
    return sub << 24 | main << 16


PX4 = Persona(
    name="px4",
    autopilot=m.MAV_AUTOPILOT_PX4,
    version=(1, 17, 0),
    modes=MappingProxyType(
        {
            Mode.MANUAL: _px4(1),
            Mode.ALTITUDE: _px4(2),
            Mode.POSITION: _px4(3),
            Mode.TAKEOFF: _px4(4, 2),
            Mode.HOLD: _px4(4, 3),
            Mode.MISSION: _px4(4, 4),
            Mode.RTL: _px4(4, 5),
            Mode.LAND: _px4(4, 6),
            Mode.GUIDED: _px4(6),
        }
    ),
    aliases=MappingProxyType({_px4(4, 1): Mode.HOLD, _px4(7): Mode.MANUAL}),
    boot_mode=Mode.HOLD,
    capabilities=_COMMON_CAPABILITIES | m.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE,
    parameter_encoding="bytewise",
    profile=transfer_profile.PX4,
    split_mode=True,
    takes_off=True,
    after_takeoff=Mode.HOLD,
    data_streams=False,
    reached_repeats=10,
    rates_hz=_PX4_RATES_HZ,
    reached_merged=True,
    unsupported=frozenset(
        int(command)
        for command in (
            m.MAV_CMD_CONDITION_YAW,
            m.MAV_CMD_DO_FENCE_ENABLE,
            m.MAV_CMD_DO_SET_MISSION_CURRENT,
        )
    ),
)

ARDUPILOT = Persona(
    name="ardupilot",
    autopilot=m.MAV_AUTOPILOT_ARDUPILOTMEGA,
    version=(4, 6, 0),
    modes=MappingProxyType(
        {
            Mode.MANUAL: 0,
            Mode.ALTITUDE: 2,
            Mode.MISSION: 3,
            Mode.GUIDED: 4,
            Mode.TAKEOFF: 4,
            Mode.HOLD: 5,
            Mode.RTL: 6,
            Mode.LAND: 9,
            Mode.POSITION: 16,
        }
    ),
    aliases=MappingProxyType({1: Mode.MANUAL, 17: Mode.HOLD, 21: Mode.RTL, 27: Mode.RTL}),
    boot_mode=Mode.MANUAL,
    capabilities=_COMMON_CAPABILITIES | m.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST,
    parameter_encoding="cast",
    profile=transfer_profile.ARDUPILOT,
    split_mode=False,
    takes_off=False,
    after_takeoff=Mode.GUIDED,
    data_streams=True,
    reached_repeats=0,
    rates_hz=MappingProxyType({m.MAVLINK_MSG_ID_HEARTBEAT: 1.0}),
    refused_result=int(m.MAV_RESULT_FAILED),
    unsupported=frozenset({int(m.MAV_CMD_DO_ORBIT), int(m.MAV_CMD_DO_CHANGE_ALTITUDE)}),
    int_only=frozenset({int(m.MAV_CMD_DO_REPOSITION)}),
    truth_message=int(m.MAVLINK_MSG_ID_SIM_STATE),
)

_PERSONAS = {persona.name: persona for persona in (PX4, ARDUPILOT)}


def persona_names() -> tuple[str, ...]:
    """Return the names of the autopilots that can be played."""
    return tuple(_PERSONAS)


def get_persona(name: str) -> Persona:
    """Return a persona by name; VehicleError that lists the names when there is none.

    Examples
    --------
    >>> get_persona("px4").modes[Mode.MISSION]
    67371008
    """
    try:
        return _PERSONAS[name.lower()]
    except KeyError:
        msg = f"unknown autopilot {name!r}: choose {', '.join(_PERSONAS)}"
        raise VehicleError(msg) from None
