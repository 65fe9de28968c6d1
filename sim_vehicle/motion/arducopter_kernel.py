"""The compiled flight of a multirotor under ArduCopter: guidance, position control, airframe.

How it works is told in docs/vehicle-model.md, section ArduCopter. Formulas after ArduPilot 4.7:
`AC_WPNav.cpp`, `AC_PosControl.cpp`, `AP_Math/control.cpp`, ArduCopter's `mode.cpp`, `mode_auto.cpp`,
`mode_rtl.cpp` and `takeoff.cpp`, and the airframe of its simulator, `SIM_Frame.cpp`. Everything is SI,
east-north-up about home.
"""

from __future__ import annotations

from math import atan2, inf, isinf, isnan, pi, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_vehicle.motion.air import wind_at
from sim_vehicle.motion.kernel import (
    ENERGY,
    GRID,
    NEAR,
    RAN,
    REACHED,
    ROI_NEAR,
    SLOWEST,
    STALL_S,
    STALLED,
    WIND,
)
from sim_vehicle.motion.power_kernels import multirotor_power
from sim_vehicle.motion.scurve import (
    MADE,
    TIME,
    UX,
    change_speed,
    clear_leg,
    end_time,
    make_leg,
    may_turn,
    state_at,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Columns of a route.
RX, RY, RZ, RADIUS, SPEED, HEADING, DISTANCE, KIND, PAUSE = range(9)
# Kinds of legs that have a law of their own (`sim_vehicle.motion.model.LegKind`).
_TAKEOFF, _HOME, _LAND, _STAY, _ARC = 1, 3, 5, 6, 7

# The guide: desired position 0-2, velocity 3-5 and acceleration 6-8; begin 9-11 and end 12-14 of the leg
GUIDE = 45
PX, VX, AX, BEGIN, END = 0, 3, 6, 9, 12
# pace of the target 15, error along the track 16 and speed along it 17
PACE, LAG, ALONG = 15, 16, 17
# velocity loop: integrator 18-19, filtered error 20-21, its filtered rate 22-23; vertical: filtered error 24,
# integrator of the thrust 25, thrust over weight 26; whether the filters begin anew 27
INTEGRAL, ERROR, RATE, ERROR_Z, THRUST_I, THRUST, RESET = 18, 20, 22, 24, 25, 26, 27
# acceleration that is asked for 28-29, that of the attitude target 30-31, and that of the attitude 32-33
ASKED, TARGET, LEAN = 28, 30, 32
# mode 34, whether the next leg is known 35, speed in use 36-38 (level, up, down), what to begin 39
MODE, FAST, LEVEL, UP, DOWN, BEGINS = 34, 35, 36, 37, 38, 39
# step until which it waits 40 (infinity: it does not), whether the way is done 41 (2: the pause runs), speed
# along chords 42, vertical wind 43, vertical acceleration by drag 44
UNTIL, DONE, PACE_ARC, RISING, LIFT = 40, 41, 42, 43, 44

NO_MODE, HOLDING, LEGS, CLIMBING, LANDING, LANDED, CHORDS = range(7)
NOTHING, CHAINED, SAME, ANEW = range(4)

# The law: what parameters and the airframe decide.
LAW = 40
(
    DT,
    DRAG,
    DRAG_2,
    ERROR_FILTER,
    RATE_FILTER,
    POS_P,
    VEL_P,
    VEL_I,
    VEL_D,
    VEL_IMAX,
    POS_Z_P,
    VEL_Z_P,
    ERROR_Z_FILTER,
    ACC_Z_P,
    ACC_Z_I,
    ACC_Z_IMAX,
    ACCEL,
    ACCEL_Z,
    CORNER,
    WP_RADIUS,
    PACE_FILTER,
    JERK,
    SNAP,
    SHAPE_JERK,
    SHAPE_JERK_Z,
    MOST_LEAN,
    TARGET_FILTER,
    LEAN_FILTER,
    SPEED_UP,
    SPEED_DOWN,
    LAND_FAST,
    LAND_SLOW,
    LAND_LOW,
    SPOOL_STEPS,
    DETECT_STEPS,
    YAW_RATE,
    YAW_ACCEL,
    LOOKS_AHEAD,
    CAPACITY,
    STAND_BY,
) = range(LAW)

GRAVITY = 9.80665
LEAST_WAY = 0.01
SHAKE = 0.04


@njit(cache=True, inline="always")
def _rooted(error: float, gain: float, limit: float) -> float:
    """Return the rate that closes an error: linear near it, then such that the limit suffices to stop."""
    straight = limit / (gain * gain)
    if error > straight:
        return sqrt(2.0 * limit * (error - 0.5 * straight))
    if error < -straight:
        return -sqrt(2.0 * limit * (-error - 0.5 * straight))
    return error * gain


@njit(cache=True, inline="always")
def stopping_way(speed: float, gain: float, limit: float) -> float:
    """Return the error for which `_rooted` gives a speed: the way in which the controller stops."""
    if speed < limit / gain:
        return speed / gain
    return 0.5 * limit / (gain * gain) + 0.5 * speed * speed / limit


@njit(cache=True)
def _shape(change: float, acceleration: float, limit: float, jerk: float, dt: float) -> float:
    """Return the next acceleration on the way to a change of speed, within limits of it and of its jerk."""
    wanted = _rooted(change, jerk / limit, jerk)
    most = abs(change) / dt
    wanted = min(max(wanted, -most, -limit), most, limit)
    return acceleration + min(max(wanted - acceleration, -jerk * dt), jerk * dt)


@njit(cache=True)
def _stop_here(state: Floats, guide: Floats, law: Floats) -> None:
    """Begin anew from the place where the vehicle comes to rest."""
    vx, vy, vz = state[3], state[4], state[5]
    speed = sqrt(vx * vx + vy * vy)
    guide[PX], guide[PX + 1] = state[0], state[1]
    if speed > 0.0:
        way = stopping_way(min(speed, guide[LEVEL]), law[POS_P], law[ACCEL]) / speed
        guide[PX] += vx * way
        guide[PX + 1] += vy * way
    way = stopping_way(
        min(abs(vz), law[SPEED_UP] if vz > 0.0 else law[SPEED_DOWN]), law[POS_Z_P], law[ACCEL_Z]
    )
    guide[PX + 2] = max(state[2] + (way if vz > 0.0 else -way), 0.0)
    guide[VX : AX + 3] = 0.0
    guide[BEGIN : BEGIN + 3] = guide[PX : PX + 3]
    guide[END : END + 3] = guide[PX : PX + 3]
    guide[INTEGRAL], guide[INTEGRAL + 1] = guide[ASKED], guide[ASKED + 1]
    guide[THRUST_I] = guide[THRUST]
    guide[RESET] = 1.0
    guide[PACE] = 1.0


@njit(cache=True)
def _take_velocity(state: Floats, guide: Floats) -> None:
    """Begin anew from the present place and velocity."""
    guide[PX : PX + 6] = state[0:6]
    guide[AX : AX + 3] = 0.0
    guide[INTEGRAL], guide[INTEGRAL + 1] = guide[ASKED], guide[ASKED + 1]
    guide[THRUST_I] = guide[THRUST]
    guide[RESET] = 1.0
    guide[PACE] = 1.0


@njit(cache=True)
def _make(i: int, a: Floats, b: Floats, guide: Floats, law: Floats, heads: Floats, curves: Floats) -> None:
    make_leg(
        heads[i],
        curves[i],
        (b[0] - a[0], b[1] - a[1], b[2] - a[2]),
        (guide[LEVEL], guide[UP], guide[DOWN]),
        (law[ACCEL], law[ACCEL_Z]),
        law[SNAP],
        law[JERK],
    )


@njit(cache=True)
def _apart(guide: Floats) -> None:
    """Keep the begin of a leg from its end: an estimated position is never exactly the wanted one."""
    gap = 0.0
    for k in range(3):
        gap += (guide[END + k] - guide[BEGIN + k]) ** 2
    if gap < LEAST_WAY * LEAST_WAY:
        guide[BEGIN] = guide[END] - LEAST_WAY


@njit(cache=True)
def _begin(
    state: Floats,
    guide: Floats,
    law: Floats,
    heads: Floats,
    curves: Floats,
    route: Floats,
    leg: int,
    step: int,
) -> None:
    """Begin a leg; guide[BEGINS] tells how it follows from what was before."""
    how = guide[BEGINS]
    guide[BEGINS] = NOTHING
    guide[UNTIL], guide[DONE] = inf, 0.0
    row = route[leg]
    kind = int(row[KIND])
    before = guide[MODE]
    speed = row[SPEED]
    faster = (
        law[SPEED_UP] != guide[UP]
        or law[SPEED_DOWN] != guide[DOWN]
        or (speed > 0.0 and speed != guide[LEVEL])
    )
    if speed > 0.0:
        guide[LEVEL] = speed
    guide[UP], guide[DOWN] = law[SPEED_UP], law[SPEED_DOWN]
    if kind in (_TAKEOFF, _LAND):
        if how == ANEW or before == CHORDS:
            _take_velocity(state, guide)
        if kind == _TAKEOFF:
            guide[MODE] = CLIMBING
            guide[END], guide[END + 1], guide[END + 2] = row[RX], row[RY], row[RZ]
            if state[2] <= 0.0:
                guide[UNTIL] = step + law[SPOOL_STEPS]
        else:
            guide[MODE] = LANDING
        return
    if kind == _STAY:
        _stop_here(state, guide, law)
        guide[MODE] = HOLDING
        return
    if how == ANEW or before not in (LEGS, CLIMBING, CHORDS):
        _stop_here(state, guide, law)
        before = NO_MODE
    if kind == _ARC:
        guide[MODE] = CHORDS
        if before != CHORDS:
            guide[PACE_ARC] = 0.0
        guide[BEGIN : BEGIN + 3] = guide[END : END + 3]
        guide[END : END + 3] = row[RX : RZ + 1]
        return
    guide[MODE] = LEGS
    if before == LEGS and faster:
        for i in range(1, 3):
            change_speed(heads[i], curves[i], guide[LEVEL], guide[UP], guide[DOWN])
    if how != SAME:
        if before == LEGS:
            heads[0], curves[0] = heads[1], curves[1]
        else:
            clear_leg(heads[0])
            guide[FAST] = 0.0
        guide[BEGIN : BEGIN + 3] = guide[END : END + 3]
        guide[END : END + 3] = row[RX : RZ + 1]
        if before != LEGS:
            _apart(guide)
        if guide[FAST] != 0.0 and heads[2, TIME] < end_time(heads[2], curves[2]):
            heads[1], curves[1] = heads[2], curves[2]
        else:
            _make(1, guide[BEGIN : BEGIN + 3], guide[END : END + 3], guide, law, heads, curves)
        clear_leg(heads[2])
    elif guide[FAST] != 0.0 and heads[2, TIME] > 0.0:
        # The corner is being flown already.
        return
    guide[FAST] = 0.0
    if leg + 1 < len(route) and row[RADIUS] > 0.0 and row[PAUSE] <= 0.0:
        after = route[leg + 1]
        if after[KIND] <= _HOME and after[KIND] != _TAKEOFF:
            guide[FAST] = 1.0
            _make(2, guide[END : END + 3], after[RX : RZ + 1], guide, law, heads, curves)


@njit(cache=True)
def _command(state: Floats, guide: Floats, law: Floats) -> None:
    """Position and velocity control: the acceleration that is asked for and the thrust."""
    dt = law[DT]
    ex, ey = guide[PX] - state[0], guide[PX + 1] - state[1]
    size = sqrt(ex * ex + ey * ey)
    if size > 0.0:
        most = stopping_way(guide[LEVEL], law[POS_P], law[ACCEL])
        if size > most:
            ex, ey, size = ex * most / size, ey * most / size, most
            if guide[MODE] != LEGS:
                guide[PX], guide[PX + 1] = state[0] + ex, state[1] + ey
        gain = _rooted(size, law[POS_P], law[ACCEL]) / size
    else:
        gain = 0.0
    ez = guide[PX + 2] - state[2]
    most = stopping_way(guide[UP] if ez > 0.0 else guide[DOWN], law[POS_Z_P], law[ACCEL_Z])
    ez = min(max(ez, -most), most)
    wx, wy, wz = guide[VX], guide[VX + 1], guide[VX + 2]
    wanted = sqrt(wx * wx + wy * wy + wz * wz)
    guide[LAG] = guide[ALONG] = 0.0
    if wanted > 1e-6:
        guide[LAG] = (ex * wx + ey * wy + ez * wz) / wanted
        guide[ALONG] = (state[3] * wx + state[4] * wy + state[5] * wz) / wanted
    ux, uy = gain * ex + wx - state[3], gain * ey + wy - state[4]
    uz = _rooted(ez, law[POS_Z_P], law[ACCEL_Z]) + wz - state[5]
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
    thrust = min(max(thrust, -GRAVITY), 1.5 * GRAVITY)
    most = law[ACC_Z_IMAX]
    guide[THRUST_I] = min(max(guide[THRUST_I] + law[ACC_Z_I] * dt * (az - thrust - lift), -most), most)
    guide[THRUST] = thrust


@njit(cache=True, inline="always")
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


@njit(cache=True)
def _move(state: Floats, guide: Floats, law: Floats, rising: float) -> float:
    """Fly a step: the attitude follows, thrust and drag move the airframe. Returns the way that was flown."""
    dt = law[DT]
    for k in range(2):
        guide[TARGET + k] += law[TARGET_FILTER] * (guide[ASKED + k] - guide[TARGET + k])
        guide[LEAN + k] += law[LEAN_FILTER] * (guide[TARGET + k] - guide[LEAN + k])
    share = 1.0 + guide[THRUST] / GRAVITY
    # Drag acts in the plane of the rotors and, without the part of their momentum, across it.
    lx, ly = guide[LEAN], guide[LEAN + 1]
    stretch = sqrt(lx * lx + ly * ly + GRAVITY * GRAVITY)
    nx, ny, nz = lx / stretch, ly / stretch, GRAVITY / stretch
    ux, uy, uz = state[3] - state[15], state[4] - state[16], state[5] - rising
    through = ux * nx + uy * ny + uz * nz
    ux, uy, uz = ux - through * nx, uy - through * ny, uz - through * nz
    drag = law[DRAG] * sqrt(max(share, 0.0) / nz) + law[DRAG_2] * sqrt(ux * ux + uy * uy + uz * uz)
    through *= law[DRAG_2] * abs(through)
    ax = share * lx - drag * ux - through * nx
    ay = share * ly - drag * uy - through * ny
    guide[LIFT] = -drag * uz - through * nz
    az = guide[THRUST] + guide[LIFT]
    mx = dt * (state[3] + 0.5 * dt * ax)
    my = dt * (state[4] + 0.5 * dt * ay)
    mz = dt * (state[5] + 0.5 * dt * az)
    state[0] += mx
    state[1] += my
    state[2] += mz
    state[3] += dt * ax
    state[4] += dt * ay
    state[5] += dt * az
    state[6], state[7], state[8] = ax, ay, az
    if state[2] < 0.0:
        mz -= state[2]
        state[2] = 0.0
        state[5] = max(state[5], 0.0)
        state[8] = max(state[8], 0.0)
    return sqrt(mx * mx + my * my + mz * mz)


@njit(cache=True, inline="always")
def _blurred_share(share: float, blur: float) -> float:
    """Return the mean of a number within 0 to 1 when it shakes by ``blur`` to both sides."""
    high, low = share + blur, share - blur
    if low >= 1.0 or high <= 0.0 or (low >= 0.0 and high <= 1.0):
        return min(max(share, 0.0), 1.0)
    high = high - 0.5 if high > 1.0 else 0.5 * high * high
    low = 0.5 * low * low if low > 0.0 else 0.0
    return (high - low) / (2.0 * blur)


@njit(cache=True)
def _lead_legs(guide: Floats, law: Floats, heads: Floats, curves: Floats) -> bool:
    """Move the target along this leg, the end of the one before and the begin of the next; tell its end.

    The target slows down as far as the vehicle falls behind it, with the time constant of the acceleration.
    """
    wanted = sqrt(guide[VX] ** 2 + guide[VX + 1] ** 2 + guide[VX + 2] ** 2)
    pace = 1.0
    if wanted > 1e-6:
        pace = _blurred_share(0.05 + (guide[ALONG] - law[POS_P] * guide[LAG]) / wanted, SHAKE / wanted)
    guide[PACE] += law[PACE_FILTER] * (pace - guide[PACE])
    dt = law[DT] * guide[PACE]
    ends = end_time(heads[1], curves[1])
    now = min(heads[1, TIME] + dt, ends)
    heads[1, TIME] = now
    done = now >= ends
    follows = heads[2, TIME] > 0.0
    if guide[FAST] != 0.0 and not follows:
        follows = may_turn(heads, curves, law[WP_RADIUS], law[CORNER])
    if follows:
        heads[2, TIME] = min(heads[2, TIME] + dt, end_time(heads[2], curves[2]))
        done = done or heads[2, TIME] >= ends - now
    last = end_time(heads[0], curves[0])
    if heads[0, TIME] < last:
        heads[0, TIME] = min(heads[0, TIME] + dt, last)
        if heads[0, TIME] >= last:
            heads[0, MADE] = 0.0
    for k in range(3):
        guide[PX + k] = guide[BEGIN + k]
    guide[VX : AX + 3] = 0.0
    for i in range(3):
        if heads[i, MADE] == 0.0 or (i == 2 and not follows):
            continue
        p, v, a = state_at(heads[i], curves[i], heads[i, TIME])
        if i == 0:
            p -= heads[0, 2]
        for k in range(3):
            u = heads[i, UX + k]
            guide[PX + k] += u * p
            guide[VX + k] += u * v
            guide[AX + k] += u * a
    return done


@njit(cache=True)
def _lead_chord(guide: Floats, law: Floats, route: Floats, leg: int) -> bool:
    """Move the target along the chords of a curve, with half of the acceleration; tell the end of this one."""
    dt = law[DT]
    left, way = 0.0, 0.0
    for k in range(3):
        left += (guide[END + k] - guide[PX + k]) ** 2
    left = sqrt(left)
    # What lies ahead within the way that braking takes.
    accel = 0.5 * law[ACCEL]
    speed = guide[PACE_ARC]
    top = min(route[leg, SPEED], guide[LEVEL])
    way, i = left, leg
    need = 0.5 * speed * speed / accel + 2.0 * dt * speed
    while way <= need:
        if i + 1 >= len(route) or route[i + 1, KIND] != _ARC or route[i, PAUSE] > 0.0:
            top = min(top, sqrt(2.0 * accel * way))
            break
        slow = route[i + 1, SPEED]
        top = min(top, sqrt(slow * slow + 2.0 * accel * way))
        step = 0.0
        for k in range(3):
            step += (route[i + 1, k] - route[i, k]) ** 2
        way += sqrt(step)
        i += 1
    speed = min(max(top, speed - accel * dt), speed + accel * dt)
    guide[PACE_ARC] = speed
    move = max(speed, 0.05) * dt
    done = move >= left
    share = 1.0 if done else move / left
    for k in range(3):
        gap = guide[END + k] - guide[PX + k]
        guide[VX + k] = gap * speed / left if left > 0.0 else 0.0
        guide[PX + k] += gap * share
        guide[AX + k] = 0.0
    return done


@njit(cache=True)
def _lead_up(guide: Floats, law: Floats) -> bool:
    """Climb to the height of the take-off; tell when that is reached and the climb slow."""
    dt, limit, jerk = law[DT], law[ACCEL_Z], law[SHAPE_JERK_Z]
    guide[PX + 2] += dt * (guide[VX + 2] + 0.5 * dt * guide[AX + 2])
    guide[VX + 2] += dt * guide[AX + 2]
    gain = jerk / limit
    error = guide[END + 2] - guide[PX + 2]
    rate = _rooted(error, gain, limit)
    if rate * guide[VX + 2] > 0.0:
        slope = gain if abs(error) <= limit / (gain * gain) else limit / abs(rate)
        rate -= slope * guide[VX + 2] / gain
    rate = min(max(rate, -guide[DOWN]), guide[UP])
    wanted = min(max((rate - guide[VX + 2]) * gain, -limit), limit)
    guide[AX + 2] += min(max(wanted - guide[AX + 2], -jerk * dt), jerk * dt)
    stops = 0.5 * (0.1 * guide[UP]) ** 2 / limit
    return bool(guide[PX + 2] >= guide[END + 2] - stops and guide[VX + 2] < 0.1 * guide[UP])


@njit(cache=True)
def _lead_down(guide: Floats, law: Floats, height: float) -> None:
    """Sink, slowly near the ground."""
    dt = law[DT]
    guide[PX + 2] += dt * (guide[VX + 2] + 0.5 * dt * guide[AX + 2])
    guide[VX + 2] += dt * guide[AX + 2]
    rate = _rooted(law[LAND_LOW] - height, law[POS_Z_P], law[ACCEL_Z])
    fast = law[LAND_FAST] if law[LAND_FAST] > 0.0 else guide[DOWN]
    rate = min(max(rate, -max(fast, law[LAND_SLOW])), -law[LAND_SLOW])
    guide[AX + 2] = _shape(rate - guide[VX + 2], guide[AX + 2], law[ACCEL_Z], law[SHAPE_JERK_Z], dt)


@njit(cache=True)
def _lead_level(guide: Floats, law: Floats) -> None:
    """Bring the horizontal velocity to rest while the vehicle climbs or sinks."""
    if guide[VX] == 0.0 and guide[VX + 1] == 0.0 and guide[AX] == 0.0 and guide[AX + 1] == 0.0:
        return
    dt, limit, jerk = law[DT], law[ACCEL], law[SHAPE_JERK]
    for k in range(2):
        guide[PX + k] += dt * (guide[VX + k] + 0.5 * dt * guide[AX + k])
        guide[VX + k] += dt * guide[AX + k]
    speed = sqrt(guide[VX] ** 2 + guide[VX + 1] ** 2)
    if speed < 1e-3:
        guide[VX] = guide[VX + 1] = guide[AX] = guide[AX + 1] = 0.0
        return
    size = min(_rooted(speed, jerk / limit, jerk), speed / dt, limit) / speed
    cx, cy = -guide[VX] * size - guide[AX], -guide[VX + 1] * size - guide[AX + 1]
    change = sqrt(cx * cx + cy * cy)
    share = min(1.0, jerk * dt / change) if change > 0.0 else 0.0
    guide[AX] += cx * share
    guide[AX + 1] += cy * share


@njit(cache=True)
def _turn(state: Floats, guide: Floats, law: Floats, heading: float, turning: float) -> None:
    """Turn the nose: to a place, at a rate, to a heading, or to where the target goes."""
    yaw, rate, change = state[9], state[10], law[YAW_ACCEL] * law[DT]
    wanted = np.nan
    if not isnan(state[17]):
        east, north = state[17] - state[0], state[18] - state[1]
        if east * east + north * north > ROI_NEAR * ROI_NEAR:
            wanted = atan2(east, north)
    elif not isnan(turning):
        rate += min(max(min(max(turning, -law[YAW_RATE]), law[YAW_RATE]) - rate, -change), change)
        state[9], state[10] = (yaw + rate * law[DT]) % (2.0 * pi), rate
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
            state[9], state[10] = (yaw + rate * law[DT]) % (2.0 * pi), rate
        return
    error = (wanted - yaw + pi) % (2.0 * pi) - pi
    size = abs(error)
    if size < 1e-6 and abs(rate) < 1e-4:
        state[9], state[10] = wanted % (2.0 * pi), 0.0
        return
    aim = min(law[YAW_RATE], 2.0 * size, 0.8 * sqrt(2.0 * law[YAW_ACCEL] * size))
    aim = aim if error > 0.0 else -aim
    rate += min(max(aim - rate, -change), change)
    state[9], state[10] = (yaw + rate * law[DT]) % (2.0 * pi), rate


@njit(cache=True)
def _stand(state: Floats, guide: Floats) -> None:
    """Stand on the ground with the motors running."""
    state[2:9] = 0.0
    guide[PX : PX + 3] = state[0:3]
    guide[VX : AX + 3] = 0.0
    guide[INTEGRAL : LEAN + 2] = 0.0
    guide[RESET] = 1.0


@njit(cache=True)
def _lead(
    state: Floats,
    guide: Floats,
    law: Floats,
    heads: Floats,
    curves: Floats,
    route: Floats,
    leg: int,
    step: int,
) -> bool:
    """Move the target for the next step; tell whether the leg is done."""
    mode = guide[MODE]
    if mode == LEGS:
        done = _lead_legs(guide, law, heads, curves)
        if done and guide[FAST] == 0.0:
            gap = 0.0
            for k in range(3):
                gap += (guide[END + k] - state[k]) ** 2
            done = gap <= law[WP_RADIUS] ** 2
    elif mode == CHORDS:
        done = guide[DONE] != 0.0 or _lead_chord(guide, law, route, leg)
        if done:
            guide[DONE] = 1.0
            if leg + 1 >= len(route) or route[leg + 1, KIND] != _ARC:
                guide[VX : AX + 3] = 0.0
                guide[PACE_ARC] = 0.0
                gap = 0.0
                for k in range(3):
                    gap += (guide[END + k] - state[k]) ** 2
                done = gap <= law[WP_RADIUS] ** 2
    elif mode == CLIMBING:
        _lead_level(guide, law)
        done = _lead_up(guide, law)
        if done:
            guide[PX + 2] = guide[END + 2]
            guide[VX : AX + 3] = 0.0
            guide[END], guide[END + 1] = guide[PX], guide[PX + 1]
    elif mode == LANDING:
        _lead_level(guide, law)
        _lead_down(guide, law, state[2])
        done = False
        if state[2] <= 0.0:
            guide[MODE] = LANDED
            guide[UNTIL] = step + law[DETECT_STEPS]
            _stand(state, guide)
    elif mode == HOLDING:
        if leg + 1 < len(route):
            return True
        gap = (guide[PX] - state[0]) ** 2 + (guide[PX + 1] - state[1]) ** 2 + (guide[PX + 2] - state[2]) ** 2
        done = gap < 0.04 and state[3] ** 2 + state[4] ** 2 + state[5] ** 2 < 0.01
    else:
        done = mode == LANDED and step >= guide[UNTIL]
    return done


@njit(cache=True)
def advance(
    state: Floats,
    counters: Integers,
    guide: Floats,
    law: Floats,
    heads: Floats,
    curves: Floats,
    route: Floats,
    turning: float,
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

    Parameters
    ----------
    state, counters : float64[STATE], int64[COUNTERS]
        Those of `sim_vehicle.motion.kernel`; changed in place, as are the next arrays.
    guide : float64[GUIDE]
    law : float64[LAW]
    heads, curves : float64[3, HEAD], float64[3, SEGMENTS, COLUMNS]
        The leg before, this one and the next: `sim_vehicle.motion.scurve`.
    route : float64[n, 9]
        East, north, up, radius, speed, heading, near, kind and pause, as in `sim_vehicle.motion.model.Route`.
    turning : float
        Rate of turning instead of the headings, NaN for none.
    power, wind, first_wind, max_steps, stop_each, arrivals, track, track_every
        As in `sim_vehicle.motion.kernel.advance`.

    Returns
    -------
    int
        RAN, REACHED, WIND (the wind block is used up), STALLED (no progress), ENERGY or NEAR.
    """
    dt = law[DT]
    last = route.shape[0] - 1
    event = RAN
    rising = guide[RISING]
    for _ in range(max_steps):
        step, leg = counters[0], counters[1]
        if guide[BEGINS] != NOTHING:
            _begin(state, guide, law, heads, curves, route, leg, step)
            state[14] = inf
        row = route[leg]
        if step % GRID == 0:
            index = 0
            if wind.shape[0] > 1:
                index = step // GRID - first_wind
                if index >= wind.shape[0]:
                    event = WIND
                    break
            state[15], state[16], rising = wind_at(wind[index], state[2])
            ux, uy = state[3] - state[15], state[4] - state[16]
            grounded = guide[MODE] == LANDED or (guide[MODE] == CLIMBING and step < guide[UNTIL] < inf)
            if grounded:
                state[13] = law[STAND_BY]
            else:
                climb = state[5] - rising
                state[13] = multirotor_power(power, ux, uy, climb, state[6], state[7], state[8])
            if track_every > 0 and (step // GRID) % track_every == 0 and counters[5] < track.shape[0]:
                track[counters[5]] = state[0:3]
                counters[5] += 1
            if counters[3] == 0 and guide[DONE] == 0.0 and not grounded and guide[MODE] != LANDING:
                if state[14] == inf:
                    left = 0.0
                    for k in range(3):
                        left += (row[k] - state[k]) ** 2
                    slowest = min(guide[LEVEL], guide[UP], guide[DOWN], SLOWEST)
                    state[14] = step + (STALL_S + 1.5 * sqrt(left) / slowest) / dt
                    counters[2] = step
                if state[3] ** 2 + state[4] ** 2 + state[5] ** 2 > 0.0025 * min(guide[LEVEL] ** 2, 1.0):
                    counters[2] = step
                if (step - counters[2]) * dt > STALL_S or step > state[14]:
                    event = STALLED
                    break
        waits = guide[MODE] == CLIMBING and step < guide[UNTIL] < inf
        if waits or guide[MODE] == LANDED:
            _stand(state, guide)
        else:
            _command(state, guide, law)
            state[12] += _move(state, guide, law, rising)
        _turn(state, guide, law, row[HEADING], turning)
        state[11] += state[13] * dt
        step += 1
        counters[0] = step
        done = False
        if not waits:
            done = _lead(state, guide, law, heads, curves, route, leg, step)
        if counters[3] == 0:
            if done and row[PAUSE] > 0.0 and guide[DONE] != 2.0:
                guide[DONE] = 2.0
                guide[UNTIL] = step + round(row[PAUSE] / dt)
            if guide[DONE] == 2.0:
                done = step >= guide[UNTIL]
            if done:
                arrivals[leg] = step
                counters[4] = 0
                if leg == last:
                    counters[3] = 1
                    event = REACHED
                else:
                    counters[1] = leg + 1
                    guide[BEGINS] = CHAINED
                    if stop_each:
                        event = REACHED
            elif counters[4] == 0 and row[DISTANCE] > 0.0:
                left = 0.0
                for k in range(3):
                    left += (row[k] - state[k]) ** 2
                if left < row[DISTANCE] ** 2:
                    counters[4] = 1
                    event = NEAR
        if state[11] >= law[CAPACITY]:
            event = ENERGY
        if event != RAN:
            break
    guide[RISING] = rising
    return event
