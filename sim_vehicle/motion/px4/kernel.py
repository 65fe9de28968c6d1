"""Compiled kernel of a multirotor under PX4: navigator, trajectory, controllers, airframe.

Mechanisms and constants are from PX4 v1.17: ``FlightTaskAuto`` and ``PositionSmoothing`` (trajectory),
``FlightTaskOrbit``, ``mc_pos_control`` (``PositionControl``, ``Takeoff``), ``navigator/mission_block``
(acceptance), ``land_detector``, ``simulator_sih`` (airframe). For gaps see docs/vehicle-model.md.

State and counters are as in `sim_vehicle.motion.multirotor.kernel`; the record `GUIDE` holds the memory of
the autopilot. Positions are east-north-up relative to the start.

Besides the common arguments, a step has guides GUIDE[1], laws LAW[1] and errors float64[n, COLUMNS]. The
first row of the errors has the grid index of the first take-off. The further rows are the estimate errors
(`sim_vehicle.airframe.navigation_errors`) on the grid from this index on. A single row means that the
estimate is exact. The kernel uses only the time step and the energy limit of the multirotor's limits.
"""

from __future__ import annotations

from enum import IntEnum
from math import atan2, cos, exp, inf, isnan, pi, sin, sqrt

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.columns import Record, record_type
from sim_vehicle.motion.multirotor.kernel import ROI_NEAR, STALL_S, Floats, Integers, turn_at
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
from sim_vehicle.motion.stepping import kernel_of, multirotor_power, stop

# A leg has its target, the previous and the next waypoint, and settings.
Leg = IntEnum(
    "Leg",
    "X Y Z BEFORE_X BEFORE_Y BEFORE_Z AFTER_X AFTER_Y AFTER_Z "
    "RADIUS "  # Acceptance radius.
    "SPEED "
    "HEADING "  # NaN faces the target, infinity means no turn, minus infinity faces the orbit's centre.
    "NEAR "  # Distance at which NEAR is reported.
    "KIND "  # `LegKind`.
    "PAUSE "
    "TURN_RATE "  # Heading rate; NaN if HEADING applies.
    "CIRCLE",  # Radius of an orbit, positive for clockwise.
    start=0,
)
_TAKEOFF, _CLIMB, _DESCEND, _LAND, _SETPOINT, _ORBIT = 1, 2, 4, 5, 9, 11
# Memory of the autopilot.
Guide = IntEnum(
    "Guide",
    "X Y Z VX VY VZ AX AY AZ "  # Trajectory: position, velocity, acceleration.
    "INTEGRAL_X INTEGRAL_Y INTEGRAL_Z "  # Integrators of the velocity controller.
    "THRUST_X THRUST_Y THRUST_RATE_X THRUST_RATE_Y "  # Direction of the thrust.
    "THRUST "  # Thrust, m/s^2.
    "FILTERED_AX FILTERED_AY FILTERED_AZ "  # Filtered acceleration.
    "TURN "  # Speed before a turn or along an orbit.
    "CLIMB "  # Commanded vertical speed.
    # Waypoints of the trajectory.
    "TARGET_X TARGET_Y TARGET_Z BEFORE_X BEFORE_Y BEFORE_Z AFTER_X AFTER_Y AFTER_Z "
    "STATE "  # Position relative to the leg: 0 on it, 1 past its end, 2 before its start, 3 beside it.
    "FRESH "  # Whether the leg is new.
    "CLOCK "  # Time since the motors started; negative if they are off, infinity in flight.
    "HEADING "  # Commanded heading.
    "BEST "  # Shortest distance to the leg's end since the leg began.
    "INSIDE "  # Step at which the vehicle came within the acceptance radius; negative if it has not.
    "GROUND "  # Time on the ground.
    "LAUNCH "  # Whether the vehicle takes off from the ground.
    "ERROR ERROR_VX ERROR_VY ERROR_VZ "  # Errors of the estimated height (m) and velocity (m/s).
    "PUSH_X PUSH_Y",  # Acceleration that the estimate misses, m/s^2.
    start=0,
)
# Constants of the control law, from parameters and the vehicle, in SI units.
Law = IntEnum(
    "Law",
    "DT XY_VEL_MAX ACC_HOR JERK TRAJ_P ERR_MAX XY_P Z_P XY_VEL_P XY_VEL_I XY_VEL_D Z_VEL_P Z_VEL_I "
    "Z_VEL_D AUTO_UP AUTO_DOWN MAX_UP MAX_DOWN ACC_UP ACC_DOWN TILT YAW_RATE YAW_ACC TAKEOFF_SPEED "
    "TAKEOFF_RAMP LAND_SPEED LAND_ALT1 LAND_ALT2 LAND_ALT3 LAND_CRAWL ALT_RAD SPOOLUP DRAG ATTITUDE "
    "THRUST_LOW THRUST_HIGH LAND_TIME LAND_CLIMB YAW_ERROR",
    start=0,
)
LEG, GUIDE, LAW = record_type(Leg), record_type(Guide), record_type(Law)
Own = tuple[Record, Record, Floats]
# Factor on the vertical speed threshold of the land detector in its state "maybe landed".
MAYBE_LANDED = 2.5

