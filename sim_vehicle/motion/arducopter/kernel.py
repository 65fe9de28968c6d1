"""Compiled kernel of a multirotor under ArduCopter; SI units, east-north-up relative to the start.

Besides the common arguments, a step has guides GUIDE[1], laws LAW[1], heads float64[3, HEAD] and curves
float64[3, SEGMENTS, COLUMNS] of the previous, present and next leg (see
`sim_vehicle.motion.arducopter.scurve`). The kernel uses only the time step and the energy limit of the
multirotor's limits. The route is LEG[n]; a speed of 0 keeps the previous speed.
"""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.arducopter import control as at
from sim_vehicle.motion.arducopter.control import command, move, stand, turn
from sim_vehicle.motion.arducopter.guidance import begin, lead
from sim_vehicle.motion.columns import Record
from sim_vehicle.motion.multirotor.kernel import SLOWEST, STALL_S, Vector
from sim_vehicle.motion.stepping import distance2, kernel_of, multirotor_power

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Own = tuple[Record, Record, Floats, Floats]


@compiled(inline="always")
def _enter(state: Record, counters: Integers, route: Record, limits: Record, own: Own) -> None:
    guide = own[0][0]
    if guide.begins != at.NOTHING:
        begin(state, guide, own[1][0], own[2], own[3], route, counters[col.LEG_INDEX], counters[col.STEP])
        state.give_up_step = inf


@compiled(inline="always")
def _feel(
    state: Record, counters: Integers, row: Record, air: Vector, limits: Record, power: Floats, own: Own
) -> bool:
    guide, law, step = own[0][0], own[1][0], counters[col.STEP]
    state.wind_east, state.wind_north, guide.rising = air
    grounded = guide.mode == at.LANDED or (guide.mode == at.CLIMBING and step < guide.until < inf)
    if grounded:
        state.power = law.stand_by
    else:
        ux, uy = state.velocity_x - state.wind_east, state.velocity_y - state.wind_north
        climb = state.velocity_z - guide.rising
        state.power = multirotor_power(
            power, ux, uy, climb, state.acceleration_x, state.acceleration_y, state.acceleration_z
        )
    if counters[col.ARRIVED] != 0 or guide.done != 0.0 or grounded or guide.mode == at.LANDING:
        return False
    if state.give_up_step == inf:
        left = distance2(state, row.x, row.y, row.z)
        slowest = min(guide.level, guide.up, guide.down, SLOWEST)
        state.give_up_step = step + (STALL_S + 1.5 * sqrt(left) / slowest) / law.dt
        counters[col.MOVED_STEP] = step
    speed2 = state.velocity_x**2 + state.velocity_y**2 + state.velocity_z**2
    if speed2 > 0.0025 * min(guide.level**2, 1.0):
        counters[col.MOVED_STEP] = step
    return bool((step - counters[col.MOVED_STEP]) * law.dt > STALL_S or step > state.give_up_step)


@compiled(inline="always")
def _move(state: Record, counters: Integers, route: Record, limits: Record, own: Own) -> bool:
    guide, law, heads, curves = own[0][0], own[1][0], own[2], own[3]
    step, leg = counters[col.STEP], counters[col.LEG_INDEX]
    row = route[leg]
    waits = guide.mode == at.CLIMBING and step < guide.until < inf
    if waits or guide.mode == at.LANDED:
        stand(state, guide)
    else:
        command(state, guide, law)
        state.path_length += move(state, guide, law, guide.rising)
    turn(state, guide, law, row.heading, row.turning)
    step += 1
    done = False
    if not waits:
        done = lead(state, guide, law, heads, curves, route, leg, step)
    if counters[col.ARRIVED] == 0:
        if done and row.pause > 0.0 and guide.done != 2.0:
            guide.done = 2.0
            guide.until = step + round(row.pause / law.dt)
        if guide.done == 2.0:
            done = step >= guide.until
    return done


@compiled(inline="always")
def chain(state: Record, counters: Integers, row: Record, route: Record, limits: Record, own: Own) -> None:
    """Mark the next leg as a continuation of the completed leg."""
    if counters[col.ARRIVED] == 0:
        own[0][0].begins = at.CHAINED


advance = kernel_of(__name__, _enter, _feel, _move, chain)
