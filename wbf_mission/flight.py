"""One run end to end: environment, plan, upload over MAVLink, flight, leaf camera, estimate, score."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from geo import Farm
from geo.errors import WbfMissionError
from geo.seeds import child_seed, stream
from mission.link.tlog import TlogWriter
from mission.outcome import Outcome
from mission.planners import Planner
from sensors.camera.leaf_camera import LeafCamera, LeafCameraOptions
from sensors.camera.wire import ObservationAssembler
from sensors.environment import Environment
from sensors.environment.cache import EnvironmentCache
from sensors.estimators import Estimator, prepare_estimator
from sensors.field_files import load_field_set
from sensors.fields import FieldSet
from sensors.observations import Observations
from sensors.scoring.score import RunningScore, ScoreWeights
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.camera.component import LeafCameraComponent
from sim_vehicle.epoch import EPOCH_UNIX_S
from sim_vehicle.host.simulation import Impairment, Simulation, StopReason
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.estimation import RunEstimate, estimator_of, require_run_memory, resolved, score_points
from wbf_mission.ground.station import GroundStation
from wbf_mission.outcome import Phase
from wbf_mission.planning import PlanResult, home_of, plan
from wbf_mission.progress import Progress, silent
from wbf_mission.report import FieldMap, field_maps, true_map
from wbf_mission.result import Result
from wbf_mission.scenario import CameraOptions, Scenario, scenario_with
from wbf_mission.stopwatch import Stopwatch
from wbf_mission.weather import noise_of, wind_of_run

SMALL_FARM_CELLS = 2500
SLICE_S = 1.0
FLIGHT_LIMIT_FACTOR = 3.0
FLIGHT_LIMIT_EXTRA_S = 600.0


class FlightError(WbfMissionError, RuntimeError):
    """A run that cannot be done."""


def make_environment(
    scenario: Scenario, farm: Farm, progress: Progress | None = None, *, use_cache: bool = True
) -> Environment:
    """Give the environment of the scenario's seed on its day; large farms' are kept in the user's cache."""
    return _find_environment(scenario, farm, progress, use_cache=use_cache)[0]


def _find_environment(
    scenario: Scenario, farm: Farm, progress: Progress | None, *, use_cache: bool
) -> tuple[Environment, bool]:
    """Give the environment, and whether it came from the cache."""

    def tell(done: int, total: int) -> None:
        if progress is not None:
            progress("environment", done, total)

    cache = EnvironmentCache.of_user() if use_cache else EnvironmentCache.off()
    return cache.environment(
        farm.grid(),
        day=scenario.farm.day,
        seed=child_seed(scenario.seed, "environment"),
        fields=load_field_set(scenario.farm.fields),
        progress=tell,
    )


def camera_options(camera: CameraOptions, fields: FieldSet) -> LeafCameraOptions:
    """Give the leaf camera's own options, on a farm with these fields."""
    return LeafCameraOptions(
        footprint_cells=camera.footprint,
        noise_std=camera.noise,
        false_positive_rate=camera.false_positive_rate,
        false_negative_rate=camera.false_negative_rate,
        sensed=camera.fields,
        fields=fields,
    )


def check_flight(scenario: Scenario) -> None:
    """Check what a scenario says of fields, camera and estimator, which planning alone does not use.

    Raises
    ------
    WbfMissionError
        If `fly` would refuse it.
    """
    fields = load_field_set(scenario.farm.fields)
    camera_options(scenario.camera, fields)
    if scenario.estimate.estimator is not None:
        estimator_of(scenario.estimate.estimator, scenario.seed, fields)


