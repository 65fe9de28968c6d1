"""Loop over time steps that all compiled vehicles share: wind, track, legs, events."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.energy import power
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.columns import Record
from sim_vehicle.weather.gust_kernel import wind_at

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

multirotor_power = compiled(allocates=False)(power.multirotor_power)


@compiled(allocates=False)
def _wind_row(step: int, first: int, rows: int) -> int:
    """Return the row of the wind block for a step; -1 if the block ends before the step."""
    if rows == 1:
        # The wind is steady.
        return 0
    index = step // col.GRID - first
    return index if index < rows else -1


@compiled(allocates=False)
def _mark_track(
    counters: Integers, step: int, track: Floats, every: int, x: float, y: float, z: float
) -> None:
    """Append the position to the track at each `every`-th grid point (0: never) until the track is full."""
    point = counters[col.TRACK_POINTS]
    if every > 0 and (step // col.GRID) % every == 0 and point < track.shape[0]:
        track[point, 0], track[point, 1], track[point, 2] = x, y, z
        counters[col.TRACK_POINTS] = point + 1


@compiled(allocates=False)
def _complete_leg(counters: Integers, arrivals: Integers, step: int, stop_each: bool) -> int:
    """Record the arrival at the end of the present leg, go on to the next leg, and return the event."""
    leg = counters[col.LEG_INDEX]
    arrivals[leg] = step
    counters[col.NEAR_SENT] = 0
    if leg == len(arrivals) - 1:
        counters[col.ARRIVED] = 1
        return col.REACHED
    counters[col.LEG_INDEX] = leg + 1
    return col.REACHED if stop_each else col.RAN


@compiled(inline="always")
def distance2(state: Record, x: float, y: float, z: float) -> float:
    """Return the squared distance from the vehicle to a position."""
    dx, dy, dz = x - state.position_x, y - state.position_y, z - state.position_z
    return float(dx**2 + dy**2 + dz**2)


@compiled(allocates=False)
def stop(state: Record) -> None:
    """Set the vehicle's velocity and acceleration to zero."""
    state.velocity_x = state.velocity_y = state.velocity_z = 0.0
    state.acceleration_x = state.acceleration_y = state.acceleration_z = 0.0


@compiled(inline="always")
def take_velocity(state: Record, east: float, north: float, up: float, dt: float) -> None:
    """Set the velocity after a step, and the constant acceleration that causes this velocity."""
    state.acceleration_x = (east - state.velocity_x) / dt
    state.acceleration_y = (north - state.velocity_y) / dt
    state.acceleration_z = (up - state.velocity_z) / dt
    state.velocity_x, state.velocity_y, state.velocity_z = east, north, up


def kernel_of(
    module: str,
    enter: Callable[..., None],
    feel: Callable[..., bool],
    move: Callable[..., bool],
    leave: Callable[..., None],
) -> Callable[..., int]:
    """Return a vehicle's kernel: the compiled loop over time steps.

    The arguments are compiled functions. The functions get the state STATE, the limits LIMITS and ``own``, a
    tuple of the arrays that only this kind of vehicle has.

    Parameters
    ----------
    module : str
        Module name under which the kernel is compiled and cached.
    enter : callable
        Called before a step, to begin a leg that is due. Arguments: state, counters, route LEG[n], limits,
        own.
    feel : callable
        Called at each point of the wind grid. Sets the wind (tuple: east, north, up) and the power in the
        state, and returns whether the vehicle has stalled. Arguments: state, counters, the leg's row, the
        wind, limits, power, own.
    move : callable
        Moves the vehicle by one step and returns whether the leg is complete. Arguments as for ``enter``.
    leave : callable
        Called after a completed leg. Arguments: state, counters, the leg's row, route, limits, own.
    """

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
        *own: Any,
    ) -> int:
        """Advance for ``max_steps`` steps along the route, or until an event occurs, and return the event.

        If a step both completes a leg and empties the battery, the event is ENERGY, and ``arrivals`` has the
        leg.

        Parameters
        ----------
        states, counters : STATE[1], int64[COUNTERS]
            Modified in place.
        route : LEG[n]
            After the last leg the vehicle holds at the end of that leg.
        limits_of, power : LIMITS[1], float64[COEFFICIENTS]
        wind : float64[m, ROW]
            Values every `GRID` steps from grid index ``first_wind`` (see `wind_at`); a single row is a steady
            wind.
        stop_each : bool
            Whether to return at every waypoint, or only at the last.
        arrivals : int64[n]
            Output: step of arrival at the end of each leg.
        track : float64[k, 3]
            Output: position every ``track_every`` grid points (0: never), until the track is full.

        Returns
        -------
        int
            RAN, REACHED, WIND (end of the wind block), STALLED (no progress), ENERGY or NEAR.
        """
        state, limits = states[0], limits_of[0]
        # Local variables hold the limits, because reading these in every step costs a tenth of the speed.
        dt, capacity = limits.step_s, limits.energy_limit
        for _ in range(max_steps):
            enter(state, counters, route, limits, own)
            step, row = counters[col.STEP], route[counters[col.LEG_INDEX]]
            if step % col.GRID == 0:
                index = _wind_row(step, first_wind, len(wind))
                if index < 0:
                    return col.WIND
                air = wind_at(wind[index], state.position_z)
                stuck = feel(state, counters, row, air, limits, power, own)
                _mark_track(
                    counters, step, track, track_every, state.position_x, state.position_y, state.position_z
                )
                if stuck:
                    return col.STALLED
            done = move(state, counters, route, limits, own)
            state.energy_used += state.power * dt
            step += 1
            counters[col.STEP] = step
            event = col.RAN
            if counters[col.ARRIVED] == 0:
                if done:
                    event = _complete_leg(counters, arrivals, step, stop_each)
                    leave(state, counters, row, route, limits, own)
                elif counters[col.NEAR_SENT] == 0 and distance2(state, row.x, row.y, row.z) < row.near**2:
                    counters[col.NEAR_SENT] = 1
                    event = col.NEAR
            if state.energy_used >= capacity:
                event = col.ENERGY
            if event != col.RAN:
                return event
        return col.RAN

    advance.__module__, advance.__qualname__ = module, "advance"
    # Predicted flights with estimate errors are advanced in threads, each by a call of its own.
    return compiled(nogil=True, allocates=False)(advance)
