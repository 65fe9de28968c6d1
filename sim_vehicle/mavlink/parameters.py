"""The parameters of the vehicle: what peers may read and change, and what that does.

The few names that ground software reads or sets are here, in each autopilot's own spelling and unit; each
acts on the vehicle through `RuntimeParameters`.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import Message
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import autopilot_of
from sim_vehicle.autopilot.runtime_parameters import RuntimeParameters

HASH = "_HASH_CHECK"
"""What a peer asks a PX4 for to learn whether it knows all parameters already."""
_NO_INDEX = 65535
_MAV_TYPES = {"fixed-wing": m.MAV_TYPE_FIXED_WING, "rover": m.MAV_TYPE_GROUND_ROVER}

__all__ = ["MavParameter", "ParameterSet", "parameter_table"]


@dataclass(frozen=True, slots=True)
class MavParameter:
    """One parameter.

    Parameters
    ----------
    name : str
        At most 16 characters.
    field : str or None
        The field of `RuntimeParameters` that it is; None for a constant.
    integer : bool
        INT32 rather than REAL32.
    scale : float
        The parameter's value per SI value (100 for centimetres).
    low, high : float
        Allowed values, in the parameter's unit.
    value : float
        Of a constant; the default of a setting.
    setting : bool
        Whether it is one of `RuntimeParameters.settings`.
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


def parameter_table(autopilot: str, spec: VehicleSpec, system_id: int) -> tuple[MavParameter, ...]:
    """Return the parameters of a vehicle as one autopilot names them, sorted by name."""
    make = {"px4": _px4_table, "ardupilot": _ardupilot_table}[autopilot]
    # Imported here: the tables of the safety functions are made of these parameters.
    from sim_vehicle.mavlink.safety_parameters import safety_parameters
    from sim_vehicle.mavlink.vehicle_types import foreign_parameter

    table = {p.name: p for p in make(spec, system_id) + safety_parameters(autopilot, spec)}
    table = {name: p for name, p in table.items() if not foreign_parameter(spec, name)}
    if spec.autopilot == autopilot:
        for name, known in autopilot_of(spec).settings.items():
            table[name] = MavParameter(
                name,
                integer=known.integer,
                low=known.low,
                high=known.high,
                value=known.default,
                setting=True,
            )
    return tuple(table[name] for name in sorted(table))


def _px4_table(spec: VehicleSpec, system_id: int) -> list[MavParameter]:
    return [
        MavParameter("BAT1_N_CELLS", integer=True, value=spec.battery.cells if spec.battery else 0),
        MavParameter("BAT_CRIT_THR", "critical_fraction", low=0.0, high=0.5),
        MavParameter("BAT_LOW_THR", "low_fraction", low=0.0, high=0.9),
        MavParameter("COM_DISARM_LAND", "disarm_delay_s", low=0.0, high=600.0),
        MavParameter("COM_LOW_BAT_ACT", "low_battery_action", integer=True, low=0, high=3),
        MavParameter("CAL_ACC0_ID", integer=True, value=1310988),
        MavParameter("CAL_GYRO0_ID", integer=True, value=1310988),
        MavParameter("CAL_MAG0_ID", integer=True, value=197388),
        MavParameter("COM_RC_IN_MODE", integer=True, value=1),
        MavParameter("MAV_COMP_ID", integer=True, value=1),
        MavParameter("MAV_SYS_ID", integer=True, value=system_id),
        MavParameter("MAV_TYPE", integer=True, value=_MAV_TYPES.get(spec.kind, m.MAV_TYPE_QUADROTOR)),
        MavParameter("MIS_TAKEOFF_ALT", "takeoff_altitude_m", low=0.5, high=spec.max_altitude_m),
        MavParameter("MPC_ACC_HOR", value=spec.acceleration_m_s2),
        MavParameter("MPC_JERK_AUTO", value=spec.jerk_m_s3),
        MavParameter("MPC_LAND_SPEED", "landing_speed_m_s", low=0.1, high=spec.descent_speed_m_s),
        MavParameter("MPC_XY_CRUISE", "cruise_speed_m_s", low=0.1, high=spec.top_speed_m_s),
        MavParameter("MPC_XY_VEL_MAX", value=spec.speed_limit_m_s),
        MavParameter("MPC_Z_VEL_MAX_DN", value=spec.descent_speed_m_s),
        MavParameter("MPC_Z_VEL_MAX_UP", value=spec.climb_speed_m_s),
        MavParameter("NAV_ACC_RAD", "acceptance_radius_m", low=0.05, high=200.0),
        MavParameter("RTL_RETURN_ALT", "return_altitude_m", low=0.5, high=spec.max_altitude_m),
        MavParameter("SYS_AUTOSTART", integer=True, value=4001),
    ]


