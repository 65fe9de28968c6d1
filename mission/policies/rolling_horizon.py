"""A policy that looks ahead: the best route up to a horizon, found anew as soon as more is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mission.policies.map_policy import CELLS_A_LEG, MapPolicy
from mission.policies.route_search import COST, VALUE, leg_offsets, search_route
from mission.policies.steering import Route, RouteProblem


@dataclass(kw_only=True, eq=False, repr=False)
class RollingHorizon(MapPolicy):
    """Fly the route of several legs that gains most up to a horizon; search again after a few cells.

    The search foresees what its own legs will leave to be seen: a cell is worth something once, and seeing it
    takes a share of its neighbours' values. It does not foresee what will be found; so it searches again.

    It takes the parameters of `MapPolicy`, too.

    Parameters
    ----------
    horizon, patience : float
        How far routes are compared, and the length after which value counts 1/e, in cells of flight.
    share, spread : float
        Seeing a cell takes ``share * exp(-d^2 / spread)`` of the acquisition value of one d cells away.
    beam, interval : int, float
        Routes kept in each interval of cost, and its length in cells of flight.
    """

    reason: ClassVar[str] = "looked ahead"

    horizon: float = 40.0
    patience: float = 60.0
    share: float = 0.2
    beam: int = 8
    interval: float = 5.0
    every: int = 2
    least_s: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._groups = max(1, round(self.horizon / self.interval))
        self._offsets = leg_offsets(max(1, int(self.horizon)))

    def _search(self, problem: RouteProblem) -> Sequence[Route]:
        per_cell = problem.costs.per_cell
        # With a turn every few cells: a vehicle whose turns cost more than its way would see nothing ahead.
        horizon = self.horizon * (per_cell + problem.costs.turn / CELLS_A_LEG)
        route = search_route(
            problem.values, problem.shares, problem.planning_grid.free, problem.x, problem.y, self._offsets,
            min(horizon, problem.vehicle.left), problem.costs.turn, problem.costs.slopes,
            self.patience * per_cell, self._groups, int(self.beam),
        )  # fmt: skip
        if not len(route):
            return []
        return [Route(np.ascontiguousarray(route[:, :COST]), float(route[-1, VALUE]))]
