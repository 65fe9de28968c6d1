"""The legs of a route for the kernel: directions, limits in the frame of each leg, speeds at the corners."""

from __future__ import annotations

from math import inf, isnan, pi, sqrt

import numpy as np

from geo.compiled import compiled
from sim_vehicle.motion.multirotor.kernel import (
    ACCELERATION_MAX,
    AT_HEIGHT,
    CLIMB_MAX,
    DESCENT_MAX,
    JERK_MAX,
    LEG,
    LEG_ACCELERATION_ALONG,
    LEG_ACROSS_X,
    LEG_ACROSS_Y,
    LEG_ACROSS_Z,
    LEG_ALONG_X,
    LEG_ALONG_Y,
    LEG_ALONG_Z,
    LEG_BEYOND,
    LEG_BRAKING_DISTANCE,
    LEG_CLIMB,
    LEG_END_SPEED,
    LEG_HEADING,
    LEG_HORIZONTAL,
    LEG_JERK_ALONG,
    LEG_NEAR,
    LEG_NORMAL_X,
    LEG_NORMAL_Y,
    LEG_NORMAL_Z,
    LEG_RADIUS,
    LEG_SPEED,
    LEG_SPEED_ACROSS,
    LEG_SPEED_NORMAL,
    LEG_TURN_RATE,
    LEG_X,
    LEG_Y,
    LEG_Z,
    SPEED_MAX,
    VELOCITY,
    VERTICAL_ACCELERATION,
    VERTICAL_JERK,
    Floats,
)

# How the horizontal limits are shared: along the leg and across it (0.8^2 + 0.6^2 = 1), and normal to both.
ALONG = 0.8
ACROSS = 0.6
NORMAL = 0.25


@compiled
def _speed_within(distance: float, limit: float, jerk: float) -> float:
    """Return the speed from which an axis stops within a distance, starting with no acceleration."""
    v = (distance * sqrt(jerk)) ** (2.0 / 3.0)
    if v <= limit * limit / jerk:
        return float(v)
    ramp = limit / jerk
    return 0.5 * limit * (sqrt(ramp * ramp + 8.0 * distance / limit) - ramp)


