"""Motion model of a generic multirotor, around the compiled kernel."""

from __future__ import annotations

import math
from math import atan2, inf, isnan, pi, sqrt
from typing import TYPE_CHECKING

import numpy as np

from geo.compiled import compiled
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.columns import Record, State
from sim_vehicle.motion.compiled_motion import CompiledMotion, Dynamics
from sim_vehicle.motion.legs import KEEP, ROUTE
from sim_vehicle.motion.multirotor import kernel
from sim_vehicle.weather.wind import Wind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position, Route

GENERIC = Dynamics(kernel.advance, col.STATE, kernel.LIMITS)
"""Dynamics of a multirotor that has no autopilot, or whose autopilot is not in control."""


class Multirotor(CompiledMotion):
    """Multirotor that flies routes.

    Parameters
    ----------
    yaw_rad : float
        Heading at the start.

    Examples
    --------
    >>> from sim_vehicle.motion.legs import Leg, Route
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> vehicle = Multirotor(get_vehicle("quad"))
    >>> vehicle.fly(Route.through([Leg((0.0, 0.0, 10.0), 5.0)]))
    >>> vehicle.advance(10_000)
    <MotionEvent.REACHED: 1>
    >>> round(vehicle.position_m[2], 1), vehicle.time_s < 10.0
    (10.0, True)
    """

    dynamics = GENERIC

    def __init__(self, spec: VehicleSpec, wind: Wind | None = None, yaw_rad: float = 0.0) -> None:
        super().__init__(spec, wind, yaw_rad)
        self.state[col.LOOK] = math.nan

    def _numbers(self, spec: VehicleSpec) -> Mapping[str, float]:
        return {
            "speed_max": spec.speed_limit_m_s,
            "airspeed_max": spec.airspeed_limit_m_s,
            "climb_max": spec.climb_speed_m_s,
            "descent_max": spec.descent_speed_m_s,
            "acceleration_max": spec.acceleration_m_s2,
            "jerk_max": spec.jerk_m_s3,
            "vertical_acceleration": spec.vertical_acceleration_m_s2,
            "vertical_jerk": spec.vertical_jerk_m_s3,
            "turn_rate": spec.yaw_rate_rad_s,
            "turn_acceleration": spec.yaw_acceleration_rad_s2,
            "touch_down_speed": spec.landing_speed_m_s,
        }

    def fly(self, route: Route) -> None:
        """Begin a route, flown by the generic dynamics, from the present position and motion."""
        self._begin(self._prepared(route.legs))

    def _prepared(self, legs: Record) -> Record:
        route = np.zeros(len(legs), kernel.LEG)
        prepare_route(route, self._records("state", col.STATE), legs, self._records("_limits", kernel.LIMITS))
        return route

    def steer(self, velocity_m_s: Position, *, height_m: float = math.nan, heading: Heading = KEEP) -> None:
        """Keep a velocity, or its horizontal part at a fixed altitude; a descent ends on the ground."""
        position = self.position_m
        self._begin(prepare_velocity(position, velocity_m_s, height_m, *heading.numbers, self._limit))

    def look_at(self, position_m: tuple[float, float] | None) -> None:
        """Point the nose at a position (east, north) on all legs; None ends this."""
        self.state[col.LOOK] = math.nan if position_m is None else position_m

    def point(self, heading_rad: float) -> None:
        """Turn the nose to a compass heading on the present leg."""
        if self._route is not None:
            self._route["heading"][self.leg] = heading_rad
            self._route["turn_rate"][self.leg] = math.nan

    def stopping_point(self) -> Position:
        """Return the position at which the vehicle stops if it brakes now."""
        x, y, z, vx, vy, vz, ax, ay, az = self.state[State.POSITION_X : State.HEADING].tolist()
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        if speed < 1e-3:
            return x, y, z
        ux, uy, uz = vx / speed, vy / speed, vz / speed
        probe = np.ones(1, ROUTE)
        probe["x"], probe["y"], probe["z"] = x + ux, y + uy, z + uz
        leg = self._prepared(probe)[0]
        along = ax * ux + ay * uy + az * uz
        limit, jerk = leg.acceleration_along, leg.jerk_along
        distance = kernel.stopping_distance(speed, along, 0.0, limit, jerk)
        return x + ux * distance, y + uy * distance, max(z + uz * distance, 0.0)

    def set_climb(self, climb_m_s: float | None, descent_m_s: float | None) -> None:
        """Limit the climb and descent speeds from the next route on; None selects the vehicle's limit."""
        spec = self.spec
        self._limit.climb_max = min(climb_m_s or math.inf, spec.climb_speed_m_s)
        self._limit.descent_max = min(descent_m_s or math.inf, spec.descent_speed_m_s)


