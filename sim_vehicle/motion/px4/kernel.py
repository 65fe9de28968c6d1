"""The compiled motion of a multirotor under PX4: navigator, trajectory, controllers, airframe.

Mechanisms and constants from PX4 v1.17: ``FlightTaskAuto`` and ``PositionSmoothing`` (the trajectory that is
followed), ``mc_pos_control`` (``PositionControl``, ``Takeoff``), ``navigator/mission_block`` (when a waypoint
is reached), ``land_detector``, and ``simulator_sih`` (the airframe). docs/vehicle-model.md tells what is left
out.

The state and the counters are those of `sim_vehicle.motion.multirotor.kernel`; what the autopilot remembers
is a further row of `GUIDE` numbers. East-north-up about home.
"""

from __future__ import annotations

from math import atan2, cos, exp, inf, isnan, pi, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.energy.power_kernels import multirotor_power
from sim_vehicle.motion.columns import ENERGY, GRID, NEAR, RAN, REACHED, STALLED, WIND
from sim_vehicle.motion.multirotor.kernel import ROI_NEAR, STALL_S, Floats, Integers
from sim_vehicle.motion.px4.smoothing import (
    Vector,
    clamped,
    climb_speed,
    follow,
    level_speed,
    lookahead,
    profile,
    stretched,
    unit_dot,
)
from sim_vehicle.weather.gust_kernel import wind_at

# leg: target 0-2, place before 3-5, place after 6-8, acceptance radius 9, speed 10, heading 11 (NaN: to the
# target, infinity: keep), distance to notify at 12, kind 13 (`LegKind`), pause 14, rate of turning 15 (NaN:
# by the heading)
LEG = 16
_TAKEOFF, _CLIMB, _DESCEND, _LAND = 1, 2, 4, 5

# guide: trajectory 0-8 (place, velocity, acceleration), velocity integrals 9-11, thrust direction 12-13, its
# rate 14-15, thrust (m/s^2) 16, filtered acceleration 17-19, speed before a turn 20, vertical speed wanted
# 21, waypoints that are followed 22-30 (target, before, after), state against the track 31, a new leg 32,
# time since the motors started 33 (negative: off, infinity: in flight), wanted heading 34, nearest so far 35,
# in the acceptance radius since step 36 (negative: not yet), time on the ground 37, taking off from the
# ground 38
GUIDE = 39
G_TURN, G_CLIMB, G_TARGET, G_BEFORE, G_AFTER, G_STATE, G_FRESH = 20, 21, 22, 25, 28, 31, 32
G_CLOCK, G_HEADING, G_BEST, G_INSIDE, G_GROUND, G_LAUNCH = 33, 34, 35, 36, 37, 38

# law: the parameters as `sim_vehicle.motion.px4.model.law_of` puts them, SI units.
(
    DT,
    XY_VEL_MAX,
    ACC_HOR,
    JERK,
    TRAJ_P,
    ERR_MAX,
    XY_P,
    Z_P,
    XY_VEL_P,
    XY_VEL_I,
    XY_VEL_D,
    Z_VEL_P,
    Z_VEL_I,
    Z_VEL_D,
    AUTO_UP,
    AUTO_DOWN,
    MAX_UP,
    MAX_DOWN,
    ACC_UP,
    ACC_DOWN,
    TILT,
    YAW_RATE,
    YAW_ACC,
    TAKEOFF_SPEED,
    TAKEOFF_RAMP,
    LAND_SPEED,
    LAND_ALT1,
    LAND_ALT2,
    LAND_ALT3,
    LAND_CRAWL,
    ALT_RAD,
    SPOOLUP,
    DRAG,
    ATTITUDE,
    THRUST_LOW,
    THRUST_HIGH,
    LAND_TIME,
    YAW_ERROR,
) = range(38)
LAW = 38

