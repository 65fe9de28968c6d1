"""Commands from the vehicle to its camera, retried until acknowledged."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import Command
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.component import NEVER

if TYPE_CHECKING:
    from sim_vehicle.execution.state import VehicleState
    from sim_vehicle.mavlink.wire_state import WireState

__all__ = ["CAMERA", "CameraCommands", "camera_feedback"]

CAMERA = int(m.MAV_COMP_ID_CAMERA)
# Number of attempts, RETRY_S apart, before the operator is warned.
TRIES = 3
RETRY_S = 0.5
_STOPPED_BY = {
    Command.DO_SET_CAM_TRIGG_DIST: Command.DO_SET_CAM_TRIGG_DIST,
    Command.DO_SET_CAM_TRIGG_INTERVAL: Command.DO_SET_CAM_TRIGG_INTERVAL,
    Command.IMAGE_START_CAPTURE: Command.IMAGE_STOP_CAPTURE,
}


@dataclass(slots=True)
class _Pending:
    message: m.MAVLink_command_long_message
    tries: int
    due_s: float


class CameraCommands:
    """Commands to the camera of the vehicle's own system, with retries and a warning if they fail."""

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
        """Return the message of a command with its 7 parameters; `poll` retries it until acknowledged."""
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
        """Stop a series of images when the autopilot does: on disarming or on leaving the mission mode."""
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
        """Resume the paused series of images, unless the camera received another command since."""
        return [] if self._paused is None else [self.command(*self._paused, now_s)]

    def acknowledged(self, command: int, result: int) -> None:
        """Handle a COMMAND_ACK from the camera."""
        if result == m.MAV_RESULT_IN_PROGRESS or all(p.message.command != command for p in self._pending):
            return
        self._pending = [p for p in self._pending if p.message.command != command]
        if result != m.MAV_RESULT_ACCEPTED:
            self._state.pilot.warn(f"Camera refused command {command} (result {result})")

    def poll(self, now_s: float) -> list[Message]:
        """Return the commands to retry; after three attempts, warn the operator and drop the command."""
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
    """Return CAMERA_FEEDBACK for an image that the autopilot commanded, with the present attitude."""
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