def fly(
    scenario: Scenario,
    *,
    planner: Planner | str | None = None,
    estimator: Estimator | str | None = None,
    weights: ScoreWeights | None = None,
    progress: Progress | None = None,
    pace: float | None = None,
    tlog: Path | None = None,
    impairment: Impairment | None = None,
    use_cache: bool = True,
) -> Result:
    """Do a scenario's whole job offline.

    Parameters
    ----------
    scenario : Scenario
    planner, estimator : object or str, optional
        In place of the scenario's.
    weights : ScoreWeights, optional
        What errors cost; the paper's by default.
    progress : callable, optional
        ``progress(what, done, total)``.
    pace : float, optional
        Simulated seconds per wall second; as fast as possible without.
    tlog : Path, optional
        Write every MAVLink frame of the run there; its folder is made when the flight begins.
    impairment : Impairment, optional
        A bad radio between the ground station and the vehicle.
    use_cache : bool
        Take the environment of a large farm from the user's cache, or keep it there
        (:class:`sensors.environment.cache.EnvironmentCache`).

    Returns
    -------
    Result
        Also when the flight went wrong or was interrupted by Ctrl-C: the outcome says how.

    Raises
    ------
    WbfMissionError
        If the scenario cannot be planned or set up.
    """
    tell = progress or silent
    watch = Stopwatch()
    fields = load_field_set(scenario.farm.fields)
    options = camera_options(scenario.camera, fields)
    scenario = scenario_with(scenario, {"planner": planner, "estimator": estimator})
    scenario = resolved(scenario)
    learner = estimator_of(scenario.estimate.estimator, scenario.seed, fields)
    tell("planning", 0, 1)
    planned = plan(scenario, progress=tell)
    tell("planning", 1, 1)
    watch.lap("plan")
    farm = planned.farm
    require_run_memory(farm, learner, round(_expected_observations(scenario.camera, planned)))
    environment, cached = _find_environment(scenario, farm, progress, use_cache=use_cache)
    truth = environment.values(scenario.farm.day)
    watch.lap("environment")
    # One BLAS thread: sums do not depend on the number of cores then, and small matrices are faster.
    with threadpool_limits(1, user_api="blas"):
        run = _Run(scenario, planned, environment, truth, weights, learner, options, tell, watch)
        try:
            try:
                run.fly(pace, tlog, impairment)
            except KeyboardInterrupt:
                run.interrupt()
            result = run.result()
        finally:
            run.estimate.close()
    result.environment_cached = cached
    return result


