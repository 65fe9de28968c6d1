"""Received commands (COMMAND_LONG and COMMAND_INT), and commands to the vehicle's camera."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import CommandMessage, is_a
from mission.model import Command, MissionItem
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.component import NEVER

if TYPE_CHECKING:
    from sim_vehicle.execution.state import VehicleState
    from sim_vehicle.mavlink.wire_state import WireState

CAMERA = int(m.MAV_COMP_ID_CAMERA)
# Number of attempts, RETRY_S apart, after which the operator is warned.
TRIES = 3
RETRY_S = 0.5
_STOPPED_BY = {
    Command.DO_SET_CAM_TRIGG_DIST: Command.DO_SET_CAM_TRIGG_DIST,
    Command.DO_SET_CAM_TRIGG_INTERVAL: Command.DO_SET_CAM_TRIGG_INTERVAL,
    Command.IMAGE_START_CAPTURE: Command.IMAGE_STOP_CAPTURE,
}
_INT_FRAMES = {5: 0, 6: 3, 11: 10}

Result: TypeAlias = "int | tuple[Message, ...] | None"
"""Result of a command: a MAV_RESULT, or the messages that follow if it is accepted; None also accepts it."""


@dataclass(frozen=True, slots=True)
class VehicleCommand:
    """Received COMMAND_LONG or COMMAND_INT."""

    id: int
    """MAV_CMD."""
    params: tuple[float, ...]
    """Parameters 1 to 7; latitude and longitude of a position are in degrees."""
    frame: int
    """MAV_FRAME, with INT variants replaced; GLOBAL for COMMAND_LONG."""
    source: tuple[int, int]
    again: bool = False
    """Whether this command repeats a command that got no answer."""
    long: bool = False
    """Whether the message was a COMMAND_LONG, which has positions in 32-bit floats."""

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
    """Convert a mission item to a VehicleCommand in a standard frame, with NaN for missing parameters."""
    item = item.in_standard_frame()
    first = (item.param1, item.param2, item.param3, item.param4)
    params = (*(math.nan if value is None else value for value in first), item.x, item.y, item.z)
    return VehicleCommand(item.command, params, item.frame, source)


@dataclass(slots=True)
class _Pending:
    message: m.MAVLink_command_long_message
    tries: int
    due_s: float


class CameraCommands:
    """Commands to the camera in the vehicle's system; they are retried, and a failure gives a warning."""

    def __init__(self, state: WireState) -> None:
        self._state = state
        self._pending: list[_Pending] = []
        self._stop: int | None = None
        self._started: tuple[int, tuple[float, ...]] | None = None
        self._paused: tuple[int, tuple[float, ...]] | None = None
        self._was_in_mission = False

    @property
    def shooting(self) -> bool:
        """Whether the camera is taking a series of images."""
        return self._stop is not None

    def command(self, command: int, params: tuple[float, ...], now_s: float) -> Message:
        """Return the message of a camera command; `poll` repeats the message until it is acknowledged."""
        if command == Command.IMAGE_STOP_CAPTURE:
            self._stop = None
        elif command in _STOPPED_BY:
            starts = command == Command.IMAGE_START_CAPTURE or params[0] > 0.0
            self._stop = _STOPPED_BY[Command(command)] if starts else None
        if command in _STOPPED_BY or command == Command.IMAGE_STOP_CAPTURE:
            self._started = (command, params) if self._stop is not None else None
            self._paused = None
        message = m.MAVLink_command_long_message(self._state.system_id, CAMERA, command, 0, *params)
        self._pending = [p for p in self._pending if p.message.command != command]
        self._pending.append(_Pending(message, 1, now_s + RETRY_S))
        return message

    def _stop_series(self, now_s: float) -> list[Message]:
        """Stop the running series of images."""
        return [] if self._stop is None else [self.command(self._stop, (0.0,) * 7, now_s)]

    def watch(self, now_s: float) -> list[Message]:
        """Stop a series of images after disarming and, with PX4, when the vehicle leaves the mission mode."""
        pilot = self._state.pilot
        left = self._was_in_mission and pilot.mode is not Mode.MISSION
        self._was_in_mission = pilot.mode is Mode.MISSION
        pauses = pilot.behaviour.pauses_shots
        if not self.shooting:
            return []
        if not pilot.armed or (pauses and pilot.mode in (Mode.RTL, Mode.LAND)):
            return self._stop_series(now_s)
        if not (pauses and left):
            return []
        paused = self._started
        sent = self._stop_series(now_s)
        self._paused = paused
        return sent

    def resume(self, now_s: float) -> list[Message]:
        """Resume the paused series of images, unless another command has started or stopped a series."""
        return [] if self._paused is None else [self.command(*self._paused, now_s)]

    def acknowledged(self, command: int, result: int) -> None:
        """Handle a COMMAND_ACK from the camera."""
        if result == m.MAV_RESULT_IN_PROGRESS or all(p.message.command != command for p in self._pending):
            return
        self._pending = [p for p in self._pending if p.message.command != command]
        if result != m.MAV_RESULT_ACCEPTED:
            self._state.pilot.warn(f"Camera refused command {command} (result {result})")

    def poll(self, now_s: float) -> list[Message]:
        """Return the commands to retry; drop a command after three attempts and warn the operator."""
        again: list[Message] = []
        for pending in [p for p in self._pending if p.due_s <= now_s]:
            if pending.tries == TRIES:
                self._pending.remove(pending)
                self._state.pilot.warn(f"Camera does not answer command {pending.message.command}")
                continue
            pending.message.confirmation = pending.tries
            pending.tries += 1
            pending.due_s = now_s + RETRY_S
            again.append(pending.message)
        return again

    @property
    def due_s(self) -> float:
        """Time of the next retry (s); infinite if no command is pending."""
        return min([p.due_s for p in self._pending]) if self._pending else NEVER


def camera_feedback(image: m.MAVLink_camera_image_captured_message, state: VehicleState) -> Message:
    """Return CAMERA_FEEDBACK with the present attitude for an image that the autopilot commanded."""
    return m.MAVLink_camera_feedback_message(
        image.time_utc or image.time_boot_ms * 1000,
        *(0, 0, image.image_index & 0xFFFF),
        image.lat,
        image.lon,
        image.alt / 1000.0,
        image.relative_alt / 1000.0,
        math.degrees(state.roll_rad),
        math.degrees(state.pitch_rad),
        math.degrees(state.yaw_rad),
        0.0,
        m.CAMERA_FEEDBACK_PHOTO,
        (image.image_index + 1) & 0xFFFF,
    )