def _ardupilot_table(spec: VehicleSpec, system_id: int) -> list[MavParameter]:
    ceiling_cm = 100.0 * spec.max_altitude_m
    return [
        MavParameter("DISARM_DELAY", "disarm_delay_s", integer=True, low=0, high=127),
        MavParameter("FENCE_TOTAL", integer=True),
        MavParameter("FRAME_CLASS", integer=True, value=1),
        MavParameter("FRAME_TYPE", integer=True, value=1),
        MavParameter("LAND_SPEED", "landing_speed_m_s", True, 100.0, 10, 100.0 * spec.descent_speed_m_s),
        MavParameter("MIS_TOTAL", integer=True),
        MavParameter("PILOT_TKOFF_ALT", "takeoff_altitude_m", False, 100.0, 50.0, ceiling_cm),
        MavParameter("RALLY_TOTAL", integer=True),
        MavParameter("RTL_ALT", "return_altitude_m", True, 100.0, 50, ceiling_cm),
        MavParameter("SYSID_THISMAV", integer=True, value=system_id),
        MavParameter("WPNAV_ACCEL", value=100.0 * spec.acceleration_m_s2),
        MavParameter("WPNAV_RADIUS", "acceptance_radius_m", False, 100.0, 5.0, 20_000.0),
        MavParameter("WPNAV_SPEED", "cruise_speed_m_s", False, 100.0, 10.0, 100.0 * spec.top_speed_m_s),
        MavParameter("WPNAV_SPEED_DN", value=100.0 * spec.descent_speed_m_s),
        MavParameter("WPNAV_SPEED_UP", value=100.0 * spec.climb_speed_m_s),
    ]


class ParameterSet:
    """The vehicle's side of the parameter protocol.

    Parameters
    ----------
    table : tuple of MavParameter
    values : RuntimeParameters
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
        table: tuple[MavParameter, ...],
        values: RuntimeParameters,
        encoding: Literal["bytewise", "cast"],
        changed: Callable[[], None],
        refused: Callable[[str], None],
        live: Mapping[str, Callable[[], float]] | None = None,
    ) -> None:
        self._live = dict(live or {})
        self._table = table
        self._index = {parameter.name: i for i, parameter in enumerate(table)}
        self._values = values
        self._bytewise = encoding == "bytewise"
        self._changed = changed
        self._refused = refused

    def value(self, name: str) -> float:
        """Return the value of a parameter in its own unit; KeyError when there is none."""
        parameter = self._table[self._index[name]]
        if name in self._live:
            return float(self._live[name]())
        if parameter.setting:
            return self._values.settings.get(name, parameter.value)
        if parameter.field is None:
            return parameter.value
        value = float(getattr(self._values, parameter.field)) * parameter.scale
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

    def _set(self, parameter: MavParameter, message: Message) -> None:
        value = self._decode(message.param_value, message.param_type)
        if parameter.field is None and not parameter.setting:
            self._refused(f"{parameter.name} cannot be changed")
        elif not parameter.low <= value <= parameter.high:
            self._refused(f"{parameter.name} must be {parameter.low:g} to {parameter.high:g}")
        elif parameter.field is None:
            self._values.settings[parameter.name] = value
            self._changed()
        else:
            stored = value / parameter.scale
            if isinstance(getattr(self._values, parameter.field), int):
                stored = round(stored)
            setattr(self._values, parameter.field, stored)
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
