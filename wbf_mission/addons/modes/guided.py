"""Guided flight: setpoints, attitudes and headings from a companion or ground station.

Setpoints are sent repeatedly (ArduPilot "Copter commands in guided mode", PX4 "Offboard mode"). A commanded
attitude does not hold the position: the vehicle accelerates by the tilted thrust, and drag pulls it towards
the wind's velocity. The vehicle flies the resulting velocities by velocity control, and telemetry shows the
attitude computed here (ArduCopter's ``mode_guided.cpp``, ``angle_control_run``).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.autopilot.parameters import RuntimeParameters, Setting
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.leg_follower import drag_1_s
from sim_vehicle.execution.state import LandedState
from sim_vehicle.motion.legs import ALONG, KEEP, Heading
from sim_vehicle.pilot.controls import Controls, RefusedError, Severity

if TYPE_CHECKING:
    from sim_vehicle.pilot.failsafe import Failsafe
    from sim_vehicle.pilot.pilot import Pilot

# On the ground, setpoints less than this height above the vehicle are ignored: MAVLink rounds heights.
_GROUND_MARGIN_M = 0.01


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Setpoint of position, velocity and heading; NaN marks a component that is not set."""

    position_m: tuple[float, float, float]
    """East, north, up relative to the start."""
    velocity_m_s: tuple[float, float, float]
    """East, north, up."""
    # Compass heading, and heading rate (clockwise).
    yaw_rad: float = math.nan
    turn_rad_s: float = math.nan

    @property
    def heading(self) -> Heading | None:
        """Commanded heading, or None; a heading rate takes precedence."""
        if not math.isnan(self.turn_rad_s):
            return Heading.turning(self.turn_rad_s)
        return None if math.isnan(self.yaw_rad) else Heading.fixed(self.yaw_rad)

    @property
    def is_velocity(self) -> bool:
        """Whether the setpoint has a velocity but no horizontal position."""
        return math.isnan(self.position_m[0]) and not all(math.isnan(v) for v in self.velocity_m_s)

    def lifts_from(self, height_m: float) -> bool:
        """Whether the setpoint makes a multirotor take off (``MulticopterPositionControl::Run`` of PX4)."""
        return self.position_m[2] > height_m + _GROUND_MARGIN_M or self.velocity_m_s[2] > 0.0


_SLOWEST_M_S = 0.05
# Fraction of the top speed above which ArduCopter turns the nose along the velocity (`AC_PosControl`).
_TURNING_SHARE = 0.05
# Minimum height of position setpoints; with lower setpoints, real autopilots press onto the ground.
_LOWEST_M = 0.1


