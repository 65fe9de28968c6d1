"""MAVLink camera components: the common base class, and the leaf camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

from mission.link.codec.dialect import Message, mavlink
from mission.link.codec.typed import CommandMessage, is_a, is_command
from sensors.camera.leaf_camera import ground_offset
from sim_vehicle.camera.image_memory import STORAGE_MIB, ImageMemory
from sim_vehicle.camera.trigger import CameraTrigger, Exposure, Fix

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from geo.farm import Farm
    from sensors.camera.leaf_camera import Camera

CAMERA_COMPONENT_ID = 100
MIN_DISTANCE_M = 0.01
MIN_INTERVAL_S = 0.01
MAX_INTERVAL_S = 86_400.0
_HEARTBEAT_S = 1.0
_TELEMETRY_TIMEOUT_S = 2.5
_POSITION_US, _TIME_US = 100_000.0, 1_000_000.0
_UNIX_US = 10**15
_E7 = 1e7
_STRAIGHT_DOWN = -9000

_ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
_DENIED = mavlink.MAV_RESULT_DENIED
_UNSUPPORTED = mavlink.MAV_RESULT_UNSUPPORTED
_NOT_NOW = mavlink.MAV_RESULT_TEMPORARILY_REJECTED

Parameters: TypeAlias = tuple[float, float, float, float]
_Obeyed: TypeAlias = int | list[Message]


class CameraComponent:
    """A MAVLink camera that takes images on mission commands and sends the readings of the images.

    The camera takes its position from the autopilot's GLOBAL_POSITION_INT messages, best at 10 Hz, at least
    at 1 Hz. If none arrive, the camera requests them, because ArduPilot sends only requested messages.

    Images are triggered by DO_SET_CAM_TRIGG_DIST, DO_SET_CAM_TRIGG_INTERVAL, IMAGE_START_CAPTURE and the
    autopilot's CAMERA_TRIGGER. The camera stops when the vehicle disarms or the autopilot restarts.

    Each image is reported by CAMERA_IMAGE_CAPTURED and DEBUG_FLOAT_ARRAY (`sensors.camera.wire`). Subclasses
    implement `_take`.

    Parameters
    ----------
    fields : tuple of str
        Names of the fields that the camera reads.
    footprint_cells : int
        Side of the square footprint of an image, in cells.
    system_id, component_id : int
        MAVLink address; the camera has the system id of the vehicle.
    """

    wanted: frozenset[int] | None = frozenset(
        {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
            mavlink.MAVLINK_MSG_ID_COMMAND_INT,
            mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
            mavlink.MAVLINK_MSG_ID_CAMERA_TRIGGER,
        }
    )

    def __init__(
        self,
        fields: tuple[str, ...],
        footprint_cells: int,
        *,
        system_id: int = 1,
        component_id: int = CAMERA_COMPONENT_ID,
    ) -> None:
        self.system_id = system_id
        self.component_id = component_id
        self.trigger = CameraTrigger()
        self._footprint_cells = footprint_cells
        self._memory = ImageMemory(fields, footprint_cells)
        self._autopilot = (system_id, int(mavlink.MAV_COMP_ID_AUTOPILOT1))
        self._heartbeat_s: float | None = None
        self._position_s: float | None = None
        self._mode = mavlink.CAMERA_MODE_IMAGE_SURVEY
        self._armed = False
        self._utc_offset_us: int | None = None
        self._external = False
        self._last_trigger_sequence = -1
        self._sequences: dict[tuple[int, int], int] = {}

    @property
    def image_count(self) -> int:
        """Number of images taken."""
        return self._memory.count

    def next_deadline(self) -> float:
        """Return the time of the next heartbeat."""
        return -math.inf if self._heartbeat_s is None else self._heartbeat_s

    def poll(self, now_s: float) -> list[Message]:
        """Return the heartbeat if it is due; `receive`, not `poll`, takes the images."""
        due_s = self._heartbeat_s
        if due_s is not None and now_s < due_s:
            return []
        late = due_s is None or now_s - due_s > _HEARTBEAT_S
        self._heartbeat_s = (now_s if late or due_s is None else due_s) + _HEARTBEAT_S
        state = mavlink.MAV_STATE_ACTIVE if self.trigger.active else mavlink.MAV_STATE_STANDBY
        return [_heartbeat(state), *self._request_telemetry(now_s)]

    def goodbye(self) -> list[Message]:
        """Return a last HEARTBEAT with the state POWEROFF."""
        return [_heartbeat(mavlink.MAV_STATE_POWEROFF)]

    def _request_telemetry(self, now_s: float) -> list[Message]:
        """Request telemetry from an autopilot that sends no positions."""
        if self._position_s is None or now_s < self._position_s + _TELEMETRY_TIMEOUT_S:
            return []
        self._position_s = now_s
        wanted = (
            (mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, _POSITION_US),
            (mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, _TIME_US),
        )
        command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        return [
            mavlink.MAVLink_command_long_message(*self._autopilot, command, 0, kind, period_us, 0, 0, 0, 0, 0)
            for kind, period_us in wanted
        ]

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Process telemetry and commands; return images and answers."""
        if is_a(message, mavlink.MAVLink_global_position_int_message):
            if not self._from_autopilot(message):
                return []
            self._position_s = now_s
            return self._position(message)
        if is_command(message):
            return self._command(message)
        if not self._from_autopilot(message):
            return []
        if is_a(message, mavlink.MAVLink_heartbeat_message):
            if self._position_s is None:
                self._position_s = now_s
            armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            if self._armed and not armed:
                self.trigger.stop()
            self._armed = armed
        elif is_a(message, mavlink.MAVLink_system_time_message):
            known = _UNIX_US < message.time_unix_usec < 2**62
            self._utc_offset_us = message.time_unix_usec - message.time_boot_ms * 1000 if known else None
        elif is_a(message, mavlink.MAVLink_camera_trigger_message):
            self._external_trigger(message)
        return []

    def _from_autopilot(self, message: Message) -> bool:
        return (message.get_srcSystem(), message.get_srcComponent()) == self._autopilot

    def _position(self, message: mavlink.MAVLink_global_position_int_message) -> list[Message]:
        latitude_e7, longitude_e7 = message.lat, message.lon
        if (
            (latitude_e7 == 0 and longitude_e7 == 0)
            or abs(latitude_e7) > 900_000_000
            or abs(longitude_e7) > 1_800_000_000
        ):
            self.trigger.lost()
            return []
        exposures = self.trigger.add(
            Fix(
                message.time_boot_ms,
                latitude_e7,
                longitude_e7,
                message.alt,
                message.relative_alt,
                message.vx / 100.0,
                message.vy / 100.0,
                message.hdg,
            )
        )
        return self._take(exposures) if exposures else []

    def _external_trigger(self, message: mavlink.MAVLink_camera_trigger_message) -> None:
        self._external = True
        if message.seq == self._last_trigger_sequence:
            return
        self._last_trigger_sequence = message.seq
        time_us = message.time_usec
        if time_us > _UNIX_US:
            if self._utc_offset_us is None:
                fix = self.trigger.position
                time_us = fix.time_ms * 1000 if fix is not None else 0
            else:
                time_us -= self._utc_offset_us
        self.trigger.at(time_us)

    def _take(self, exposures: Sequence[Exposure]) -> list[Message]:
        """Take an image at each exposure and return the messages that are ready."""
        raise NotImplementedError

    def _report(self, exposure: Exposure, values: NDArray[np.float32]) -> list[Message]:
        """Store an image with its readings, float32[cells, fields], and return the messages of the image."""
        return self._memory.report(self._memory.add(exposure, values), self._utc_offset_us)

    # Commands

    def _command(self, message: CommandMessage) -> list[Message]:
        if message.target_system not in (0, self.system_id):
            return []
        if message.target_component not in (0, self.component_id):
            return []
        obeyed = self._obey(message, message.command)
        result, extra = (obeyed, []) if isinstance(obeyed, int) else (_ACCEPTED, obeyed)
        if message.target_component == 0 and result == _UNSUPPORTED:
            return []  # Another component of the system may support the command.
        answer = mavlink.MAVLink_command_ack_message(
            message.command,
            result,
            target_system=message.get_srcSystem(),
            target_component=message.get_srcComponent(),
        )
        return [answer, *extra]

    def _obey(self, message: CommandMessage, command: int) -> _Obeyed:
        """Execute a command; return the messages that follow its acceptance, or else a MAV_RESULT."""
        given = (message.param1, message.param2, message.param3, message.param4)
        if command in _TRIGGERS and math.isnan(given[0]):
            return _DENIED
        p: Parameters = tuple(0.0 if math.isnan(value) else value for value in given)  # type: ignore[assignment]
        if command == mavlink.MAV_CMD_REQUEST_CAMERA_IMAGE_CAPTURE:
            return self._request(mavlink.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED, p[0])
        if old := _OLD_REQUESTS.get(command):
            return self._request(old, 0.0) if 1.0 in p[:2] else []
        handler = _HANDLERS.get(command)
        return _UNSUPPORTED if handler is None else handler(self, message, p)

    def _stop_capture(self, _message: CommandMessage, p: Parameters) -> _Obeyed:
        if not self._mine(p[0]):
            return _DENIED
        self.trigger.stop()
        return []

    def _set_mode(self, _message: CommandMessage, p: Parameters) -> _Obeyed:
        if p[1] not in (mavlink.CAMERA_MODE_IMAGE, mavlink.CAMERA_MODE_IMAGE_SURVEY):
            return _DENIED
        self._mode = int(p[1])
        return []

    def _reset_settings(self, _message: CommandMessage, _p: Parameters) -> _Obeyed:
        self._mode = mavlink.CAMERA_MODE_IMAGE_SURVEY
        return []

    def _format_storage(self, _message: CommandMessage, p: Parameters) -> _Obeyed:
        if 1.0 in p[1:3]:
            self._memory.renumber(delete=p[1] == 1.0)
        return self._request(mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION, 0.0)

    def _shoot(self, message: CommandMessage, _p: Parameters) -> _Obeyed:
        """Take an image by DO_DIGICAM_CONTROL if its parameter 5 (x in a COMMAND_INT) is 1."""
        shoots = 1.0 in (getattr(message, "param5", 0.0), getattr(message, "x", 0))
        return self._start_capture(message, (0.0, 0.0, 1.0, 0.0)) if shoots else []

    def _shoot_by_time(self, message: CommandMessage, p: Parameters) -> _Obeyed:
        if _is_repeated(message) and self.trigger.interval_us == _microseconds(p[0] / 1000.0):
            return []
        return self._by_interval(p[0] / 1000.0, 0)

    def _mine(self, camera_id: float) -> bool:
        """Return whether this camera obeys a camera id: 0 (all), 1 to 6 (autopilot's cameras), or its own."""
        return camera_id < 7.0 or camera_id == self.component_id

    def _shoot_by_distance(self, message: CommandMessage, p: Parameters) -> _Obeyed:
        distance_m, now = p[0], p[2]
        if not self._mine(p[3]) or not math.isfinite(distance_m) or distance_m < 0.0:
            return _DENIED
        if distance_m == 0.0:
            self.trigger.stop()
            return []
        if distance_m < MIN_DISTANCE_M:
            return _DENIED
        if _is_repeated(message) and self.trigger.distance_m == distance_m:
            return []
        self.trigger.every_distance(distance_m)
        here = self.trigger.here() if now == 1.0 else None
        return self._take([here]) if here is not None else []

    def _by_interval(self, interval_s: float, count: int) -> _Obeyed:
        """Start exposures at an interval; 0 s stops exposures, and -1 ms selects the default, 1 s."""
        if interval_s == 0.0:
            self.trigger.stop()
            return []
        interval_s = 1.0 if interval_s == -0.001 else interval_s
        if not MIN_INTERVAL_S <= interval_s <= MAX_INTERVAL_S:
            return _DENIED
        fix = self.trigger.position
        start_us = fix.time_ms * 1000 if fix is not None else 0
        self.trigger.every_interval(round(interval_s * 1e6), count, start_us=start_us)
        return []

    def _start_capture(self, message: CommandMessage, p: Parameters) -> _Obeyed:
        camera_id, interval_s, count, sequence = p
        if not self._mine(camera_id) or not (0.0 <= count < 2**24 and count % 1.0 == 0.0):
            return _DENIED
        if count != 1.0:
            if _is_repeated(message) and self.trigger.interval_us == _microseconds(interval_s):
                return []
            return self._by_interval(interval_s, int(count)) if interval_s > 0.0 else _DENIED
        source = (message.get_srcSystem(), message.get_srcComponent())
        if self._external and source == self._autopilot:
            return []  # PX4 also sends CAMERA_TRIGGER for this exposure.
        here = self.trigger.here()
        if here is None:
            return _NOT_NOW
        if sequence > 0.0 and math.isfinite(sequence):
            before = self._sequences.get(source, 0)
            again = sequence == before or (sequence < before and _is_repeated(message))
            if again:
                return []
            self._sequences[source] = int(sequence)
        return self._take([here])

    def _request(self, message_id: float, index: float) -> _Obeyed:
        fix = self.trigger.position
        time_ms = fix.time_ms if fix is not None else 0
        if message_id == mavlink.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED:
            image = self._memory.find(index)
            return _DENIED if image is None else self._memory.report(image, self._utc_offset_us)
        build = _BUILDERS.get(message_id)
        return _UNSUPPORTED if build is None else [build(self, time_ms)]

    def _settings(self, time_ms: int) -> Message:
        return mavlink.MAVLink_camera_settings_message(time_ms, self._mode)

    def _information(self, time_ms: int) -> Message:
        side = self._footprint_cells
        return mavlink.MAVLink_camera_information_message(
            time_ms,
            list(b"wbf-mission".ljust(32, b"\0")),
            list(b"leaf camera".ljust(32, b"\0")),
            1,
            math.nan,
            math.nan,
            math.nan,
            side,
            side,
            0,
            mavlink.CAMERA_CAP_FLAGS_CAPTURE_IMAGE
            | mavlink.CAMERA_CAP_FLAGS_HAS_MODES
            | mavlink.CAMERA_CAP_FLAGS_HAS_IMAGE_SURVEY_MODE,
            0,
            b"",
        )

    def _storage(self, time_ms: int) -> Message:
        used = self._memory.used_mib
        ready = mavlink.STORAGE_STATUS_READY
        return mavlink.MAVLink_storage_information_message(
            time_ms, 1, 1, ready, STORAGE_MIB, used, STORAGE_MIB - used, math.nan, math.nan
        )

    def _status(self, time_ms: int) -> Message:
        trigger = self.trigger
        image_status = (2 if trigger.interval_us else 0) + (1 if trigger.active else 0)
        free = STORAGE_MIB - self._memory.used_mib
        return mavlink.MAVLink_camera_capture_status_message(
            time_ms, image_status, 0, trigger.interval_us / 1e6, 0, free, self.image_count
        )


