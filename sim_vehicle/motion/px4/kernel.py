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
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.multirotor.kernel import ENERGY_LIMIT, ROI_NEAR, STALL_S, Floats, Integers
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
from sim_vehicle.motion.rules import complete_leg, mark_track, wind_row
from sim_vehicle.weather.gust_kernel import wind_at

# One leg: its target, the positions before and after it, and how it is flown.
(
    LEG_X,
    LEG_Y,
    LEG_Z,
    LEG_BEFORE_X,
    LEG_BEFORE_Y,
    LEG_BEFORE_Z,
    LEG_AFTER_X,
    LEG_AFTER_Y,
    LEG_AFTER_Z,
    LEG_RADIUS,  # Acceptance radius.
    LEG_SPEED,
    LEG_HEADING,  # NaN: to the target, infinity: keep.
    LEG_NEAR,  # Distance to notify at.
    LEG_KIND,  # `LegKind`.
    LEG_PAUSE,
    LEG_TURN_RATE,  # NaN: by the heading.
) = range(16)
LEG = 16
_TAKEOFF, _CLIMB, _DESCEND, _LAND, _SETPOINT = 1, 2, 4, 5, 9

# What the autopilot remembers.
GUIDE = 45
(
    G_X,  # The trajectory: position, velocity, acceleration.
    G_Y,
    G_Z,
    G_VX,
    G_VY,
    G_VZ,
    G_AX,
    G_AY,
    G_AZ,
    G_INTEGRAL_X,  # Integrals of the velocity controller.
    G_INTEGRAL_Y,
    G_INTEGRAL_Z,
    G_THRUST_X,  # Direction of the thrust.
    G_THRUST_Y,
    G_THRUST_RATE_X,
    G_THRUST_RATE_Y,
    G_THRUST,  # m/s^2.
    G_FILTERED_AX,  # Filtered acceleration.
    G_FILTERED_AY,
    G_FILTERED_AZ,
    G_TURN,  # Speed before a turn.
    G_CLIMB,  # Vertical speed wanted.
) = range(22)
# Where the positions of the waypoints that are followed begin, three numbers each.
G_TARGET, G_BEFORE, G_AFTER = 22, 25, 28
(
    G_STATE,  # State against the track.
    G_FRESH,  # Whether the leg is new.
    G_CLOCK,  # Time since the motors started; negative: off, infinity: in flight.
    G_HEADING,  # Wanted heading.
    G_BEST,  # Nearest so far.
    G_INSIDE,  # Step of entering the acceptance radius; negative: not yet.
    G_GROUND,  # Time on the ground.
    G_LAUNCH,  # Whether it takes off from the ground.
    G_ERROR,  # Errors of the estimate: height, m; velocities, m/s.
    G_ERROR_VX,
    G_ERROR_VY,
    G_ERROR_VZ,
    G_PUSH_X,  # Acceleration that the estimate does not know, m/s^2.
    G_PUSH_Y,
) = range(31, GUIDE)

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
    LAND_CLIMB,
    YAW_ERROR,
) = range(39)
LAW = 39
# Once the vehicle is maybe landed, the land detector takes so many times more for a vertical movement.
MAYBE_LANDED = 2.5

