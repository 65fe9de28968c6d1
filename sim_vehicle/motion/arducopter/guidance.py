"""ArduCopter's guidance: where the target of the position control is, leg by leg.

Formulas after ArduPilot 4.7: `AC_WPNav.cpp`, `AP_Math/control.cpp`, ArduCopter's `mode.cpp`, `mode_auto.cpp`,
`mode_rtl.cpp` and `takeoff.cpp`. How it works is told in docs/vehicle-model.md, section ArduCopter.
"""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.arducopter.control import rooted, stand, stopping_distance
from sim_vehicle.motion.arducopter.layout import (
    ACCEL,
    ACCEL_Z,
    ALONG,
    ANEW,
    ARC,
    ARMING_STEPS,
    ASKED,
    AX,
    BEGIN,
    BEGINS,
    CHORDS,
    CLIMBING,
    CORNER,
    DETECT_STEPS,
    DONE,
    DOWN,
    DT,
    END,
    FAST,
    GUIDED,
    HOLDING,
    HOME,
    INTEGRAL,
    JERK,
    KIND,
    LAG,
    LAND,
    LAND_FAST,
    LAND_LOW,
    LAND_SLOW,
    LANDED,
    LANDING,
    LEAST_SPEED,
    LEAST_WAY,
    LEGS,
    LEVEL,
    MODE,
    NO_MODE,
    NOTHING,
    PACE,
    PACE_ARC,
    PACE_FILTER,
    PAUSE,
    POS_P,
    POS_Z_P,
    PX,
    RADIUS,
    RESET,
    RX,
    RY,
    RZ,
    SAME,
    SETPOINT,
    SHAKE,
    SHAPE_JERK,
    SHAPE_JERK_Z,
    SIDE,
    SNAP,
    SPEED,
    SPEED_DOWN,
    SPEED_UP,
    SPOOL_STEPS,
    STAY,
    TAKEOFF,
    THRUST,
    THRUST_I,
    UNTIL,
    UP,
    VX,
    WP_RADIUS,
)
from sim_vehicle.motion.arducopter.scurve import (
    LENGTH,
    MADE,
    TIME,
    UX,
    change_speed,
    clear_leg,
    copy_leg,
    end_time,
    make_leg,
    may_turn,
    state_at,
)
from sim_vehicle.motion.rows import clear, copy

Floats = NDArray[np.float64]


@compiled
def _shape(change: float, acceleration: float, limit: float, jerk: float, dt: float) -> float:
    """Return the next acceleration of a change of speed, within limits of it and of its jerk."""
    wanted = rooted(change, jerk / limit, jerk)
    most = abs(change) / dt
    wanted = min(max(wanted, -most, -limit), most, limit)
    return acceleration + min(max(wanted - acceleration, -jerk * dt), jerk * dt)


@compiled
def _stop_here(state: Floats, guide: Floats, law: Floats) -> None:
    """Begin anew from the position where the vehicle comes to rest."""
    vx, vy, vz = state[col.VELOCITY_X], state[col.VELOCITY_Y], state[col.VELOCITY_Z]
    speed = sqrt(vx * vx + vy * vy)
    guide[PX], guide[PX + 1] = state[col.POSITION_X], state[col.POSITION_Y]
    if speed > 0.0:
        seconds = stopping_distance(min(speed, guide[LEVEL]), law[POS_P], law[ACCEL]) / speed
        guide[PX] += vx * seconds
        guide[PX + 1] += vy * seconds
    distance = stopping_distance(
        min(abs(vz), law[SPEED_UP] if vz > 0.0 else law[SPEED_DOWN]), law[POS_Z_P], law[ACCEL_Z]
    )
    guide[PX + 2] = max(state[col.POSITION_Z] + (distance if vz > 0.0 else -distance), 0.0)
    clear(guide, VX, AX + 3)
    copy(guide, BEGIN, guide, PX, 3)
    copy(guide, END, guide, PX, 3)
    guide[INTEGRAL], guide[INTEGRAL + 1] = guide[ASKED], guide[ASKED + 1]
    guide[THRUST_I] = guide[THRUST]
    guide[RESET] = 1.0
    guide[PACE] = 1.0


@compiled
def _take_velocity(state: Floats, guide: Floats) -> None:
    """Begin anew from the present position and velocity."""
    copy(guide, PX, state, col.POSITION, 6)
    clear(guide, AX, AX + 3)
    guide[INTEGRAL], guide[INTEGRAL + 1] = guide[ASKED], guide[ASKED + 1]
    guide[THRUST_I] = guide[THRUST]
    guide[RESET] = 1.0
    guide[PACE] = 1.0


@compiled
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


