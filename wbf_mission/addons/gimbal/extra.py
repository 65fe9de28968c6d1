"""Gimbal of the camera, as an extra of the simulated vehicle.

The autopilot is the gimbal manager (gimbal protocol v2) of gimbal device 1; the device itself is not a
MAVLink component. The older mount messages are also supported. Parameters, modes and limits follow
ArduPilot's ``AP_Mount.cpp``, ``AP_Mount_Backend.cpp`` and ``AP_Mount_Servo.cpp``; answers are recorded from
ArduCopter 4.7 in SITL with ``MNT1_TYPE`` 1. The simulated gimbal stabilises roll and pitch to the horizon and
yaw to the vehicle, at limited rates.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple, get_args

from geo.frame import angles_of, quaternion_of
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from mission.model import Command
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.parameters import RuntimeParameters, Setting
from sim_vehicle.execution.items import ROI_COMMANDS
from sim_vehicle.mavlink.extras import VehicleExtra
from sim_vehicle.mavlink.vehicle_command import Result, VehicleCommand

if TYPE_CHECKING:
    from sim_vehicle.execution.state import VehicleState
    from sim_vehicle.mavlink.parameters import ParameterSet
    from sim_vehicle.mavlink.plan_receiver import PlanReceiver
    from sim_vehicle.mavlink.wire_state import WireState

RATE_RAD_S = math.radians(60.0)
"""Maximum rate of each axis."""
_DEGREE = math.radians(1.0)


def _settings(**defaults_deg: float) -> tuple[Setting, ...]:
    return tuple(Setting(f"MNT1_{name}", default, _DEGREE) for name, default in defaults_deg.items())


_LOW = _settings(ROLL_MIN=-30.0, PITCH_MIN=-90.0, YAW_MIN=-180.0)
_HIGH = _settings(ROLL_MAX=30.0, PITCH_MAX=20.0, YAW_MAX=180.0)
# A mapping camera points straight down at rest.
_NEUTRAL = _settings(NEUTRAL_X=0.0, NEUTRAL_Y=-90.0, NEUTRAL_Z=0.0)
_RETRACTED = _settings(RETRACT_X=0.0, RETRACT_Y=0.0, RETRACT_Z=0.0)
_DEFAULT_MODE = Setting("MNT1_DEFLT_MODE", 1.0)
# Number of attitudes that are kept to look up an image's attitude later: 10 s at 50 steps per second.
_REMEMBERED = 512
_TURN = 2.0 * math.pi

Angles = tuple[float, float, float]


class GimbalMode(IntEnum):
    """Gimbal mode, with the values of MAV_MOUNT_MODE."""

    RETRACT = 0
    NEUTRAL = 1
    TARGET = 2
    """Angles or rates from a client."""
    STICKS = 3
    """Control by sticks; without sticks, each angle is in the middle of its range."""
    POINT = 4
    HOME = 6


_MODES = frozenset(int(mode) for mode in GimbalMode)


class Attitude(NamedTuple):
    """Camera attitude: roll and pitch (up is positive) relative to the horizon, and compass heading."""

    roll_rad: float
    pitch_rad: float
    heading_rad: float


class Gimbal:
    """Three-axis gimbal.

    The gimbal is fitted if the vehicle's parameter `fitting` is above 0 at boot. If `fitting` is None, the
    gimbal is never fitted.

    >>> from types import SimpleNamespace
    >>> gimbal = Gimbal(SimpleNamespace(kept=lambda name, default: default), Setting("MNT1_TYPE", 1.0))
    >>> gimbal.turn_to((0.0, -0.5, 3.0), earth=False)
    >>> state = SimpleNamespace(time_s=1.0, yaw_rad=0.0, position_m=(0.0, 0.0, 30.0))
    >>> gimbal.advance(state, 1_000_000, (0.0, 0.0))
    >>> [round(math.degrees(angle), 1) for angle in gimbal.angles_rad]
    [0.0, -30.0, 60.0]
    """

    def __init__(self, parameters: RuntimeParameters, fitting: Setting | None = None) -> None:
        self._parameters = parameters
        self._fitting = fitting
        self._time_s = 0.0
        self._point: tuple[float, float, float] | None = None
        self._track: deque[tuple[float, Attitude]] = deque(maxlen=_REMEMBERED)
        self.boot()

    def boot(self) -> None:
        """Reset the gimbal: it rests in the default mode."""
        self.fitted = self._fitting is not None and self._fitting.of(self._parameters) > 0.0
        # Whether sticks control the yaw relative to north instead of relative to the vehicle.
        self.yaw_lock = False
        # System and component id of the client in control, 0 for none; other clients may still send commands.
        self.controller = (0, 0)
        self._point = None
        self.to_default()
        self._target: Angles = self._resting()
        self._rates: Angles | None = None
        self._earth = self._rates_earth = False
        self.angles_rad = self._limited(self._target)
        self._track.clear()
        # A neutral gimbal is not simulated until the first order or request after boot.
        self.awake = self.mode is not GimbalMode.NEUTRAL

    @property
    def limits_rad(self) -> tuple[tuple[float, float], ...]:
        """Minimum and maximum of roll, pitch, and yaw relative to the vehicle."""
        kept = self._parameters
        return tuple((low.of(kept), high.of(kept)) for low, high in zip(_LOW, _HIGH, strict=True))

    @property
    def locks_yaw(self) -> bool:
        """Whether the gimbal keeps its compass heading when the vehicle turns."""
        if self.mode is GimbalMode.TARGET:
            return self._earth
        if self.mode is GimbalMode.STICKS:
            return self.yaw_lock
        return self.mode in (GimbalMode.POINT, GimbalMode.HOME)

    def wake(self) -> None:
        """Start the simulation of the gimbal on a client's first request."""
        self.awake = self.fitted

    def set_mode(self, number: int) -> bool:
        """Set a mode by its number; return whether the mode exists."""
        if number not in _MODES:
            return False
        self.mode = GimbalMode(number)
        self.wake()
        return True

    def to_default(self) -> None:
        """Set the default mode."""
        number = _DEFAULT_MODE.of(self._parameters)
        self.mode = GimbalMode(int(number)) if number in _MODES else GimbalMode.NEUTRAL

    def turn_to(self, angles_rad: Sequence[float], *, earth: bool) -> None:
        """Turn to finite roll, pitch and yaw; yaw is relative to north if `earth`, else to the nose."""
        roll, pitch, yaw = angles_rad
        if not earth and yaw > math.pi:
            yaw -= _TURN
        self._target = self._limited((roll, pitch, yaw), earth=earth)
        self._rates, self._earth = None, earth
        self.set_mode(GimbalMode.TARGET)

    def turn_at(self, rates_rad_s: Sequence[float], *, earth: bool) -> None:
        """Turn at finite rates of roll, pitch and yaw, starting from the present target."""
        roll, pitch, yaw = rates_rad_s
        self._rates = (roll, pitch, yaw)
        self._rates_earth = earth
        self.set_mode(GimbalMode.TARGET)

    def point_at(self, position_m: tuple[float, float, float] | None) -> None:
        """Track a position (east, north, up) while the vehicle moves; None ends the tracking."""
        self._point = position_m
        if position_m is not None:
            self.set_mode(GimbalMode.POINT)
        elif self.mode is GimbalMode.POINT:
            self.to_default()

    def advance(self, state: VehicleState, boot_us: float, home_m: tuple[float, float, float]) -> None:
        """Advance the gimbal to the vehicle's time; `boot_us` is the time since boot."""
        passed_s, self._time_s = max(0.0, state.time_s - self._time_s), state.time_s
        if not self.awake:
            return
        target = self._aim(state, home_m, passed_s)
        if target is not None:
            most = RATE_RAD_S * passed_s
            roll, pitch, yaw = (
                now + min(max(there - now, -most), most)
                for now, there in zip(self.angles_rad, self._limited(target), strict=True)
            )
            self.angles_rad = (roll, pitch, yaw)
        self._track.append((boot_us, self._attitude(state.yaw_rad)))

    def attitude_at(self, boot_us: float) -> Attitude | None:
        """Return the camera attitude at a time since boot; None if the gimbal was not yet awake."""
        after = None
        for time_us, attitude in reversed(self._track):
            if time_us > boot_us:
                after = time_us, attitude
                continue
            if after is None or after[0] == time_us:
                return attitude
            part = (boot_us - time_us) / (after[0] - time_us)
            roll, pitch, heading = (
                a + part * math.remainder(b - a, _TURN) for a, b in zip(attitude, after[1], strict=True)
            )
            return Attitude(roll, pitch, heading % _TURN)
        # Before it is awake, the gimbal is at rest.
        return None

    def _attitude(self, heading_rad: float) -> Attitude:
        roll, pitch, yaw = self.angles_rad
        return Attitude(roll, pitch, (heading_rad + yaw) % _TURN)

    def _aim(self, state: VehicleState, home_m: tuple[float, float, float], passed_s: float) -> Angles | None:
        """Return the present target with yaw relative to the vehicle; None keeps the present angles."""
        if self.mode is GimbalMode.TARGET:
            self._follow_rates(state.yaw_rad, passed_s)
            roll, pitch, yaw = self._target
            return (roll, pitch, self._to_body(yaw, state.yaw_rad) if self._earth else yaw)
        if self.mode in (GimbalMode.POINT, GimbalMode.HOME):
            point = home_m if self.mode is GimbalMode.HOME else self._point
            if point is None:
                return None
            east, north, up = (there - here for there, here in zip(point, state.position_m, strict=True))
            yaw = self._to_body(math.atan2(east, north), state.yaw_rad)
            aim = (0.0, math.atan2(up, math.hypot(east, north)), yaw)
        elif self.mode is GimbalMode.STICKS:
            roll, pitch, yaw = (0.5 * (low + high) for low, high in self.limits_rad)
            aim = (roll, pitch, self._to_body(0.0, state.yaw_rad) if self.yaw_lock else yaw)
        else:
            aim = self._resting()
        # If rates are commanded later, they start from this target.
        self._target, self._earth = aim, False
        return aim

    def _follow_rates(self, heading_rad: float, passed_s: float) -> None:
        """Move the target at the commanded rates."""
        if self._rates is None:
            return
        roll, pitch, yaw = self._target
        if self._earth != self._rates_earth:
            yaw += heading_rad if self._rates_earth else -heading_rad
            yaw, self._earth = math.remainder(yaw, _TURN), self._rates_earth
        roll, pitch, yaw = (
            angle + rate * passed_s for angle, rate in zip((roll, pitch, yaw), self._rates, strict=True)
        )
        self._target = self._limited((roll, pitch, yaw), earth=self._earth)

    def _resting(self) -> Angles:
        settings = _RETRACTED if self.mode is GimbalMode.RETRACT else _NEUTRAL
        roll, pitch, yaw = (setting.of(self._parameters) for setting in settings)
        return roll, pitch, yaw

    def _limited(self, angles: Angles, *, earth: bool = False) -> Angles:
        """Return the angles clipped to the limits; a yaw relative to north is wrapped, but not clipped."""
        roll, pitch, yaw = (
            max(low, min(angle, high)) for angle, (low, high) in zip(angles, self.limits_rad, strict=True)
        )
        return roll, pitch, math.remainder(angles[2], _TURN) if earth else yaw

    @staticmethod
    def _to_body(yaw_rad: float, heading_rad: float) -> float:
        return math.remainder(yaw_rad - heading_rad, _TURN)