class SetpointFollower:
    """Flies the latest setpoint and detects the end of a setpoint stream."""

    def __init__(self, controls: Controls, failsafe: Failsafe, attitude: AttitudePilot) -> None:
        self._controls = controls
        self._parameters = controls.parameters
        self._failsafe = failsafe
        self._attitude = attitude
        self._rules = controls.rules
        self._latest: Setpoint | AttitudeTarget | None = None
        self._taken_s = -math.inf
        self.flown: Setpoint | None = None  # Setpoint that the vehicle flies, or None

    @property
    def is_fresh(self) -> bool:
        """Whether the latest setpoint is still valid: not older than the timeout."""
        return self._controls.now_s - self._taken_s <= self._parameters.setpoint_timeout_s

    def listens_in(self, mode: Mode) -> bool:
        """Whether setpoints are accepted in a mode; some modes only store them for later."""
        return self._rules.needs_stream or mode in (Mode.GUIDED, Mode.TAKEOFF)

    def take(self, setpoint: Setpoint | AttitudeTarget) -> None:
        """Store a setpoint as the latest."""
        self._latest = setpoint
        self._taken_s = self._controls.now_s

    def begin(self) -> None:
        """Fly the latest setpoint if the mode needs a setpoint stream."""
        self.flown = None
        if self._rules.needs_stream and self._latest is not None:
            self.fly()

    def expired(self) -> Mode | None:
        """If setpoints have stopped, warn, and return the mode to enter; None if no other mode is needed."""
        if self.is_fresh:
            return None
        if self._rules.needs_stream:
            self._controls.note(Severity.WARNING, self._rules.stream_lost.format("returning"))
            self.flown = None
            return Mode.RTL
        if self.flown is not None and self.flown.is_velocity:
            self._controls.note(Severity.WARNING, self._rules.stream_lost.format("stopping"))
            self.flown = None
            return Mode.GUIDED
        return None

    def forget(self) -> None:
        """Record that the vehicle no longer flies a setpoint."""
        self.flown = None

    def fly(self) -> None:
        """Fly the latest setpoint, unless the vehicle already flies it."""
        setpoint = self._latest
        if setpoint is None or setpoint == self.flown:
            return
        if isinstance(setpoint, AttitudeTarget):
            self._attitude.take(setpoint)
            return
        if self._waits_on_ground and not setpoint.lifts_from(self._controls.state.position_m[2]):
            return
        try:
            self._fly(setpoint)
        except VehicleError as error:
            raise RefusedError(f"Setpoint refused: {error}") from None
        self.flown = setpoint
        self._controls.complaint = ""

    @property
    def _waits_on_ground(self) -> bool:
        """Whether the vehicle waits on the ground for a setpoint to take off (PX4)."""
        controls = self._controls
        on_ground = controls.landed is LandedState.ON_GROUND and not controls.spec.drives
        return on_ground and self._rules.needs_stream

    def _fly(self, setpoint: Setpoint) -> None:
        executor = self._controls.executor
        (x, y, z), (vx, vy, vz) = setpoint.position_m, setpoint.velocity_m_s
        heading = setpoint.heading
        executor.flight.look_at(None)
        if math.isnan(x) and not (math.isnan(vx) and math.isnan(vz)):
            across = (0.0, 0.0) if math.isnan(vx) else (vx, vy)
            up = 0.0 if math.isnan(vz) else vz
            travels = math.hypot(*across) > _TURNING_SHARE * executor.spec.top_speed_m_s
            default = ALONG if self._rules.yaws_to_setpoint and travels else KEEP
            executor.steer((*across, up), height_m=z, heading=heading or default)
            return
        here = executor.motion.stopping_point()
        if heading is None:
            heading = ALONG if self._rules.yaws_to_setpoint and not math.isnan(x) else KEEP
        target = (here[0], here[1]) if math.isnan(x) else (x, y)
        height = here[2] if math.isnan(z) else max(z, _LOWEST_M) if executor.spec.hovers else z
        if self._rules.fences_setpoints and (reason := self._failsafe.outside((*target, height))) is not None:
            raise VehicleError(f"position outside the fence ({reason})")
        speed = math.nan if math.isnan(vx) else math.hypot(vx, vy)
        executor.goto(
            *target,
            height,
            heading=heading,
            speed_m_s=min(speed, executor.spec.top_speed_m_s) if speed > _SLOWEST_M_S else None,
            as_setpoint=True,
        )


_STEP_S = 0.02
_MOST_LEAN = Setting("ANGLE_MAX", 3000.0, math.radians(0.01))
_LAG = Setting("ATC_INPUT_TC", 0.15)


@dataclass(frozen=True, slots=True)
class AttitudeTarget:
    """Target of SET_ATTITUDE_TARGET."""

    # Roll right and pitch up; NaN if only rates are commanded.
    roll_rad: float
    pitch_rad: float
    heading: Heading
    climb_m_s: float
    """Climb rate; NaN if a thrust is commanded."""
    rates_rad_s: tuple[float, float] = (0.0, 0.0)
    """Rates of roll and pitch, used if no angles are commanded."""
    thrust: float = 1.0
    """Thrust in units of the hover thrust."""


_LEVEL = AttitudeTarget(0.0, 0.0, KEEP, 0.0)


