"""ArduCopter's legs, guidance memory, control law and position controller, and the airframe's dynamics.

The formulas are from ArduPilot 4.7: `AC_PosControl.cpp`, `AC_PID_2D.cpp`, `AP_Math/control.cpp`, and the
simulator's airframe, `SIM_Frame.cpp`. See docs/vehicle-model.md, section ArduCopter.
"""

from __future__ import annotations

from enum import IntEnum
from math import atan2, isinf, isnan, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion.columns import Record, record_type
from sim_vehicle.motion.multirotor.kernel import ROI_NEAR, turn_at, turn_to
from sim_vehicle.motion.stepping import stop

Floats = NDArray[np.float64]

Leg = IntEnum(
    "Leg",
    "X Y Z RADIUS SPEED HEADING "
    "NEAR "  # Distance at which NEAR is reported.
    "KIND "  # `LegKind`.
    "PAUSE "
    "TURNING",  # Heading rate.
    start=0,
)
# Leg kinds that ArduCopter flies in special ways (`sim_vehicle.motion.legs.LegKind`).
TAKEOFF, HOME, LAND, STAY, ARC, SETPOINT = 1, 3, 5, 6, 8, 9

# Memory of the autopilot.
Guide = IntEnum(
    "Guide",
    "PX PY PZ VX VY VZ AX AY AZ "  # Position, velocity and acceleration of the target.
    "BEGIN_X BEGIN_Y BEGIN_Z END_X END_Y END_Z "  # Start and end of the leg.
    "PACE "  # Speed of the target's time, relative to real time.
    "LAG "  # Error along the track.
    "ALONG "  # Speed along the track.
    # The velocity loop has an integrator, a filtered error, and a filtered rate of this error.
    "INTEGRAL_X INTEGRAL_Y ERROR_X ERROR_Y RATE_X RATE_Y "
    "ERROR_Z "  # Filtered error of the vertical speed.
    "THRUST_I "  # Integrator of the thrust.
    "THRUST "  # Thrust acceleration in excess of gravity.
    "RESET "  # Whether the filters must be reset.
    # Horizontal accelerations: as commanded, of the attitude target, and of the attitude.
    "ASKED_X ASKED_Y TARGET_X TARGET_Y LEAN_X LEAN_Y "
    "MODE "
    "FAST "  # Whether the next leg is known.
    "LEVEL UP DOWN "  # Speed limits: horizontal, climb, descent.
    "BEGINS "  # Transition to the leg that is about to begin.
    "UNTIL "  # Step at which a wait ends; infinity without a wait.
    "DONE "  # 1 if the path is complete, 2 during the pause.
    "PACE_ARC "  # Speed along chords.
    "RISING "  # Vertical wind.
    "LIFT "  # Vertical acceleration caused by drag.
    "ARMING_STEPS",  # Steps on the ground before the motors spool up.
    start=0,
)
NO_MODE, HOLDING, LEGS, CLIMBING, LANDING, LANDED, CHORDS, GUIDED = range(8)
NOTHING, CHAINED, SAME, ANEW = range(4)

# Constants of the control law, computed from the autopilot's parameters and the airframe.
Law = IntEnum(
    "Law",
    "DT DRAG DRAG_2 ERROR_FILTER RATE_FILTER POS_P VEL_P VEL_I VEL_D VEL_IMAX POS_Z_P VEL_Z_P "
    "ERROR_Z_FILTER ACC_Z_P ACC_Z_I ACC_Z_IMAX ACCEL ACCEL_Z CORNER WP_RADIUS PACE_FILTER JERK SNAP "
    "SHAPE_JERK SHAPE_JERK_Z MOST_LEAN TARGET_FILTER LEAN_FILTER SPEED_UP SPEED_DOWN LAND_FAST "
    "LAND_SLOW LAND_LOW SPOOL_STEPS DETECT_STEPS YAW_RATE YAW_ACCEL LOOKS_AHEAD STAND_BY",
    start=0,
)
LEG, GUIDE, LAW = record_type(Leg), record_type(Guide), record_type(Law)

HOVER_THROTTLE = 0.39
"""Hover throttle of ArduPilot's simulator (MOT_THST_HOVER)."""
LEAST_SPEED = 0.2
"""Minimum horizontal speed; lower speeds are ignored (WPNAV_WP_SPEED_MIN)."""
LEAST_WAY = 0.01
"""Minimum length of a leg from rest, because an estimated position never equals the exact position."""
SHAKE = 0.04
"""Noise of the estimated speed (m/s); it affects how the target waits for a vehicle at rest."""
SIDE = 0.7071067811865476
"""Limit of the acceleration across the path in guided position control, as a fraction of the total limit,
while the acceleration along the path is larger."""


