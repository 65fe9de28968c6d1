"""Parameters of the vehicle in the parameter protocol.

The table holds all parameters of the autopilot, with the autopilot's names and units. Parameters with an
effect act on the vehicle through `RuntimeParameters`; the others are only stored.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeAlias

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from sim_vehicle.autopilot.parameters import MavParameter
from sim_vehicle.component import NEVER

if TYPE_CHECKING:
    from sim_vehicle.pilot.pilot import Pilot

ParameterMessage: TypeAlias = (
    m.MAVLink_param_request_list_message | m.MAVLink_param_request_read_message | m.MAVLink_param_set_message
)
HASH = "_HASH_CHECK"
"""Pseudo-parameter with the checksum of all parameters; PX4 clients compare it with their cached values."""
_NO_INDEX = 65535
# A list is sent in batches over about a second, because the whole list would overflow a socket's buffer.
_BATCH = 25
_BATCH_S = 0.02


class ParameterSet:
    """Vehicle side of the parameter protocol; ``live`` parameters are read-only, computed at each read."""

    def __init__(
        self, pilot: Pilot, table: tuple[MavParameter, ...], live: Mapping[str, Callable[[], float]]
    ) -> None:
        self._pilot = pilot
        self._live = live
        self._table = table
        self._index = {parameter.name: i for i, parameter in enumerate(table)}
        self._values = pilot.parameters
        self._bytewise = pilot.firmware.profile.bytewise
        self._beyond: dict[str, tuple[float, float]] = {}
        self._next = len(table)
        self.due_s = NEVER
        self._defaults = {p.name: self.value(p.name) for p in table if p.field is not None}

    @property
    def table(self) -> tuple[MavParameter, ...]:
        """All parameters, in the order of their indices."""
        return self._table

    def default(self, name: str) -> float:
        """Return the initial value of a parameter in its own unit; raises KeyError if the name is unknown."""
        return self._defaults.get(name, self._table[self._index[name]].value)

    def poll(self, now_s: float) -> list[Message]:
        """Return the next batch of a requested list, if it is due."""
        if now_s < self.due_s:
            return []
        end = min(self._next + _BATCH, len(self._table))
        messages = [self._message(i) for i in range(self._next, end)]
        self._next = end
        self.due_s = now_s + _BATCH_S if end < len(self._table) else NEVER
        return [*messages, self._hash()] if self._bytewise and self.due_s == NEVER else messages

    def value(self, name: str) -> float:
        """Return the value of a parameter in its own unit; raises KeyError if the name is unknown."""
        parameter = self._table[self._index[name]]
        if name in self._live:
            return float(self._live[name]())
        if name in self._beyond and self._beyond[name][1] == self._held(parameter):
            return self._beyond[name][0]
        if parameter.field is None:
            return self._held(parameter)
        value = self._held(parameter) * parameter.scale
        return float(round(value)) if parameter.integer else value

    def _held(self, parameter: MavParameter) -> float:
        """Return the value in force, in SI units if the parameter is a field of `RuntimeParameters`."""
        if parameter.field is not None:
            return float(getattr(self._values, parameter.field))
        return self._values.kept(parameter.name, parameter.value)

    def handle(self, message: ParameterMessage, now_s: float) -> list[Message]:
        """Answer PARAM_REQUEST_READ, PARAM_SET and PARAM_REQUEST_LIST; `poll` sends the rest of the list."""
        if is_a(message, m.MAVLink_param_request_list_message):
            self._next, self.due_s = 0, now_s
            return self.poll(now_s)
        if is_a(message, m.MAVLink_param_request_read_message) and message.param_index >= 0:
            index: int | None = message.param_index if message.param_index < len(self._table) else None
        else:
            index = self._index.get(str(message.param_id))
            if index is None and self._bytewise and str(message.param_id) == HASH:
                if is_a(message, m.MAVLink_param_request_read_message):
                    return [self._hash()]
                self.due_s = NEVER  # A client that has all values stops the list.
        if index is None:
            return self._error(message, m.MAV_PARAM_ERROR_DOES_NOT_EXIST)
        if is_a(message, m.MAVLink_param_set_message):
            if self._bytewise and message.param_type != self._table[index].mav_type:
                return []  # PX4 ignores a value of another type.
            if not self._bytewise and not math.isfinite(message.param_value):
                return self._error(message, m.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE)
            self._set(self._table[index], self._decode(message.param_value, self._table[index]))
        return [self._message(index)]

    def _error(
        self, message: m.MAVLink_param_request_read_message | m.MAVLink_param_set_message, error: int
    ) -> list[Message]:
        """Return ArduPilot's PARAM_ERROR to the sender; PX4 sends none."""
        name, index = str(message.param_id).encode(), getattr(message, "param_index", -1)
        source = (message.get_srcSystem(), message.get_srcComponent())
        return [] if self._bytewise else [m.MAVLink_param_error_message(*source, name, index, error)]

    def _hash(self) -> Message:
        """Return PX4's checksum of all names and values, which also ends the list."""
        checksum = 0
        for parameter in self._table:
            value = self.value(parameter.name)
            raw = struct.pack("<i", round(value)) if parameter.integer else struct.pack("<f", value)
            checksum = zlib.crc32(parameter.name.encode() + raw, checksum)
        value = struct.unpack("<f", struct.pack("<I", checksum))[0]
        return m.MAVLink_param_value_message(
            HASH.encode(), value, int(m.MAV_PARAM_TYPE_UINT32), len(self._table), _NO_INDEX
        )

    def change(self, name: str, value: float) -> None:
        """Set a parameter as PARAM_SET does; ignore an unknown name."""
        index = self._index.get(name)
        if index is not None:
            self._set(self._table[index], value)

    def _set(self, parameter: MavParameter, value: float) -> None:
        name = parameter.name
        if parameter.integer and math.isfinite(value):
            value = float(math.trunc(value + math.copysign(0.01, value)))  # as AP_Param::set_float
        if name in self._live or (parameter.field is None and not (parameter.motion or parameter.stored)):
            self._pilot.warn(f"{name} cannot be changed")
        elif not math.isfinite(value):
            self._pilot.warn(f"{name} must be a number")
        elif parameter.stored:
            self._store(parameter, value)
        elif self._is_choice(parameter) and not parameter.low <= value <= parameter.high:
            self._pilot.warn(f"{name} must be {parameter.low:g} to {parameter.high:g}")
        else:
            self._take(parameter, value)

    def _is_choice(self, parameter: MavParameter) -> bool:
        """Whether the values are distinct choices, which must not be clipped to the range."""
        if parameter.field is None:
            return parameter.integer
        return isinstance(getattr(self._values, parameter.field), int)

    def _store(self, parameter: MavParameter, value: float) -> None:
        if parameter.integer:
            limit = 2 ** (parameter.bits - 1)
            if not -limit <= value < limit:
                self._pilot.warn(f"{parameter.name} must be {-limit} to {limit - 1}")
                return
        self._values.stored[parameter.name] = value

    def _take(self, parameter: MavParameter, value: float) -> None:
        """Apply a value. A value out of range is stored as given, but the nearest valid value is used."""
        holds = min(max(value, parameter.low), parameter.high)
        if parameter.field is None:
            self._values.settings[parameter.name] = holds
        else:
            stored = holds / parameter.scale
            if isinstance(getattr(self._values, parameter.field), int):
                stored = round(stored)
            setattr(self._values, parameter.field, stored)
        self._beyond.pop(parameter.name, None)
        if holds != value:
            self._beyond[parameter.name] = (value, self._held(parameter))
            self._pilot.warn(f"{parameter.name} {value:g} is stored, but {holds:g} is used")
        self._pilot.apply_parameters()

    def _decode(self, value: float, parameter: MavParameter) -> float:
        if self._bytewise and parameter.integer:
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
