"""COMMAND_LONG and COMMAND_INT: one table, MAV_CMD to what the vehicle does and answers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import CommandMessage
from mission.model import RELATIVE_FRAMES, Command
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.mavlink.camera_commands import CAMERA_COMMANDS
from sim_vehicle.mavlink.flight_commands import FLIGHT_COMMANDS
from sim_vehicle.mavlink.gimbal_messages import (
    GIMBAL_BUILDERS,
    GIMBAL_COMMANDS,
    REGION_COMMANDS,
    order_gimbal,
)
from sim_vehicle.mavlink.orders import Answer, Order, order_of
from sim_vehicle.mavlink.telemetry import BUILDERS, built
from sim_vehicle.motion.legs import ALONG, Heading
from sim_vehicle.pilot.arming import FORCE
from sim_vehicle.pilot.notices import RefusedError

if TYPE_CHECKING:
    from sim_vehicle.autopilot.mavlink_profile import MavlinkProfile
    from sim_vehicle.mavlink.orders import CommandedVehicle

__all__ = ["HANDLERS", "CommandReceiver", "execute", "set_custom_mode"]

_MOST_PEERS = 256
_HEARTBEAT_US = 1e6
_FIRST_FREE_SERVO, _LAST_SERVO = 5, 16
_STANDARD_MODES = {
    1: Mode.HOLD,
    4: Mode.ALTITUDE,
    5: Mode.RTL,
    6: Mode.MISSION,
    7: Mode.LAND,
    8: Mode.TAKEOFF,
}


Handler = Callable[["CommandedVehicle", Order], Answer]
ACCEPTED = Answer()
UNSUPPORTED = Answer(int(m.MAV_RESULT_UNSUPPORTED))
DENIED = Answer(int(m.MAV_RESULT_DENIED))
FAILED = Answer(int(m.MAV_RESULT_FAILED))
INT_ONLY = Answer(int(m.MAV_RESULT_COMMAND_INT_ONLY))


def execute(vehicle: CommandedVehicle, order: Order) -> tuple[Answer, str]:
    """Do a command; returns the answer and what is told when it was refused."""
    handler = HANDLERS.get(order.command)
    profile = vehicle.state.firmware.mavlink
    if handler is None or order.command in profile.unsupported:
        return UNSUPPORTED, ""
    if order.long and order.command in profile.int_only:
        return INT_ONLY, ""
    try:
        return handler(vehicle, order), ""
    except RefusedError as refusal:
        return (DENIED if refusal.denied else Answer(profile.refused_result)), refusal.told


class CommandReceiver:
    """Carries out commands and acknowledges them; a command that a peer repeats is done once."""

    def __init__(self, vehicle: CommandedVehicle) -> None:
        self._vehicle = vehicle
        self._last: dict[tuple[int, int], tuple[Order, int]] = {}

    def receive(self, message: CommandMessage) -> list[Message]:
        """Take COMMAND_LONG or COMMAND_INT; the acknowledgement and what follows it."""
        order = order_of(message)
        if order.command in self._vehicle.state.firmware.mavlink.silent:
            return []
        last = self._last.get(order.source)
        if order.again and last is not None and last[0].is_same(order):
            return [_acknowledgement(order, last[1])]
        answer, reason = execute(self._vehicle, order)
        if reason:
            self._vehicle.say_warning(reason)
        if len(self._last) > _MOST_PEERS:
            self._last.clear()
        self._last[order.source] = (order, answer.result)
        return [_acknowledgement(order, answer.result), *answer.messages]


def _acknowledgement(order: Order, result: int) -> Message:
    return m.MAVLink_command_ack_message(order.command, result, 0, 0, *order.source)


def set_custom_mode(vehicle: CommandedVehicle, number: int) -> None:
    """Take the mode with this custom number.

    Raises
    ------
    RefusedError
        When it is unknown or not possible now.
    """
    modes = vehicle.state.firmware.mavlink.modes
    mode = modes.mode_of(number)
    if mode is Mode.FLIP and vehicle.state.custom_mode not in modes.flips_from:
        told = modes.refusal(number)
        raise RefusedError(told, told=told)
    if mode is None and modes.ignores(number):
        return
    if mode is None:
        told = modes.unknown_text.format(number)
        raise RefusedError(told, told=told)
    _enter(vehicle, mode, number)
    vehicle.state.name_mode(number)


def _enter(vehicle: CommandedVehicle, mode: Mode, number: int) -> None:
    """Take a mode."""
    with _told_as(vehicle, number):
        vehicle.pilot.set_mode(mode)


@contextmanager
def _told_as(vehicle: CommandedVehicle, number: int | None) -> Iterator[None]:
    """Tell in the firmware's words that the custom mode with this number is not entered; None for no mode."""
    try:
        yield
    except RefusedError as refusal:
        if number is None:
            raise
        has_position = vehicle.pilot.controls.position_ok
        told = vehicle.state.firmware.mavlink.modes.refusal(number, has_position=has_position)
        raise RefusedError(str(refusal), denied=refusal.denied, told=told) from None


