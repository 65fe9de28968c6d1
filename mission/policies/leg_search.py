"""Straight legs on a map of cells, in compiled code: what every leg from a place sees, and what it costs."""

from __future__ import annotations

import math
from typing import Any

from geo.compiled import compiled


@compiled(inline="late")
def is_free(free: Any, i: int, j: int) -> bool:
    """Return whether legs may lead through a cell; through none beside the map."""
    width, height = free.shape
    if i < 0 or j < 0 or i >= width or j >= height:
        return False
    return bool(free[i, j])


@compiled(inline="late")
def leg_to(x: float, y: float, i: int, j: int, slopes: Any) -> tuple[float, float, float, float, float]:
    """Return the leg from a place to the middle of a cell.

    Parameters
    ----------
    x, y : float
        The place, in cells.
    i, j : int
        The cell.
    slopes : float64[directions]
        See `mission.policies.planning_grid.LegCosts`.

    Returns
    -------
    tuple of float
        Its parts along x and y, its length in cells, its direction in turns from the x-axis towards y, and
        what a cell's length of it costs.
    """
    dx, dy = i + 0.5 - x, j + 0.5 - y
    turns = (math.atan2(dy, dx) / (2.0 * math.pi)) % 1.0
    return dx, dy, math.hypot(dx, dy), turns, slopes[int(turns * len(slopes) + 0.5) % len(slopes)]


@compiled
def leg_values(
    pooled: Any,
    free: Any,
    x: float,
    y: float,
    offsets: Any,
    turn: float,
    slopes: Any,
    values: Any,
    costs: Any,
) -> None:
    """Fill in the value and the cost of the legs from a place to cells around it.

    Parameters
    ----------
    pooled, free : float32[W, H], bool[W, H]
        What seeing each cell takes; where legs may lead. A leg may begin elsewhere.
    x, y : float
        The place, in cells.
    offsets : int64[n, 2]
        Ends of the legs, in cells from the one of the place (`mission.policies.route_search.leg_offsets`).
    turn, slopes
        See `mission.policies.planning_grid.LegCosts`.
    values, costs : float64[n]
        Filled; a leg that cannot be flown has the value -1.
    """
    begin_i, begin_j = math.floor(x + 1e-9), math.floor(y + 1e-9)
    inside = is_free(free, begin_i, begin_j)
    for n in range(len(offsets)):
        values[n] = -1.0
        target_i, target_j = begin_i + offsets[n, 0], begin_j + offsets[n, 1]
        if not is_free(free, target_i, target_j):
            continue
        dx, dy, length, _, slope = leg_to(x, y, target_i, target_j, slopes)
        steps = math.ceil(length - 1e-6)
        value = 0.0
        last_i, last_j = begin_i, begin_j
        entered = inside
        for step in range(1, steps + 1):
            part = min(1.0, step / length)
            i, j = math.floor(x + part * dx + 1e-9), math.floor(y + part * dy + 1e-9)
            if not is_free(free, i, j):
                if entered:
                    value = -1.0
                    break
                continue
            entered = True
            if i != last_i or j != last_j:
                value += pooled[i, j]
                last_i, last_j = i, j
        values[n] = value
        costs[n] = turn + steps * slope
