"""COMMAND_LONG and COMMAND_INT: one table, MAV_CMD to what the vehicle does and answers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from mission.link.codec.frames import Message
from mission.model import RELATIVE_FRAMES, Command
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.mavlink.camera_commands import CAMERA_COMMANDS
from sim_vehicle.mavlink.flight_commands import FLIGHT_ORDERS
from sim_vehicle.motion.legs import ALONG, Heading
from sim_vehicle.pilot.arming import FORCE
from sim_vehicle.pilot.notices import RefusedError

if TYPE_CHECKING:
    from sim_vehicle.mavlink.vehicle import SimVehicle

__all__ = ["HANDLERS", "Answer", "Order", "execute", "order_of"]

_ASKING = frozenset(range(521, 529))
_INT_FRAMES = {5: 0, 6: 3, 11: 10}
_STANDARD_MODES = {
    1: Mode.HOLD,
    4: Mode.ALTITUDE,
    5: Mode.RTL,
    6: Mode.MISSION,
    7: Mode.LAND,
    8: Mode.TAKEOFF,
}


@dataclass(frozen=True, slots=True)
class Order:
    """A command as it came, long or int.

    Parameters
    ----------
    command : int
        MAV_CMD.
    params : tuple of 7 floats
        Parameters 1 to 7; a place's latitude and longitude are degrees.
    frame : int
        MAV_FRAME, without the INT variants; COMMAND_LONG has GLOBAL.
    source : tuple of int
        System and component of the sender.
    again : bool
        The sender repeats a command that it had no answer to.
    long : bool
        It came as COMMAND_LONG, with places in 32-bit floats.
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
    def place(self) -> tuple[float, float] | None:
        """Latitude and longitude, None when none is given."""
        latitude, longitude = self.params[4:6]
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0) or latitude == longitude == 0.0:
            return None
        return latitude, longitude


@dataclass(frozen=True, slots=True)
class Answer:
    """What follows a command.

    Parameters
    ----------
    result : int
        MAV_RESULT of the acknowledgement.
    messages : tuple
        Sent after the acknowledgement.
    """

    result: int = int(m.MAV_RESULT_ACCEPTED)
    messages: tuple[Message, ...] = ()


Handler = Callable[["SimVehicle", Order], Answer]
ACCEPTED = Answer()
UNSUPPORTED = Answer(int(m.MAV_RESULT_UNSUPPORTED))
DENIED = Answer(int(m.MAV_RESULT_DENIED))
FAILED = Answer(int(m.MAV_RESULT_FAILED))
INT_ONLY = Answer(int(m.MAV_RESULT_COMMAND_INT_ONLY))


def order_of(message: Message) -> Order:
    """Read COMMAND_LONG or COMMAND_INT."""
    source = (message.get_srcSystem(), message.get_srcComponent())
    first = (message.param1, message.param2, message.param3, message.param4)
    if type(message).id == m.MAVLINK_MSG_ID_COMMAND_LONG:
        params = (*first, message.param5, message.param6, message.param7)
        return Order(message.command, params, 0, source, message.confirmation > 0, True)
    frame = _INT_FRAMES.get(message.frame, message.frame)
    scale = 1e-7 if frame in (0, 3, 10) else 1.0
    params = (*first, message.x * scale, message.y * scale, message.z)
    return Order(message.command, params, frame, source, False)


def execute(vehicle: SimVehicle, order: Order) -> tuple[Answer, str]:
    """Do a command; returns the answer and, when it was refused, the reason."""
    handler = HANDLERS.get(order.command)
    if handler is None or order.command in vehicle.firmware.persona.unsupported:
        asks = order.command in _ASKING  # peers ask for what may not be there; that is no order
        return UNSUPPORTED, "" if asks else f"Command {order.command} refused: not supported"
    if order.long and order.command in vehicle.firmware.persona.int_only:
        return INT_ONLY, f"Command {order.command} refused: send COMMAND_INT"
    try:
        return handler(vehicle, order), ""
    except RefusedError as refusal:
        return (DENIED if refusal.denied else Answer(vehicle.firmware.persona.refused_result)), str(refusal)


