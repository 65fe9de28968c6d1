"""A ground vehicle as a motion model: the compiled kernel with its state, route and energy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.energy.battery import WH_J
from sim_vehicle.motion.columns import State
from sim_vehicle.motion.compiled_motion import CompiledMotion, Dynamics
from sim_vehicle.motion.legs import KEEP, LegKind
from sim_vehicle.motion.rover import layout as wheels
from sim_vehicle.motion.rover.kernel import advance
from sim_vehicle.motion.rover.layout import Leg, Limits, Wheels

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position, Route
    from sim_vehicle.weather.wind import Wind

NOT_DRIVEN = (LegKind.TAKEOFF, LegKind.CLIMB, LegKind.DESCEND)
"""Legs that mean nothing on the ground."""


@dataclass(frozen=True, slots=True)
class SihRover:
    """The rover of PX4's simulator and the loops that steer and drive it; see `sim_vehicle.motion.rover.sih`.

    Parameters
    ----------
    throttle_speed, speed_p, speed_i : float
        Throttle over speed, m/s and s/m.
    wheel_base, steer_max, steer_speed : float
        Metres; greatest angle of the wheels, rad, and its greatest change, rad/s.
    rate_ff, rate_p, rate_i : float
        Angle of the wheels over the rate of turning: of the feed-forward, s, and 1.
    force, friction : float
        Per mass: of full throttle and of rolling, m/s^2.
    grip, turn_grip, turn_damping : float
        Cornering stiffness over mass and over the moment of inertia, damping over that.
    actuator_s : float
        Time constant of its outputs.
    drag : float
        Per mass, over the square of the speed along each axis of the Earth, 1/m.
    north, east : tuple of 3 floats
        Those directions in the axes of the Earth.
    """

    throttle_speed: float
    speed_p: float
    speed_i: float
    wheel_base: float
    steer_max: float
    steer_speed: float
    rate_ff: float
    rate_p: float
    rate_i: float
    force: float
    friction: float
    grip: float
    turn_grip: float
    turn_damping: float
    actuator_s: float
    drag: float
    north: tuple[float, float, float]
    east: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class RoverLimits:
    """What an autopilot's parameters decide about driving; SI units, radians.

    Parameters
    ----------
    turn_radius, turn_rate, lateral : float
        Tightest turn, greatest rate of turning and lateral acceleration.
    steering_s : float
        Time constant of the steering.
    ahead_gain, ahead_min, ahead_max : float
        Look-ahead of the pure pursuit: seconds, and metres.
    pivot_begin, pivot_end, pivot_rate : float
        Heading errors at which turning on the spot begins and ends, and its rate; a beginning of 0 is never.
    acceptance : float
        Radius of waypoints.
    corner_gain, corner_max : float
        The acceptance radius of a corner is this much of what the tightest turn needs, at most so much; 0 is
        none.
    passes : bool
        Whether a waypoint that was driven past counts.
    yaw_p, yaw_acceleration : float
        Rate of turning over the error of the heading, and its greatest change; 0: the bend is that of pure
        pursuit.
    jerk : float
        Of slowing down; 0 is none.
    corner_slows, corner_least, corner_most : float
        A corner of 180 degrees takes such a share of the greatest speed, down to the least; a negative share:
        the speed is that which the lateral acceleration allows.
    simulated : SihRover, optional
        The vehicle; without one it has the speed that is asked for and turns as it is asked to.
    """

    speed_max: float
    acceleration: float
    deceleration: float
    turn_radius: float
    turn_rate: float
    lateral: float
    steering_s: float
    ahead_gain: float
    ahead_min: float
    ahead_max: float
    pivot_begin: float
    pivot_end: float
    pivot_rate: float
    acceptance: float
    corner_gain: float
    corner_max: float
    passes: bool
    yaw_p: float = 0.0
    yaw_acceleration: float = 0.0
    jerk: float = 0.0
    corner_slows: float = -1.0
    corner_least: float = 0.0
    corner_most: float = 0.0
    simulated: SihRover | None = None


class Rover(CompiledMotion):
    """A vehicle on wheels that drives routes; heights mean nothing to it.

    Parameters
    ----------
    limits_of : callable
        What the autopilot makes of a vehicle's parameters.
    wind : Wind, optional
        Counts only in the power.
    yaw_rad : float
        Heading at the start.
    """

    dynamics = Dynamics(advance, wheels.STATE, wheels.LIMITS)
    _state_size = len(State) + len(Wheels)
    _energy_limit = Limits.ENERGY_LIMIT

    def __init__(
        self,
        spec: VehicleSpec,
        limits_of: Callable[[VehicleSpec], RoverLimits],
        wind: Wind | None = None,
        yaw_rad: float = 0.0,
    ) -> None:
        self._limits_of = limits_of
        self.law = limits_of(spec)
        super().__init__(spec, wind, yaw_rad)
        self.state[Wheels.PAUSE_END] = math.inf

    def attitude(self) -> tuple[float, float, float, float]:
        """Return roll and pitch, which are none, speed in place of an airspeed, and throttle."""
        return 0.0, 0.0, float(self.state[Wheels.SPEED]), float(self.state[Wheels.THROTTLE])

    def place_in_flight(self, position_m: Position, velocity_m_s: Position, heading_rad: float) -> None:
        """Be under way at time 0, with nothing used yet, as if it had driven there."""
        super().place_in_flight(position_m, velocity_m_s, heading_rad)
        self.state[Wheels.SPEED : Wheels.PIVOTING + 1] = 0.0
        self.state[Wheels.YAW_ASKED :] = 0.0
        self.state[Wheels.SPEED] = self.state[Wheels.SPEED_ASKED] = math.hypot(*velocity_m_s[:2])
        self.state[Wheels.YAW_ASKED] = self.state[State.HEADING]
        self.state[Wheels.PAUSE_END] = math.inf

    def fly(self, route: Route) -> None:
        """Begin a route, from where the vehicle is and as it moves now."""
        law = self.law
        n = len(route.points_m)
        rows = np.zeros((n, len(Leg)))
        rows[:, : Leg.KIND] = route.points_m[:, :2]
        speed = np.where(np.isnan(route.speed_m_s), self.spec.cruise_speed_m_s, route.speed_m_s)
        rows[:, Leg.SPEED] = np.clip(speed, 0.1, law.speed_max)
        rows[:, Leg.NEAR] = route.near_m
        rows[:, Leg.PAUSE] = route.pause_s
        x, y = self.state[State.POSITION_X : State.POSITION_Z].tolist()
        for i in range(n):
            radius = float(route.radius_m[i])
            stops = i == n - 1 or radius <= 0.0 or route.pause_s[i] > 0.0
            rows[i, Leg.KIND] = wheels.STOP if stops else wheels.THROUGH
            # Neither autopilot takes the radius of an item on wheels.
            rows[i, Leg.RADIUS] = law.acceptance
            if int(route.kind[i]) in NOT_DRIVEN:
                rows[i, Leg.KIND] = wheels.AT_ONCE
                rows[i, : Leg.KIND] = x, y
            x, y = rows[i, : Leg.KIND].tolist()
        self._corners(rows)
        self._route = rows.view(wheels.LEG)[:, 0]
        self._begin()

    def _corners(self, rows: NDArray[np.float64]) -> None:
        """Find the radius and the speed of each corner, and of those before it that have to brake for it."""
        law = self.law
        ends = np.vstack([self.state[None, State.POSITION_X : State.POSITION_Z], rows[:, : Leg.KIND]])
        ways = np.diff(ends, axis=0)
        lengths = np.hypot(ways[:, 0], ways[:, 1])
        leave = 0.0
        for i in range(len(rows) - 1, -1, -1):
            row = rows[i]
            if row[Leg.KIND] != wheels.THROUGH:
                leave = float(row[Leg.SPEED]) if row[Leg.KIND] == wheels.AT_ONCE else 0.0
                row[Leg.END_SPEED] = leave
                continue
            turn = 0.0
            if lengths[i] > 1e-3 and lengths[i + 1] > 1e-3:
                (ax, ay), (bx, by) = ways[i].tolist(), ways[i + 1].tolist()
                turn = abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))
            tangent = math.tan(0.5 * min(turn, 0.9 * math.pi))
            if law.corner_gain > 0.0 and law.turn_radius > 0.0:
                needed = law.corner_gain * law.turn_radius * tangent
                row[Leg.RADIUS] = max(row[Leg.RADIUS], min(needed, law.corner_max))
            speed = float(rows[i + 1, Leg.SPEED])
            if law.corner_slows >= 0.0:
                slowed = law.corner_most * (1.0 - min(law.corner_slows * turn / math.pi, 1.0))
                speed = min(max(slowed, law.corner_least), float(row[Leg.SPEED]))
            elif turn > 1e-3:
                bend = max(float(row[Leg.RADIUS]) / max(tangent, 1e-6), law.turn_radius, 0.1)
                speed = min(speed, math.sqrt(law.lateral * bend), law.turn_rate * bend)
            if 0.0 < law.pivot_begin < turn:
                speed = 0.0
            reach = math.sqrt(leave * leave + 2.0 * law.deceleration * float(lengths[i + 1]))
            leave = min(speed, reach, float(row[Leg.SPEED]))
            row[Leg.END_SPEED] = leave

    def steer(self, velocity_m_s: Position, *, height_m: float = math.nan, heading: Heading = KEEP) -> None:
        """Drive at a velocity, or stop; told to go down it stops for good."""
        east, north, up = velocity_m_s
        speed = math.hypot(east, north)
        row = np.zeros((1, len(Leg)))
        row[0, : Leg.KIND] = self.state[State.POSITION_X : State.POSITION_Z]
        row[0, Leg.KIND] = wheels.BRAKE if up < 0.0 and speed == 0.0 else wheels.VELOCITY
        row[0, Leg.SPEED] = min(speed, self.law.speed_max)
        row[0, Leg.HEADING] = math.atan2(east, north) if speed > 0.0 else self.state[State.HEADING]
        self._route = row.view(wheels.LEG)[:, 0]
        self._begin()

    def stopping_point(self) -> Position:
        """Return the position of rest if it brakes now."""
        x, y = self.state[State.POSITION_X : State.POSITION_Z].tolist()
        speed, yaw = float(self.state[Wheels.SPEED]), float(self.state[State.HEADING])
        distance = 0.5 * speed * speed / self.law.deceleration
        return x + distance * math.sin(yaw), y + distance * math.cos(yaw), 0.0

    def lose_power(self) -> None:
        """Stop: without power it cannot go anywhere."""
        self._limits[Limits.SPEED_MAX] = 1e-3

    def update_spec(self, spec: VehicleSpec) -> None:
        """Take other defaults and limits; they hold from the next route on."""
        self.law = self._limits_of(spec)
        super().update_spec(spec)

    def touch_down(self) -> None:
        """Stand still."""
        super().touch_down()
        self.state[Wheels.SPEED : Wheels.PIVOTING + 1] = 0.0
        self.state[Wheels.YAW_ASKED :] = 0.0

    def _numbers(self, spec: VehicleSpec) -> NDArray[np.float64]:
        """Return the limits in the order of the kernel."""
        law = self.law
        numbers = np.zeros(len(Limits))
        by_name = {
            Limits.STEP_S: spec.step_s,
            Limits.SPEED_MAX: law.speed_max,
            Limits.ACCELERATION: law.acceleration,
            Limits.DECELERATION: law.deceleration,
            Limits.TURN_RADIUS: law.turn_radius,
            Limits.TURN_RATE: law.turn_rate,
            Limits.LATERAL: law.lateral,
            Limits.STEERING_S: law.steering_s,
            Limits.AHEAD_GAIN: law.ahead_gain,
            Limits.AHEAD_MIN: law.ahead_min,
            Limits.AHEAD_MAX: law.ahead_max,
            Limits.PIVOT_BEGIN: law.pivot_begin,
            Limits.PIVOT_END: law.pivot_end,
            Limits.PIVOT_RATE: law.pivot_rate,
            Limits.PASSES: float(law.passes),
            Limits.YAW_P: law.yaw_p,
            Limits.YAW_ACCELERATION: law.yaw_acceleration,
            Limits.JERK: law.jerk,
            Limits.ENERGY_LIMIT: math.inf if spec.battery is None else spec.battery.capacity_wh * WH_J,
        }
        for index, value in by_name.items():
            numbers[index] = value
        if law.simulated is not None:
            _set_simulated(numbers, law.simulated, spec.step_s)
        return numbers


def _set_simulated(numbers: NDArray[np.float64], rover: SihRover, step_s: float) -> None:
    """Add the numbers of PX4's simulated rover to the limits."""
    by_name = {
        Limits.THROTTLE_SPEED: rover.throttle_speed,
        Limits.SPEED_P: rover.speed_p,
        Limits.SPEED_I: rover.speed_i,
        Limits.WHEEL_BASE: rover.wheel_base,
        Limits.STEER_MAX: rover.steer_max,
        Limits.STEER_STEP: rover.steer_speed / rover.steer_max * step_s,
        Limits.RATE_FF: rover.rate_ff,
        Limits.RATE_P: rover.rate_p,
        Limits.RATE_I: rover.rate_i,
        Limits.FORCE: rover.force,
        Limits.FRICTION: rover.friction,
        Limits.GRIP: rover.grip,
        Limits.TURN_GRIP: rover.turn_grip,
        Limits.TURN_DAMPING: rover.turn_damping,
        Limits.ACTUATOR_SHARE: -math.expm1(-step_s / rover.actuator_s),
        Limits.DRAG: rover.drag,
    }
    for index, value in by_name.items():
        numbers[index] = value
    numbers[Limits.NORTH_1 : Limits.EAST_1] = rover.north
    numbers[Limits.EAST_1 :] = rover.east