# This is 4 SIH_T_MAX / SIH_MASS of the reference airframe (SIH quadrotor 10040).
SIH_THRUST_M_S2 = 20.0
# Time constant of the motors in SIH; the body rates respond about as fast.
MOTOR_S = 0.05
# Time constant of the velocity controller's derivative filter, from MPC_VELD_LP.
DERIVATIVE_S = 1.0 / (2.0 * pi * 5.0)
LOOKAHEAD_M = 5.0
LEAST_TRACK_M = 1.0
# With estimate errors, a vehicle that has missed its target flies on along the line until its estimate brings
# it back. This takes 15 s in recordings, and up to a minute with simulated errors.
LONG_STALL_S = 120.0
# Smallest change of the height error that counts as a jump (PX4 has switched estimators), not as drift.
RESET_M = 0.5
# Fraction of the thrust that vertical control leaves for horizontal control, MPC_THR_XY_MARG.
MARGIN = 0.3
BRISK = 0.2
# Mean size of the errors of the estimated vertical speed and of the estimated horizontal position.
NOISE_M_S = 0.15
NOISE_M = 0.12
# A vehicle that comes nearer to its target by a fiftieth or by this many metres has not stalled.
PROGRESS = 0.98
PROGRESS_M = 10.0
# Maximum centripetal acceleration in FlightTaskOrbit, and speed back to the circle per metre of distance.
ORBIT_M_S2 = 2.0
ORBIT_1_S = 1.0
# Distance of the point ahead at which the nose of an orbiting vehicle aims.
_AHEAD_M = 1e3


@compiled(allocates=False)
def _choose_waypoints(g: Record, row: Record, px: float, py: float, pz: float, radius: float) -> None:
    """Choose waypoints of the leg, or waypoints that bring a stray vehicle back to the leg."""
    dx, dy, dz = row.x - row.before_x, row.y - row.before_y, row.z - row.before_z
    size = sqrt(dx * dx + dy * dy + dz * dz)
    state = 0.0
    nearx, neary, nearz = row.before_x, row.before_y, row.before_z
    if size > 1e-6 and row.kind != _LAND:
        dx, dy, dz = dx / size, dy / size, dz / size
        qx, qy, qz = px - row.before_x, py - row.before_y, pz - row.before_z
        along = qx * dx + qy * dy + qz * dz
        nearx, neary, nearz = (
            row.before_x + along * dx,
            row.before_y + along * dy,
            row.before_z + along * dz,
        )
        if along > size:
            state = 1.0
        elif along < 0.0 and qx * qx + qy * qy + qz * qz > radius * radius:
            state = 2.0
        elif (px - nearx) ** 2 + (py - neary) ** 2 + (pz - nearz) ** 2 > radius * radius:
            state = 3.0
    if g.fresh == 0.0 and state == g.state and state != 3.0:
        return
    g.fresh, g.state = 0.0, state
    g.target_x, g.target_y, g.target_z = row.x, row.y, row.z
    g.before_x, g.before_y, g.before_z = row.before_x, row.before_y, row.before_z
    g.after_x, g.after_y, g.after_z = row.after_x, row.after_y, row.after_z
    if state > 0.0:
        g.before_x, g.before_y, g.before_z = px, py, pz
    if state == 2.0:
        g.target_x, g.target_y, g.target_z = row.before_x, row.before_y, row.before_z
        g.after_x, g.after_y, g.after_z = row.x, row.y, row.z
    elif state == 3.0:
        g.target_x, g.target_y, g.target_z = nearx, neary, nearz
        g.after_x, g.after_y, g.after_z = row.x, row.y, row.z


