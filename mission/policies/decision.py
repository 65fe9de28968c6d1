"""What a policy answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import shapely
from numpy.typing import NDArray

from mission.errors import AnswerError, PlanningError
from mission.planners.path import Points
from mission.policies.observation import PolicyObservation, VehicleReport

_INSIDE_M = 1e-6
_OF_LIMIT = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Alternative:
    """A path that was thought of, for the record of a run.

    Parameters
    ----------
    system_id : int
        For which vehicle.
    points_m : float64[n, 2]
        Metres of the farm frame.
    value : float
        What it promises, in the policy's own measure; more is better.
    cost : float
        What it costs, in the unit of the vehicle's budget.
    """

    system_id: int
    points_m: Points
    value: float
    cost: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "points_m", np.reshape(self.points_m, (-1, 2)))


@dataclass(frozen=True, slots=True, eq=False)
class AcquisitionMap:
    """What a policy thought that seeing each place is worth, before it chose.

    Parameters
    ----------
    values : float32[w, h]
        Of square blocks, block (0, 0) at the origin of the farm frame, in the policy's own measure; 0 where
        no vehicle may fly.
    cell_m : float
        Side of a block, metres.
    """

    values: NDArray[np.float32]
    cell_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """New rests of the paths of one or several vehicles, or to go on.

    Parameters
    ----------
    paths : mapping of int to float64[n, 2]
        By system id the points to fly through from now on, in metres of the farm frame; the vehicle then
        flies home. No points: fly home now (a vehicle whose mission does not lead home, the ideal robot, ends
        where it is); at the start: do not fly. Vehicles that are not named go on.
    reason : str
        Why, in a few words, for the record.
    alternatives : tuple of Alternative
        What else was thought of, the chosen ones among them; the best first.
    spacing_m : mapping of int to float
        Distance between neighbouring rows of a path, where it has such a thing; for reports.
    acquisition : AcquisitionMap or None
        What the paths were chosen by, where that is a map; for who watches.

    Raises
    ------
    AnswerError
        If points are no finite pairs.

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
        taken = {}
        for system_id, points in self.paths.items():
            array = np.array(points, dtype=np.float64)
            if array.size == 0:
                array = np.empty((0, 2))
            if array.ndim != 2 or array.shape[1] != 2:
                shape = array.shape
                msg = f"vehicle {system_id}: a path is finite (x, y) points, not an array of shape {shape}"
                raise AnswerError(msg, "no points")
            if not np.isfinite(array).all():
                worst = array[~np.isfinite(array)][0]
                msg = f"vehicle {system_id}: a path is finite (x, y) points, but a coordinate is {worst}"
                raise AnswerError(msg, "not finite")
            array.flags.writeable = False
            taken[int(system_id)] = array
        object.__setattr__(self, "paths", MappingProxyType(taken))
        object.__setattr__(self, "spacing_m", MappingProxyType(dict(self.spacing_m)))

    @property
    def changes(self) -> bool:
        """Whether any vehicle gets another path."""
        return bool(self.paths)


NO_CHANGE = Decision()
"""Everybody flies on as before."""


def answer_costs(name: str, answer: object, observation: PolicyObservation) -> dict[int, float]:
    """Return what the paths of a policy's answer cost, by system id, in the units of the budgets."""
    if not isinstance(answer, Decision):
        msg = f"{name} answered with a {type(answer).__name__}, not a Decision"
        raise AnswerError(msg, "no Decision")
    costs = {}
    for system_id, points in answer.paths.items():
        try:
            vehicle = observation.vehicle(system_id)
        except PlanningError as error:
            raise AnswerError(f"{name}: {error}", "wrong vehicle") from None
        costs[system_id] = _checked_cost(name, vehicle, points)
    return costs


def _checked_cost(name: str, vehicle: VehicleReport, points: Points) -> float:
    """Return what a new path costs; AnswerError if the vehicle must not fly it."""
    who = name if vehicle.system_id == 1 else f"{name}, vehicle {vehicle.system_id},"
    if not vehicle.steerable:
        msg = f"{who} changes the path of a vehicle that is {vehicle.status.value}"
        raise AnswerError(msg, "not steerable")
    cost = vehicle.travel_cost.rest([points])[0]
    budget = vehicle.request.budget
    # Home at once is the least that a vehicle can do: in wind, or round an obstacle, even that may be over.
    if len(points) and not cost <= vehicle.left + budget.limit * _OF_LIMIT:
        over = f"the budget of {budget.limit:g} {budget.unit}"
        if vehicle.spent > 0.0:
            over = f"the {vehicle.left:.6g} {budget.unit} that are left of {budget.limit:g}"
        msg = f"{who} returned a path that takes {cost:.6g} {budget.unit}, over {over}"
        raise AnswerError(msg, "over the budget")
    area = vehicle.request.room
    # Between parts that do not hang together the path may take the straight way.
    room = area.convex_hull if isinstance(area, shapely.MultiPolygon) else area
    if len(points):
        line = shapely.LineString(points) if len(points) > 1 else shapely.Point(points[0])
        if not shapely.covers(shapely.buffer(room, _INSIDE_M), line):
            msg = f"{who} returned a path that leaves its area"
            raise AnswerError(msg, "outside the area")
    return cost