def _arm(vehicle: SimVehicle, order: Order) -> Answer:
    arm, force = order.params[0], order.number(2) == FORCE
    if arm not in (0.0, 1.0):
        msg = f"Arming refused: parameter 1 is {arm:g}"
        raise RefusedError(msg, denied=True)
    if arm:
        vehicle.pilot.arm(force=force)
    else:
        vehicle.pilot.disarm(force=force)
    return ACCEPTED


def _set_mode(vehicle: SimVehicle, order: Order) -> Answer:
    if not order.number(1) & m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        msg = "Mode refused: only custom modes are known"
        raise RefusedError(msg, denied=True)
    vehicle.set_custom_mode(vehicle.firmware.persona.modes.custom_mode_of(order.number(2), order.number(3)))
    return ACCEPTED


def _set_standard_mode(vehicle: SimVehicle, order: Order) -> Answer:
    mode = _STANDARD_MODES.get(order.number(1))
    if mode is None:
        return UNSUPPORTED
    vehicle.pilot.set_mode(mode)
    return ACCEPTED


def _takeoff(vehicle: SimVehicle, order: Order) -> Answer:
    pilot = vehicle.pilot
    altitude = order.params[6]
    if vehicle.firmware.persona.takeoff_needs_arming and not pilot.armed:
        vehicle.say_warning("Takeoff refused: not armed")
        return FAILED
    if vehicle.firmware.persona.takeoff_above_sea and order.frame not in RELATIVE_FRAMES:
        altitude -= vehicle.home.altitude_m
    if not altitude > 0.0:
        altitude = pilot.spec.takeoff_altitude_m
    pilot.takeoff(altitude)
    return ACCEPTED


def _mode(mode: Mode) -> Handler:
    def handler(vehicle: SimVehicle, _order: Order) -> Answer:
        vehicle.pilot.set_mode(mode)
        return ACCEPTED

    handler.__doc__ = f"Take the {mode.value} mode."
    return handler


def _reposition(vehicle: SimVehicle, order: Order) -> Answer:
    place = order.place
    if place is None or order.frame not in (0, 3):
        msg = "Reposition refused: no place"
        raise RefusedError(msg, denied=True)
    pilot = vehicle.pilot
    altitude = order.params[6] - (0.0 if order.frame in RELATIVE_FRAMES else vehicle.home.altitude_m)
    if math.isnan(altitude):
        altitude = pilot.state.position_m[2]
    # The heading is in radians here, other than in mission items.
    speed, yaw_rad = order.params[0], order.params[3]
    looks = math.isfinite(yaw_rad) and vehicle.firmware.persona.reposition_turns
    pilot.goto(
        *place,
        altitude,
        mode=vehicle.firmware.persona.modes.after_command,
        heading=Heading.fixed(yaw_rad) if looks else ALONG,
        speed_m_s=speed if speed > 0.0 and math.isfinite(speed) else None,
    )
    return ACCEPTED


def _mission_start(vehicle: SimVehicle, order: Order) -> Answer:
    first = order.number(1)
    reason = vehicle.pilot.mission.why_not
    if reason is not None:
        msg = f"Mission start refused: {reason}"
        raise RefusedError(msg)
    if first > 0:
        vehicle.pilot.set_current(vehicle.own_seq(first))
    vehicle.pilot.set_mode(Mode.MISSION)
    return ACCEPTED


def _pause_continue(vehicle: SimVehicle, order: Order) -> Answer:
    if order.params[0] not in (0.0, 1.0):
        msg = f"Pause refused: parameter 1 is {order.params[0]:g}"
        raise RefusedError(msg, denied=True)
    if order.params[0]:
        vehicle.pilot.resume()
    else:
        vehicle.pilot.pause()
    return ACCEPTED


def _mission_current(vehicle: SimVehicle, order: Order) -> Answer:
    seq = order.number(1, -1)
    if order.number(2) == 1 and seq < 0:
        vehicle.pilot.set_current(0)
    elif seq >= 0:
        vehicle.pilot.set_current(vehicle.own_seq(seq))
    return Answer(messages=vehicle.built(m.MAVLINK_MSG_ID_MISSION_CURRENT))


