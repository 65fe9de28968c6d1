"""Short ways through given places: insertion by the shortest detour, and 2-opt."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from geo.compiled import compiled
from mission.planners.path import Points

_NEIGHBOURS = 10
_SWEEPS = 100
_LEAST_GAIN = 1e-9


def insert_by_detour(start_m: Points, places_m: Points, *, returns: bool) -> NDArray[np.int64]:
    """Order places by inserting one after the other where that makes the way least longer.

    Parameters
    ----------
    start_m : float64[2]
        Where the way begins.
    places_m : float64[n, 2]
        In the order of their insertion.
    returns : bool
        Whether the way back to the start counts, too.

    Returns
    -------
    int64[n]
        The numbers of the places in the order of the way.
    """
    following = _insert(np.vstack((start_m, places_m)), returns)
    order = np.empty(len(places_m), np.int64)
    node = 0
    for k in range(len(order)):
        node = following[node]
        order[k] = node - 1
    return order


def shorten(
    start_m: Points, places_m: Points, order: NDArray[np.int64], *, returns: bool
) -> NDArray[np.int64]:
    """Reverse parts of a way while that makes it shorter (2-opt, Croes 1958, among near neighbours).

    Parameters
    ----------
    start_m, places_m, returns
        As for `insert_by_detour`.
    order : int64[n]
        The way.

    Returns
    -------
    int64[n]
        A way that is not longer.
    """
    points = np.vstack((start_m, places_m))
    near = cKDTree(points).query(points, k=min(_NEIGHBOURS + 1, len(points)))[1].reshape(len(points), -1)
    tour = np.concatenate((np.zeros(1, np.int64), order + 1))
    _two_opt(points, near[:, 1:].astype(np.int64), tour, returns)
    shorter: NDArray[np.int64] = tour[1:] - 1
    return shorter


@compiled
def _insert(points: Any, returns: bool) -> Any:
    """Return for each point the one after it; -1 after the last."""
    count = len(points)
    following = np.full(count, -1, np.int64)
    for new in range(1, count):
        x, y = points[new, 0], points[new, 1]
        best, best_extra = -1, math.inf
        node = 0
        to_node = math.hypot(points[0, 0] - x, points[0, 1] - y)
        while node >= 0:
            after = following[node]
            extra, to_after = to_node, 0.0
            if after >= 0 or returns:
                end = max(after, 0)
                to_after = math.hypot(points[end, 0] - x, points[end, 1] - y)
                leg = math.hypot(points[end, 0] - points[node, 0], points[end, 1] - points[node, 1])
                extra += to_after - leg
            if extra < best_extra:
                best, best_extra = node, extra
            node, to_node = after, to_after
        following[new] = following[best]
        following[best] = new
    return following


@compiled
def _gain(points: Any, tour: Any, first: int, last: int, returns: bool) -> float:
    """Return what the tour gets shorter if it is reversed from behind the first position to the last one."""
    a, b, c = tour[first], tour[first + 1], tour[last]
    gain = math.hypot(points[a, 0] - points[b, 0], points[a, 1] - points[b, 1])
    gain -= math.hypot(points[a, 0] - points[c, 0], points[a, 1] - points[c, 1])
    if last + 1 < len(tour) or returns:
        d = tour[last + 1] if last + 1 < len(tour) else tour[0]
        gain += math.hypot(points[c, 0] - points[d, 0], points[c, 1] - points[d, 1])
        gain -= math.hypot(points[b, 0] - points[d, 0], points[b, 1] - points[d, 1])
    return gain


@compiled
def _two_opt(points: Any, near: Any, tour: Any, returns: bool) -> None:
    count = len(tour)
    at = np.empty(count, np.int64)
    for k in range(count):
        at[tour[k]] = k
    for _ in range(_SWEEPS):
        better = False
        for node in range(count):
            for other in near[node]:
                # The two new legs are either from both to what follows them, or from what comes before.
                for before in range(2):
                    first, last = min(at[node], at[other]) - before, max(at[node], at[other]) - before
                    if first < 0 or last <= first + 1:
                        continue
                    if _gain(points, tour, first, last, returns) > _LEAST_GAIN:
                        low, high = first + 1, last
                        while low < high:
                            tour[low], tour[high] = tour[high], tour[low]
                            low += 1
                            high -= 1
                        for k in range(first + 1, last + 1):
                            at[tour[k]] = k
                        better = True
        if not better:
            break
