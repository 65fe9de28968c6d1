"""Campaign: the flights of a run on all its days, and the estimate that all flights share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from geo.system import free_unused_memory
from mission.course import MissionProgress
from mission.errors import PlanningError
from mission.link.tlog import TlogWriter
from mission.model import Mission
from mission.policies.policy import KeepPath
from sensors.environment import Environment
from sensors.estimation import Evidence, RunEstimate, attribute_errors_to, prepare_days
from sensors.estimators import advance_estimator
from sensors.scoring.information import InformationModel
from sensors.scoring.score import RunningScore
from sim_vehicle.execution.state import EPOCH_UNIX_S
from wbf_mission.events import DayBegun, Decided, Estimated, EventStream, FlightEnded, Noted, VehicleMoved
from wbf_mission.maps.field_maps import FieldMap, field_maps
from wbf_mission.maps.report import report_of_maps
from wbf_mission.planning import PlanResult
from wbf_mission.planning.fleet import Vehicle
from wbf_mission.planning.sorties import SortiePlan, UncutError, cut_plan
from wbf_mission.progress import Stopwatch
from wbf_mission.replanning.record import DecisionRecord
from wbf_mission.run.flight import FlightInterrupted, PlannedFlight, fly_once, leaf_camera, plan_flight
from wbf_mission.run.hosting import Hosting
from wbf_mission.run.joint_flight import OperatorConsole
from wbf_mission.run.record import DayRecord, Flight, FlightRecord, keeps_days
from wbf_mission.run.resolve import Run
from wbf_mission.run.reuse import FlightAlone, FlightMemory, FlightsAhead, can_fly_ahead


class RealSorties(Protocol):
    """A real vehicle's progress through its sorties; after an early end, the rest is cut into new sorties."""

    cut: SortiePlan  # Flown sorties, cut to their flown part, and the planned sorties.
    stopped: str  # Why the mission was stopped; empty if it goes on or is complete.
    changed_s: float  # Duration of the last battery change.

    def follow(self, flight: int) -> MissionProgress:
        """Return the progress tracker of a flight; flights count from 1."""

    def note(self, flight: int, record: FlightRecord) -> None:
        """After a flight, update the place that the mission has reached."""

    def go_on(self, flight: int, record: FlightRecord) -> bool:
        """Change the battery after a flight; return whether another sortie follows."""

    @property
    def rest(self) -> Mission | None:
        """The rest of the mission, as a separate mission; None if the mission is complete."""


