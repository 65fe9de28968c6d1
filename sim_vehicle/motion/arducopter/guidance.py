"""ArduCopter's guidance: the target of the position controller along each leg.

The formulas are from ArduPilot 4.7: `AC_WPNav.cpp`, `AP_Math/control.cpp`, ArduCopter's `mode.cpp`,
`mode_auto.cpp`, `mode_rtl.cpp` and `takeoff.cpp`. See docs/vehicle-model.md, section ArduCopter.
"""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.motion.arducopter import control as at
from sim_vehicle.motion.arducopter.control import halt, rooted, stand, stopping_distance
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
from sim_vehicle.motion.columns import Record
from sim_vehicle.motion.stepping import distance2

Floats = NDArray[np.float64]
Position = tuple[float, float, float]


@compiled(allocates=False)
def _shape(change: float, acceleration: float, limit: float, jerk: float, dt: float) -> float:
    """Return the acceleration after the next step of a speed change, within acceleration and jerk limits."""
    wanted = rooted(change, jerk / limit, jerk)
    most = abs(change) / dt
    wanted = min(max(wanted, -most, -limit), most, limit)
    return acceleration + min(max(wanted - acceleration, -jerk * dt), jerk * dt)


@compiled(allocates=False)
def _stop_here(state: Record, guide: Record, law: Record) -> None:
    """Put the target at the position where the vehicle stops if it brakes now."""
    vx, vy, vz = state.velocity_x, state.velocity_y, state.velocity_z
    speed = sqrt(vx * vx + vy * vy)
    guide.px, guide.py = state.position_x, state.position_y
    if speed > 0.0:
        seconds = stopping_distance(min(speed, guide.level), law.pos_p, law.accel) / speed
        guide.px += vx * seconds
        guide.py += vy * seconds
    distance = stopping_distance(
        min(abs(vz), law.speed_up if vz > 0.0 else law.speed_down), law.pos_z_p, law.accel_z
    )
    guide.pz = max(state.position_z + (distance if vz > 0.0 else -distance), 0.0)
    halt(guide)
    guide.begin_x, guide.begin_y, guide.begin_z = guide.px, guide.py, guide.pz
    guide.end_x, guide.end_y, guide.end_z = guide.px, guide.py, guide.pz
    guide.integral_x, guide.integral_y = guide.asked_x, guide.asked_y
    guide.thrust_i = guide.thrust
    guide.reset = 1.0
    guide.pace = 1.0


@compiled(allocates=False)
def _take_velocity(state: Record, guide: Record) -> None:
    """Give the target the position and velocity of the vehicle."""
    guide.px, guide.py, guide.pz = state.position_x, state.position_y, state.position_z
    guide.vx, guide.vy, guide.vz = state.velocity_x, state.velocity_y, state.velocity_z
    guide.ax = guide.ay = guide.az = 0.0
    guide.integral_x, guide.integral_y = guide.asked_x, guide.asked_y
    guide.thrust_i = guide.thrust
    guide.reset = 1.0
    guide.pace = 1.0


@compiled(inline="always")
def begin_of(guide: Record) -> Position:
    """Return the start of the leg."""
    return guide.begin_x, guide.begin_y, guide.begin_z


@compiled(inline="always")
def end_of(guide: Record) -> Position:
    """Return the end of the leg."""
    return guide.end_x, guide.end_y, guide.end_z


@compiled(allocates=False)
def make(i: int, a: Position, b: Position, guide: Record, law: Record, heads: Floats, curves: Floats) -> None:
    """Make the profile of leg `i` of the three legs, from `a` to `b`, at the present speed limits."""
    make_leg(
        heads[i],
        curves[i],
        (b[0] - a[0], b[1] - a[1], b[2] - a[2]),
        (guide.level, guide.up, guide.down),
        (law.accel, law.accel_z),
        law.snap,
        law.jerk,
    )