@compiled
def _apart(guide: Floats) -> None:
    """Keep the begin of a leg from its end: an estimated position is never exactly the wanted one."""
    gap = 0.0
    for k in range(3):
        gap += (guide[END + k] - guide[BEGIN + k]) ** 2
    if gap < LEAST_WAY * LEAST_WAY:
        guide[BEGIN] = guide[END] - LEAST_WAY


@compiled
def begin(
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
    if kind == ARC:
        # The bends of a curve may be slower than what the mission set.
        speed = max(speed, guide[LEVEL])
    elif speed < LEAST_SPEED:
        speed = guide[LEVEL]
    faster = law[SPEED_UP] != guide[UP] or law[SPEED_DOWN] != guide[DOWN] or speed != guide[LEVEL]
    guide[LEVEL] = speed
    guide[UP], guide[DOWN] = law[SPEED_UP], law[SPEED_DOWN]
    if kind in (TAKEOFF, LAND):
        if how == ANEW or before == CHORDS:
            _take_velocity(state, guide)
        if kind == TAKEOFF:
            guide[MODE] = CLIMBING
            guide[END], guide[END + 1], guide[END + 2] = row[RX], row[RY], row[RZ]
            if state[col.POSITION_Z] <= 0.0:
                guide[UNTIL] = step + guide[ARMING_STEPS] + law[SPOOL_STEPS]
        else:
            guide[MODE] = LANDING
        return
    if kind == STAY:
        _stop_here(state, guide, law)
        guide[MODE] = HOLDING
        return
    if kind == SETPOINT:
        if before != GUIDED:
            _take_velocity(state, guide)
        guide[MODE] = GUIDED
        copy(guide, END, row, RX, 3)
        return
    if how == ANEW or before not in (LEGS, CLIMBING, CHORDS):
        _stop_here(state, guide, law)
        before = NO_MODE
    if kind == ARC:
        guide[MODE] = CHORDS
        if before != CHORDS:
            guide[PACE_ARC] = 0.0
        copy(guide, BEGIN, guide, END, 3)
        copy(guide, END, row, RX, 3)
        return
    guide[MODE] = LEGS
    if before == LEGS and faster:
        for i in range(1, 3):
            change_speed(heads[i], curves[i], guide[LEVEL], guide[UP], guide[DOWN])
    if how != SAME:
        if before == LEGS:
            copy_leg(heads, curves, 0, 1)
        else:
            clear_leg(heads[0])
            guide[FAST] = 0.0
        copy(guide, BEGIN, guide, END, 3)
        copy(guide, END, row, RX, 3)
        if before != LEGS:
            _apart(guide)
        if guide[FAST] != 0.0 and heads[2, TIME] < end_time(heads[2], curves[2]):
            copy_leg(heads, curves, 1, 2)
        else:
            _make(1, guide[BEGIN : BEGIN + 3], guide[END : END + 3], guide, law, heads, curves)
        clear_leg(heads[2])
    elif guide[FAST] != 0.0 and heads[2, TIME] > 0.0:
        # The corner is being flown already.
        return
    guide[FAST] = 0.0
    if leg + 1 < len(route) and row[RADIUS] > 0.0 and row[PAUSE] <= 0.0:
        after = route[leg + 1]
        if after[KIND] <= HOME and after[KIND] != TAKEOFF:
            guide[FAST] = 1.0
            _make(2, guide[END : END + 3], after[RX : RZ + 1], guide, law, heads, curves)


@compiled(inline="always")
def _blurred_share(share: float, blur: float) -> float:
    """Return the mean of a number within 0 to 1 when it shakes by ``blur`` to both sides."""
    high, low = share + blur, share - blur
    if low >= 1.0 or high <= 0.0 or (low >= 0.0 and high <= 1.0):
        return min(max(share, 0.0), 1.0)
    high = high - 0.5 if high > 1.0 else 0.5 * high * high
    low = 0.5 * low * low if low > 0.0 else 0.0
    return (high - low) / (2.0 * blur)


@compiled(inline="late", allocates=False)
def lead_legs(guide: Floats, law: Floats, heads: Floats, curves: Floats) -> bool:
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
    done = bool(now >= ends)
    follows = heads[2, TIME] > 0.0
    if guide[FAST] != 0.0 and not follows:
        follows = may_turn(heads, curves, law[WP_RADIUS], law[CORNER])
    if follows:
        heads[2, TIME] = min(heads[2, TIME] + dt, end_time(heads[2], curves[2]))
        done = bool(done or heads[2, TIME] >= ends - now)
    last = end_time(heads[0], curves[0])
    if heads[0, TIME] < last:
        heads[0, TIME] = min(heads[0, TIME] + dt, last)
        if heads[0, TIME] >= last:
            heads[0, MADE] = 0.0
    x, y, z = guide[BEGIN], guide[BEGIN + 1], guide[BEGIN + 2]
    vx = vy = vz = ax = ay = az = 0.0
    for i in range(3):
        if heads[i, MADE] == 0.0 or (i == 2 and not follows):
            continue
        p, v, a = state_at(heads[i], curves[i], heads[i, TIME])
        if i == 0:
            p -= heads[0, LENGTH]
        east, north, up = heads[i, UX], heads[i, UX + 1], heads[i, UX + 2]
        x, y, z = x + east * p, y + north * p, z + up * p
        vx, vy, vz = vx + east * v, vy + north * v, vz + up * v
        ax, ay, az = ax + east * a, ay + north * a, az + up * a
    guide[PX], guide[PX + 1], guide[PX + 2] = x, y, z
    guide[VX], guide[VX + 1], guide[VX + 2] = vx, vy, vz
    guide[AX], guide[AX + 1], guide[AX + 2] = ax, ay, az
    return done


@compiled(allocates=False)
def _lead_chord(guide: Floats, law: Floats, route: Floats, leg: int) -> bool:
    """Move the target along a curve of chords with half of the acceleration; tell the end of this one."""
    dt = law[DT]
    left, way = 0.0, 0.0
    for k in range(3):
        left += (guide[END + k] - guide[PX + k]) ** 2
    left = sqrt(left)
    # What lies ahead within the braking distance.
    accel = 0.5 * law[ACCEL]
    speed = guide[PACE_ARC]
    top = route[leg, SPEED]
    way, i = left, leg
    need = 0.5 * speed * speed / accel + 2.0 * dt * speed
    while way <= need:
        if i + 1 >= len(route) or route[i + 1, KIND] != ARC or route[i, PAUSE] > 0.0:
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
    done = bool(move >= left)
    share = 1.0 if done else move / left
    for k in range(3):
        gap = guide[END + k] - guide[PX + k]
        guide[VX + k] = gap * speed / left if left > 0.0 else 0.0
        guide[PX + k] += gap * share
        guide[AX + k] = 0.0
    return done


@compiled(allocates=False)
def _lead_up(guide: Floats, law: Floats) -> bool:
    """Climb to the height of the take-off; tell when that is reached and the climb slow."""
    dt, limit, jerk = law[DT], law[ACCEL_Z], law[SHAPE_JERK_Z]
    guide[PX + 2] += dt * (guide[VX + 2] + 0.5 * dt * guide[AX + 2])
    guide[VX + 2] += dt * guide[AX + 2]
    gain = jerk / limit
    error = guide[END + 2] - guide[PX + 2]
    rate = rooted(error, gain, limit)
    if rate * guide[VX + 2] > 0.0:
        slope = gain if abs(error) <= limit / (gain * gain) else limit / abs(rate)
        rate -= slope * guide[VX + 2] / gain
    rate = min(max(rate, -guide[DOWN]), guide[UP])
    wanted = min(max((rate - guide[VX + 2]) * gain, -limit), limit)
    guide[AX + 2] += min(max(wanted - guide[AX + 2], -jerk * dt), jerk * dt)
    stops = 0.5 * (0.1 * guide[UP]) ** 2 / limit
    return bool(guide[PX + 2] >= guide[END + 2] - stops and guide[VX + 2] < 0.1 * guide[UP])


@compiled(allocates=False)
def _lead_to(guide: Floats, law: Floats) -> bool:
    """Move the target to the position asked for in guided mode; tell whether it is there.

    `AC_PosControl::input_pos_NEU_m`: the speed is that from which half of the acceleration, reached with half
    of the jerk, still stops there. What corrects the velocity goes along the wanted velocity and across it:
    a turn of less than 45 degrees or more than 135 leaves most of the acceleration to what goes along, any
    other brakes and turns at once.
    """
    dt, limit, jerk = law[DT], law[ACCEL], law[SHAPE_JERK]
    for k in range(3):
        guide[PX + k] += dt * (guide[VX + k] + 0.5 * dt * guide[AX + k])
        guide[VX + k] += dt * guide[AX + k]
    dx, dy, dz = guide[END] - guide[PX], guide[END + 1] - guide[PX + 1], guide[END + 2] - guide[PX + 2]
    flat = sqrt(dx * dx + dy * dy)
    way = sqrt(flat * flat + dz * dz)
    most = guide[LEVEL] * way / flat if flat > 0.0 else inf
    if dz != 0.0:
        most = min(most, (guide[UP] if dz > 0.0 else guide[DOWN]) * way / abs(dz))
    wx = wy = wz = ex = ey = 0.0
    if flat > 0.0:
        ex, ey = dx / flat, dy / flat
        rate = min(rooted(flat, 0.5 * jerk / limit, 0.5 * limit), flat / dt, most * flat / way)
        wx, wy = rate * ex, rate * ey
    cx, cy = wx - guide[VX], wy - guide[VX + 1]
    change = sqrt(cx * cx + cy * cy)
    if change > 0.0:
        size = min(rooted(change, jerk / limit, jerk), change / dt)
        cx, cy = cx * size / change, cy * size / change
        along, across = cx * ex + cy * ey, cy * ex - cx * ey
        if along * along > across * across:
            across = min(max(across, -SIDE * limit), SIDE * limit)
            room = sqrt(limit * limit - across * across)
            along = min(max(along, -room), room)
            cx, cy = along * ex - across * ey, along * ey + across * ex
        elif size > limit:
            cx, cy = cx * limit / size, cy * limit / size
    cx, cy = cx - guide[AX], cy - guide[AX + 1]
    change = sqrt(cx * cx + cy * cy)
    share = min(1.0, jerk * dt / change) if change > 0.0 else 0.0
    guide[AX] += cx * share
    guide[AX + 1] += cy * share
    limit, jerk = law[ACCEL_Z], law[SHAPE_JERK_Z]
    if dz != 0.0:
        top = min(most * abs(dz) / way, abs(dz) / dt)
        wz = min(max(rooted(dz, 0.5 * jerk / limit, 0.5 * limit), -top), top)
    guide[AX + 2] = _shape(wz - guide[VX + 2], guide[AX + 2], limit, jerk, dt)
    return bool(way < 0.05 and guide[VX] ** 2 + guide[VX + 1] ** 2 < 0.0025)


@compiled(allocates=False)
def _lead_down(guide: Floats, law: Floats, height: float) -> None:
    """Sink, slowly near the ground."""
    dt = law[DT]
    guide[PX + 2] += dt * (guide[VX + 2] + 0.5 * dt * guide[AX + 2])
    guide[VX + 2] += dt * guide[AX + 2]
    rate = rooted(law[LAND_LOW] - height, law[POS_Z_P], law[ACCEL_Z])
    fast = law[LAND_FAST] if law[LAND_FAST] > 0.0 else guide[DOWN]
    rate = min(max(rate, -max(fast, law[LAND_SLOW])), -law[LAND_SLOW])
    guide[AX + 2] = _shape(rate - guide[VX + 2], guide[AX + 2], law[ACCEL_Z], law[SHAPE_JERK_Z], dt)


@compiled(allocates=False)
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
    size = min(rooted(speed, jerk / limit, jerk), speed / dt, limit) / speed
    cx, cy = -guide[VX] * size - guide[AX], -guide[VX + 1] * size - guide[AX + 1]
    change = sqrt(cx * cx + cy * cy)
    share = min(1.0, jerk * dt / change) if change > 0.0 else 0.0
    guide[AX] += cx * share
    guide[AX + 1] += cy * share


@compiled(inline="late", allocates=False)
def lead(
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
        done = lead_legs(guide, law, heads, curves)
        if done and guide[FAST] == 0.0:
            gap = 0.0
            for k in range(3):
                gap += (guide[END + k] - state[k]) ** 2
            done = gap <= law[WP_RADIUS] ** 2
    elif mode == CHORDS:
        done = guide[DONE] != 0.0 or _lead_chord(guide, law, route, leg)
        if done:
            guide[DONE] = 1.0
            if leg + 1 >= len(route) or route[leg + 1, KIND] != ARC:
                clear(guide, VX, AX + 3)
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
            clear(guide, VX, AX + 3)
            guide[END], guide[END + 1] = guide[PX], guide[PX + 1]
    elif mode == LANDING:
        _lead_level(guide, law)
        _lead_down(guide, law, state[col.POSITION_Z])
        done = False
        if state[col.POSITION_Z] <= 0.0:
            guide[MODE] = LANDED
            guide[UNTIL] = step + law[DETECT_STEPS]
            stand(state, guide)
    elif mode == GUIDED:
        done = _lead_to(guide, law)
    elif mode == HOLDING:
        if leg + 1 < len(route):
            return True
        gap = (
            (guide[PX] - state[col.POSITION_X]) ** 2
            + (guide[PX + 1] - state[col.POSITION_Y]) ** 2
            + (guide[PX + 2] - state[col.POSITION_Z]) ** 2
        )
        done = (
            gap < 0.04
            and state[col.VELOCITY_X] ** 2 + state[col.VELOCITY_Y] ** 2 + state[col.VELOCITY_Z] ** 2 < 0.01
        )
    else:
        done = mode == LANDED and step >= guide[UNTIL]
    return done
