"""A policy that looks ahead: the best route up to a horizon, found anew as soon as more is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mission.policies.acquisition import Acquisition
from mission.policies.coordination import Coordination
from mission.policies.map_policy import CELLS_A_LEG, MapPolicy
from mission.policies.route_search import COST, WORTH, leg_offsets, search_route
from mission.policies.steering import Route, RouteProblem


class RollingHorizon(MapPolicy):
    """Fly the route of several legs that gains most up to a horizon; search again after a few cells.

    The search foresees what its own legs will leave to be seen: a cell is worth something once, and seeing it
    takes a share of its neighbours' worth. It does not foresee what will be found; so it searches again.

    Parameters
    ----------
    acquisition : str or Acquisition
        What seeing a cell is worth.
    horizon, patience : float
        How far routes are compared, and the length after which worth counts 1/e, in cells of flight.
    share, spread : float
        Seeing a cell takes ``share * exp(-d^2 / spread)`` of the worth of one d cells away.
    beam, interval : int, float
        Routes kept in each interval of cost, and its length in cells of flight.
    every : int
        Search again after so many observations.
    least_s : float
        But not before so many seconds of flight.
    caution, reach : float
        See `mission.policies.acquisition.WithCoverage`.
    least_weight : float
        See `mission.policies.acquisition.Balanced`.
    coordination : {"sequential", "auction"} or Coordination
        Who of a fleet flies where (`mission.policies.coordination`).
    """

    reason = "looked ahead"

    def __init__(
        self,
        acquisition: str | Acquisition = "expected-loss",
        horizon: float = 40.0,
        patience: float = 60.0,
        share: float = 0.2,
        spread: float = 4.5,
        beam: int = 8,
        interval: float = 5.0,
        every: int = 2,
        least_s: float = 1.0,
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
        self._horizon = float(horizon)
        self._patience = float(patience)
        self._beam = int(beam)
        self._groups = max(1, round(horizon / interval))
        self._offsets = leg_offsets(max(1, int(horizon)))

    def _search(self, problem: RouteProblem) -> Sequence[Route]:
        per_cell = problem.costs.per_cell
        # With a turn every few cells: a vehicle whose turns cost more than its way would see nothing ahead.
        horizon = self._horizon * (per_cell + problem.costs.turn / CELLS_A_LEG)
        route = search_route(
            problem.worth, problem.shares, problem.chart.free, problem.x, problem.y, self._offsets,
            min(horizon, problem.vehicle.left), problem.costs.turn, problem.costs.slopes,
            self._patience * per_cell, self._groups, self._beam,
        )  # fmt: skip
        if not len(route):
            return []
        return [Route(np.ascontiguousarray(route[:, :COST]), float(route[-1, WORTH]))]
