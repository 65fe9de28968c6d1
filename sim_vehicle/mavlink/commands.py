"""Execution of COMMAND_LONG and COMMAND_INT, with a table of handlers by MAV_CMD.

To add a command, add a row to `HANDLERS`. A handler is a function that takes the vehicle and the command, and
returns a `Result` or raises RefusedError.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Protocol, TypeAlias

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import CommandMessage
from mission.model import RELATIVE_FRAMES, Command
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.execution.items import CAMERA_COMMANDS, ROI_COMMANDS
from sim_vehicle.execution.state import LandedState
from sim_vehicle.mavlink.vehicle_command import Result, VehicleCommand, read_command
from sim_vehicle.motion.legs import ALONG, Heading
from sim_vehicle.pilot.controls import RefusedError, Severity
from sim_vehicle.pilot.failsafe import FORCE

if TYPE_CHECKING:
    from sim_vehicle.autopilot.mavlink_profile import MavlinkProfile
    from sim_vehicle.mavlink.extras import VehicleExtra
    from sim_vehicle.mavlink.reports import Schedule
    from sim_vehicle.mavlink.wire_state import WireState
    from sim_vehicle.pilot.pilot import Pilot

# Maximum number of clients whose last command is remembered, as clients can change their address at will.
_MOST_PEERS = 256
_HEARTBEAT_US = 1e6
# Threshold of parameter 1 above which DO_FLIGHTTERMINATION terminates (common.xml).
_TERMINATE = 0.5
_ACCEPTED = m.MAV_RESULT_ACCEPTED
_DENIED = m.MAV_RESULT_DENIED
_FAILED = m.MAV_RESULT_FAILED
_UNSUPPORTED = m.MAV_RESULT_UNSUPPORTED


class CommandedVehicle(Protocol):
    """Interface through which command handlers use the vehicle."""

    pilot: Pilot
    state: WireState
    has_camera: bool
    extras: tuple[VehicleExtra, ...]
    builders: dict[int, Callable[[WireState], Message | None]]

    @property
    def schedule(self) -> Schedule:
        """Message intervals on the link over which the command came."""
        ...

    def command_camera(self, command: int, params: tuple[float, ...]) -> None:
        """Send a command to the camera."""

    def built(self, message_id: int) -> tuple[Message, ...]:
        """Return the message with this id for the present state; empty if there is none to send."""

    def is_ready(self, message_id: int) -> bool:
        """Return whether the vehicle and its extras can send this message, even if it is not due now."""

    def metadata(self) -> tuple[Message, ...]:
        """Return COMPONENT_METADATA messages; empty if there are none."""

    def on_home_moved(self) -> None:
        """Send the position of home."""

    def reboot(self) -> None:
        """Reboot the vehicle."""


Handler: TypeAlias = Callable[[CommandedVehicle, VehicleCommand], Result]


class CommandReceiver:
    """Receiver that executes and acknowledges commands; it executes a retried command only once."""

    def __init__(self, vehicle: CommandedVehicle) -> None:
        self._vehicle = vehicle
        self._last: dict[tuple[int, int], tuple[VehicleCommand, int]] = {}

    def receive(self, message: CommandMessage) -> list[Message]:
        """Execute COMMAND_LONG or COMMAND_INT; return the acknowledgement and further messages."""
        command = read_command(message)
        if command.id in self._vehicle.state.mavlink.silent:
            return []
        before = self._last.get(command.source)
        if command.again and before is not None and before[0].is_same(command):
            return [_acknowledgement(command, before[1])]
        result, messages = self._execute(command)
        if len(self._last) > _MOST_PEERS:
            self._last.clear()
        self._last[command.source] = (command, result)
        return [_acknowledgement(command, result), *messages]

    def _execute(self, command: VehicleCommand) -> tuple[int, tuple[Message, ...]]:
        """Execute a command; return the MAV_RESULT and the messages that follow the acknowledgement."""
        vehicle, profile = self._vehicle, self._vehicle.state.mavlink
        handlers = [extra.commands[command.id] for extra in vehicle.extras if command.id in extra.commands]
        if command.id in HANDLERS:
            handlers.append(partial(HANDLERS[command.id], vehicle))
        if not handlers or command.id in profile.unsupported:
            return _UNSUPPORTED, ()
        if command.long and command.id in profile.int_only:
            return m.MAV_RESULT_COMMAND_INT_ONLY, ()
        try:
            result = [handle(command) for handle in handlers][-1]
        except RefusedError as refusal:
            vehicle.pilot.warn(refusal.text)
            return _DENIED if refusal.denied else profile.refused_result, ()
        return (result, ()) if isinstance(result, int) else (_ACCEPTED, result or ())


def _acknowledgement(command: VehicleCommand, result: int) -> Message:
    return m.MAVLink_command_ack_message(command.id, result, 0, 0, *command.source)


# Modes


def set_custom_mode(vehicle: CommandedVehicle, number: int) -> None:
    """Enter the mode with this custom mode number; raises RefusedError if the vehicle cannot enter it now."""
    modes = vehicle.state.mavlink.modes
    mode = modes.mode_of(number)
    if mode is Mode.FLIP and vehicle.state.custom_mode not in modes.flips_from:
        text = modes.refusal(number)
        raise RefusedError(text, text=text)
    if number in modes.unready:
        vehicle.pilot.warn(modes.unready[number][1])
        text = modes.refusal(number)
        raise RefusedError(text, text=text)
    if mode is None and modes.ignores(number):
        return
    if mode is None:
        text = modes.unknown_text.format(number)
        raise RefusedError(text, text=text)
    enter_mode(vehicle.state, mode, number)
    vehicle.state.name_mode(number)


def enter_mode(state: WireState, mode: Mode, number: int) -> None:
    """Enter a mode, or refuse it with the firmware's text for the custom mode `number`."""
    with _refused_as(state, number):
        state.pilot.set_mode(mode)


