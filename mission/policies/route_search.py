"""Compiled search for routes on a map of cell values: straight legs one by one, or a tour of places.

A tour solves the orienteering problem (Golden, Levy & Vohra 1987): to choose places and their order within a
budget. In this search, cells along the legs also have value. Places are inserted in the order of value per
cost. Then the tour is improved by reversing sections (2-opt), and by removing and refilling sections.
"""

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

    `pooled`, float32[W, H], is the value of observing each cell. Legs may cross only `free` cells, bool[W,
    H], but may start elsewhere. `offsets`, int64[n, 2], gives the target cells relative to the cell of (x,
    y). For `turn` and `slopes` see `mission.policies.planning_grid.LegCosts`. A leg over a cell that is not
    free has the value -1.
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
    """Return the fractions of value that observing a cell removes from the cell and its neighbours.

    The result is float32[n, n] with n = 2 radius + 1. The middle is 1; a neighbour at a distance of d cells
    has ``share * exp(-d^2 / spread)``.
    """
    axis = np.arange(-radius, radius + 1)
    squares = axis[:, None] ** 2 + axis[None, :] ** 2
    shares: NDArray[np.float32] = (share * exp(-squares / spread)).astype(np.float32)
    shares[radius, radius] = 1.0
    return shares


@compiled(nogil=True)
def add_runs(weight: Any, runs: Any, values: Any, first: int, total: Any) -> None:
    """Add `weight` times a map to `total` in the cells of `runs`; `total` begins at the map's column `first`.

    `runs`, int32[n, 3], has the column of each run, its first cell along y, and the end of the run.
    """
    for k in range(len(runs)):
        x, low, high = runs[k]
        added, sums = values[x, low:high], total[x - first, low:high]
        for y in range(len(sums)):
            sums[y] += weight * added[y]


@compiled
def pool(left: Any, shares: Any, x_0: int, x_1: int, y_0: int, y_1: int, out: Any) -> None:
    """Write the value of observing each cell, including shares of nearby cells, to a block of `out`."""
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
                    # Numba vectorises an inner loop only if the loop index starts at 0.
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
    """Return the end cells of legs relative to the first cell, int64[n, 2]; far end cells are sparser."""
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

    The array `best`, float64[sectors, groups + 1], gets the values of the legs, projected to the ends of the
    intervals. The array `best_end`, float64[sectors, groups + 1, 4], gets the ends of the legs.
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
    """Insert a route into its group (sorted, best first), unless all its routes are at least as good."""
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
    by ``exp(-cost / patience)``. The search divides the costs up to the horizon into `groups` intervals, and
    keeps the `beam` best routes of each interval. For `shares` see `neighbour_shares`; for `free`, `turn` and
    `slopes` see `leg_values`; for `offsets` see `leg_offsets`.

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