# Fractions of the horizontal limits along the leg, across it (0.8^2 + 0.6^2 = 1), and normal to both.
_ALONG = 0.8
_ACROSS = 0.6
_NORMAL = 0.25


@compiled(allocates=False)
def _speed_within(distance: float, limit: float, jerk: float) -> float:
    """Return the speed at which motion on an axis can still stop within a distance."""
    v = (distance * sqrt(jerk)) ** (2.0 / 3.0)
    if v <= limit * limit / jerk:
        return float(v)
    ramp = limit / jerk
    return 0.5 * limit * (sqrt(ramp * ramp + 8.0 * distance / limit) - ramp)


@compiled(allocates=False)
def _shared(level: float, vertical: float, flat: float, rise: float) -> tuple[float, float, float]:
    """Return the limits along, across and normal to a leg, whose direction has parts `flat` and `rise`."""
    normal = _NORMAL * min(
        _ALONG * level / rise if rise > 0.0 else inf, vertical / flat if flat > 0.0 else inf
    )
    along = min(
        (_ALONG * level - rise * normal) / flat if flat > 0.0 else inf,
        (vertical - flat * normal) / rise if rise > 0.0 else inf,
    )
    return along, _ACROSS * level, normal


@compiled
def prepare_route(route: Record, states: Record, legs: Record, limits_of: Record) -> None:
    """Fill in the kernel's legs: directions, limits in the frame of each leg, and speeds at the corners.

    Parameters
    ----------
    route : LEG[n]
        Output, initially zero.
    states, limits_of : STATE[1], LIMITS[1]
        Start of the first leg, and the limits of the vehicle.
    legs : ROUTE[n]
    """
    state, limits, n = states[0], limits_of[0], len(legs)
    lengths = np.empty(n)
    bx, by, bz = state.position_x, state.position_y, state.position_z
    for i in range(n):
        row, leg = route[i], legs[i]
        row.x, row.y, row.z = leg.x, leg.y, leg.z
        dx, dy, dz = row.x - bx, row.y - by, row.z - bz
        flat = sqrt(dx * dx + dy * dy)
        length = sqrt(flat * flat + dz * dz)
        lengths[i] = length
        if length > 1e-6:
            row.along_x, row.along_y, row.along_z = dx / length, dy / length, dz / length
            flat /= length
        elif i > 0:
            row.along_x, row.along_y, row.along_z = (
                route[i - 1].along_x,
                route[i - 1].along_y,
                route[i - 1].along_z,
            )
            flat = route[i - 1].horizontal
        else:
            row.along_x, row.along_y, row.along_z = 1.0, 0.0, 0.0
            flat = 1.0
        if flat < 1e-6:
            row.along_x, row.along_y, row.along_z = 0.0, 0.0, 1.0 if row.along_z > 0.0 else -1.0
            flat = 0.0
        rise = abs(row.along_z)
        row.horizontal = flat
        if flat > 0.0:
            row.across_x, row.across_y = -row.along_y / flat, row.along_x / flat
        else:
            row.across_x, row.across_y = 0.0, 1.0
        row.normal_x = row.along_y * row.across_z - row.along_z * row.across_y
        row.normal_y = row.along_z * row.across_x - row.along_x * row.across_z
        row.normal_z = row.along_x * row.across_y - row.along_y * row.across_x
        # A margin of 0.1 % covers the error of the time step.
        up = 0.999 * (limits.climb_max if row.along_z > 0.0 else limits.descent_max)
        row.acceleration_along, row.acceleration_across, row.acceleration_normal = _shared(
            limits.acceleration_max, limits.vertical_acceleration, flat, rise
        )
        row.jerk_along, row.jerk_across, row.jerk_normal = _shared(
            limits.jerk_max, limits.vertical_jerk, flat, rise
        )
        row.speed_across = 0.3 * limits.speed_max
        lesser = min(limits.climb_max, limits.descent_max)
        row.speed_normal = _NORMAL * min(
            limits.speed_max / rise if rise > 0.0 else inf, lesser / flat if flat > 0.0 else inf
        )
        wanted = inf if isnan(leg.speed) else leg.speed
        if not isnan(leg.vertical) and flat == 0.0:
            up = min(up, leg.vertical)
        row.speed = min(
            min(wanted, 0.95 * limits.speed_max - rise * row.speed_normal) / flat if flat > 0.0 else inf,
            (up - flat * row.speed_normal) / rise if rise > 0.0 else inf,
        )
        row.radius = leg.radius if i < n - 1 else 0.0
        if leg.heading == inf or (isnan(leg.heading) and flat * length < 0.05):
            row.heading = np.nan
        elif isnan(leg.heading):
            row.heading = np.arctan2(row.along_x, row.along_y) % (2.0 * pi)
        else:
            row.heading = leg.heading % (2.0 * pi)
        row.near, row.turn_rate = leg.near, leg.turn
        bx, by, bz = row.x, row.y, row.z
    # A backward pass finds the speed at each corner, and the next position for which the vehicle must brake.
    # A corner that requires a lower speed than this braking becomes the next such position.
    slow, way = 0.0, 0.0
    for i in range(n - 1, -1, -1):
        row = route[i]
        if row.radius > 0.0:
            after = route[i + 1]
            corner = min(row.speed, after.speed)
            turn = 1.0
            axes = (
                (after.along_x, after.along_y, after.along_z, after.acceleration_along, after.jerk_along),
                (
                    after.across_x,
                    after.across_y,
                    after.across_z,
                    after.acceleration_across,
                    after.jerk_across,
                ),
                (
                    after.normal_x,
                    after.normal_y,
                    after.normal_z,
                    after.acceleration_normal,
                    after.jerk_normal,
                ),
            )
            for axis in range(3):
                x, y, z, limit, jerk = axes[axis]
                part = row.along_x * x + row.along_y * y + row.along_z * z
                if axis == 0:
                    turn = part
                    if part >= 0.0:
                        continue
                part = abs(part)
                if part > 1e-9:
                    corner = min(corner, _speed_within(max(part, 0.3) * row.radius, limit, jerk) / part)
            way = max(way + lengths[i + 1] + max(turn, 0.0) * row.radius - after.radius, 0.0)
            limit = after.acceleration_along if turn > 0.9 else 0.9 * after.acceleration_along
            ramp = limit * limit / after.jerk_along
            reach = 0.5 * (sqrt((ramp - 2.0 * slow) ** 2 + 8.0 * limit * way) - ramp)
            reach = max(slow, reach, _speed_within(way, limit, after.jerk_along))
            if corner < reach or turn < 0.9:
                slow, way = min(corner, reach), 0.0
        else:
            slow, way = 0.0, 0.0
        row.end_speed, row.beyond = slow, way
        v = row.speed + 0.5 * row.acceleration_along * row.acceleration_along / row.jerk_along
        row.braking_distance = v * (
            v / row.acceleration_along + 2.0 * row.acceleration_along / row.jerk_along
        )


