"""Reuse of equal flights by several runs, and flights flown ahead in other processes.

A planner's path does not depend on the camera's readings. Mission, vehicle, weather and, for a flight with
random draws, the seed therefore decide a flight; environment, camera errors and estimator do not matter. The
flight is flown with cameras that number their readings (`sensors.camera.leaf_camera`). For each run, readings
of that run's environment then replace the numbers.

Flights of a run can also be flown in parallel. Each flight draws from random streams that belong to its
number, so the order of the flights does not matter.
"""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from msgspec.msgpack import encode
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from geo.errors import WbfMissionError
from geo.processes import CallsAhead
from mission.link.tlog import FrameLog
from sensors.camera.leaf_camera import Camera, ImageList, NumberingCamera
from sensors.environment import Environment
from sensors.environment.cache import EnvironmentMemory
from sensors.estimation import Evidence
from sensors.observations import Observations
from sim_vehicle.execution.state import EPOCH_UNIX_S
from wbf_mission.planning import PlanResult
from wbf_mission.planning.assignment import SortieNumber
from wbf_mission.planning.fleet import Vehicle
from wbf_mission.progress import Progress, silent
from wbf_mission.replanning.record import DecisionRecord
from wbf_mission.run.flight import FlightInterrupted, PlannedFlight, fly_once, leaf_camera, plan_flight
from wbf_mission.run.hosting import Hosting, VirtualHosting
from wbf_mission.run.plan import progress_events
from wbf_mission.run.record import Flight, FlightRecord
from wbf_mission.run.resolve import Run

MOST_FLIGHTS = 32
MOST_READINGS = 1_000_000
"""Largest number of readings that the kept flights may have together."""


@dataclass(frozen=True, slots=True)
class _KeptFlight:
    """A kept flight: its observations have indices of readings in place of the values of one environment."""

    records: tuple[FlightRecord, ...]
    images: ImageList
    seen: Observations  # Observations without values.
    reading: NDArray[np.int64]  # int64[n], index of the reading of each observation.
    duration_s: float
    frames: int

    def of_run(self, run: Run, planned: PlannedFlight, environment: Environment) -> Flight:
        """Return the flight with the readings of a run's environment."""
        cameras = [leaf_camera(run, number, environment) for number, _, _ in planned.sorties]
        readings = self.images.read(cameras)
        seen = replace(
            self.seen, day=np.full(len(self.seen), planned.day, np.int32), values=readings[self.reading]
        )
        records = [
            replace(
                one,
                day=planned.day,
                flight=planned.flight,
                plan=plan,
                camera=replace(one.camera),
                transfers=list(one.transfers),
                texts=list(one.texts),
                warnings=list(one.warnings),
            )
            for one, plan in zip(self.records, planned.plans, strict=True)
        ]
        return Flight(records, self.duration_s, self.frames, (seen,))


class FlightMemory:
    """Cache of the `most` recently used flights, and of small environments."""

    def __init__(self, most: int = MOST_FLIGHTS) -> None:
        self.environments = EnvironmentMemory()
        self._most = most
        self._kept: OrderedDict[bytes, _KeptFlight] = OrderedDict()

    def __len__(self) -> int:
        return len(self._kept)

    def fly(
        self,
        run: Run,
        planned: PlannedFlight,
        environment: Environment,
        hosting: Hosting,
        progress: Progress = silent,
    ) -> Flight | None:
        """Fly a flight, or reuse an equal flight; None if runs cannot share the flight.

        Runs cannot share a flight that a policy, an operator, a link or a fault can change, that is logged or
        very long, or in which a decision was made.
        """
        expected = planned.expected_readings(run.looks)
        if hosting != VirtualHosting() or run.decider.steers or 2.0 * expected > MOST_READINGS:
            return None
        key = _key(run, planned)
        kept = self._kept.pop(key, None)
        if kept is None:
            kept = _flown(run, planned, hosting, progress)
            if kept is None:
                return None
        self._kept[key] = kept
        while len(self._kept) > self._most or self._readings > MOST_READINGS:
            self._kept.popitem(last=False)
        return kept.of_run(run, planned, environment)

    @property
    def _readings(self) -> int:
        return sum(len(kept.reading) for kept in self._kept.values())


@cache
def memory_of_process() -> FlightMemory:
    """Return the flight memory that all runs of this process share."""
    return FlightMemory()


def _flown(run: Run, planned: PlannedFlight, hosting: Hosting, progress: Progress) -> _KeptFlight | None:
    """Fly a flight with cameras that number their readings; return None if a decision was made in flight."""
    evidence, decisions = Evidence(run.farm, run.fields), list[DecisionRecord]()
    if len(planned.sorties) > 1:
        # A vehicle may take over the rest of a lost vehicle's path. The flight is planned anew, so that its
        # decisions do not enter the run's records twice.
        there = {number.system_id for number, _, _ in planned.sorties}
        gone = {vehicle.task.system_id for vehicle in run.vehicles} - there
        planned = plan_flight(run, planned.day, planned.flight, evidence, decisions, gone)
    images = ImageList(run.camera.footprint_cells**2)
    shape = run.farm.grid().shape
    order = [number.system_id for number, _, _ in planned.sorties]

    def camera(number: SortieNumber) -> NumberingCamera:
        return NumberingCamera(images, order.index(number.system_id), shape, run.camera)

    flown = _fly_apart(run, planned, evidence, camera, hosting, None, progress)
    if len(decisions) > 1 or not images.is_exact:
        return None
    seen = evidence.observations()
    return _KeptFlight(
        tuple(flown.records),
        images,
        replace(seen, values=np.broadcast_to(np.float32(np.nan), seen.values.shape)),
        seen.values[:, 0].astype(np.int64),
        flown.duration_s,
        flown.frames,
    )


