"""Policies that search for routes over a map of acquisition values."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from geo.named import ParameterError
from mission.policies.acquisition import (
    Acquisition,
    Balanced,
    WithCorrelationLength,
    WithCoverage,
    make_acquisition,
)
from mission.policies.decision import Decision
from mission.policies.observation import PolicyObservation, pays_for_return
from mission.policies.planning_grid import MOST_CELLS, strip_width
from mission.policies.policy import LEAST_S, Triggers
from mission.policies.route_search import (
    COST,
    VALUE,
    candidate_places,
    leg_offsets,
    leg_values,
    neighbour_shares,
    pool,
    search_route,
    search_tour,
    take_leg,
)
from mission.policies.steering import (
    Coordination,
    Route,
    RouteProblem,
    Steering,
    far_route,
    make_coordination,
)

_RADIUS = 3  # Radius, in cells, of the neighbour shares: cells beyond it lose less than 1 % of their value
_ALTERNATIVES = 4
_LEAST_LEGS = 4
_MOST_STOPS = 40
# Bounds of the parameters. With legs of up to 1000 cells, four million end cells are compared.
_BOUNDS = {
    "share": (0.0, 1.0), "spread": (0.01, 1000.0), "every": (1, 1_000_000), "least_s": (0.0, 86_400.0),
    "caution": (0.0, 1000.0), "reach": (0.01, 1000.0), "least_weight": (0.0, 1.0),
    "longest": (1.0, 1000.0), "ahead": (1.0, 1e6), "horizon": (1.0, 1000.0), "patience": (0.1, 1e6),
    "places": (1, 1000), "near": (1, 1000), "rounds": (0, 100), "beam": (1, 1000), "interval": (0.1, 1000.0),
}  # fmt: skip
CELLS_A_LEG = 8.0
"""Approximate length of a leg of a route, in cells."""


@dataclass(kw_only=True, eq=False, repr=False)
class MapPolicy(ABC):
    """A policy that searches for routes over a map of acquisition values, and repeats the search in flight.

    Parameters
    ----------
    acquisition : str or Acquisition
        Acquisition function: the value of observing a cell.
    share, spread : float
        Observing a cell removes the fraction ``share * exp(-d^2 / spread)`` of the acquisition value of a
        cell d cells away.
    every : int
        Number of observations between two searches.
    least_s : float
        Least time between two searches, in seconds of flight.
    caution, reach : float
        Parameters of `mission.policies.acquisition.WithCoverage`.
    least_weight : float
        Parameter of `mission.policies.acquisition.Balanced`.
    coordination : {"sequential", "auction"} or Coordination
        The rule by which the vehicles of a fleet share the map (`mission.policies.steering`).

    Raises
    ------
    ParameterError
        If a parameter is out of its range.
    """

    reason: ClassVar[str]
    """Reason shown in the record of each decision."""
    _wider: ClassVar[dict[str, tuple[float, float]]] = {}  # Bounds in place of the bounds in `_BOUNDS`

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
        for name, (least, most) in (_BOUNDS | self._wider).items():
            if not least <= (value := getattr(self, name, least)) <= most:
                msg = f"{type(self).__name__}: {name}={value}: give a number from {least:g} to {most:g}"
                raise ParameterError(msg)
        self.triggers = Triggers(observations=int(self.every), least_s=float(self.least_s))
        shares = neighbour_shares(self.share, self.spread, _RADIUS)
        swept = WithCorrelationLength(make_acquisition(self.acquisition), strip_width(shares), MOST_CELLS)
        self._steering = Steering(
            Balanced(WithCoverage(swept, self.caution, self.reach), self.least_weight),
            shares,
            make_coordination(self.coordination),
        )

    def start(self) -> None:
        """Clear the memory of the previous run."""
        self._steering.start()

    def decide(self, observation: PolicyObservation) -> Decision:
        """Search for a route for each steerable vehicle."""
        return self._steering.decide(observation, self._routes, self.reason)

    def _routes(self, problem: RouteProblem) -> Sequence[Route]:
        """Return the routes of `_search`, or, if it finds none, a far leg with a route from its end."""
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
        """Return routes for the vehicle, best first; none if no cell near the vehicle has a value."""


@dataclass(kw_only=True, eq=False, repr=False)
class Greedy(MapPolicy):
    """Fly the straight leg with the greatest ratio of value to cost, and choose again after a few cells.

    Further legs are appended by the same rule, so that the vehicle always has a path ahead; the value that
    earlier legs observe does not count again. The class also has the parameters of `MapPolicy`.

    Parameters
    ----------
    longest, ahead : float
        Length of the longest leg, and of the planned path, in cells.
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


@dataclass(kw_only=True, eq=False, repr=False)
class Orienteering(MapPolicy):
    """Choose places and their order for the greatest discounted value within the remaining budget.

    The cost of a leg is the vehicle's travel cost. If the budget counts the return, the tour leaves enough of
    the budget for the return. The class also has the parameters of `MapPolicy`.

    Parameters
    ----------
    places : int
        Number of candidate places over the whole farm, and number in a window around the vehicle.
    near : int
        Side of the window around the vehicle, in cells.
    horizon, patience : float
        Greatest length of a tour, and length after which a value counts only 1/e, in cells of flight with a
        turn every few cells.
    rounds : int
        Number of improvement rounds; each round removes a part of the tour and refills it.
    """

    reason: ClassVar[str] = "tour"
    _wider: ClassVar[dict[str, tuple[float, float]]] = {"horizon": (1.0, 1e6)}

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
        # The cost per cell includes turns; otherwise expensive turns would use up the whole limit.
        per_cell = problem.costs.per_cell + problem.costs.turn / CELLS_A_LEG
        limit = min(vehicle.left, self.horizon * per_cell + float(back[0]))
        order, value = search_tour(
            places, costs, back, pooled, self.patience * per_cell, limit, int(self.rounds), _MOST_STOPS
        )
        return [Route(places[order], float(value))] if len(order) else []


@dataclass(kw_only=True, eq=False, repr=False)
class RollingHorizon(MapPolicy):
    """Fly the most valuable route of several legs up to a horizon of cost; search again after a few cells.

    A route earns the value of each cell once, and observing a cell removes a share of its neighbours' values.
    The search cannot predict what the vehicle will find, so it is repeated in flight. The class also has the
    parameters of `MapPolicy`.

    Parameters
    ----------
    horizon, patience : float
        Length of the compared routes, and length after which a value counts only 1/e, in cells of flight.
    beam, interval : int, float
        Number of routes kept in each interval of cost, and length of an interval in cells of flight.
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
        # The horizon includes turns; otherwise expensive turns would use up the whole horizon.
        horizon = self.horizon * (per_cell + problem.costs.turn / CELLS_A_LEG)
        route = search_route(
            problem.values, problem.shares, problem.planning_grid.free, problem.x, problem.y, self._offsets,
            min(horizon, problem.vehicle.left), problem.costs.turn, problem.costs.slopes,
            self.patience * per_cell, self._groups, int(self.beam),
        )  # fmt: skip
        if not len(route):
            return []
        return [Route(np.ascontiguousarray(route[:, :COST]), float(route[-1, VALUE]))]