@compiled(inline="always")
def rooted(error: float, gain: float, limit: float) -> float:
    """Return the rate at which to reduce an error: linear near 0; beyond, the deceleration is `limit`."""
    straight = limit / (gain * gain)
    if error > straight:
        return sqrt(2.0 * limit * (error - 0.5 * straight))
    if error < -straight:
        return -sqrt(2.0 * limit * (-error - 0.5 * straight))
    return error * gain


@compiled(inline="always")
def stopping_distance(speed: float, gain: float, limit: float) -> float:
    """Return the controller's stopping distance at a speed: the error for which `rooted` is the speed."""
    if speed < limit / gain:
        return speed / gain
    return 0.5 * limit / (gain * gain) + 0.5 * speed * speed / limit


@compiled(inline="late", allocates=False)
def command(state: Record, guide: Record, law: Record) -> None:
    """Run the position and velocity controllers; store the commanded acceleration and thrust."""
    dt = law.dt
    ex, ey = guide.px - state.position_x, guide.py - state.position_y
    size = sqrt(ex * ex + ey * ey)
    if size > 0.0:
        most = stopping_distance(guide.level, law.pos_p, law.accel)
        if size > most:
            ex, ey, size = ex * most / size, ey * most / size, most
            if guide.mode != LEGS:
                guide.px, guide.py = state.position_x + ex, state.position_y + ey
        gain = rooted(size, law.pos_p, law.accel) / size
    else:
        gain = 0.0
    ez = guide.pz - state.position_z
    most = stopping_distance(guide.up if ez > 0.0 else guide.down, law.pos_z_p, law.accel_z)
    ez = min(max(ez, -most), most)
    wx, wy, wz = guide.vx, guide.vy, guide.vz
    wanted = sqrt(wx * wx + wy * wy + wz * wz)
    guide.lag = guide.along = 0.0
    if wanted > 1e-6:
        guide.lag = (ex * wx + ey * wy + ez * wz) / wanted
        guide.along = (state.velocity_x * wx + state.velocity_y * wy + state.velocity_z * wz) / wanted
    ux, uy = gain * ex + wx - state.velocity_x, gain * ey + wy - state.velocity_y
    uz = rooted(ez, law.pos_z_p, law.accel_z) + wz - state.velocity_z
    fx, fy, fz = guide.error_x, guide.error_y, guide.error_z
    if guide.reset != 0.0:
        guide.reset = 0.0
        fx, fy, fz = ux, uy, uz
        guide.rate_x = guide.rate_y = 0.0
    else:
        hx, hy = law.error_filter * (ux - fx), law.error_filter * (uy - fy)
        fx += hx
        fy += hy
        fz += law.error_z_filter * (uz - fz)
        guide.rate_x += law.rate_filter * (hx / dt - guide.rate_x)
        guide.rate_y += law.rate_filter * (hy / dt - guide.rate_y)
    guide.error_x, guide.error_y, guide.error_z = fx, fy, fz
    sx, sy = guide.integral_x, guide.integral_y
    dx, dy = law.vel_i * dt * fx, law.vel_i * dt * fy
    was = sqrt(sx * sx + sy * sy)
    limited = sqrt(guide.asked_x**2 + guide.asked_y**2) >= 0.999 * law.most_lean
    sx, sy = sx + dx, sy + dy
    most = law.vel_imax
    if limited and dx * guide.asked_x + dy * guide.asked_y > 0.0:
        most = min(most, was)
    now = sqrt(sx * sx + sy * sy)
    if now > most:
        sx, sy = sx * most / now, sy * most / now
    guide.integral_x, guide.integral_y = sx, sy
    ax = law.vel_p * fx + sx + law.vel_d * guide.rate_x + guide.ax
    ay = law.vel_p * fy + sy + law.vel_d * guide.rate_y + guide.ay
    guide.asked_x, guide.asked_y = _across_first(ax, ay, wx, wy, law.most_lean)
    # A proportional and an integral part make the thrust follow the vertical acceleration.
    az = law.vel_z_p * fz + guide.az
    gain, lift = law.acc_z_p, guide.lift
    thrust = (gain * (az - lift) + guide.thrust_i) / (1.0 + gain)
    thrust = min(max(thrust, -GRAVITY_M_S2), 1.5 * GRAVITY_M_S2)
    most = law.acc_z_imax
    guide.thrust_i = min(max(guide.thrust_i + law.acc_z_i * dt * (az - thrust - lift), -most), most)
    guide.thrust = thrust


@compiled(inline="always")
def _across_first(ax: float, ay: float, vx: float, vy: float, most: float) -> tuple[float, float]:
    """Return an acceleration cut to a limit; the part along the wanted velocity is cut first."""
    if ax * ax + ay * ay <= most * most:
        return ax, ay
    speed = sqrt(vx * vx + vy * vy)
    if speed < 1e-6:
        scale = most / sqrt(ax * ax + ay * ay)
        return ax * scale, ay * scale
    ux, uy = vx / speed, vy / speed
    along, across = ax * ux + ay * uy, ay * ux - ax * uy
    across = min(max(across, -most), most)
    room = sqrt(most * most - across * across)
    along = min(max(along, -room), room)
    return along * ux - across * uy, along * uy + across * ux