def _available_modes(profile: MavlinkProfile, index: int) -> tuple[Message, ...]:
    """AVAILABLE_MODES for one mode (from 1) or, with 0, for all."""
    modes = list(profile.modes.numbers.items())
    chosen = range(1, len(modes) + 1) if index == 0 else [index] if 1 <= index <= len(modes) else []
    return tuple(
        m.MAVLink_available_modes_message(
            len(modes), i, 0, modes[i - 1][1], 0, modes[i - 1][0].value.encode()
        )
        for i in chosen
    )


def _arm(vehicle: CommandedVehicle, order: Order) -> Answer:
    arm, force = order.params[0], order.number(2) == FORCE
    if arm not in (0.0, 1.0):
        vehicle.say_refusal(vehicle.state.firmware.mavlink.refusals.arming.format(arm))
        return UNSUPPORTED
    if arm:
        vehicle.pilot.arm(force=force)
    else:
        vehicle.pilot.disarm(force=force)
    return ACCEPTED


def _set_mode(vehicle: CommandedVehicle, order: Order) -> Answer:
    if not order.number(1) & m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        msg = "Mode refused: only custom modes are known"
        raise RefusedError(msg, denied=True)
    modes = vehicle.state.firmware.mavlink.modes
    set_custom_mode(vehicle, modes.custom_mode_of(order.number(2), order.number(3)))
    return ACCEPTED


def _set_standard_mode(vehicle: CommandedVehicle, order: Order) -> Answer:
    mode = _STANDARD_MODES.get(order.number(1))
    if mode is None:
        return UNSUPPORTED
    _enter(vehicle, mode, vehicle.state.firmware.mavlink.modes[mode])
    return ACCEPTED


def _takeoff(vehicle: CommandedVehicle, order: Order) -> Answer:
    pilot = vehicle.pilot
    altitude = order.params[6]
    if vehicle.state.firmware.mavlink.takeoff_needs_arming and not pilot.armed:
        return FAILED
    if vehicle.state.firmware.mavlink.takeoff_above_sea and order.frame not in RELATIVE_FRAMES:
        altitude -= vehicle.state.home.altitude_m
    if not altitude > 0.0:
        altitude = pilot.spec.takeoff_altitude_m
    modes = vehicle.state.firmware.mavlink.modes
    number = modes[Mode.TAKEOFF]
    with _told_as(vehicle, None if number == modes[Mode.GUIDED] else number):
        pilot.takeoff(altitude)
    return ACCEPTED


def _mode(mode: Mode) -> Handler:
    def handler(vehicle: CommandedVehicle, _order: Order) -> Answer:
        number = vehicle.state.firmware.mavlink.modes[mode]
        _enter(vehicle, mode, number)
        vehicle.state.name_mode(number)
        return ACCEPTED

    handler.__doc__ = f"Take the {mode.value} mode."
    return handler


def _reposition(vehicle: CommandedVehicle, order: Order) -> Answer:
    position = order.position
    if position is None or order.frame not in (0, 3):
        msg = "Reposition refused: no position"
        raise RefusedError(msg, denied=True)
    pilot = vehicle.pilot
    altitude = order.params[6] - (0.0 if order.frame in RELATIVE_FRAMES else vehicle.state.home.altitude_m)
    if math.isnan(altitude):
        altitude = pilot.state.position_m[2]
    # The heading is in radians here, other than in mission items.
    speed, yaw_rad = order.params[0], order.params[3]
    turns = math.isfinite(yaw_rad) and vehicle.state.firmware.mavlink.reposition_turns
    pilot.goto(
        *position,
        altitude,
        mode=vehicle.state.firmware.mavlink.modes.after_command,
        heading=Heading.fixed(yaw_rad) if turns else ALONG,
        speed_m_s=speed if speed > 0.0 and math.isfinite(speed) else None,
    )
    return ACCEPTED


def _mission_start(vehicle: CommandedVehicle, order: Order) -> Answer:
    first = order.number(1)
    with _told_as(vehicle, vehicle.state.firmware.mavlink.modes[Mode.MISSION]):
        reason = vehicle.pilot.mission.why_not
        if reason is not None:
            msg = f"Mission start refused: {reason}"
            raise RefusedError(msg)
        vehicle.pilot.start_mission(vehicle.state.own_seq(first) if first > 0 else None)
    return ACCEPTED