def candidate_places(
    pooled: NDArray[np.float32], x: float, y: float, near: int, most: int
) -> NDArray[np.float64]:
    """Return candidate places of a tour: the best cell of each tile. Tiles near the vehicle are smaller."""
    width, height = pooled.shape
    side = max(2, math.ceil(math.sqrt(width * height / most)))
    fine = max(2, math.ceil(near / math.sqrt(most)))
    found: set[tuple[int, int]] = set()
    x_0, y_0 = max(0, int(x) - near // 2), max(0, int(y) - near // 2)
    for tile, left, low, right, high in (
        (side, 0, 0, width, height),
        (fine, x_0, y_0, min(width, x_0 + near), min(height, y_0 + near)),
    ):
        if tile == side and left > 0:
            continue
        for i in range(left, right, tile):
            for j in range(low, high, tile):
                part = pooled[i : min(i + tile, right), j : min(j + tile, high)]
                at = int(np.argmax(part))
                if part.flat[at] > 0.0:
                    found.add((i + at // part.shape[1], j + at % part.shape[1]))
    return np.array(sorted(found), np.float64).reshape(-1, 2) + 0.5


@compiled
def _tour_value(
    tour: Any, count: int, places: Any, costs: Any, back: Any, pooled: Any, marks: Any, mark: int,
    patience: float, limit: float,
) -> Any:  # fmt: skip
    """Return the discounted value and the cost of a tour; the cost is infinite if it exceeds the limit."""
    cost = 0.0
    for k in range(1, count):
        cost += costs[tour[k - 1], tour[k]]
    if cost + back[tour[count - 1]] > limit + 1e-9:
        return 0.0, math.inf
    value, spent = 0.0, 0.0
    for k in range(1, count):
        a, b = tour[k - 1], tour[k]
        dx, dy = places[b, 0] - places[a, 0], places[b, 1] - places[a, 1]
        length = math.hypot(dx, dy)
        steps = max(1, math.ceil(length - 1e-6))
        fade = math.exp(-costs[a, b] / steps / patience)
        factor = math.exp(-spent / patience)
        for step in range(1, steps + 1):
            part = min(1.0, step / max(length, 1e-9))
            factor *= fade
            i = math.floor(places[a, 0] + part * dx + 1e-9)
            j = math.floor(places[a, 1] + part * dy + 1e-9)
            if 0 <= i < pooled.shape[0] and 0 <= j < pooled.shape[1] and marks[i, j] != mark:
                marks[i, j] = mark
                value += pooled[i, j] * factor
        spent += costs[a, b]
    return value, cost


@compiled
def _fill(
    tour: Any, count: int, used: Any, places: Any, costs: Any, back: Any, pooled: Any, marks: Any, mark: int,
    patience: float, limit: float,
) -> Any:  # fmt: skip
    """Insert places in the order of value per cost until none fits; return the new `count` and `mark`."""
    trial = np.empty_like(tour)
    while count < len(tour):
        mark += 1
        value, cost = _tour_value(tour, count, places, costs, back, pooled, marks, mark, patience, limit)
        best_rate, best_place, best_at = 0.0, -1, -1
        for place in range(1, len(places)):
            if used[place]:
                continue
            # Only the cheapest position and the end are tried: trying all positions would square the time.
            at, least = count, costs[tour[count - 1], place] + back[place] - back[tour[count - 1]]
            for k in range(1, count):
                extra = costs[tour[k - 1], place] + costs[place, tour[k]] - costs[tour[k - 1], tour[k]]
                if extra < least:
                    at, least = k, extra
            for choice in range(2):
                if choice == 1:
                    if at == count:
                        break
                    at = count
                trial[:at] = tour[:at]
                trial[at] = place
                trial[at + 1 : count + 1] = tour[at:count]
                mark += 1
                new, new_cost = _tour_value(
                    trial, count + 1, places, costs, back, pooled, marks, mark, patience, limit
                )
                if new_cost == math.inf:
                    continue
                rate = (new - value) / max(new_cost - cost, 1e-6)
                if new > value and rate > best_rate:
                    best_rate, best_place, best_at = rate, place, at
        if best_place < 0:
            break
        for k in range(count, best_at, -1):
            tour[k] = tour[k - 1]
        tour[best_at] = best_place
        used[best_place] = True
        count += 1
    return count, mark


@compiled
def _reverse_parts(
    tour: Any, count: int, places: Any, costs: Any, back: Any, pooled: Any, marks: Any, mark: int,
    patience: float, limit: float,
) -> int:  # fmt: skip
    """Reverse sections of the tour while this increases its value (2-opt); return the new `mark`."""
    trial = np.empty_like(tour)
    mark += 1
    value, _ = _tour_value(tour, count, places, costs, back, pooled, marks, mark, patience, limit)
    better = True
    while better:
        better = False
        for first in range(1, count - 1):
            for last in range(first + 1, min(count, first + 8)):
                trial[:count] = tour[:count]
                for k in range(first, last + 1):
                    trial[k] = tour[first + last - k]
                mark += 1
                new, cost = _tour_value(
                    trial, count, places, costs, back, pooled, marks, mark, patience, limit
                )
                if cost < math.inf and new > value * (1.0 + 1e-9):
                    tour[:count] = trial[:count]
                    value = new
                    better = True
    return mark


@compiled
def search_tour(
    places: Any, costs: Any, back: Any, pooled: Any, patience: float, limit: float, rounds: int, most: int
) -> Any:
    """Search for a tour of high value within a limit of cost, including the return.

    `places`, float64[n, 2], are the start and the candidate places, in cells. `costs`, float64[n, n], are the
    costs of the legs between the places, and `back`, float64[n], the costs of returning home. `pooled`,
    float32[W, H], is the value of observing each cell; a cell counts only once. Value earned after a cost is
    discounted by ``exp(-cost / patience)``. The tour has at most `most` places. Each of the `rounds` removes
    and refills a third of the tour.

    Return the indices of the places in flight order, int64[m], without the start, and the discounted value.
    """
    marks = np.zeros(pooled.shape, np.int64)
    mark = 0
    tour = np.zeros(min(most, len(places)), np.int64)
    used = np.zeros(len(places), np.bool_)
    used[0] = True
    count, mark = _fill(tour, 1, used, places, costs, back, pooled, marks, mark, patience, limit)
    mark = _reverse_parts(tour, count, places, costs, back, pooled, marks, mark, patience, limit)
    mark += 1
    value, _ = _tour_value(tour, count, places, costs, back, pooled, marks, mark, patience, limit)
    for number in range(rounds):
        trial, trial_used = tour.copy(), used.copy()
        # The rounds remove the first, last and middle third in turn.
        third = max(1, (count - 1) // 3)
        first = min(1 + third * (number * 2 % 3), count)
        last = min(count, first + third)
        if first == last:
            continue
        for k in range(first, last):
            trial_used[trial[k]] = False
        trial[first : count - (last - first)] = tour[last:count]
        left = count - (last - first)
        left, mark = _fill(trial, left, trial_used, places, costs, back, pooled, marks, mark, patience, limit)
        mark = _reverse_parts(trial, left, places, costs, back, pooled, marks, mark, patience, limit)
        mark += 1
        new, _ = _tour_value(trial, left, places, costs, back, pooled, marks, mark, patience, limit)
        if new > value:
            tour, used, count, value = trial, trial_used, left, new
    return tour[1:count].copy(), value
