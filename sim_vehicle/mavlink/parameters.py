"""The parameters of the vehicle: what peers may read and change, and what that does.

The few names that ground software reads or sets are here, in each autopilot's own spelling and unit; each
acts on the vehicle through `Tuning`.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import Message
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot.mav_parameter import MavParameter

HASH = "_HASH_CHECK"
"""What a peer asks a PX4 for to learn whether it knows all parameters already."""
_NO_INDEX = 65535

__all__ = ["ParameterSet", "Tuning"]


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
        The autopilot's own values (`sim_vehicle.autopilot.failsafe_rules`); ArduPilot alone has the second.
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


class ParameterSet:
    """The vehicle's side of the parameter protocol.

    Parameters
    ----------
    table : tuple of MavParameter
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
        table: tuple[MavParameter, ...],
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
        if parameter.motion:
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

    def _set(self, parameter: MavParameter, message: Message) -> None:
        value = self._decode(message.param_value, message.param_type)
        if parameter.field is None and not parameter.motion:
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
            parameter.name.encode(), value, parameter.mav_type, len(self._table), index
        )
