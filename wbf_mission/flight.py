"""One run end to end: environment, plan, upload over MAVLink, flight, leaf camera, estimate, score."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from geo import Farm
from geo.errors import WbfMissionError
from geo.seeds import child_seed, stream
from mission.link.tlog import TlogWriter
from mission.model import GeoPoint
from sensors.camera import LeafCamera, LeafCameraOptions
from sensors.environment import Environment, generate_environment
from sensors.estimators import Estimator, make_estimator
from sensors.fields import FIELDS, relevance_masks
from sensors.information import InformationModel
from sensors.messages import AssemblerStatistics, ObservationAssembler
from sensors.observations import Observations
from sensors.score import RunningScore
from sim_vehicle.camera import LeafCameraComponent
from sim_vehicle.simulation import Impairment, Simulation, StopReason
from sim_vehicle.vehicle import Outcome as VehicleOutcome
from sim_vehicle.vehicle import SimVehicle
from wbf_mission.estimation import DEFAULT_SCORE_POINTS, LARGE_FARM_SCORE_POINTS, RunEstimate, ScoreHistory
from wbf_mission.ground import GroundStation, Outcome, Phase, Track
from wbf_mission.planning import PlanResult, plan, wind_of
from wbf_mission.scenario import Scenario

Progress = Callable[[str, float, float], None]

SMALL_FARM_CELLS = 2500
LARGE_FARM_VALUES = 10_000_000
SLICE_S = 1.0
FLIGHT_LIMIT_FACTOR = 3.0
FLIGHT_LIMIT_EXTRA_S = 600.0
EPOCH_UNIX_S = (
    1_780_315_200.0  # 2026-06-01T12:00:00Z: a fixed time of day, so that equal runs give equal logs
)


class FlightError(WbfMissionError, RuntimeError):
    """A run that cannot be done."""


@dataclass(slots=True)
class FlightResult:
    """What a run gave; parts that were not reached are empty.

    Parameters
    ----------
    scenario : Scenario
    plan : PlanResult
    outcome : Outcome
        How the flight ended.
    reason : str
        Why it ended so, empty when it went well.
    track : Track
        What was flown.
    observations : Observations
        What arrived from the camera.
    camera : AssemblerStatistics
        Pictures received, lost, fetched again.
    transfers : list
        Statistics of the mission transfers.
    truth, model : float32[3, W, H] and InformationModel, or None
        The environment of the flight's day, and the last estimate.
    history : ScoreHistory
        Scores over time.
    battery_used : float or None
        Fraction of the battery, from the vehicle's telemetry.
    flight_time_s : float
        Simulated seconds from the mission's start to its end.
    timings_s : dict
        Wall seconds of each part.
    texts : list
        What the vehicle said (time, severity, text).
    """

    scenario: Scenario
    plan: PlanResult
    outcome: Outcome
    reason: str
    track: Track
    observations: Observations
    camera: AssemblerStatistics
    transfers: list[Any]
    truth: NDArray[np.float32] | None
    model: InformationModel | None
    history: ScoreHistory
    battery_used: float | None
    flight_time_s: float
    simulated_s: float
    frames: int
    timings_s: dict[str, float] = field(default_factory=dict)
    texts: list[tuple[float, int, str]] = field(default_factory=list)

    @property
    def farm(self) -> Farm:
        """The farm that was flown."""
        return self.plan.farm

    def summary(self) -> dict[str, Any]:
        """Return the run in plain values, for JSON."""
        final = self.history.entries[-1] if self.history.entries else None
        seen = self.observations
        cells = len(np.unique(seen.x.astype(np.int64) * self.farm.height_cells + seen.y)) if len(seen) else 0
        flight_s = self.timings_s.get("flight", 0.0)
        return {
            "seed": self.scenario.seed,
            "farm": self.farm.name,
            "planner": self.scenario.planner if self.scenario.mission is None else None,
            "mission": self.scenario.mission,
            "estimator": self.scenario.estimator,
            "vehicle": self.plan.vehicle.name,
            "day": self.scenario.day,
            "outcome": self.outcome.value,
            "reason": self.reason,
            "score": self.history.score,
            "final_score": final.score if final else None,
            "scored_times": len(self.history.entries),
            "losses": dict(zip(FIELDS, final.field_loss, strict=True)) if final else dict.fromkeys(FIELDS),
            "rmse": dict(zip(FIELDS, final.field_rmse, strict=True)) if final else dict.fromkeys(FIELDS),
            "mae": dict(zip(FIELDS, final.field_mae, strict=True)) if final else dict.fromkeys(FIELDS),
            "authors_axis_max": final.authors_axis_max if final else None,
            "observations": len(seen),
            "cells_observed": cells,
            "path_length_m": self.track.length_m,
            "planned_length_m": self.plan.length_m,
            "flight_time_s": self.flight_time_s,
            "predicted_time_s": self.plan.prediction.duration_s,
            "battery_used": self.battery_used,
            "predicted_battery_used": self.plan.battery_used,
            "coverage": self.plan.coverage,
            "spacing_m": self.plan.spacing_m,
            "budget": self.plan.budget_text,
            "transfer": _transfer_summary(self.transfers),
            "camera": asdict(self.camera),
            "mavlink_frames": self.frames,
            "wall_time_s": sum(self.timings_s.values()),
            "realtime_factor": self.simulated_s / flight_s if flight_s > 0.0 else 0.0,
            "timings_s": dict(self.timings_s),
            "scenario": self.scenario.to_dict(),
        }


def _transfer_summary(transfers: list[Any]) -> dict[str, Any]:
    return {
        "items": sum(part.items for part in transfers),
        "messages_sent": sum(part.messages_sent for part in transfers),
        "messages_received": sum(part.messages_received for part in transfers),
        "retries": sum(part.retries for part in transfers),
        "duration_s": sum(part.duration_s for part in transfers),
        "verified": bool(transfers) and all(part.verified for part in transfers),
    }


class _Stopwatch:
    """Wall seconds by part of the run."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._since = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self._since
        self._since = now


