"""The compiled flight of a multirotor under ArduCopter; all is SI, east-north-up about home."""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.energy.power_kernels import multirotor_power
from sim_vehicle.motion.arducopter.control import command, move, stand, turn
from sim_vehicle.motion.arducopter.guidance import begin, lead
from sim_vehicle.motion.arducopter.layout import (
    BEGINS,
    CAPACITY,
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
from sim_vehicle.motion.columns import ENERGY, GRID, NEAR, POSITION, RAN, REACHED, STALLED, WIND
from sim_vehicle.motion.multirotor.kernel import SLOWEST, STALL_S
from sim_vehicle.motion.rows import copy
from sim_vehicle.weather.gust_kernel import wind_at

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@compiled
def advance(
    state: Floats,
    counters: Integers,
    guide: Floats,
    law: Floats,
    heads: Floats,
    curves: Floats,
    route: Floats,
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
        Those of `sim_vehicle.motion.multirotor.kernel`; changed in place, as are the next arrays.
    guide : float64[GUIDE]
    law : float64[LAW]
    heads, curves : float64[3, HEAD], float64[3, SEGMENTS, COLUMNS]
        The leg before, this one and the next: `sim_vehicle.motion.arducopter.scurve`.
    route : float64[n, LEG]
        East, north, up, radius, speed, heading, near, kind, pause and rate of turning, as in
        `sim_vehicle.motion.legs.Route`; a speed of 0 keeps the one before.
    power, wind, first_wind, max_steps, stop_each, arrivals, track, track_every
        As in `sim_vehicle.motion.multirotor.kernel.advance`.

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
            begin(state, guide, law, heads, curves, route, leg, step)
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
                copy(track[counters[5]], 0, state, POSITION, 3)
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
            stand(state, guide)
        else:
            command(state, guide, law)
            state[12] += move(state, guide, law, rising)
        turn(state, guide, law, row[HEADING], row[TURNING])
        state[11] += state[13] * dt
        step += 1
        counters[0] = step
        done = False
        if not waits:
            done = lead(state, guide, law, heads, curves, route, leg, step)
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