# SIH: time constant of the motors; the rates of the body follow theirs about as fast.
MOTOR_S = 0.05
# Cut-off of the filter before the derivative term of the velocity controller, MPC_VELD_LP.
DERIVATIVE_S = 1.0 / (2.0 * pi * 5.0)
LOOKAHEAD_M = 5.0
LEAST_TRACK_M = 1.0
# A vehicle that has passed its target on the wrong side follows the line past it until its estimate brings it
# back: recorded for 15 s, with errors drawn for up to a minute.
LONG_STALL_S = 120.0
# A change of the estimate that is no drift: the other estimator took over.
RESET_M = 0.5
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
    dx, dy, dz = (
        row[LEG_X] - row[LEG_BEFORE_X],
        row[LEG_Y] - row[LEG_BEFORE_Y],
        row[LEG_Z] - row[LEG_BEFORE_Z],
    )
    size = sqrt(dx * dx + dy * dy + dz * dz)
    state = 0.0
    nearx, neary, nearz = row[LEG_BEFORE_X], row[LEG_BEFORE_Y], row[LEG_BEFORE_Z]
    if size > 1e-6 and row[LEG_KIND] != _LAND:
        dx, dy, dz = dx / size, dy / size, dz / size
        qx, qy, qz = px - row[LEG_BEFORE_X], py - row[LEG_BEFORE_Y], pz - row[LEG_BEFORE_Z]
        along = qx * dx + qy * dy + qz * dz
        nearx, neary, nearz = (
            row[LEG_BEFORE_X] + along * dx,
            row[LEG_BEFORE_Y] + along * dy,
            row[LEG_BEFORE_Z] + along * dz,
        )
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
        g[G_TARGET + k], g[G_BEFORE + k], g[G_AFTER + k] = row[k], row[LEG_BEFORE_X + k], row[LEG_AFTER_X + k]
    if state > 0.0:
        g[G_BEFORE], g[G_BEFORE + 1], g[G_BEFORE + 2] = px, py, pz
    if state == 2.0:
        for k in range(3):
            g[G_TARGET + k], g[G_AFTER + k] = row[LEG_BEFORE_X + k], row[k]
    elif state == 3.0:
        g[G_TARGET], g[G_TARGET + 1], g[G_TARGET + 2] = nearx, neary, nearz
        for k in range(3):
            g[G_AFTER + k] = row[k]


