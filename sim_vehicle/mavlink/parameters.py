"""The parameters of the vehicle, as peers read and change them.

All names of the autopilot are here, in its own spelling and unit. Those that do something act on the vehicle
through `RuntimeParameters`; the others are kept.
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
"""Pseudo-parameter with the checksum of all parameters; a peer of PX4 reads it to reuse its cached values."""
_NO_INDEX = 65535
# A whole list at once would overflow a socket's buffer; so it takes about a second.
_BATCH = 25
_BATCH_S = 0.02

__all__ = ["ParameterSet"]


class ParameterSet:
    """The side of the vehicle in the parameter protocol; ``live`` are constants, counted anew each time."""

    def __init__(
        self, pilot: Pilot, table: tuple[MavParameter, ...], live: Mapping[str, Callable[[], float]]
    ) -> None:
        self._pilot = pilot
        self._live = live
        self._table = table
        self._index = {parameter.name: i for i, parameter in enumerate(table)}
        self._values = pilot.parameters
        self._bytewise = pilot.firmware.mavlink.parameter_encoding == "bytewise"
        self._beyond: dict[str, tuple[float, float]] = {}
        self._next = len(table)
        self.due_s = NEVER
        self._defaults = {p.name: self.value(p.name) for p in table if p.field is not None}

    @property
    def table(self) -> tuple[MavParameter, ...]:
        """All parameters, in the order of their indices."""
        return self._table

    def default(self, name: str) -> float:
        """Return the first value of a parameter, in its own unit; KeyError when there is none."""
        return self._defaults.get(name, self._table[self._index[name]].value)

    def poll(self, now_s: float) -> list[Message]:
        """Return the part of a list that was asked for and is due now."""
        if now_s < self.due_s:
            return []
        end = min(self._next + _BATCH, len(self._table))
        messages = [self._message(i) for i in range(self._next, end)]
        self._next = end
        self.due_s = now_s + _BATCH_S if end < len(self._table) else NEVER
        return messages

    def value(self, name: str) -> float:
        """Return the value of a parameter in its own unit; KeyError when there is none."""
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
        """Return the value that the vehicle uses: in SI units where it is one of its own values."""
        if parameter.field is not None:
            return float(getattr(self._values, parameter.field))
        return self._values.kept(parameter.name, parameter.value)

    def handle(self, message: ParameterMessage, now_s: float) -> list[Message]:
        """Answer PARAM_REQUEST_LIST, of which the rest follows in time, PARAM_REQUEST_READ and PARAM_SET."""
        if is_a(message, m.MAVLink_param_request_list_message):
            self._next, self.due_s = 0, now_s
            return self.poll(now_s)
        if is_a(message, m.MAVLink_param_request_read_message) and message.param_index >= 0:
            index: int | None = message.param_index if message.param_index < len(self._table) else None
        else:
            index = self._index.get(str(message.param_id))
            if index is None and self._bytewise and str(message.param_id) == HASH:
                return [self._hash()]
        if index is None:
            return []
        if is_a(message, m.MAVLink_param_set_message):
            self._set(self._table[index], self._decode(message.param_value, message.param_type))
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

    def change(self, name: str, value: float) -> None:
        """Set a parameter as PARAM_SET does; nothing happens when there is none of this name."""
        index = self._index.get(name)
        if index is not None:
            self._set(self._table[index], value)

    def _set(self, parameter: MavParameter, value: float) -> None:
        name = parameter.name
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
        """Whether its values are choices, without neighbours."""
        if parameter.field is None:
            return parameter.integer
        return isinstance(getattr(self._values, parameter.field), int)

    def _store(self, parameter: MavParameter, value: float) -> None:
        if parameter.integer:
            limit = 2 ** (parameter.bits - 1)
            value = float(round(value))
            if not -limit <= value < limit:
                self._pilot.warn(f"{parameter.name} must be {-limit} to {limit - 1}")
                return
        self._values.stored[parameter.name] = value

    def _take(self, parameter: MavParameter, value: float) -> None:
        """Let a value hold; beyond the range it is kept as it was given, and the nearest in it holds."""
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
            self._pilot.warn(f"{parameter.name} {value:g} is kept, {holds:g} holds")
        self._pilot.apply_parameters()

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