# SIH: time constant of the motors; the rates of the body follow theirs about as fast.
MOTOR_S = 0.05
# Cut-off of the filter before the derivative term of the velocity controller, MPC_VELD_LP.
DERIVATIVE_S = 1.0 / (2.0 * pi * 5.0)
LOOKAHEAD_M = 5.0
LEAST_TRACK_M = 1.0
# Share of the thrust that climbing leaves for the horizontal, MPC_THR_XY_MARG.
MARGIN = 0.3
BRISK = 0.2
# Mean size of the errors of the estimated vertical speed and horizontal position.
NOISE_M_S = 0.15
NOISE_M = 0.12
PROGRESS = 0.98


@compiled
def _choose_waypoints(g: Floats, row: Floats, px: float, py: float, pz: float, radius: float) -> None:
    """Follow the leg, or fly back to it when the vehicle is off it, before it or past its end."""
    dx, dy, dz = row[0] - row[3], row[1] - row[4], row[2] - row[5]
    size = sqrt(dx * dx + dy * dy + dz * dz)
    state = 0.0
    nearx, neary, nearz = row[3], row[4], row[5]
    if size > 1e-6 and row[13] != _LAND:
        dx, dy, dz = dx / size, dy / size, dz / size
        qx, qy, qz = px - row[3], py - row[4], pz - row[5]
        along = qx * dx + qy * dy + qz * dz
        nearx, neary, nearz = row[3] + along * dx, row[4] + along * dy, row[5] + along * dz
        if along > size:
            state = 1.0
        elif along < 0.0 and qx * qx + qy * qy + qz * qz > radius * radius:
            state = 2.0
        elif (px - nearx) ** 2 + (py - neary) ** 2 + (pz - nearz) ** 2 > radius * radius:
            state = 3.0
    if g[G_FRESH] == 0.0 and state == g[G_STATE] and state != 3.0:
        return
    g[G_FRESH], g[G_STATE] = 0.0, state
    for k in range(3):
        g[G_TARGET + k], g[G_BEFORE + k], g[G_AFTER + k] = row[k], row[3 + k], row[6 + k]
    if state > 0.0:
        g[G_BEFORE], g[G_BEFORE + 1], g[G_BEFORE + 2] = px, py, pz
    if state == 2.0:
        for k in range(3):
            g[G_TARGET + k], g[G_AFTER + k] = row[3 + k], row[k]
    elif state == 3.0:
        g[G_TARGET], g[G_TARGET + 1], g[G_TARGET + 2] = nearx, neary, nearz
        for k in range(3):
            g[G_AFTER + k] = row[k]


