"""The decision loop: when to ask the policy, and how to carry out its decisions."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Protocol, TypeAlias

import numpy as np
import shapely

from geo import Farm
from geo.errors import WbfMissionError, told_error
from mission.errors import AnswerError, PlanningError
from mission.planners.path import Points
from mission.policies.decision import AcquisitionMap, Decision, answer_costs
from mission.policies.observation import Event, PolicyObservation, Status, VehicleReport
from mission.policies.policy import Policy, Triggers
from sensors.fields import FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import ScoreWeights
from wbf_mission.replanning.record import PLANNED_PATH, SKIPPED, DecisionRecord, PathChange
from wbf_mission.replanning.spacing import KeptDistance

_SCHEDULE = Path("/proc/thread-self/schedstat")
CRASHED, TOO_LATE, _NO_PATH = "crashed", "too late", "no path"
"""Kinds of fault of an answer; an `AnswerError` from `answer_costs` or `Decision` has the other kinds."""
_REACHED_M = 1.0
"""An autopilot counts a point within this distance (m) as reached, and does not fly back to it."""


@dataclass(frozen=True, slots=True)
class Answer:
    """A valid decision of a policy, with the costs of its paths."""

    decision: Decision
    costs: dict[int, float]  # Cost of each new path by system id, in the unit of the vehicle's budget.
    compute_s: float  # Computing time of the decision, without the time spent waiting for a core.


@dataclass(frozen=True, slots=True)
class Answered:
    """An observation and the policy's answer."""

    observation: PolicyObservation
    answer: Answer | AnswerError | None  # AnswerError for an invalid answer; None if no vehicle was steerable


Question: TypeAlias = Callable[[], PolicyObservation]
"""Function that returns the observation for a policy, with the vehicles at the moment of the question."""


def ask(policy: Policy, name: str, observation: PolicyObservation) -> Answer:
    """Return the policy's answer; raise AnswerError if the decision is invalid or the policy fails."""
    begin = time.perf_counter() - _waited_s()
    try:
        decision = policy.decide(observation)
    except AnswerError as error:
        if error.kind == _NO_PATH:  # The text names the planner
            raise
        raise AnswerError(f"{name}: {error}", error.kind) from None
    except PlanningError as error:
        raise AnswerError(str(error), _NO_PATH) from error
    except (WbfMissionError, MemoryError):
        raise
    except (Exception, SystemExit) as error:
        raise AnswerError(f"{name} failed: {told_error(error)}", CRASHED) from error
    compute_s = max(0.0, time.perf_counter() - _waited_s() - begin)
    return Answer(decision, answer_costs(name, decision, observation), compute_s)


def _waited_s() -> float:
    """Return the time that this thread has waited for a core (s); 0 if the system does not report it.

    This time does not count as computing time of a policy, because other programs may keep the machine busy.
    """
    try:
        return int(_SCHEDULE.read_text(encoding="ascii").split()[1]) * 1e-9
    except (OSError, ValueError, IndexError):
        return 0.0