@contextmanager
def _refused_as(state: WireState, number: int | None) -> Iterator[None]:
    """Give refusals the firmware's text for the custom mode `number`; None leaves the refusals unchanged."""
    try:
        yield
    except RefusedError as refusal:
        if number is None:
            raise
        text = state.mavlink.modes.refusal(number, has_position=state.pilot.position_ok)
        raise RefusedError(str(refusal), denied=refusal.denied, text=text) from None


def _mode(mode: Mode) -> Handler:
    def handler(vehicle: CommandedVehicle, _command: VehicleCommand) -> None:
        number = vehicle.state.mavlink.modes[mode]
        enter_mode(vehicle.state, mode, number)
        vehicle.state.name_mode(number)

    return handler


def _set_mode(vehicle: CommandedVehicle, command: VehicleCommand) -> None:
    if not command.number(1) & m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED or not math.isfinite(command.params[1]):
        raise RefusedError("Mode refused: only custom modes are supported", denied=True)
    modes = vehicle.state.mavlink.modes
    set_custom_mode(vehicle, modes.custom_mode_of(command.number(2), command.number(3)))


def _available_modes(profile: MavlinkProfile, index: int) -> tuple[Message, ...]:
    """Return AVAILABLE_MODES for the mode with an index from 1, or for all modes if the index is 0."""
    modes = list(profile.modes.numbers.items())
    return tuple(
        m.MAVLink_available_modes_message(len(modes), i, 0, number, 0, mode.value.encode())
        for i, (mode, number) in enumerate(modes, 1)
        if index in (0, i)
    )


# Flight


def _arm(vehicle: CommandedVehicle, command: VehicleCommand) -> Result:
    arm, force = command.params[0], command.number(2) == FORCE
    if arm not in (0.0, 1.0):
        vehicle.pilot.warn(vehicle.state.mavlink.refusals.arming.format(arm))
        return _UNSUPPORTED
    (vehicle.pilot.arm if arm else vehicle.pilot.disarm)(force=force)
    return None


def _run_checks(vehicle: CommandedVehicle, _command: VehicleCommand) -> Result:
    """Run the pre-arm checks, and warn if one fails."""
    if vehicle.pilot.armed:
        return m.MAV_RESULT_TEMPORARILY_REJECTED
    problem = vehicle.pilot.arming.health_problem()
    if problem is not None:
        vehicle.pilot.warn(f"{vehicle.pilot.rules.preflight}: {problem}")
    return None


def _takeoff(vehicle: CommandedVehicle, command: VehicleCommand) -> Result:
    pilot, modes, profile = vehicle.pilot, vehicle.state.mavlink.modes, vehicle.state.firmware.profile
    altitude, known = command.params[6], modes.takes_off_from
    if profile.takeoff_needs_arming and not pilot.armed:
        return _FAILED
    if known and (vehicle.state.custom_mode not in known or pilot.landed is not LandedState.ON_GROUND):
        return _FAILED
    frame = command.frame if profile.takeoff_above_sea else int(m.MAV_FRAME_GLOBAL_RELATIVE_ALT)
    altitude = vehicle.state.above_start(altitude, frame)
    if not altitude > 0.0:
        altitude = pilot.spec.takeoff_altitude_m
    number = modes[Mode.TAKEOFF]
    with _refused_as(vehicle.state, None if number == modes[Mode.GUIDED] else number):
        pilot.takeoff(altitude)
    return None


