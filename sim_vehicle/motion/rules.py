"""What every kernel does in the same way: the wind of a step, points of the track, the end of a leg."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sim_vehicle.motion import columns as col
from sim_vehicle.motion.records import Record

__all__ = ["complete_leg", "distance2", "mark_track", "stop", "wind_row"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@compiled(allocates=False)
def wind_row(step: int, first: int, rows: int) -> int:
    """Return the row of the wind's block for a step on its grid; -1: the block is used up.

    Parameters
    ----------
    first : int
        Grid index of the first row.
    rows : int
        One row is a steady wind.
    """
    if rows == 1:
        return 0
    index = step // col.GRID - first
    return index if index < rows else -1


@compiled(allocates=False)
def mark_track(
    counters: Integers, step: int, track: Floats, every: int, x: float, y: float, z: float
) -> None:
    """Write the position into the track at every so many grid points (0: never), until it is full."""
    point = counters[col.TRACK_POINTS]
    if every > 0 and (step // col.GRID) % every == 0 and point < track.shape[0]:
        track[point, 0], track[point, 1], track[point, 2] = x, y, z
        counters[col.TRACK_POINTS] = point + 1


@compiled(allocates=False)
def complete_leg(counters: Integers, arrivals: Integers, step: int, stop_each: bool) -> int:
    """Enter the arrival at the end of the current leg and go on to the next; return the event."""
    leg = counters[col.LEG_INDEX]
    arrivals[leg] = step
    counters[col.NEAR_TOLD] = 0
    if leg == len(arrivals) - 1:
        counters[col.ARRIVED] = 1
        return col.REACHED
    counters[col.LEG_INDEX] = leg + 1
    return col.REACHED if stop_each else col.RAN


@compiled(inline="always")
def distance2(state: Record, x: float, y: float, z: float) -> float:
    """Return the square of the distance to a position."""
    dx, dy, dz = x - state.position_x, y - state.position_y, z - state.position_z
    return float(dx**2 + dy**2 + dz**2)


@compiled(allocates=False)
def stop(state: Record) -> None:
    """Have neither velocity nor acceleration."""
    state.velocity_x = state.velocity_y = state.velocity_z = 0.0
    state.acceleration_x = state.acceleration_y = state.acceleration_z = 0.0