class AttitudePilot:
    """Flies an attitude until `stop`, and writes the attitude to `flown_attitude` of the controls."""

    def __init__(self, controls: Controls) -> None:
        self._controls = controls
        self._parameters = controls.parameters
        self._target: AttitudeTarget | None = None
        self._taken_s = self._flown_s = self.roll_rad = self._pitch = 0.0
        self._velocity_m_s = (0.0, 0.0, 0.0)
        self._height_m: float | None = None
        self._manoeuvre: Callable[[float], bool] | None = None

    @property
    def active(self) -> bool:
        """Whether an attitude is being flown."""
        return self._target is not None

    def stop(self) -> None:
        """Stop flying an attitude."""
        self._target = self._manoeuvre = self._controls.flown_attitude = None

    def take(self, target: AttitudeTarget = _LEVEL, manoeuvre: Callable[[float], bool] | None = None) -> None:
        """Fly an attitude until the next order.

        `manoeuvre` replaces the attitude. `manoeuvre` is a function of a time step (s) that sets `roll_rad`,
        calls `move`, and returns whether the manoeuvre has ended.
        """
        if self._target is None:
            state = self._controls.state
            self._velocity_m_s, self._height_m = state.velocity_m_s, None
            self.roll_rad, self._pitch, self._flown_s = state.roll_rad, state.pitch_rad, self._controls.now_s
        self._target, self._taken_s = target, self._controls.now_s
        self._manoeuvre = manoeuvre or self._manoeuvre

    @property
    def flown_for_s(self) -> float:
        """Time (s) for which the attitude has been flown since the last order."""
        return self._flown_s - self._taken_s

    def check(self) -> bool:
        """Fly the attitude up to the present time, and return whether a manoeuvre has ended."""
        target, controls = self._target, self._controls
        if target is None:
            return False
        if controls.now_s - self._taken_s > self._parameters.setpoint_timeout_s:
            # After GUID_TIMEOUT the vehicle levels and holds its height.
            target = _LEVEL
        if controls.landed is LandedState.ON_GROUND:
            lifts = target.climb_m_s > 0.0 or (math.isnan(target.climb_m_s) and target.thrust > 1.0)
            # On the ground, only the latest time step is computed; the vehicle may take off in this step.
            self._flown_s, self._velocity_m_s = controls.now_s - _STEP_S, (0.0, 0.0, 0.0)
            if not lifts:
                controls.flown_attitude = None
                return False
        over = False
        while self._flown_s < controls.now_s - 1e-9:
            step_s = min(_STEP_S, controls.now_s - self._flown_s)
            self._flown_s += step_s
            if self._manoeuvre is not None:
                over |= self._manoeuvre(step_s)
            else:
                self._lean(target, step_s)
        controls.flown_attitude = self.roll_rad, self._pitch
        east, north, up = self._velocity_m_s
        if target.climb_m_s != 0.0 or self._manoeuvre is not None:
            self._height_m = None
        elif self._height_m is None:
            self._height_m = controls.state.position_m[2]
        height_m = math.nan if self._height_m is None else self._height_m
        executor = controls.executor
        controls.order(lambda: executor.steer((east, north, up), height_m=height_m, heading=target.heading))
        return over

    def _lean(self, target: AttitudeTarget, step_s: float) -> None:
        """Lean as commanded, but at most by ANGLE_MAX, and change the velocity by the thrust."""
        roll, pitch = target.roll_rad, target.pitch_rad
        if math.isnan(roll):
            roll = self.roll_rad + step_s * target.rates_rad_s[0]
            pitch = self._pitch + step_s * target.rates_rad_s[1]
        size = max(math.hypot(roll, pitch) / _MOST_LEAN.of(self._parameters), 1.0)
        roll, pitch = roll / size, pitch / size
        lag_s = max(_LAG.of(self._parameters), 1e-3)
        share = 1.0 if math.isnan(target.roll_rad) else 1.0 - math.exp(-step_s / lag_s)
        self.roll_rad += share * (roll - self.roll_rad)
        self._pitch += share * (pitch - self._pitch)
        upright = math.cos(self.roll_rad) * math.cos(self._pitch)
        if math.isnan(target.climb_m_s):
            self.move(target.thrust, step_s)
        else:
            self.move(1.0 / upright, step_s)
            self._velocity_m_s = (*self._velocity_m_s[:2], target.climb_m_s)

    def move(self, thrust: float, step_s: float) -> None:
        """Change the velocity by thrust (in units of the weight), weight and drag."""
        controls = self._controls
        state, spec = controls.state, controls.spec
        wind_east, wind_north = state.wind_m_s
        east, north, up = self._velocity_m_s
        force = GRAVITY_M_S2 * thrust
        ahead = -force * math.sin(self._pitch) * math.cos(self.roll_rad)
        aside = force * math.sin(self.roll_rad)
        lift = force * math.cos(self.roll_rad) * math.cos(self._pitch) - GRAVITY_M_S2
        sine, cosine = math.sin(state.yaw_rad), math.cos(state.yaw_rad)
        drag = drag_1_s(spec, math.hypot(east - wind_east, north - wind_north))
        east += step_s * (ahead * sine + aside * cosine - drag * (east - wind_east))
        north += step_s * (ahead * cosine - aside * sine - drag * (north - wind_north))
        up = min(max(up + step_s * lift, -spec.descent_speed_m_s), spec.climb_speed_m_s)
        size = max(math.hypot(east, north) / spec.top_speed_m_s, 1.0)
        self._velocity_m_s = (east / size, north / size, up)