def prepare_velocity(
    position: Position,
    velocity: tuple[float, float, float],
    height_m: float,
    heading_rad: float,
    turn_rad_s: float,
    limits: Record,
) -> Record:
    """Return the single leg of a flight at a velocity, LEG[1].

    The axes of the leg are the horizontal direction of flight, the horizontal direction across, and the
    vertical. The vehicle therefore reaches the velocity within the same limits as on other legs: 80 % of the
    horizontal limits along the leg, 60 % across it.

    Parameters
    ----------
    velocity : tuple of 3 floats
        East, north, up.
    height_m : float
        Height to hold in place of the vertical speed; NaN for none.
    heading_rad, turn_rad_s : float
        Heading and heading rate as in `Heading.numbers`: NaN follows the flight, infinity keeps the heading.
    """
    east, north, up = velocity
    speed = np.hypot(east, north)
    # The direction of a denormal number is not a unit vector.
    ux, uy = (east / speed, north / speed) if speed > 1e-12 else (1.0, 0.0)
    route = np.zeros(1, kernel.LEG)
    row = route[0]
    # The end of the leg is put out of reach, because the wind limit depends on the distance to the end.
    row.x, row.y = position[0] + 1e6 * ux, position[1] + 1e6 * uy
    row.z = position[2] if np.isnan(height_m) else height_m
    row.along_x, row.along_y = ux, uy
    row.across_x, row.across_y = -uy, ux
    row.normal_z = 1.0
    row.speed = min(speed, 0.95 * limits.speed_max)
    row.radius = kernel.VELOCITY if np.isnan(height_m) else kernel.AT_HEIGHT
    row.heading = np.nan
    if np.isfinite(heading_rad):
        row.heading = heading_rad % (2.0 * np.pi)
    elif np.isnan(heading_rad) and speed > 0.1:
        row.heading = atan2(ux, uy) % (2.0 * np.pi)
    row.acceleration_along, row.jerk_along = _ALONG * limits.acceleration_max, _ALONG * limits.jerk_max
    row.acceleration_across, row.jerk_across = _ACROSS * limits.acceleration_max, _ACROSS * limits.jerk_max
    row.acceleration_normal, row.jerk_normal = limits.vertical_acceleration, limits.vertical_jerk
    row.speed_across, row.speed_normal = limits.speed_max, limits.climb_max
    row.horizontal, row.turn_rate = 1.0, turn_rad_s
    row.climb = min(max(up, -0.999 * limits.descent_max), 0.999 * limits.climb_max)
    return route
