"""The greedy policy: always the straight leg that gains most for what it costs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mission.policies.acquisition import Acquisition
from mission.policies.coordination import Coordination
from mission.policies.leg_search import leg_values
from mission.policies.map_policy import MapPolicy
from mission.policies.policy import LEAST_S
from mission.policies.route_search import leg_offsets, pool, take_leg
from mission.policies.steering import Route, RouteProblem

_ALTERNATIVES = 4
_LEAST_LEGS = 4


class Greedy(MapPolicy):
    """Fly the straight leg whose cells are worth most by what the leg costs; choose again after a few cells.

    So that there is always a path, further legs are chosen after it as if nothing were found.

    Parameters
    ----------
    acquisition : str or Acquisition
        What seeing a cell is worth.
    share, spread : float
        Seeing a cell takes ``share * exp(-d^2 / spread)`` of the worth of one d cells away.
    longest, ahead : float
        Length of the longest leg, and of the path that is planned, in cells.
    every : int
        Choose again after so many observations.
    least_s : float
        But not before so many seconds of flight.
    caution, reach : float
        See `mission.policies.acquisition.WithCoverage`.
    least_weight : float
        See `mission.policies.acquisition.Balanced`.
    coordination : {"sequential", "auction"} or Coordination
        Who of a fleet flies where (`mission.policies.coordination`).
    """

    reason = "most for its cost"

    def __init__(
        self,
        acquisition: str | Acquisition = "expected-loss",
        share: float = 0.12,
        spread: float = 4.5,
        longest: float = 40.0,
        ahead: float = 60.0,
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
        self._offsets = leg_offsets(max(1, int(longest)))
        self._ahead = float(ahead)

    def _search(self, problem: RouteProblem) -> Sequence[Route]:
        shares, free = problem.shares, problem.chart.free
        left, pooled = problem.worth.copy(), np.empty_like(problem.worth)
        values, costs = np.empty((2, len(self._offsets)))
        x, y, spent, gained = problem.x, problem.y, 0.0, 0.0
        limit = min(self._ahead * problem.costs.per_cell, problem.vehicle.left)
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
