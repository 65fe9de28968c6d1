"""Compiled kernel of a generic multirotor: jerk-limited flight along the legs of a route.

docs/vehicle-model.md describes the model and its control law. Arrays are float64 unless noted; lengths are in
metres, angles in radians, positions east-north-up relative to home, headings clockwise from north.

One vehicle is a record of `STATE` and a row of `COUNTERS` integers. A batch of vehicles has an array of
records, an array of rows and a loop over `advance`.
"""

from __future__ import annotations

from enum import IntEnum
from math import atan2, inf, isnan, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.columns import Record, record_type
from sim_vehicle.motion.stepping import distance2, kernel_of, multirotor_power

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Vector = tuple[float, float, float]
Axis = tuple[float, float, float, float, float]
Turn = tuple[float, float]

# One leg: target, directions along, across and normal to the leg, and the limits on these axes.
Leg = IntEnum(
    "Leg",
    "X Y Z ALONG_X ALONG_Y ALONG_Z ACROSS_X ACROSS_Y ACROSS_Z NORMAL_X NORMAL_Y NORMAL_Z "
    "SPEED "  # Cruise speed.
    "END_SPEED "  # Speed to reach by braking.
    "RADIUS "  # Acceptance radius; 0 is a stop; VELOCITY and AT_HEIGHT are special values.
    "HEADING "  # Heading to turn to; NaN: keep the heading.
    "ACCELERATION_ALONG JERK_ALONG ACCELERATION_ACROSS JERK_ACROSS ACCELERATION_NORMAL JERK_NORMAL "
    "SPEED_ACROSS SPEED_NORMAL BRAKING_DISTANCE "
    "NEAR "  # Distance at which NEAR is reported.
    "HORIZONTAL "  # Horizontal part of the leg's direction.
    "BEYOND "  # Braking distance available beyond this leg.
    "TURN_RATE "  # Heading rate; NaN: the heading decides.
    "CLIMB",  # Vertical speed.
    start=0,
)
# Radii of endless legs: a velocity to keep, or a horizontal velocity at the height of the target.
VELOCITY, AT_HEIGHT = -1.0, -2.0
Limits = IntEnum(
    "Limits",
    "STEP_S SPEED_MAX AIRSPEED_MAX CLIMB_MAX DESCENT_MAX ACCELERATION_MAX JERK_MAX "
    "VERTICAL_ACCELERATION VERTICAL_JERK TURN_RATE TURN_ACCELERATION "
    "ENERGY_LIMIT "  # Used energy that ends the flight, J.
    "TOUCH_DOWN_SPEED",
    start=0,
)
LEG, LIMITS = record_type(Leg), record_type(Limits)

STOP_RADIUS = 0.05
STOP_SPEED = 0.1
# A leg has stalled if the vehicle stands still for this long, or if the leg takes longer than this plus 1.5
# times the time for the leg and its initial detour at the speed SLOWEST.
STALL_S = 30.0
SLOWEST = 0.3
# Distance to the region of interest (m) below which the nose keeps its direction.
ROI_NEAR = 0.5
CREEP = 3.0


@compiled(inline="late", allocates=False)
def stopping_distance(v: float, a: float, v_end: float, limit: float, jerk: float) -> float:
    """Return the shortest distance in which speed `v` and acceleration `a` become a steady speed `v_end`."""
    distance = 0.0
    if a > 0.0:
        t = a / jerk
        distance = t * (v + a * t / 3.0)
        v += 0.5 * a * t
        a = 0.0
    lost = v - v_end
    if lost <= 1e-6:
        return 0.0
    brake = -a
    peak = sqrt(jerk * lost + 0.5 * brake * brake)
    if peak <= brake:
        # Even an immediate release of the brake loses too much speed: return the distance until ``v_end``.
        t = (brake - sqrt(brake * brake - 2.0 * jerk * lost)) / jerk
        return distance + t * (v - t * (0.5 * brake - jerk * t / 6.0))
    if peak > limit:
        peak = limit if limit > brake else brake
    t = (peak - brake) / jerk
    distance += t * (v - t * (0.5 * brake + jerk * t / 6.0))
    v -= t * (brake + 0.5 * jerk * t)
    v_last = v_end + 0.5 * peak * peak / jerk
    if v > v_last:
        distance += 0.5 * (v + v_last) * (v - v_last) / peak
        v = v_last
    t = peak / jerk
    return distance + t * (v - peak * t / 3.0)


