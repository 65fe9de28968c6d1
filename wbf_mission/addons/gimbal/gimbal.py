"""Gimbal of the camera: target and angles over time.

Parameters, modes and limits follow ArduPilot's ``AP_Mount_Backend.cpp`` and ``AP_Mount_Servo.cpp``. The
simulated gimbal stabilises roll and pitch to the horizon and yaw to the vehicle, at limited rates.
"""

from __future__ import annotations

import math
from collections import deque
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

from sim_vehicle.autopilot.parameters import Setting

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sim_vehicle.autopilot.parameters import RuntimeParameters
    from sim_vehicle.execution.state import VehicleState

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

    The gimbal is fitted if the vehicle's parameter `fitting` is above 0 at boot. If `fitting` is None, it is
    never fitted.

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
