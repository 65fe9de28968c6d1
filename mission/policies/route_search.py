"""Compiled search for routes of straight legs on a map of cell values."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from geo.linear_algebra import exp


@compiled(inline="late")
def is_free(free: Any, i: int, j: int) -> bool:
    """Return whether legs may cross cell (i, j); False outside the map."""
    width, height = free.shape
    if i < 0 or j < 0 or i >= width or j >= height:
        return False
    return bool(free[i, j])


@compiled(inline="late")
def leg_to(x: float, y: float, i: int, j: int, slopes: Any) -> tuple[float, float, float, float, float]:
    """Return the leg from (x, y), in cells, to the centre of cell (i, j).

    The result is: components along x and y, length in cells, direction in turns from the x-axis towards y,
    and cost per cell of length (from `mission.policies.planning_grid.LegCosts.slopes`).
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
    """Fill in values and costs, float64[n] each, of the legs from (x, y) to surrounding cells.

    `pooled`, float32[W, H], is the value of observing each cell. Legs may cross only `free` cells,
    bool[W, H], but may start elsewhere. The target cells are `offsets`, int64[n, 2], from the cell of (x, y).
    For `turn` and `slopes` see `mission.policies.planning_grid.LegCosts`. A leg over a cell that is not free
    has the value -1.
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


_SECTORS = 32
_DENSE = 6  # Up to twice this distance, legs may end in every cell

X, Y, COST, VALUE = range(4)
"""Columns of a route: position in cells, cumulative cost, and cumulative discounted value."""


def neighbour_shares(share: float, spread: float, radius: int) -> NDArray[np.float32]:
    """Return the shares of value that observing a cell removes, float32[2 radius + 1, 2 radius + 1].

    The share is 1 for the cell itself, and ``share * exp(-d^2 / spread)`` for a cell d cells away.
    """
    axis = np.arange(-radius, radius + 1)
    squares = axis[:, None] ** 2 + axis[None, :] ** 2
    shares: NDArray[np.float32] = (share * exp(-squares / spread)).astype(np.float32)
    shares[radius, radius] = 1.0
    return shares


@compiled
def pool(left: Any, shares: Any, x_0: int, x_1: int, y_0: int, y_1: int, out: Any) -> None:
    """Write the value of observing each cell, including the neighbour shares, to a block of `out`."""
    width, height = left.shape
    radius = shares.shape[0] // 2
    first, end = max(y_0, 0), min(y_1, height)
    for x in range(max(x_0, 0), min(x_1, width)):
        for y in range(first, end):
            out[x, y] = np.float32(0.0)
        for i in range(max(0, x - radius), min(width, x + radius + 1)):
            for aside in range(-radius, radius + 1):
                share = shares[i - x + radius, aside + radius]
                low, high = max(first, -aside), min(end, height - aside)
                if low < high:
                    # Numba vectorises an inner loop only if it starts at 0.
                    seen, taken = left[i, low + aside : high + aside], out[x, low:high]
                    for k in range(high - low):
                        taken[k] += share * seen[k]


@compiled
def take_leg(left: Any, shares: Any, x: float, y: float, to_x: float, to_y: float) -> None:
    """Remove from the map `left` the value that a leg observes, except in its first cell."""
    width, height = left.shape
    radius = shares.shape[0] // 2
    length = math.hypot(to_x - x, to_y - y)
    steps = math.ceil(length - 1e-6)
    last_i, last_j = math.floor(x), math.floor(y)
    for step in range(1, steps + 1):
        part = min(1.0, step / length)
        i = math.floor(x + part * (to_x - x) + 1e-9)
        j = math.floor(y + part * (to_y - y) + 1e-9)
        if (i == last_i and j == last_j) or i < 0 or j < 0 or i >= width or j >= height:
            continue
        last_i, last_j = i, j
        for a in range(max(0, i - radius), min(width, i + radius + 1)):
            for b in range(max(0, j - radius), min(height, j + radius + 1)):
                left[a, b] *= np.float32(1.0) - shares[a - i + radius, b - j + radius]


def leg_offsets(reach: int) -> NDArray[np.int64]:
    """Return the end cells of legs relative to their first cell, int64[n, 2]; sparser with distance."""
    axis = np.arange(-reach, reach + 1)
    dx, dy = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    distance = np.hypot(dx, dy)
    stride = np.maximum(1, (distance / _DENSE).astype(np.int64))
    straight = (dx == 0) | (dy == 0)
    kept = (distance >= 1.0) & (distance <= reach) & (straight | ((dx % stride == 0) & (dy % stride == 0)))
    return np.stack([dx[kept], dy[kept]], axis=1)


@compiled
def _expand(
    pooled: Any,
    free: Any,
    place: Any,
    offsets: Any,
    horizon: float,
    turn: float,
    slopes: Any,
    patience: float,
    best: Any,
    best_end: Any,
) -> None:
    """Find the best leg for each sector of directions and each interval of cost.

    Fills `best`, float64[sectors, groups + 1], with the values projected to the ends of the intervals, and
    `best_end`, float64[sectors, groups + 1, 4], with the ends of the legs.
    """
    sectors, groups = best.shape[0], best.shape[1] - 1
    interval = horizon / groups
    best[:] = -1.0
    x, y = place[X], place[Y]
    begin_i, begin_j = math.floor(x + 1e-9), math.floor(y + 1e-9)
    inside = is_free(free, begin_i, begin_j)
    for n in range(len(offsets)):
        target_i, target_j = begin_i + offsets[n, 0], begin_j + offsets[n, 1]
        if not is_free(free, target_i, target_j):
            continue
        dx, dy, length, direction, slope = leg_to(x, y, target_i, target_j, slopes)
        steps = math.ceil(length - 1e-6)
        cost = place[COST] + turn
        value = place[VALUE]
        fade = math.exp(-slope / patience)
        factor = math.exp(-cost / patience)
        last_i, last_j = begin_i, begin_j
        entered = inside
        valid = True
        end_x, end_y = x, y
        for step in range(1, steps + 1):
            part = min(1.0, step / length)
            end_x, end_y = x + part * dx, y + part * dy
            i, j = math.floor(end_x + 1e-9), math.floor(end_y + 1e-9)
            cost += slope
            factor *= fade
            if not is_free(free, i, j):
                if entered:
                    valid = False
                    break
                continue
            entered = True
            if i != last_i or j != last_j:
                value += pooled[i, j] * factor
                last_i, last_j = i, j
            if cost >= horizon - 1e-9:
                break
        if not valid:
            continue
        group = groups if cost >= horizon - 1e-9 else int(cost / interval)
        # Routes of a group differ in cost, so their values are projected to the end of the interval.
        upto = horizon if group == groups else (group + 1) * interval
        rank = value * (1.0 - math.exp(-upto / patience)) / (1.0 - factor)
        sector = int(direction * sectors) % sectors
        if rank > best[sector, group]:
            best[sector, group] = rank
            best_end[sector, group, X] = end_x
            best_end[sector, group, Y] = end_y
            best_end[sector, group, COST] = cost
            best_end[sector, group, VALUE] = value


@compiled
def _insert(ranks: Any, ends: Any, parents: Any, rank: float, end: Any, node: int) -> None:
    """Insert a route into its group, sorted best first, unless all routes of the group are better."""
    k = len(ranks) - 1
    if rank <= ranks[k]:
        return
    while k > 0 and ranks[k - 1] < rank:
        ranks[k] = ranks[k - 1]
        ends[k] = ends[k - 1]
        parents[k] = parents[k - 1]
        k -= 1
    ranks[k] = rank
    ends[k] = end
    parents[k] = node


@compiled
def search_route(
    values: Any,
    shares: Any,
    free: Any,
    x: float,
    y: float,
    offsets: Any,
    horizon: float,
    turn: float,
    slopes: Any,
    patience: float,
    groups: int,
    beam: int,
) -> Any:
    """Search for the route with the greatest discounted value up to a horizon of cost (beam search).

    `values`, float32[W, H], are the acquisition values of the cells. Value earned after a cost is discounted
    by ``exp(-cost / patience)``. The search divides the costs up to the horizon into `groups`, and keeps the
    `beam` best routes in each. For `shares` see `neighbour_shares`; for `free`, `turn` and `slopes` see
    `leg_values`; for `offsets` see `leg_offsets`.

    Return the ends of the legs of the best route, float64[legs, 4]: x, y, cumulative cost, and cumulative
    discounted value. There are no legs if no value can be reached.
    """
    width, height = values.shape
    radius = shares.shape[0] // 2
    most = groups * beam + 1
    place = np.zeros((most, 4))
    parent = np.full(most, -1)
    lefts = np.empty((most, width, height), np.float32)
    pools = np.empty((most, width, height), np.float32)
    best = np.empty((_SECTORS, groups + 1))
    best_end = np.empty((_SECTORS, groups + 1, 4))
    ranks = np.full((groups + 1, beam), -1.0)
    ends = np.zeros((groups + 1, beam, 4))
    parents = np.full((groups + 1, beam), -1)
    place[0, X], place[0, Y] = x, y
    lefts[0] = values
    pool(lefts[0], shares, 0, width, 0, height, pools[0])
    first, nodes = 0, 1
    for group in range(-1, groups):
        if group >= 0:
            first = nodes
            for k in range(beam):
                if ranks[group, k] < 0.0:
                    break
                up = parents[group, k]
                parent[nodes] = up
                place[nodes] = ends[group, k]
                lefts[nodes] = lefts[up]
                pools[nodes] = pools[up]
                a, b, c, d = place[up, X], place[up, Y], place[nodes, X], place[nodes, Y]
                take_leg(lefts[nodes], shares, a, b, c, d)
                reach = 2 * radius + 1
                x_0, x_1 = int(min(a, c)) - reach, int(max(a, c)) + reach + 1
                y_0, y_1 = int(min(b, d)) - reach, int(max(b, d)) + reach + 1
                pool(lefts[nodes], shares, x_0, x_1, y_0, y_1, pools[nodes])
                nodes += 1
        for node in range(first, nodes):
            _expand(pools[node], free, place[node], offsets, horizon, turn, slopes, patience, best, best_end)
            for sector in range(_SECTORS):
                for into in range(group + 1, groups + 1):
                    rank = best[sector, into]
                    if rank >= 0.0:
                        _insert(ranks[into], ends[into], parents[into], rank, best_end[sector, into], node)
    count = 0
    if ranks[groups, 0] > 0.0:
        count = 1
        node = parents[groups, 0]
        while node > 0:
            count += 1
            node = parent[node]
    route = np.empty((count, 4))
    if count:
        route[count - 1] = ends[groups, 0]
        node = parents[groups, 0]
        for k in range(count - 2, -1, -1):
            route[k] = place[node]
            node = parent[node]
    return route
