"""The compiled motion of one multirotor: jerk-limited flight along the legs of a route.

The model and its control law are described in docs/vehicle-model.md. All arrays are float64 unless said
otherwise; lengths in metres, angles in radians, east-north-up about home, headings clockwise from north.

One vehicle is a row of `STATE` numbers and a row of `COUNTERS` integers, so a batch of vehicles is two
arrays and a loop over `advance`.
"""

from __future__ import annotations

from math import atan2, inf, isnan, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.energy.power_kernels import multirotor_power
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.rules import complete_leg, mark_track, wind_row
from sim_vehicle.weather.columns import AIR_EAST, AIR_NORTH
from sim_vehicle.weather.gust_kernel import wind_at

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Vector = tuple[float, float, float]

# One leg: its target, the directions along, across and normal to it, and the limits on these axes.
(
    LEG_X,
    LEG_Y,
    LEG_Z,
    LEG_ALONG_X,
    LEG_ALONG_Y,
    LEG_ALONG_Z,
    LEG_ACROSS_X,
    LEG_ACROSS_Y,
    LEG_ACROSS_Z,
    LEG_NORMAL_X,
    LEG_NORMAL_Y,
    LEG_NORMAL_Z,
    LEG_SPEED,  # Cruise speed.
    LEG_END_SPEED,  # Speed to brake to.
    LEG_RADIUS,  # Acceptance radius; 0: stop; or VELOCITY, AT_HEIGHT.
    LEG_HEADING,  # NaN: keep.
    LEG_ACCELERATION_ALONG,
    LEG_JERK_ALONG,
    LEG_ACCELERATION_ACROSS,
    LEG_JERK_ACROSS,
    LEG_ACCELERATION_NORMAL,
    LEG_JERK_NORMAL,
    LEG_SPEED_ACROSS,
    LEG_SPEED_NORMAL,
    LEG_BRAKING_DISTANCE,
    LEG_NEAR,  # Distance to notify at.
    LEG_HORIZONTAL,  # Horizontal part of the leg.
    LEG_BEYOND,  # Path beyond this leg to brake in.
    LEG_TURN_RATE,  # NaN: by the heading.
    LEG_CLIMB,  # Vertical speed.
) = range(30)
LEG = 30
# Radii of legs that have no end: a velocity is kept, or a horizontal velocity at the height of the target.
VELOCITY, AT_HEIGHT = -1.0, -2.0
# Limits.
(
    STEP_S,
    SPEED_MAX,
    AIRSPEED_MAX,
    CLIMB_MAX,
    DESCENT_MAX,
    ACCELERATION_MAX,
    JERK_MAX,
    VERTICAL_ACCELERATION,
    VERTICAL_JERK,
    TURN_RATE,
    TURN_ACCELERATION,
    ENERGY_LIMIT,  # Energy that ends the flight, J.
    TOUCH_DOWN_SPEED,
) = range(13)
LIMITS = 13

STOP_RADIUS = 0.05
STOP_SPEED = 0.1
# A leg is given up when the vehicle stands still for so long, or when it takes longer than its length, and
# the detour with which it begins, take at the slowest speed.
STALL_S = 30.0
SLOWEST = 0.3
# Nearer than this to the position that it points at, the nose keeps its direction.
ROI_NEAR = 0.5
CREEP = 3.0


@compiled(inline="always")
def stopping_distance(v: float, a: float, v_end: float, limit: float, jerk: float) -> float:
    """Return the least distance in which speed ``v``, acceleration ``a`` become a steady ``v_end``."""
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
        # Letting go of the brake loses too much already: the distance to where ``v_end`` is passed.
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


@compiled(inline="always")
def _gentle_acceleration(room: float, jerk: float, dt: float) -> float:
    """Return the acceleration from which a speed that is ``room`` below its limit just reaches it.

    Letting go of an acceleration in whole steps changes the speed by up to ``jerk dt^2 / 8`` more than in the
    continuous law; the last bit takes two steps, which leaves no remainder to oscillate about.
    """
    change = jerk * dt
    last = change * dt
    if abs(room) <= last:
        return room / dt
    if room > 0.0:
        return sqrt(0.25 * change * change + 2.0 * jerk * (room - 0.125 * last)) - 0.5 * change
    return 0.5 * change - sqrt(0.25 * change * change - 2.0 * jerk * room)


