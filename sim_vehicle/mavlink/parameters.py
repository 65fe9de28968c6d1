"""The parameters of the vehicle: what peers may read and change, and what that does.

The few names that ground software reads or sets are here, in each autopilot's own spelling and unit; each
acts on the vehicle through `Tuning`.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import Message
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import autopilot_of

HASH = "_HASH_CHECK"
"""What a peer asks a PX4 for to learn whether it knows all parameters already."""
_NO_INDEX = 65535
_MAV_TYPES = {"fixed-wing": m.MAV_TYPE_FIXED_WING, "rover": m.MAV_TYPE_GROUND_ROVER}

__all__ = ["Parameter", "ParameterSet", "Tuning", "parameter_table"]


@dataclass(slots=True)
class Tuning:
    """What can be changed on a vehicle after it was built; SI units.

    Parameters
    ----------
    cruise_speed_m_s, acceptance_radius_m, takeoff_altitude_m, return_altitude_m, landing_speed_m_s : float
        As in `sim_vehicle.airframe.spec.VehicleSpec`.
    disarm_delay_s : float
        Time from touch-down to disarming.
    low_fraction, critical_fraction : float
        Battery levels of the two failsafes.
    low_battery_action, critical_battery_action : int
        The autopilot's own values (`sim_vehicle.pilot.failsafe_rules`); the second is used by ArduPilot only.
    emergency_fraction : float
        Level of the last battery failsafe.
    low_voltage_v, critical_voltage_v, low_voltage_timer_s : float
        Voltages of the whole pack that are low and critical after that time; 0 is none. Of ArduPilot only.
    low_voltage_source : int
        0 for the voltage as it is, 1 for it without the sag of the load.
    fence_enable, fence_action, fence_type : int
        The autopilot's own values; ``fence_type`` as FENCE_TYPE: 1 ceiling, 2 radius, 4 areas.
    fence_ceiling_m, fence_radius_m : float
        Height above and distance from home; 0 is no limit.
    link_action : int
        The autopilot's own value; 0 is none.
    link_timeout_s : float
        Silence of the ground station after which it is lost.
    setpoint_timeout_s : float
        Age at which setpoints hold no more.
    settings : dict of str to float
        The autopilot's parameters that move the vehicle and are not at their defaults, in their own units.
    """

    cruise_speed_m_s: float
    acceptance_radius_m: float
    takeoff_altitude_m: float
    return_altitude_m: float
    landing_speed_m_s: float
    disarm_delay_s: float
    low_fraction: float
    critical_fraction: float
    low_battery_action: int = 1
    critical_battery_action: int = 1
    emergency_fraction: float = 0.05
    low_voltage_v: float = 0.0
    critical_voltage_v: float = 0.0
    low_voltage_timer_s: float = 10.0
    low_voltage_source: int = 0
    fence_enable: int = 1
    fence_action: int = 2
    fence_type: int = 7
    fence_ceiling_m: float = 0.0
    fence_radius_m: float = 0.0
    link_action: int = 0
    link_timeout_s: float = 10.0
    setpoint_timeout_s: float = 1.0
    settings: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, spec: VehicleSpec) -> Tuning:
        """Return the values of a vehicle as built."""
        battery = spec.battery
        return cls(
            spec.cruise_speed_m_s,
            spec.acceptance_radius_m,
            spec.takeoff_altitude_m,
            spec.return_altitude_m,
            spec.landing_speed_m_s,
            spec.disarm_delay_s,
            battery.reserve_fraction if battery else 0.0,
            battery.critical_fraction if battery else 0.0,
            # ArduCopter's default, which is meant for three cells and refuses to arm with fewer.
            low_voltage_v=10.5 if spec.kind == "multirotor" and battery and battery.cells > 2 else 0.0,
            settings=dict(spec.parameters),
        )


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter.

    Parameters
    ----------
    name : str
        At most 16 characters.
    field : str or None
        The field of `Tuning` that it is; None for a constant.
    integer : bool
        INT32 rather than REAL32.
    scale : float
        The parameter's value per SI value (100 for centimetres).
    low, high : float
        Allowed values, in the parameter's unit.
    value : float
        Of a constant; the default of a setting.
    setting : bool
        Whether it is one of `Tuning.settings`.
    """

    name: str
    field: str | None = None
    integer: bool = False
    scale: float = 1.0
    low: float = -math.inf
    high: float = math.inf
    value: float = 0.0
    setting: bool = False

    @property
    def kind(self) -> int:
        """MAV_PARAM_TYPE."""
        return int(m.MAV_PARAM_TYPE_INT32 if self.integer else m.MAV_PARAM_TYPE_REAL32)


