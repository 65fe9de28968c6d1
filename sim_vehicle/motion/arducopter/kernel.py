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
from sim_vehicle.motion.arducopter.layout import CHAINED, CLIMBING, LANDED, LANDING, NOTHING
from sim_vehicle.motion.multirotor.kernel import SLOWEST, STALL_S
from sim_vehicle.motion.records import Record
from sim_vehicle.motion.rules import complete_leg, distance2, mark_track, wind_row
from sim_vehicle.weather.gust_kernel import wind_at

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@compiled(allocates=False)
def advance(
    states: Record,
    counters: Integers,
    route: Record,
    limits_of: Record,
    power: Floats,
    wind: Floats,
    first_wind: int,
    max_steps: int,
    stop_each: bool,
    arrivals: Integers,
    track: Floats,
    track_every: int,
    guides: Record,
    laws: Record,
    heads: Floats,
    curves: Floats,
) -> int:
    """Fly up to ``max_steps`` steps along the route; return early, with the event, when something happens.

    Parameters
    ----------
    states, counters : STATE[1], int64[COUNTERS]
        Those of `sim_vehicle.motion.multirotor.kernel`; changed in place.
    route : LEG[n]
        East, north, up, radius, speed, heading, near, kind, pause and rate of turning, as in
        `sim_vehicle.motion.legs.Route`; a speed of 0 keeps the one before.
    limits_of : LIMITS[1]
        Of the multirotor: only the energy that ends the flight is used.
    power, wind, first_wind, max_steps, stop_each, arrivals, track, track_every
        As in `sim_vehicle.motion.multirotor.kernel.advance`.
    guides : GUIDE[1]
        Changed in place, as are the next arrays.
    laws : LAW[1]
    heads, curves : float64[3, HEAD], float64[3, SEGMENTS, COLUMNS]
        The leg before, this one and the next: `sim_vehicle.motion.arducopter.scurve`.

    Returns
    -------
    int
        RAN, REACHED, WIND (the wind block is used up), STALLED (no progress), ENERGY or NEAR.
    """
    state, guide, law = states[0], guides[0], laws[0]
    # Read once: a look into the limits at every step costs a tenth of the speed.
    dt, capacity = law.dt, limits_of[0].energy_limit
    event = col.RAN
    rising = guide.rising
    for _ in range(max_steps):
        step, leg = counters[col.STEP], counters[col.LEG_INDEX]
        if guide.begins != NOTHING:
            begin(state, guide, law, heads, curves, route, leg, step)
            state.give_up_step = inf
        row = route[leg]
        if step % col.GRID == 0:
            index = wind_row(step, first_wind, len(wind))
            if index < 0:
                event = col.WIND
                break
            state.wind_east, state.wind_north, rising = wind_at(wind[index], state.position_z)
            ux, uy = (
                state.velocity_x - state.wind_east,
                state.velocity_y - state.wind_north,
            )
            grounded = guide.mode == LANDED or (guide.mode == CLIMBING and step < guide.until < inf)
            if grounded:
                state.power = law.stand_by
            else:
                climb = state.velocity_z - rising
                state.power = multirotor_power(
                    power,
                    ux,
                    uy,
                    climb,
                    state.acceleration_x,
                    state.acceleration_y,
                    state.acceleration_z,
                )
            mark_track(
                counters,
                step,
                track,
                track_every,
                state.position_x,
                state.position_y,
                state.position_z,
            )
            if counters[col.ARRIVED] == 0 and guide.done == 0.0 and not grounded and guide.mode != LANDING:
                if state.give_up_step == inf:
                    left = distance2(state, row.x, row.y, row.z)
                    slowest = min(guide.level, guide.up, guide.down, SLOWEST)
                    state.give_up_step = step + (STALL_S + 1.5 * sqrt(left) / slowest) / dt
                    counters[col.MOVED_STEP] = step
                if state.velocity_x**2 + state.velocity_y**2 + state.velocity_z**2 > 0.0025 * min(
                    guide.level**2, 1.0
                ):
                    counters[col.MOVED_STEP] = step
                if (step - counters[col.MOVED_STEP]) * dt > STALL_S or step > state.give_up_step:
                    event = col.STALLED
                    break
        waits = guide.mode == CLIMBING and step < guide.until < inf
        if waits or guide.mode == LANDED:
            stand(state, guide)
        else:
            command(state, guide, law)
            state.path_length += move(state, guide, law, rising)
        turn(state, guide, law, row.heading, row.turning)
        state.energy_used += state.power * dt
        step += 1
        counters[col.STEP] = step
        done = False
        if not waits:
            done = lead(state, guide, law, heads, curves, route, leg, step)
        if counters[col.ARRIVED] == 0:
            if done and row.pause > 0.0 and guide.done != 2.0:
                guide.done = 2.0
                guide.until = step + round(row.pause / dt)
            if guide.done == 2.0:
                done = step >= guide.until
            if done:
                event = complete_leg(counters, arrivals, step, stop_each)
                if counters[col.ARRIVED] == 0:
                    guide.begins = CHAINED
            elif counters[col.NEAR_TOLD] == 0 and row.distance > 0.0:
                left = distance2(state, row.x, row.y, row.z)
                if left < row.distance**2:
                    counters[col.NEAR_TOLD] = 1
                    event = col.NEAR
        if state.energy_used >= capacity:
            event = col.ENERGY
        if event != col.RAN:
            break
    guide.rising = rising
    return event
