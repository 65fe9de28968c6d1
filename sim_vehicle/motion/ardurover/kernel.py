"""The compiled drive of a ground vehicle under ArduPilot's Rover; all is SI, east-north about home.

Formulas after ArduPilot 4.7: `AR_WPNav.cpp` and Rover's `mode_auto.cpp`; the S-curves are those of
`sim_vehicle.motion.arducopter`.
"""

from __future__ import annotations

from enum import IntEnum
from math import atan2, inf, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.energy.power_kernels import rover_power
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.arducopter.control import halt
from sim_vehicle.motion.arducopter.guidance import begin_of, end_of, lead_legs
from sim_vehicle.motion.arducopter.kernel import Own, chain
from sim_vehicle.motion.arducopter.layout import (
    ANEW,
    HOLDING,
    HOME,
    LEAST_SPEED,
    LEAST_WAY,
    LEGS,
    NO_MODE,
    NOTHING,
    SAME,
    STAY,
    Guide,
    Law,
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
from sim_vehicle.motion.columns import Record, record_type
from sim_vehicle.motion.multirotor.kernel import Vector
from sim_vehicle.motion.rover.kernel import PATIENCE_S, SLOW_SHARE
from sim_vehicle.motion.rover.layout import STOPPED
from sim_vehicle.motion.stepping import kernel_of

Drive = IntEnum(
    "Drive",
    "SPEED_ASKED TURN_ASKED "  # Desired speed and rate of turning after their limits.
    "STEER_ERROR STEER_I DRIVE_ERROR DRIVE_I "  # Filtered errors and integrators.
    "PIVOTS "  # Whether it turns on the spot; 2: it has turned and pauses.
    "PIVOTS_NEXT "  # Whether it will at the next waypoint.
    "STANDS",  # Whether it was told to stop and has.
    start=len(Guide),
)
DriveGains = IntEnum(
    "DriveGains",
    "NEAR "  # A stop is reached within it.
    "SPEED_ACCEL DECEL "  # Accelerations of the speed that is asked for.
    "LATERAL "  # Greatest lateral acceleration.
    "TURN_SPEED "  # Speed that it keeps in turns, unless it slows down.
    "STEER_ACCEL STEER_RATE STEER_FF STEER_P STEER_I_GAIN STEER_IMAX STEER_FILTER "
    "SCALE_BASE "  # Speed above which the steering is scaled down.
    "TIGHTEST "  # Radius at full steering; 0: it steers by its tracks.
    "STEER_LAG "  # Share of the lag of tracks in a step.
    "ANGLE_P "
    "PIVOT_ANGLE "  # 0: never.
    "PIVOT_RATE PIVOT_DELAY "
    "DRIVE_BASE "  # Throttle over speed.
    "DRIVE_P DRIVE_I_GAIN DRIVE_IMAX DRIVE_FILTER STOP_SPEED "
    "TOP_SPEED "  # At full throttle.
    "DRIVE_LAG",  # Share of the drive's lag in a step.
    start=len(Law),
)
GUIDE, LAW = record_type(Guide, Drive), record_type(Law, DriveGains)


Floats = NDArray[np.float64]
Position = tuple[float, float, float]
Integers = NDArray[np.int64]

AT_ONCE = -1
"""Kind of a leg that has no meaning on the ground."""


@compiled(allocates=False)
def _make(
    i: int, a: Position, b: Position, guide: Record, law: Record, heads: Floats, curves: Floats
) -> None:
    make_leg(
        heads[i],
        curves[i],
        (b[0] - a[0], b[1] - a[1], 0.0),
        (guide.level, guide.level, guide.level),
        (law.accel, law.accel_z),
        law.snap,
        law.jerk,
    )


@compiled(allocates=False)
def _stop_here(state: Record, guide: Record, law: Record) -> None:
    """Begin anew from the position where the vehicle comes to rest."""
    ahead = 0.5 * abs(state.speed) / law.decel
    guide.px = state.position_x + ahead * state.velocity_x
    guide.py = state.position_y + ahead * state.velocity_y
    guide.pz = 0.0
    halt(guide)
    guide.begin_x, guide.begin_y, guide.begin_z = guide.px, guide.py, guide.pz
    guide.end_x, guide.end_y, guide.end_z = guide.px, guide.py, guide.pz
    guide.pace = 1.0


@compiled(allocates=False)
def _turns_by(x: float, y: float, from_x: float, from_y: float, bearing: float) -> float:
    """Return the angle between a bearing and that of a way; 0 for a way without length."""
    dx, dy = x - from_x, y - from_y
    if dx * dx + dy * dy < LEAST_WAY * LEAST_WAY:
        return 0.0
    return abs((atan2(dx, dy) - bearing + pi) % (2.0 * pi) - pi)


@compiled(allocates=False)
def begin(
    state: Record, guide: Record, law: Record, heads: Floats, curves: Floats, route: Record, leg: int
) -> None:
    """Begin a leg; guide.begins tells how it follows from what was before."""
    how = guide.begins
    guide.begins = NOTHING
    guide.until, guide.done = inf, 0.0
    row = route[leg]
    before = guide.mode
    if int(row.kind) in (AT_ONCE, STAY):
        guide.mode = HOLDING
        return
    speed = row.speed if row.speed >= LEAST_SPEED else guide.level
    faster = speed != guide.level
    guide.level = speed
    if how == ANEW or before != LEGS:
        _stop_here(state, guide, law)
        before = NO_MODE
    guide.mode = LEGS
    if before == LEGS and faster:
        for i in range(1, 3):
            change_speed(heads[i], curves[i], speed, speed, speed)
    pivots = law.pivot_angle > 0.0
    if how != SAME:
        passed = before == LEGS and guide.fast != 0.0
        if before == LEGS:
            copy_leg(heads, curves, 0, 1)
        else:
            clear_leg(heads[0])
            guide.fast = 0.0
        guide.begin_x, guide.begin_y, guide.begin_z = guide.end_x, guide.end_y, guide.end_z
        guide.end_x, guide.end_y, guide.end_z = row.x, row.y, row.z
        if not passed:
            guide.pivots = 0.0
            turn = _turns_by(
                guide.end_x,
                guide.end_y,
                state.position_x,
                state.position_y,
                state.heading,
            )
            if pivots and (turn > law.pivot_angle or guide.pivots_next != 0.0):
                guide.pivots = 1.0
        if guide.fast != 0.0 and heads[2, TIME] < end_time(heads[2], curves[2]):
            copy_leg(heads, curves, 1, 2)
        else:
            _make(1, begin_of(guide), end_of(guide), guide, law, heads, curves)
        clear_leg(heads[2])
    elif guide.fast != 0.0 and heads[2, TIME] > 0.0:
        # The corner is being driven already.
        return
    guide.fast = guide.pivots_next = 0.0
    if leg + 1 < len(route) and row.radius > 0.0 and row.pause <= 0.0:
        after = route[leg + 1]
        if 0.0 <= after.kind <= HOME:
            course = atan2(guide.end_x - guide.begin_x, guide.end_y - guide.begin_y)
            corner = _turns_by(after.x, after.y, guide.end_x, guide.end_y, course)
            if pivots and corner > law.pivot_angle:
                guide.pivots_next = 1.0
                return
            guide.fast = 1.0
            _make(2, end_of(guide), (after.x, after.y, after.z), guide, law, heads, curves)


@compiled(allocates=False)
def _lead(state: Record, guide: Record, law: Record, heads: Floats, curves: Floats) -> bool:
    """Move the target for the next step; tell whether the leg is done."""
    if guide.pivots != 0.0:
        return False
    look_along(state, guide)
    done = lead_legs(guide, law, heads, curves)
    if done and guide.fast == 0.0:
        gx, gy = guide.end_x - state.position_x, guide.end_y - state.position_y
        dx, dy = guide.end_x - guide.begin_x, guide.end_y - guide.begin_y
        near = gx * gx + gy * gy <= law.near**2
        done = bool(near or gx * dx + gy * dy < 0.0)
    return done


@compiled(inline="always")
def _enter(state: Record, counters: Integers, route: Record, limits: Record, own: Own) -> None:
    guide, law, leg = own[0][0], own[1][0], counters[col.LEG_INDEX]
    if guide.begins != NOTHING:
        begin(state, guide, law, own[2], own[3], route, leg)
        state.give_up_step = inf
    if state.give_up_step == inf:
        row = route[leg]
        left = sqrt((row.x - state.position_x) ** 2 + (row.y - state.position_y) ** 2)
        slowest = SLOW_SHARE * max(guide.level, LEAST_SPEED)
        state.give_up_step = counters[col.STEP] + (PATIENCE_S + row.pause + left / slowest) / law.dt


@compiled(inline="always")
def _feel(
    state: Record, counters: Integers, row: Record, air: Vector, limits: Record, power: Floats, own: Own
) -> bool:
    state.wind_east, state.wind_north = air[0], air[1]
    speed, ux, uy = abs(state.speed), 0.0, 0.0
    if speed > 0.0:
        ux, uy = state.velocity_x / speed, state.velocity_y / speed
    head = speed - state.wind_east * ux - state.wind_north * uy
    pull = state.acceleration_x * ux + state.acceleration_y * uy
    state.power = rover_power(power, speed, head, pull)
    return bool(counters[col.ARRIVED] == 0 and counters[col.STEP] > state.give_up_step)


@compiled(inline="always")
def _move(state: Record, counters: Integers, route: Record, limits: Record, own: Own) -> bool:
    guide, law = own[0][0], own[1][0]
    step, leg = counters[col.STEP], counters[col.LEG_INDEX]
    row = route[leg]
    stops = guide.mode == HOLDING or counters[col.ARRIVED] != 0
    if stops:
        centre(state, guide, law)
    else:
        steer(state, guide, law, ask(state, guide, law, step))
    drive(state, guide, law)
    step += 1
    if counters[col.ARRIVED] != 0:
        return False
    if stops:
        done = row.kind == AT_ONCE or leg + 1 < len(route) or bool(abs(state.speed) < STOPPED)
    else:
        done = _lead(state, guide, law, own[2], own[3])
    if done and row.pause > 0.0 and guide.done == 0.0:
        guide.done = 1.0
        guide.until = step + round(row.pause / law.dt)
    if guide.done != 0.0:
        done = step >= guide.until
    return done


advance = kernel_of(__name__, _enter, _feel, _move, chain)
