"""Flights that are flown once for all runs in which they would be the same, or ahead in other processes.

The vehicle of a planner flies its path whatever its camera sees. So a flight is decided by the mission, the
vehicle, the weather and, where something is drawn on the way, the seed; the environment, the errors of the
camera and the estimator are not among these. It is flown with cameras that number their readings
(`sensors.camera.leaf_camera`). What an environment gives to read then takes the places of the numbers.

Nor need the flights of a run wait for each other then: each draws from the random streams of its own number,
so those that are flown ahead are the same as one after the other. `wbf_mission.run.flight.fly_once` knows
nothing of all this.
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
from mission.link.codec.dialect import mavlink
from mission.link.codec.frames import FrameReader, FrameWriter
from mission.link.codec.typed import is_a
from mission.link.tlog import FrameLog
from sensors.camera.layout import LeafLayout
from sensors.camera.leaf_camera import Camera, ImageList, NumberingCamera
from sensors.environment import Environment
from sensors.environment.cache import EnvironmentMemory
from sensors.estimation import Evidence
from sensors.observations import Observations
from sim_vehicle.epoch import EPOCH_UNIX_S
from wbf_mission.events import EventStream, Progressed
from wbf_mission.planning import PlanResult
from wbf_mission.planning.assignment import SortieNumber
from wbf_mission.planning.fleet import Vehicle
from wbf_mission.progress import Progress, silent
from wbf_mission.replanning.record import DecisionRecord
from wbf_mission.run.flight import FlightInterrupted, PlannedFlight, fly_once, leaf_camera, plan_flight
from wbf_mission.run.hosting import Hosting, VirtualHosting
from wbf_mission.run.record import Flight, FlightRecord
from wbf_mission.run.resolve import Run

_SEQUENCE = 4
_ID = slice(7, 10)
_IMAGE_ID = mavlink.MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY.to_bytes(3, "little")


def log_of_readings(log: FrameLog, readings: NDArray[np.float32], layout: LeafLayout) -> FrameLog:
    """Return the log of the same flight with other readings, float32[n, fields] by their numbers.

    Its frames are MAVLink 2 and not signed, as our own components send them.
    """
    told = FrameLog()
    reader = FrameReader()
    write = told.write
    for frame, time_s in log:
        image = frame[_ID] == _IMAGE_ID
        write(_frame_of_readings(frame, reader, readings, layout) if image else frame, time_s)
    return told


def _frame_of_readings(
    frame: bytes, reader: FrameReader, readings: NDArray[np.float32], layout: LeafLayout
) -> bytes:
    """Return the frame of an image, with other readings if it is the leaf camera's."""
    (message,) = reader.feed(frame)
    assert is_a(message, mavlink.MAVLink_debug_float_array_message)
    if message.name == layout.name and layout.fits(message.data):
        message.data = _read(message.data, readings, layout)
    writer = FrameWriter(message.get_srcSystem(), message.get_srcComponent())
    writer.codec.seq = frame[_SEQUENCE]
    return writer.encode(message)


def _read(data: Sequence[float], readings: NDArray[np.float32], layout: LeafLayout) -> list[float]:
    part = layout.unpack(data)
    assert part is not None
    begin = 3 + len(layout.header)
    numbers = np.array(part.values).reshape(-1, len(layout.fields))[:, 0]
    known = ~np.isnan(numbers)
    values = np.full((len(numbers), len(layout.fields)), np.nan, np.float32)
    values[known] = readings[numbers[known].astype(np.int64)]
    return [*data[:begin], *values.ravel().tolist(), *data[begin + values.size :]]


MOST_FLIGHTS = 32
MOST_READINGS = 1_000_000
"""Of all flights that are kept."""


@dataclass(frozen=True, slots=True)
class _KeptFlight:
    """A flight without what its cameras saw."""

    records: tuple[FlightRecord, ...]
    images: ImageList
    seen: Observations  # Without values
    reading: NDArray[np.int64]  # int64[n]: which reading each observation is
    duration_s: float
    frames: int
    log: FrameLog | None  # With the numbers of the readings

    def of_run(self, run: Run, planned: PlannedFlight, environment: Environment) -> Flight:
        """Return the flight of a run, with what is seen in its environment."""
        cameras = [leaf_camera(run, number, environment) for number, _, _ in planned.sorties]
        readings = self.images.read(cameras)
        seen = replace(
            self.seen, day=np.full(len(self.seen), planned.day, np.int32), values=readings[self.reading]
        )
        log = self.log
        if log is not None:
            log = log_of_readings(log, readings, LeafLayout.of(run.fields.names))
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
        return Flight(records, self.duration_s, self.frames, (seen,), log=log)


class FlightMemory:
    """Keeps the flights that were used last, at `most` so many, and the small environments."""

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
        *,
        logged: bool = False,
    ) -> Flight | None:
        """Fly a flight, or take it as it was flown before; None if it has to be flown for its run alone.

        That is so if what is seen or a person at the other end of a link may change it, something goes wrong
        on purpose, it is very long, or something was decided on the way. With `logged` every frame is kept,
        whatever the hosting says.
        """
        expected = planned.expected_readings(run.looks)
        plain = isinstance(hosting, VirtualHosting) and replace(hosting, tlog=None) == VirtualHosting()
        if not plain or run.decider.steers or 2.0 * expected > MOST_READINGS:
            return None
        key = _key(run, planned, logged=logged)
        kept = self._kept.pop(key, None)
        if kept is None:
            kept = _flown(run, planned, hosting, progress, logged=logged)
            if kept is None:
                return None
        self._kept[key] = kept
        while len(self._kept) > self._most or self._readings > MOST_READINGS:
            self._kept.popitem(last=False)
        return kept.of_run(run, planned, environment)

    @property
    def _readings(self) -> int:
        return sum(len(one.reading) for one in self._kept.values())