@compiled
def axis_acceleration(
    d: float, v: float, a: float, v_end: float, speed: float, limit: float, jerk: float, dt: float
) -> float:
    """Return the acceleration at the end of the step that brings one axis to its target.

    The largest one, within the jerk and acceleration limits, after which the speed limit can still be kept
    and the axis can still come to ``v_end`` within the remaining distance ``d``. A state from which that is
    possible is never left, so the target is not overshot.
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


@compiled
def velocity_acceleration(v: float, a: float, wanted: float, limit: float, jerk: float, dt: float) -> float:
    """Return the acceleration at the end of the step that brings one axis to a speed, without overshoot."""
    change = jerk * dt
    low = max(a - change, min(-limit, a + change))
    high = min(a + change, max(limit, a - change))
    gentle = _gentle_acceleration(wanted - v - 0.5 * a * dt, jerk, dt)
    return float(min(max(gentle, low), high))


@compiled
def _climb_acceleration(row: Floats, height: float, v: float, a: float, limits: Floats) -> float:
    """Return the vertical acceleration of a leg that keeps a velocity, slow enough to touch down."""
    dt, limit, jerk = limits[STEP_S], row[LEG_ACCELERATION_NORMAL], row[LEG_JERK_NORMAL]
    if row[LEG_RADIUS] == AT_HEIGHT:
        d = row[LEG_Z] - height
        if abs(d) + abs(v) + abs(a) <= 1e-9:
            return 0.0
        speed = 0.999 * (limits[CLIMB_MAX] if d > 0.0 else limits[DESCENT_MAX])
        return float(axis_acceleration(d, v, a, 0.0, speed, limit, jerk, dt))
    wanted = row[LEG_CLIMB]
    if wanted >= 0.0:
        return float(velocity_acceleration(v, a, wanted, limit, jerk, dt))
    end = min(-wanted, limits[TOUCH_DOWN_SPEED])
    return -float(axis_acceleration(max(height, 0.0), -v, -a, end, -wanted, limit, jerk, dt))


@compiled
def _below_top_speed(
    vx: float, vy: float, ax: float, ay: float, bx: float, by: float, limits: Floats
) -> tuple[float, float]:
    """Return the horizontal acceleration without what would lead beyond the speed limit.

    The axes of a leg that only keeps a velocity turn with every order, so that the sum of what each allows
    can be too much. A quarter of the jerk is left for the turning of the velocity itself.
    """
    speed2 = vx * vx + vy * vy
    if speed2 < 0.25 * limits[SPEED_MAX] * limits[SPEED_MAX]:
        return bx, by
    dt, speed = limits[STEP_S], sqrt(speed2)
    ux, uy = vx / speed, vy / speed
    now = ax * ux + ay * uy
    outward = bx * ux + by * uy
    most = _gentle_acceleration(
        0.999 * limits[SPEED_MAX] - speed - 0.5 * now * dt, 0.75 * limits[JERK_MAX], dt
    )
    if outward <= most:
        return bx, by
    change = limits[JERK_MAX] * dt
    radial = max(most, now - change, -limits[ACCELERATION_MAX]) - now
    tangential = (by - ay) * ux - (bx - ax) * uy
    room = change * change - radial * radial
    free = sqrt(room) if room > 0.0 else 0.0
    tangential = min(max(tangential, -free), free)
    return ax + radial * ux - tangential * uy, ay + radial * uy + tangential * ux


@compiled
def _detour(row: Floats, velocity: Vector, acceleration: Vector) -> float:
    """Return about how far a new leg is left before the motion that does not belong to it has stopped.

    A leg may begin while the vehicle moves across it or backwards, as when a climb is ordered in fast
    flight; the axes of the leg then brake with what little it leaves to them.
    """
    detour = 0.0
    for axis in range(3):
        v = a = 0.0
        for k in range(3):
            v += velocity[k] * row[LEG_ALONG_X + 3 * axis + k]
            a += acceleration[k] * row[LEG_ALONG_X + 3 * axis + k]
        if axis == 0 or v < 0.0:
            v, a = -v, -a
        limit, jerk = row[LEG_ACCELERATION_ALONG + 2 * axis], row[LEG_JERK_ALONG + 2 * axis]
        if a > 0.0:
            v += 0.5 * a * a / jerk
        if v > 0.0:
            detour += v * (0.5 * v / limit + limit / jerk)
    return detour


@compiled
def advance(
    state: Floats,
    counters: Integers,
    route: Floats,
    limits: Floats,
    power: Floats,
    wind: Floats,
    first_wind: int,
    max_steps: int,
    stop_each: bool,
    arrivals: Integers,
    track: Floats,
    track_every: int,
) -> int:
    """Fly up to ``max_steps`` steps along the route; return early, with the event, when something happens.

    An empty battery hides that a leg was completed in the same step: ``arrivals`` tells that in any case.

    Parameters
    ----------
    state, counters : float64[STATE], int64[COUNTERS]
        Changed in place.
    route : float64[n, LEG]
        Of `prepare_route`; after the last leg the vehicle stays at its end.
    limits, power : float64[LIMITS], float64[7]
    wind : float64[m, ROW]
        On the grid of `GRID` steps from grid index ``first_wind``, see `wind_at`; one row is a steady wind.
    stop_each : bool
        Return at every waypoint, not only at the last.
    arrivals : int64[n]
        Receives the step at which each leg was completed.
    track : float64[k, 3]
        Receives the position every ``track_every`` grid points (0: never) until it is full.

    Returns
    -------
    int
        RAN, REACHED, WIND (the wind block is used up), STALLED (no progress), ENERGY or NEAR.
    """
    dt = limits[STEP_S]
    windy = wind.shape[0] > 1 or wind[0, AIR_EAST] != 0.0 or wind[0, AIR_NORTH] != 0.0
    px, py, pz = state[col.POSITION_X], state[col.POSITION_Y], state[col.POSITION_Z]
    vx, vy, vz = state[col.VELOCITY_X], state[col.VELOCITY_Y], state[col.VELOCITY_Z]
    ax, ay, az = state[col.ACCELERATION_X], state[col.ACCELERATION_Y], state[col.ACCELERATION_Z]
    yaw, yaw_rate, energy, length = (
        state[col.HEADING],
        state[col.HEADING_RATE],
        state[col.ENERGY_USED],
        state[col.PATH_LENGTH],
    )
    step, leg = counters[col.STEP], counters[col.LEG_INDEX]
    event = col.RAN
    fresh = True
    accel2 = limits[ACCELERATION_MAX] * limits[ACCELERATION_MAX]
    top2 = limits[SPEED_MAX] * limits[SPEED_MAX]
    tx = ty = tz = ux = uy = uz = nx = ny = wx = wy = wz = 0.0
    cruise = leave = radius = heading = horizontal = 0.0
    for _ in range(max_steps):
        if fresh:
            row = route[leg]
            tx, ty, tz = row[LEG_X], row[LEG_Y], row[LEG_Z]
            ux, uy, uz = row[LEG_ALONG_X], row[LEG_ALONG_Y], row[LEG_ALONG_Z]
            nx, ny = row[LEG_ACROSS_X], row[LEG_ACROSS_Y]
            wx, wy, wz = row[LEG_NORMAL_X], row[LEG_NORMAL_Y], row[LEG_NORMAL_Z]
            cruise, leave, radius, heading, horizontal = (
                row[LEG_SPEED],
                row[LEG_END_SPEED],
                row[LEG_RADIUS],
                row[LEG_HEADING],
                row[LEG_HORIZONTAL],
            )
            fresh = False
        rx, ry, rz = tx - px, ty - py, tz - pz
        if step % col.GRID == 0:
            index = wind_row(step, first_wind, len(wind))
            if index < 0:
                event = col.WIND
                break
            state[col.WIND_EAST], state[col.WIND_NORTH], rising = wind_at(wind[index], pz)
            airx, airy = vx - state[col.WIND_EAST], vy - state[col.WIND_NORTH]
            state[col.POWER] = multirotor_power(power, airx, airy, vz - rising, ax, ay, az)
            mark_track(counters, step, track, track_every, px, py, pz)
            if counters[col.ARRIVED] == 0 and radius >= 0.0:
                if state[col.GIVE_UP_STEP] == inf:
                    left = sqrt(rx * rx + ry * ry + rz * rz)
                    left += _detour(row, (vx, vy, vz), (ax, ay, az))
                    state[col.GIVE_UP_STEP] = step + (STALL_S + 1.5 * left / min(cruise, SLOWEST)) / dt
                    counters[col.MOVED_STEP] = step
                if vx * vx + vy * vy + vz * vz > 0.0025 * min(cruise * cruise, 1.0):
                    counters[col.MOVED_STEP] = step
                if (step - counters[col.MOVED_STEP]) * dt > STALL_S or step > state[col.GIVE_UP_STEP]:
                    event = col.STALLED
                    break
        # Along the leg, across it, and normal to both: the state in the frame of the leg.
        ds = rx * ux + ry * uy + rz * uz
        vs = vx * ux + vy * uy + vz * uz
        accs = ax * ux + ay * uy + az * uz
        dn = rx * nx + ry * ny
        vn = vx * nx + vy * ny
        accn = ax * nx + ay * ny
        dw = rx * wx + ry * wy + rz * wz
        vw = vx * wx + vy * wy + vz * wz
        accw = ax * wx + ay * wy + az * wz
        speed = cruise
        if horizontal > 0.0:
            free = top2 - vn * vn
            most = (sqrt(free) if free > 0.0 else 0.0) / horizontal
            if most < speed:
                speed = most
            if windy and horizontal > 0.05:
                ex, ey = ux / horizontal, uy / horizontal
                tail = state[col.WIND_EAST] * ex + state[col.WIND_NORTH] * ey
                side = state[col.WIND_EAST] * ey - state[col.WIND_NORTH] * ex
                free = limits[AIRSPEED_MAX] * limits[AIRSPEED_MAX] - side * side
                most = (tail + sqrt(free)) / horizontal if free > 0.0 else 0.0
                # Without this a vehicle that brakes against a storm could never finish to stop.
                if most < speed and (most > SLOWEST or ds > CREEP):
                    speed = most if most > SLOWEST else 0.0
        row = route[leg]
        if abs(vw) > row[LEG_SPEED_NORMAL] and uz != 0.0:
            most = 0.999 * (limits[CLIMB_MAX] if uz > 0.0 else limits[DESCENT_MAX]) - horizontal * abs(vw)
            most = most / abs(uz) if most > 0.0 else 0.0
            if most < speed:
                speed = most
        if radius < 0.0:
            s1 = velocity_acceleration(vs, accs, speed, row[LEG_ACCELERATION_ALONG], row[LEG_JERK_ALONG], dt)
        elif radius > 0.0 and ds >= 0.0:
            ahead = row[LEG_BEYOND] + (ds - radius if ds > radius else 0.0)
            if ahead == 0.0 and vs <= leave and leave < speed:
                speed = leave
            if ahead > row[LEG_BRAKING_DISTANCE] and vs <= speed:
                ahead = 1e9
            s1 = axis_acceleration(
                ahead, vs, accs, leave, speed, row[LEG_ACCELERATION_ALONG], row[LEG_JERK_ALONG], dt
            )
        else:
            s1 = axis_acceleration(
                ds, vs, accs, 0.0, speed, row[LEG_ACCELERATION_ALONG], row[LEG_JERK_ALONG], dt
            )
        n1 = accn
        if radius < 0.0:
            n1 = velocity_acceleration(vn, accn, 0.0, row[LEG_ACCELERATION_ACROSS], row[LEG_JERK_ACROSS], dt)
        elif abs(dn) + abs(vn) + abs(accn) > 1e-9:
            n1 = axis_acceleration(
                dn,
                vn,
                accn,
                0.0,
                row[LEG_SPEED_ACROSS],
                row[LEG_ACCELERATION_ACROSS],
                row[LEG_JERK_ACROSS],
                dt,
            )
        w1 = accw
        if radius < 0.0:
            w1 = _climb_acceleration(row, pz, vz, az, limits)
        elif abs(dw) + abs(vw) + abs(accw) > 1e-9:
            w1 = axis_acceleration(
                dw,
                vw,
                accw,
                0.0,
                row[LEG_SPEED_NORMAL],
                row[LEG_ACCELERATION_NORMAL],
                row[LEG_JERK_NORMAL],
                dt,
            )
        bx = s1 * ux + n1 * nx + w1 * wx
        by = s1 * uy + n1 * ny + w1 * wy
        bz = s1 * uz + w1 * wz
        if radius < 0.0:
            bx, by = _below_top_speed(vx, vy, ax, ay, bx, by, limits)
        norm2 = bx * bx + by * by
        if norm2 > accel2:
            scale = sqrt(accel2 / norm2)
            bx *= scale
            by *= scale
        bz = min(max(bz, -limits[VERTICAL_ACCELERATION]), limits[VERTICAL_ACCELERATION])
        # A new leg may give the vertical axis less jerk than it needs to end what the leg before had begun.
        if vz > 0.5 * limits[CLIMB_MAX]:
            most = _gentle_acceleration(limits[CLIMB_MAX] - vz - 0.5 * az * dt, limits[VERTICAL_JERK], dt)
            bz = max(min(bz, most), az - limits[VERTICAL_JERK] * dt, -limits[VERTICAL_ACCELERATION])
        elif vz < -0.5 * limits[DESCENT_MAX]:
            most = _gentle_acceleration(limits[DESCENT_MAX] + vz + 0.5 * az * dt, limits[VERTICAL_JERK], dt)
            bz = min(max(bz, -most), az + limits[VERTICAL_JERK] * dt, limits[VERTICAL_ACCELERATION])
        third = dt * dt / 6.0
        mx = vx * dt + third * (2.0 * ax + bx)
        my = vy * dt + third * (2.0 * ay + by)
        mz = vz * dt + third * (2.0 * az + bz)
        px += mx
        py += my
        pz += mz
        length += sqrt(mx * mx + my * my + mz * mz)
        vx += 0.5 * dt * (ax + bx)
        vy += 0.5 * dt * (ay + by)
        vz += 0.5 * dt * (az + bz)
        ax, ay, az = bx, by, bz
        energy += state[col.POWER] * dt
        step += 1
        if not isnan(state[col.LOOK_EAST]):
            east, north = state[col.LOOK_EAST] - px, state[col.LOOK_NORTH] - py
            if east * east + north * north > ROI_NEAR * ROI_NEAR:
                heading = atan2(east, north) % (2.0 * pi)
        if not isnan(row[LEG_TURN_RATE]):
            change = limits[TURN_ACCELERATION] * dt
            rate = min(max(row[LEG_TURN_RATE], -limits[TURN_RATE]), limits[TURN_RATE])
            yaw_rate += min(max(rate - yaw_rate, -change), change)
            yaw = (yaw + yaw_rate * dt) % (2.0 * pi)
        elif not isnan(heading) and (heading != yaw or yaw_rate != 0.0):
            error = (heading - yaw + pi) % (2.0 * pi) - pi
            size = abs(error)
            if size < 1e-6 and abs(yaw_rate) < 1e-4:
                yaw, yaw_rate = heading, 0.0
            else:
                rate = min(limits[TURN_RATE], 2.0 * size, 0.8 * sqrt(2.0 * limits[TURN_ACCELERATION] * size))
                rate = rate if error > 0.0 else -rate
                change = limits[TURN_ACCELERATION] * dt
                yaw_rate += min(max(rate - yaw_rate, -change), change)
                yaw = (yaw + yaw_rate * dt) % (2.0 * pi)
        elif yaw_rate != 0.0:
            change = limits[TURN_ACCELERATION] * dt
            yaw_rate -= min(max(yaw_rate, -change), change)
            yaw = (yaw + yaw_rate * dt) % (2.0 * pi)
        if counters[col.ARRIVED] == 0:
            rx, ry, rz = tx - px, ty - py, tz - pz
            left2 = rx * rx + ry * ry + rz * rz
            if radius < 0.0:
                reached = radius == VELOCITY and row[LEG_CLIMB] < 0.0 and pz <= 0.0
            elif radius > 0.0:
                reached = left2 <= radius * radius
            else:
                reached = (
                    left2 <= STOP_RADIUS * STOP_RADIUS
                    and vx * vx + vy * vy + vz * vz <= STOP_SPEED * STOP_SPEED
                )
            if reached:
                event = complete_leg(counters, arrivals, step, stop_each)
                state[col.GIVE_UP_STEP] = inf
                fresh = leg != counters[col.LEG_INDEX]
                leg = counters[col.LEG_INDEX]
            elif counters[col.NEAR_TOLD] == 0 and left2 < row[LEG_NEAR] * row[LEG_NEAR]:
                counters[col.NEAR_TOLD] = 1
                event = col.NEAR
        if energy >= limits[ENERGY_LIMIT]:
            event = col.ENERGY
        if event != col.RAN:
            break
    state[col.POSITION_X], state[col.POSITION_Y], state[col.POSITION_Z] = px, py, pz
    state[col.VELOCITY_X], state[col.VELOCITY_Y], state[col.VELOCITY_Z] = vx, vy, vz
    state[col.ACCELERATION_X], state[col.ACCELERATION_Y], state[col.ACCELERATION_Z] = ax, ay, az
    state[col.HEADING], state[col.HEADING_RATE], state[col.ENERGY_USED], state[col.PATH_LENGTH] = (
        yaw,
        yaw_rate,
        energy,
        length,
    )
    counters[col.STEP] = step
    return event