def _reposition(vehicle: CommandedVehicle, command: VehicleCommand) -> None:
    position = command.position
    if position is None or command.frame not in (vehicle.state.firmware.profile.frames or (0, 3)):
        raise RefusedError("Reposition refused: the command has no global position", denied=True)
    pilot = vehicle.pilot
    altitude = vehicle.state.above_start(command.params[6], command.frame)
    if math.isnan(altitude):
        altitude = pilot.state.position_m[2]
    # Unlike mission items, DO_REPOSITION gives the heading in radians.
    speed, yaw_rad = command.params[0], command.params[3]
    turns = math.isfinite(yaw_rad) and vehicle.state.mavlink.reposition_turns
    pilot.goto(
        *position,
        altitude,
        mode=vehicle.state.mavlink.modes.after_command,
        heading=Heading.fixed(yaw_rad) if turns else ALONG,
        speed_m_s=speed if speed > 0.0 and math.isfinite(speed) else None,
    )


def _change_speed(vehicle: CommandedVehicle, command: VehicleCommand) -> Result:
    if command.number(1) not in (0, 1):
        return _UNSUPPORTED
    if command.params[1] != -1.0:
        vehicle.pilot.set_speed(command.params[1])
    return None


def _region(vehicle: CommandedVehicle, command: VehicleCommand) -> None:
    """Execute DO_SET_ROI_LOCATION etc.: point the nose at a position, or stop pointing if it is 0, 0."""
    if command.id == Command.DO_SET_ROI_NONE or command.params[4:6] == (0.0, 0.0):
        vehicle.pilot.look_at(None)
    elif command.position is None or command.frame not in (0, *RELATIVE_FRAMES):
        raise RefusedError("Region of interest refused: the command has no global position", denied=True)
    else:
        vehicle.pilot.look_at(*command.position)


def _camera(vehicle: CommandedVehicle, command: VehicleCommand) -> Result:
    if not vehicle.has_camera:
        return _UNSUPPORTED
    vehicle.command_camera(command.id, command.params)
    return None


def _fence_enable(vehicle: CommandedVehicle, command: VehicleCommand) -> None:
    """Execute ArduPilot's DO_FENCE_ENABLE: 0 disables the fence, 1 and 2 (without the floor) enable it."""
    kind = command.number(1, -1)
    if kind not in (0, 1, 2):
        raise RefusedError(f"Fence refused: parameter 1 is {command.params[0]:g}, not 0 to 2", denied=True)
    vehicle.pilot.parameters.fence_enable = int(kind > 0)
    vehicle.pilot.apply_parameters()


def _terminate(vehicle: CommandedVehicle, command: VehicleCommand) -> None:
    if command.params[0] > _TERMINATE:
        vehicle.pilot.terminate("by command")


def _set_home(vehicle: CommandedVehicle, command: VehicleCommand) -> None:
    """Execute DO_SET_HOME: set home here if parameter 1 is 1, else at a position; PX4's altitude is AMSL."""
    pilot, state = vehicle.pilot, vehicle.state
    x, y, up = pilot.state.position_m
    position = pilot.frame.to_wgs84(x, y)
    # ArduPilot takes a zero position for the present position (``handle_command_do_set_home``).
    here = command.params[0] == 1.0 or not (state.mavlink.home_above_sea or any(command.params[4:6]))
    if not here:
        if command.position is None or not math.isfinite(command.params[6]):
            raise RefusedError("Home refused: the command has no position", denied=True)
        position = command.position
        frame = int(m.MAV_FRAME_GLOBAL) if state.mavlink.home_above_sea else command.frame
        up = state.above_start(command.params[6], frame)
    pilot.set_home(*position, up)
    vehicle.on_home_moved()


# Mission


def _mission_start(vehicle: CommandedVehicle, command: VehicleCommand) -> None:
    pilot, first = vehicle.pilot, command.number(1)
    restarts = first == 0 < pilot.mission.current_seq and not pilot.behaviour.start_resumes
    with _refused_as(vehicle.state, vehicle.state.mavlink.modes[Mode.MISSION]):
        if (reason := pilot.mission.why_not) is not None:
            raise RefusedError(f"Mission start refused: {reason}")
        pilot.start_mission(vehicle.state.own_seq(first) if first > 0 or restarts else None)


def _land_start(vehicle: CommandedVehicle, _command: VehicleCommand) -> None:
    """Execute DO_LAND_START: continue the mission at the start of its landing."""
    seq = vehicle.pilot.executor.mission.landing_start()
    if seq is None:
        text = vehicle.state.mavlink.refusals.landing
        raise RefusedError("Land start refused: the mission has no landing start", text=text)
    vehicle.pilot.set_current(seq)
    vehicle.pilot.set_mode(Mode.MISSION)


def _pause_continue(vehicle: CommandedVehicle, command: VehicleCommand) -> None:
    if command.params[0] not in (0.0, 1.0):
        raise RefusedError(f"Pause refused: parameter 1 is {command.params[0]:g}, not 0 or 1", denied=True)
    if command.params[0]:
        vehicle.pilot.resume()
    else:
        vehicle.pilot.pause()


