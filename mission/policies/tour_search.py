"""Orienteering: the choice and order of places to visit within a budget, by insertion and local search.

The problem is the orienteering problem (Golden, Levy & Vohra 1987) with value along the legs, not only at
the places. Places are inserted in the order of value per cost. The tour is then improved by reversing
sections (2-opt), and by removing and refilling sections.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled


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
            # Only the cheapest position and the end are tried: trying all would square the running time.
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
    float32[W, H], is the value of observing each cell, which counts once. Value earned after a cost is
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