@compiled
def _guide(g: Floats, row: Floats, law: Floats, px: float, py: float, pz: float) -> None:
    """Move the trajectory by one step."""
    dt, jerk, accel, radius = law[DT], law[JERK], law[ACC_HOR], row[9]
    # With less, a wind that shakes the vehicle off its track could keep it going to and fro between states.
    _choose_waypoints(g, row, px, py, pz, max(radius, LEAST_TRACK_M))
    kind = row[13]
    if g[G_CLIMB] > 0.0:
        limit, top = law[ACC_UP], law[AUTO_UP]
        if kind == _TAKEOFF and g[G_LAUNCH] > 0.0 and pz < law[LAND_ALT1]:
            top = law[TAKEOFF_SPEED]
            if law[TAKEOFF_RAMP] > 0.0:
                limit = min(limit, top / law[TAKEOFF_RAMP])
            g[2] = pz
    else:
        limit, top = law[ACC_DOWN], law[AUTO_DOWN]
    place = (g[0], g[1], g[2])
    target = (g[22], g[23], g[24])
    after = (g[28], g[29], g[30])
    level = level_speed(place, target, after, radius, row[10], accel, jerk, law[TRAJ_P])
    tx, ty = target[0] - g[0], target[1] - g[1]
    turning = (
        g[3] * g[3] + g[4] * g[4] > BRISK * BRISK
        and tx * tx + ty * ty > radius * radius
        and unit_dot(g[3], g[4], tx, ty) < 0.98
    )
    if turning:
        level = min(level, g[G_TURN])
    else:
        g[G_TURN] = level
    if kind == _LAND:
        size = sqrt(tx * tx + ty * ty)
        scale = level / size if size > 1e-9 else 0.0
        wx, wy = tx * scale, ty * scale
        share = (pz - law[LAND_ALT2]) / max(law[LAND_ALT1] - law[LAND_ALT2], 1e-6)
        share = min(max(share, 0.0), 1.0)
        wz = -(law[LAND_SPEED] + share * (law[MAX_DOWN] - law[LAND_SPEED]))
        if pz <= law[LAND_ALT3]:
            wz = -law[LAND_CRAWL]
    else:
        climb = climb_speed(place, target, after, law[ALT_RAD], top, limit, jerk)
        aim = target
        if turning:
            aim = lookahead(place, (g[25], g[26], g[27]), target, max(radius, LOOKAHEAD_M))
        dx, dy, dz = aim[0] - g[0], aim[1] - g[1], aim[2] - g[2]
        size = sqrt(dx * dx + dy * dy + dz * dz)
        scale = sqrt(level * level + climb * climb) / size if size > 1e-9 else 0.0
        wx, wy, wz = clamped((dx * scale, dy * scale, dz * scale), level, climb)
    g[G_CLIMB] = wz
    fastest = law[XY_VEL_MAX]
    wx, wy = min(max(wx, -fastest), fastest), min(max(wy, -fastest), fastest)
    wz = min(max(wz, -top), top)
    # The trajectory waits for a vehicle that is behind it; on the average of a noisy estimate, half so for
    # one that is beside it.
    ex, ey = g[0] - px, g[1] - py
    speed2 = g[3] * g[3] + g[4] * g[4]
    lead = (ex * g[3] + ey * g[4]) / sqrt(speed2) if speed2 > 0.0 else 0.0
    behind = 0.5 * (1.0 + lead / sqrt(lead * lead + NOISE_M * NOISE_M))
    error = behind * sqrt(ex * ex + ey * ey + NOISE_M * NOISE_M)
    t = dt * (1.0 - min(error / law[ERR_MAX], 1.0))
    a = profile(g[3], g[6], wx, accel, jerk)
    b = profile(g[4], g[7], wy, accel, jerk)
    c = profile(g[5], g[8], wz, limit, jerk)
    total = max(a[1] + a[2] + a[3], b[1] + b[2] + b[3], c[1] + c[2] + c[3])
    if total > 0.0:
        a = stretched(a, g[3], g[6], wx, accel, jerk, total)
        b = stretched(b, g[4], g[7], wy, accel, jerk, total)
        c = stretched(c, g[5], g[8], wz, limit, jerk, total)
    g[0], g[3], g[6] = follow(a, g[0], g[3], g[6], jerk, t)
    g[1], g[4], g[7] = follow(b, g[1], g[4], g[7], jerk, t)
    g[2], g[5], g[8] = follow(c, g[2], g[5], g[8], jerk, t)


