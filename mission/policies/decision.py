"""Decisions of policies, and their validation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import shapely
from numpy.typing import NDArray

from mission.errors import AnswerError, PlanningError
from mission.planners.path import Points, path_points
from mission.policies.observation import PolicyObservation, VehicleReport

_INSIDE_M = 1e-6
_OF_LIMIT = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Alternative:
    """A candidate path, for the record of a run.

    Parameters
    ----------
    system_id : int
        System id of the vehicle.
    points_m : float64[n, 2]
        Points of the path, in metres of the farm frame.
    value : float
        Expected value in the policy's own measure; higher is better.
    cost : float
        Cost of the path, in the unit of the vehicle's budget.
    """

    system_id: int
    points_m: Points
    value: float
    cost: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "points_m", np.reshape(self.points_m, (-1, 2)))


@dataclass(frozen=True, slots=True, eq=False)
class AcquisitionMap:
    """Map of the acquisition values from which a decision was made.

    Parameters
    ----------
    values : float32[w, h]
        Values of square blocks in the policy's own measure, block (0, 0) at the origin of the farm frame; 0
        where no vehicle may fly.
    cell_m : float
        Side of a block, metres.
    """

    values: NDArray[np.float32]
    cell_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """New paths of vehicles, or no change.

    Parameters
    ----------
    paths : mapping of int to float64[n, 2]
        New points ahead of each vehicle, by system id, in metres of the farm frame. After the last point the
        vehicle flies home. With a path without points it flies home now, or stays on the ground at the start.
        (The ideal robot does not return; its flight ends there.) Vehicles without an entry keep their paths.
    reason : str
        Reason in a few words, for the record.
    alternatives : tuple of Alternative
        All candidates including the chosen paths, best first.
    spacing_m : mapping of int to float
        Row spacing of paths with rows, by system id; for reports.
    acquisition : AcquisitionMap or None
        Acquisition map behind the paths, for viewers.

    Raises
    ------
    AnswerError
        If a path is not an array of finite (x, y) pairs.

    Examples
    --------
    >>> NO_CHANGE.changes
    False
    >>> Decision({1: [[0.0, 0.0], [5.0, 0.0]]}).paths[1].shape
    (2, 2)
    """

    paths: Mapping[int, Points] = field(default_factory=dict)
    reason: str = ""
    alternatives: tuple[Alternative, ...] = ()
    spacing_m: Mapping[int, float] = field(default_factory=dict)
    acquisition: AcquisitionMap | None = None

    def __post_init__(self) -> None:
        taken = {
            int(system_id): path_points(points, f"vehicle {system_id}: ")
            for system_id, points in self.paths.items()
        }
        object.__setattr__(self, "paths", MappingProxyType(taken))
        object.__setattr__(self, "spacing_m", MappingProxyType(dict(self.spacing_m)))

    @property
    def changes(self) -> bool:
        """Whether any vehicle gets a new path."""
        return bool(self.paths)


NO_CHANGE = Decision()
"""Decision that keeps the paths of all vehicles."""


def answer_costs(name: str, answer: object, observation: PolicyObservation) -> dict[int, float]:
    """Validate a policy's answer; return the cost of each path by system id, in the unit of its budget."""
    if not isinstance(answer, Decision):
        raise AnswerError(f"{name} answered with a {type(answer).__name__}, not a Decision", "no Decision")
    costs = {}
    for system_id, points in answer.paths.items():
        try:
            vehicle = observation.vehicle(system_id)
        except PlanningError as error:
            raise AnswerError(f"{name}: {error}", "wrong vehicle") from None
        costs[system_id] = _checked_cost(name, vehicle, points)
    return costs


def _checked_cost(name: str, vehicle: VehicleReport, points: Points) -> float:
    """Return the cost of a new path; raise AnswerError if the vehicle must not fly the path."""
    who = name if vehicle.system_id == 1 else f"{name}, vehicle {vehicle.system_id},"
    if not vehicle.steerable:
        msg = f"{who} changes the path of a vehicle that is {vehicle.status.value}"
        raise AnswerError(msg, "not steerable")
    cost = vehicle.travel_cost.rest([points])[0]
    budget = vehicle.request.budget
    # The direct return is always allowed, even if wind or an obstacle makes it cost more than the budget.
    if len(points) and not cost <= vehicle.left + budget.limit * _OF_LIMIT:
        over = f"the budget of {budget.limit:g} {budget.unit}"
        if vehicle.spent > 0.0:
            over = f"the {vehicle.left:.6g} {budget.unit} left of the budget of {budget.limit:g}"
        msg = f"{who} returned a path that takes {cost:.6g} {budget.unit}, over {over}"
        raise AnswerError(msg, "over the budget")
    area = vehicle.request.room
    # A path may cross from one separate part to another in a straight line.
    room = area.convex_hull if isinstance(area, shapely.MultiPolygon) else area
    if len(points):
        line = shapely.LineString(points) if len(points) > 1 else shapely.Point(points[0])
        allowed = shapely.buffer(room, _INSIDE_M)
        if not shapely.covers(allowed, line):
            x_m, y_m = shapely.get_coordinates(shapely.difference(line, allowed))[0]
            msg = f"{who} returned a path that leaves its area (request.room) at ({x_m:.1f}, {y_m:.1f}) m"
            raise AnswerError(msg, "outside the area")
    return cost