class LeafCameraComponent(CameraComponent):
    """The benchmark's leaf camera, which reads the fields of a farm below the vehicle.

    The camera reads the cell below the true position of the vehicle, not below the reported position.

    Parameters
    ----------
    camera : Camera
        The leaf camera that reads the environment.
    farm : Farm
        Farm, for the conversion of positions into cells.
    system_id, component_id : int
        MAVLink address; the camera has the system id of the vehicle.
    position_error : callable, optional
        ``position_error(time_us)`` returns the error of the reported position to the east and north (m) at a
        time since boot; by default 0.
    looks : callable, optional
        ``looks(time_us)`` returns roll, pitch and compass heading (rad) of the camera's gimbal at a time
        since boot, or None for straight down; by default straight down.
    """

    def __init__(
        self,
        camera: Camera,
        farm: Farm,
        *,
        system_id: int = 1,
        component_id: int = CAMERA_COMPONENT_ID,
        position_error: Callable[[float], tuple[float, float]] | None = None,
        looks: Callable[[float], tuple[float, float, float] | None] | None = None,
    ) -> None:
        options = camera.options
        super().__init__(
            options.fields.names, options.footprint_cells, system_id=system_id, component_id=component_id
        )
        self._position_error = position_error
        self._looks = looks
        self._camera = camera
        self._farm = farm

    def _take(self, exposures: Sequence[Exposure]) -> list[Message]:
        """Read the cells in the exposures and return the messages."""
        if self._looks is not None:
            exposures = [_turned(exposure, self._looks(exposure.time_us)) for exposure in exposures]
        cells = [self._cell_under(exposure) for exposure in exposures]
        values = self._camera.capture([x for x, _ in cells], [y for _, y in cells])
        messages: list[Message] = []
        for exposure, seen in zip(exposures, values, strict=True):
            messages += self._report(exposure, seen)
        return messages

    def _cell_under(self, exposure: Exposure) -> tuple[int, int]:
        """Return the cell that the camera faces on flat ground; if it faces the sky, a cell off the farm."""
        farm = self._farm
        x_m, y_m = farm.frame.from_wgs84(exposure.latitude_e7 / _E7, exposure.longitude_e7 / _E7)
        if self._position_error is not None:
            off_x_m, off_y_m = farm.frame.from_east_north(*self._position_error(exposure.time_us))
            x_m -= off_x_m
            y_m -= off_y_m
        if exposure.pitch_cdeg != _STRAIGHT_DOWN:
            attitude = self._memory.attitude(exposure)
            offset_m = ground_offset(attitude, exposure.relative_altitude_mm / 1000.0)
            ahead_x_m, ahead_y_m = farm.frame.from_east_north(*offset_m)
            x_m += ahead_x_m
            y_m += ahead_y_m
        return farm.cell_of(x_m, y_m)