def parameter_table(autopilot: str, spec: VehicleSpec, system_id: int) -> tuple[Parameter, ...]:
    """Return the parameters of a vehicle as one autopilot names them, sorted by name."""
    make = {"px4": _px4_table, "ardupilot": _ardupilot_table}[autopilot]
    # Imported here: the tables of the safety functions are made of these parameters.
    from sim_vehicle.mavlink.safety_parameters import safety_parameters
    from sim_vehicle.mavlink.vehicle_types import foreign_parameter

    table = {p.name: p for p in make(spec, system_id) + safety_parameters(autopilot, spec)}
    table = {name: p for name, p in table.items() if not foreign_parameter(spec, name)}
    if spec.autopilot == autopilot:
        for name, known in autopilot_of(spec).parameters.items():
            table[name] = Parameter(
                name,
                integer=known.integer,
                low=known.low,
                high=known.high,
                value=known.default,
                setting=True,
            )
    return tuple(table[name] for name in sorted(table))


def _px4_table(spec: VehicleSpec, system_id: int) -> list[Parameter]:
    return [
        Parameter("BAT1_N_CELLS", integer=True, value=spec.battery.cells if spec.battery else 0),
        Parameter("BAT_CRIT_THR", "critical_fraction", low=0.0, high=0.5),
        Parameter("BAT_LOW_THR", "low_fraction", low=0.0, high=0.9),
        Parameter("COM_DISARM_LAND", "disarm_delay_s", low=0.0, high=600.0),
        Parameter("COM_LOW_BAT_ACT", "low_battery_action", integer=True, low=0, high=3),
        Parameter("CAL_ACC0_ID", integer=True, value=1310988),
        Parameter("CAL_GYRO0_ID", integer=True, value=1310988),
        Parameter("CAL_MAG0_ID", integer=True, value=197388),
        Parameter("COM_RC_IN_MODE", integer=True, value=1),
        Parameter("MAV_COMP_ID", integer=True, value=1),
        Parameter("MAV_SYS_ID", integer=True, value=system_id),
        Parameter("MAV_TYPE", integer=True, value=_MAV_TYPES.get(spec.kind, m.MAV_TYPE_QUADROTOR)),
        Parameter("MIS_TAKEOFF_ALT", "takeoff_altitude_m", low=0.5, high=spec.max_altitude_m),
        Parameter("MPC_ACC_HOR", value=spec.acceleration_m_s2),
        Parameter("MPC_JERK_AUTO", value=spec.jerk_m_s3),
        Parameter("MPC_LAND_SPEED", "landing_speed_m_s", low=0.1, high=spec.descent_speed_m_s),
        Parameter("MPC_XY_CRUISE", "cruise_speed_m_s", low=0.1, high=spec.top_speed_m_s),
        Parameter("MPC_XY_VEL_MAX", value=spec.speed_limit_m_s),
        Parameter("MPC_Z_VEL_MAX_DN", value=spec.descent_speed_m_s),
        Parameter("MPC_Z_VEL_MAX_UP", value=spec.climb_speed_m_s),
        Parameter("NAV_ACC_RAD", "acceptance_radius_m", low=0.05, high=200.0),
        Parameter("RTL_RETURN_ALT", "return_altitude_m", low=0.5, high=spec.max_altitude_m),
        Parameter("SYS_AUTOSTART", integer=True, value=4001),
    ]


def _ardupilot_table(spec: VehicleSpec, system_id: int) -> list[Parameter]:
    ceiling_cm = 100.0 * spec.max_altitude_m
    return [
        Parameter("DISARM_DELAY", "disarm_delay_s", integer=True, low=0, high=127),
        Parameter("FENCE_TOTAL", integer=True),
        Parameter("FRAME_CLASS", integer=True, value=1),
        Parameter("FRAME_TYPE", integer=True, value=1),
        Parameter("LAND_SPEED", "landing_speed_m_s", True, 100.0, 10, 100.0 * spec.descent_speed_m_s),
        Parameter("MIS_TOTAL", integer=True),
        Parameter("PILOT_TKOFF_ALT", "takeoff_altitude_m", False, 100.0, 50.0, ceiling_cm),
        Parameter("RALLY_TOTAL", integer=True),
        Parameter("RTL_ALT", "return_altitude_m", True, 100.0, 50, ceiling_cm),
        Parameter("SYSID_THISMAV", integer=True, value=system_id),
        Parameter("WPNAV_ACCEL", value=100.0 * spec.acceleration_m_s2),
        Parameter("WPNAV_RADIUS", "acceptance_radius_m", False, 100.0, 5.0, 20_000.0),
        Parameter("WPNAV_SPEED", "cruise_speed_m_s", False, 100.0, 10.0, 100.0 * spec.top_speed_m_s),
        Parameter("WPNAV_SPEED_DN", value=100.0 * spec.descent_speed_m_s),
        Parameter("WPNAV_SPEED_UP", value=100.0 * spec.climb_speed_m_s),
    ]


