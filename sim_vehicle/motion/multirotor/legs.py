"""The legs of a route for the kernel: directions, limits in the frame of each leg, speeds at the corners."""

from __future__ import annotations

from math import inf, isnan, pi, sqrt

import numpy as np

from geo.compiled import compiled
from sim_vehicle.motion.multirotor.kernel import AT_HEIGHT, LEG, VELOCITY, Floats

# How the horizontal limits are shared: along the leg and across it (0.8^2 + 0.6^2 = 1), and aslant.
ALONG = 0.8
ACROSS = 0.6
ASLANT = 0.25


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
        dx, dy, dz = row[0] - bx, row[1] - by, row[2] - bz
        flat = sqrt(dx * dx + dy * dy)
        length = sqrt(flat * flat + dz * dz)
        lengths[i] = length
        if length > 1e-6:
            row[3], row[4], row[5] = dx / length, dy / length, dz / length
            flat /= length
        elif i > 0:
            row[3], row[4], row[5] = route[i - 1, 3], route[i - 1, 4], route[i - 1, 5]
            flat = route[i - 1, 26]
        else:
            row[3], row[4], row[5] = 1.0, 0.0, 0.0
            flat = 1.0
        if flat < 1e-6:
            row[3], row[4], row[5] = 0.0, 0.0, 1.0 if row[5] > 0.0 else -1.0
            flat = 0.0
        rise = abs(row[5])
        row[26] = flat
        if flat > 0.0:
            row[6], row[7] = -row[4] / flat, row[3] / flat
        else:
            row[6], row[7] = 0.0, 1.0
        row[9] = row[4] * row[8] - row[5] * row[7]
        row[10] = row[5] * row[6] - row[3] * row[8]
        row[11] = row[3] * row[7] - row[4] * row[6]
        # A thousandth is kept for what the time step adds.
        up = 0.999 * (limits[3] if row[5] > 0.0 else limits[4])
        for k, across, vertical in ((16, limits[5], limits[7]), (17, limits[6], limits[8])):
            row[k + 2] = ACROSS * across
            aslant = min(ALONG * across / rise if rise > 0.0 else inf, vertical / flat if flat > 0.0 else inf)
            row[k + 4] = ASLANT * aslant
            row[k] = min(
                (ALONG * across - rise * row[k + 4]) / flat if flat > 0.0 else inf,
                (vertical - flat * row[k + 4]) / rise if rise > 0.0 else inf,
            )
        row[22] = 0.3 * limits[1]
        lesser = min(limits[3], limits[4])
        row[23] = ASLANT * min(limits[1] / rise if rise > 0.0 else inf, lesser / flat if flat > 0.0 else inf)
        wanted = inf if isnan(speed[i]) else speed[i]
        if not isnan(climbing[i]) and flat == 0.0:
            up = min(up, climbing[i])
        row[12] = min(
            min(wanted, 0.95 * limits[1] - rise * row[23]) / flat if flat > 0.0 else inf,
            (up - flat * row[23]) / rise if rise > 0.0 else inf,
        )
        row[14] = radius[i] if i < n - 1 else 0.0
        if heading[i] == inf or (isnan(heading[i]) and flat * length < 0.05):
            row[15] = np.nan
        elif isnan(heading[i]):
            row[15] = np.arctan2(row[3], row[4]) % (2.0 * pi)
        else:
            row[15] = heading[i] % (2.0 * pi)
        row[25] = near[i]
        row[28] = turning[i]
        bx, by, bz = row[0], row[1], row[2]
    # Backwards: the speed at each corner, and the next place that the vehicle has to brake for. A corner
    # that is slower than what braking for that place allows becomes such a place itself.
    slow, way = 0.0, 0.0
    for i in range(n - 1, -1, -1):
        row = route[i]
        if row[14] > 0.0:
            after = route[i + 1]
            corner = min(row[12], after[12])
            turn = 1.0
            for axis in range(3):
                part = 0.0
                for k in range(3):
                    part += row[3 + k] * after[3 + 3 * axis + k]
                if axis == 0:
                    turn = part
                    if part >= 0.0:
                        continue
                part = abs(part)
                if part > 1e-9:
                    room = max(part, 0.3) * row[14]
                    corner = min(
                        corner, _speed_within(room, after[16 + 2 * axis], after[17 + 2 * axis]) / part
                    )
            way = max(way + lengths[i + 1] + max(turn, 0.0) * row[14] - after[14], 0.0)
            limit = after[16] if turn > 0.9 else 0.9 * after[16]
            ramp = limit * limit / after[17]
            reach = 0.5 * (sqrt((ramp - 2.0 * slow) ** 2 + 8.0 * limit * way) - ramp)
            reach = max(slow, reach, _speed_within(way, limit, after[17]))
            if corner < reach or turn < 0.9:
                slow, way = min(corner, reach), 0.0
        else:
            slow, way = 0.0, 0.0
        row[13], row[27] = slow, way
        v = row[12] + 0.5 * row[16] * row[16] / row[17]
        row[24] = v * (v / row[16] + 2.0 * row[16] / row[17])
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
    row[:3] = position
    # So far that it is never reached; the wind's limit looks at what is left of the leg.
    row[0] += 1e6 * ux
    row[1] += 1e6 * uy
    row[3:12] = ux, uy, 0.0, -uy, ux, 0.0, 0.0, 0.0, 1.0
    row[12] = min(speed, 0.95 * limits[1])
    row[14] = VELOCITY if np.isnan(height_m) else AT_HEIGHT
    row[15] = np.nan
    if np.isfinite(heading_rad):
        row[15] = heading_rad % (2.0 * np.pi)
    elif np.isnan(heading_rad) and speed > 0.1:
        row[15] = np.arctan2(ux, uy) % (2.0 * np.pi)
    row[16:22] = (
        ALONG * limits[5],
        ALONG * limits[6],
        ACROSS * limits[5],
        ACROSS * limits[6],
        limits[7],
        limits[8],
    )
    row[22], row[23], row[26], row[28] = limits[1], limits[3], 1.0, turn_rad_s
    row[29] = min(max(up, -0.999 * limits[4]), 0.999 * limits[3])
    if not np.isnan(height_m):
        row[2] = height_m
    return row[np.newaxis]