@compiled
def _guide(g: Floats, row: Floats, law: Floats, px: float, py: float, pz: float, least_track: float) -> None:
    """Move the trajectory by one step; a setpoint has none, the controller goes straight for it."""
    if row[LEG_KIND] == _SETPOINT:
        for k in range(3):
            g[k], g[G_TARGET + k] = row[k], row[k]
        for k in range(G_VX, G_INTEGRAL_X):
            g[k] = 0.0
        return
    dt, jerk, accel, radius = law[DT], law[JERK], law[ACC_HOR], row[LEG_RADIUS]
    _choose_waypoints(g, row, px, py, pz, max(radius, least_track))
    kind = row[LEG_KIND]
    if g[G_CLIMB] > 0.0:
        limit, top = law[ACC_UP], law[AUTO_UP]
        if kind == _TAKEOFF and g[G_LAUNCH] > 0.0 and pz < law[LAND_ALT1]:
            top = law[TAKEOFF_SPEED]
            if law[TAKEOFF_RAMP] > 0.0:
                limit = min(limit, top / law[TAKEOFF_RAMP])
            g[G_Z] = pz
    else:
        limit, top = law[ACC_DOWN], law[AUTO_DOWN]
    place = (g[G_X], g[G_Y], g[G_Z])
    target = (g[G_TARGET], g[G_TARGET + 1], g[G_TARGET + 2])
    after = (g[G_AFTER], g[G_AFTER + 1], g[G_AFTER + 2])
    level = level_speed(place, target, after, radius, row[LEG_SPEED], accel, jerk, law[TRAJ_P])
    tx, ty = target[0] - g[G_X], target[1] - g[G_Y]
    turning = (
        g[G_VX] * g[G_VX] + g[G_VY] * g[G_VY] > BRISK * BRISK
        and tx * tx + ty * ty > radius * radius
        and unit_dot(g[G_VX], g[G_VY], tx, ty) < 0.98
    )
    if turning:
        level = min(level, g[G_TURN])
    else:
        g[G_TURN] = level
    if kind == _LAND:
        size = sqrt(tx * tx + ty * ty)
        scale = level / size if size > 1e-9 else 0.0
        wx, wy = tx * scale, ty * scale
        # A distance sensor tells the height over the ground, whatever the estimate is off by.
        above = pz - g[G_ERROR]
        share = (above - law[LAND_ALT2]) / max(law[LAND_ALT1] - law[LAND_ALT2], 1e-6)
        share = min(max(share, 0.0), 1.0)
        wz = -(law[LAND_SPEED] + share * (law[MAX_DOWN] - law[LAND_SPEED]))
        if above <= law[LAND_ALT3]:
            wz = -law[LAND_CRAWL]
    else:
        climb = climb_speed(place, target, after, law[ALT_RAD], top, limit, jerk)
        aim = target
        if turning:
            aim = lookahead(
                place,
                (g[G_BEFORE], g[G_BEFORE + 1], g[G_BEFORE + 2]),
                target,
                max(radius, LOOKAHEAD_M),
                least_track == 0.0,
            )
        dx, dy, dz = aim[0] - g[G_X], aim[1] - g[G_Y], aim[2] - g[G_Z]
        size = sqrt(dx * dx + dy * dy + dz * dz)
        scale = sqrt(level * level + climb * climb) / size if size > 1e-9 else 0.0
        wx, wy, wz = clamped((dx * scale, dy * scale, dz * scale), level, climb)
    g[G_CLIMB] = wz
    fastest = law[XY_VEL_MAX]
    wx, wy = min(max(wx, -fastest), fastest), min(max(wy, -fastest), fastest)
    wz = min(max(wz, -top), top)
    # The trajectory waits for a vehicle that is behind it; by an exact estimate, half so for one that is
    # beside it, which is the average of a noisy one.
    ex, ey = g[G_X] - px, g[G_Y] - py
    speed2 = g[G_VX] * g[G_VX] + g[G_VY] * g[G_VY]
    lead = (ex * g[G_VX] + ey * g[G_VY]) / sqrt(speed2) if speed2 > 0.0 else 0.0
    if least_track == 0.0:
        error = sqrt(ex * ex + ey * ey) if lead >= 0.0 else 0.0
    else:
        behind = 0.5 * (1.0 + lead / sqrt(lead * lead + NOISE_M * NOISE_M))
        error = behind * sqrt(ex * ex + ey * ey + NOISE_M * NOISE_M)
    t = dt * (1.0 - min(error / law[ERR_MAX], 1.0))
    a = profile(g[G_VX], g[G_AX], wx, accel, jerk)
    b = profile(g[G_VY], g[G_AY], wy, accel, jerk)
    c = profile(g[G_VZ], g[G_AZ], wz, limit, jerk)
    total = max(a[1] + a[2] + a[3], b[1] + b[2] + b[3], c[1] + c[2] + c[3])
    if total > 0.0:
        a = stretched(a, g[G_VX], g[G_AX], wx, accel, jerk, total)
        b = stretched(b, g[G_VY], g[G_AY], wy, accel, jerk, total)
        c = stretched(c, g[G_VZ], g[G_AZ], wz, limit, jerk, total)
    g[G_X], g[G_VX], g[G_AX] = follow(a, g[G_X], g[G_VX], g[G_AX], jerk, t)
    g[G_Y], g[G_VY], g[G_AY] = follow(b, g[G_Y], g[G_VY], g[G_AY], jerk, t)
    g[G_Z], g[G_VZ], g[G_AZ] = follow(c, g[G_Z], g[G_VZ], g[G_AZ], jerk, t)


@compiled
def _control(
    g: Floats, law: Floats, state: Floats, climb_limit: float, flying: bool
) -> tuple[float, float, float]:
    """Return the thrust vector (m/s^2) that the position and velocity controllers want."""
    dt = law[DT]
    vx = g[G_VX] + law[XY_P] * (g[G_X] - state[col.POSITION_X])
    vy = g[G_VY] + law[XY_P] * (g[G_Y] - state[col.POSITION_Y])
    size = sqrt(vx * vx + vy * vy)
    if size > law[XY_VEL_MAX]:
        vx, vy = vx * law[XY_VEL_MAX] / size, vy * law[XY_VEL_MAX] / size
    down = max(law[MAX_DOWN], 1.2 * law[AUTO_DOWN])
    vz = min(max(g[G_VZ] + law[Z_P] * (g[G_Z] - state[col.POSITION_Z] - g[G_ERROR]), -down), climb_limit)
    ex = vx - state[col.VELOCITY_X] - g[G_ERROR_VX]
    ey = vy - state[col.VELOCITY_Y] - g[G_ERROR_VY]
    ez = vz - state[col.VELOCITY_Z] - g[G_ERROR_VZ]
    ax = g[G_AX] + law[XY_VEL_P] * ex + g[G_INTEGRAL_X] - law[XY_VEL_D] * g[G_FILTERED_AX]
    ay = g[G_AY] + law[XY_VEL_P] * ey + g[G_INTEGRAL_Y] - law[XY_VEL_D] * g[G_FILTERED_AY]
    az = (g[G_AZ] if flying else 0.0) + law[Z_VEL_P] * ez + g[G_INTEGRAL_Z] - law[Z_VEL_D] * g[G_FILTERED_AZ]
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
    g[G_INTEGRAL_X] += law[XY_VEL_I] * ex * dt
    g[G_INTEGRAL_Y] += law[XY_VEL_I] * ey * dt
    g[G_INTEGRAL_Z] = min(max(g[G_INTEGRAL_Z] + law[Z_VEL_I] * ez * dt, -GRAVITY_M_S2), GRAVITY_M_S2)
    return tx, ty, tz