@compiled(allocates=False)
def _orbit(g: Record, row: Record, law: Record, px: float, py: float) -> None:
    """Move the trajectory along a circle about the leg's target (``FlightTaskOrbit``).

    The horizontal trajectory has no position, only a speed along the circle, a speed back to the circle, and
    the centripetal acceleration. The vertical trajectory is the same as for a waypoint.
    """
    dt, jerk = law.dt, law.jerk
    east, north = px - row.x, py - row.y
    size = sqrt(east * east + north * north)
    if size > 0.0:
        east, north = east / size, north / size
    radius = abs(row.circle)
    most = min(row.speed, sqrt(ORBIT_M_S2 * radius))
    g.turn = min(g.turn + law.acc_hor * dt, most)
    along = g.turn if row.circle > 0.0 else -g.turn
    back = ORBIT_1_S * (radius - size)
    inward = g.turn * g.turn / radius
    g.x, g.y = px, py
    g.vx, g.vy = along * north + back * east, back * north - along * east
    g.ax, g.ay = -inward * east, -inward * north
    g.target_x, g.target_y, g.target_z = row.x, row.y, row.z
    if isnan(row.heading):
        sense = _AHEAD_M if row.circle > 0.0 else -_AHEAD_M
        g.target_x, g.target_y = px + sense * north, py - sense * east
    limit, top = law.acc_down, law.auto_down
    if row.z > g.z:
        limit, top = law.acc_up, law.auto_up
    target = (px, py, row.z)
    climb = climb_speed((px, py, g.z), target, target, law.alt_rad, top, limit, jerk)
    g.climb = climb if row.z > g.z else -climb
    way = profile(g.vz, g.az, g.climb, limit, jerk)
    g.z, g.vz, g.az = follow(way, g.z, g.vz, g.az, jerk, dt)


