"""The parameters of the vehicle: what peers may read and change, and what that does.

The few names that ground software reads or sets are here, in each autopilot's own spelling and unit; each
acts on the vehicle through `RuntimeParameters`.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping
from typing import Literal, TypeAlias

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from sim_vehicle.autopilot.mav_parameter import MavParameter
from sim_vehicle.autopilot.runtime_parameters import RuntimeParameters

ParameterMessage: TypeAlias = (
    m.MAVLink_param_request_list_message | m.MAVLink_param_request_read_message | m.MAVLink_param_set_message
)
HASH = "_HASH_CHECK"
"""Pseudo-parameter with the checksum of all parameters; a peer of PX4 reads it to reuse its cached values."""
_NO_INDEX = 65535

__all__ = ["ParameterSet"]


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
        if parameter.motion:
            return self._values.settings.get(name, parameter.value)
        if parameter.field is None:
            return parameter.value
        value = float(getattr(self._values, parameter.field)) * parameter.scale
        return float(round(value)) if parameter.integer else value

    def handle(self, message: ParameterMessage) -> list[Message]:
        """Answer PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET."""
        if is_a(message, m.MAVLink_param_request_list_message):
            return [self._message(i) for i in range(len(self._table))]
        if is_a(message, m.MAVLink_param_request_read_message) and message.param_index >= 0:
            index: int | None = message.param_index if message.param_index < len(self._table) else None
        else:
            index = self._index.get(str(message.param_id))
            if index is None and self._bytewise and str(message.param_id) == HASH:
                return [self._hash()]
        if index is None:
            return []
        if is_a(message, m.MAVLink_param_set_message):
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

    def _set(self, parameter: MavParameter, message: m.MAVLink_param_set_message) -> None:
        value = self._decode(message.param_value, message.param_type)
        if parameter.field is None and not parameter.motion:
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
            parameter.name.encode(), value, parameter.mav_type, len(self._table), index
        )
