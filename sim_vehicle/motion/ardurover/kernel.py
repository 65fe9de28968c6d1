"""The compiled drive of a ground vehicle under ArduPilot's Rover; all is SI, east-north about home.

Formulas after ArduPilot 4.7: `AR_WPNav.cpp` and Rover's `mode_auto.cpp`; the S-curves are those of
`sim_vehicle.motion.arducopter`.
"""

from __future__ import annotations

from math import atan2, inf, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.energy.power_kernels import rover_power
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.arducopter.guidance import lead_legs
from sim_vehicle.motion.arducopter.layout import (
    ACCEL,
    ACCEL_Z,
    ANEW,
    AX,
    BEGIN,
    BEGINS,
    CHAINED,
    DISTANCE,
    DONE,
    DT,
    END,
    FAST,
    HOLDING,
    HOME,
    JERK,
    KIND,
    LEAST_SPEED,
    LEAST_WAY,
    LEGS,
    LEVEL,
    MODE,
    NO_MODE,
    NOTHING,
    PACE,
    PAUSE,
    PX,
    RADIUS,
    RX,
    RZ,
    SAME,
    SNAP,
    SPEED,
    STAY,
    UNTIL,
    VX,
)
from sim_vehicle.motion.arducopter.scurve import (
    TIME,
    change_speed,
    clear_leg,
    copy_leg,
    end_time,
    make_leg,
)
from sim_vehicle.motion.ardurover.control import ask, centre, drive, look_along, steer
from sim_vehicle.motion.ardurover.layout import DECEL, NEAR, PIVOT_ANGLE, PIVOTS, PIVOTS_NEXT
from sim_vehicle.motion.rover.kernel import PATIENCE_S, SLOW_SHARE
from sim_vehicle.motion.rover.layout import ENERGY_LIMIT, STOPPED
from sim_vehicle.motion.rover.layout import SPEED as DRIVEN
from sim_vehicle.motion.rows import clear, copy
from sim_vehicle.motion.rules import complete_leg, mark_track, wind_row
from sim_vehicle.weather.gust_kernel import wind_at

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

AT_ONCE = -1
"""Kind of a leg that has no meaning on the ground."""


@compiled
def _make(i: int, a: Floats, b: Floats, guide: Floats, law: Floats, heads: Floats, curves: Floats) -> None:
    make_leg(
        heads[i],
        curves[i],
        (b[0] - a[0], b[1] - a[1], 0.0),
        (guide[LEVEL], guide[LEVEL], guide[LEVEL]),
        (law[ACCEL], law[ACCEL_Z]),
        law[SNAP],
        law[JERK],
    )


@compiled
def _stop_here(state: Floats, guide: Floats, law: Floats) -> None:
    """Begin anew from the position where the vehicle comes to rest."""
    ahead = 0.5 * abs(state[DRIVEN]) / law[DECEL]
    guide[PX] = state[col.POSITION_X] + ahead * state[col.VELOCITY_X]
    guide[PX + 1] = state[col.POSITION_Y] + ahead * state[col.VELOCITY_Y]
    guide[PX + 2] = 0.0
    clear(guide, VX, AX + 3)
    copy(guide, BEGIN, guide, PX, 3)
    copy(guide, END, guide, PX, 3)
    guide[PACE] = 1.0


@compiled
def _turns_by(x: float, y: float, from_x: float, from_y: float, bearing: float) -> float:
    """Return the angle between a bearing and that of a way; 0 for a way without length."""
    dx, dy = x - from_x, y - from_y
    if dx * dx + dy * dy < LEAST_WAY * LEAST_WAY:
        return 0.0
    return abs((atan2(dx, dy) - bearing + pi) % (2.0 * pi) - pi)


@compiled
def begin(
    state: Floats, guide: Floats, law: Floats, heads: Floats, curves: Floats, route: Floats, leg: int
) -> None:
    """Begin a leg; guide[BEGINS] tells how it follows from what was before."""
    how = guide[BEGINS]
    guide[BEGINS] = NOTHING
    guide[UNTIL], guide[DONE] = inf, 0.0
    row = route[leg]
    before = guide[MODE]
    if int(row[KIND]) in (AT_ONCE, STAY):
        guide[MODE] = HOLDING
        return
    speed = row[SPEED] if row[SPEED] >= LEAST_SPEED else guide[LEVEL]
    faster = speed != guide[LEVEL]
    guide[LEVEL] = speed
    if how == ANEW or before != LEGS:
        _stop_here(state, guide, law)
        before = NO_MODE
    guide[MODE] = LEGS
    if before == LEGS and faster:
        for i in range(1, 3):
            change_speed(heads[i], curves[i], speed, speed, speed)
    pivots = law[PIVOT_ANGLE] > 0.0
    if how != SAME:
        passed = before == LEGS and guide[FAST] != 0.0
        if before == LEGS:
            copy_leg(heads, curves, 0, 1)
        else:
            clear_leg(heads[0])
            guide[FAST] = 0.0
        copy(guide, BEGIN, guide, END, 3)
        copy(guide, END, row, RX, 3)
        if not passed:
            guide[PIVOTS] = 0.0
            turn = _turns_by(
                guide[END],
                guide[END + 1],
                state[col.POSITION_X],
                state[col.POSITION_Y],
                state[col.HEADING],
            )
            if pivots and (turn > law[PIVOT_ANGLE] or guide[PIVOTS_NEXT] != 0.0):
                guide[PIVOTS] = 1.0
        if guide[FAST] != 0.0 and heads[2, TIME] < end_time(heads[2], curves[2]):
            copy_leg(heads, curves, 1, 2)
        else:
            _make(1, guide[BEGIN : BEGIN + 3], guide[END : END + 3], guide, law, heads, curves)
        clear_leg(heads[2])
    elif guide[FAST] != 0.0 and heads[2, TIME] > 0.0:
        # The corner is being driven already.
        return
    guide[FAST] = guide[PIVOTS_NEXT] = 0.0
    if leg + 1 < len(route) and row[RADIUS] > 0.0 and row[PAUSE] <= 0.0:
        after = route[leg + 1]
        if 0.0 <= after[KIND] <= HOME:
            course = atan2(guide[END] - guide[BEGIN], guide[END + 1] - guide[BEGIN + 1])
            corner = _turns_by(after[RX], after[RX + 1], guide[END], guide[END + 1], course)
            if pivots and corner > law[PIVOT_ANGLE]:
                guide[PIVOTS_NEXT] = 1.0
                return
            guide[FAST] = 1.0
            _make(2, guide[END : END + 3], after[RX : RZ + 1], guide, law, heads, curves)