@compiled
def prepare_route(
    start: Floats,
    points: Floats,
    radius: Floats,
    speed: Floats,
    climbing: Floats,
    heading: Floats,
    turning: Floats,
    near: Floats,
    limits: Floats,
) -> Floats:
    """Return the legs of a route: directions, limits in the frame of each leg, and the speeds at the corners.

    Parameters
    ----------
    start : float64[3]
        Where the first leg begins.
    points : float64[n, 3]
    radius : float64[n]
        Acceptance radius; 0 stops there. The last point is always a stop.
    speed : float64[n]
        Horizontal ground speed of the leg, NaN for the greatest.
    climbing : float64[n]
        Speed of a vertical leg, NaN for the greatest.
    heading : float64[n]
        Heading on the leg; NaN is the direction of the leg, infinity keeps the heading.
    turning : float64[n]
        Rate of turning, NaN turns to the headings.
    near : float64[n]
        Distance to the point at which to return NEAR, 0 for never.
    """
    n = points.shape[0]
    route = np.zeros((n, LEG))
    lengths = np.empty(n)
    bx, by, bz = start[0], start[1], start[2]
    for i in range(n):
        row = route[i]
        for k in range(3):
            row[k] = points[i, k]
        dx, dy, dz = row[LEG_X] - bx, row[LEG_Y] - by, row[LEG_Z] - bz
        flat = sqrt(dx * dx + dy * dy)
        length = sqrt(flat * flat + dz * dz)
        lengths[i] = length
        if length > 1e-6:
            row[LEG_ALONG_X], row[LEG_ALONG_Y], row[LEG_ALONG_Z] = dx / length, dy / length, dz / length
            flat /= length
        elif i > 0:
            row[LEG_ALONG_X], row[LEG_ALONG_Y], row[LEG_ALONG_Z] = (
                route[i - 1, LEG_ALONG_X],
                route[i - 1, LEG_ALONG_Y],
                route[i - 1, LEG_ALONG_Z],
            )
            flat = route[i - 1, LEG_HORIZONTAL]
        else:
            row[LEG_ALONG_X], row[LEG_ALONG_Y], row[LEG_ALONG_Z] = 1.0, 0.0, 0.0
            flat = 1.0
        if flat < 1e-6:
            row[LEG_ALONG_X], row[LEG_ALONG_Y], row[LEG_ALONG_Z] = (
                0.0,
                0.0,
                1.0 if row[LEG_ALONG_Z] > 0.0 else -1.0,
            )
            flat = 0.0
        rise = abs(row[LEG_ALONG_Z])
        row[LEG_HORIZONTAL] = flat
        if flat > 0.0:
            row[LEG_ACROSS_X], row[LEG_ACROSS_Y] = -row[LEG_ALONG_Y] / flat, row[LEG_ALONG_X] / flat
        else:
            row[LEG_ACROSS_X], row[LEG_ACROSS_Y] = 0.0, 1.0
        row[LEG_NORMAL_X] = row[LEG_ALONG_Y] * row[LEG_ACROSS_Z] - row[LEG_ALONG_Z] * row[LEG_ACROSS_Y]
        row[LEG_NORMAL_Y] = row[LEG_ALONG_Z] * row[LEG_ACROSS_X] - row[LEG_ALONG_X] * row[LEG_ACROSS_Z]
        row[LEG_NORMAL_Z] = row[LEG_ALONG_X] * row[LEG_ACROSS_Y] - row[LEG_ALONG_Y] * row[LEG_ACROSS_X]
        # A thousandth is kept for what the time step adds.
        up = 0.999 * (limits[CLIMB_MAX] if row[LEG_ALONG_Z] > 0.0 else limits[DESCENT_MAX])
        for k, across, vertical in (
            (LEG_ACCELERATION_ALONG, limits[ACCELERATION_MAX], limits[VERTICAL_ACCELERATION]),
            (LEG_JERK_ALONG, limits[JERK_MAX], limits[VERTICAL_JERK]),
        ):
            row[k + 2] = ACROSS * across
            normal = min(ALONG * across / rise if rise > 0.0 else inf, vertical / flat if flat > 0.0 else inf)
            row[k + 4] = NORMAL * normal
            row[k] = min(
                (ALONG * across - rise * row[k + 4]) / flat if flat > 0.0 else inf,
                (vertical - flat * row[k + 4]) / rise if rise > 0.0 else inf,
            )
        row[LEG_SPEED_ACROSS] = 0.3 * limits[SPEED_MAX]
        lesser = min(limits[CLIMB_MAX], limits[DESCENT_MAX])
        row[LEG_SPEED_NORMAL] = NORMAL * min(
            limits[SPEED_MAX] / rise if rise > 0.0 else inf, lesser / flat if flat > 0.0 else inf
        )
        wanted = inf if isnan(speed[i]) else speed[i]
        if not isnan(climbing[i]) and flat == 0.0:
            up = min(up, climbing[i])
        row[LEG_SPEED] = min(
            min(wanted, 0.95 * limits[SPEED_MAX] - rise * row[LEG_SPEED_NORMAL]) / flat
            if flat > 0.0
            else inf,
            (up - flat * row[LEG_SPEED_NORMAL]) / rise if rise > 0.0 else inf,
        )
        row[LEG_RADIUS] = radius[i] if i < n - 1 else 0.0
        if heading[i] == inf or (isnan(heading[i]) and flat * length < 0.05):
            row[LEG_HEADING] = np.nan
        elif isnan(heading[i]):
            row[LEG_HEADING] = np.arctan2(row[LEG_ALONG_X], row[LEG_ALONG_Y]) % (2.0 * pi)
        else:
            row[LEG_HEADING] = heading[i] % (2.0 * pi)
        row[LEG_NEAR] = near[i]
        row[LEG_TURN_RATE] = turning[i]
        bx, by, bz = row[LEG_X], row[LEG_Y], row[LEG_Z]
    # Backwards: the speed at each corner, and the next position that the vehicle has to brake for. A corner
    # that is slower than what braking for that position allows becomes such a position itself.
    slow, way = 0.0, 0.0
    for i in range(n - 1, -1, -1):
        row = route[i]
        if row[LEG_RADIUS] > 0.0:
            after = route[i + 1]
            corner = min(row[LEG_SPEED], after[LEG_SPEED])
            turn = 1.0
            for axis in range(3):
                part = 0.0
                for k in range(3):
                    part += row[LEG_ALONG_X + k] * after[LEG_ALONG_X + 3 * axis + k]
                if axis == 0:
                    turn = part
                    if part >= 0.0:
                        continue
                part = abs(part)
                if part > 1e-9:
                    room = max(part, 0.3) * row[LEG_RADIUS]
                    corner = min(
                        corner,
                        _speed_within(
                            room, after[LEG_ACCELERATION_ALONG + 2 * axis], after[LEG_JERK_ALONG + 2 * axis]
                        )
                        / part,
                    )
            way = max(way + lengths[i + 1] + max(turn, 0.0) * row[LEG_RADIUS] - after[LEG_RADIUS], 0.0)
            limit = after[LEG_ACCELERATION_ALONG] if turn > 0.9 else 0.9 * after[LEG_ACCELERATION_ALONG]
            ramp = limit * limit / after[LEG_JERK_ALONG]
            reach = 0.5 * (sqrt((ramp - 2.0 * slow) ** 2 + 8.0 * limit * way) - ramp)
            reach = max(slow, reach, _speed_within(way, limit, after[LEG_JERK_ALONG]))
            if corner < reach or turn < 0.9:
                slow, way = min(corner, reach), 0.0
        else:
            slow, way = 0.0, 0.0
        row[LEG_END_SPEED], row[LEG_BEYOND] = slow, way
        v = (
            row[LEG_SPEED]
            + 0.5 * row[LEG_ACCELERATION_ALONG] * row[LEG_ACCELERATION_ALONG] / row[LEG_JERK_ALONG]
        )
        row[LEG_BRAKING_DISTANCE] = v * (
            v / row[LEG_ACCELERATION_ALONG] + 2.0 * row[LEG_ACCELERATION_ALONG] / row[LEG_JERK_ALONG]
        )
    return route