@compiled(allocates=False)
def take_next(
    guide: Record, law: Record, heads: Floats, curves: Floats, row: Record, before: float, least: float
) -> None:
    """Continue with the next leg, from the end of the present leg or from the target at rest.

    A leg from rest gets a length of at least `least`, because an estimated position is never exact.
    """
    if before == at.LEGS:
        copy_leg(heads, curves, 0, 1)
    else:
        clear_leg(heads[0])
        guide.fast = 0.0
    guide.begin_x, guide.begin_y, guide.begin_z = guide.end_x, guide.end_y, guide.end_z
    guide.end_x, guide.end_y, guide.end_z = row.x, row.y, row.z
    if before != at.LEGS:
        gap = (
            (guide.end_x - guide.begin_x) ** 2
            + (guide.end_y - guide.begin_y) ** 2
            + (guide.end_z - guide.begin_z) ** 2
        )
        if gap < least * least:
            guide.begin_x = guide.end_x - least
    if guide.fast != 0.0 and heads[2, TIME] < end_time(heads[2], curves[2]):
        copy_leg(heads, curves, 1, 2)
    else:
        make(1, begin_of(guide), end_of(guide), guide, law, heads, curves)
    clear_leg(heads[2])


@compiled(allocates=False)
def begin(
    state: Record,
    guide: Record,
    law: Record,
    heads: Floats,
    curves: Floats,
    route: Record,
    leg: int,
    step: int,
) -> None:
    """Begin a leg with the transition that ``guide.begins`` names."""
    how = guide.begins
    guide.begins = at.NOTHING
    guide.until, guide.done = inf, 0.0
    row = route[leg]
    kind = int(row.kind)
    before = guide.mode
    speed = row.speed
    if kind == at.ARC:
        # The speed of a chord may be below the mission's speed.
        speed = max(speed, guide.level)
    elif speed < at.LEAST_SPEED:
        speed = guide.level
    faster = law.speed_up != guide.up or law.speed_down != guide.down or speed != guide.level
    guide.level = speed
    guide.up, guide.down = law.speed_up, law.speed_down
    if kind in (at.TAKEOFF, at.LAND):
        if how == at.ANEW or before == at.CHORDS:
            _take_velocity(state, guide)
        if kind == at.TAKEOFF:
            guide.mode = at.CLIMBING
            guide.end_x, guide.end_y, guide.end_z = row.x, row.y, row.z
            if state.position_z <= 0.0:
                guide.until = step + guide.arming_steps + law.spool_steps
        else:
            guide.mode = at.LANDING
        return
    if kind == at.STAY:
        _stop_here(state, guide, law)
        guide.mode = at.HOLDING
        return
    if kind == at.SETPOINT:
        if before != at.GUIDED:
            _take_velocity(state, guide)
        guide.mode = at.GUIDED
        guide.end_x, guide.end_y, guide.end_z = row.x, row.y, row.z
        return
    if how == at.ANEW or before not in (at.LEGS, at.CLIMBING, at.CHORDS):
        _stop_here(state, guide, law)
        before = at.NO_MODE
    if kind == at.ARC:
        guide.mode = at.CHORDS
        if before != at.CHORDS:
            guide.pace_arc = 0.0
        guide.begin_x, guide.begin_y, guide.begin_z = guide.end_x, guide.end_y, guide.end_z
        guide.end_x, guide.end_y, guide.end_z = row.x, row.y, row.z
        return
    guide.mode = at.LEGS
    if before == at.LEGS and faster:
        for i in range(1, 3):
            change_speed(heads[i], curves[i], guide.level, guide.up, guide.down)
    if how != at.SAME:
        take_next(guide, law, heads, curves, row, before, at.LEAST_WAY)
    elif guide.fast != 0.0 and heads[2, TIME] > 0.0:
        # The vehicle is already flying the corner.
        return
    guide.fast = 0.0
    if leg + 1 < len(route) and row.radius > 0.0 and row.pause <= 0.0:
        after = route[leg + 1]
        if after.kind <= at.HOME and after.kind != at.TAKEOFF:
            guide.fast = 1.0
            make(2, end_of(guide), (after.x, after.y, after.z), guide, law, heads, curves)