class ParameterSet:
    """The vehicle's side of the parameter protocol.

    Parameters
    ----------
    table : tuple of Parameter
    tuning : Tuning
        What the parameters act on.
    encoding : {"bytewise", "cast"}
        How integers travel in the float field.
    changed : callable
        Called after a parameter took a new value.
    refused : callable
        Called with a reason when a value was not taken.
    live : mapping of str to callable, optional
        Constants that are counted anew each time.
    """

    def __init__(
        self,
        table: tuple[Parameter, ...],
        tuning: Tuning,
        encoding: Literal["bytewise", "cast"],
        changed: Callable[[], None],
        refused: Callable[[str], None],
        live: Mapping[str, Callable[[], float]] | None = None,
    ) -> None:
        self._live = dict(live or {})
        self._table = table
        self._index = {parameter.name: i for i, parameter in enumerate(table)}
        self._tuning = tuning
        self._bytewise = encoding == "bytewise"
        self._changed = changed
        self._refused = refused

    def value(self, name: str) -> float:
        """Return the value of a parameter in its own unit; KeyError when there is none."""
        parameter = self._table[self._index[name]]
        if name in self._live:
            return float(self._live[name]())
        if parameter.setting:
            return self._tuning.settings.get(name, parameter.value)
        if parameter.field is None:
            return parameter.value
        value = float(getattr(self._tuning, parameter.field)) * parameter.scale
        return float(round(value)) if parameter.integer else value

    def handle(self, message: Message) -> list[Message]:
        """Answer PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET."""
        if type(message).id == m.MAVLINK_MSG_ID_PARAM_REQUEST_LIST:
            return [self._message(i) for i in range(len(self._table))]
        if type(message).id == m.MAVLINK_MSG_ID_PARAM_REQUEST_READ and message.param_index >= 0:
            index: int | None = message.param_index if message.param_index < len(self._table) else None
        else:
            index = self._index.get(str(message.param_id))
            if index is None and self._bytewise and str(message.param_id) == HASH:
                return [self._hash()]
        if index is None:
            return []
        if type(message).id == m.MAVLINK_MSG_ID_PARAM_SET:
            self._set(self._table[index], message)
        return [self._message(index)]

    def _hash(self) -> Message:
        """Return the checksum of all names and values, as PX4 does; it answers an attempt to set it, too."""
        checksum = 0
        for parameter in self._table:
            value = self.value(parameter.name)
            raw = struct.pack("<i", round(value)) if parameter.integer else struct.pack("<f", value)
            checksum = zlib.crc32(parameter.name.encode() + raw, checksum)
        value = struct.unpack("<f", struct.pack("<I", checksum))[0]
        return m.MAVLink_param_value_message(
            HASH.encode(), value, int(m.MAV_PARAM_TYPE_UINT32), len(self._table), _NO_INDEX
        )

    def _set(self, parameter: Parameter, message: Message) -> None:
        value = self._decode(message.param_value, message.param_type)
        if parameter.field is None and not parameter.setting:
            self._refused(f"{parameter.name} cannot be changed")
        elif not parameter.low <= value <= parameter.high:
            self._refused(f"{parameter.name} must be {parameter.low:g} to {parameter.high:g}")
        elif parameter.field is None:
            self._tuning.settings[parameter.name] = value
            self._changed()
        else:
            stored = value / parameter.scale
            if isinstance(getattr(self._tuning, parameter.field), int):
                stored = round(stored)
            setattr(self._tuning, parameter.field, stored)
            self._changed()

    def _decode(self, value: float, kind: int) -> float:
        if self._bytewise and kind != m.MAV_PARAM_TYPE_REAL32:
            return float(struct.unpack("<i", struct.pack("<f", value))[0])
        return value

    def _message(self, index: int) -> Message:
        parameter = self._table[index]
        value = self.value(parameter.name)
        if parameter.integer and self._bytewise:
            value = struct.unpack("<f", struct.pack("<i", round(value)))[0]
        return m.MAVLink_param_value_message(
            parameter.name.encode(), value, parameter.kind, len(self._table), index
        )