@compiled(allocates=False)
def _guide(g: Record, row: Record, law: Record, px: float, py: float, pz: float, least_track: float) -> None:
    """Move the trajectory by one step; a setpoint is used at once, without a smooth trajectory to it."""
    if row.kind == _SETPOINT:
        g.x, g.y, g.z = row.x, row.y, row.z
        g.target_x, g.target_y, g.target_z = row.x, row.y, row.z
        g.vx = g.vy = g.vz = g.ax = g.ay = g.az = 0.0
        return
    if row.kind == _ORBIT:
        _orbit(g, row, law, px, py)
        return
    dt, jerk, accel, radius = law.dt, law.jerk, law.acc_hor, row.radius
    _choose_waypoints(g, row, px, py, pz, max(radius, least_track))
    kind = row.kind
    if g.climb > 0.0:
        limit, top = law.acc_up, law.auto_up
        if kind == _TAKEOFF and g.launch > 0.0 and pz < law.land_alt1:
            top = law.takeoff_speed
            if law.takeoff_ramp > 0.0:
                limit = min(limit, top / law.takeoff_ramp)
            g.z = pz
    else:
        limit, top = law.acc_down, law.auto_down
    place = (g.x, g.y, g.z)
    target = (g.target_x, g.target_y, g.target_z)
    after = (g.after_x, g.after_y, g.after_z)
    level = level_speed(place, target, after, radius, row.speed, accel, jerk, law.traj_p)
    tx, ty = target[0] - g.x, target[1] - g.y
    turning = (
        g.vx * g.vx + g.vy * g.vy > BRISK * BRISK
        and tx * tx + ty * ty > radius * radius
        and unit_dot(g.vx, g.vy, tx, ty) < 0.98
    )
    if turning:
        level = min(level, g.turn)
    else:
        g.turn = level
    if kind == _LAND:
        size = sqrt(tx * tx + ty * ty)
        scale = level / size if size > 1e-9 else 0.0
        wx, wy = tx * scale, ty * scale
        # A distance sensor measures the height above ground without the estimate's error.
        above = pz - g.error
        share = (above - law.land_alt2) / max(law.land_alt1 - law.land_alt2, 1e-6)
        share = min(max(share, 0.0), 1.0)
        wz = -(law.land_speed + share * (law.max_down - law.land_speed))
        if above <= law.land_alt3:
            wz = -law.land_crawl
    else:
        climb = climb_speed(place, target, after, law.alt_rad, top, limit, jerk)
        aim = target
        if turning:
            aim = lookahead(
                place,
                (g.before_x, g.before_y, g.before_z),
                target,
                max(radius, LOOKAHEAD_M),
                least_track == 0.0,
            )
        dx, dy, dz = aim[0] - g.x, aim[1] - g.y, aim[2] - g.z
        size = sqrt(dx * dx + dy * dy + dz * dz)
        scale = sqrt(level * level + climb * climb) / size if size > 1e-9 else 0.0
        wx, wy, wz = clamped((dx * scale, dy * scale, dz * scale), level, climb)
    g.climb = wz
    fastest = law.xy_vel_max
    wx, wy = min(max(wx, -fastest), fastest), min(max(wy, -fastest), fastest)
    wz = min(max(wz, -top), top)
    # The trajectory slows down for a vehicle that is behind it. For a vehicle beside it, an exact estimate
    # makes the trajectory slow down half as much, which is the average for noisy estimates.
    ex, ey = g.x - px, g.y - py
    speed2 = g.vx * g.vx + g.vy * g.vy
    lead = (ex * g.vx + ey * g.vy) / sqrt(speed2) if speed2 > 0.0 else 0.0
    if least_track == 0.0:
        error = sqrt(ex * ex + ey * ey) if lead >= 0.0 else 0.0
    else:
        behind = 0.5 * (1.0 + lead / sqrt(lead * lead + NOISE_M * NOISE_M))
        error = behind * sqrt(ex * ex + ey * ey + NOISE_M * NOISE_M)
    t = dt * (1.0 - min(error / law.err_max, 1.0))
    a = profile(g.vx, g.ax, wx, accel, jerk)
    b = profile(g.vy, g.ay, wy, accel, jerk)
    c = profile(g.vz, g.az, wz, limit, jerk)
    total = max(a[1] + a[2] + a[3], b[1] + b[2] + b[3], c[1] + c[2] + c[3])
    if total > 0.0:
        a = stretched(a, g.vx, g.ax, wx, accel, jerk, total)
        b = stretched(b, g.vy, g.ay, wy, accel, jerk, total)
        c = stretched(c, g.vz, g.az, wz, limit, jerk, total)
    g.x, g.vx, g.ax = follow(a, g.x, g.vx, g.ax, jerk, t)
    g.y, g.vy, g.ay = follow(b, g.y, g.vy, g.ay, jerk, t)
    g.z, g.vz, g.az = follow(c, g.z, g.vz, g.az, jerk, t)