_DEVICE = 1
_FAILED = m.MAV_RESULT_FAILED
_LOCKS = m.GIMBAL_DEVICE_FLAGS_ROLL_LOCK | m.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
_AXES = 0b111_111_111 << 2  # has-axis, follow and lock flags of roll, pitch and yaw
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
    """Turn to finite angles (roll, pitch, yaw) or at finite rates; if all are NaN, set only the yaw lock."""
    for mode, flag in _RESTING.items():  # manager and device flags have the same bits
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


GimbalMessage = (
    m.MAVLink_gimbal_manager_set_attitude_message
    | m.MAVLink_gimbal_manager_set_pitchyaw_message
    | m.MAVLink_mount_configure_message
    | m.MAVLink_mount_control_message
)


class GimbalExtra(VehicleExtra):
    """Gimbal of the camera; it is fitted if the firmware's gimbal parameter was above 0 at boot."""

    def __init__(self, state: WireState, parameters: ParameterSet, plans: PlanReceiver) -> None:
        super().__init__(state, parameters, plans)
        self.gimbal = Gimbal(state.pilot.parameters, state.mavlink.gimbal)
        self._was_in_mission = False
        self._orders: dict[int, Callable[[VehicleCommand], Result]] = {
            m.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: self._pitch_yaw,
            m.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: self._configure,
            m.MAV_CMD_DO_MOUNT_CONFIGURE: self._mount_configure,
            m.MAV_CMD_DO_MOUNT_CONTROL: self._mount_control,
            **dict.fromkeys(ROI_COMMANDS, self._region),
        }
        self.commands = dict.fromkeys(self._orders, self._obey)
        self.handlers = {
            **{kind.id: self._receive for kind in get_args(GimbalMessage)},
            m.MAVLink_param_set_message.id: self._on_parameter,
        }
        builders = {
            m.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: self._information,
            m.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: self._status,
            m.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: self._attitude_status,
            m.MAVLINK_MSG_ID_MOUNT_STATUS: self._mount_status,
        }
        self.builders = {kind: self._fitted(build) for kind, build in builders.items()}

    def _fitted(self, build: Callable[[], Message]) -> Callable[[WireState], Message | None]:
        return lambda _: build() if self.gimbal.fitted else None

    def advance(self) -> None:
        """Move the gimbal on to the vehicle's present time."""
        pilot = self.state.pilot
        self.gimbal.advance(pilot.state, 1e3 * self.state.boot_ms, pilot.home_m)

    def watch(self) -> None:
        """Return to the default mode when the vehicle leaves the mission mode."""
        in_mission = self.state.pilot.mode is Mode.MISSION
        if self._was_in_mission and not in_mission:
            self.gimbal.to_default()
        self._was_in_mission = in_mission

    def reboot(self) -> None:
        """Reset the gimbal at a reboot of the autopilot."""
        self.gimbal.boot()

    def execute(self, command: VehicleCommand) -> None:
        """Execute a mission item; a mission's DO_MOUNT_CONTROL always sets angles."""
        if command.id == m.MAV_CMD_DO_MOUNT_CONTROL:
            params = (*command.params[:6], float(m.MAV_MOUNT_MODE_MAVLINK_TARGETING))
            command = replace(command, params=params)
        if command.id in self._orders:
            self._obey(command)

    def requested(self, message_id: int) -> None:
        """Wake the gimbal on the first request of its telemetry."""
        if message_id in self.builders:
            self.gimbal.wake()

    def is_ready(self, message_id: int) -> bool:
        """Return whether a message can be sent; before the gimbal is awake, its messages cannot."""
        return message_id not in self.builders or self.gimbal.awake

    def camera_attitude(self, boot_us: float) -> Attitude | None:
        """Return the camera attitude at a time since boot; None if the gimbal was not yet awake."""
        return self.gimbal.attitude_at(boot_us)

    def _on_parameter(self, message: m.MAVLink_param_set_message, _now_s: float) -> None:
        if message.param_id.startswith("MNT"):
            self.gimbal.wake()

    def _pitch_yaw(self, command: VehicleCommand) -> Result:
        """Handle DO_GIMBAL_MANAGER_PITCHYAW: angles (degrees), rates (degrees/s), flags, unused, device."""
        if command.number(7, -1) not in (0, _DEVICE):
            return _FAILED
        pitch, yaw, pitch_rate, yaw_rate, flags = command.params[:5]
        if not command.long and command.frame in (0, 3, 10):
            flags *= 1e7  # the field was scaled like a latitude, but it holds flags
        if not 0.0 <= flags < 2**32:
            return _FAILED
        return _turn(self.gimbal, round(flags), (0.0, pitch, yaw), (0.0, pitch_rate, yaw_rate))

    def _configure(self, command: VehicleCommand) -> Result:
        """Handle DO_GIMBAL_MANAGER_CONFIGURE: set who controls; -1 keeps, -2 takes, -3 releases control."""
        system, component = command.params[:2]
        known = all(-3.0 <= number <= 255.0 for number in (system, component))
        if not known or command.number(7, -1) not in (0, _DEVICE):
            return _FAILED
        gimbal, before = self.gimbal, self.gimbal.controller
        if system == -2.0:
            gimbal.controller = command.source
        elif system == -3.0:
            gimbal.controller = (0, 0) if before == command.source else before
        elif system >= 0.0:
            gimbal.controller = (int(system), int(component) & 255)
        return () if gimbal.controller == before else (self._status(),)

    def _mount_configure(self, command: VehicleCommand) -> None:
        """Handle DO_MOUNT_CONFIGURE: set the mode; its other settings have no effect."""
        self.gimbal.set_mode(command.number(1, -1))

    def _mount_control(self, command: VehicleCommand) -> Result:
        """Handle DO_MOUNT_CONTROL: turn to pitch, roll and yaw, point at a position, or set the mode."""
        gimbal, mode = self.gimbal, command.number(7, -1)
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
            self._point_at(position, height_m)
        elif not gimbal.set_mode(mode):
            return _FAILED
        return None

    def _region(self, command: VehicleCommand) -> None:
        """Point at a region of interest; a command without a position ends the pointing."""
        position = None if command.id == Command.DO_SET_ROI_NONE else command.position
        if position is None:
            self.gimbal.point_at(None)
            return
        height_m = command.params[6] if math.isfinite(command.params[6]) else 0.0
        if not command.long:
            height_m = self.state.above_start(height_m, command.frame)
        self._point_at(position, height_m)

    def _point_at(self, position: tuple[float, float], height_m: float) -> None:
        self.gimbal.point_at((*self.state.pilot.frame.from_wgs84(*position), height_m))

    def _obey(self, command: VehicleCommand) -> Result:
        """Execute a command or mission item; the result is FAILED if no gimbal is fitted."""
        if self.state.mavlink.gimbal is None:
            return m.MAV_RESULT_UNSUPPORTED
        if not self.gimbal.fitted:
            return _FAILED
        self.gimbal.wake()
        return self._orders[command.id](command)

    def _receive(self, message: GimbalMessage, _now_s: float) -> None:
        """Execute a message to the gimbal; invalid values are ignored."""
        gimbal = self.gimbal
        if not gimbal.fitted:
            return
        if is_a(message, m.MAVLink_mount_configure_message):
            gimbal.set_mode(message.mount_mode)
        elif is_a(message, m.MAVLink_mount_control_message):
            if gimbal.mode is GimbalMode.POINT:
                if abs(message.input_a) <= 90e7 and abs(message.input_b) <= 180e7:
                    place = (1e-7 * message.input_a, 1e-7 * message.input_b)
                    self._point_at(place, message.input_c / 100.0)
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
                _turn(
                    gimbal, message.flags, tuple(map(math.degrees, angles)), tuple(map(math.degrees, rates))
                )

    def _information(self) -> Message:
        limits = [limit for axis in self.gimbal.limits_rad for limit in axis]
        return m.MAVLink_gimbal_manager_information_message(
            self.state.boot_ms, int(_CAPABILITIES), _DEVICE, *limits
        )

    def _status(self) -> Message:
        flags = _LOCKS | (m.GIMBAL_MANAGER_FLAGS_YAW_LOCK if self.gimbal.yaw_lock else 0)
        return m.MAVLink_gimbal_manager_status_message(
            self.state.boot_ms, int(flags), _DEVICE, *self.gimbal.controller, 0, 0
        )

    def _attitude_status(self) -> Message:
        gimbal = self.gimbal
        flags = _LOCKS | m.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME | _RESTING.get(gimbal.mode, 0)
        if gimbal.locks_yaw:
            flags |= m.GIMBAL_DEVICE_FLAGS_YAW_LOCK
        attitude = quaternion_of(*gimbal.angles_rad)
        return m.MAVLink_gimbal_device_attitude_status_message(
            0, 0, self.state.boot_ms, int(flags), attitude, *_NAN_3, 0, math.nan, math.nan, _DEVICE
        )

    def _mount_status(self) -> Message:
        roll, pitch, yaw = (round(100.0 * math.degrees(angle)) for angle in self.gimbal.angles_rad)
        return m.MAVLink_mount_status_message(0, 0, pitch, roll, yaw, int(self.gimbal.mode))