@compiled(inline="late", allocates=False)
def _gentle_acceleration(room: float, jerk: float, dt: float) -> float:
    """Return the acceleration that brings a speed exactly to its limit, from `room` below the limit.

    Releasing an acceleration in whole steps changes the speed by up to ``jerk dt^2 / 8`` more than in the
    continuous law. The last two steps bring the speed exactly to its limit; a remainder would oscillate.
    """
    change = jerk * dt
    last = change * dt
    if abs(room) <= last:
        return room / dt
    if room > 0.0:
        return sqrt(0.25 * change * change + 2.0 * jerk * (room - 0.125 * last)) - 0.5 * change
    return 0.5 * change - sqrt(0.25 * change * change - 2.0 * jerk * room)


@compiled(allocates=False)
def axis_acceleration(
    d: float, v: float, a: float, v_end: float, speed: float, limit: float, jerk: float, dt: float
) -> float:
    """Return the acceleration along an axis at the end of the step, for a target at the distance `d`.

    The result is the largest acceleration within the jerk and acceleration limits that still allows the
    vehicle to keep the speed limit and to reach `v_end` within the distance `d`. The vehicle does not
    overshoot the target, because each step preserves this condition.
    """
    sign = 1.0
    if d < 0.0:
        sign, d, v, a, v_end = -1.0, -d, -v, -a, 0.0
    change = jerk * dt
    if v_end == 0.0 and d < 0.01 and abs(v) < 0.02 and abs(a) < 0.1:
        rate = 64.0 * d - 48.0 * v - 12.0 * a
        step = min(max(rate * dt, -change), change)
        return sign * min(max(a + step, -limit), limit) if d + abs(v) + abs(a) > 1e-9 else sign * a
    low = max(a - change, min(-limit, a + change))
    room = speed - v - 0.5 * a * dt
    high = _gentle_acceleration(room, jerk, dt)
    if abs(high) < 1e-12:
        high = 0.0
    high = min(high, a + change, limit)
    if high <= low:
        return sign * low
    third = dt * dt / 6.0
    ahead = d - v * dt - third * 2.0 * a
    v_half = v + 0.5 * a * dt
    spare_high = ahead - third * high - stopping_distance(v_half + 0.5 * dt * high, high, v_end, limit, jerk)
    if spare_high >= 0.0:
        return sign * high
    spare_low = ahead - third * low - stopping_distance(v_half + 0.5 * dt * low, low, v_end, limit, jerk)
    if spare_low <= 0.0:
        return sign * low
    for _ in range(6):
        middle = low + (high - low) * spare_low / (spare_low - spare_high)
        spare = (
            ahead - third * middle - stopping_distance(v_half + 0.5 * dt * middle, middle, v_end, limit, jerk)
        )
        if spare >= 0.0:
            low, spare_low = middle, spare
            if spare < 1e-9:
                break
            spare_high *= 0.5
        else:
            high, spare_high = middle, spare
            spare_low *= 0.5
    return float(sign * low)


@compiled(allocates=False)
def velocity_acceleration(v: float, a: float, wanted: float, limit: float, jerk: float, dt: float) -> float:
    """Return the acceleration at the end of the step that leads to the speed `wanted` without overshoot."""
    change = jerk * dt
    low = max(a - change, min(-limit, a + change))
    high = min(a + change, max(limit, a - change))
    gentle = _gentle_acceleration(wanted - v - 0.5 * a * dt, jerk, dt)
    return float(min(max(gentle, low), high))


@compiled(allocates=False)
def _climb_acceleration(row: Record, height: float, v: float, a: float, limits: Record) -> float:
    """Return the vertical acceleration of a velocity leg, with a descent slow enough to touch down."""
    dt, limit, jerk = limits.step_s, row.acceleration_normal, row.jerk_normal
    if row.radius == AT_HEIGHT:
        d = row.z - height
        if abs(d) + abs(v) + abs(a) <= 1e-9:
            return 0.0
        speed = 0.999 * (limits.climb_max if d > 0.0 else limits.descent_max)
        return float(axis_acceleration(d, v, a, 0.0, speed, limit, jerk, dt))
    wanted = row.climb
    if wanted >= 0.0:
        return float(velocity_acceleration(v, a, wanted, limit, jerk, dt))
    end = min(-wanted, limits.touch_down_speed)
    return -float(axis_acceleration(max(height, 0.0), -v, -a, end, -wanted, limit, jerk, dt))


