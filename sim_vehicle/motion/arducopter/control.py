"""ArduCopter's position control, and the airframe that it moves.

Formulas after ArduPilot 4.7: `AC_PosControl.cpp`, `AC_PID_2D.cpp`, `AP_Math/control.cpp`, and the airframe of
its simulator, `SIM_Frame.cpp`. How it works is told in docs/vehicle-model.md, section ArduCopter.
"""

from __future__ import annotations

from math import atan2, isinf, isnan, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.arducopter.layout import (
    ACC_Z_I,
    ACC_Z_IMAX,
    ACC_Z_P,
    ACCEL,
    ACCEL_Z,
    ALONG,
    ASKED,
    AX,
    DOWN,
    DRAG,
    DRAG_2,
    DT,
    ERROR,
    ERROR_FILTER,
    ERROR_Z,
    ERROR_Z_FILTER,
    INTEGRAL,
    LAG,
    LEAN,
    LEAN_FILTER,
    LEGS,
    LEVEL,
    LIFT,
    LOOKS_AHEAD,
    MODE,
    MOST_LEAN,
    POS_P,
    POS_Z_P,
    PX,
    RATE,
    RATE_FILTER,
    RESET,
    TARGET,
    TARGET_FILTER,
    THRUST,
    THRUST_I,
    UP,
    VEL_D,
    VEL_I,
    VEL_IMAX,
    VEL_P,
    VEL_Z_P,
    VX,
    YAW_ACCEL,
    YAW_RATE,
)
from sim_vehicle.motion.multirotor.kernel import ROI_NEAR
from sim_vehicle.motion.rows import clear, copy

Floats = NDArray[np.float64]


@compiled(inline="always")
def rooted(error: float, gain: float, limit: float) -> float:
    """Return the rate that closes an error: linear near it, then such that the limit suffices to stop."""
    straight = limit / (gain * gain)
    if error > straight:
        return sqrt(2.0 * limit * (error - 0.5 * straight))
    if error < -straight:
        return -sqrt(2.0 * limit * (-error - 0.5 * straight))
    return error * gain


@compiled(inline="always")
def stopping_distance(speed: float, gain: float, limit: float) -> float:
    """Return the error for which `_rooted` gives a speed: the path in which the controller stops."""
    if speed < limit / gain:
        return speed / gain
    return 0.5 * limit / (gain * gain) + 0.5 * speed * speed / limit


