"""The greedy policy: always the straight leg that gains most for what it costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mission.policies.leg_search import leg_values
from mission.policies.map_policy import MapPolicy
from mission.policies.route_search import leg_offsets, pool, take_leg
from mission.policies.steering import Route, RouteProblem

_ALTERNATIVES = 4
_LEAST_LEGS = 4


@dataclass(kw_only=True, eq=False, repr=False)
class Greedy(MapPolicy):
    """Fly the straight leg whose cells are worth most by what the leg costs; choose again after a few cells.

    So that there is always a path, further legs are chosen after it as if nothing were found.

    It takes the parameters of `MapPolicy`, too.

    Parameters
    ----------
    share, spread : float
        Seeing a cell takes ``share * exp(-d^2 / spread)`` of the acquisition value of one d cells away.
    longest, ahead : float
        Length of the longest leg, and of the path that is planned, in cells.
    """

    reason: ClassVar[str] = "most for its cost"

    longest: float = 40.0
    ahead: float = 60.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._offsets = leg_offsets(max(1, int(self.longest)))

    def _search(self, problem: RouteProblem) -> Sequence[Route]:
        shares, free = problem.shares, problem.planning_grid.free
        left, pooled = problem.values.copy(), np.empty_like(problem.values)
        values, costs = np.empty((2, len(self._offsets)))
        x, y, spent, gained = problem.x, problem.y, 0.0, 0.0
        limit = min(self.ahead * problem.costs.per_cell, problem.vehicle.left)
        corners: list[tuple[float, float]] = []
        others: list[Route] = []
        while spent < limit or (len(corners) < _LEAST_LEGS and spent < problem.vehicle.left):
            pool(left, shares, 0, left.shape[0], 0, left.shape[1], pooled)
            leg_values(
                pooled, free, x, y, self._offsets, problem.costs.turn, problem.costs.slopes, values, costs
            )
            rates = np.where(values > 0.0, values / np.where(values > 0.0, costs, 1.0), 0.0)
            best = int(np.argmax(rates))
            if rates[best] <= 0.0:
                break
            here = np.floor(np.array([x, y]) + 1e-9)
            ends = (here + self._offsets + 0.5).astype(np.float64)
            if not corners:
                order = np.argsort(-rates, kind="stable")[1:_ALTERNATIVES]
                others = [Route(ends[k : k + 1], float(values[k])) for k in order if rates[k] > 0.0]
            to_x, to_y = ends[best].tolist()
            take_leg(left, shares, x, y, to_x, to_y)
            x, y = to_x, to_y
            corners.append((x, y))
            spent += float(costs[best])
            gained += float(values[best])
        return [Route(np.array(corners), gained), *others] if corners else []