_ROLL_ACCELERATION = Setting("ATC_ACCEL_R_MAX", 110_000.0, math.radians(0.01))
# MOT_THST_HOVER of ArduPilot's simulator; FLIP adds and subtracts fractions of full throttle.
_HOVER = 0.39
# FLIP_ROTATION_RATE, FLIP_THR_INC, FLIP_THR_DEC, FLIP_RECOVERY_ANGLE, FLIP_TIMEOUT_MS; ATC_ANG_RLL_P.
_RATE_RAD_S, _MORE, _LESS, _DONE_RAD, _LONGEST_S = (
    math.radians(400.0),
    1.0 + 0.2 / _HOVER,
    1.0 - 0.24 / _HOVER,
    math.radians(5.0),
    2.5,
)
_ROLL_P_1_S = 4.5


class Flip:
    """Roll of 360 degrees to the right (direction 1) or left (-1); it begins at once (``mode_flip.cpp``)."""

    def __init__(self, attitude: AttitudePilot, parameters: RuntimeParameters, direction: float) -> None:
        self._attitude, self._parameters, self._direction = attitude, parameters, direction
        self._rolled = self._rolling = 0.0
        self._attitude.stop()
        self._attitude.take(manoeuvre=self._turn_over)
        self._level_rad = self._attitude.roll_rad

    def _turn_over(self, step_s: float) -> bool:
        """Continue the flip for one step, and return whether it has ended."""
        change = _ROLL_ACCELERATION.of(self._parameters) * step_s
        wanted, thrust, over = _RATE_RAD_S, _MORE, False
        if self._rolled >= math.radians(270.0):
            left = 2.0 * math.pi + self._direction * self._level_rad - self._rolled
            wanted = min(_RATE_RAD_S, _ROLL_P_1_S * left, math.sqrt(2.0 * max(left, 0.0) * change / step_s))
            over = left <= _DONE_RAD
        elif self._rolled >= math.radians(45.0):
            thrust = _LESS
        self._rolling += min(max(wanted - self._rolling, -change), change)
        self._rolled += step_s * self._rolling
        self._attitude.roll_rad = math.remainder(self._direction * self._rolled, 2.0 * math.pi)
        self._attitude.move(thrust, step_s)
        return over or self._attitude.flown_for_s > _LONGEST_S


# Modes with CONDITION_YAW; in LOITER and the manual modes, the sticks control the heading.
_SLEWS_IN = frozenset({Mode.GUIDED, Mode.TAKEOFF, Mode.MISSION, Mode.RTL, Mode.LAND})