@compiled(inline="late", allocates=False)
def command(state: Floats, guide: Floats, law: Floats) -> None:
    """Position and velocity control: the acceleration that is asked for and the thrust."""
    dt = law[DT]
    ex, ey = guide[PX] - state[col.POSITION_X], guide[PX + 1] - state[col.POSITION_Y]
    size = sqrt(ex * ex + ey * ey)
    if size > 0.0:
        most = stopping_distance(guide[LEVEL], law[POS_P], law[ACCEL])
        if size > most:
            ex, ey, size = ex * most / size, ey * most / size, most
            if guide[MODE] != LEGS:
                guide[PX], guide[PX + 1] = state[col.POSITION_X] + ex, state[col.POSITION_Y] + ey
        gain = rooted(size, law[POS_P], law[ACCEL]) / size
    else:
        gain = 0.0
    ez = guide[PX + 2] - state[col.POSITION_Z]
    most = stopping_distance(guide[UP] if ez > 0.0 else guide[DOWN], law[POS_Z_P], law[ACCEL_Z])
    ez = min(max(ez, -most), most)
    wx, wy, wz = guide[VX], guide[VX + 1], guide[VX + 2]
    wanted = sqrt(wx * wx + wy * wy + wz * wz)
    guide[LAG] = guide[ALONG] = 0.0
    if wanted > 1e-6:
        guide[LAG] = (ex * wx + ey * wy + ez * wz) / wanted
        guide[ALONG] = (
            state[col.VELOCITY_X] * wx + state[col.VELOCITY_Y] * wy + state[col.VELOCITY_Z] * wz
        ) / wanted
    ux, uy = gain * ex + wx - state[col.VELOCITY_X], gain * ey + wy - state[col.VELOCITY_Y]
    uz = rooted(ez, law[POS_Z_P], law[ACCEL_Z]) + wz - state[col.VELOCITY_Z]
    fx, fy, fz = guide[ERROR], guide[ERROR + 1], guide[ERROR_Z]
    if guide[RESET] != 0.0:
        guide[RESET] = 0.0
        fx, fy, fz = ux, uy, uz
        guide[RATE] = guide[RATE + 1] = 0.0
    else:
        hx, hy = law[ERROR_FILTER] * (ux - fx), law[ERROR_FILTER] * (uy - fy)
        fx += hx
        fy += hy
        fz += law[ERROR_Z_FILTER] * (uz - fz)
        guide[RATE] += law[RATE_FILTER] * (hx / dt - guide[RATE])
        guide[RATE + 1] += law[RATE_FILTER] * (hy / dt - guide[RATE + 1])
    guide[ERROR], guide[ERROR + 1], guide[ERROR_Z] = fx, fy, fz
    sx, sy = guide[INTEGRAL], guide[INTEGRAL + 1]
    dx, dy = law[VEL_I] * dt * fx, law[VEL_I] * dt * fy
    was = sqrt(sx * sx + sy * sy)
    limited = sqrt(guide[ASKED] ** 2 + guide[ASKED + 1] ** 2) >= 0.999 * law[MOST_LEAN]
    sx, sy = sx + dx, sy + dy
    most = law[VEL_IMAX]
    if limited and dx * guide[ASKED] + dy * guide[ASKED + 1] > 0.0:
        most = min(most, was)
    now = sqrt(sx * sx + sy * sy)
    if now > most:
        sx, sy = sx * most / now, sy * most / now
    guide[INTEGRAL], guide[INTEGRAL + 1] = sx, sy
    ax = law[VEL_P] * fx + sx + law[VEL_D] * guide[RATE] + guide[AX]
    ay = law[VEL_P] * fy + sy + law[VEL_D] * guide[RATE + 1] + guide[AX + 1]
    guide[ASKED], guide[ASKED + 1] = _across_first(ax, ay, wx, wy, law[MOST_LEAN])
    # The thrust follows the vertical acceleration with a proportional and an integral part at once.
    az = law[VEL_Z_P] * fz + guide[AX + 2]
    gain, lift = law[ACC_Z_P], guide[LIFT]
    thrust = (gain * (az - lift) + guide[THRUST_I]) / (1.0 + gain)
    thrust = min(max(thrust, -GRAVITY_M_S2), 1.5 * GRAVITY_M_S2)
    most = law[ACC_Z_IMAX]
    guide[THRUST_I] = min(max(guide[THRUST_I] + law[ACC_Z_I] * dt * (az - thrust - lift), -most), most)
    guide[THRUST] = thrust