def _pause_continue(vehicle: CommandedVehicle, order: Order) -> Answer:
    if order.params[0] not in (0.0, 1.0):
        msg = f"Pause refused: parameter 1 is {order.params[0]:g}"
        raise RefusedError(msg, denied=True)
    if order.params[0]:
        vehicle.pilot.resume()
    else:
        vehicle.pilot.pause()
    return ACCEPTED


def _mission_current(vehicle: CommandedVehicle, order: Order) -> Answer:
    seq = order.number(1, -1)
    if order.number(2) == 1 and seq < 0:
        vehicle.pilot.set_current(0)
    elif seq >= 0:
        vehicle.pilot.set_current(vehicle.state.own_seq(seq))
    return Answer(messages=built(m.MAVLINK_MSG_ID_MISSION_CURRENT, vehicle.state))


def _change_speed(vehicle: CommandedVehicle, order: Order) -> Answer:
    if order.number(1) not in (0, 1):
        return UNSUPPORTED
    if order.params[1] != -1.0:
        vehicle.pilot.set_speed(order.params[1])
    return ACCEPTED


def _flight_command(vehicle: CommandedVehicle, order: Order) -> Answer:
    FLIGHT_COMMANDS[order.command](vehicle, order)
    return ACCEPTED


def _region(vehicle: CommandedVehicle, order: Order) -> Answer:
    """DO_SET_ROI and its like: the nose turns, and the gimbal where there is one."""
    order_gimbal(vehicle.state, order)
    return _flight_command(vehicle, order)


def _gimbal(vehicle: CommandedVehicle, order: Order) -> Answer:
    if vehicle.state.firmware.mavlink.gimbal is None:
        return UNSUPPORTED
    return order_gimbal(vehicle.state, order)


def _get_home(vehicle: CommandedVehicle, _order: Order) -> Answer:
    return Answer(messages=built(m.MAVLINK_MSG_ID_HOME_POSITION, vehicle.state))


def _set_interval(vehicle: CommandedVehicle, order: Order) -> Answer:
    message_id, interval = order.number(1, -1), order.params[1]
    if message_id not in BUILDERS:
        vehicle.say_refusal(vehicle.state.firmware.mavlink.refusals.interval.format(message_id))
        return DENIED
    if math.isnan(interval) or abs(interval) > 1e10:
        return DENIED
    if message_id == m.MAVLINK_MSG_ID_HEARTBEAT and not 0.0 <= interval <= _HEARTBEAT_US:
        # Who is not heard is lost to its peers.
        return DENIED
    if message_id in GIMBAL_BUILDERS:
        vehicle.state.gimbal.wake()
    vehicle.schedule.set_interval(message_id, int(interval), vehicle.state.now_us)
    return ACCEPTED


def _get_interval(vehicle: CommandedVehicle, order: Order) -> Answer:
    return _interval_of(vehicle, order.number(1, -1))


def _interval_of(vehicle: CommandedVehicle, message_id: int) -> Answer:
    if not 0 <= message_id <= 65535:
        return DENIED
    known = message_id in BUILDERS
    interval = vehicle.schedule.interval_us(message_id) if known else 0
    return Answer(messages=(m.MAVLink_message_interval_message(message_id, interval),))


def _request_message(vehicle: CommandedVehicle, order: Order) -> Answer:
    message_id = order.number(1, -1)
    if message_id == m.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
        return _interval_of(vehicle, order.number(2, -1))
    if message_id == m.MAVLINK_MSG_ID_AVAILABLE_MODES:
        messages = _available_modes(vehicle.state.firmware.mavlink, order.number(2))
        return Answer(messages=messages) if messages else DENIED
    if message_id == m.MAVLINK_MSG_ID_COMPONENT_METADATA:
        messages = vehicle.metadata()
    else:
        if message_id in GIMBAL_BUILDERS:
            vehicle.state.gimbal.wake()
        messages = built(message_id, vehicle.state)
    known = message_id in BUILDERS and message_id not in GIMBAL_BUILDERS
    if messages or known:
        return Answer(messages=messages)
    # PX4's MavlinkReceiver::handle_request_message_command, ArduPilot's handle_command_request_message.
    return Answer(vehicle.state.firmware.mavlink.unknown_message_result)


def _capabilities(vehicle: CommandedVehicle, _order: Order) -> Answer:
    return Answer(messages=built(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION, vehicle.state))


def _protocol_version(vehicle: CommandedVehicle, _order: Order) -> Answer:
    return Answer(messages=built(m.MAVLINK_MSG_ID_PROTOCOL_VERSION, vehicle.state))


