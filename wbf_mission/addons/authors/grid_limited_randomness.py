"""Grid-limited randomness: a policy that visits, in each round, a random place in each cell of a grid.

Source: S. Matloob, A. Dutta, O. P. Kreidl, D. Turgut and L. Boloni, "Exploring the tradeoffs between
systematic and random exploration in mobile sensors", MSWiM 2023, and ``papers/y2023_glr`` of the authors'
repository WaterberryFarms.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from geo.compiled import compiled
from geo.seeds import stream
from mission.errors import PlanningError
from mission.planners.path import Area, Points, drop_coincident
from mission.planners.search import densest_feasible
from mission.planners.terrain import Terrain, area_of, draw_places, polygons_of
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event, PolicyObservation, VehicleReport, pays_for_return
from mission.policies.policy import NEVER_AGAIN
from mission.policies.steering import affordable

ORDERS = ("end", "detour", "tour")
_MOST_PLACES = 4000
_MOST_CELLS = 100
_NAME = "grid-limited-randomness"


class GridLimitedRandomness:
    """Draw a random place in each cell of a grid, round by round, and visit as many as the budget allows.

    With a grid of one cell, the path is a random walk; more cells make the path more systematic. The path is
    not changed in flight. Each vehicle draws separate places.

    Parameters
    ----------
    h_cells, v_cells : int
        Number of cells along x and y, over the bounds of the area.
    order : str
        Order of the places. ``end``: row by row of cells, to and fro (the authors' GLR-EOP). ``detour``: each
        place is inserted where it lengthens the path least (GLR-SD). ``tour``: a tour of all places (GLR-CA).

    Raises
    ------
    PlanningError
        If a parameter is out of its range.
    """

    triggers = NEVER_AGAIN

    def __init__(self, h_cells: int = 2, v_cells: int = 2, order: str = "tour") -> None:
        for name, count in (("h_cells", h_cells), ("v_cells", v_cells)):
            if not isinstance(count, int) or not 1 <= count <= _MOST_CELLS:
                msg = f"{_NAME}: {name} must be a whole number from 1 to {_MOST_CELLS}, not {count!r}"
                raise PlanningError(msg)
        if order not in ORDERS:
            raise PlanningError(f"{_NAME}: order must be one of {', '.join(ORDERS)}, not {order!r}")
        self._h_cells, self._v_cells = h_cells, v_cells
        self._order = order

    def start(self) -> None:
        """Do nothing: the policy has no state."""

    def decide(self, observation: PolicyObservation) -> Decision:
        """Draw a path for each vehicle at the start; later return no change."""
        if observation.event is not Event.START:
            return NO_CHANGE
        return Decision({one.system_id: self._path(one) for one in observation.steerable}, reason="draw")

    def _path(self, vehicle: VehicleReport) -> Points:
        request = vehicle.request
        terrain = Terrain(request.area, request.footprint_m, request.passable)
        draws = _Draws(self._grid(terrain), vehicle)
        start = np.asarray(request.start_xy_m)
        returns = pays_for_return(vehicle)

        def path(count: int) -> Points:
            places = draws.first(count)
            if self._order != "end":
                order = insert_by_detour(start, places, returns=returns)
                if self._order == "tour":
                    order = shorten(start, places, order, returns=returns)
                places = places[order]
            return drop_coincident(terrain.join(list(places[:, None, :]), start))

        found = densest_feasible(request, path, 1, _MOST_PLACES, what=f"{_NAME} with one place")
        points = found.points_m
        if self._order == "end" and found.index < _MOST_PLACES:
            points = path(found.index + 1)
        return affordable(vehicle, points)

    def _grid(self, terrain: Terrain) -> list[Area]:
        """Return the flyable part of each grid cell, row by row in alternating directions."""
        x_min, y_min, x_max, y_max = terrain.flyable.bounds
        x = np.linspace(x_min, x_max, self._h_cells + 1).tolist()
        y = np.linspace(y_min, y_max, self._v_cells + 1).tolist()
        cells: list[Area] = []
        for row, (low, high) in enumerate(pairwise(y)):
            columns = list(pairwise(x))
            for left, right in columns if row % 2 == 0 else reversed(columns):
                cell = shapely.intersection(terrain.flyable, shapely.box(left, low, right, high))
                if parts := polygons_of(cell):
                    cells.append(area_of(parts))
        return cells


class _Draws:
    """Endless sequence of random places, drawn on demand: in each round, one place per grid cell."""

    def __init__(self, cells: list[Area], vehicle: VehicleReport) -> None:
        seed, name = vehicle.request.seed, f"vehicle-{vehicle.system_id}"
        self._cells = cells
        self._streams = [stream(seed, _NAME, name, f"cell-{k}") for k in range(len(cells))]
        self._drawn: list[Points] = [np.empty((0, 2)) for _ in cells]

    def first(self, count: int) -> Points:
        """Return the first `count` places, float64[count, 2]."""
        rounds = -(-count // len(self._cells))
        for k, cell in enumerate(self._cells):
            while len(self._drawn[k]) < rounds:
                more = draw_places(cell, rounds - len(self._drawn[k]), self._streams[k])
                self._drawn[k] = np.vstack((self._drawn[k], more))
        together = np.stack([drawn[:rounds] for drawn in self._drawn], axis=1)
        return together.reshape(-1, 2)[:count]


_NEIGHBOURS = 10
_SWEEPS = 100
_LEAST_GAIN = 1e-9


def insert_by_detour(start_m: Points, places_m: Points, *, returns: bool) -> NDArray[np.int64]:
    """Return an order of the places: each place is inserted where it lengthens the path least."""
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
    """Return a better order: parts are reversed while this shortens the path (2-opt with near neighbours)."""
    points = np.vstack((start_m, places_m))
    near = cKDTree(points).query(points, k=min(_NEIGHBOURS + 1, len(points)))[1].reshape(len(points), -1)
    tour = np.concatenate((np.zeros(1, np.int64), order + 1))
    _two_opt(points, near[:, 1:].astype(np.int64), tour, returns)
    return tour[1:] - 1


@compiled
def _insert(points: Any, returns: bool) -> Any:
    """Return the successor of each point in the path; -1 for the last point."""
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
    """Return the length that is saved if the tour's part from `first + 1` to `last` is reversed."""
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
                # One new leg joins `node` and `other`, the other leg their successors or their predecessors.
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
