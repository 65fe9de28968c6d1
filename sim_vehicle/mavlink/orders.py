"""Commands as they come over MAVLink, their answers, and what has to be there to carry them out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import CommandMessage, is_a

if TYPE_CHECKING:
    from sim_vehicle.mavlink.schedule import Schedule
    from sim_vehicle.mavlink.wire_state import WireState
    from sim_vehicle.pilot.pilot import Pilot

__all__ = ["Answer", "CommandedVehicle", "Order", "order_of"]

_INT_FRAMES = {5: 0, 6: 3, 11: 10}


@dataclass(frozen=True, slots=True)
class Order:
    """A command as it came, long or int.

    Parameters
    ----------
    command : int
        MAV_CMD.
    params : tuple of 7 floats
        Parameters 1 to 7; a position's latitude and longitude are degrees.
    frame : int
        MAV_FRAME, without the INT variants; COMMAND_LONG has GLOBAL.
    source : tuple of int
        System and component of the sender.
    again : bool
        The sender repeats a command that it had no answer to.
    long : bool
        It came as COMMAND_LONG, with positions in 32-bit floats.
    """

    command: int
    params: tuple[float, ...]
    frame: int
    source: tuple[int, int]
    again: bool
    long: bool = False

    def number(self, index: int, default: int = 0) -> int:
        """Return a parameter (from 1) as an integer; the default when it is not finite."""
        value = self.params[index - 1]
        return int(value) if math.isfinite(value) else default

    def is_same(self, other: Order) -> bool:
        """Whether it is the same command with the same parameters."""
        return self.command == other.command and repr(self.params) == repr(other.params)

    @property
    def position(self) -> tuple[float, float] | None:
        """Latitude and longitude, None when none is given."""
        latitude, longitude = self.params[4:6]
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0) or latitude == longitude == 0.0:
            return None
        return latitude, longitude


@dataclass(frozen=True, slots=True)
class Answer:
    """Result of a command.

    Parameters
    ----------
    result : int
        MAV_RESULT of the acknowledgement.
    messages : tuple
        Sent after the acknowledgement.
    """

    result: int = int(m.MAV_RESULT_ACCEPTED)
    messages: tuple[Message, ...] = ()


class CommandedVehicle(Protocol):
    """A vehicle as its commands see it."""

    schedule: Schedule
    has_camera: bool

    @property
    def pilot(self) -> Pilot:
        """The vehicle without MAVLink."""

    @property
    def state(self) -> WireState:
        """Its state for messages."""

    def command_camera(self, command: int, params: tuple[float, ...]) -> None:
        """Send a command to the camera."""

    def metadata(self) -> tuple[Message, ...]:
        """Where the files are that describe it; nothing where it has none."""

    def on_home_moved(self) -> None:
        """Tell where home is now."""

    def calibrate_gyro(self) -> None:
        """Calibrate the gyroscopes, and tell how it goes."""

    def reboot(self) -> None:
        """Start again."""

    def say_refusal(self, text: str) -> None:
        """Say why an order is refused; nothing where the autopilot has no words for it."""

    def say_warning(self, text: str) -> None:
        """Tell the operator something."""


def order_of(message: CommandMessage) -> Order:
    """Read COMMAND_LONG or COMMAND_INT."""
    source = (message.get_srcSystem(), message.get_srcComponent())
    first = (message.param1, message.param2, message.param3, message.param4)
    if is_a(message, m.MAVLink_command_long_message):
        params = (*first, message.param5, message.param6, message.param7)
        return Order(message.command, params, 0, source, message.confirmation > 0, True)
    frame = _INT_FRAMES.get(message.frame, message.frame)
    scale = 1e-7 if frame in (0, 3, 10) else 1.0
    params = (*first, message.x * scale, message.y * scale, message.z)
    return Order(message.command, params, frame, source, False)