@compiled(allocates=False)
def _control(
    g: Record, law: Record, state: Record, climb_limit: float, flying: bool
) -> tuple[float, float, float]:
    """Return the thrust vector (m/s^2) commanded by the position and velocity controllers."""
    dt = law.dt
    vx = g.vx + law.xy_p * (g.x - state.position_x)
    vy = g.vy + law.xy_p * (g.y - state.position_y)
    size = sqrt(vx * vx + vy * vy)
    if size > law.xy_vel_max:
        vx, vy = vx * law.xy_vel_max / size, vy * law.xy_vel_max / size
    down = max(law.max_down, 1.2 * law.auto_down)
    vz = min(max(g.vz + law.z_p * (g.z - state.position_z - g.error), -down), climb_limit)
    ex = vx - state.velocity_x - g.error_vx
    ey = vy - state.velocity_y - g.error_vy
    ez = vz - state.velocity_z - g.error_vz
    ax = g.ax + law.xy_vel_p * ex + g.integral_x - law.xy_vel_d * g.filtered_ax
    ay = g.ay + law.xy_vel_p * ey + g.integral_y - law.xy_vel_d * g.filtered_ay
    az = (g.az if flying else 0.0) + law.z_vel_p * ez + g.integral_z - law.z_vel_d * g.filtered_az
    wanted2 = ax * ax + ay * ay
    size = sqrt(wanted2 + GRAVITY_M_S2 * GRAVITY_M_S2)
    upright = GRAVITY_M_S2 / size
    bx, by = ax / size, ay / size
    if upright < cos(law.tilt):
        scale = sin(law.tilt) / sqrt(bx * bx + by * by)
        upright, bx, by = cos(law.tilt), bx * scale, by * scale
    thrust = max((GRAVITY_M_S2 + az) / upright, law.thrust_low)
    tx, ty, tz = thrust * bx, thrust * by, thrust * upright
    most = law.thrust_high
    if (tz <= law.thrust_low and ez <= 0.0) or (tz >= most and ez >= 0.0):
        ez = 0.0
    level = sqrt(tx * tx + ty * ty)
    kept = min(level, MARGIN * most)
    tz = min(tz, sqrt(most * most - kept * kept))
    room = sqrt(max(most * most - tz * tz, 0.0))
    if level > room:
        tx, ty = tx * room / level, ty * room / level
    # Tracking anti-windup takes the acceleration that the vehicle does not deliver out of the integrators.
    # PX4 does this below hover thrust. On average, noise of the vertical speed has the same effect.
    noise = NOISE_M_S * law.z_vel_p
    missing = 0.5 * (sqrt(az * az + noise * noise) - az) / GRAVITY_M_S2
    lostx, losty = missing * ax, missing * ay
    if (ax - tx) ** 2 + (ay - ty) ** 2 > lostx * lostx + losty * losty and wanted2 > tx * tx + ty * ty:
        lostx, losty = ax - tx, ay - ty
    ex -= 2.0 / law.xy_vel_p * lostx
    ey -= 2.0 / law.xy_vel_p * losty
    g.integral_x += law.xy_vel_i * ex * dt
    g.integral_y += law.xy_vel_i * ey * dt
    g.integral_z = min(max(g.integral_z + law.z_vel_i * ez * dt, -GRAVITY_M_S2), GRAVITY_M_S2)
    return tx, ty, tz