@compiled(allocates=False)
def _below_top_speed(
    vx: float, vy: float, ax: float, ay: float, bx: float, by: float, limits: Record
) -> tuple[float, float]:
    """Return the horizontal acceleration, reduced so that the speed limit is kept.

    The axes of a velocity leg turn with every order, and a leg may begin while the vehicle moves across it.
    The sum of the accelerations allowed per axis can then be too large. A quarter of the jerk is reserved for
    turning the velocity.
    """
    speed2 = vx * vx + vy * vy
    if speed2 < 0.25 * limits.speed_max * limits.speed_max:
        return bx, by
    dt, speed = limits.step_s, sqrt(speed2)
    ux, uy = vx / speed, vy / speed
    now = ax * ux + ay * uy
    outward = bx * ux + by * uy
    most = _gentle_acceleration(0.999 * limits.speed_max - speed - 0.5 * now * dt, 0.75 * limits.jerk_max, dt)
    if outward <= most:
        return bx, by
    change = limits.jerk_max * dt
    radial = max(most, now - change, -limits.acceleration_max) - now
    tangential = (by - ay) * ux - (bx - ax) * uy
    room = change * change - radial * radial
    free = sqrt(room) if room > 0.0 else 0.0
    tangential = min(max(tangential, -free), free)
    return ax + radial * ux - tangential * uy, ay + radial * uy + tangential * ux


@compiled(allocates=False)
def axes_of(row: Record) -> tuple[Axis, Axis, Axis]:
    """Return the three axes of a leg (along, across, normal), each with its acceleration and jerk limits."""
    return (
        (row.along_x, row.along_y, row.along_z, row.acceleration_along, row.jerk_along),
        (row.across_x, row.across_y, row.across_z, row.acceleration_across, row.jerk_across),
        (row.normal_x, row.normal_y, row.normal_z, row.acceleration_normal, row.jerk_normal),
    )


@compiled(allocates=False)
def _detour(row: Record, velocity: Vector, acceleration: Vector) -> float:
    """Return the approximate extra path at the start of a leg until the motion off the leg has stopped.

    A leg may begin while the vehicle moves across or against it, as with a climb ordered in fast flight. The
    vehicle then brakes across the leg, within the small limits of these axes.
    """
    detour = 0.0
    axes = axes_of(row)
    for axis in range(3):
        x, y, z, limit, jerk = axes[axis]
        v = velocity[0] * x + velocity[1] * y + velocity[2] * z
        a = acceleration[0] * x + acceleration[1] * y + acceleration[2] * z
        if axis == 0 or v < 0.0:
            v, a = -v, -a
        if a > 0.0:
            v += 0.5 * a * a / jerk
        if v > 0.0:
            detour += v * (0.5 * v / limit + limit / jerk)
    return detour


@compiled(allocates=False)
def turn_at(yaw: float, rate: float, wanted: float, most: float, change: float, dt: float) -> Turn:
    """Return heading and heading rate after a step; the rate approaches `wanted` by at most `change`."""
    wanted = min(max(wanted, -most), most)
    rate += min(max(wanted - rate, -change), change)
    return (yaw + rate * dt) % (2.0 * pi), rate


@compiled(allocates=False)
def turn_to(yaw: float, rate: float, heading: float, most: float, acceleration: float, dt: float) -> Turn:
    """Return heading and heading rate after a step of a turn that stops at `heading`."""
    error = (heading - yaw + pi) % (2.0 * pi) - pi
    size = abs(error)
    if size < 1e-6 and abs(rate) < 1e-4:
        return heading, 0.0
    aim = min(most, 2.0 * size, 0.8 * sqrt(2.0 * acceleration * size))
    return turn_at(yaw, rate, aim if error > 0.0 else -aim, most, acceleration * dt, dt)


@compiled(inline="always")
def _enter(state: Record, counters: Integers, route: Record, limits: Record, own: tuple[()]) -> None:
    """Do nothing: a leg needs no preparation."""