def prepare_velocity(
    position: Floats,
    velocity: tuple[float, float, float],
    height_m: float,
    heading_rad: float,
    turn_rad_s: float,
    limits: Floats,
) -> Floats:
    """Return the one leg of a flight at a velocity, float64[1, LEG].

    Its axes are the horizontal direction of flight, the one across it, and the vertical, so the velocity
    comes about within the limits of any other leg: 80 % of the horizontal ones along, 60 % across.

    Parameters
    ----------
    position : float64[3]
    velocity : tuple of 3 floats
        East, north, up.
    height_m : float
        Height to keep in place of the vertical speed, NaN for none.
    heading_rad, turn_rad_s : float
        As in `prepare_route`; a heading of NaN is that of the flight, infinity keeps it.
    """
    east, north, up = velocity
    speed = np.hypot(east, north)
    ux, uy = (east / speed, north / speed) if speed > 0.0 else (1.0, 0.0)
    row = np.zeros(LEG)
    row[:LEG_ALONG_X] = position
    # So far that it is never reached; the wind's limit looks at what is left of the leg.
    row[LEG_X] += 1e6 * ux
    row[LEG_Y] += 1e6 * uy
    row[LEG_ALONG_X:LEG_SPEED] = ux, uy, 0.0, -uy, ux, 0.0, 0.0, 0.0, 1.0
    row[LEG_SPEED] = min(speed, 0.95 * limits[SPEED_MAX])
    row[LEG_RADIUS] = VELOCITY if np.isnan(height_m) else AT_HEIGHT
    row[LEG_HEADING] = np.nan
    if np.isfinite(heading_rad):
        row[LEG_HEADING] = heading_rad % (2.0 * np.pi)
    elif np.isnan(heading_rad) and speed > 0.1:
        row[LEG_HEADING] = np.arctan2(ux, uy) % (2.0 * np.pi)
    row[LEG_ACCELERATION_ALONG:LEG_SPEED_ACROSS] = (
        ALONG * limits[ACCELERATION_MAX],
        ALONG * limits[JERK_MAX],
        ACROSS * limits[ACCELERATION_MAX],
        ACROSS * limits[JERK_MAX],
        limits[VERTICAL_ACCELERATION],
        limits[VERTICAL_JERK],
    )
    row[LEG_SPEED_ACROSS], row[LEG_SPEED_NORMAL], row[LEG_HORIZONTAL], row[LEG_TURN_RATE] = (
        limits[SPEED_MAX],
        limits[CLIMB_MAX],
        1.0,
        turn_rad_s,
    )
    row[LEG_CLIMB] = min(max(up, -0.999 * limits[DESCENT_MAX]), 0.999 * limits[CLIMB_MAX])
    if not np.isnan(height_m):
        row[LEG_Z] = height_m
    return row[np.newaxis]