@compiled
def _control(
    g: Floats, law: Floats, state: Floats, climb_limit: float, flying: bool
) -> tuple[float, float, float]:
    """Return the thrust vector (m/s^2) that the position and velocity controllers want."""
    dt = law[DT]
    vx = g[3] + law[XY_P] * (g[0] - state[0])
    vy = g[4] + law[XY_P] * (g[1] - state[1])
    size = sqrt(vx * vx + vy * vy)
    if size > law[XY_VEL_MAX]:
        vx, vy = vx * law[XY_VEL_MAX] / size, vy * law[XY_VEL_MAX] / size
    down = max(law[MAX_DOWN], 1.2 * law[AUTO_DOWN])
    vz = min(max(g[5] + law[Z_P] * (g[2] - state[2]), -down), climb_limit)
    ex, ey, ez = vx - state[3], vy - state[4], vz - state[5]
    ax = g[6] + law[XY_VEL_P] * ex + g[9] - law[XY_VEL_D] * g[17]
    ay = g[7] + law[XY_VEL_P] * ey + g[10] - law[XY_VEL_D] * g[18]
    az = (g[8] if flying else 0.0) + law[Z_VEL_P] * ez + g[11] - law[Z_VEL_D] * g[19]
    wanted2 = ax * ax + ay * ay
    size = sqrt(wanted2 + GRAVITY_M_S2 * GRAVITY_M_S2)
    upright = GRAVITY_M_S2 / size
    bx, by = ax / size, ay / size
    if upright < cos(law[TILT]):
        scale = sin(law[TILT]) / sqrt(bx * bx + by * by)
        upright, bx, by = cos(law[TILT]), bx * scale, by * scale
    thrust = max((GRAVITY_M_S2 + az) / upright, law[THRUST_LOW])
    tx, ty, tz = thrust * bx, thrust * by, thrust * upright
    most = law[THRUST_HIGH]
    if (tz <= law[THRUST_LOW] and ez <= 0.0) or (tz >= most and ez >= 0.0):
        ez = 0.0
    level = sqrt(tx * tx + ty * ty)
    kept = min(level, MARGIN * most)
    tz = min(tz, sqrt(most * most - kept * kept))
    room = sqrt(max(most * most - tz * tz, 0.0))
    if level > room:
        tx, ty = tx * room / level, ty * room / level
    # Tracking anti-windup: the integral gives back what the vehicle does not deliver. It does so whenever the
    # thrust is below that of hovering, hence on the average of a noisy vertical speed too.
    noise = NOISE_M_S * law[Z_VEL_P]
    missing = 0.5 * (sqrt(az * az + noise * noise) - az) / GRAVITY_M_S2
    lostx, losty = missing * ax, missing * ay
    if (ax - tx) ** 2 + (ay - ty) ** 2 > lostx * lostx + losty * losty and wanted2 > tx * tx + ty * ty:
        lostx, losty = ax - tx, ay - ty
    ex -= 2.0 / law[XY_VEL_P] * lostx
    ey -= 2.0 / law[XY_VEL_P] * losty
    g[9] += law[XY_VEL_I] * ex * dt
    g[10] += law[XY_VEL_I] * ey * dt
    g[11] = min(max(g[11] + law[Z_VEL_I] * ez * dt, -GRAVITY_M_S2), GRAVITY_M_S2)
    return tx, ty, tz


@compiled
def _turn(g: Floats, row: Floats, law: Floats, state: Floats) -> None:
    """Turn the heading: to the target, as the leg says, or to the place that the nose points at."""
    yaw, rate, dt = state[9], state[10], law[DT]
    if not isnan(row[15]) and isnan(state[17]):
        wanted = min(max(row[15], -law[YAW_RATE]), law[YAW_RATE])
        change = law[YAW_ACC] * dt
        rate += min(max(wanted - rate, -change), change)
        state[9], state[10] = (yaw + rate * dt) % (2.0 * pi), rate
        g[G_HEADING] = state[9]
        return
    if not isnan(state[17]):
        dx, dy = state[17] - state[0], state[18] - state[1]
        if dx * dx + dy * dy > ROI_NEAR * ROI_NEAR:
            g[G_HEADING] = atan2(dx, dy)
    elif isnan(row[11]):
        dx, dy = g[22] - state[0], g[23] - state[1]
        if dx * dx + dy * dy > row[9] * row[9]:
            g[G_HEADING] = atan2(dx, dy)
    elif row[11] != inf:
        g[G_HEADING] = row[11]
    gap = (g[G_HEADING] - yaw + pi) % (2.0 * pi) - pi
    if gap == 0.0 and rate == 0.0:
        return
    p = profile(yaw, rate, yaw + gap, law[YAW_RATE], law[YAW_ACC])
    _, yaw, rate = follow(p, 0.0, yaw, rate, law[YAW_ACC], dt)
    state[9], state[10] = yaw % (2.0 * pi), rate