@cache
def memory_of_process() -> FlightMemory:
    """Return the flights that all runs of this process share."""
    return FlightMemory()


def _flown(
    run: Run, planned: PlannedFlight, hosting: Hosting, progress: Progress, *, logged: bool
) -> _KeptFlight | None:
    """Fly a flight whose cameras number their readings; None if something was decided on the way."""
    evidence, decisions = Evidence(run.farm, run.fields), list[DecisionRecord]()
    if len(planned.sorties) > 1:
        # Some may take over the rest of one that is lost; the run's own records shall not tell of it twice.
        there = {number.system_id for number, _, _ in planned.sorties}
        gone = {one.task.system_id for one in run.vehicles} - there
        planned = plan_flight(run, planned.day, planned.flight, evidence, decisions, gone)
    images = ImageList(run.camera.footprint_cells**2)
    shape = run.farm.grid().shape
    order = [number.system_id for number, _, _ in planned.sorties]

    def camera(number: SortieNumber) -> NumberingCamera:
        return NumberingCamera(images, order.index(number.system_id), shape, run.camera)

    log = FrameLog() if logged else None
    flown = _fly_apart(run, planned, evidence, camera, hosting, log, progress)
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
        log,
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
    """Fly a flight for itself; what it gave until a Ctrl-C is of no use to a run."""
    events = EventStream()
    events.listen(lambda event: progress(event.what, event.done, event.total), Progressed)
    try:
        # Nobody knows yet when the flight begins: frames have their times since then.
        return fly_once(
            run,
            planned,
            evidence,
            cameras,
            hosting,
            events=events,
            writer=log,
            offset_s=-EPOCH_UNIX_S,
        )
    except FlightInterrupted:
        raise KeyboardInterrupt from None


def _key(run: Run, planned: PlannedFlight, *, logged: bool) -> bytes:
    """Return all that decides a flight, written out."""
    farm, frame = run.farm, run.farm.frame
    georeference = (frame.latitude_deg, frame.longitude_deg, frame.altitude_m, frame.rotation_deg)
    sorties = [_sortie_values(*one) for one in planned.sorties]
    drawn = None
    if any(_draws(one) for _, one, _ in planned.sorties):
        drawn = (run.seed, [number for number, _, _ in planned.sorties])
    return encode(
        [
            [georeference, farm.cell_size_m, farm.width_cells, farm.height_cells, farm.home_m],
            [run.camera.footprint_cells, run.fields.names],
            sorties,
            drawn,
            logged,
        ],
        order="deterministic",
    )


def _sortie_values(number: SortieNumber, vehicle: Vehicle, plan: PlanResult) -> list[object]:
    level = (vehicle.mission.altitude_m, vehicle.mission.cruise_speed_m_s)
    options = (vehicle.vehicle.values(), vehicle.weather.values(), level)
    return [number.system_id, vehicle.task.builder.home_m, plan.mission, plan.vehicle, options]


def _draws(flown: Vehicle) -> bool:
    """Whether a flight depends on chance."""
    weather, vehicle = flown.weather, flown.vehicle
    gusts = weather.wind_gust_m_s > 0.0 or weather.turbulence is not None
    errs = flown.task.builder.estimate_errors
    return gusts or errs or vehicle.gps_noise_m > 0.0 or vehicle.baro_noise_m > 0.0


WORTH_S = 6000.0
"""Seconds of simulated flight of a run from which on processes are worth their start."""
MOST_CELLS = 500_000
"""A larger environment is not sent to other processes."""


@dataclass(frozen=True, slots=True)
class FlightAlone:
    """Flies any flight of a run without the others."""

    run: Run  # With a decider that does not ask what is believed
    environment: Environment
    hosting: Hosting
    logged: bool = False  # Whether frames are kept

    def __call__(self, day: int, flight: int) -> Flight:
        """Plan a flight and fly it, unless it was flown in this process before."""
        run, evidence, decisions = self.run, Evidence(self.run.farm, self.run.fields), list[DecisionRecord]()
        with threadpool_limits(1, user_api="blas"):
            planned = plan_flight(run, day, flight, evidence, decisions)
            _spare_collector()
            flown = memory_of_process().fly(run, planned, self.environment, self.hosting, logged=self.logged)
            if flown is None:
                log = FrameLog() if self.logged else None
                cameras = partial(leaf_camera, run, environment=self.environment)
                flown = _fly_apart(run, planned, evidence, cameras, self.hosting, log, silent)
                flown = replace(flown, parts=evidence.parts, log=log)
        return replace(flown, decisions=decisions)


@cache
def _spare_collector() -> None:
    """Let the garbage collector leave alone what this process holds before its first flight: the program."""
    gc.freeze()


def can_fly_ahead(run: Run, hosting: Hosting, expected_s: float) -> bool:
    """Return whether the flights of a run can be flown in other processes, and whether that is worth it.

    Who steers has to see first; a flight in real time is followed while it goes on. A planner that is an
    object may be bound to this process. Where this process is itself one of several, these share the cores
    already. All vehicles fly for about `expected_s` in all flights.
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
    """Flies flights, by day and number, in as many processes as there are cores; gives them in order."""

    def __init__(self, fly: FlightAlone, numbers: Sequence[tuple[int, int]]) -> None:
        self._order = {number: k for k, number in enumerate(numbers)}
        self._calls = CallsAhead(fly, numbers)

    def take(self, day: int, flight: int) -> Flight | None:
        """Wait for a flight and return it; in their order, each once.

        None if it has to be flown here in its turn: a process was killed, something is wrong that is found
        again and told here, or something was decided on the way, by what was known when it was flown.
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