def make_environment(scenario: Scenario, farm: Farm, progress: Progress | None = None) -> Environment:
    """Generate the environment of the scenario's seed up to its day."""

    def tell(done: int, total: int) -> None:
        if progress is not None:
            progress("environment", done, total)

    return generate_environment(
        farm.grid(),
        days=scenario.day,
        seed=child_seed(scenario.seed, "environment"),
        keep_days=[scenario.day],
        progress=tell,
    )


def camera_options(scenario: Scenario) -> LeafCameraOptions:
    """Return the camera of a scenario."""
    return LeafCameraOptions(
        footprint_cells=scenario.camera_footprint,
        noise_std=scenario.camera_noise,
        false_positive_rate=scenario.false_positive_rate,
        false_negative_rate=scenario.false_negative_rate,
        sensed=scenario.camera_fields,
    )


def fly(
    scenario: Scenario,
    *,
    progress: Progress | None = None,
    pace: float | None = None,
    tlog: Path | None = None,
    impairment: Impairment | None = None,
) -> FlightResult:
    """Do a scenario's whole job offline.

    Parameters
    ----------
    scenario : Scenario
    progress : callable, optional
        ``progress(what, done, total)``.
    pace : float, optional
        Simulated seconds per wall second; as fast as possible without.
    tlog : Path, optional
        Write every MAVLink frame of the run there.
    impairment : Impairment, optional
        A bad radio between the ground station and the vehicle.

    Returns
    -------
    FlightResult
        Also when the flight went wrong or was interrupted by Ctrl-C: the outcome says how.

    Raises
    ------
    WbfMissionError
        If the scenario cannot be planned or set up.
    """
    tell = progress or _silent
    watch = _Stopwatch()
    options = camera_options(scenario)
    estimator = make_estimator(scenario.estimator, random_state=child_seed(scenario.seed, "estimator"))
    tell("planning", 0, 1)
    planned = plan(scenario)
    tell("planning", 1, 1)
    watch.lap("plan")
    farm = planned.farm
    environment = make_environment(scenario, farm, progress)
    truth = environment.values(scenario.day)
    watch.lap("environment")
    # One BLAS thread: sums do not depend on the number of cores then, and small matrices are faster.
    with threadpool_limits(1, user_api="blas"):
        run = _Run(scenario, planned, environment, truth, estimator, options, tell, watch)
        try:
            run.fly(pace, tlog, impairment)
        except KeyboardInterrupt:
            run.interrupt()
        return run.result()