def _change_speed(vehicle: SimVehicle, order: Order) -> Answer:
    if order.number(1) not in (0, 1):
        return UNSUPPORTED
    if order.params[1] != -1.0:
        vehicle.pilot.set_speed(order.params[1])
    return ACCEPTED


def _flight_order(vehicle: SimVehicle, order: Order) -> Answer:
    FLIGHT_ORDERS[order.command](vehicle, order)
    return ACCEPTED


def _get_home(vehicle: SimVehicle, _order: Order) -> Answer:
    return Answer(messages=vehicle.built(m.MAVLINK_MSG_ID_HOME_POSITION))


def _set_interval(vehicle: SimVehicle, order: Order) -> Answer:
    message_id, interval = order.number(1, -1), order.params[1]
    if message_id not in vehicle.builders or math.isnan(interval) or abs(interval) > 1e10:
        msg = f"Interval of message {message_id} refused"
        raise RefusedError(msg, denied=True)
    vehicle.schedule.set_interval(message_id, int(interval), vehicle.now_us)
    return ACCEPTED


def _get_interval(vehicle: SimVehicle, order: Order) -> Answer:
    return _interval_of(vehicle, order.number(1, -1))


def _interval_of(vehicle: SimVehicle, message_id: int) -> Answer:
    if not 0 <= message_id <= 65535:
        msg = f"Interval of message {message_id} refused"
        raise RefusedError(msg, denied=True)
    known = message_id in vehicle.builders
    interval = vehicle.schedule.interval_us(message_id) if known else 0
    return Answer(messages=(m.MAVLink_message_interval_message(message_id, interval),))


def _request_message(vehicle: SimVehicle, order: Order) -> Answer:
    message_id = order.number(1, -1)
    if message_id == m.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
        return _interval_of(vehicle, order.number(2, -1))
    if message_id == m.MAVLINK_MSG_ID_AVAILABLE_MODES:
        messages = vehicle.available_modes(order.number(2))
        return Answer(messages=messages) if messages else DENIED
    messages = vehicle.built(message_id)
    return Answer(messages=messages) if messages else UNSUPPORTED


def _capabilities(vehicle: SimVehicle, _order: Order) -> Answer:
    return Answer(messages=vehicle.built(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION))


def _protocol_version(vehicle: SimVehicle, _order: Order) -> Answer:
    return Answer(messages=vehicle.built(m.MAVLINK_MSG_ID_PROTOCOL_VERSION))


def _camera(vehicle: SimVehicle, order: Order) -> Answer:
    if not vehicle.has_camera:
        return UNSUPPORTED
    vehicle.command_camera(order.command, order.params)
    return ACCEPTED


def _reboot(vehicle: SimVehicle, order: Order) -> Answer:
    if vehicle.pilot.armed:
        msg = "Reboot refused: armed"
        raise RefusedError(msg)
    if order.number(1) == 1:
        vehicle.reboot()
    return ACCEPTED


def _calibrate(vehicle: SimVehicle, _order: Order) -> Answer:
    if vehicle.pilot.armed:
        msg = "Calibration refused: armed"
        raise RefusedError(msg)
    return ACCEPTED


HANDLERS: dict[int, Handler] = {
    m.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
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
    **dict.fromkeys(FLIGHT_ORDERS, _flight_order),
    m.MAV_CMD_GET_HOME_POSITION: _get_home,
    m.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
    m.MAV_CMD_GET_MESSAGE_INTERVAL: _get_interval,
    m.MAV_CMD_REQUEST_MESSAGE: _request_message,
    m.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _capabilities,
    m.MAV_CMD_REQUEST_PROTOCOL_VERSION: _protocol_version,
    m.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
    m.MAV_CMD_PREFLIGHT_CALIBRATION: _calibrate,
    **dict.fromkeys(CAMERA_COMMANDS, _camera),
}
