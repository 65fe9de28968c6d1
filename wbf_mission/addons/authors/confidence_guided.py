"""The confidence-guided policy: fly repeatedly to the least certain cell nearby.

Source: ``papers/y2023_confidenceguided`` of the authors' repository WaterberryFarms.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from geo.seeds import stream
from geo.texts import unknown
from mission.errors import PlanningError
from mission.planners.path import Points
from mission.policies.acquisition import ValueMap
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import PolicyObservation
from mission.policies.policy import LEAST_S, Triggers
from mission.policies.route_search import neighbour_shares, take_leg
from mission.policies.steering import Route, RouteProblem, Steering

ALL = "all"
_NAME = "confidence-guided"
_MOST_SPAN = 1000
# The authors' Gaussian process has a lengthscale of 2 cells: at a distance of d cells, an observation reduces
# the variance by the fraction exp(-d^2 / 4). The fractions affect only the waypoints that are planned after
# the next waypoint.
_SHARES = neighbour_shares(1.0, 4.0, 3)
_SAME_CELLS = 0.5


class ConfidenceGuided:
    """Fly to the least certain cell in a square around the vehicle; on arrival, choose the next cell.

    Ties between equally uncertain cells are broken at random. Observations on the way do not change a chosen
    waypoint. If the square has no uncertain cell, its side is doubled. Each further waypoint is chosen as if
    the waypoints before it had been observed, so that the vehicle always has a path.

    Parameters
    ----------
    span : int
        Half the side of the square, cells.
    field : str
        Field whose uncertainty counts; ``all``: all fields, weighted as in the score.
    ahead : int
        Number of waypoints to plan.

    Raises
    ------
    PlanningError
        If a parameter is out of its range.
    """

    triggers = Triggers(waypoints=True, least_s=LEAST_S)

    def __init__(self, span: int = 5, field: str = "tylcv", ahead: int = 12) -> None:
        for name, value in (("span", span), ("ahead", ahead)):
            if not isinstance(value, int) or not 1 <= value <= _MOST_SPAN:
                msg = f"{_NAME}: {name} must be a whole number from 1 to {_MOST_SPAN}, not {value!r}"
                raise PlanningError(msg)
        self._span, self._field, self._ahead = span, field, ahead
        self._steering = Steering(self._uncertainty, _SHARES)
        self._streams: dict[int, np.random.Generator] = {}
        self._targets: dict[int, Points] = {}

    def start(self) -> None:
        """Reset the policy for a new run."""
        self._steering.start()
        self._streams, self._targets = {}, {}

    def decide(self, observation: PolicyObservation) -> Decision:
        """Choose a new waypoint for each vehicle that has reached its waypoint."""
        decision = self._steering.decide(observation, self._search, "least certain")
        paths = decision.paths.items()
        self._targets |= {system_id: points[0] for system_id, points in paths if len(points)}
        return decision if decision.changes else NO_CHANGE

    def _uncertainty(self, observation: PolicyObservation) -> ValueMap:
        names = observation.fields.names
        if self._field != ALL and self._field not in names:
            raise PlanningError(f"{_NAME}: {unknown('field', self._field, [*names, ALL])}")
        uncertainty = observation.model.uncertainty
        if self._field != ALL:
            return np.array(uncertainty[names.index(self._field)])
        weights = np.asarray(observation.weights.field, np.float32)
        return (weights[:, None, None] * uncertainty).sum(axis=0)

    def _search(self, problem: RouteProblem) -> Sequence[Route]:
        vehicle = problem.vehicle
        left, x, y = problem.values.copy(), problem.x, problem.y
        corners: list[tuple[float, float]] = []
        found: list[float] = []
        if self._on_its_way(problem):
            if len(vehicle.rest_m) > 1:
                return []
            to_x, to_y = vehicle.rest_m[0] / problem.planning_grid.cell_m
            take_leg(left, problem.shares, x, y, to_x, to_y)
            x, y = to_x, to_y
            corners.append((x, y))
        for _ in range(self._ahead):
            cell = self._least_certain(problem, left, x, y)
            if cell is None:
                break
            found.append(float(left[cell]))
            to_x, to_y = cell[0] + 0.5, cell[1] + 0.5
            take_leg(left, problem.shares, x, y, to_x, to_y)
            left[cell] = 0.0
            x, y = to_x, to_y
            corners.append((x, y))
        return [Route(np.array(corners), found[0])] if found else []

    def _on_its_way(self, problem: RouteProblem) -> bool:
        """Return whether the vehicle has not yet reached the waypoint that was chosen for it."""
        vehicle = problem.vehicle
        target = self._targets.get(vehicle.system_id)
        if target is None or not len(vehicle.rest_m):
            return False
        return float(np.hypot(*(vehicle.rest_m[0] - target))) < _SAME_CELLS * problem.planning_grid.cell_m

    def _least_certain(
        self, problem: RouteProblem, left: ValueMap, x: float, y: float
    ) -> tuple[int, int] | None:
        """Return the cell of the next waypoint; None if no uncertain cell can be reached."""
        rng = self._stream(problem)
        here = np.floor(np.array([x, y]) + 1e-9).astype(np.int64)
        span = max(1, round(self._span / problem.planning_grid.block))
        shape = np.array(left.shape)
        while True:
            low, high = np.maximum(here - span, 0), np.minimum(here + span + 1, shape)
            cells = np.stack(np.meshgrid(*map(np.arange, low, np.maximum(high, low)), indexing="ij"), axis=-1)
            cells = cells.reshape(-1, 2)
            known = left[cells[:, 0], cells[:, 1]]
            kept = (
                problem.planning_grid.free[cells[:, 0], cells[:, 1]]
                & (known > 0.0)
                & (cells != here).any(axis=1)
            )
            cells, known = cells[kept], known[kept]
            reached = self._reached(problem, x, y, cells)
            cells, known = cells[reached], known[reached]
            if len(cells):
                best = cells[known == known.max()]
                i, j = best[rng.integers(len(best))].tolist()
                return i, j
            if (low == 0).all() and (high == shape).all():
                return None
            span *= 2

    @staticmethod
    def _reached(problem: RouteProblem, x: float, y: float, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which cells a straight leg from (x, y) reaches within the area; all if (x, y) is outside."""
        planning_grid = problem.planning_grid
        here = np.array([x, y]) * planning_grid.cell_m
        if (
            planning_grid.convex
            or not len(cells)
            or not shapely.covers(planning_grid.area, shapely.Point(here))
        ):
            return np.ones(len(cells), np.bool_)
        ends = (cells + 0.5) * planning_grid.cell_m
        legs = np.stack(np.broadcast_arrays(here, ends), axis=1)
        return np.asarray(shapely.covers(planning_grid.area, shapely.linestrings(legs)))

    def _stream(self, problem: RouteProblem) -> np.random.Generator:
        number = problem.vehicle.system_id
        if number not in self._streams:
            self._streams[number] = stream(problem.vehicle.request.seed, _NAME, f"vehicle-{number}")
        return self._streams[number]