@compiled(inline="always")
def _blurred_share(share: float, blur: float) -> float:
    """Return the mean of `share` clipped to 0..1 if `share` varies uniformly by up to +-`blur`."""
    high, low = share + blur, share - blur
    if low >= 1.0 or high <= 0.0 or (low >= 0.0 and high <= 1.0):
        return min(max(share, 0.0), 1.0)
    high = high - 0.5 if high > 1.0 else 0.5 * high * high
    low = 0.5 * low * low if low > 0.0 else 0.0
    return (high - low) / (2.0 * blur)


@compiled(inline="late", allocates=False)
def lead_legs(guide: Record, law: Record, heads: Floats, curves: Floats) -> bool:
    """Move the target along the present leg, and return whether the leg is complete.

    Near corners, the motions of successive legs overlap in time and are added to each other. If the vehicle
    falls behind, the target slows down with the time constant of the acceleration.
    """
    wanted = sqrt(guide.vx**2 + guide.vy**2 + guide.vz**2)
    pace = 1.0
    if wanted > 1e-6:
        pace = _blurred_share(0.05 + (guide.along - law.pos_p * guide.lag) / wanted, at.SHAKE / wanted)
    guide.pace += law.pace_filter * (pace - guide.pace)
    dt = law.dt * guide.pace
    ends = end_time(heads[1], curves[1])
    now = min(heads[1, TIME] + dt, ends)
    heads[1, TIME] = now
    done = bool(now >= ends)
    follows = heads[2, TIME] > 0.0
    if guide.fast != 0.0 and not follows:
        follows = may_turn(heads, curves, law.wp_radius, law.corner)
    if follows:
        heads[2, TIME] = min(heads[2, TIME] + dt, end_time(heads[2], curves[2]))
        done = bool(done or heads[2, TIME] >= ends - now)
    last = end_time(heads[0], curves[0])
    if heads[0, TIME] < last:
        heads[0, TIME] = min(heads[0, TIME] + dt, last)
        if heads[0, TIME] >= last:
            heads[0, MADE] = 0.0
    x, y, z = guide.begin_x, guide.begin_y, guide.begin_z
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
    guide.px, guide.py, guide.pz = x, y, z
    guide.vx, guide.vy, guide.vz = vx, vy, vz
    guide.ax, guide.ay, guide.az = ax, ay, az
    return done


@compiled(allocates=False)
def _lead_chord(guide: Record, law: Record, route: Record, leg: int) -> bool:
    """Move the target along chords at half the acceleration limit; return whether the leg is over."""
    dt = law.dt
    gx, gy, gz = guide.end_x - guide.px, guide.end_y - guide.py, guide.end_z - guide.pz
    left = sqrt(gx**2 + gy**2 + gz**2)
    # The chords ahead within the braking distance limit the speed.
    accel = 0.5 * law.accel
    speed = guide.pace_arc
    top = route[leg].speed
    way, i = left, leg
    need = 0.5 * speed * speed / accel + 2.0 * dt * speed
    while way <= need:
        if i + 1 >= len(route) or route[i + 1].kind != at.ARC or route[i].pause > 0.0:
            top = min(top, sqrt(2.0 * accel * way))
            break
        slow = route[i + 1].speed
        top = min(top, sqrt(slow * slow + 2.0 * accel * way))
        step = (
            (route[i + 1].x - route[i].x) ** 2
            + (route[i + 1].y - route[i].y) ** 2
            + (route[i + 1].z - route[i].z) ** 2
        )
        way += sqrt(step)
        i += 1
    speed = min(max(top, speed - accel * dt), speed + accel * dt)
    guide.pace_arc = speed
    move = max(speed, 0.05) * dt
    done = bool(move >= left)
    share = 1.0 if done else move / left
    halt(guide)
    if left > 0.0:
        guide.vx, guide.vy, guide.vz = gx * speed / left, gy * speed / left, gz * speed / left
    guide.px += gx * share
    guide.py += gy * share
    guide.pz += gz * share
    return done