@compiled(inline="always")
def _feel(
    state: Record, counters: Integers, row: Record, air: Vector, limits: Record, power: Floats, own: tuple[()]
) -> bool:
    state.wind_east, state.wind_north = air[0], air[1]
    vx, vy, vz = state.velocity_x, state.velocity_y, state.velocity_z
    ax, ay, az = state.acceleration_x, state.acceleration_y, state.acceleration_z
    state.power = multirotor_power(
        power, vx - state.wind_east, vy - state.wind_north, vz - air[2], ax, ay, az
    )
    if counters[col.ARRIVED] != 0 or row.radius < 0.0:
        return False
    step, dt = counters[col.STEP], limits.step_s
    if state.give_up_step == inf:
        left = sqrt(distance2(state, row.x, row.y, row.z)) + _detour(row, (vx, vy, vz), (ax, ay, az))
        state.give_up_step = step + (STALL_S + 1.5 * left / min(row.speed, SLOWEST)) / dt
        counters[col.MOVED_STEP] = step
    if vx * vx + vy * vy + vz * vz > 0.0025 * min(row.speed * row.speed, 1.0):
        counters[col.MOVED_STEP] = step
    return bool((step - counters[col.MOVED_STEP]) * dt > STALL_S or step > state.give_up_step)


@compiled(allocates=False)
def _turn(state: Record, row: Record, limits: Record) -> None:
    """Turn at the leg's rate, or else to the region of interest or the leg's heading, or stop turning."""
    heading = row.heading
    if not isnan(state.look_east):
        east, north = state.look_east - state.position_x, state.look_north - state.position_y
        near = east * east + north * north <= ROI_NEAR * ROI_NEAR
        heading = state.heading if near else atan2(east, north) % (2.0 * pi)
    yaw, rate, dt = state.heading, state.heading_rate, limits.step_s
    most, change = limits.turn_rate, limits.turn_acceleration * dt
    if not isnan(row.turn_rate):
        yaw, rate = turn_at(yaw, rate, row.turn_rate, most, change, dt)
    elif not isnan(heading) and (heading != yaw or rate != 0.0):
        yaw, rate = turn_to(yaw, rate, heading, most, limits.turn_acceleration, dt)
    elif rate != 0.0:
        yaw, rate = turn_at(yaw, rate, 0.0, most, change, dt)
    state.heading, state.heading_rate = yaw, rate


@compiled(allocates=False)
def _reached(state: Record, row: Record) -> bool:
    """Return whether the leg is complete: on the ground, within the radius, or at rest at its end."""
    if row.radius < 0.0:
        return bool(row.radius == VELOCITY and row.climb < 0.0 and state.position_z <= 0.0)
    left2 = distance2(state, row.x, row.y, row.z)
    if row.radius > 0.0:
        return bool(left2 <= row.radius * row.radius)
    speed2 = state.velocity_x**2 + state.velocity_y**2 + state.velocity_z**2
    return bool(left2 <= STOP_RADIUS * STOP_RADIUS and speed2 <= STOP_SPEED * STOP_SPEED)