def _set_current(vehicle: CommandedVehicle, command: VehicleCommand) -> Result:
    seq = command.number(1, -1)
    if command.number(2) == 1 and seq < 0:
        vehicle.pilot.set_current(0)
    elif seq >= 0:
        vehicle.pilot.set_current(vehicle.state.own_seq(seq))
    return vehicle.built(m.MAVLINK_MSG_ID_MISSION_CURRENT)


# Messages


def _send(message_id: int) -> Handler:
    return lambda vehicle, _command: vehicle.built(message_id)


def _set_interval(vehicle: CommandedVehicle, command: VehicleCommand) -> Result:
    message_id, interval = command.number(1, -1), command.params[1]
    if message_id not in vehicle.builders:
        vehicle.pilot.warn(vehicle.state.mavlink.refusals.interval.format(message_id))
        return _DENIED
    if math.isnan(interval) or abs(interval) > 1e10:
        return _DENIED
    if message_id == m.MAVLINK_MSG_ID_HEARTBEAT and not 0.0 <= interval <= _HEARTBEAT_US:
        # Clients lose the connection to a vehicle without heartbeats.
        return _DENIED
    for extra in vehicle.extras:
        extra.requested(message_id)
    vehicle.schedule.set_interval(message_id, int(interval), vehicle.state.now_us)
    return None


def _interval_of(vehicle: CommandedVehicle, message_id: int) -> Result:
    if not 0 <= message_id <= 65535:
        return _DENIED
    interval = vehicle.schedule.interval_us(message_id) if message_id in vehicle.builders else 0
    return (m.MAVLink_message_interval_message(message_id, interval),)


def _request_message(vehicle: CommandedVehicle, command: VehicleCommand) -> Result:
    message_id = command.number(1, -1)
    if message_id == m.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
        return _interval_of(vehicle, command.number(2, -1))
    if message_id == m.MAVLINK_MSG_ID_AVAILABLE_MODES:
        return _available_modes(vehicle.state.mavlink, command.number(2)) or _DENIED
    if message_id == m.MAVLINK_MSG_ID_COMPONENT_METADATA:
        messages = vehicle.metadata()
    else:
        for extra in vehicle.extras:
            extra.requested(message_id)
        messages = vehicle.built(message_id)
    if messages or vehicle.is_ready(message_id):
        return messages
    # PX4's handle_request_message_command and ArduPilot's handle_command_request_message return this result.
    return vehicle.state.mavlink.unknown_message_result


# Preflight


def _reboot(vehicle: CommandedVehicle, command: VehicleCommand) -> Result:
    if vehicle.pilot.armed:
        return vehicle.state.mavlink.armed_reboot_result
    if command.number(1) == 1:
        vehicle.reboot()
    return None if command.number(1) in (0, 1) else _UNSUPPORTED


HANDLERS: dict[int, Handler] = {
    m.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
    m.MAV_CMD_RUN_PREARM_CHECKS: _run_checks,
    m.MAV_CMD_DO_SET_MODE: _set_mode,
    Command.NAV_TAKEOFF: _takeoff,
    Command.NAV_LAND: _mode(Mode.LAND),
    Command.NAV_RETURN_TO_LAUNCH: _mode(Mode.RTL),
    Command.NAV_LOITER_UNLIM: _mode(Mode.HOLD),
    m.MAV_CMD_DO_REPOSITION: _reposition,
    Command.DO_CHANGE_SPEED: _change_speed,
    m.MAV_CMD_DO_FENCE_ENABLE: _fence_enable,
    m.MAV_CMD_DO_FLIGHTTERMINATION: _terminate,
    Command.DO_SET_HOME: _set_home,
    m.MAV_CMD_MISSION_START: _mission_start,
    Command.DO_LAND_START: _land_start,
    m.MAV_CMD_DO_PAUSE_CONTINUE: _pause_continue,
    m.MAV_CMD_DO_SET_MISSION_CURRENT: _set_current,
    m.MAV_CMD_DO_SEND_BANNER: lambda vehicle, _: vehicle.pilot.note(
        Severity.INFO, vehicle.state.mavlink.identity.banner
    ),
    m.MAV_CMD_GET_HOME_POSITION: _send(m.MAVLINK_MSG_ID_HOME_POSITION),
    m.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _send(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
    m.MAV_CMD_REQUEST_PROTOCOL_VERSION: _send(m.MAVLINK_MSG_ID_PROTOCOL_VERSION),
    m.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
    m.MAV_CMD_GET_MESSAGE_INTERVAL: lambda vehicle, command: _interval_of(vehicle, command.number(1, -1)),
    m.MAV_CMD_REQUEST_MESSAGE: _request_message,
    m.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
    **dict.fromkeys(ROI_COMMANDS, _region),
    **dict.fromkeys(CAMERA_COMMANDS, _camera),
}
