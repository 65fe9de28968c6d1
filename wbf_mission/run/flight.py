"""Plans and flies one flight of a run, with one or several vehicles, in simulation or over links."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
from numpy.random import SeedSequence

from geo.frame import LocalFrame
from geo.seeds import child_seed, stream
from mission.course import MissionProgress
from mission.link.tlog import FrameSink
from sensors.camera.leaf_camera import Camera, LeafCamera
from sensors.environment import Environment
from sensors.estimation import Evidence
from wbf_mission.events import EventStream
from wbf_mission.planning import PlanResult, home_of
from wbf_mission.planning.assignment import SortieNumber
from wbf_mission.planning.conditions import ground_separation_margin_m
from wbf_mission.planning.fleet import Vehicle
from wbf_mission.progress import Stopwatch
from wbf_mission.replanning.loop import DecisionLoop, Knowledge
from wbf_mission.replanning.record import DecisionRecord
from wbf_mission.replanning.spacing import MARGIN_M, KeptDistance, Positions, least_apart_m
from wbf_mission.run.hosting import Hosting
from wbf_mission.run.joint_flight import JointFlight, OperatorConsole
from wbf_mission.run.record import Flight
from wbf_mission.run.resolve import Run
from wbf_mission.run.sortie import Sortie
from wbf_mission.scenario import CameraOptions, ScenarioError
from wbf_mission.scenario.values import DISTANCE

_LATEST_S = 7200
_STEP_S = 5


class FlightInterrupted(KeyboardInterrupt):
    """Raised at Ctrl-C during a flight; has the flight's result up to the interrupt."""

    def __init__(self, flight: Flight) -> None:
        super().__init__()
        self.flight = flight


@dataclass(frozen=True, slots=True)
class PlannedFlight:
    """A flight that is planned, but has not begun."""

    day: int
    flight: int
    loop: DecisionLoop  # Asks the policy during the flight.
    # Sortie number, vehicle and plan for each vehicle with a path; empty if the flight is skipped
    sorties: tuple[tuple[SortieNumber, Vehicle, PlanResult], ...]
    # Ratio of expected to planned flight time, for each vehicle; above 1 if a policy adds paths in flight
    times: tuple[float, ...]
    faults_seed: SeedSequence  # Seed of the faults that are injected into the flight.
    gone: Collection[int] = ()  # System ids of the lost vehicles.

    @property
    def plans(self) -> tuple[PlanResult, ...]:
        """The plan of each vehicle."""
        return tuple(plan for _, _, plan in self.sorties)

    @property
    def expected_s(self) -> float:
        """Approximate flight time (s), summed over the vehicles."""
        return sum(
            times * plan.prediction.duration_s for times, plan in zip(self.times, self.plans, strict=True)
        )

    def expected_readings(self, camera: CameraOptions) -> float:
        """Return the expected number of cell readings in the flight."""
        readings = [_expected_readings(camera, plan) for plan in self.plans]
        return sum(times * one for times, one in zip(self.times, readings, strict=True))


def plan_flight(
    run: Run,
    day: int,
    flight: int,
    evidence: Evidence,
    decisions: list[DecisionRecord],
    gone: Collection[int] = (),
) -> PlannedFlight:
    """Plan a flight; a vehicle stays on the ground if its path has no points."""
    there = [vehicle for vehicle in run.vehicles if vehicle.task.system_id not in gone]
    decider = run.decider
    knowledge = Knowledge(run.farm, day, run.fields, run.weights, evidence.model, evidence.observations)
    loop = DecisionLoop(
        decider.policy,
        decider.name,
        knowledge,
        flight=flight,
        records=decisions,
        kept_distance=_kept_distance(run, there),
    )
    numbers = [SortieNumber(day, flight, vehicle.task.system_id, run.first_day) for vehicle in there]
    vehicles = [
        replace(one, task=one.task.of_sortie(number)) for one, number in zip(there, numbers, strict=True)
    ]
    faults_seed = child_seed(run.seed, "faults", f"day-{day}", f"flight-{flight}")
    times = (1.0,) * len(vehicles)
    if decider.sorties:
        plans = (decider.sorties[(flight - 1) % len(decider.sorties)],) * len(vehicles)
    elif decider.mission is not None:
        plans = (decider.mission,) * len(vehicles)
    else:
        answer = loop.start([vehicle.task.report(steered=decider.steers) for vehicle in vehicles])
        flies = [len(answer.decision.paths[vehicle.task.system_id]) > 0 for vehicle in vehicles]
        numbers, vehicles = list(compress(numbers, flies)), list(compress(vehicles, flies))
        tasks = [vehicle.task for vehicle in vehicles]
        plans = tuple(task.plan_of(answer.decision, decider.label, steered=decider.steers) for task in tasks)
        times = (1.0,) * len(vehicles)
        if decider.steers:
            times = tuple(
                max(1.0, task.request.budget.limit / max(answer.costs[task.system_id], 1e-9))
                for task in tasks
            )
    sorties = tuple(zip(numbers, vehicles, plans, strict=True))
    return PlannedFlight(day, flight, loop, sorties, times, faults_seed, gone)


def leaf_camera(run: Run, number: SortieNumber, environment: Environment) -> LeafCamera:
    """Return the leaf camera of one vehicle's flight."""
    return LeafCamera(
        environment,
        run.farm.grid().shape,
        number.day,
        run.camera_of(number.system_id),
        stream(run.seed, *number.stream_names("camera")),
    )


