"""The orienteering policy: a tour of candidate places within the budget, planned again on the way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mission.policies.acquisition import Acquisition
from mission.policies.coordination import Coordination
from mission.policies.fares import pays_for_return
from mission.policies.map_policy import CELLS_A_LEG, MapPolicy
from mission.policies.policy import LEAST_S
from mission.policies.route_search import pool
from mission.policies.steering import Route, RouteProblem
from mission.policies.tour_search import candidate_places, search_tour

_MOST_STOPS = 40


class Orienteering(MapPolicy):
    """Choose places and their order so that the legs see most, early, within what is left of the budget.

    Costs of legs are the vehicle's own fares, and where the budget pays for the way home it is kept.

    Parameters
    ----------
    acquisition : str or Acquisition
        What seeing a cell is worth.
    places : int
        Candidates over the whole farm, and as many again about the vehicle.
    near : int
        Side of the window about the vehicle, cells.
    horizon, patience : float
        Largest length of a tour, and the length after which worth counts 1/e, in cells of flight with a turn
        every few of them.
    rounds : int
        Of taking a part out and filling up again.
    share, spread : float
        Seeing a cell takes ``share * exp(-d^2 / spread)`` of the worth of one d cells away.
    every : int
        Plan again after so many observations.
    least_s : float
        But not before so many seconds of flight.
    caution, reach : float
        See `mission.policies.acquisition.WithCoverage`.
    least_weight : float
        See `mission.policies.acquisition.Balanced`.
    coordination : {"sequential", "auction"} or Coordination
        Who of a fleet flies where (`mission.policies.coordination`).
    """

    reason = "tour"

    def __init__(
        self,
        acquisition: str | Acquisition = "expected-loss",
        places: int = 49,
        near: int = 14,
        horizon: float = 60.0,
        patience: float = 60.0,
        rounds: int = 2,
        share: float = 0.12,
        spread: float = 4.5,
        every: int = 5,
        least_s: float = LEAST_S,
        caution: float = 0.0,
        reach: float = 3.0,
        least_weight: float = 0.0,
        coordination: str | Coordination = "sequential",
    ) -> None:
        super().__init__(
            acquisition=acquisition,
            share=share,
            spread=spread,
            every=every,
            least_s=least_s,
            caution=caution,
            reach=reach,
            least_weight=least_weight,
            coordination=coordination,
        )
        self._places, self._near = int(places), int(near)
        self._horizon, self._patience = float(horizon), float(patience)
        self._rounds = int(rounds)

    def _search(self, problem: RouteProblem) -> Sequence[Route]:
        vehicle, cell_m = problem.vehicle, problem.chart.cell_m
        pooled = np.empty_like(problem.worth)
        pool(problem.worth, problem.shares, 0, pooled.shape[0], 0, pooled.shape[1], pooled)
        pooled[~problem.chart.free] = 0.0
        goals = candidate_places(pooled, problem.x, problem.y, self._near, self._places)
        places = np.vstack((np.array([[problem.x, problem.y]]), goals))
        costs = vehicle.fares.legs(places * cell_m, places * cell_m)
        home = np.asarray(vehicle.request.start_xy_m)[None]
        back = (
            vehicle.fares.legs(places * cell_m, home)[:, 0]
            if pays_for_return(vehicle)
            else np.zeros(len(places))
        )
        # With a turn every few cells: a vehicle whose turns cost more than its way would get nowhere.
        per_cell = problem.costs.per_cell + problem.costs.turn / CELLS_A_LEG
        limit = min(vehicle.left, self._horizon * per_cell + float(back[0]))
        order, value = search_tour(
            places, costs, back, pooled, self._patience * per_cell, limit, self._rounds, _MOST_STOPS
        )
        return [Route(places[order], float(value))] if len(order) else []