@compiled
def _fly(g: Floats, law: Floats, state: Floats, wanted: Vector, lag: float, flying: bool) -> float:
    """Move the airframe by one step and return the length of it.

    The direction of the thrust follows as the attitude does (an angle controller over a rate that lags), its
    size as the motors do; the drag is linear.
    """
    dt = law[DT]
    size = sqrt(wanted[0] ** 2 + wanted[1] ** 2 + wanted[2] ** 2)
    scale = 1.0 / size if size > 1e-6 else 0.0
    g[14] += (law[ATTITUDE] * (wanted[0] * scale - g[12]) - g[14]) * lag
    g[15] += (law[ATTITUDE] * (wanted[1] * scale - g[13]) - g[15]) * lag
    g[12] += g[14] * dt
    g[13] += g[15] * dt
    g[16] += (size - g[16]) * lag
    flat2 = g[12] * g[12] + g[13] * g[13]
    if flat2 > 0.9:
        shrink = sqrt(0.9 / flat2)
        g[12], g[13], flat2 = g[12] * shrink, g[13] * shrink, 0.9
    ax = g[16] * g[12] - law[DRAG] * (state[3] - state[15])
    ay = g[16] * g[13] - law[DRAG] * (state[4] - state[16])
    az = g[16] * sqrt(1.0 - flat2) - GRAVITY_M_S2 - law[DRAG] * state[5]
    if state[2] <= 0.0 and (az <= 0.0 or state[5] < 0.0):
        if not flying:
            for k in range(12, 16):
                g[k] = 0.0
            for k in range(3, 9):
                state[k] = 0.0
            return 0.0
        # A waypoint so low that the vehicle grazes the ground: it slides.
        az, state[5] = max(az, 0.0), max(state[5], 0.0)
    mx = dt * (state[3] + 0.5 * ax * dt)
    my = dt * (state[4] + 0.5 * ay * dt)
    mz = dt * (state[5] + 0.5 * az * dt)
    state[0] += mx
    state[1] += my
    state[2] = max(state[2] + mz, 0.0)
    state[3] += ax * dt
    state[4] += ay * dt
    state[5] += az * dt
    state[6], state[7], state[8] = ax, ay, az
    blend = dt / (dt + DERIVATIVE_S)
    g[17] += (ax - g[17]) * blend
    g[18] += (ay - g[18]) * blend
    g[19] += (az - g[19]) * blend
    return sqrt(mx * mx + my * my + mz * mz)


@compiled
def _inside(row: Floats, law: Floats, state: Floats) -> bool:
    """Tell whether the navigator takes a waypoint as reached, its heading and pause aside."""
    kind, rise = row[13], row[2] - state[2]
    if kind == _TAKEOFF:
        return bool(rise < (law[ALT_RAD] if row[2] >= law[ALT_RAD] else 0.5 * row[2]))
    if kind in (_CLIMB, _DESCEND):
        return bool(abs(rise) <= law[ALT_RAD])
    flat2 = (row[0] - state[0]) ** 2 + (row[1] - state[1]) ** 2
    return bool(flat2 <= row[9] * row[9] and abs(rise) <= law[ALT_RAD])


@compiled
def _left(row: Floats, state: Floats) -> float:
    """Return what is left of a leg; only the height counts where only the height ends it."""
    rise, kind = row[2] - state[2], row[13]
    if kind in (_TAKEOFF, _CLIMB, _DESCEND, _LAND):
        return float(abs(rise))
    return float(sqrt((row[0] - state[0]) ** 2 + (row[1] - state[1]) ** 2 + rise * rise))


@compiled
def begin_leg(g: Floats, route: Floats, leg: int, state: Floats) -> None:
    """Make a leg the current one; a leg of a return or a landing begins where the vehicle is."""
    row = route[leg]
    if row[13] >= _CLIMB:
        for k in range(3):
            row[3 + k] = state[k]
    if row[13] != _TAKEOFF:
        g[G_LAUNCH] = 0.0
    if row[11] == inf:
        g[G_HEADING] = state[9]
    g[G_FRESH], g[G_BEST], g[G_INSIDE], g[G_GROUND] = 1.0, inf, -1.0, 0.0