def fly_once(
    run: Run,
    planned: PlannedFlight,
    evidence: Evidence,
    cameras: Callable[[SortieNumber], Camera],
    hosting: Hosting,
    *,
    events: EventStream | None = None,
    watch: Stopwatch | None = None,
    console: OperatorConsole | None = None,
    writer: FrameSink | None = None,
    offset_s: float = 0.0,
    follow: MissionProgress | None = None,
) -> Flight:
    """Fly a planned flight to its end; Ctrl-C after its start raises FlightInterrupted.

    Parameters
    ----------
    evidence : Evidence
        Receives the observations as they arrive.
    cameras : callable
        Returns the camera of each vehicle (`leaf_camera`).
    writer : FrameSink, optional
        Receives every frame.
    offset_s : float
        Start of the flight, seconds after the start of the run.
    follow : MissionProgress, optional
        Receives the messages of a real vehicle that flies alone.
    """
    events = events or EventStream()
    delays: Sequence[float] = [0.0] * len(planned.plans)
    if run.keeps.kind == DISTANCE and len(delays) > 1:
        delays = departure_delays(planned.plans, run.keeps.metres, _margin_m(run))
    sorties = [
        Sortie(
            number,
            one,
            plan,
            cameras(number),
            lambda done, total: events.progress("uploading", done, total),
            delay,
            hosting.arming_gate(number.system_id),
            hosting.transfers,
            force=hosting.force,
            place=place,
        )
        for place, ((number, one, plan), delay) in enumerate(zip(planned.sorties, delays, strict=True))
    ]
    if follow is not None:
        sorties[0].follow = follow.receive
    expected_s = max(
        one.start_delay_s + times * one.plan.prediction.duration_s
        for one, times in zip(sorties, planned.times, strict=True)
    )
    opened = hosting.open(
        sorties,
        writer,
        offset_s=offset_s,
        seed=planned.faults_seed,
        gone=planned.gone,
    )
    flying: JointFlight | None = None
    try:
        with opened as host:
            flying = JointFlight(
                sorties,
                planned.loop,
                evidence,
                host,
                offset_s=offset_s,
                hosting=hosting,
                console=console,
                expected_s=expected_s,
                events=events,
                watch=watch or Stopwatch(),
            )
            flying.fly()
    except KeyboardInterrupt:
        if flying is None:
            raise
        flying.interrupt()
        raise FlightInterrupted(flying.given()) from None
    return flying.given()


def departure_delays(plans: Sequence[PlanResult], distance_m: float, margin_m: float = 0.0) -> list[int]:
    """Return the delay of each vehicle's start after the first start (s).

    A vehicle starts as soon as its predicted flight keeps `distance_m` from all vehicles that start before
    it. The paper's robots have no size and start at once.
    """
    flights: list[tuple[Positions, int]] = []
    delays = []
    for number, plan in enumerate(plans, start=1):
        delay = 0
        if not plan.vehicle.is_ideal:
            flight = _positions(plan)
            while any(
                least_apart_m(other, flight, delay - begin) < distance_m + margin_m + MARGIN_M
                for other, begin in flights
            ):
                delay += _STEP_S
                if delay > _LATEST_S:
                    raise ScenarioError(
                        f"separation distance: vehicle {number} would wait for more than two hours to keep"
                        f" {distance_m:g} m from other vehicles; give a smaller distance, or use layers"
                    )
            flights.append((flight, delay))
        delays.append(delay)
    return delays


def _positions(plan: PlanResult) -> Positions:
    """Return a vehicle's predicted position at each full second of its flight, in the farm frame (m)."""
    prediction, farm = plan.prediction, plan.farm
    home = home_of(plan.mission, farm)
    about_home = LocalFrame(home.latitude_deg, home.longitude_deg, home.altitude_m)
    latitude, longitude = about_home.to_wgs84(prediction.track_m[:, 0], prediction.track_m[:, 1])
    places = np.column_stack(farm.frame.from_wgs84(latitude, longitude))
    times = np.minimum(np.arange(len(places)) * prediction.track_step_s, prediction.duration_s)
    seconds = np.arange(0.0, prediction.duration_s, 1.0)
    return np.column_stack([np.interp(seconds, times, places[:, axis]) for axis in range(2)])


def _kept_distance(run: Run, vehicles: Sequence[Vehicle]) -> KeptDistance | None:
    """Return the check of distances between vehicles in flight, or None without separation by distance."""
    if run.keeps.kind != DISTANCE:
        return None
    builders = {vehicle.task.system_id: vehicle.task.builder for vehicle in vehicles}
    speeds_m_s = {
        number: min(one.level.speed_m_s, one.vehicle.top_speed_m_s)
        for number, one in builders.items()
        if not one.vehicle.is_ideal
    }
    return KeptDistance(run.keeps.metres, speeds_m_s, _margin_m(run))


def _margin_m(run: Run) -> float:
    """Return the margin for errors of the horizontal distance between two estimated positions (m)."""
    return ground_separation_margin_m(run.vehicles[0].vehicle)


def _expected_readings(camera: CameraOptions, planned: PlanResult) -> float:
    """Return the expected number of cell readings of a plan."""
    if planned.vehicle.is_ideal:
        images = planned.prediction.duration_s / planned.vehicle.step_s
    else:
        spacing_m = camera.spacing_m or planned.farm.cell_size_m * camera.footprint
        images = planned.prediction.path_length_m / spacing_m
    return images * camera.footprint**2
