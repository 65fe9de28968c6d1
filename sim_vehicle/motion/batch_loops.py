"""The compiled loops over many vehicles, one for each kernel."""

from __future__ import annotations

import zlib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_vehicle.motion.arducopter import kernel as arducopter_kernel
from sim_vehicle.motion.fixed_wing import kernel as fixed_wing_kernel
from sim_vehicle.motion.multirotor import kernel
from sim_vehicle.motion.px4 import kernel as px4_kernel
from sim_vehicle.motion.rover import kernel as rover_kernel

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["CALL", "EVENT", "EVERY", "FIRST", "STEPS", "STOPS", "WIND_ROWS", "loops"]

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


@cache
def loops() -> dict[str, Callable[..., object]]:
    """Return the loops by name; each is compiled when it is first called.

    The compiler keeps what it compiled as long as the file of the function is unchanged, whatever happens to
    the files of the functions that it calls. So the loops hold a number that stands for the sources of all of
    them.
    """
    rooms = Path(__file__).parents[1]
    number = 0
    for source in sorted(
        path for room in ("energy", "motion", "weather") for path in (rooms / room).rglob("*.py")
    ):
        number = zlib.crc32(source.read_bytes(), number)
    return _loops(number)


def _loops(sources: int) -> dict[str, Callable[..., object]]:
    """Return the loops over ``members``, indices of vehicles.

    All have: call int64[B, CALL], routes and arrivals one after the other from ``offsets`` on, wind[B, n, 9],
    and the rows of the vehicles; then what their kernel has besides.
    """

    @njit(cache=True, nogil=True)
    def generic(
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
    ) -> int:
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
        return sources

    @njit(cache=True, nogil=True)
    def px4(
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
    ) -> int:
        for k in members:
            begin, end = offsets[k], offsets[k + 1]
            call[k, EVENT] = _fly_px4(
                state[k],
                counters[k],
                guide[k],
                routes[begin:end],
                law[k],
                limits[k, 11],
                power[k],
                wind[k, : call[k, WIND_ROWS]],
                call[k, FIRST],
                call[k, STEPS],
                call[k, STOPS] != 0,
                arrivals[begin:end],
                track[k],
                call[k, EVERY],
            )
        return sources

    @njit(cache=True, nogil=True)
    def arducopter(
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
    ) -> int:
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
        return sources

    @njit(cache=True, nogil=True)
    def wing(
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
    ) -> int:
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
        return sources

    @njit(cache=True, nogil=True)
    def rover(
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
    ) -> int:
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
        return sources

    return {"generic": generic, "px4": px4, "arducopter": arducopter, "wing": wing, "rover": rover}