@compiled
def advance(
    state: Floats,
    counters: Integers,
    g: Floats,
    route: Floats,
    law: Floats,
    capacity: float,
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

    Parameters and events as in `sim_vehicle.motion.multirotor.kernel.advance`, and:

    Parameters
    ----------
    g : float64[GUIDE]
        What the autopilot remembers, changed in place.
    route : float64[n, LEG]
    law : float64[LAW]
    capacity : float
        Energy that ends the flight (J).
    """
    dt = law[DT]
    last = route.shape[0] - 1
    lag = 1.0 - exp(-dt / MOTOR_S)
    leg = counters[1]
    row = route[leg]
    event = RAN
    for _ in range(max_steps):
        step = counters[0]
        if step % GRID == 0:
            index = 0
            if wind.shape[0] > 1:
                index = step // GRID - first_wind
                if index >= wind.shape[0]:
                    return WIND
            state[15], state[16], rising = wind_at(wind[index], state[2])
            airx, airy = state[3] - state[15], state[4] - state[16]
            climb = state[5] - rising
            state[13] = multirotor_power(power, airx, airy, climb, state[6], state[7], state[8])
            if track_every > 0 and (step // GRID) % track_every == 0 and counters[5] < track.shape[0]:
                for k in range(3):
                    track[counters[5], k] = state[k]
                counters[5] += 1
            if counters[3] == 0 and g[G_INSIDE] < 0.0:
                left = _left(row, state)
                if left < PROGRESS * g[G_BEST] or g[G_CLOCK] < law[SPOOLUP] or g[G_GROUND] > 0.0:
                    g[G_BEST] = left
                    counters[2] = step
                elif (step - counters[2]) * dt > STALL_S:
                    return STALLED
        kind = row[13]
        state[11] += state[13] * dt
        counters[0] = step = step + 1
        if kind == _LAND and state[2] <= 0.0:
            for k in range(3, 9):
                state[k] = 0.0
            state[10] = 0.0
            g[G_GROUND] += dt
        else:
            g[G_CLOCK] += dt
            if g[G_CLOCK] < law[SPOOLUP]:
                # Motors spin up; the trajectory waits on the ground, sinking at 0.7 m/s as PX4 has it.
                for k in range(3):
                    g[k] = state[k]
                for k in range(3, 20):
                    g[k] = 0.0
                g[5], g[G_CLIMB] = -0.7, 1.0
            else:
                climb_limit, flying = law[MAX_UP], True
                ramp = law[TAKEOFF_RAMP]
                if g[G_CLOCK] - law[SPOOLUP] < ramp:
                    flying = False
                    low = -GRAVITY_M_S2 / law[Z_VEL_P]
                    climb_limit = low + (g[G_CLOCK] - law[SPOOLUP]) / ramp * (climb_limit - low)
                _guide(g, row, law, state[0], state[1], state[2])
                wanted = _control(g, law, state, climb_limit, flying)
                state[12] += _fly(g, law, state, wanted, lag, flying)
                _turn(g, row, law, state)
        if counters[3] == 0:
            # The navigator looks twenty times a second.
            if g[G_INSIDE] < 0.0:
                if kind == _LAND:
                    if g[G_GROUND] >= law[LAND_TIME]:
                        g[G_INSIDE] = step
                elif (2 * step) % 5 < 2 and g[G_CLOCK] >= law[SPOOLUP] and _inside(row, law, state):
                    g[G_INSIDE] = step
            reached = g[G_INSIDE] >= 0.0 and (step - g[G_INSIDE]) * dt >= row[14]
            if reached and kind == 0.0 and row[11] < inf and isnan(state[17]) and isnan(row[15]):
                gap = (row[11] - state[9] + pi) % (2.0 * pi) - pi
                reached = abs(gap) < law[YAW_ERROR]
            if reached:
                arrivals[leg] = step
                counters[4] = 0
                counters[2] = step
                if leg == last:
                    counters[3] = 1
                    event = REACHED
                else:
                    leg += 1
                    counters[1] = leg
                    row = route[leg]
                    begin_leg(g, route, leg, state)
                    if stop_each:
                        event = REACHED
            elif counters[4] == 0 and row[12] > 0.0:
                dx, dy, dz = row[0] - state[0], row[1] - state[1], row[2] - state[2]
                if dx * dx + dy * dy + dz * dz < row[12] * row[12]:
                    counters[4] = 1
                    event = NEAR
        if state[11] >= capacity:
            event = ENERGY
        if event != RAN:
            break
    return event
