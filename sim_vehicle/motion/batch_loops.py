"""The compiled loops over many vehicles, one for each kernel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.motion.arducopter import kernel as arducopter
from sim_vehicle.motion.ardurover import kernel as ardurover
from sim_vehicle.motion.fixed_wing import kernel as fixed_wing
from sim_vehicle.motion.multirotor import kernel as multirotor
from sim_vehicle.motion.px4 import kernel as px4
from sim_vehicle.motion.rover import kernel as rover

__all__ = ["CALL", "EVENT", "EVERY", "FIRST", "LOOPS", "STEPS", "STOPS", "WIND_ROWS"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Tables = tuple[Floats, ...]

# What a vehicle's kernel is called with: steps, whether to stop at each leg, steps between points of the
# track, rows of the wind and the first of them; and the event that it returned.
STEPS, STOPS, EVERY, WIND_ROWS, FIRST, EVENT = range(6)
CALL = 6


# The rows of one vehicle in the tables that only its kernel has; their dimensions differ, so that compiled
# code cannot loop over them.
@compiled
def _none(own: Tables, k: int) -> Tables:  # noqa: ARG001
    return ()


@compiled
def _three(own: Tables, k: int) -> Tables:
    return own[0][k], own[1][k], own[2][k]


@compiled
def _four(own: Tables, k: int) -> Tables:
    return own[0][k], own[1][k], own[2][k], own[3][k]


def _loop(
    name: str, advance: Callable[..., int], rows: Callable[[Tables, int], Tables] = _none
) -> Callable[..., None]:
    """Make the loop over ``members``, indices of vehicles, that calls a kernel for each.

    It takes call int64[B, CALL], routes and arrivals one after the other from ``offsets`` on, wind[B, n, 9],
    and the rows of the vehicles; then what their kernel has besides.
    """

    def loop(
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
        *own: Any,
    ) -> None:
        for k in members:
            begin, end = offsets[k], offsets[k + 1]
            call[k, EVENT] = advance(
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
                *rows(own, k),
            )

    loop.__qualname__ = f"loop_of_{name}"
    return compiled(nogil=True)(loop)


LOOPS: Mapping[str, Callable[..., None]] = MappingProxyType(
    {
        "generic": _loop("generic", multirotor.advance),
        "px4": _loop("px4", px4.advance, _three),
        "arducopter": _loop("arducopter", arducopter.advance, _four),
        "fixed-wing": _loop("fixed_wing", fixed_wing.advance),
        "rover": _loop("rover", rover.advance),
        "ardurover": _loop("ardurover", ardurover.advance, _four),
    }
)
"""The loops by name; each is compiled when it is first called."""
