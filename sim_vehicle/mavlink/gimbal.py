"""Gimbal commands and telemetry over MAVLink.

Implements gimbal protocol v2 with the autopilot as gimbal manager of gimbal device 1, which is not a MAVLink
component itself, and the older mount messages. Sources: ArduPilot's ``AP_Mount.cpp`` and
``AP_Mount_Backend.cpp``; the answers are those of ArduCopter 4.7 in SITL with ``MNT1_TYPE`` 1.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from geo.frame import angles_of, quaternion_of
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from mission.model import Command
from sim_vehicle.execution.items import ROI_COMMANDS
from sim_vehicle.mavlink.vehicle_command import Result, VehicleCommand
from sim_vehicle.pilot.gimbal import Gimbal, GimbalMode

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_vehicle.mavlink.wire_state import WireState

__all__ = [
    "GIMBAL_BUILDERS",
    "GIMBAL_COMMANDS",
    "GimbalMessage",
    "command_gimbal",
    "obey_gimbal_message",
]

_DEVICE = 1
_FAILED = m.MAV_RESULT_FAILED
_LOCKS = m.GIMBAL_DEVICE_FLAGS_ROLL_LOCK | m.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
_AXES = 0b111_111_111 << 2  # flags for axis, follow and lock, of roll, pitch and yaw each
_CAPABILITIES = (
    m.GIMBAL_MANAGER_CAP_FLAGS_HAS_RETRACT
    | m.GIMBAL_MANAGER_CAP_FLAGS_HAS_NEUTRAL
    | _AXES
    | m.GIMBAL_MANAGER_CAP_FLAGS_HAS_RC_INPUTS
    | m.GIMBAL_MANAGER_CAP_FLAGS_CAN_POINT_LOCATION_LOCAL
    | m.GIMBAL_MANAGER_CAP_FLAGS_CAN_POINT_LOCATION_GLOBAL
)
_RESTING = {
    GimbalMode.RETRACT: m.GIMBAL_DEVICE_FLAGS_RETRACT,
    GimbalMode.NEUTRAL: m.GIMBAL_DEVICE_FLAGS_NEUTRAL,
}
# Tolerance of a unit quaternion's length.
_UNIT = 0.1
_NAN_3 = (math.nan, math.nan, math.nan)
_MOST_DEG = (90.0, 180.0, 360.0)


def _turn(gimbal: Gimbal, flags: int, angles_deg: tuple[float, ...], rates_deg: tuple[float, ...]) -> Result:
    """Turn the gimbal to angles, else at rates (roll, pitch, yaw), else set only the yaw lock."""
    for mode, flag in _RESTING.items():  # manager flags equal device flags
        if flags & flag:
            gimbal.set_mode(mode)
            return None
    earth = bool(flags & m.GIMBAL_MANAGER_FLAGS_YAW_LOCK)
    if all(map(math.isfinite, angles_deg)):
        gimbal.turn_to(tuple(map(math.radians, angles_deg)), earth=earth)
    elif all(map(math.isfinite, rates_deg)):
        gimbal.turn_at(tuple(map(math.radians, rates_deg)), earth=earth)
    elif all(map(math.isnan, (*angles_deg[1:], *rates_deg[1:]))):
        gimbal.yaw_lock = earth
        gimbal.wake()
    else:
        return _FAILED
    return None


def _pitch_yaw(source: WireState, command: VehicleCommand) -> Result:
    """DO_GIMBAL_MANAGER_PITCHYAW: angles (degrees), rates (degrees per second), flags, -, device."""
    if command.number(7, -1) not in (0, _DEVICE):
        return _FAILED
    pitch, yaw, pitch_rate, yaw_rate, flags = command.params[:5]
    if not command.long and command.frame in (0, 3, 10):
        flags *= 1e7  # undo the scaling of latitudes: this field holds flags
    if not 0.0 <= flags < 2**32:
        return _FAILED
    return _turn(source.gimbal, round(flags), (0.0, pitch, yaw), (0.0, pitch_rate, yaw_rate))


def _configure(source: WireState, command: VehicleCommand) -> Result:
    """DO_GIMBAL_MANAGER_CONFIGURE: set the controller; -1 keeps, -2 takes and -3 releases control."""
    system, component = command.params[:2]
    known = all(-3.0 <= number <= 255.0 for number in (system, component))
    if not known or command.number(7, -1) not in (0, _DEVICE):
        return _FAILED
    gimbal, before = source.gimbal, source.gimbal.controller
    if system == -2.0:
        gimbal.controller = command.source
    elif system == -3.0:
        gimbal.controller = (0, 0) if before == command.source else before
    elif system >= 0.0:
        gimbal.controller = (int(system), int(component) & 255)
    return () if gimbal.controller == before else (_status(source),)


def _mount_configure(source: WireState, command: VehicleCommand) -> None:
    """DO_MOUNT_CONFIGURE: set the mode; other settings have no effect."""
    source.gimbal.set_mode(command.number(1, -1))


def _mount_control(source: WireState, command: VehicleCommand) -> Result:
    """DO_MOUNT_CONTROL: pitch, roll, yaw relative to the vehicle, height above home, position, mode."""
    gimbal, mode = source.gimbal, command.number(7, -1)
    if mode == GimbalMode.TARGET:
        angles = command.params[:3]
        if not all(abs(angle) <= most for angle, most in zip(angles, _MOST_DEG, strict=True)):
            return _FAILED
        pitch, roll, yaw = map(math.radians, angles)
        gimbal.turn_to((roll, pitch, yaw), earth=False)
    elif mode == GimbalMode.POINT:
        position, height_m = command.position, command.params[3]
        if position is None or not math.isfinite(height_m):
            return _FAILED
        gimbal.point_at((*source.pilot.frame.from_wgs84(*position), height_m))
    elif not gimbal.set_mode(mode):
        return _FAILED
    return None


def _region(source: WireState, command: VehicleCommand) -> None:
    """DO_SET_ROI_LOCATION, DO_SET_ROI, DO_SET_ROI_NONE: point at a position, or stop without a position."""
    position = None if command.id == Command.DO_SET_ROI_NONE else command.position
    if position is None:
        source.gimbal.point_at(None)
        return
    height_m = command.params[6] if math.isfinite(command.params[6]) else 0.0
    if not command.long:
        height_m = source.above_start(height_m, command.frame)
    source.gimbal.point_at((*source.pilot.frame.from_wgs84(*position), height_m))


_POINTING: dict[int, Callable[[WireState, VehicleCommand], Result]] = {
    m.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: _pitch_yaw,
    m.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: _configure,
    m.MAV_CMD_DO_MOUNT_CONFIGURE: _mount_configure,
    m.MAV_CMD_DO_MOUNT_CONTROL: _mount_control,
    **dict.fromkeys(ROI_COMMANDS, _region),
}
GIMBAL_COMMANDS = frozenset(_POINTING) - ROI_COMMANDS
"""MAV_CMDs that concern only the gimbal."""


def command_gimbal(source: WireState, command: VehicleCommand) -> Result:
    """Execute a gimbal command or mission item; FAILED if the vehicle has no gimbal."""
    obey = _POINTING.get(command.id)
    if obey is None or not source.gimbal.fitted:
        return _FAILED
    source.gimbal.wake()
    return obey(source, command)


GimbalMessage = (
    m.MAVLink_gimbal_manager_set_attitude_message
    | m.MAVLink_gimbal_manager_set_pitchyaw_message
    | m.MAVLink_mount_configure_message
    | m.MAVLink_mount_control_message
)


def obey_gimbal_message(source: WireState, message: GimbalMessage) -> None:
    """Execute a message to the gimbal; invalid values are ignored."""
    gimbal = source.gimbal
    if not gimbal.fitted:
        return
    if is_a(message, m.MAVLink_mount_configure_message):
        gimbal.set_mode(message.mount_mode)
    elif is_a(message, m.MAVLink_mount_control_message):
        if gimbal.mode is GimbalMode.POINT:
            if abs(message.input_a) <= 90e7 and abs(message.input_b) <= 180e7:
                place_m = source.pilot.frame.from_wgs84(1e-7 * message.input_a, 1e-7 * message.input_b)
                gimbal.point_at((*place_m, message.input_c / 100.0))
            return
        asked = (message.input_a, message.input_b, message.input_c)
        pitch, roll, yaw = (math.radians(angle / 100.0) for angle in asked)
        gimbal.turn_to((roll, pitch, yaw), earth=False)
    elif message.gimbal_device_id in (0, _DEVICE):
        if is_a(message, m.MAVLink_gimbal_manager_set_pitchyaw_message):
            angles: tuple[float, ...] = (0.0, message.pitch, message.yaw)
            rates: tuple[float, ...] = (0.0, message.pitch_rate, message.yaw_rate)
        else:
            angles = angles_of(message.q) if abs(math.hypot(*message.q) - 1.0) < _UNIT else _NAN_3
            rates = (message.angular_velocity_x, message.angular_velocity_y, message.angular_velocity_z)
        if not all(map(math.isfinite, (*angles, *rates))):
            _turn(gimbal, message.flags, tuple(map(math.degrees, angles)), tuple(map(math.degrees, rates)))


def _information(source: WireState) -> Message:
    limits = [limit for axis in source.gimbal.limits_rad for limit in axis]
    return m.MAVLink_gimbal_manager_information_message(source.boot_ms, int(_CAPABILITIES), _DEVICE, *limits)


def _status(source: WireState) -> Message:
    flags = _LOCKS | (m.GIMBAL_MANAGER_FLAGS_YAW_LOCK if source.gimbal.yaw_lock else 0)
    return m.MAVLink_gimbal_manager_status_message(
        source.boot_ms, int(flags), _DEVICE, *source.gimbal.controller, 0, 0
    )


def _attitude_status(source: WireState) -> Message:
    gimbal = source.gimbal
    flags = _LOCKS | m.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME | _RESTING.get(gimbal.mode, 0)
    if gimbal.locks_yaw:
        flags |= m.GIMBAL_DEVICE_FLAGS_YAW_LOCK
    attitude = quaternion_of(*gimbal.angles_rad)
    return m.MAVLink_gimbal_device_attitude_status_message(
        0, 0, source.boot_ms, int(flags), attitude, *_NAN_3, 0, math.nan, math.nan, _DEVICE
    )


def _mount_status(source: WireState) -> Message:
    roll, pitch, yaw = (round(100.0 * math.degrees(angle)) for angle in source.gimbal.angles_rad)
    return m.MAVLink_mount_status_message(0, 0, pitch, roll, yaw, int(source.gimbal.mode))


def _fitted(build: Callable[[WireState], Message]) -> Callable[[WireState], Message | None]:
    return lambda source: build(source) if source.gimbal.fitted else None


GIMBAL_BUILDERS: dict[int, Callable[[WireState], Message | None]] = {
    m.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: _fitted(_information),
    m.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: _fitted(_status),
    m.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: _fitted(_attitude_status),
    m.MAVLINK_MSG_ID_MOUNT_STATUS: _fitted(_mount_status),
}
"""Builders of gimbal telemetry by message id; a builder returns None if there is no gimbal."""