@compiled(allocates=False)
def _turn(g: Record, row: Record, law: Record, state: Record) -> None:
    """Turn the nose to the region of interest, the target or the leg's heading, or turn at the leg's rate."""
    yaw, rate, dt = state.heading, state.heading_rate, law.dt
    if not isnan(row.turn_rate) and isnan(state.look_east):
        yaw, rate = turn_at(yaw, rate, row.turn_rate, law.yaw_rate, law.yaw_acc * dt, dt)
        state.heading, state.heading_rate = yaw, rate
        g.heading = state.heading
        return
    if not isnan(state.look_east):
        dx, dy = state.look_east - state.position_x, state.look_north - state.position_y
        if dx * dx + dy * dy > ROI_NEAR * ROI_NEAR:
            g.heading = atan2(dx, dy)
    elif isnan(row.heading) or row.heading == -inf:
        dx, dy = g.target_x - state.position_x, g.target_y - state.position_y
        if dx * dx + dy * dy > row.radius * row.radius:
            g.heading = atan2(dx, dy)
    elif row.heading != inf:
        g.heading = row.heading
    gap = (g.heading - yaw + pi) % (2.0 * pi) - pi
    if gap == 0.0 and rate == 0.0:
        return
    p = profile(yaw, rate, yaw + gap, law.yaw_rate, law.yaw_acc)
    _, yaw, rate = follow(p, 0.0, yaw, rate, law.yaw_acc, dt)
    state.heading, state.heading_rate = yaw % (2.0 * pi), rate


@compiled(allocates=False)
def _fly(g: Record, law: Record, state: Record, wanted: Vector, flying: bool, turning: float) -> float:
    """Move the airframe by one step and return the path length of the step.

    The direction of the thrust lags as an angle controller with a rate loop does, its size lags with the
    motors, and the drag is linear. `turning` is the yaw rate (rad/s, clockwise) that ``AttitudeControl``
    feeds forward; this rotates the tilt about the vertical.
    """
    dt, lag = law.dt, 1.0 - exp(-law.dt / MOTOR_S)
    size = sqrt(wanted[0] ** 2 + wanted[1] ** 2 + wanted[2] ** 2)
    scale = 1.0 / size if size > 1e-6 else 0.0
    ratex = law.attitude * (wanted[0] * scale - g.thrust_x) + turning * g.thrust_y
    ratey = law.attitude * (wanted[1] * scale - g.thrust_y) - turning * g.thrust_x
    g.thrust_rate_x += (ratex - g.thrust_rate_x) * lag
    g.thrust_rate_y += (ratey - g.thrust_rate_y) * lag
    g.thrust_x += g.thrust_rate_x * dt
    g.thrust_y += g.thrust_rate_y * dt
    g.thrust += (size - g.thrust) * lag
    flat2 = g.thrust_x * g.thrust_x + g.thrust_y * g.thrust_y
    if flat2 > 0.9:
        shrink = sqrt(0.9 / flat2)
        g.thrust_x, g.thrust_y, flat2 = g.thrust_x * shrink, g.thrust_y * shrink, 0.9
    ax = g.thrust * g.thrust_x - law.drag * (state.velocity_x - state.wind_east) + g.push_x
    ay = g.thrust * g.thrust_y - law.drag * (state.velocity_y - state.wind_north) + g.push_y
    az = g.thrust * sqrt(1.0 - flat2) - GRAVITY_M_S2 - law.drag * state.velocity_z
    if state.position_z <= 0.0 and (az <= 0.0 or state.velocity_z < 0.0):
        if not flying:
            g.thrust_x = g.thrust_y = g.thrust_rate_x = g.thrust_rate_y = 0.0
            stop(state)
            return 0.0
        # The vehicle slides if a waypoint is so low that the vehicle touches the ground.
        az, state.velocity_z = max(az, 0.0), max(state.velocity_z, 0.0)
    mx = dt * (state.velocity_x + 0.5 * ax * dt)
    my = dt * (state.velocity_y + 0.5 * ay * dt)
    mz = dt * (state.velocity_z + 0.5 * az * dt)
    state.position_x += mx
    state.position_y += my
    state.position_z = max(state.position_z + mz, 0.0)
    state.velocity_x += ax * dt
    state.velocity_y += ay * dt
    state.velocity_z += az * dt
    state.acceleration_x, state.acceleration_y, state.acceleration_z = ax, ay, az
    blend = dt / (dt + DERIVATIVE_S)
    g.filtered_ax += (ax - g.filtered_ax) * blend
    g.filtered_ay += (ay - g.filtered_ay) * blend
    g.filtered_az += (az - g.filtered_az) * blend
    return sqrt(mx * mx + my * my + mz * mz)