@compiled(inline="late", allocates=False)
def move(state: Record, guide: Record, law: Record, rising: float) -> float:
    """Move the airframe by one time step under thrust and drag, and return the length of path flown."""
    dt = law.dt
    guide.target_x += law.target_filter * (guide.asked_x - guide.target_x)
    guide.lean_x += law.lean_filter * (guide.target_x - guide.lean_x)
    guide.target_y += law.target_filter * (guide.asked_y - guide.target_y)
    guide.lean_y += law.lean_filter * (guide.target_y - guide.lean_y)
    share = 1.0 + guide.thrust / GRAVITY_M_S2
    # The rotors' momentum drag acts in the rotor plane; the other drag also acts normal to the plane.
    lx, ly = guide.lean_x, guide.lean_y
    stretch = sqrt(lx * lx + ly * ly + GRAVITY_M_S2 * GRAVITY_M_S2)
    nx, ny, nz = lx / stretch, ly / stretch, GRAVITY_M_S2 / stretch
    ux, uy, uz = (
        state.velocity_x - state.wind_east,
        state.velocity_y - state.wind_north,
        state.velocity_z - rising,
    )
    through = ux * nx + uy * ny + uz * nz
    ux, uy, uz = ux - through * nx, uy - through * ny, uz - through * nz
    drag = law.drag * sqrt(max(share, 0.0) / nz) + law.drag_2 * sqrt(ux * ux + uy * uy + uz * uz)
    through *= law.drag_2 * abs(through)
    ax = share * lx - drag * ux - through * nx
    ay = share * ly - drag * uy - through * ny
    guide.lift = -drag * uz - through * nz
    az = guide.thrust + guide.lift
    mx = dt * (state.velocity_x + 0.5 * dt * ax)
    my = dt * (state.velocity_y + 0.5 * dt * ay)
    mz = dt * (state.velocity_z + 0.5 * dt * az)
    state.position_x += mx
    state.position_y += my
    state.position_z += mz
    state.velocity_x += dt * ax
    state.velocity_y += dt * ay
    state.velocity_z += dt * az
    state.acceleration_x, state.acceleration_y, state.acceleration_z = ax, ay, az
    if state.position_z < 0.0:
        mz -= state.position_z
        state.position_z = 0.0
        state.velocity_z = max(state.velocity_z, 0.0)
        state.acceleration_z = max(state.acceleration_z, 0.0)
    return sqrt(mx * mx + my * my + mz * mz)


@compiled(inline="late", allocates=False)
def turn(state: Record, guide: Record, law: Record, heading: float, turning: float) -> None:
    """Turn the nose: to the region of interest, at a rate, to a heading, or in the target's direction."""
    yaw, rate, change = state.heading, state.heading_rate, law.yaw_accel * law.dt
    wanted = np.nan
    if not isnan(state.look_east):
        east, north = state.look_east - state.position_x, state.look_north - state.position_y
        if east * east + north * north > ROI_NEAR * ROI_NEAR:
            wanted = atan2(east, north)
    elif not isnan(turning):
        state.heading, state.heading_rate = turn_at(yaw, rate, turning, law.yaw_rate, change, law.dt)
        return
    elif not isnan(heading):
        wanted = np.nan if isinf(heading) else heading
    elif law.looks_ahead != 0.0:
        vx, vy = guide.vx, guide.vy
        if vx * vx + vy * vy > (0.05 * guide.level) ** 2:
            wanted = atan2(vx, vy)
    if isnan(wanted):
        if rate != 0.0:
            state.heading, state.heading_rate = turn_at(yaw, rate, 0.0, law.yaw_rate, change, law.dt)
        return
    yaw, state.heading_rate = turn_to(yaw, rate, wanted, law.yaw_rate, law.yaw_accel, law.dt)
    state.heading = yaw % (2.0 * pi)


@compiled(inline="always")
def halt(guide: Record) -> None:
    """Set the target's velocity and acceleration to zero."""
    guide.vx = guide.vy = guide.vz = guide.ax = guide.ay = guide.az = 0.0


@compiled(allocates=False)
def stand(state: Record, guide: Record) -> None:
    """Let the vehicle stand on the ground with its motors running."""
    state.position_z = 0.0
    stop(state)
    guide.px, guide.py, guide.pz = state.position_x, state.position_y, state.position_z
    halt(guide)
    guide.integral_x = guide.integral_y = guide.error_x = guide.error_y = 0.0
    guide.rate_x = guide.rate_y = guide.error_z = guide.thrust_i = guide.thrust = 0.0
    guide.asked_x = guide.asked_y = guide.target_x = guide.target_y = guide.lean_x = guide.lean_y = 0.0
    guide.reset = 1.0