class _Run:
    """The parts of one flight, joined on the virtual clock."""

    def __init__(
        self,
        scenario: Scenario,
        planned: PlanResult,
        environment: Environment,
        truth: NDArray[np.float32],
        weights: ScoreWeights | None,
        estimator: Estimator,
        options: LeafCameraOptions,
        tell: Progress,
        watch: Stopwatch,
    ) -> None:
        farm = planned.farm
        grid = farm.grid()
        self.scenario, self.planned, self.truth, self.tell, self.watch = scenario, planned, truth, tell, watch
        camera = LeafCamera(
            environment, grid.shape, scenario.farm.day, options, stream(scenario.seed, "camera")
        )
        self.fields = options.fields
        self.assembler = ObservationAssembler(farm, day=scenario.farm.day, fields=self.fields.names)
        self.ground = GroundStation(planned.mission, self.assembler, on_progress=self._on_transfer)
        home = home_of(planned.mission, farm)
        self.vehicle = SimVehicle(
            planned.vehicle,
            home,
            wind=wind_of_run(scenario),
            autopilot=get_autopilot(scenario.vehicle.autopilot),
            epoch_unix_s=EPOCH_UNIX_S,
            noise=noise_of(scenario.vehicle, scenario.seed),
        )
        self.camera = LeafCameraComponent(
            camera, farm, position_error=self.vehicle.position_error if self.vehicle.errors else None
        )
        self.estimator = estimator.fit(grid)
        prepare_estimator(estimator, scenario.farm.day, tell)
        self.watch.lap("learning")
        self.estimate = RunEstimate(
            estimator, RunningScore(truth, self.fields.masks(grid), weights, self.fields), self._score_every()
        )
        self.parts: list[Observations] = []
        self.simulation: Simulation | None = None
        self.watch.lap("setup")

    def _score_every(self) -> int:
        """Return after how many observations the estimate is scored."""
        planned = self.planned
        points = self.scenario.score.points
        if points is None:
            if planned.vehicle.is_ideal and planned.farm.owner_cells <= SMALL_FARM_CELLS:
                return 1
            points = score_points(planned.farm, self.estimator)
        return max(1, round(_expected_observations(self.scenario.camera, planned) / points))

    def fly(self, pace: float | None, tlog: Path | None, impairment: Impairment | None) -> None:
        """Fly from the first heartbeat to the last, estimating on the way."""
        writer = None
        if tlog is not None:
            tlog.parent.mkdir(parents=True, exist_ok=True)
            writer = TlogWriter(tlog)
        tap = None
        if writer is not None:
            write = writer.write

            def tap(frame: bytes, now_s: float) -> None:
                write(frame, EPOCH_UNIX_S + now_s)

        simulation = Simulation(
            [self.vehicle, self.camera, self.ground], tap=tap, impairment=impairment, remote=[self.ground]
        )
        self.simulation = simulation
        limit_s = FLIGHT_LIMIT_FACTOR * self.planned.prediction.duration_s + FLIGHT_LIMIT_EXTRA_S
        begin = time.perf_counter()
        try:
            while not self.ground.done:
                stop = simulation.run(until=self._is_done, limit_s=SLICE_S)
                self.watch.lap("flight")
                if pace is not None:
                    self._keep_pace(begin, pace)
                if simulation.now_s > limit_s or stop in (StopReason.IDLE, StopReason.STALLED):
                    why = (
                        f"not over after {simulation.now_s:.0f} simulated seconds ({self.ground.phase.value})"
                    )
                    self.ground.interrupt(Outcome.TIME_LIMIT, why, simulation.now_s)
                self._learn()
                if self.ground.phase is Phase.FLIGHT:
                    self.tell("flying", self.ground.flight_time_s, self.planned.prediction.duration_s)
        finally:
            if writer is not None:
                writer.close()

    def interrupt(self) -> None:
        """Stop where we are; what was seen so far is kept."""
        now_s = self.simulation.now_s if self.simulation is not None else 0.0
        self.ground.interrupt(Outcome.INTERRUPTED, f"stopped after {now_s:.0f} simulated seconds", now_s)
        self._learn()

    def _is_done(self, now_s: float) -> bool:  # noqa: ARG002
        return self.ground.done

    def _keep_pace(self, begin: float, pace: float) -> None:
        assert self.simulation is not None
        ahead_s = self.simulation.now_s / pace - (time.perf_counter() - begin)
        if ahead_s > 0.0:
            time.sleep(ahead_s)
        self.watch.lap("waiting")

    def _learn(self) -> None:
        part = self.assembler.take()
        if len(part):
            self.parts.append(part)
            self.estimate.add(part)
        self.watch.lap("estimate and score")

    def _on_transfer(self, phase: Phase, done: int, total: int) -> None:  # noqa: ARG002
        self.tell("uploading", done, total)

    def result(self) -> Result:
        """Score what was learned last and gather everything."""
        simulation, ground = self.simulation, self.ground
        now_s = simulation.now_s if simulation is not None else 0.0
        self.estimate.finish(now_s)
        self.watch.lap("estimate and score")
        battery = self.planned.vehicle.battery
        used = None
        if battery is not None and ground.battery.consumed_wh is not None:
            used = ground.battery.consumed_wh / battery.capacity_wh
        observations = Observations.concatenate(self.parts, self.fields.names)
        maps, true_maps = self._maps(observations)
        self.watch.lap("report")
        return Result(
            scenario=self.scenario,
            plan=self.planned,
            outcome=ground.outcome,
            reason=ground.reason,
            track=ground.track(self.planned.farm.frame),
            true_track=ground.true_track(self.planned.farm.frame),
            observations=observations,
            camera=self.assembler.statistics,
            transfers=ground.transfers,
            truth=self.truth,
            model=self.estimate.model,
            history=self.estimate.history,
            battery_used=used,
            flight_time_s=ground.flight_time_s,
            simulated_s=now_s,
            frames=simulation.frames if simulation is not None else 0,
            timings_s=self.watch.seconds,
            texts=ground.texts,
            warnings=[*self.planned.warnings, *filter(None, [self.assembler.mismatch()])],
            fields=self.fields,
            maps=maps,
            true_maps=true_maps,
        )

    def _maps(self, observations: Observations) -> tuple[tuple[FieldMap, ...], tuple[FieldMap, ...]]:
        """Return the last estimate and the truth in blocks of cells, nothing without an estimate."""
        model, farm = self.estimate.model, self.planned.farm
        if model is None:
            return (), ()
        maps = field_maps(
            farm,
            model,
            observations,
            fields=self.fields,
            states_deviation=getattr(self.estimator, "states_deviation", False),
        )
        return maps, tuple(true_map(farm, one.field, self.truth[k]) for k, one in enumerate(maps))


def _expected_observations(camera: CameraOptions, planned: PlanResult) -> float:
    if planned.vehicle.is_ideal:
        images = planned.prediction.duration_s / planned.vehicle.step_s
    else:
        spacing_m = camera.spacing_m or planned.farm.cell_size_m * camera.footprint
        images = planned.prediction.path_length_m / spacing_m
    return images * camera.footprint**2
