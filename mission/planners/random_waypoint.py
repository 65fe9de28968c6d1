"""The planner random-waypoint: straight legs between random positions until the budget is used."""

from __future__ import annotations

import math

import numpy as np
import shapely
from shapely.geometry import Point

from mission.errors import PlanningError
from mission.planners.path import PlannedPath, Points, drop_coincident, path_length
from mission.planners.request import PlanningRequest
from mission.planners.search import densest_feasible
from mission.planners.terrain import TOLERANCE_M, Terrain, draw_places

MAX_WAYPOINTS = 30_000
_FIRST_BLOCK = 16
_CUTS = 10  # Greatest number of lengths tried for the last leg.
_UNUSED = 1e-6  # Fraction of the budget that may remain unused.
# If a circle with the least leg as radius covers more than this of the area, near positions are skipped.
_OFTEN = 1 / 6
_MOST_PASSED = 64  # If this number of draws is rejected, the farthest draw is taken.
# A leg turns straight back if the sum of its unit vector and the previous leg's is shorter than this.
_BACK = 0.03


def random_waypoint(request: PlanningRequest, /, *, waypoints: int | None = None) -> PlannedPath:
    """Plan straight legs between uniformly distributed random positions of the area.

    A leg that would leave the area is replaced by the shortest path inside the area. The last leg is cut to
    use up the budget. A seed gives the same positions in the same order for every budget. On land where many
    legs would be shorter than `least_leg_m`, positions near the previous position are skipped.

    The path begins at the start, or at the nearest point of the inset area if the start is outside.

    Parameters
    ----------
    waypoints : int, optional
        Greatest number of positions. Default: as many as the budget allows.

    Raises
    ------
    PlanningError
        If the budget is too small to reach the area (and return); the text gives the least budget. If
        `waypoints` is out of range.

    Examples
    --------
    >>> from mission.planners.budget import LengthBudget
    >>> path = random_waypoint(PlanningRequest(shapely.box(0, 0, 30, 30), (5, 5), LengthBudget(360.0)))
    >>> 359.9 < path.length_m <= 360.0
    True
    """
    most = MAX_WAYPOINTS if waypoints is None else waypoints
    if not isinstance(most, int) or isinstance(most, bool) or not 1 <= most <= MAX_WAYPOINTS:
        raise PlanningError(
            f"random-waypoint: waypoints must be a whole number from 1 to {MAX_WAYPOINTS}, not {waypoints!r}"
        )
    walk = _Walk(request)
    budget = request.budget
    count = min(_FIRST_BLOCK, most)
    while (cost := request.cost(walk.path(count))) <= budget.limit and count < most:
        wanted = count * budget.limit / cost if cost > 0 else math.inf
        count = math.ceil(min(most, max(1.1 * wanted + 1, count + 1), 16 * count))
    found = densest_feasible(
        request, walk.path, 0, count, what="random-waypoint, to reach the area,", density=walk.length
    )
    points = found.points_m
    if found.index < count:
        points = _use_up(request, points, walk.legs[found.index + 1], found.cost)
    return PlannedPath(drop_coincident(points, 1e-6), None, "random-waypoint")


class _Walk:
    """An endless random walk; its positions are drawn on demand."""

    def __init__(self, request: PlanningRequest) -> None:
        self._terrain = Terrain(request.area, request.footprint_m, request.passable, request.least_leg_m)
        self._rng = np.random.default_rng(request.seed)
        self._drawn = np.empty((0, 2))
        start = Point(request.start_xy_m)
        flyable = self._terrain.flyable
        least_m = request.least_leg_m
        self._apart_m = least_m if math.pi * least_m**2 > _OFTEN * flyable.area else 0.0
        line = shapely.shortest_line(start, flyable)
        entry = shapely.get_coordinates(line)[-1]
        self._start = np.asarray(request.start_xy_m, dtype=np.float64)
        self.legs: list[Points] = self._terrain.legs([entry[None]], self._start)
        self._lengths = [path_length(np.vstack((self._start, self.legs[0])))]

    def path(self, waypoints: int) -> Points:
        """Return the path through the first `waypoints` random positions."""
        self._extend(waypoints)
        return np.vstack(self.legs[: waypoints + 1])

    def length(self, waypoints: int) -> float:
        """Return the length of `path(waypoints)`, including the leg from the start."""
        self._extend(waypoints)
        return self._lengths[waypoints]

    def _extend(self, waypoints: int) -> None:
        missing = waypoints + 1 - len(self.legs)
        if missing <= 0:
            return
        places = self._places(missing) if self._apart_m == 0.0 else self._places_apart(missing)
        for leg in self._terrain.legs(list(places[:, None, :]), self.legs[-1][-1]):
            way = np.vstack((self.legs[-1][-1], leg))
            self._lengths.append(self._lengths[-1] + path_length(way))
            self.legs.append(leg)

    def _places(self, count: int) -> Points:
        """Draw the next waypoints, float64[n, 2]."""
        while len(self._drawn) < count:
            self._drawn = np.vstack((self._drawn, draw_places(self._terrain.flyable, count, self._rng)))
        places, self._drawn = self._drawn[:count], self._drawn[count:]
        return places

    def _places_apart(self, count: int) -> Points:
        """Return the next positions; skip positions whose leg would be too short or turn straight back."""
        found = [self.legs[-2][-1] if len(self.legs) > 1 else self._start, self.legs[-1][-1]]
        while len(found) < count + 2:
            drawn = self._places(_MOST_PASSED)
            steps, come = drawn - found[-1], found[-1] - found[-2]
            away_m = np.hypot(*steps.T)
            turn = steps / np.maximum(away_m, 1e-9)[:, None] + come / max(math.hypot(*come), 1e-9)
            away_m[np.hypot(*turn.T) < _BACK] = 0.0
            far = np.flatnonzero(away_m >= self._apart_m)
            taken = int(far[0] if len(far) else np.argmax(away_m))
            found.append(drawn[taken])
            # Return unused draws to the stream.
            self._drawn = np.vstack((drawn[taken + 1 :] if len(far) else drawn[:0], self._drawn))
        return np.array(found[2:])


def _use_up(request: PlanningRequest, points: Points, leg: Points, spent: float) -> Points:
    """Return the path extended by as much of the next leg as the budget allows."""
    limit = request.budget.limit
    way = np.vstack((points[-1], leg))
    reach = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))))
    good, bad = 0.0, float(reach[-1])
    good_cost, bad_cost = spent, request.cost(np.vstack((points, leg)))
    best = points
    for attempt in range(_CUTS):
        if limit - good_cost <= _UNUSED * limit or bad - good <= _UNUSED * reach[-1]:
            break
        share = 0.5
        if attempt % 3 < 2 and bad_cost > good_cost:
            share = (limit * (1 - _UNUSED / 2) - good_cost) / (bad_cost - good_cost)
        middle = good + min(max(share, 0.01), 0.99) * (bad - good)
        last = int(np.searchsorted(reach, middle))
        share = (middle - reach[last - 1]) / (reach[last] - reach[last - 1])
        cut = way[last - 1] + share * (way[last] - way[last - 1])
        candidate = np.vstack((points, way[1:last], cut))
        cost = request.cost(candidate)
        if cost <= limit:
            good, good_cost = middle, cost
            # A leg between separate parts may cross forbidden land, but the path must not end on such land.
            if shapely.dwithin(request.room, Point(cut), TOLERANCE_M):
                best = candidate
        else:
            bad, bad_cost = middle, cost
    return best