@compiled
def _turn(g: Floats, row: Floats, law: Floats, state: Floats) -> None:
    """Turn the heading: to the target, as the leg says, or to the position that the nose points at."""
    yaw, rate, dt = state[col.HEADING], state[col.HEADING_RATE], law[DT]
    if not isnan(row[LEG_TURN_RATE]) and isnan(state[col.LOOK_EAST]):
        wanted = min(max(row[LEG_TURN_RATE], -law[YAW_RATE]), law[YAW_RATE])
        change = law[YAW_ACC] * dt
        rate += min(max(wanted - rate, -change), change)
        state[col.HEADING], state[col.HEADING_RATE] = (yaw + rate * dt) % (2.0 * pi), rate
        g[G_HEADING] = state[col.HEADING]
        return
    if not isnan(state[col.LOOK_EAST]):
        dx, dy = state[col.LOOK_EAST] - state[col.POSITION_X], state[col.LOOK_NORTH] - state[col.POSITION_Y]
        if dx * dx + dy * dy > ROI_NEAR * ROI_NEAR:
            g[G_HEADING] = atan2(dx, dy)
    elif isnan(row[LEG_HEADING]):
        dx, dy = g[G_TARGET] - state[col.POSITION_X], g[G_TARGET + 1] - state[col.POSITION_Y]
        if dx * dx + dy * dy > row[LEG_RADIUS] * row[LEG_RADIUS]:
            g[G_HEADING] = atan2(dx, dy)
    elif row[LEG_HEADING] != inf:
        g[G_HEADING] = row[LEG_HEADING]
    gap = (g[G_HEADING] - yaw + pi) % (2.0 * pi) - pi
    if gap == 0.0 and rate == 0.0:
        return
    p = profile(yaw, rate, yaw + gap, law[YAW_RATE], law[YAW_ACC])
    _, yaw, rate = follow(p, 0.0, yaw, rate, law[YAW_ACC], dt)
    state[col.HEADING], state[col.HEADING_RATE] = yaw % (2.0 * pi), rate