@compiled(allocates=False)
def _inside(row: Record, law: Record, state: Record, error: float) -> bool:
    """Return whether the navigator accepts the vehicle's position at the waypoint (not its heading)."""
    kind, rise = row.kind, row.z - (state.position_z + error)
    if kind == _ORBIT:
        return False
    if kind == _TAKEOFF:
        return bool(rise < (law.alt_rad if row.z >= law.alt_rad else 0.5 * row.z))
    if kind in (_CLIMB, _DESCEND):
        return bool(abs(rise) <= law.alt_rad)
    flat2 = (row.x - state.position_x) ** 2 + (row.y - state.position_y) ** 2
    return bool(flat2 <= row.radius * row.radius and abs(rise) <= law.alt_rad)


@compiled(allocates=False)
def _left(row: Record, state: Record) -> float:
    """Return the remaining distance on a leg, or the remaining height if only the height ends the leg."""
    rise, kind = row.z - state.position_z, row.kind
    if kind in (_TAKEOFF, _CLIMB, _DESCEND, _LAND):
        return float(abs(rise))
    return float(sqrt((row.x - state.position_x) ** 2 + (row.y - state.position_y) ** 2 + rise * rise))


@compiled(allocates=False)
def begin_leg(g: Record, row: Record, state: Record) -> None:
    """Begin the leg `row`; legs of a return or a landing start at the vehicle's position."""
    if row.kind >= _CLIMB:
        row.before_x, row.before_y = state.position_x, state.position_y
        row.before_z = state.position_z + g.error
    if row.kind != _TAKEOFF:
        g.launch = 0.0
    if row.heading == inf:
        g.heading = state.heading
    if row.kind == _ORBIT:
        g.turn = 0.0
    g.fresh, g.best, g.inside, g.ground = 1.0, inf, -1.0, 0.0


@compiled(inline="always")
def _enter(state: Record, counters: Integers, route: Record, limits: Record, own: Own) -> None:
    """Do nothing, because a leg begins when the previous leg ends."""