def _camera(vehicle: CommandedVehicle, order: Order) -> Answer:
    if not vehicle.has_camera:
        return UNSUPPORTED
    vehicle.command_camera(order.command, order.params)
    return ACCEPTED


def _reboot(vehicle: CommandedVehicle, order: Order) -> Answer:
    if vehicle.pilot.armed:
        return Answer(vehicle.state.firmware.mavlink.armed_reboot_result)
    if order.number(1) == 1:
        vehicle.reboot()
    return ACCEPTED


def _calibrate(vehicle: CommandedVehicle, order: Order) -> Answer:
    if vehicle.pilot.armed:
        msg = "Calibration refused: armed"
        raise RefusedError(msg, told=vehicle.state.firmware.mavlink.calibration_text)
    if order.number(1) == 1:
        vehicle.calibrate_gyro()
    return ACCEPTED


def _accept(_vehicle: CommandedVehicle, _order: Order) -> Answer:
    """Take an order that nothing here hangs on: actuators, the begin and end of a compass calibration."""
    return ACCEPTED


def _servo(vehicle: CommandedVehicle, order: Order) -> Answer:
    """DO_SET_SERVO: the outputs of the motors are not to be had."""
    channel = order.number(1)
    if not _FIRST_FREE_SERVO <= channel <= _LAST_SERVO:
        if 1 <= channel < _FIRST_FREE_SERVO:
            vehicle.say_warning(f"ServoRelayEvent: Channel {channel} is already in use")
        return FAILED
    return ACCEPTED


def _relay(_vehicle: CommandedVehicle, order: Order) -> Answer:
    """DO_SET_RELAY: there is one, number 0."""
    return ACCEPTED if order.number(1, -1) == 0 else FAILED


def _no_compass_result(_vehicle: CommandedVehicle, _order: Order) -> Answer:
    """DO_ACCEPT_MAG_CAL: a vehicle that nobody turns about has no result to accept."""
    return FAILED


def _run_checks(vehicle: CommandedVehicle, _order: Order) -> Answer:
    """Run the checks before arming, and say what fails."""
    if vehicle.pilot.armed:
        return Answer(m.MAV_RESULT_TEMPORARILY_REJECTED)
    problem = vehicle.pilot.arming.health_problem()
    if problem is not None:
        vehicle.say_warning(f"{vehicle.pilot.failsafe.rules.preflight}: {problem}")
    return ACCEPTED


HANDLERS: dict[int, Handler] = {
    m.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
    m.MAV_CMD_RUN_PREARM_CHECKS: _run_checks,
    m.MAV_CMD_DO_SET_MODE: _set_mode,
    m.MAV_CMD_DO_SET_STANDARD_MODE: _set_standard_mode,
    Command.NAV_TAKEOFF: _takeoff,
    Command.NAV_LAND: _mode(Mode.LAND),
    Command.NAV_RETURN_TO_LAUNCH: _mode(Mode.RTL),
    Command.NAV_LOITER_UNLIM: _mode(Mode.HOLD),
    m.MAV_CMD_DO_REPOSITION: _reposition,
    m.MAV_CMD_MISSION_START: _mission_start,
    m.MAV_CMD_DO_PAUSE_CONTINUE: _pause_continue,
    m.MAV_CMD_DO_SET_MISSION_CURRENT: _mission_current,
    Command.DO_CHANGE_SPEED: _change_speed,
    **dict.fromkeys(FLIGHT_COMMANDS, _flight_command),
    m.MAV_CMD_GET_HOME_POSITION: _get_home,
    m.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
    m.MAV_CMD_GET_MESSAGE_INTERVAL: _get_interval,
    m.MAV_CMD_REQUEST_MESSAGE: _request_message,
    m.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _capabilities,
    m.MAV_CMD_REQUEST_PROTOCOL_VERSION: _protocol_version,
    m.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
    m.MAV_CMD_PREFLIGHT_CALIBRATION: _calibrate,
    m.MAV_CMD_DO_SET_ACTUATOR: _accept,
    m.MAV_CMD_DO_SET_SERVO: _servo,
    m.MAV_CMD_DO_SET_RELAY: _relay,
    m.MAV_CMD_DO_START_MAG_CAL: _accept,
    m.MAV_CMD_DO_CANCEL_MAG_CAL: _accept,
    m.MAV_CMD_DO_ACCEPT_MAG_CAL: _no_compass_result,
    **dict.fromkeys(REGION_COMMANDS, _region),
    **dict.fromkeys(GIMBAL_COMMANDS, _gimbal),
    **dict.fromkeys(CAMERA_COMMANDS, _camera),
}
