"""What every straight leg from a place sees, and what it costs: many legs at once, in compiled code."""

from __future__ import annotations

import math
from typing import Any

from geo.compiled import compiled


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
    """Fill in the worth and the cost of the legs from a place to cells around it.

    Parameters
    ----------
    pooled, free : float32[W, H], bool[W, H]
        What seeing each cell takes; where legs may lead. A leg may begin elsewhere.
    x, y : float
        The place, in cells.
    offsets : int64[n, 2]
        Ends of the legs, in cells from the one of the place (`mission.policies.route_search.leg_offsets`).
    turn, slopes
        See `mission.policies.chart.LegCosts`.
    values, costs : float64[n]
        Filled; a leg that cannot be flown has the value -1.
    """
    width, height = pooled.shape
    begin_i, begin_j = math.floor(x + 1e-9), math.floor(y + 1e-9)
    inside = 0 <= begin_i < width and 0 <= begin_j < height and free[begin_i, begin_j]
    for n in range(len(offsets)):
        values[n] = -1.0
        target_i, target_j = begin_i + offsets[n, 0], begin_j + offsets[n, 1]
        if target_i < 0 or target_j < 0 or target_i >= width or target_j >= height:
            continue
        if not free[target_i, target_j]:
            continue
        dx, dy = target_i + 0.5 - x, target_j + 0.5 - y
        length = math.hypot(dx, dy)
        angle = (math.atan2(dy, dx) / (2.0 * math.pi)) % 1.0
        steps = math.ceil(length - 1e-6)
        value = 0.0
        last_i, last_j = begin_i, begin_j
        entered = inside
        for step in range(1, steps + 1):
            part = min(1.0, step / length)
            i, j = math.floor(x + part * dx + 1e-9), math.floor(y + part * dy + 1e-9)
            if i < 0 or j < 0 or i >= width or j >= height or not free[i, j]:
                if entered:
                    value = -1.0
                    break
                continue
            entered = True
            if i != last_i or j != last_j:
                value += pooled[i, j]
                last_i, last_j = i, j
        values[n] = value
        costs[n] = turn + steps * slopes[int(angle * len(slopes) + 0.5) % len(slopes)]