@compiled(inline="always")
def _feel(
    state: Record, counters: Integers, row: Record, air: Vector, limits: Record, power: Floats, own: Own
) -> bool:
    g, law, errors, step = own[0][0], own[1][0], own[2], counters[col.STEP]
    state.wind_east, state.wind_north = air[0], air[1]
    airx, airy = state.velocity_x - state.wind_east, state.velocity_y - state.wind_north
    climb = state.velocity_z - air[2]
    state.power = multirotor_power(
        power, airx, airy, climb, state.acceleration_x, state.acceleration_y, state.acceleration_z
    )
    stall_s = STALL_S
    if len(errors) > 1:
        stall_s = LONG_STALL_S
        wrong = errors[min(max(step // col.GRID - int(errors[0, 0]), 0) + 1, len(errors) - 1)]
        if abs(wrong[0] - g.error) > RESET_M:
            # FlightTaskAuto continues its trajectory from the new estimate.
            g.z = state.position_z + wrong[0]
        g.error, g.error_vx, g.error_vy, g.error_vz = wrong[0], wrong[1], wrong[2], wrong[3]
        g.push_x, g.push_y = wrong[4], wrong[5]
    if counters[col.ARRIVED] != 0 or g.inside >= 0.0:
        return False
    left = _left(row, state)
    nearer = left < max(PROGRESS * g.best, g.best - PROGRESS_M)
    if nearer or g.clock < law.spoolup or g.ground > 0.0 or row.kind == _ORBIT:
        g.best = left
        counters[col.MOVED_STEP] = step
        return False
    return bool((step - counters[col.MOVED_STEP]) * law.dt > stall_s)


@compiled(allocates=False)
def _wait_on_ground(g: Record, state: Record) -> None:
    """Wait for the motors; as in PX4, the trajectory stays on the ground, at a speed of 0.7 m/s downwards."""
    g.x, g.y, g.z = state.position_x, state.position_y, state.position_z + g.error
    g.vx = g.vy = g.ax = g.ay = g.az = 0.0
    g.integral_x = g.integral_y = g.integral_z = 0.0
    g.thrust_x = g.thrust_y = g.thrust_rate_x = g.thrust_rate_y = g.thrust = 0.0
    g.filtered_ax = g.filtered_ay = g.filtered_az = 0.0
    g.vz, g.climb = -0.7, 1.0


@compiled(allocates=False)
def _stand_landed(g: Record, law: Record, state: Record) -> None:
    """Stand on the ground until the land detector reports that the vehicle has landed."""
    stop(state)
    state.heading_rate = 0.0
    # An error of the estimated vertical speed counts as movement and restarts the detection.
    maybe = g.ground >= law.land_time * (2.0 / 3.0)
    still = abs(g.error_vz) <= law.land_climb * (MAYBE_LANDED if maybe else 1.0)
    # Once the vehicle has landed, later estimates do not delay disarming.
    g.ground = g.ground + law.dt if still or g.inside >= 0.0 else law.dt


@compiled(inline="always")
def _move(state: Record, counters: Integers, route: Record, limits: Record, own: Own) -> bool:
    g, law, errs = own[0][0], own[1][0], len(own[2]) > 1
    row = route[counters[col.LEG_INDEX]]
    if row.kind == _LAND and state.position_z <= 0.0:
        _stand_landed(g, law, state)
    else:
        g.clock += law.dt
        if g.clock < law.spoolup:
            _wait_on_ground(g, state)
        else:
            climb_limit, flying = law.max_up, True
            ramp = law.takeoff_ramp
            if g.clock - law.spoolup < ramp:
                flying = False
                low = -GRAVITY_M_S2 / law.z_vel_p
                climb_limit = low + (g.clock - law.spoolup) / ramp * (climb_limit - low)
            believed = state.position_z + g.error
            # In wind, without this minimum radius, a vehicle with an exact estimate could alternate between
            # two choices of waypoints. PX4 has no minimum, so a vehicle with estimate errors has none.
            least_track = 0.0 if errs else LEAST_TRACK_M
            _guide(g, row, law, state.position_x, state.position_y, believed, least_track)
            wanted = _control(g, law, state, climb_limit, flying)
            turning = state.heading_rate if errs else 0.0
            state.path_length += _fly(g, law, state, wanted, flying, turning)
            _turn(g, row, law, state)
    return bool(counters[col.ARRIVED] == 0 and _reached(g, row, law, state, counters[col.STEP] + 1))


@compiled(allocates=False)
def _reached(g: Record, row: Record, law: Record, state: Record, step: int) -> bool:
    """Return whether the navigator continues with the next leg after a step."""
    # The navigator runs at 20 Hz.
    if g.inside < 0.0:
        if row.kind == _LAND:
            if g.ground >= law.land_time:
                g.inside = step
        elif (2 * step) % 5 < 2 and g.clock >= law.spoolup and _inside(row, law, state, g.error):
            g.inside = step
    if g.inside < 0.0 or (step - g.inside) * law.dt < row.pause:
        return False
    if row.kind == 0.0 and row.heading < inf and isnan(state.look_east) and isnan(row.turn_rate):
        gap = (row.heading - state.heading + pi) % (2.0 * pi) - pi
        return bool(abs(gap) < law.yaw_error)
    return True


@compiled(inline="always")
def _leave(state: Record, counters: Integers, row: Record, route: Record, limits: Record, own: Own) -> None:
    counters[col.MOVED_STEP] = counters[col.STEP]
    if counters[col.ARRIVED] == 0:
        begin_leg(own[0][0], route[counters[col.LEG_INDEX]], state)


advance = kernel_of(__name__, _enter, _feel, _move, _leave)
