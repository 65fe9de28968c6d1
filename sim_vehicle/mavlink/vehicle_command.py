"""Received commands (COMMAND_LONG and COMMAND_INT) in a common form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import CommandMessage, is_a
from mission.model import MissionItem

__all__ = ["Result", "VehicleCommand", "command_of", "read_command"]

_INT_FRAMES = {5: 0, 6: 3, 11: 10}

Result: TypeAlias = "int | tuple[Message, ...] | None"
"""Result of a command: MAV_RESULT, or the messages after an accepting acknowledgement; None accepts, too."""


@dataclass(frozen=True, slots=True)
class VehicleCommand:
    """Received COMMAND_LONG or COMMAND_INT."""

    id: int
    """MAV_CMD."""
    params: tuple[float, ...]
    """Parameters 1 to 7; latitude and longitude of a position are in degrees."""
    frame: int
    """MAV_FRAME without INT variants; GLOBAL for COMMAND_LONG."""
    source: tuple[int, int]
    again: bool = False
    """Whether this is a retry of a command that had no answer."""
    long: bool = False
    """Whether the message was a COMMAND_LONG, with positions in 32-bit floats."""

    def number(self, index: int, default: int = 0) -> int:
        """Return parameter `index` (from 1) as an integer, or `default` if the parameter is not finite."""
        value = self.params[index - 1]
        return int(value) if math.isfinite(value) else default

    def is_same(self, other: VehicleCommand) -> bool:
        """Whether both commands have the same id and parameters."""
        return self.id == other.id and repr(self.params) == repr(other.params)

    @property
    def position(self) -> tuple[float, float] | None:
        """Latitude and longitude; None if the command has no position."""
        latitude, longitude = self.params[4:6]
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0) or latitude == longitude == 0.0:
            return None
        return latitude, longitude


def read_command(message: CommandMessage) -> VehicleCommand:
    """Convert COMMAND_LONG or COMMAND_INT to a VehicleCommand."""
    source = (message.get_srcSystem(), message.get_srcComponent())
    first = (message.param1, message.param2, message.param3, message.param4)
    if is_a(message, m.MAVLink_command_long_message):
        params = (*first, message.param5, message.param6, message.param7)
        return VehicleCommand(message.command, params, 0, source, message.confirmation > 0, long=True)
    frame = _INT_FRAMES.get(message.frame, message.frame)
    scale = 1e-7 if frame in (0, 3, 10) else 1.0
    params = (*first, message.x * scale, message.y * scale, message.z)
    return VehicleCommand(message.command, params, frame, source)


def command_of(item: MissionItem, source: tuple[int, int]) -> VehicleCommand:
    """Convert a mission item to a VehicleCommand in a standard frame; a missing parameter is NaN."""
    item = item.in_standard_frame()
    first = (item.param1, item.param2, item.param3, item.param4)
    params = (*(math.nan if value is None else value for value in first), item.x, item.y, item.z)
    return VehicleCommand(item.command, params, item.frame, source)