class AutoYaw:
    """CONDITION_YAW: turns to a heading in flight, and keeps it until the mode or mission item changes.

    Source: ArduCopter's ``autoyaw.cpp``.
    """

    def __init__(self, controls: Controls) -> None:
        self._controls = controls
        self._flown: tuple[Mode, int] | None = None
        self._yaw_rad = self._left_rad = self._rate_rad_s = self._slewed_s = 0.0

    @property
    def active(self) -> bool:
        """Whether a heading of CONDITION_YAW is in force."""
        return self._flown is not None

    def forget(self) -> None:
        """Record that CONDITION_YAW no longer controls the heading."""
        self._flown = None

    def order(self, angle_rad: float, rate_rad_s: float, direction: int, *, relative: bool) -> None:
        """Turn to a compass heading or, if `relative`, by an angle.

        `rate_rad_s` is limited to the vehicle's maximum yaw rate; if it is not positive, the maximum is used.
        `direction` is 1 for clockwise, -1 for counter-clockwise, and 0 for the short way.
        """
        if self._controls.mode not in _SLEWS_IN or self._controls.landed is LandedState.ON_GROUND:
            return
        if not self.active:
            self._yaw_rad = self._controls.state.yaw_rad
        if relative:
            left = -angle_rad if direction < 0 else angle_rad
        else:
            left = math.remainder(angle_rad - self._yaw_rad, 2.0 * math.pi)
            if direction * left < 0.0:
                left += direction * 2.0 * math.pi
        most = self._controls.spec.yaw_rate_rad_s
        self._left_rad = left
        self._rate_rad_s = min(rate_rad_s, most) if rate_rad_s > 0.0 else most
        self._slewed_s = self._controls.now_s
        self._flown = self._now
        self._controls.executor.flight.look_at(None)
        self.check()

    def check(self) -> None:
        """Continue the turn, or forget it if the mode or the mission item has changed."""
        if self._flown is None:
            return
        if self._flown != self._now:
            self._flown = None
            return
        step = (self._controls.now_s - self._slewed_s) * self._rate_rad_s
        turned = min(max(self._left_rad, -step), step)
        self._slewed_s = self._controls.now_s
        self._left_rad -= turned
        self._yaw_rad = (self._yaw_rad + turned) % (2.0 * math.pi)
        self._controls.executor.motion.point(self._yaw_rad)

    @property
    def _now(self) -> tuple[Mode, int]:
        """Mode and, in the mission mode, current item."""
        mode = self._controls.mode
        return mode, self._controls.executor.mission.current_seq if mode is Mode.MISSION else -1


class GuidedFlight:
    """Flight by setpoints, attitudes and headings that a peer sends."""

    def __init__(self, pilot: Pilot) -> None:
        self._pilot = pilot
        self.attitude = AttitudePilot(pilot)
        self.setpoints = SetpointFollower(pilot, pilot.failsafe, self.attitude)
        self.auto_yaw = AutoYaw(pilot)

    def take_setpoint(self, setpoint: Setpoint) -> None:
        """Store a setpoint, and fly it in the guided mode."""
        pilot = self._pilot
        self.setpoints.take(setpoint)
        if pilot.mode is Mode.GUIDED:
            self.attitude.stop()
        if pilot.mode is Mode.TAKEOFF and not pilot.rules.needs_stream:
            pilot.mode = Mode.GUIDED
        if pilot.mode is Mode.GUIDED and pilot.armed:
            if self.auto_yaw.active:
                # An unchanged setpoint must be flown again, because it also sets the heading.
                self.auto_yaw.forget()
                self.setpoints.forget()
            self.setpoints.fly()

    def take_attitude(self, target: AttitudeTarget | None) -> None:
        """Fly an attitude in the guided modes; None stops. Modes that need a stream store it."""
        pilot = self._pilot
        if target is not None and pilot.rules.needs_stream:
            self.setpoints.take(target)
        if pilot.mode not in (Mode.GUIDED, Mode.TAKEOFF, Mode.ATTITUDE) or not pilot.armed:
            return
        if pilot.mode is Mode.TAKEOFF:
            pilot.mode = Mode.GUIDED
        self.auto_yaw.forget()
        self.setpoints.forget()
        if target is not None:
            self.attitude.take(target)
        elif pilot.mode is Mode.ATTITUDE:
            self.attitude.take()
        elif pilot.landed is not LandedState.ON_GROUND:
            self.attitude.stop()
            pilot.order(pilot.executor.flight.hold)
