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
from sim_vehicle.motion.columns import (
    ACCELERATION_X,
    ACCELERATION_Y,
    ACCELERATION_Z,
    ARRIVED,
    ENERGY,
    ENERGY_USED,
    GIVE_UP_STEP,
    GRID,
    LEG_INDEX,
    MOVED_STEP,
    NEAR,
    NEAR_TOLD,
    PATH_LENGTH,
    POSITION,
    POSITION_Z,
    POWER,
    RAN,
    REACHED,
    STALLED,
    STEP,
    TRACK_POINTS,
    VELOCITY_X,
    VELOCITY_Y,
    VELOCITY_Z,
    WIND,
    WIND_EAST,
    WIND_NORTH,
)
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
        step, leg = counters[STEP], counters[LEG_INDEX]
        if guide[BEGINS] != NOTHING:
            begin(state, guide, law, heads, curves, route, leg, step)
            state[GIVE_UP_STEP] = inf
        row = route[leg]
        if step % GRID == 0:
            index = 0
            if wind.shape[0] > 1:
                index = step // GRID - first_wind
                if index >= wind.shape[0]:
                    event = WIND
                    break
            state[WIND_EAST], state[WIND_NORTH], rising = wind_at(wind[index], state[POSITION_Z])
            ux, uy = state[VELOCITY_X] - state[WIND_EAST], state[VELOCITY_Y] - state[WIND_NORTH]
            grounded = guide[MODE] == LANDED or (guide[MODE] == CLIMBING and step < guide[UNTIL] < inf)
            if grounded:
                state[POWER] = law[STAND_BY]
            else:
                climb = state[VELOCITY_Z] - rising
                state[POWER] = multirotor_power(
                    power, ux, uy, climb, state[ACCELERATION_X], state[ACCELERATION_Y], state[ACCELERATION_Z]
                )
            if (
                track_every > 0
                and (step // GRID) % track_every == 0
                and counters[TRACK_POINTS] < track.shape[0]
            ):
                copy(track[counters[TRACK_POINTS]], 0, state, POSITION, 3)
                counters[TRACK_POINTS] += 1
            if counters[ARRIVED] == 0 and guide[DONE] == 0.0 and not grounded and guide[MODE] != LANDING:
                if state[GIVE_UP_STEP] == inf:
                    left = 0.0
                    for k in range(3):
                        left += (row[k] - state[k]) ** 2
                    slowest = min(guide[LEVEL], guide[UP], guide[DOWN], SLOWEST)
                    state[GIVE_UP_STEP] = step + (STALL_S + 1.5 * sqrt(left) / slowest) / dt
                    counters[MOVED_STEP] = step
                if state[VELOCITY_X] ** 2 + state[VELOCITY_Y] ** 2 + state[VELOCITY_Z] ** 2 > 0.0025 * min(
                    guide[LEVEL] ** 2, 1.0
                ):
                    counters[MOVED_STEP] = step
                if (step - counters[MOVED_STEP]) * dt > STALL_S or step > state[GIVE_UP_STEP]:
                    event = STALLED
                    break
        waits = guide[MODE] == CLIMBING and step < guide[UNTIL] < inf
        if waits or guide[MODE] == LANDED:
            stand(state, guide)
        else:
            command(state, guide, law)
            state[PATH_LENGTH] += move(state, guide, law, rising)
        turn(state, guide, law, row[HEADING], row[TURNING])
        state[ENERGY_USED] += state[POWER] * dt
        step += 1
        counters[STEP] = step
        done = False
        if not waits:
            done = lead(state, guide, law, heads, curves, route, leg, step)
        if counters[ARRIVED] == 0:
            if done and row[PAUSE] > 0.0 and guide[DONE] != 2.0:
                guide[DONE] = 2.0
                guide[UNTIL] = step + round(row[PAUSE] / dt)
            if guide[DONE] == 2.0:
                done = step >= guide[UNTIL]
            if done:
                arrivals[leg] = step
                counters[NEAR_TOLD] = 0
                if leg == last:
                    counters[ARRIVED] = 1
                    event = REACHED
                else:
                    counters[LEG_INDEX] = leg + 1
                    guide[BEGINS] = CHAINED
                    if stop_each:
                        event = REACHED
            elif counters[NEAR_TOLD] == 0 and row[DISTANCE] > 0.0:
                left = 0.0
                for k in range(3):
                    left += (row[k] - state[k]) ** 2
                if left < row[DISTANCE] ** 2:
                    counters[NEAR_TOLD] = 1
                    event = NEAR
        if state[ENERGY_USED] >= law[CAPACITY]:
            event = ENERGY
        if event != RAN:
            break
    guide[RISING] = rising
    return event