@compiled
def _fly(
    g: Floats, law: Floats, state: Floats, wanted: Vector, lag: float, flying: bool, turning: float
) -> float:
    """Move the airframe by one step and return the length of it.

    The direction of the thrust follows as the attitude does (an angle controller over a rate that lags), its
    size as the motors do; the drag is linear. ``turning`` is the yaw rate (rad/s, clockwise) that the
    attitude controller feeds forward about the vertical (``AttitudeControl``): it carries the tilt along.
    """
    dt = law[DT]
    size = sqrt(wanted[0] ** 2 + wanted[1] ** 2 + wanted[2] ** 2)
    scale = 1.0 / size if size > 1e-6 else 0.0
    ratex = law[ATTITUDE] * (wanted[0] * scale - g[G_THRUST_X]) + turning * g[G_THRUST_Y]
    ratey = law[ATTITUDE] * (wanted[1] * scale - g[G_THRUST_Y]) - turning * g[G_THRUST_X]
    g[G_THRUST_RATE_X] += (ratex - g[G_THRUST_RATE_X]) * lag
    g[G_THRUST_RATE_Y] += (ratey - g[G_THRUST_RATE_Y]) * lag
    g[G_THRUST_X] += g[G_THRUST_RATE_X] * dt
    g[G_THRUST_Y] += g[G_THRUST_RATE_Y] * dt
    g[G_THRUST] += (size - g[G_THRUST]) * lag
    flat2 = g[G_THRUST_X] * g[G_THRUST_X] + g[G_THRUST_Y] * g[G_THRUST_Y]
    if flat2 > 0.9:
        shrink = sqrt(0.9 / flat2)
        g[G_THRUST_X], g[G_THRUST_Y], flat2 = g[G_THRUST_X] * shrink, g[G_THRUST_Y] * shrink, 0.9
    ax = (
        g[G_THRUST] * g[G_THRUST_X] - law[DRAG] * (state[col.VELOCITY_X] - state[col.WIND_EAST]) + g[G_PUSH_X]
    )
    ay = (
        g[G_THRUST] * g[G_THRUST_Y]
        - law[DRAG] * (state[col.VELOCITY_Y] - state[col.WIND_NORTH])
        + g[G_PUSH_Y]
    )
    az = g[G_THRUST] * sqrt(1.0 - flat2) - GRAVITY_M_S2 - law[DRAG] * state[col.VELOCITY_Z]
    if state[col.POSITION_Z] <= 0.0 and (az <= 0.0 or state[col.VELOCITY_Z] < 0.0):
        if not flying:
            for k in range(12, 16):
                g[k] = 0.0
            for k in range(3, 9):
                state[k] = 0.0
            return 0.0
        # A waypoint so low that the vehicle grazes the ground: it slides.
        az, state[col.VELOCITY_Z] = max(az, 0.0), max(state[col.VELOCITY_Z], 0.0)
    mx = dt * (state[col.VELOCITY_X] + 0.5 * ax * dt)
    my = dt * (state[col.VELOCITY_Y] + 0.5 * ay * dt)
    mz = dt * (state[col.VELOCITY_Z] + 0.5 * az * dt)
    state[col.POSITION_X] += mx
    state[col.POSITION_Y] += my
    state[col.POSITION_Z] = max(state[col.POSITION_Z] + mz, 0.0)
    state[col.VELOCITY_X] += ax * dt
    state[col.VELOCITY_Y] += ay * dt
    state[col.VELOCITY_Z] += az * dt
    state[col.ACCELERATION_X], state[col.ACCELERATION_Y], state[col.ACCELERATION_Z] = ax, ay, az
    blend = dt / (dt + DERIVATIVE_S)
    g[G_FILTERED_AX] += (ax - g[G_FILTERED_AX]) * blend
    g[G_FILTERED_AY] += (ay - g[G_FILTERED_AY]) * blend
    g[G_FILTERED_AZ] += (az - g[G_FILTERED_AZ]) * blend
    return sqrt(mx * mx + my * my + mz * mz)


@compiled
def _inside(row: Floats, law: Floats, state: Floats, error: float) -> bool:
    """Tell whether the navigator takes a waypoint as reached, its heading and pause aside."""
    kind, rise = row[LEG_KIND], row[LEG_Z] - (state[col.POSITION_Z] + error)
    if kind == _TAKEOFF:
        return bool(rise < (law[ALT_RAD] if row[LEG_Z] >= law[ALT_RAD] else 0.5 * row[LEG_Z]))
    if kind in (_CLIMB, _DESCEND):
        return bool(abs(rise) <= law[ALT_RAD])
    flat2 = (row[LEG_X] - state[col.POSITION_X]) ** 2 + (row[LEG_Y] - state[col.POSITION_Y]) ** 2
    return bool(flat2 <= row[LEG_RADIUS] * row[LEG_RADIUS] and abs(rise) <= law[ALT_RAD])


@compiled
def _left(row: Floats, state: Floats) -> float:
    """Return the distance left of a leg; only the height counts where only the height ends it."""
    rise, kind = row[LEG_Z] - state[col.POSITION_Z], row[LEG_KIND]
    if kind in (_TAKEOFF, _CLIMB, _DESCEND, _LAND):
        return float(abs(rise))
    return float(
        sqrt(
            (row[LEG_X] - state[col.POSITION_X]) ** 2
            + (row[LEG_Y] - state[col.POSITION_Y]) ** 2
            + rise * rise
        )
    )