def _turned(exposure: Exposure, attitude: tuple[float, float, float] | None) -> Exposure:
    """Return an exposure with a camera attitude (roll, pitch, heading; rad); None changes nothing."""
    if attitude is None:
        return exposure
    roll, pitch, heading = (round(100.0 * math.degrees(angle)) for angle in attitude)
    return exposure._replace(roll_cdeg=roll, pitch_cdeg=pitch, heading_cdeg=heading % 36_000)


def _is_repeated(message: CommandMessage) -> bool:
    """Return whether a command repeats an unanswered command; a repeat must not restart the trigger."""
    return getattr(message, "confirmation", 0) > 0


def _microseconds(seconds: float) -> int:
    """Return a time in microseconds; -1, which equals no interval, if the time is not finite."""
    return round(seconds * 1e6) if math.isfinite(seconds) else -1


def _heartbeat(state: int) -> Message:
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_CAMERA, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, state, 3
    )


_TRIGGERS = (mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST, mavlink.MAV_CMD_DO_SET_CAM_TRIGG_INTERVAL)
_Handler: TypeAlias = Callable[[CameraComponent, CommandMessage, Parameters], _Obeyed]
_HANDLERS: dict[int, _Handler] = {
    mavlink.MAV_CMD_REQUEST_MESSAGE: lambda camera, _, p: camera._request(p[0], p[1]),
    mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST: CameraComponent._shoot_by_distance,
    mavlink.MAV_CMD_DO_SET_CAM_TRIGG_INTERVAL: CameraComponent._shoot_by_time,
    203: CameraComponent._shoot,  # DO_DIGICAM_CONTROL
    mavlink.MAV_CMD_IMAGE_START_CAPTURE: CameraComponent._start_capture,
    mavlink.MAV_CMD_IMAGE_STOP_CAPTURE: CameraComponent._stop_capture,
    mavlink.MAV_CMD_SET_CAMERA_MODE: CameraComponent._set_mode,
    mavlink.MAV_CMD_STORAGE_FORMAT: CameraComponent._format_storage,
    mavlink.MAV_CMD_RESET_CAMERA_SETTINGS: CameraComponent._reset_settings,
}
_BUILDERS: dict[float, Callable[[CameraComponent, int], Message]] = {
    mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION: CameraComponent._information,
    mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS: CameraComponent._settings,
    mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION: CameraComponent._storage,
    mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS: CameraComponent._status,
}
_OLD_REQUESTS = {
    mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION: mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION,
    mavlink.MAV_CMD_REQUEST_CAMERA_SETTINGS: mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS,
    mavlink.MAV_CMD_REQUEST_STORAGE_INFORMATION: mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION,
    mavlink.MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS: mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS,
}
"""Older commands in place of REQUEST_MESSAGE, each with its message; MAVSDK and QGroundControl use them."""
