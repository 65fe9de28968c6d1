"""The flights of a run: its days, the flights of each day, and one estimate of the farm over all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from geo.seeds import child_seed
from mission.link.tlog import TlogWriter
from mission.policies.policy import FixedPlan, KeepPath, Policy
from sensors.camera.leaf_camera import LeafCameraOptions
from sensors.environment import Environment
from sensors.estimators import Estimator, advance_estimator
from sensors.fields import FieldSet
from sensors.scoring.information import InformationModel
from sensors.scoring.score import RunningScore, ScoreWeights
from wbf_mission.day_record import DayRecord, keeps_days
from wbf_mission.deciding.loop import DecisionLoop, Knowledge
from wbf_mission.deciding.record import DecisionRecord
from wbf_mission.deciding.spacing import KeptDistance
from wbf_mission.departures import departure_delays
from wbf_mission.estimation import RunEstimate, attribute_errors_to, score_points
from wbf_mission.evidence import Evidence
from wbf_mission.field_maps import FieldMap, field_maps
from wbf_mission.fleet import Vehicle
from wbf_mission.flight_record import FlightRecord
from wbf_mission.hosting import Hosting
from wbf_mission.joint_flight import Attendant, JointFlight
from wbf_mission.planning import PlanResult
from wbf_mission.progress import Progress
from wbf_mission.report import report_of_maps
from wbf_mission.scenario import CameraOptions, Scenario
from wbf_mission.scenario.separation import DISTANCE
from wbf_mission.sortie import Sortie
from wbf_mission.sortie_number import SortieNumber
from wbf_mission.stopwatch import Stopwatch

SMALL_FARM_CELLS = 2500


@dataclass(frozen=True, slots=True)
class Decider:
    """Who decides where the vehicles fly.

    Parameters
    ----------
    policy : Policy
        A `FixedPlan` for a planner, a `KeepPath` for a mission from a file.
    name : str
        What messages call it: ``planner spiral``, ``policy greedy``.
    label : str
        Its name with its parameters.
    mission : PlanResult or None
        A mission from a file, which is flown.
    """

    policy: Policy
    name: str
    label: str
    mission: PlanResult | None = None

    @property
    def steers(self) -> bool:
        """Whether it decides by what is believed of the farm; a planner and a mission file do not."""
        return not isinstance(self.policy, FixedPlan | KeepPath)


@dataclass(frozen=True, slots=True)
class _Planned:
    """The next flight: who is asked during it, and of each vehicle its number, task and plan.

    Who decides in flight begins with a short path: `times` tells how many such paths the budget pays for.
    """

    loop: DecisionLoop
    sorties: tuple[tuple[SortieNumber, Vehicle, PlanResult], ...]
    times: tuple[float, ...]


class Campaign:
    """All flights of a run.

    Every flight begins with full batteries and the whole budget, and draws anew: wind, errors of sensors, and
    planners that draw. A flight that goes wrong does not end the run. A vehicle that is lost for good
    (`Outcome.loses_vehicle`) does not fly again; when none is left, the days that remain are scored by what
    is believed of them.

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
    days : list of DayRecord
        What is over.
    maps : tuple of FieldMap
        The estimate at the end of the last of these days, in blocks of cells.
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
        self.days: list[DayRecord] = []
        self.maps: tuple[FieldMap, ...] = ()
        self.evidence = Evidence(self.farm, self.fields)
        self.truth: NDArray[np.float32] | None = None
        self.simulated_s = 0.0
        self.frames = 0
        self._decider = decider
        self._options = options
        self.watch = watch
        self._tell = tell
        self._next: _Planned | None = None
        self._flying: JointFlight | None = None
        self._gone: set[int] = set()

    def plan(self, day: int, flight: int = 1) -> tuple[PlanResult, ...]:
        """Ask for the paths of the next flight, and return the plan of each vehicle.

        Raises
        ------
        WbfMissionError
            If there is no path within the budget.
        """
        first = self.scenario.farm.day
        numbers = [
            SortieNumber(day, flight, one.task.system_id, first)
            for one in self.vehicles
            if one.task.system_id not in self._gone
        ]
        vehicles = [
            replace(one, task=one.task.of_sortie(number))
            for number in numbers
            for one in self.vehicles
            if one.task.system_id == number.system_id
        ]
        knowledge = Knowledge(
            self.farm, day, self.fields, self.weights, self.evidence.model, self.evidence.observations
        )
        loop = DecisionLoop(
            self._decider.policy,
            self._decider.name,
            knowledge,
            flight=flight,
            records=self.decisions,
            kept_distance=self._kept_distance(vehicles),
        )
        times = (1.0,) * len(vehicles)
        if self._decider.mission is not None:
            plans = (self._decider.mission,) * len(vehicles)
        else:
            answer = loop.start([one.task.report() for one in vehicles])
            label = self._decider.label
            steers = self._decider.steers
            plans = tuple(
                one.task.plan_of(answer.decision, label, camera_on_approach=steers) for one in vehicles
            )
            if steers:
                tasks = [one.task for one in vehicles]
                times = tuple(
                    max(1.0, one.request.budget.limit / max(answer.costs[one.system_id], 1e-9))
                    for one in tasks
                )
        self._next = _Planned(loop, tuple(zip(numbers, vehicles, plans, strict=True)), times)
        return plans

    @property
    def expected_readings(self) -> float:
        """How many readings are expected of all flights, if they are like the one that is planned."""
        return self.scenario.farm.days * self.scenario.farm.flights_per_day * self._expected_of_next

    @property
    def _expected_of_next(self) -> float:
        if self._next is None:
            return 0.0
        of_plans = [expected_readings(self.scenario.camera, plan) for _, _, plan in self._next.sorties]
        return sum(times * readings for times, readings in zip(self._next.times, of_plans, strict=True))

    def learn_with(self, estimator: Estimator, environment: Environment) -> None:
        """Let an estimator, fitted to the farm, learn from now on, and score it."""
        first = self.scenario.farm.day
        self.truth = environment.values(first)
        score = RunningScore(self.truth, self.fields.masks(self.farm.grid()), self.weights, self.fields)
        with attribute_errors_to(estimator):
            advance_estimator(estimator, first)
        self.evidence.estimate = RunEstimate(estimator, score, day=first)

    def _score_every(self, estimate: RunEstimate) -> int:
        """Return after how many observations of a flight the estimate is scored."""
        points = self.scenario.score.points
        if points is None:
            ideal = all(one.task.builder.vehicle.is_ideal for one in self.vehicles)
            if ideal and self.farm.owner_cells <= SMALL_FARM_CELLS:
                return 1
            points = score_points(self.farm, estimate.estimator)
        return max(1, round(self._expected_of_next / points))

    def fly(self, environment: Environment, hosting: Hosting, attendant: Attendant | None = None) -> None:
        """Fly all days; `attendant` stands by."""
        writer = None
        if hosting.tlog is not None:
            hosting.tlog.parent.mkdir(parents=True, exist_ok=True)
            writer = TlogWriter(hosting.tlog)
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
                    if len(self._gone) < len(self.vehicles):
                        self._fly_once(day, flight, environment, hosting, attendant, writer)
                self.end_day()
        finally:
            if writer is not None:
                writer.close()

    def interrupt(self) -> None:
        """Stop where we are; what was seen so far is kept."""
        if self._flying is not None:
            self._flying.interrupt()
            self._end_flight()

    def end_day(self) -> None:
        """Sum up the day that is estimated, unless that was done."""
        estimate = self.evidence.estimate
        assert estimate is not None
        if self.truth is None or (self.days and self.days[-1].day == estimate.day):
            return
        model = estimate.model
        if model is not None:
            self.maps = field_maps(
                self.farm,
                model,
                self.evidence.observations(),
                fields=self.fields,
                states_deviation=getattr(estimate.estimator, "states_deviation", False),
                day=estimate.day,
            )
        report = report_of_maps(self.farm, self.maps) if model is not None else None
        truth = kept = None
        if keeps_days(self.farm, len(self.fields), self.scenario.farm.days):
            truth = self.truth
            if model is not None:
                kept = InformationModel(
                    model.value.copy(), model.uncertainty.copy(), fields=self.fields.names
                )
        self.days.append(DayRecord(estimate.day, report, truth, kept))
        self.watch.lap("report")

    def _begin_day(self, day: int, environment: Environment) -> None:
        assert self.evidence.estimate is not None
        self.truth = environment.values(day)
        self.evidence.estimate.begin_day(day, self.truth, self.simulated_s)
        self.watch.lap("estimate and score")

    def _fly_once(
        self,
        day: int,
        flight: int,
        environment: Environment,
        hosting: Hosting,
        attendant: Attendant | None,
        writer: TlogWriter | None,
    ) -> None:
        if self._next is None:
            self.plan(day, flight)
            self.watch.lap("plan")
        assert self._next is not None
        planned, self._next = self._next, None
        delays = self._start_delays([plan for _, _, plan in planned.sorties])
        sorties = [
            Sortie(
                number,
                one.task,
                plan,
                one.scenario,
                environment,
                self._options,
                self._on_transfer,
                delay,
                hosting.clearance(number.system_id),
                hosting.transfers,
            )
            for (number, one, plan), delay in zip(planned.sorties, delays, strict=True)
        ]
        opened = hosting.open(
            sorties,
            writer,
            offset_s=self.simulated_s,
            seed=child_seed(self.scenario.seed, "faults", f"day-{day}", f"flight-{flight}"),
            gone=self._gone,
        )
        with opened as host:
            self._flying = JointFlight(
                sorties,
                planned.loop,
                self.evidence,
                host,
                offset_s=self.simulated_s,
                pace=hosting.pace,
                attendant=attendant,
                expected_s=max(
                    one.start_delay_s + times * one.plan.prediction.duration_s
                    for one, times in zip(sorties, planned.times, strict=True)
                ),
                tell=self._tell,
                watch=self.watch,
            )
            self._flying.fly()
        self._end_flight()

    def _start_delays(self, plans: Sequence[PlanResult]) -> Sequence[float]:
        """Return how many seconds after the first start each vehicle starts."""
        keeps = self.scenario.vehicle.keeps
        if keeps.kind != DISTANCE or len(plans) == 1:
            return [0.0] * len(plans)
        return departure_delays(plans, keeps.metres)

    def _kept_distance(self, vehicles: Sequence[Vehicle]) -> KeptDistance | None:
        """Return the distance that vehicles keep in flight; None if they need not."""
        keeps = self.scenario.vehicle.keeps
        if keeps.kind != DISTANCE:
            return None
        builders = {one.task.system_id: one.task.builder for one in vehicles}
        return KeptDistance(
            keeps.metres,
            {
                number: min(one.level.speed_m_s, one.vehicle.top_speed_m_s)
                for number, one in builders.items()
                if not one.vehicle.is_ideal
            },
        )

    def _end_flight(self) -> None:
        flown, self._flying = self._flying, None
        assert flown is not None
        records = [sortie.record() for sortie in flown.sorties]
        for one in records:
            one.seen_before = flown.seen_before
        self.flights += records
        self._gone |= {one.system_id for one in records if one.outcome.loses_vehicle}
        self.simulated_s += flown.now_s
        self.frames += flown.frames
        assert self.evidence.estimate is not None
        self.evidence.estimate.end_flight(self.simulated_s)
        self.watch.lap("estimate and score")

    def _on_transfer(self, done: int, total: int) -> None:
        self._tell("uploading", done, total)


def expected_readings(camera: CameraOptions, planned: PlanResult) -> float:
    """Return how many readings of cells are expected of a flight."""
    if planned.vehicle.is_ideal:
        images = planned.prediction.duration_s / planned.vehicle.step_s
    else:
        spacing_m = camera.spacing_m or planned.farm.cell_size_m * camera.footprint
        images = planned.prediction.path_length_m / spacing_m
    return images * camera.footprint**2
