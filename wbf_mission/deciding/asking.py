"""Asking a policy, whoever wrote it, and holding its answer to the rules."""

from __future__ import annotations

import time
from dataclasses import dataclass

import shapely
from shapely.geometry import LineString, MultiPolygon, Point

from geo.blame import told_error
from geo.errors import WbfMissionError
from mission.errors import AnswerError, PlanningError
from mission.planners.path import Points
from mission.policies.decision import Decision
from mission.policies.policy import Policy
from mission.policies.situation import Situation, VehicleReport

_INSIDE_M = 1e-6
_OF_LIMIT = 1e-9
CRASHED, TOO_LATE = "crashed", "too late"
"""Kinds of answers, beside those that `ask` and `Decision` find."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What a policy answered.

    Parameters
    ----------
    decision : Decision
    costs : dict of int to float
        What each new rest of a path costs, in the unit of the vehicle's budget.
    compute_s : float
        Wall seconds that it took.
    """

    decision: Decision
    costs: dict[int, float]
    compute_s: float


def ask(policy: Policy, name: str, situation: Situation) -> Answer:
    """Ask a policy.

    Parameters
    ----------
    policy : Policy
    name : str
        What messages call it.
    situation : Situation

    Raises
    ------
    AnswerError
        If it fails, or its answer breaks a rule; the text names the policy and the vehicle.
    """
    begin = time.perf_counter()
    try:
        decision = policy.decide(situation)
    except AnswerError:
        raise
    except PlanningError as error:
        raise AnswerError(str(error), "no path") from error
    except (WbfMissionError, MemoryError):
        raise
    except Exception as error:
        msg = f"{name} failed: {told_error(error)}"
        raise AnswerError(msg, CRASHED) from error
    except SystemExit as error:
        msg = f"{name} ended the program: {told_error(error)}; raise an error instead"
        raise PlanningError(msg) from error
    compute_s = time.perf_counter() - begin
    if not isinstance(decision, Decision):
        msg = f"{name} answered with a {type(decision).__name__}, not a Decision"
        raise AnswerError(msg, "no Decision")
    costs = {}
    for system_id, points in decision.paths.items():
        try:
            vehicle = situation.vehicle(system_id)
        except PlanningError as error:
            raise AnswerError(f"{name}: {error}", "wrong vehicle") from None
        costs[system_id] = _checked_cost(name, vehicle, points)
    return Answer(decision, costs, compute_s)


def _checked_cost(name: str, vehicle: VehicleReport, points: Points) -> float:
    """Return what a new path costs; AnswerError if the vehicle must not fly it."""
    who = name if vehicle.system_id == 1 else f"{name}, vehicle {vehicle.system_id},"
    if not vehicle.steerable:
        msg = f"{who} changes the path of a vehicle that is {vehicle.status.value}"
        raise AnswerError(msg, "not steerable")
    cost = vehicle.fares.rest([points])[0]
    budget = vehicle.request.budget
    # Home at once is the least that a vehicle can do: in wind, or round an obstacle, even that may be over.
    if len(points) and not cost <= vehicle.left + budget.limit * _OF_LIMIT:
        over = f"the budget of {budget.limit:g} {budget.unit}"
        if vehicle.spent > 0.0:
            over = f"the {vehicle.left:.6g} {budget.unit} that are left of {budget.limit:g}"
        msg = f"{who} returned a path that takes {cost:.6g} {budget.unit}, over {over}"
        raise AnswerError(msg, "over the budget")
    area = vehicle.request.area
    # Between parts that do not hang together the path may take the straight way.
    room = area.convex_hull if isinstance(area, MultiPolygon) else area
    if len(points):
        line = LineString(points) if len(points) > 1 else Point(points[0])
        if not shapely.covers(shapely.buffer(room, _INSIDE_M), line):
            msg = f"{who} returned a path that leaves its area"
            raise AnswerError(msg, "outside the area")
    return cost