class _Run:
    """The parts of one flight, joined on the virtual clock."""

    def __init__(
        self,
        scenario: Scenario,
        planned: PlanResult,
        environment: Environment,
        truth: NDArray[np.float32],
        estimator: Estimator,
        options: LeafCameraOptions,
        tell: Progress,
        watch: _Stopwatch,
    ) -> None:
        farm = planned.farm
        grid = farm.grid()
        self.scenario, self.planned, self.truth, self.tell, self.watch = scenario, planned, truth, tell, watch
        camera = LeafCamera(environment, grid.shape, scenario.day, options, stream(scenario.seed, "camera"))
        self.assembler = ObservationAssembler(farm, day=scenario.day)
        self.ground = GroundStation(planned.mission, self.assembler, on_progress=self._on_transfer)
        latitude, longitude = farm.frame.to_wgs84(*farm.home_m)
        home = planned.mission.home or GeoPoint(latitude, longitude, farm.frame.altitude_m)
        self.vehicle = SimVehicle(planned.vehicle, home, wind=wind_of(scenario), epoch_unix_s=EPOCH_UNIX_S)
        self.camera = LeafCameraComponent(camera, farm)
        estimator.fit(grid)
        self.estimate = RunEstimate(
            estimator, RunningScore(truth, relevance_masks(grid)), self._score_every()
        )
        self.parts: list[Observations] = []
        self.simulation: Simulation | None = None
        self.watch.lap("setup")

    def _score_every(self) -> int:
        """Return after how many observations the estimate is scored."""
        vehicle, cell_m = self.planned.vehicle, self.planned.farm.cell_size_m
        if vehicle.is_ideal:
            expected = self.planned.prediction.duration_s / vehicle.step_s
        else:
            expected = self.planned.length_m / (
                self.scenario.camera_spacing_m or cell_m * self.scenario.camera_footprint
            )
        expected *= self.scenario.camera_footprint**2
        points = self.scenario.score_points
        if points is None:
            if vehicle.is_ideal and self.planned.farm.owner_cells <= SMALL_FARM_CELLS:
                return 1
            points = (
                LARGE_FARM_SCORE_POINTS
                if np.prod(self.truth.shape) > LARGE_FARM_VALUES
                else DEFAULT_SCORE_POINTS
            )
        return max(1, round(expected / points))

    def fly(self, pace: float | None, tlog: Path | None, impairment: Impairment | None) -> None:
        """Fly from the first heartbeat to the last, estimating on the way."""
        writer = TlogWriter(tlog) if tlog is not None else None
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

    def result(self) -> FlightResult:
        """Score what was learned last and gather everything."""
        simulation, ground = self.simulation, self.ground
        now_s = simulation.now_s if simulation is not None else 0.0
        self.estimate.finish(now_s)
        self.watch.lap("estimate and score")
        outcome, reason = self._outcome()
        battery = self.planned.vehicle.battery
        used = None
        if battery is not None and ground.battery.consumed_wh is not None:
            used = ground.battery.consumed_wh / battery.capacity_wh
        return FlightResult(
            scenario=self.scenario,
            plan=self.planned,
            outcome=outcome,
            reason=reason,
            track=ground.track(self.planned.farm.frame),
            observations=Observations.concatenate(self.parts),
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
        )

    def _outcome(self) -> tuple[Outcome, str]:
        """Return the ground's outcome, in the vehicle's more precise terms where it has any."""
        ground, vehicle = self.ground, self.vehicle
        if ground.outcome is Outcome.FLIGHT_ABORTED and vehicle.outcome is not VehicleOutcome.RUNNING:
            precise = {
                VehicleOutcome.CANNOT_FLY_ITEM: Outcome.CANNOT_FLY_ITEM,
                VehicleOutcome.BATTERY_LOW: Outcome.BATTERY_LOW,
                VehicleOutcome.BATTERY_DEPLETED: Outcome.BATTERY_DEPLETED,
                VehicleOutcome.MISSION_REJECTED: Outcome.MISSION_REJECTED,
            }.get(vehicle.outcome, Outcome.FLIGHT_ABORTED)
            return precise, vehicle.outcome_text or ground.reason
        return ground.outcome, ground.reason


def _silent(_what: str, _done: float, _total: float) -> None:
    return None