@compiled(inline="always")
def _move(state: Record, counters: Integers, route: Record, limits: Record, own: tuple[()]) -> bool:
    row, dt = route[counters[col.LEG_INDEX]], limits.step_s
    px, py, pz = state.position_x, state.position_y, state.position_z
    vx, vy, vz = state.velocity_x, state.velocity_y, state.velocity_z
    ax, ay, az = state.acceleration_x, state.acceleration_y, state.acceleration_z
    ux, uy, uz, nx, ny = row.along_x, row.along_y, row.along_z, row.across_x, row.across_y
    wx, wy, wz = row.normal_x, row.normal_y, row.normal_z
    leave, radius, horizontal = row.end_speed, row.radius, row.horizontal
    rx, ry, rz = row.x - px, row.y - py, row.z - pz
    # Along the leg, across it, and normal to both: the state in the leg's frame.
    ds = rx * ux + ry * uy + rz * uz
    vs = vx * ux + vy * uy + vz * uz
    accs = ax * ux + ay * uy + az * uz
    dn = rx * nx + ry * ny
    vn = vx * nx + vy * ny
    accn = ax * nx + ay * ny
    dw = rx * wx + ry * wy + rz * wz
    vw = vx * wx + vy * wy + vz * wz
    accw = ax * wx + ay * wy + az * wz
    speed = row.speed
    if horizontal > 0.0:
        free = limits.speed_max * limits.speed_max - vn * vn
        most = (sqrt(free) if free > 0.0 else 0.0) / horizontal
        if most < speed:
            speed = most
        if (state.wind_east != 0.0 or state.wind_north != 0.0) and horizontal > 0.05:
            ex, ey = ux / horizontal, uy / horizontal
            tail = state.wind_east * ex + state.wind_north * ey
            side = state.wind_east * ey - state.wind_north * ex
            free = limits.airspeed_max * limits.airspeed_max - side * side
            most = (tail + sqrt(free)) / horizontal if free > 0.0 else 0.0
            # Near the target a limit below SLOWEST does not apply, or a vehicle could never stop in a storm.
            if most < speed and (most > SLOWEST or ds > CREEP):
                speed = most if most > SLOWEST else 0.0
    if abs(vw) > row.speed_normal and uz != 0.0:
        most = 0.999 * (limits.climb_max if uz > 0.0 else limits.descent_max) - horizontal * abs(vw)
        most = most / abs(uz) if most > 0.0 else 0.0
        if most < speed:
            speed = most
    if radius < 0.0:
        s1 = velocity_acceleration(vs, accs, speed, row.acceleration_along, row.jerk_along, dt)
    elif radius > 0.0 and ds >= 0.0:
        ahead = row.beyond + (ds - radius if ds > radius else 0.0)
        if ahead == 0.0 and vs <= leave and leave < speed:
            speed = leave
        if ahead > row.braking_distance and vs <= speed:
            ahead = 1e9
        s1 = axis_acceleration(ahead, vs, accs, leave, speed, row.acceleration_along, row.jerk_along, dt)
    else:
        s1 = axis_acceleration(ds, vs, accs, 0.0, speed, row.acceleration_along, row.jerk_along, dt)
    n1 = accn
    if radius < 0.0:
        n1 = velocity_acceleration(vn, accn, 0.0, row.acceleration_across, row.jerk_across, dt)
    elif abs(dn) + abs(vn) + abs(accn) > 1e-9:
        n1 = axis_acceleration(
            dn, vn, accn, 0.0, row.speed_across, row.acceleration_across, row.jerk_across, dt
        )
    w1 = accw
    if radius < 0.0:
        w1 = _climb_acceleration(row, pz, vz, az, limits)
    elif abs(dw) + abs(vw) + abs(accw) > 1e-9:
        w1 = axis_acceleration(
            dw, vw, accw, 0.0, row.speed_normal, row.acceleration_normal, row.jerk_normal, dt
        )
    bx = s1 * ux + n1 * nx + w1 * wx
    by = s1 * uy + n1 * ny + w1 * wy
    bz = s1 * uz + w1 * wz
    if radius < 0.0 or abs(vw) > row.speed_normal or abs(vn) > row.speed_across:
        bx, by = _below_top_speed(vx, vy, ax, ay, bx, by, limits)
    norm2 = bx * bx + by * by
    most = limits.acceleration_max * limits.acceleration_max
    if norm2 > most:
        scale = sqrt(most / norm2)
        bx *= scale
        by *= scale
    bz = min(max(bz, -limits.vertical_acceleration), limits.vertical_acceleration)
    # A new leg may leave the vertical axis too little jerk to end the previous leg's motion.
    if vz > 0.5 * limits.climb_max:
        most = _gentle_acceleration(limits.climb_max - vz - 0.5 * az * dt, limits.vertical_jerk, dt)
        bz = max(min(bz, most), az - limits.vertical_jerk * dt, -limits.vertical_acceleration)
    elif vz < -0.5 * limits.descent_max:
        most = _gentle_acceleration(limits.descent_max + vz + 0.5 * az * dt, limits.vertical_jerk, dt)
        bz = min(max(bz, -most), az + limits.vertical_jerk * dt, limits.vertical_acceleration)
    third = dt * dt / 6.0
    mx = vx * dt + third * (2.0 * ax + bx)
    my = vy * dt + third * (2.0 * ay + by)
    mz = vz * dt + third * (2.0 * az + bz)
    state.position_x, state.position_y, state.position_z = px + mx, py + my, pz + mz
    state.path_length += sqrt(mx * mx + my * my + mz * mz)
    state.velocity_x = vx + 0.5 * dt * (ax + bx)
    state.velocity_y = vy + 0.5 * dt * (ay + by)
    state.velocity_z = vz + 0.5 * dt * (az + bz)
    state.acceleration_x, state.acceleration_y, state.acceleration_z = bx, by, bz
    _turn(state, row, limits)
    return _reached(state, row)


@compiled(inline="always")
def _leave(
    state: Record, counters: Integers, row: Record, route: Record, limits: Record, own: tuple[()]
) -> None:
    state.give_up_step = inf


advance = kernel_of(__name__, _enter, _feel, _move, _leave)
