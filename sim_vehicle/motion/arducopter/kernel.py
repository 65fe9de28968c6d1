"""The compiled flight of a multirotor under ArduCopter; all is SI, east-north-up about home."""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.energy.power_kernels import multirotor_power
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.arducopter.control import command, move, stand, turn
from sim_vehicle.motion.arducopter.guidance import begin, lead
from sim_vehicle.motion.arducopter.layout import (
    BEGINS,
    CHAINED,
    CLIMBING,
    DISTANCE,
    DONE,
    DOWN,
    DT,
    HEADING,
    LANDED,
    LANDING,
    LEVEL,
    MODE,
    NOTHING,
    PAUSE,
    RISING,
    STAND_BY,
    TURNING,
    UNTIL,
    UP,
)
from sim_vehicle.motion.multirotor.kernel import ENERGY_LIMIT, SLOWEST, STALL_S
from sim_vehicle.motion.rules import complete_leg, mark_track, wind_row
from sim_vehicle.weather.gust_kernel import wind_at

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@compiled(allocates=False)
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
    """Fly up to ``max_steps`` steps along the route; return early, with the event, when something happens.

    Parameters
    ----------
    state, counters : float64[STATE], int64[COUNTERS]
        Those of `sim_vehicle.motion.multirotor.kernel`; changed in place.
    route : float64[n, LEG]
        East, north, up, radius, speed, heading, near, kind, pause and rate of turning, as in
        `sim_vehicle.motion.legs.Route`; a speed of 0 keeps the one before.
    limits : float64[LIMITS]
        Of the multirotor: only the energy that ends the flight is used.
    power, wind, first_wind, max_steps, stop_each, arrivals, track, track_every
        As in `sim_vehicle.motion.multirotor.kernel.advance`.
    guide : float64[GUIDE]
        Changed in place, as are the next arrays.
    law : float64[LAW]
    heads, curves : float64[3, HEAD], float64[3, SEGMENTS, COLUMNS]
        The leg before, this one and the next: `sim_vehicle.motion.arducopter.scurve`.

    Returns
    -------
    int
        RAN, REACHED, WIND (the wind block is used up), STALLED (no progress), ENERGY or NEAR.
    """
    # Read once: a look into the limits at every step costs a tenth of the speed.
    dt, capacity = law[DT], limits[ENERGY_LIMIT]
    event = col.RAN
    rising = guide[RISING]
    for _ in range(max_steps):
        step, leg = counters[col.STEP], counters[col.LEG_INDEX]
        if guide[BEGINS] != NOTHING:
            begin(state, guide, law, heads, curves, route, leg, step)
            state[col.GIVE_UP_STEP] = inf
        row = route[leg]
        if step % col.GRID == 0:
            index = wind_row(step, first_wind, len(wind))
            if index < 0:
                event = col.WIND
                break
            state[col.WIND_EAST], state[col.WIND_NORTH], rising = wind_at(wind[index], state[col.POSITION_Z])
            ux, uy = (
                state[col.VELOCITY_X] - state[col.WIND_EAST],
                state[col.VELOCITY_Y] - state[col.WIND_NORTH],
            )
            grounded = guide[MODE] == LANDED or (guide[MODE] == CLIMBING and step < guide[UNTIL] < inf)
            if grounded:
                state[col.POWER] = law[STAND_BY]
            else:
                climb = state[col.VELOCITY_Z] - rising
                state[col.POWER] = multirotor_power(
                    power,
                    ux,
                    uy,
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
            if counters[col.ARRIVED] == 0 and guide[DONE] == 0.0 and not grounded and guide[MODE] != LANDING:
                if state[col.GIVE_UP_STEP] == inf:
                    left = 0.0
                    for k in range(3):
                        left += (row[k] - state[k]) ** 2
                    slowest = min(guide[LEVEL], guide[UP], guide[DOWN], SLOWEST)
                    state[col.GIVE_UP_STEP] = step + (STALL_S + 1.5 * sqrt(left) / slowest) / dt
                    counters[col.MOVED_STEP] = step
                if state[col.VELOCITY_X] ** 2 + state[col.VELOCITY_Y] ** 2 + state[
                    col.VELOCITY_Z
                ] ** 2 > 0.0025 * min(guide[LEVEL] ** 2, 1.0):
                    counters[col.MOVED_STEP] = step
                if (step - counters[col.MOVED_STEP]) * dt > STALL_S or step > state[col.GIVE_UP_STEP]:
                    event = col.STALLED
                    break
        waits = guide[MODE] == CLIMBING and step < guide[UNTIL] < inf
        if waits or guide[MODE] == LANDED:
            stand(state, guide)
        else:
            command(state, guide, law)
            state[col.PATH_LENGTH] += move(state, guide, law, rising)
        turn(state, guide, law, row[HEADING], row[TURNING])
        state[col.ENERGY_USED] += state[col.POWER] * dt
        step += 1
        counters[col.STEP] = step
        done = False
        if not waits:
            done = lead(state, guide, law, heads, curves, route, leg, step)
        if counters[col.ARRIVED] == 0:
            if done and row[PAUSE] > 0.0 and guide[DONE] != 2.0:
                guide[DONE] = 2.0
                guide[UNTIL] = step + round(row[PAUSE] / dt)
            if guide[DONE] == 2.0:
                done = step >= guide[UNTIL]
            if done:
                event = complete_leg(counters, arrivals, step, stop_each)
                if counters[col.ARRIVED] == 0:
                    guide[BEGINS] = CHAINED
            elif counters[col.NEAR_TOLD] == 0 and row[DISTANCE] > 0.0:
                left = 0.0
                for k in range(3):
                    left += (row[k] - state[k]) ** 2
                if left < row[DISTANCE] ** 2:
                    counters[col.NEAR_TOLD] = 1
                    event = col.NEAR
        if state[col.ENERGY_USED] >= capacity:
            event = col.ENERGY
        if event != col.RAN:
            break
    guide[RISING] = rising
    return event
