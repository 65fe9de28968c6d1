"""Grid-limited randomness: in every round a random place in each cell of a grid.

Source: S. Matloob, A. Dutta, O. P. Kreidl, D. Turgut and L. Boloni, "Exploring the tradeoffs between
systematic and random exploration in mobile sensors", MSWiM 2023, and ``papers/y2023_glr`` of the authors'
repository WaterberryFarms.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely

from geo.seeds import stream
from mission.errors import PlanningError
from mission.planners.inside_routing import Terrain
from mission.planners.path import Area, Points, drop_coincident
from mission.planners.places import draw_places
from mission.planners.search import densest_feasible
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event, PolicyObservation, VehicleReport
from mission.policies.policy import NEVER_AGAIN, Triggers
from mission.policies.round_tour import insert_by_detour, shorten
from mission.policies.steering import affordable
from mission.policies.travel_cost import pays_for_return

ORDERS = ("end", "detour", "tour")
_MOST_PLACES = 4000
_MOST_CELLS = 100
_NAME = "grid-limited-randomness"


class GridLimitedRandomness:
    """Draw a place in each cell of a grid, round after round, and fly through as many as the budget allows.

    With one cell it is a random walk; the more cells, the more systematic it is. Nothing is decided in
    flight. Each vehicle draws for itself.

    Parameters
    ----------
    h_cells, v_cells : int
        Cells of the grid along x and y, over the bounds of the area.
    order : str
        How the places are ordered: ``end``, as they are drawn, cell by cell to and fro (the authors'
        GLR-EOP); ``detour``, each is put where it makes the path least longer (GLR-SD); ``tour``, a short
        tour through all of them (GLR-CA).

    Raises
    ------
    PlanningError
        If a parameter is out of its range.
    """

    def __init__(self, h_cells: int = 2, v_cells: int = 2, order: str = "tour") -> None:
        for name, count in (("h_cells", h_cells), ("v_cells", v_cells)):
            if not isinstance(count, int) or not 1 <= count <= _MOST_CELLS:
                msg = f"{_NAME}: {name} must be a whole number from 1 to {_MOST_CELLS}, not {count!r}"
                raise PlanningError(msg)
        if order not in ORDERS:
            msg = f"{_NAME}: order must be one of {', '.join(ORDERS)}, not {order!r}"
            raise PlanningError(msg)
        self._h_cells, self._v_cells = h_cells, v_cells
        self._order = order

    @property
    def triggers(self) -> Triggers:
        """Only at the start."""
        return NEVER_AGAIN

    def start(self) -> None:
        """Nothing is remembered."""

    def decide(self, observation: PolicyObservation) -> Decision:
        """Draw a path for every vehicle at the start, else go on."""
        if observation.event is not Event.START:
            return NO_CHANGE
        return Decision({one.system_id: self._path(one) for one in observation.steerable}, reason="draw")

    def _path(self, vehicle: VehicleReport) -> Points:
        request = vehicle.request
        terrain = Terrain(request.area, request.footprint_m)
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
        """Return what can be flown over of the grid's cells, row by row, to and fro."""
        x_min, y_min, x_max, y_max = terrain.flyable.bounds
        x = np.linspace(x_min, x_max, self._h_cells + 1).tolist()
        y = np.linspace(y_min, y_max, self._v_cells + 1).tolist()
        cells: list[Area] = []
        for row, (low, high) in enumerate(pairwise(y)):
            columns = list(pairwise(x))
            for left, right in columns if row % 2 == 0 else reversed(columns):
                cell = shapely.intersection(terrain.flyable, shapely.box(left, low, right, high))
                parts = [part for part in shapely.get_parts(cell) if part.area > 0.0]
                if parts:
                    cells.append(parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts))
        return cells


class _Draws:
    """The endless sequence of places, as far as it is known: one of each cell in each round."""

    def __init__(self, cells: list[Area], vehicle: VehicleReport) -> None:
        seed, name = vehicle.request.seed, f"vehicle-{vehicle.system_id}"
        self._cells = cells
        self._streams = [stream(seed, _NAME, name, f"cell-{k}") for k in range(len(cells))]
        self._drawn: list[Points] = [np.empty((0, 2)) for _ in cells]

    def first(self, count: int) -> Points:
        """Return the first so many places, float64[count, 2]."""
        rounds = -(-count // len(self._cells))
        for k, cell in enumerate(self._cells):
            while len(self._drawn[k]) < rounds:
                more = draw_places(cell, rounds - len(self._drawn[k]), self._streams[k])
                self._drawn[k] = np.vstack((self._drawn[k], more))
        together = np.stack([drawn[:rounds] for drawn in self._drawn], axis=1)
        first: Points = together.reshape(-1, 2)[:count]
        return first