@compiled(inline="always")
def _move_level(guide: Record, dt: float) -> None:
    guide.px += dt * (guide.vx + 0.5 * dt * guide.ax)
    guide.vx += dt * guide.ax
    guide.py += dt * (guide.vy + 0.5 * dt * guide.ay)
    guide.vy += dt * guide.ay


@compiled(inline="always")
def _move_up(guide: Record, dt: float) -> None:
    guide.pz += dt * (guide.vz + 0.5 * dt * guide.az)
    guide.vz += dt * guide.az


@compiled(inline="always")
def _accelerate(guide: Record, ax: float, ay: float, most: float) -> None:
    """Change the horizontal acceleration towards `ax`, `ay` by at most `most`."""
    cx, cy = ax - guide.ax, ay - guide.ay
    change = sqrt(cx * cx + cy * cy)
    share = min(1.0, most / change) if change > 0.0 else 0.0
    guide.ax += cx * share
    guide.ay += cy * share


@compiled(allocates=False)
def _lead_up(guide: Record, law: Record) -> bool:
    """Move the target up to the take-off height; return whether the target is there and climbs slowly."""
    dt, limit, jerk = law.dt, law.accel_z, law.shape_jerk_z
    _move_up(guide, dt)
    gain = jerk / limit
    error = guide.end_z - guide.pz
    rate = rooted(error, gain, limit)
    if rate * guide.vz > 0.0:
        slope = gain if abs(error) <= limit / (gain * gain) else limit / abs(rate)
        rate -= slope * guide.vz / gain
    rate = min(max(rate, -guide.down), guide.up)
    wanted = min(max((rate - guide.vz) * gain, -limit), limit)
    guide.az += min(max(wanted - guide.az, -jerk * dt), jerk * dt)
    stops = 0.5 * (0.1 * guide.up) ** 2 / limit
    return bool(guide.pz >= guide.end_z - stops and guide.vz < 0.1 * guide.up)


@compiled(allocates=False)
def _lead_to(guide: Record, law: Record) -> bool:
    """Move the target to a guided setpoint's position; return whether the target has arrived.

    Source: `AC_PosControl::input_pos_NEU_m`. The target can always stop at the position with half of the
    acceleration and jerk limits. The velocity correction has a part along the wanted velocity and a part
    across it. If the correction is within 45 degrees of the wanted direction or of its opposite, the part
    along has precedence; otherwise the target brakes and turns at the same time.
    """
    dt, limit, jerk = law.dt, law.accel, law.shape_jerk
    _move_level(guide, dt)
    _move_up(guide, dt)
    dx, dy, dz = guide.end_x - guide.px, guide.end_y - guide.py, guide.end_z - guide.pz
    flat = sqrt(dx * dx + dy * dy)
    way = sqrt(flat * flat + dz * dz)
    most = guide.level * way / flat if flat > 0.0 else inf
    if dz != 0.0:
        most = min(most, (guide.up if dz > 0.0 else guide.down) * way / abs(dz))
    wx = wy = wz = ex = ey = 0.0
    if flat > 0.0:
        ex, ey = dx / flat, dy / flat
        rate = min(rooted(flat, 0.5 * jerk / limit, 0.5 * limit), flat / dt, most * flat / way)
        wx, wy = rate * ex, rate * ey
    cx, cy = wx - guide.vx, wy - guide.vy
    change = sqrt(cx * cx + cy * cy)
    if change > 0.0:
        size = min(rooted(change, jerk / limit, jerk), change / dt)
        cx, cy = cx * size / change, cy * size / change
        along, across = cx * ex + cy * ey, cy * ex - cx * ey
        if along * along > across * across:
            across = min(max(across, -at.SIDE * limit), at.SIDE * limit)
            room = sqrt(limit * limit - across * across)
            along = min(max(along, -room), room)
            cx, cy = along * ex - across * ey, along * ey + across * ex
        elif size > limit:
            cx, cy = cx * limit / size, cy * limit / size
    _accelerate(guide, cx, cy, jerk * dt)
    limit, jerk = law.accel_z, law.shape_jerk_z
    if dz != 0.0:
        top = min(most * abs(dz) / way, abs(dz) / dt)
        wz = min(max(rooted(dz, 0.5 * jerk / limit, 0.5 * limit), -top), top)
    guide.az = _shape(wz - guide.vz, guide.az, limit, jerk, dt)
    return bool(way < 0.05 and guide.vx**2 + guide.vy**2 < 0.0025)


