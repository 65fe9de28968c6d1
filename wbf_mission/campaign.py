"""The flights of a run: its days, the flights of each day, and one estimate of the farm over all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from mission.link.tlog import TlogWriter
from mission.policies.policy import FixedPlan, Policy
from sensors.camera.leaf_camera import LeafCameraOptions
from sensors.environment import Environment
from sensors.estimators import Estimator
from sensors.fields import FieldSet
from sensors.scoring.score import RunningScore, ScoreWeights
from sim_vehicle.host.simulation import Impairment
from wbf_mission.deciding.loop import DecisionLoop, Knowledge
from wbf_mission.deciding.record import DecisionRecord
from wbf_mission.estimation import RunEstimate, score_points
from wbf_mission.evidence import Evidence
from wbf_mission.flight_record import FlightRecord
from wbf_mission.joint_flight import JointFlight
from wbf_mission.outcome import Phase
from wbf_mission.planning import FlightTask, PlanResult
from wbf_mission.progress import Progress
from wbf_mission.scenario import CameraOptions, Scenario
from wbf_mission.sortie import Sortie, SortieNumber
from wbf_mission.stopwatch import Stopwatch

SMALL_FARM_CELLS = 2500


@dataclass(frozen=True, slots=True)
class Host:
    """How flights are run.

    Parameters
    ----------
    pace : float or None
        Simulated seconds per wall second; as fast as possible without.
    tlog : Path or None
        Where every MAVLink frame is written; its folder is made when the first flight begins.
    impairment : Impairment or None
        A bad radio between the ground stations and the vehicles.
    """

    pace: float | None = None
    tlog: Path | None = None
    impairment: Impairment | None = None


@dataclass(frozen=True, slots=True)
class Vehicle:
    """One of the vehicles of a run.

    Parameters
    ----------
    task : FlightTask
    scenario : Scenario
        The run's, with the name of this one vehicle.
    """

    task: FlightTask
    scenario: Scenario


@dataclass(frozen=True, slots=True)
class Decider:
    """Who decides where the vehicles fly.

    Parameters
    ----------
    policy : Policy
        A `FixedPlan` for a planner.
    name : str
        What messages call it: ``planner spiral``, ``policy greedy``.
    label : str
        Its name with its parameters.
    mission : PlanResult or None
        A mission from a file, which is flown in place of what the policy would plan.
    """

    policy: Policy
    name: str
    label: str
    mission: PlanResult | None = None


class Campaign:
    """All flights of a run.

    Parameters
    ----------
    scenario : Scenario
        That names its estimator.
    vehicles : sequence of Vehicle
    decider : Decider
    options : LeafCameraOptions
    weights : ScoreWeights or None
    tell : callable
        Progress.
    watch : Stopwatch

    Attributes
    ----------
    flights : list of FlightRecord
        What is over.
    decisions : list of DecisionRecord
    evidence : Evidence
    truth : float32[n, W, H] or None
        Of the day that is flown.
    simulated_s : float
    frames : int
    """

    def __init__(
        self,
        scenario: Scenario,
        vehicles: Sequence[Vehicle],
        decider: Decider,
        *,
        options: LeafCameraOptions,
        weights: ScoreWeights | None,
        tell: Progress,
        watch: Stopwatch,
    ) -> None:
        self.scenario = scenario
        self.vehicles = tuple(vehicles)
        self.farm: Farm = self.vehicles[0].task.builder.farm
        self.fields: FieldSet = options.fields
        self.weights = ScoreWeights.of(self.fields) if weights is None else weights
        self.decisions: list[DecisionRecord] = []
        self.flights: list[FlightRecord] = []
        self.evidence = Evidence(self.farm, self.fields)
        self.truth: NDArray[np.float32] | None = None
        self.simulated_s = 0.0
        self.frames = 0
        self._decider = decider
        self._options = options
        self.watch = watch
        self._tell = tell
        self._next: tuple[DecisionLoop, tuple[PlanResult, ...]] | None = None
        self._flying: JointFlight | None = None

    def plan(self, day: int, flight: int = 1) -> tuple[PlanResult, ...]:
        """Ask for the paths of the next flight, and return the plan of each vehicle.

        Raises
        ------
        WbfMissionError
            If there is no path within the budget.
        """
        knowledge = Knowledge(
            self.farm, day, self.fields, self.weights, self.evidence.model, self.evidence.observations
        )
        loop = DecisionLoop(
            self._decider.policy, self._decider.name, knowledge, flight=flight, records=self.decisions
        )
        if self._decider.mission is not None:
            self._next = loop, (self._decider.mission,) * len(self.vehicles)
            return self._next[1]
        decision = loop.start([one.task.report() for one in self.vehicles]).decision
        label = self._decider.label
        steers = not isinstance(self._decider.policy, FixedPlan)
        self._next = (
            loop,
            tuple(one.task.plan_of(decision, label, camera_on_approach=steers) for one in self.vehicles),
        )
        return self._next[1]

    @property
    def expected_readings(self) -> float:
        """How many readings are expected of all flights, if they are like the one that is planned."""
        plans = () if self._next is None else self._next[1]
        flights = self.scenario.farm.days * self.scenario.farm.flights_per_day
        return flights * sum(expected_readings(self.scenario.camera, one) for one in plans)

    def learn_with(self, estimator: Estimator, environment: Environment) -> None:
        """Let an estimator, fitted to the farm, learn from now on, and score it."""
        self.truth = environment.values(self.scenario.farm.day)
        score = RunningScore(self.truth, self.fields.masks(self.farm.grid()), self.weights, self.fields)
        self.evidence.estimate = RunEstimate(estimator, score)

    def _score_every(self, estimate: RunEstimate) -> int:
        """Return after how many observations the estimate is scored."""
        points = self.scenario.score.points
        if points is None:
            ideal = all(one.task.builder.vehicle.is_ideal for one in self.vehicles)
            if ideal and self.farm.owner_cells <= SMALL_FARM_CELLS:
                return 1
            points = score_points(self.farm, estimate.estimator)
        return max(1, round(self.expected_readings / points))

    def fly(self, environment: Environment, host: Host) -> None:
        """Fly all days."""
        writer = None
        if host.tlog is not None:
            host.tlog.parent.mkdir(parents=True, exist_ok=True)
            writer = TlogWriter(host.tlog)
        first = self.scenario.farm.day
        if self._next is None:
            self.plan(first)
        assert self.evidence.estimate is not None
        self.evidence.estimate.every = self._score_every(self.evidence.estimate)
        try:
            for day in range(first, first + self.scenario.farm.days):
                if day != first:
                    self._begin_day(day, environment)
                for flight in range(1, self.scenario.farm.flights_per_day + 1):
                    self._fly_once(SortieNumber(day, flight, 1, first), environment, host, writer)
                    if not all(one.outcome.is_good for one in self.flights[-len(self.vehicles) :]):
                        break
        finally:
            if writer is not None:
                writer.close()

    def interrupt(self) -> None:
        """Stop where we are; what was seen so far is kept."""
        if self._flying is not None:
            self._flying.interrupt()
            self._end_flight()

    def _begin_day(self, day: int, environment: Environment) -> None:
        assert self.evidence.estimate is not None
        self.truth = environment.values(day)
        self.evidence.estimate.begin_day(self.truth)

    def _fly_once(
        self, number: SortieNumber, environment: Environment, host: Host, writer: TlogWriter | None
    ) -> None:
        day, flight = number.day, number.flight
        if self._next is None:
            self.plan(day, flight)
        assert self._next is not None
        (loop, plans), self._next = self._next, None
        sorties = [
            Sortie(
                SortieNumber(day, flight, one.task.system_id, number.first_day),
                one.task,
                plan,
                one.scenario,
                environment,
                self._options,
                self._on_transfer,
            )
            for one, plan in zip(self.vehicles, plans, strict=True)
        ]
        self._flying = JointFlight(
            sorties,
            loop,
            self.evidence,
            offset_s=self.simulated_s,
            impairment=host.impairment,
            writer=writer,
            pace=host.pace,
            tell=self._tell,
            watch=self.watch,
        )
        self._flying.fly()
        self._end_flight()

    def _end_flight(self) -> None:
        flown, self._flying = self._flying, None
        assert flown is not None
        self.flights += [sortie.record() for sortie in flown.sorties]
        self.simulated_s += flown.now_s
        self.frames += flown.frames

    def _on_transfer(self, phase: Phase, done: int, total: int) -> None:  # noqa: ARG002
        self._tell("uploading", done, total)


def expected_readings(camera: CameraOptions, planned: PlanResult) -> float:
    """Return how many readings of cells are expected of a flight."""
    if planned.vehicle.is_ideal:
        images = planned.prediction.duration_s / planned.vehicle.step_s
    else:
        spacing_m = camera.spacing_m or planned.farm.cell_size_m * camera.footprint
        images = planned.prediction.path_length_m / spacing_m
    return images * camera.footprint**2