class Campaign:
    """All flights of a run.

    Every flight begins with full batteries and the whole budget, and draws new wind, sensor errors and random
    paths. A failed flight does not end the run. A lost vehicle (`Outcome.loses_vehicle`) does not fly again;
    after the loss of all vehicles, the remaining days are scored without further observations. If the policy
    returns no path for any vehicle, the flight is skipped, except the first flight.
    """

    def __init__(
        self,
        run: Run,
        *,
        events: EventStream,
        watch: Stopwatch,
        change_s: float | None = None,
        full: float = 1.0,
    ) -> None:
        self.run = run
        self.cut: SortiePlan | None = None  # Sorties of a mission for several batteries, once it is cut
        self._change_s, self._full = change_s, full
        self.decisions: list[DecisionRecord] = []
        self.flights: list[FlightRecord] = []
        self.days: list[DayRecord] = []
        self.maps: tuple[FieldMap, ...] = ()  # Estimate at the end of the last day, summed over pixels
        self.evidence = Evidence(run.farm, run.fields)
        self.truth: NDArray[np.float32] | None = None  # True fields of the current day, float32[n, W, H]
        self.simulated_s = 0.0
        self.frames = 0
        self.watch = watch
        self._events = events
        self._next: PlannedFlight | None = None
        self._scored_a_flight = 0
        self._seen_before = 0
        self._gone: set[int] = set()
        self._log: TlogWriter | None = None
        self.real: RealSorties | None = None  # Progress of a real vehicle's sorties

    def plan(self, day: int, flight: int = 1) -> tuple[PlanResult, ...]:
        """Plan the next flight, and return the plan of each vehicle.

        Raises WbfMissionError if no path fits the budget, or the policy returns no path for the first flight.
        """
        known = len(self.decisions)
        planned = plan_flight(self.run, day, flight, self.evidence, self.decisions, self._gone)
        for record in self.decisions[known:]:
            self._events.tell(Decided(self.simulated_s, record, planned.loop.acquisition))
        if not planned.sorties and not self.flights:
            msg = f"{self.run.decider.name} finds nothing worth a flight: no vehicle has a path"
            raise PlanningError(msg)
        if self._change_s is not None and self.cut is None and not self.flights:
            planned = self._in_sorties(planned, self._change_s)
        self._next = planned
        return planned.plans

    def _tell_estimate(self, time_s: float, model: InformationModel) -> None:
        """Emit the estimate at a scored time; called in the estimator's thread."""
        assert self.evidence.estimate is not None
        history = self.evidence.estimate.history
        scored = Estimated(time_s, history.days[-1], history.observations[-1], model, history.entries[-1])
        self._events.tell(scored)

    def _in_sorties(self, planned: PlannedFlight, change_s: float) -> PlannedFlight:
        """Return the flight of the first sortie if the mission needs several batteries, else `planned`."""
        run = self.run
        if run.decider.steers or len(planned.sorties) != 1:
            return planned
        ((_, vehicle, whole),) = planned.sorties
        if not whole.is_too_long:
            return planned
        try:
            cut = cut_plan(
                whole,
                vehicle.task.builder,
                footprint=run.looks.footprint,
                change_s=change_s,
                full=self._full,
            )
        except UncutError as error:
            self._events.tell(Noted(str(error), warns=True))
            return planned
        self._fly_in(cut, run.flights_per_day)
        return plan_flight(self.run, planned.day, planned.flight, self.evidence, self.decisions, self._gone)

    def _fly_in(self, cut: SortiePlan, times_a_day: int = 1) -> None:
        """Let the run fly the sorties of a cut mission in place of the mission."""
        self.cut = cut
        # Each sortie gets the whole mission's predicted coverage, since the run reports all sorties together.
        sorties = tuple(replace(plan, coverage=cut.whole.coverage) for plan in cut.plans)
        decider = replace(self.run.decider, policy=KeepPath(), sorties=sorties)
        self.run = replace(self.run, decider=decider, flights_per_day=times_a_day * len(sorties))

    @property
    def sorties(self) -> tuple[PlanResult, ...]:
        """The plans of all sorties, or of the next flight if the mission is not cut."""
        if self.cut is not None:
            return self.cut.plans
        return () if self._next is None else self._next.plans

    @property
    def planned(self) -> tuple[tuple[Vehicle, PlanResult], ...]:
        """The vehicles of the next flight with their plans; empty before planning."""
        return () if self._next is None else tuple((one, plan) for _, one, plan in self._next.sorties)

    @property
    def expected_readings(self) -> float:
        """Expected number of the run's readings, extrapolated from the plan of the next flight."""
        return len(self.run.numbers) * self._expected_of_next

    @property
    def _expected_of_next(self) -> float:
        return 0.0 if self._next is None else self._next.expected_readings(self.run.looks)

    def learn_from(self, environment: Environment, ready: Callable[[], None]) -> None:
        """Fit the estimator to the farm, and start the estimate, which first waits for `ready`."""
        run, first, estimator = self.run, self.run.first_day, self.run.estimator
        free_unused_memory()
        with attribute_errors_to(estimator):
            estimator.fit(run.farm.grid())
            prepare_days(estimator, first, run.days, self._events.progress)
            advance_estimator(estimator, first)
        self.watch.lap("learning")
        self.truth = environment.truth(first)
        score = RunningScore(self.truth, run.fields.scored(run.farm.grid()), run.weights, run.fields)
        estimate = self.evidence.estimate = RunEstimate(estimator, score, day=first, ready=ready)
        if self._events.wants(Estimated):
            estimate.on_score = self._tell_estimate
        self._events.tell(DayBegun(self.simulated_s, first, self.truth))

    def fly(
        self,
        environment: Environment,
        hosting: Hosting,
        console: OperatorConsole | None = None,
        memory: FlightMemory | None = None,
        sorties: Callable[[SortiePlan, Vehicle, int], RealSorties | None] = lambda *_of: None,
    ) -> None:
        """Fly all days, and reuse flights of `memory`; `sorties` makes the tracker of real sorties."""
        first = self.run.first_day
        if self._next is None:
            self.plan(first)
        if self.cut is not None:
            self.real = sorties(self.cut, self.run.vehicles[0], self.run.looks.footprint)
        assert self.evidence.estimate is not None
        self.evidence.estimate.every = self.run.readings_a_score(self._expected_of_next)
        self._scored_a_flight = max(1, round(self._expected_of_next / self.evidence.estimate.every))
        # With a console, orders or a live listener, flights must be flown in order and in this process.
        followed = console is not None or hosting.orders is not None or self._events.wants(VehicleMoved)
        ahead = None if followed else self._ahead(environment, hosting)
        try:
            for day in range(first, self.run.last_day + 1):
                if day != first:
                    assert self.evidence.estimate is not None
                    self.truth = environment.truth(day)
                    self._events.tell(DayBegun(self.simulated_s, day, self.truth))
                    self.evidence.estimate.begin_day(day, self.truth, self.simulated_s)
                    self.watch.lap("estimate and score")
                flight = 0
                # If a real sortie ends early, the day gets more sorties.
                while flight < self.run.flights_per_day:
                    flight += 1
                    if len(self._gone) == len(self.run.vehicles):
                        continue
                    # Flights that were flown ahead assume that no vehicle was lost.
                    flown = None if ahead is None or self._gone else ahead.take(day, flight)
                    if flown is None and memory is not None and not followed:
                        planned = self._planned(day, flight)
                        flown = memory.fly(self.run, planned, environment, hosting, self._events.progress)
                    if flown is None:
                        self._fly_once(day, flight, environment, hosting, console)
                    else:
                        self._events.progress(
                            "flying", self.run.numbers.index((day, flight)) + 1, len(self.run.numbers)
                        )
                        self._take(flown, hosting)
                    if self.real is not None and not self._go_on(self.real, flight):
                        break
                self.end_day()
        finally:
            if ahead is not None:
                ahead.close()
            if self._log is not None:
                self._log.close()

    def close(self) -> None:
        """Stop the estimate's thread, and release its resources."""
        if self.evidence.estimate is not None:
            self.evidence.estimate.close()
            self.evidence.estimate.on_score = lambda _time_s, _model: None  # It holds this campaign

    def end_day(self) -> None:
        """Add the record of the current day, if it is missing."""
        estimate = self.evidence.estimate
        assert estimate is not None
        if self.truth is None or (self.days and self.days[-1].day == estimate.day):
            return
        model = estimate.model
        free_unused_memory()
        if model is not None:
            self.maps = field_maps(
                self.run.farm,
                model,
                self.evidence.observations(),
                fields=self.run.fields,
                states_deviation=getattr(estimate.estimator, "states_deviation", False),
                only_seen=getattr(estimate.estimator, "knows_only_seen", False),
                day=estimate.day,
            )
        report = report_of_maps(self.run.farm, self.maps) if model is not None else None
        truth = kept = None
        if keeps_days(self.run.farm, len(self.run.fields), self.run.days):
            truth = self.truth
            if model is not None:
                kept = InformationModel(
                    model.value.copy(), model.uncertainty.copy(), fields=self.run.fields.names
                )
        self.days.append(DayRecord(estimate.day, report, truth, kept))
        self.watch.lap("report")

    def _fly_once(
        self,
        day: int,
        flight: int,
        environment: Environment,
        hosting: Hosting,
        console: OperatorConsole | None,
    ) -> None:
        planned, self._next = self._planned(day, flight), None
        if not planned.sorties:
            # The estimate does not change; it is scored again.
            assert self.evidence.estimate is not None
            self.evidence.estimate.hold(self._scored_a_flight, self.simulated_s)
            self.watch.lap("estimate and score")
            return
        try:
            flown = fly_once(
                self.run,
                planned,
                self.evidence,
                partial(leaf_camera, self.run, environment=environment),
                hosting,
                events=self._events,
                watch=self.watch,
                console=console,
                writer=self._open_log(hosting),
                offset_s=self.simulated_s,
                follow=None if self.real is None else self.real.follow(flight),
            )
        except FlightInterrupted as stop:
            self._take(stop.flight, hosting)
            raise
        self._take(flown, hosting)

    def _go_on(self, real: RealSorties, flight: int) -> bool:
        """Change a real vehicle's battery for its next sortie; return False if no sortie follows."""
        goes_on = real.go_on(flight, self.flights[-1])
        self.watch.lap("waiting")
        if goes_on:
            self.simulated_s += real.changed_s
            self._fly_in(real.cut)
        return goes_on

    def _change_after(self, flown: Flight) -> float:
        """Return the duration of the battery change after a simulated flight (s); 0 after the last sortie."""
        if self.cut is None or self.real is not None or flown.records[0].flight % len(self.cut.sorties) == 0:
            return 0.0
        return self.cut.change_s

    def _planned(self, day: int, flight: int) -> PlannedFlight:
        """Return the next flight; plan it if necessary."""
        if self._next is None:
            self.plan(day, flight)
            self.watch.lap("plan")
        assert self._next is not None
        return self._next

    def _open_log(self, hosting: Hosting) -> TlogWriter | None:
        """Return the writer of the telemetry log (None without a log); the first call creates the file."""
        if self._log is None and hosting.tlog is not None:
            hosting.tlog.parent.mkdir(parents=True, exist_ok=True)
            self._log = TlogWriter(hosting.tlog)
        return self._log

    def _ahead(self, environment: Environment, hosting: Hosting) -> FlightsAhead | None:
        """Start all flights in worker processes; return None if workers cannot fly them, or save no time."""
        numbers = self.run.numbers
        assert self._next is not None
        if len(numbers) == 1 or not can_fly_ahead(self.run, hosting, len(numbers) * self._next.expected_s):
            return None
        # A worker plans the first flight again, so the plan made here is dropped.
        self._next = None
        self.decisions.clear()
        return FlightsAhead(FlightAlone(self.run, environment, hosting, hosting.tlog is not None), numbers)

    def _take(self, flown: Flight, hosting: Hosting) -> None:
        """Add a finished flight: its frames, observations, decisions and records."""
        writer = self._open_log(hosting)
        if writer is not None and flown.log is not None:
            writer.write_all(flown.log, EPOCH_UNIX_S + self.simulated_s)
        for decision in flown.decisions:
            decision.observations += len(self.evidence)
        self.evidence.add(*flown.parts, offset_s=self.simulated_s)
        self.decisions += flown.decisions
        self.watch.lap("flight")
        for record in flown.records:
            record.seen_before, record.begun_s = self._seen_before, self.simulated_s
        self._seen_before, self._next = len(self.evidence), None
        self.flights += flown.records
        for record in flown.records:
            self._events.tell(
                FlightEnded(
                    self.simulated_s + flown.duration_s,
                    record.day,
                    record.flight,
                    record.system_id,
                    record.outcome.value,
                    record.reason,
                )
            )
        if self.real is not None:
            self.real.note(flown.records[0].flight, flown.records[0])
        self._gone |= {one.system_id for one in flown.records if one.outcome.loses_vehicle}
        self.simulated_s += flown.duration_s + self._change_after(flown)
        self.frames += flown.frames
        assert self.evidence.estimate is not None
        self.evidence.estimate.end_flight(self.simulated_s)
        self.watch.lap("estimate and score")