class Steered(Protocol):
    """A vehicle whose path can be changed in flight, as its ground station sees it."""

    @property
    def system_id(self) -> int:
        """MAVLink system id of the vehicle."""

    @property
    def waypoints_reached(self) -> int:
        """Number of waypoints that the vehicle has passed since its mission began."""

    def is_ending(self, now_s: float) -> bool:
        """Return whether the vehicle nears the end of its path; this is True only once for each path."""

    def status(self, now_s: float) -> Status:
        """Return the state of the vehicle's flight."""

    def report(self, now_s: float, ahead_s: float = 0.0) -> VehicleReport:
        """Return the vehicle's state; `spent` includes the predicted cost of the next `ahead_s` seconds."""

    def steer(self, points_m: Points, now_s: float) -> PathChange:
        """Send the vehicle a new path; the returned PathChange is updated with the outcome."""


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Estimate and observations for the policy; `observation` adds the reports of the vehicles to both."""

    farm: Farm
    day: int
    fields: FieldSet
    weights: ScoreWeights
    model: Callable[[], InformationModel]  # Returns the estimate after all observations.
    observations: Callable[[], Observations]  # Returns all observations.

    def observation(
        self, event: Event, time_s: float, vehicles: Sequence[VehicleReport], compute_s: float
    ) -> PolicyObservation:
        """Return the observation for a policy."""
        return PolicyObservation(
            event=event,
            time_s=time_s,
            day=self.day,
            farm=self.farm,
            fields=self.fields,
            weights=self.weights,
            model=self.model(),
            observations=self.observations(),
            vehicles=tuple(vehicles),
            compute_s=compute_s,
        )


class DecisionLoop:
    """Asks a policy during one flight of one or several vehicles.

    Parameters
    ----------
    name : str
        Name of the policy in messages.
    records : list of DecisionRecord
        Receives the record of every decision.
    flight : int
        Number of the flight on its day, from 1.
    compute_s : float
        Time limit of a decision (s).
    kept_distance : KeptDistance, optional
        Refuses paths that lead vehicles too close to each other; None accepts them.
    """

    def __init__(
        self,
        policy: Policy,
        name: str,
        knowledge: Knowledge,
        *,
        records: list[DecisionRecord],
        flight: int = 1,
        compute_s: float = 1.0,
        kept_distance: KeptDistance | None = None,
    ) -> None:
        self._records = records
        self._policy = policy
        self._name = name
        self._knowledge = knowledge
        self._flight = flight
        self._compute_s = compute_s
        self._kept_distance = kept_distance
        self._asked_s = self._asked_at_s = 0.0  # Times of the last question on the clocks of mission and host
        self._took_s = 0.0
        self._observations = 0
        self._reached = 0
        self._lost: frozenset[int] = frozenset()
        self.acquisition: AcquisitionMap | None = None  # Acquisition map of the last decision

    def start(self, vehicles: Sequence[VehicleReport]) -> Answer:
        """Ask for the first paths. A vehicle stays on the ground if its path has no points."""
        triggers = self._policy.triggers
        if not isinstance(triggers, Triggers):
            raise PlanningError(f"{self._name}: triggers is {triggers!r}, not a Triggers")
        observation = self._knowledge.observation(Event.START, 0.0, vehicles, self._compute_s)
        answer = ask(self._policy, self._name, observation)
        for vehicle in observation.steerable:
            if vehicle.system_id not in answer.decision.paths:
                raise PlanningError(f"{self._name} has no path for vehicle {vehicle.system_id}")
        self._observations = len(observation.observations)
        record = self._note(observation, answer)
        for vehicle in observation.steerable:
            points = answer.decision.paths[vehicle.system_id]
            cost = answer.costs[vehicle.system_id]
            outcome = PLANNED_PATH if len(points) else SKIPPED
            record.changes.append(PathChange(vehicle.system_id, vehicle.position_m, points, cost, outcome))
        return answer

    @property
    def asks_on_the_way(self) -> bool:
        """Whether the policy is asked in flight, because it has a trigger at present."""
        return not self._policy.triggers.never

    def is_early(self, time_s: float) -> bool:
        """Return whether less than `Triggers.least_s` has passed since the last question."""
        return time_s - self._asked_s < self._policy.triggers.least_s - 1e-9

    def due(self, vehicles: Sequence[Steered], time_s: float, observations: int) -> Event | None:
        """Return the trigger for asking the policy now, or None."""
        triggers = self._policy.triggers
        if self.is_early(time_s):
            return None
        if triggers.observations is not None and observations - self._observations >= triggers.observations:
            return Event.OBSERVATIONS
        if triggers.waypoints and sum(vehicle.waypoints_reached for vehicle in vehicles) > self._reached:
            return Event.WAYPOINT
        if triggers.period_s is not None and time_s - self._asked_s >= triggers.period_s - 1e-9:
            return Event.PERIOD
        return None

    def ending(self, vehicles: Sequence[Steered], now_s: float) -> bool:
        """Return whether a vehicle's path is about to end; always False for a policy without triggers."""
        return self.asks_on_the_way and any(vehicle.is_ending(now_s) for vehicle in vehicles)

    def lost(self, vehicles: Sequence[Steered], now_s: float) -> bool:
        """Return whether a vehicle was lost since the last question, while another vehicle can take over."""
        if len(vehicles) == 1:
            return False
        statuses = {vehicle.system_id: vehicle.status(now_s) for vehicle in vehicles}
        new = any(status is Status.LOST and number not in self._lost for number, status in statuses.items())
        return new and Status.FLYING in statuses.values()

    def question(
        self,
        event: Event,
        vehicles: Sequence[Steered],
        time_s: float,
        now_s: float,
        model: Callable[[], InformationModel] | None = None,
    ) -> Question:
        """Return a question with the current vehicles and observations.

        `model` replaces the estimate of `Knowledge` if another thread computes the answer while vehicles fly
        on. The vehicles' reports then include the predicted cost of flying during the computation, which is
        assumed to take the time limit or, if that is longer, twice the time of the last answer. Without this
        margin, a new path near the end of the budget would exceed the budget when the answer arrives.
        """
        ahead_s = 0.0 if model is None else max(self._compute_s, 2.0 * self._took_s)
        reports = tuple(vehicle.report(now_s, ahead_s) for vehicle in vehicles)
        self._asked_s, self._asked_at_s = time_s, now_s
        self._reached = sum(vehicle.waypoints_reached for vehicle in vehicles)
        self._lost = frozenset(report.system_id for report in reports if report.status is Status.LOST)
        known, seen = self._knowledge, self._knowledge.observations()
        known = replace(known, model=model or known.model, observations=lambda: seen)
        return partial(known.observation, event, time_s, reports, self._compute_s)

    def answer(self, question: Question) -> Answered:
        """Ask the policy. This method may run in another thread."""
        observation = question()
        if not observation.steerable:
            return Answered(observation, None)
        try:
            return Answered(observation, ask(self._policy, self._name, observation))
        except AnswerError as error:
            return Answered(observation, error)

    def outdated(self, answered: Answered, vehicles: Sequence[Steered], now_s: float) -> dict[int, str]:
        """Return the reasons, by system id, why vehicles can no longer fly their new paths.

        Each path is validated again, and its cost becomes the cost from the vehicle's current position.
        """
        then, answer, found = answered.observation, answered.answer, dict[int, str]()
        self._took_s = now_s - self._asked_at_s
        if not isinstance(answer, Answer):
            return found
        now = replace(then, vehicles=tuple(vehicle.report(now_s) for vehicle in vehicles))
        for system_id, points in answer.decision.paths.items():
            try:
                answer.costs.update(answer_costs(self._name, Decision({system_id: points}), now))
            except AnswerError as error:
                found[system_id] = str(error)
            else:
                if _is_passed(then.vehicle(system_id), now.vehicle(system_id), points):
                    found[system_id] = "the vehicle has passed the path's start"
        return found

    def carry_out(
        self,
        answered: Answered,
        vehicles: Sequence[Steered],
        now_s: float,
        not_sent: Mapping[int, str] = MappingProxyType({}),
    ) -> DecisionRecord | None:
        """Send the new paths, and return the record of the decision.

        `not_sent` holds the reasons, by system id, for not sending a path. The result is None if no vehicle
        was steerable.
        """
        observation, answer = answered.observation, answered.answer
        self._observations = len(observation.observations)
        if answer is None:
            return None
        record = self._note(observation, answer)
        if isinstance(answer, AnswerError):
            return record
        by_id = {vehicle.system_id: vehicle for vehicle in vehicles}
        refused: dict[int, str] = {}
        if self._kept_distance is not None:
            now = [vehicle.report(now_s) for vehicle in vehicles]  # Reports are newer than the observation
            refused = self._kept_distance.refusals(now, answer.decision.paths)
        refused = {**refused, **not_sent}
        for system_id, points in answer.decision.paths.items():
            if system_id in refused:
                position_m, cost = observation.vehicle(system_id).position_m, answer.costs[system_id]
                text = f"not sent: {refused[system_id]}"
                record.changes.append(PathChange(system_id, position_m, points, cost, text))
                continue
            change = by_id[system_id].steer(points, now_s)
            change.cost = answer.costs[system_id]
            record.changes.append(change)
        return record

    def _note(self, observation: PolicyObservation, answer: Answer | AnswerError) -> DecisionRecord:
        seen, event = len(observation.observations), observation.event
        record = DecisionRecord(observation.day, self._flight, observation.time_s, event.value, seen)
        self._records.append(record)
        self.acquisition = None
        if isinstance(answer, AnswerError):
            record.refused, record.fault = str(answer), answer.kind
            return record
        decision, self.acquisition = answer.decision, answer.decision.acquisition
        record.reason, record.alternatives = decision.reason, decision.alternatives
        record.compute_s = answer.compute_s
        if event is not Event.START and answer.compute_s > observation.compute_s:
            record.fault = TOO_LATE
        return record


def _is_passed(then: VehicleReport, now: VehicleReport, path_m: Points) -> bool:
    """Return whether a vehicle has passed the first point of a path between two of its reports."""
    near_m = max(_REACHED_M, then.request.least_leg_m)
    reached = then.rest_m[: max(0, len(then.rest_m) - len(now.rest_m))]
    flown = shapely.LineString(np.vstack((then.position_m, reached, now.position_m)))
    firsts = shapely.points(path_m[:1])
    over = shapely.distance(flown, firsts) <= near_m
    return bool(np.any(over & (shapely.distance(shapely.Point(now.position_m), firsts) > near_m)))