def _fly_apart(
    run: Run,
    planned: PlannedFlight,
    evidence: Evidence,
    cameras: Callable[[SortieNumber], Camera],
    hosting: Hosting,
    log: FrameLog | None,
    progress: Progress,
) -> Flight:
    """Fly a flight outside of its run; Ctrl-C discards the flight."""
    try:
        # It is unknown when the flight starts in its run, so frame times count from the flight's start.
        return fly_once(
            run,
            planned,
            evidence,
            cameras,
            hosting,
            events=progress_events(progress),
            writer=log,
            offset_s=-EPOCH_UNIX_S,
        )
    except FlightInterrupted:
        raise KeyboardInterrupt from None


def _key(run: Run, planned: PlannedFlight) -> bytes:
    """Return the flight's key, which encodes all values that decide the flight."""
    farm, frame = run.farm, run.farm.frame
    georeference = (frame.latitude_deg, frame.longitude_deg, frame.altitude_m, frame.rotation_deg)
    sorties = [_sortie_values(*sortie) for sortie in planned.sorties]
    drawn = None
    if any(_draws(one) for _, one, _ in planned.sorties):
        drawn = (run.seed, [number for number, _, _ in planned.sorties])
    return encode(
        [
            [georeference, farm.cell_size_m, farm.width_cells, farm.height_cells, farm.home_m],
            [run.camera.footprint_cells, run.fields.names],
            sorties,
            drawn,
        ],
        order="deterministic",
    )


def _sortie_values(number: SortieNumber, vehicle: Vehicle, plan: PlanResult) -> list[object]:
    """Return all values that decide a vehicle's flight; plan and vehicle already reflect other options."""
    level = (vehicle.mission.altitude_m, vehicle.mission.cruise_speed_m_s)
    options = (vehicle.vehicle.values(), vehicle.weather.values(), level)
    return [number.system_id, vehicle.task.builder.home_m, plan.mission, plan.vehicle, options]


def _draws(flown: Vehicle) -> bool:
    """Return whether a flight has random draws."""
    weather, vehicle = flown.weather, flown.vehicle
    gusts = weather.wind_gust_m_s > 0.0 or weather.turbulence is not None
    errs = flown.task.builder.estimate_errors
    return gusts or errs or vehicle.gps_noise_m > 0.0 or vehicle.baro_noise_m > 0.0


WORTH_S = 6000.0
"""If a run has more simulated flight time (s), worker processes save more time than their start costs."""
MOST_CELLS = 500_000
"""Largest environment (cells) that is sent to worker processes."""


@dataclass(frozen=True, slots=True)
class FlightAlone:
    """Flies single flights of a run, independently of its other flights."""

    run: Run  # The run; its paths do not depend on the estimate
    environment: Environment
    hosting: Hosting
    logged: bool = False  # Whether frames are kept

    def __call__(self, day: int, flight: int) -> Flight:
        """Plan a flight, then fly it or reuse an equal flight that this process flew before."""
        run, evidence, decisions = self.run, Evidence(self.run.farm, self.run.fields), list[DecisionRecord]()
        with threadpool_limits(1, user_api="blas"):
            planned = plan_flight(run, day, flight, evidence, decisions)
            _spare_collector()
            flown = memory_of_process().fly(run, planned, self.environment, self.hosting)
            if flown is None:
                log = FrameLog() if self.logged else None
                cameras = partial(leaf_camera, run, environment=self.environment)
                flown = _fly_apart(run, planned, evidence, cameras, self.hosting, log, silent)
                flown = replace(flown, parts=evidence.parts, log=log)
        return replace(flown, decisions=decisions)


@cache
def _spare_collector() -> None:
    """Exempt all present objects from garbage collection; most of them live as long as the program."""
    gc.freeze()


def can_fly_ahead(run: Run, hosting: Hosting, expected_s: float) -> bool:
    """Return whether worker processes can fly the flights of a run, and save time.

    Workers cannot fly a policy (it needs the observations of earlier flights) or a planner object (it may not
    be picklable), and they do not fly in real time (users watch such flights). A worker process starts no
    more workers, since the cores are in use. `expected_s`: flight time summed over vehicles and flights.
    """
    from joblib import cpu_count

    farm = run.farm
    plain = isinstance(hosting, VirtualHosting) and hosting.pace is None
    return (
        plain
        and run.decider.named
        and not run.decider.steers
        and expected_s >= WORTH_S
        and farm.width_cells * farm.height_cells <= MOST_CELLS
        and cpu_count() > 1
        and multiprocessing.current_process().name == "MainProcess"
    )


class FlightsAhead:
    """Flies the flights of a run in one worker process per core, and returns them in order."""

    def __init__(self, fly: FlightAlone, numbers: Sequence[tuple[int, int]]) -> None:
        self._order = {number: k for k, number in enumerate(numbers)}
        self._calls = CallsAhead(fly, numbers)

    def take(self, day: int, flight: int) -> Flight | None:
        """Wait for a flight and return it; callers take each flight once, in order.

        None means that this process must fly the flight: the worker was killed, or raised an error (which
        this process will raise again), or a decision in flight lacked earlier flights' observations.
        """
        number = self._order.pop((day, flight), None)
        if number is None:
            return None
        with contextlib.suppress(WbfMissionError, MemoryError, BrokenProcessPool):
            flown = self._calls.result(number)
            if len(flown.decisions) <= 1:
                return flown
        return None

    def close(self) -> None:
        """End the processes."""
        self._calls.close()