@compiled(allocates=False)
def _lead_down(guide: Record, law: Record, height: float) -> None:
    """Move the target down, more slowly near the ground."""
    dt = law.dt
    _move_up(guide, dt)
    rate = rooted(law.land_low - height, law.pos_z_p, law.accel_z)
    fast = law.land_fast if law.land_fast > 0.0 else guide.down
    rate = min(max(rate, -max(fast, law.land_slow)), -law.land_slow)
    guide.az = _shape(rate - guide.vz, guide.az, law.accel_z, law.shape_jerk_z, dt)


@compiled(allocates=False)
def _lead_level(guide: Record, law: Record) -> None:
    """Reduce the target's horizontal velocity to zero during a climb or descent."""
    if guide.vx == 0.0 and guide.vy == 0.0 and guide.ax == 0.0 and guide.ay == 0.0:
        return
    dt, limit, jerk = law.dt, law.accel, law.shape_jerk
    _move_level(guide, dt)
    speed = sqrt(guide.vx**2 + guide.vy**2)
    if speed < 1e-3:
        guide.vx = guide.vy = guide.ax = guide.ay = 0.0
        return
    size = min(rooted(speed, jerk / limit, jerk), speed / dt, limit) / speed
    _accelerate(guide, -guide.vx * size, -guide.vy * size, jerk * dt)


@compiled(inline="late", allocates=False)
def lead(
    state: Record,
    guide: Record,
    law: Record,
    heads: Floats,
    curves: Floats,
    route: Record,
    leg: int,
    step: int,
) -> bool:
    """Move the target by one step; return whether the leg is complete."""
    mode = guide.mode
    if mode == at.LEGS:
        done = lead_legs(guide, law, heads, curves)
        if done and guide.fast == 0.0:
            gap = distance2(state, guide.end_x, guide.end_y, guide.end_z)
            done = gap <= law.wp_radius**2
    elif mode == at.CHORDS:
        done = guide.done != 0.0 or _lead_chord(guide, law, route, leg)
        if done:
            guide.done = 1.0
            if leg + 1 >= len(route) or route[leg + 1].kind != at.ARC:
                halt(guide)
                guide.pace_arc = 0.0
                gap = distance2(state, guide.end_x, guide.end_y, guide.end_z)
                done = gap <= law.wp_radius**2
    elif mode == at.CLIMBING:
        _lead_level(guide, law)
        done = _lead_up(guide, law)
        if done:
            guide.pz = guide.end_z
            halt(guide)
            guide.end_x, guide.end_y = guide.px, guide.py
    elif mode == at.LANDING:
        _lead_level(guide, law)
        _lead_down(guide, law, state.position_z)
        done = False
        if state.position_z <= 0.0:
            guide.mode = at.LANDED
            guide.until = step + law.detect_steps
            stand(state, guide)
    elif mode == at.GUIDED:
        done = _lead_to(guide, law)
    elif mode == at.HOLDING:
        if leg + 1 < len(route):
            return True
        gap = distance2(state, guide.px, guide.py, guide.pz)
        done = gap < 0.04 and state.velocity_x**2 + state.velocity_y**2 + state.velocity_z**2 < 0.01
    else:
        done = mode == at.LANDED and step >= guide.until
    return done