@compiled
def begin_leg(g: Floats, route: Floats, leg: int, state: Floats) -> None:
    """Make a leg the current one; a leg of a return or a landing begins where the vehicle is."""
    row = route[leg]
    if row[LEG_KIND] >= _CLIMB:
        for k in range(3):
            row[LEG_BEFORE_X + k] = state[k]
        row[LEG_BEFORE_Z] += g[G_ERROR]
    if row[LEG_KIND] != _TAKEOFF:
        g[G_LAUNCH] = 0.0
    if row[LEG_HEADING] == inf:
        g[G_HEADING] = state[col.HEADING]
    g[G_FRESH], g[G_BEST], g[G_INSIDE], g[G_GROUND] = 1.0, inf, -1.0, 0.0


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
    g: Floats,
    law: Floats,
    errors: Floats,
) -> int:
    """Fly up to ``max_steps`` steps along the route; return early, with the event, when something happens.

    Parameters and events as in `sim_vehicle.motion.multirotor.kernel.advance`, and:

    Parameters
    ----------
    route : float64[n, LEG]
    limits : float64[LIMITS]
        Of the multirotor: only the energy that ends the flight is used.
    g : float64[GUIDE]
        What the autopilot remembers, changed in place.
    law : float64[LAW]
    errors : float64[n, COLUMNS]
        A row with the grid index of the first take-off, then the errors of the estimate
        (`sim_vehicle.airframe.estimate_errors`) on the grid from there on; one row is an exact estimate.
    """
    # Read once: a look into the limits at every step costs a tenth of the speed.
    dt, capacity = law[DT], limits[ENERGY_LIMIT]
    lag = 1.0 - exp(-dt / MOTOR_S)
    errs = len(errors) > 1
    # With less, a wind that shakes the vehicle off its track could keep it going to and fro between states;
    # so it goes for the real one, whose estimate shakes.
    least_track = 0.0 if errs else LEAST_TRACK_M
    stall_s = LONG_STALL_S if errs else STALL_S
    leg = counters[col.LEG_INDEX]
    row = route[leg]
    event = col.RAN
    for _ in range(max_steps):
        step = counters[col.STEP]
        if step % col.GRID == 0:
            index = wind_row(step, first_wind, len(wind))
            if index < 0:
                return col.WIND
            state[col.WIND_EAST], state[col.WIND_NORTH], rising = wind_at(wind[index], state[col.POSITION_Z])
            airx, airy = (
                state[col.VELOCITY_X] - state[col.WIND_EAST],
                state[col.VELOCITY_Y] - state[col.WIND_NORTH],
            )
            climb = state[col.VELOCITY_Z] - rising
            state[col.POWER] = multirotor_power(
                power,
                airx,
                airy,
                climb,
                state[col.ACCELERATION_X],
                state[col.ACCELERATION_Y],
                state[col.ACCELERATION_Z],
            )
            mark_track(
                counters,
                step,
                track,
                track_every,
                state[col.POSITION_X],
                state[col.POSITION_Y],
                state[col.POSITION_Z],
            )
            if errs:
                wrong = errors[min(max(step // col.GRID - int(errors[0, 0]), 0) + 1, len(errors) - 1)]
                if abs(wrong[0] - g[G_ERROR]) > RESET_M:
                    # FlightTaskAuto goes on from the new estimate.
                    g[G_Z] = state[col.POSITION_Z] + wrong[0]
                for k in range(GUIDE - G_ERROR):
                    g[G_ERROR + k] = wrong[k]
            if counters[col.ARRIVED] == 0 and g[G_INSIDE] < 0.0:
                left = _left(row, state)
                if left < PROGRESS * g[G_BEST] or g[G_CLOCK] < law[SPOOLUP] or g[G_GROUND] > 0.0:
                    g[G_BEST] = left
                    counters[col.MOVED_STEP] = step
                elif (step - counters[col.MOVED_STEP]) * dt > stall_s:
                    return col.STALLED
        kind = row[LEG_KIND]
        state[col.ENERGY_USED] += state[col.POWER] * dt
        counters[col.STEP] = step = step + 1
        if kind == _LAND and state[col.POSITION_Z] <= 0.0:
            for k in range(3, 9):
                state[k] = 0.0
            state[col.HEADING_RATE] = 0.0
            # A vertical speed that is wrongly told is a movement: the stages begin anew.
            maybe = g[G_GROUND] >= law[LAND_TIME] * (2.0 / 3.0)
            still = abs(g[G_ERROR_VZ]) <= law[LAND_CLIMB] * (MAYBE_LANDED if maybe else 1.0)
            # Landed is landed: what is told later does not delay the disarming.
            g[G_GROUND] = g[G_GROUND] + dt if still or g[G_INSIDE] >= 0.0 else dt
        else:
            g[G_CLOCK] += dt
            if g[G_CLOCK] < law[SPOOLUP]:
                # Motors spin up; the trajectory waits on the ground, sinking at 0.7 m/s as PX4 has it.
                for k in range(3):
                    g[k] = state[k]
                g[G_Z] += g[G_ERROR]
                for k in range(3, 20):
                    g[k] = 0.0
                g[G_VZ], g[G_CLIMB] = -0.7, 1.0
            else:
                climb_limit, flying = law[MAX_UP], True
                ramp = law[TAKEOFF_RAMP]
                if g[G_CLOCK] - law[SPOOLUP] < ramp:
                    flying = False
                    low = -GRAVITY_M_S2 / law[Z_VEL_P]
                    climb_limit = low + (g[G_CLOCK] - law[SPOOLUP]) / ramp * (climb_limit - low)
                believed = state[col.POSITION_Z] + g[G_ERROR]
                _guide(g, row, law, state[col.POSITION_X], state[col.POSITION_Y], believed, least_track)
                wanted = _control(g, law, state, climb_limit, flying)
                turning = state[col.HEADING_RATE] if errs else 0.0
                state[col.PATH_LENGTH] += _fly(g, law, state, wanted, lag, flying, turning)
                _turn(g, row, law, state)
        if counters[col.ARRIVED] == 0:
            # The navigator looks twenty times a second.
            if g[G_INSIDE] < 0.0:
                if kind == _LAND:
                    if g[G_GROUND] >= law[LAND_TIME]:
                        g[G_INSIDE] = step
                elif (
                    (2 * step) % 5 < 2 and g[G_CLOCK] >= law[SPOOLUP] and _inside(row, law, state, g[G_ERROR])
                ):
                    g[G_INSIDE] = step
            reached = g[G_INSIDE] >= 0.0 and (step - g[G_INSIDE]) * dt >= row[LEG_PAUSE]
            if (
                reached
                and kind == 0.0
                and row[LEG_HEADING] < inf
                and isnan(state[col.LOOK_EAST])
                and isnan(row[LEG_TURN_RATE])
            ):
                gap = (row[LEG_HEADING] - state[col.HEADING] + pi) % (2.0 * pi) - pi
                reached = abs(gap) < law[YAW_ERROR]
            if reached:
                event = complete_leg(counters, arrivals, step, stop_each)
                counters[col.MOVED_STEP] = step
                if counters[col.ARRIVED] == 0:
                    leg = counters[col.LEG_INDEX]
                    row = route[leg]
                    begin_leg(g, route, leg, state)
            elif counters[col.NEAR_TOLD] == 0 and row[LEG_NEAR] > 0.0:
                dx, dy, dz = (
                    row[LEG_X] - state[col.POSITION_X],
                    row[LEG_Y] - state[col.POSITION_Y],
                    row[LEG_Z] - state[col.POSITION_Z],
                )
                if dx * dx + dy * dy + dz * dz < row[LEG_NEAR] * row[LEG_NEAR]:
                    counters[col.NEAR_TOLD] = 1
                    event = col.NEAR
        if state[col.ENERGY_USED] >= capacity:
            event = col.ENERGY
        if event != col.RAN:
            break
    return event
