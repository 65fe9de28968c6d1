"""The compiled loops over many vehicles, one for each kernel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.motion.arducopter import kernel as arducopter_kernel
from sim_vehicle.motion.fixed_wing import kernel as fixed_wing_kernel
from sim_vehicle.motion.multirotor import kernel
from sim_vehicle.motion.multirotor.kernel import ENERGY_LIMIT
from sim_vehicle.motion.px4 import kernel as px4_kernel
from sim_vehicle.motion.rover import kernel as rover_kernel

__all__ = ["CALL", "EVENT", "EVERY", "FIRST", "LOOPS", "STEPS", "STOPS", "WIND_ROWS"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# What a vehicle's kernel is called with: steps, whether to stop at each leg, steps between points of the
# track, rows of the wind and the first of them; and the event that it returned.
STEPS, STOPS, EVERY, WIND_ROWS, FIRST, EVENT = range(6)
CALL = 6

_fly = kernel.advance
_fly_px4 = px4_kernel.advance
_fly_arducopter = arducopter_kernel.advance
_fly_wing = fixed_wing_kernel.advance
_drive = rover_kernel.advance


# All loops go over ``members``, indices of vehicles, and have: call int64[B, CALL], routes and arrivals one
# after the other from ``offsets`` on, wind[B, n, 9], and the rows of the vehicles; then what their kernel has
# besides.


@compiled(nogil=True)
def _generic(
    members: Integers,
    call: Integers,
    offsets: Integers,
    routes: Floats,
    arrivals: Integers,
    wind: Floats,
    state: Floats,
    counters: Integers,
    limits: Floats,
    power: Floats,
    track: Floats,
) -> None:
    for k in members:
        begin, end = offsets[k], offsets[k + 1]
        call[k, EVENT] = _fly(
            state[k],
            counters[k],
            routes[begin:end],
            limits[k],
            power[k],
            wind[k, : call[k, WIND_ROWS]],
            call[k, FIRST],
            call[k, STEPS],
            call[k, STOPS] != 0,
            arrivals[begin:end],
            track[k],
            call[k, EVERY],
        )


@compiled(nogil=True)
def _px4(
    members: Integers,
    call: Integers,
    offsets: Integers,
    routes: Floats,
    arrivals: Integers,
    wind: Floats,
    state: Floats,
    counters: Integers,
    limits: Floats,
    power: Floats,
    track: Floats,
    guide: Floats,
    law: Floats,
) -> None:
    for k in members:
        begin, end = offsets[k], offsets[k + 1]
        call[k, EVENT] = _fly_px4(
            state[k],
            counters[k],
            guide[k],
            routes[begin:end],
            law[k],
            limits[k, ENERGY_LIMIT],
            power[k],
            wind[k, : call[k, WIND_ROWS]],
            call[k, FIRST],
            call[k, STEPS],
            call[k, STOPS] != 0,
            arrivals[begin:end],
            track[k],
            call[k, EVERY],
        )


@compiled(nogil=True)
def _arducopter(
    members: Integers,
    call: Integers,
    offsets: Integers,
    routes: Floats,
    arrivals: Integers,
    wind: Floats,
    state: Floats,
    counters: Integers,
    limits: Floats,  # noqa: ARG001
    power: Floats,
    track: Floats,
    guide: Floats,
    law: Floats,
    heads: Floats,
    curves: Floats,
) -> None:
    for k in members:
        begin, end = offsets[k], offsets[k + 1]
        call[k, EVENT] = _fly_arducopter(
            state[k],
            counters[k],
            guide[k],
            law[k],
            heads[k],
            curves[k],
            routes[begin:end],
            power[k],
            wind[k, : call[k, WIND_ROWS]],
            call[k, FIRST],
            call[k, STEPS],
            call[k, STOPS] != 0,
            arrivals[begin:end],
            track[k],
            call[k, EVERY],
        )


@compiled(nogil=True)
def _fixed_wing(
    members: Integers,
    call: Integers,
    offsets: Integers,
    routes: Floats,
    arrivals: Integers,
    wind: Floats,
    state: Floats,
    counters: Integers,
    limits: Floats,
    power: Floats,
    track: Floats,
) -> None:
    for k in members:
        begin, end = offsets[k], offsets[k + 1]
        call[k, EVENT] = _fly_wing(
            state[k],
            counters[k],
            routes[begin:end],
            limits[k],
            power[k],
            wind[k, : call[k, WIND_ROWS]],
            call[k, FIRST],
            call[k, STEPS],
            call[k, STOPS] != 0,
            arrivals[begin:end],
            track[k],
            call[k, EVERY],
        )


@compiled(nogil=True)
def _rover(
    members: Integers,
    call: Integers,
    offsets: Integers,
    routes: Floats,
    arrivals: Integers,
    wind: Floats,
    state: Floats,
    counters: Integers,
    limits: Floats,
    power: Floats,
    track: Floats,
) -> None:
    for k in members:
        begin, end = offsets[k], offsets[k + 1]
        call[k, EVENT] = _drive(
            state[k],
            counters[k],
            routes[begin:end],
            limits[k],
            power[k],
            wind[k, : call[k, WIND_ROWS]],
            call[k, FIRST],
            call[k, STEPS],
            call[k, STOPS] != 0,
            arrivals[begin:end],
            track[k],
            call[k, EVERY],
        )


LOOPS: Mapping[str, Callable[..., None]] = MappingProxyType(
    {
        "generic": _generic,
        "px4": _px4,
        "arducopter": _arducopter,
        "fixed-wing": _fixed_wing,
        "rover": _rover,
    }
)
"""The loops by name; each is compiled when it is first called."""
