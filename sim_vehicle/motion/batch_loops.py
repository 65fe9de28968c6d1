"""The compiled loop over many vehicles that are moved by one kernel."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.motion.compiled_motion import Dynamics
from sim_vehicle.motion.records import Record

__all__ = ["CALL", "EVENT", "EVERY", "FIRST", "STEPS", "STOPS", "WIND_ROWS", "loop_of"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Tables = tuple[Record, ...]

# What a vehicle's kernel is called with: steps, whether to stop at each leg, steps between points of the
# track, rows of the wind and the first of them; and the event that it returned.
STEPS, STOPS, EVERY, WIND_ROWS, FIRST, EVENT = range(6)
CALL = 6


@compiled
def _row(table: Record, k: int) -> Record:
    """Return the row of a vehicle; records are handed over as an array of one."""
    if table.ndim == 1:
        return table[k : k + 1]
    return table[k]


# The rows of one vehicle in the tables that only its kernel has; their dimensions differ, so that compiled
# code cannot loop over them.
@compiled
def _none(own: Tables, k: int) -> Tables:  # noqa: ARG001
    return ()


@compiled
def _three(own: Tables, k: int) -> Tables:
    return _row(own[0], k), _row(own[1], k), _row(own[2], k)


@compiled
def _four(own: Tables, k: int) -> Tables:
    return _row(own[0], k), _row(own[1], k), _row(own[2], k), _row(own[3], k)


_ROWS = {0: _none, 3: _three, 4: _four}


@cache
def loop_of(dynamics: Dynamics) -> Callable[..., None]:
    """Return the loop over ``members``, indices of vehicles, that calls a kernel for each.

    It takes call int64[B, CALL], routes and arrivals one after the other from ``offsets`` on, wind[B, n, 9],
    and the rows of the vehicles; then what their kernel has besides. It is compiled when it is first called.
    """
    advance, rows = dynamics.kernel, _ROWS[len(dynamics.own)]

    def loop(
        members: Integers,
        call: Integers,
        offsets: Integers,
        routes: Record,
        arrivals: Integers,
        wind: Floats,
        state: Record,
        counters: Integers,
        limits: Record,
        power: Floats,
        track: Floats,
        *own: Any,
    ) -> None:
        for k in members:
            begin, end = offsets[k], offsets[k + 1]
            call[k, EVENT] = advance(
                _row(state, k),
                counters[k],
                routes[begin:end],
                _row(limits, k),
                power[k],
                wind[k, : call[k, WIND_ROWS]],
                call[k, FIRST],
                call[k, STEPS],
                call[k, STOPS] != 0,
                arrivals[begin:end],
                track[k],
                call[k, EVERY],
                *rows(own, k),
            )

    loop.__qualname__ = f"loop_of_{advance.__module__}"
    return compiled(nogil=True)(loop)