@compiled
def _lead(state: Floats, guide: Floats, law: Floats, heads: Floats, curves: Floats) -> bool:
    """Move the target for the next step; tell whether the leg is done."""
    if guide[PIVOTS] != 0.0:
        return False
    look_along(state, guide)
    done = lead_legs(guide, law, heads, curves)
    if done and guide[FAST] == 0.0:
        gx, gy = guide[END] - state[col.POSITION_X], guide[END + 1] - state[col.POSITION_Y]
        dx, dy = guide[END] - guide[BEGIN], guide[END + 1] - guide[BEGIN + 1]
        near = gx * gx + gy * gy <= law[NEAR] ** 2
        done = bool(near or gx * dx + gy * dy < 0.0)
    return done


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
    guide: Floats,
    law: Floats,
    heads: Floats,
    curves: Floats,
) -> int:
    """Drive up to ``max_steps`` steps along the route, as `sim_vehicle.motion.arducopter.kernel.advance`.

    Parameters
    ----------
    state, counters : float64[STATE], int64[COUNTERS]
        Those of `sim_vehicle.motion.rover.kernel`; changed in place.
    route : float64[n, LEG]
        As for ArduCopter.
    limits : float64[LIMITS]
        Of the rover: only the energy that ends the drive is used.
    guide, law : float64[GUIDE], float64[LAW]
        See `sim_vehicle.motion.ardurover.layout`.
    """
    dt, capacity = law[DT], limits[ENERGY_LIMIT]
    event = col.RAN
    for _ in range(max_steps):
        step, leg = counters[col.STEP], counters[col.LEG_INDEX]
        if guide[BEGINS] != NOTHING:
            begin(state, guide, law, heads, curves, route, leg)
            state[col.GIVE_UP_STEP] = inf
        row = route[leg]
        if state[col.GIVE_UP_STEP] == inf:
            left = sqrt((row[RX] - state[col.POSITION_X]) ** 2 + (row[RX + 1] - state[col.POSITION_Y]) ** 2)
            slowest = SLOW_SHARE * max(guide[LEVEL], LEAST_SPEED)
            state[col.GIVE_UP_STEP] = step + (PATIENCE_S + row[PAUSE] + left / slowest) / dt
        if step % col.GRID == 0:
            index = wind_row(step, first_wind, len(wind))
            if index < 0:
                event = col.WIND
                break
            state[col.WIND_EAST], state[col.WIND_NORTH], _ = wind_at(wind[index], 0.0)
            speed = abs(state[DRIVEN])
            ux, uy = (
                state[col.VELOCITY_X] / speed if speed > 0.0 else 0.0,
                state[col.VELOCITY_Y] / speed if speed > 0.0 else 0.0,
            )
            head = speed - state[col.WIND_EAST] * ux - state[col.WIND_NORTH] * uy
            pull = state[col.ACCELERATION_X] * ux + state[col.ACCELERATION_Y] * uy
            state[col.POWER] = rover_power(power, speed, head, pull)
            mark_track(counters, step, track, track_every, state[col.POSITION_X], state[col.POSITION_Y], 0.0)
            if counters[col.ARRIVED] == 0 and step > state[col.GIVE_UP_STEP]:
                event = col.STALLED
                break
        stops = guide[MODE] == HOLDING or counters[col.ARRIVED] != 0
        if stops:
            centre(state, guide, law)
        else:
            steer(state, guide, law, ask(state, guide, law, step))
        drive(state, guide, law)
        state[col.ENERGY_USED] += state[col.POWER] * dt
        step += 1
        counters[col.STEP] = step
        if counters[col.ARRIVED] == 0:
            if stops:
                done = row[KIND] == AT_ONCE or leg + 1 < len(route) or bool(abs(state[DRIVEN]) < STOPPED)
            else:
                done = _lead(state, guide, law, heads, curves)
            if done and row[PAUSE] > 0.0 and guide[DONE] == 0.0:
                guide[DONE] = 1.0
                guide[UNTIL] = step + round(row[PAUSE] / dt)
            if guide[DONE] != 0.0:
                done = step >= guide[UNTIL]
            if done:
                event = complete_leg(counters, arrivals, step, stop_each)
                if counters[col.ARRIVED] == 0:
                    guide[BEGINS] = CHAINED
            elif counters[col.NEAR_TOLD] == 0 and row[DISTANCE] > 0.0:
                rx, ry = row[RX] - state[col.POSITION_X], row[RX + 1] - state[col.POSITION_Y]
                if rx * rx + ry * ry < row[DISTANCE] ** 2:
                    counters[col.NEAR_TOLD] = 1
                    event = col.NEAR
        if state[col.ENERGY_USED] >= capacity:
            event = col.ENERGY
        if event != col.RAN:
            break
    return event
