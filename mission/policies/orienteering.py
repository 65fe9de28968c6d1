"""The orienteering policy: a tour of candidate places within the budget, planned again on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mission.policies.map_policy import CELLS_A_LEG, MapPolicy
from mission.policies.route_search import pool
from mission.policies.steering import Route, RouteProblem
from mission.policies.tour_search import candidate_places, search_tour
from mission.policies.travel_cost import pays_for_return

_MOST_STOPS = 40


@dataclass(kw_only=True, eq=False, repr=False)
class Orienteering(MapPolicy):
    """Choose places and their order so that the legs see most, early, within what is left of the budget.

    Costs of legs are the vehicle's own travel costs, and where the budget pays for the way home it is kept.

    It takes the parameters of `MapPolicy`, too.

    Parameters
    ----------
    places : int
        Candidates over the whole farm, and as many again about the vehicle.
    near : int
        Side of the window about the vehicle, cells.
    horizon, patience : float
        Largest length of a tour, and the length after which value counts 1/e, in cells of flight with a turn
        every few of them.
    rounds : int
        Of taking a part out and filling up again.
    share, spread : float
        Seeing a cell takes ``share * exp(-d^2 / spread)`` of the acquisition value of one d cells away.
    """

    reason: ClassVar[str] = "tour"

    places: int = 49
    near: int = 14
    horizon: float = 60.0
    patience: float = 60.0
    rounds: int = 2

    def _search(self, problem: RouteProblem) -> Sequence[Route]:
        vehicle, cell_m = problem.vehicle, problem.planning_grid.cell_m
        pooled = np.empty_like(problem.values)
        pool(problem.values, problem.shares, 0, pooled.shape[0], 0, pooled.shape[1], pooled)
        pooled[~problem.planning_grid.free] = 0.0
        goals = candidate_places(pooled, problem.x, problem.y, int(self.near), int(self.places))
        places = np.vstack((np.array([[problem.x, problem.y]]), goals))
        costs = vehicle.travel_cost.legs(places * cell_m, places * cell_m)
        home = np.asarray(vehicle.request.start_xy_m)[None]
        back = (
            vehicle.travel_cost.legs(places * cell_m, home)[:, 0]
            if pays_for_return(vehicle)
            else np.zeros(len(places))
        )
        # With a turn every few cells: a vehicle whose turns cost more than its way would get nowhere.
        per_cell = problem.costs.per_cell + problem.costs.turn / CELLS_A_LEG
        limit = min(vehicle.left, self.horizon * per_cell + float(back[0]))
        order, value = search_tour(
            places, costs, back, pooled, self.patience * per_cell, limit, int(self.rounds), _MOST_STOPS
        )
        return [Route(places[order], float(value))] if len(order) else []
