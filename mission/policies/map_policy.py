"""What policies have in common that search routes over a map of acquisition values."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from mission.policies.acquisition import Acquisition, Balanced, WithCoverage, WithReach, make_acquisition
from mission.policies.coordination import Coordination, make_coordination
from mission.policies.decision import Decision
from mission.policies.observation import PolicyObservation
from mission.policies.planning_grid import MOST_CELLS, strip_width
from mission.policies.policy import LEAST_S, Triggers
from mission.policies.route_search import neighbour_shares, take_leg
from mission.policies.steering import Route, RouteProblem, Steering, far_route

_RADIUS = 3
CELLS_A_LEG = 8.0
"""About how far a route flies between two turns."""


@dataclass(kw_only=True, eq=False, repr=False)
class MapPolicy(ABC):
    """Search a route for each vehicle on the map of what seeing each cell is worth; again when more is seen.

    Parameters
    ----------
    acquisition : str or Acquisition
        What seeing a cell is worth.
    share, spread : float
        Seeing a cell takes ``share * exp(-d^2 / spread)`` of the acquisition value of one d cells away.
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

    reason: ClassVar[str]
    """What is noted of each decision."""

    acquisition: str | Acquisition = "expected-loss"
    share: float = 0.12
    spread: float = 4.5
    every: int = 5
    least_s: float = LEAST_S
    caution: float = 0.0
    reach: float = 3.0
    least_weight: float = 0.0
    coordination: str | Coordination = "sequential"

    def __post_init__(self) -> None:
        shares = neighbour_shares(self.share, self.spread, _RADIUS)
        swept = WithReach(make_acquisition(self.acquisition), strip_width(shares), MOST_CELLS)
        self._steering = Steering(
            Balanced(WithCoverage(swept, self.caution, self.reach), self.least_weight),
            shares,
            make_coordination(self.coordination),
        )

    @property
    def triggers(self) -> Triggers:
        """After some observations."""
        return Triggers(observations=int(self.every), least_s=float(self.least_s))

    def start(self) -> None:
        """Forget the run before."""
        self._steering.start()

    def decide(self, observation: PolicyObservation) -> Decision:
        """Search a route for every vehicle, in turn."""
        return self._steering.decide(observation, self._routes, self.reason)

    def _routes(self, problem: RouteProblem) -> Sequence[Route]:
        """Search; where nothing is to be gained near the vehicle, go far first and search on from there."""
        routes = self._search(problem)
        far = [] if routes else far_route(problem)
        if not far:
            return routes
        x, y = far[0].corners[-1].tolist()
        values = problem.values.copy()
        take_leg(values, problem.shares, problem.x, problem.y, x, y)
        onward = self._search(replace(problem, values=values, x=x, y=y))
        if not onward:
            return far
        corners = np.vstack((far[0].corners, onward[0].corners))
        return [Route(corners, far[0].value + onward[0].value)]

    @abstractmethod
    def _search(self, problem: RouteProblem) -> Sequence[Route]:
        """Return routes of one vehicle, the best first; none if there is nothing to gain near it."""