@compiled(inline="always")
def _across_first(ax: float, ay: float, vx: float, vy: float, most: float) -> tuple[float, float]:
    """Return an acceleration within a limit; what goes along the wanted velocity is cut first."""
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
def move(state: Floats, guide: Floats, law: Floats, rising: float) -> float:
    """Fly a step: the attitude follows, thrust and drag move the airframe. Returns the length of the path."""
    dt = law[DT]
    for k in range(2):
        guide[TARGET + k] += law[TARGET_FILTER] * (guide[ASKED + k] - guide[TARGET + k])
        guide[LEAN + k] += law[LEAN_FILTER] * (guide[TARGET + k] - guide[LEAN + k])
    share = 1.0 + guide[THRUST] / GRAVITY_M_S2
    # Drag acts in the plane of the rotors and, without the part of their momentum, across it.
    lx, ly = guide[LEAN], guide[LEAN + 1]
    stretch = sqrt(lx * lx + ly * ly + GRAVITY_M_S2 * GRAVITY_M_S2)
    nx, ny, nz = lx / stretch, ly / stretch, GRAVITY_M_S2 / stretch
    ux, uy, uz = (
        state[col.VELOCITY_X] - state[col.WIND_EAST],
        state[col.VELOCITY_Y] - state[col.WIND_NORTH],
        state[col.VELOCITY_Z] - rising,
    )
    through = ux * nx + uy * ny + uz * nz
    ux, uy, uz = ux - through * nx, uy - through * ny, uz - through * nz
    drag = law[DRAG] * sqrt(max(share, 0.0) / nz) + law[DRAG_2] * sqrt(ux * ux + uy * uy + uz * uz)
    through *= law[DRAG_2] * abs(through)
    ax = share * lx - drag * ux - through * nx
    ay = share * ly - drag * uy - through * ny
    guide[LIFT] = -drag * uz - through * nz
    az = guide[THRUST] + guide[LIFT]
    mx = dt * (state[col.VELOCITY_X] + 0.5 * dt * ax)
    my = dt * (state[col.VELOCITY_Y] + 0.5 * dt * ay)
    mz = dt * (state[col.VELOCITY_Z] + 0.5 * dt * az)
    state[col.POSITION_X] += mx
    state[col.POSITION_Y] += my
    state[col.POSITION_Z] += mz
    state[col.VELOCITY_X] += dt * ax
    state[col.VELOCITY_Y] += dt * ay
    state[col.VELOCITY_Z] += dt * az
    state[col.ACCELERATION_X], state[col.ACCELERATION_Y], state[col.ACCELERATION_Z] = ax, ay, az
    if state[col.POSITION_Z] < 0.0:
        mz -= state[col.POSITION_Z]
        state[col.POSITION_Z] = 0.0
        state[col.VELOCITY_Z] = max(state[col.VELOCITY_Z], 0.0)
        state[col.ACCELERATION_Z] = max(state[col.ACCELERATION_Z], 0.0)
    return sqrt(mx * mx + my * my + mz * mz)


@compiled(inline="late", allocates=False)
def turn(state: Floats, guide: Floats, law: Floats, heading: float, turning: float) -> None:
    """Turn the nose: to a position, at a rate, to a heading, or to where the target goes."""
    yaw, rate, change = state[col.HEADING], state[col.HEADING_RATE], law[YAW_ACCEL] * law[DT]
    wanted = np.nan
    if not isnan(state[col.LOOK_EAST]):
        east, north = (
            state[col.LOOK_EAST] - state[col.POSITION_X],
            state[col.LOOK_NORTH] - state[col.POSITION_Y],
        )
        if east * east + north * north > ROI_NEAR * ROI_NEAR:
            wanted = atan2(east, north)
    elif not isnan(turning):
        rate += min(max(min(max(turning, -law[YAW_RATE]), law[YAW_RATE]) - rate, -change), change)
        state[col.HEADING], state[col.HEADING_RATE] = (yaw + rate * law[DT]) % (2.0 * pi), rate
        return
    elif not isnan(heading):
        wanted = np.nan if isinf(heading) else heading
    elif law[LOOKS_AHEAD] != 0.0:
        vx, vy = guide[VX], guide[VX + 1]
        if vx * vx + vy * vy > (0.05 * guide[LEVEL]) ** 2:
            wanted = atan2(vx, vy)
    if isnan(wanted):
        if rate != 0.0:
            rate -= min(max(rate, -change), change)
            state[col.HEADING], state[col.HEADING_RATE] = (yaw + rate * law[DT]) % (2.0 * pi), rate
        return
    error = (wanted - yaw + pi) % (2.0 * pi) - pi
    size = abs(error)
    if size < 1e-6 and abs(rate) < 1e-4:
        state[col.HEADING], state[col.HEADING_RATE] = wanted % (2.0 * pi), 0.0
        return
    aim = min(law[YAW_RATE], 2.0 * size, 0.8 * sqrt(2.0 * law[YAW_ACCEL] * size))
    aim = aim if error > 0.0 else -aim
    rate += min(max(aim - rate, -change), change)
    state[col.HEADING], state[col.HEADING_RATE] = (yaw + rate * law[DT]) % (2.0 * pi), rate


@compiled(allocates=False)
def stand(state: Floats, guide: Floats) -> None:
    """Stand on the ground with the motors running."""
    clear(state, col.POSITION + 2, col.HEADING)
    copy(guide, PX, state, col.POSITION, 3)
    clear(guide, VX, AX + 3)
    clear(guide, INTEGRAL, LEAN + 2)
    guide[RESET] = 1.0
