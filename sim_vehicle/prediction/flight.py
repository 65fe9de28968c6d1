"""Predicted flights of missions, alone or in batches, with the executor and motion of the simulator."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from geo.frame import LocalFrame
from sim_vehicle.autopilot import firmware_of
from sim_vehicle.energy.battery import WH_J
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.items import item_positions, mission_problems
from sim_vehicle.execution.state import (
    EPOCH_UNIX_S,
    BatteryDepleted,
    CameraCommand,
    CannotFly,
    CurrentChanged,
    MissionComplete,
)
from sim_vehicle.motion.model import MotionEvent

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mission.model import Mission
    from sim_vehicle.airframe.navigation_errors import EstimateErrors
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.execution.state import FlightEvent
    from sim_vehicle.weather.wind import Wind

_LONGEST_S = 86_400.0
# Time limit for the ideal vehicle: a long time step takes no more computing than a short time step.
_LONGEST_IDEAL_S = 3e8
_TRACK_POINTS = 20_000
# Compiled motion can store a track point at every 5th time step; the ideal vehicle's motion, at every step.
_GRID_STEPS = 5
_ENDLESS_WH = 1e6
Air: TypeAlias = "tuple[Wind | None, EstimateErrors | None]"
"""Wind of a flight, and errors of the autopilot's estimate."""


@dataclass(frozen=True, slots=True)
class Prediction:
    """Predicted time, energy and path of a mission, from take-off to the end of its last item.

    The intervals and the bound are None if the prediction is from a single flight.
    """

    duration_s: float
    """Time until the mission is complete (on the ground if it ends with a landing) or has failed."""
    energy_wh: float
    """Energy used; 0 for a vehicle without a power model."""
    battery_fraction: float
    """Battery charge at the end, 0 to 1."""
    path_length_m: float
    """Length of the flown path, including climbs."""
    track_m: NDArray[np.float64]
    """float64[n, 3]: east, north, up relative to home, every ``track_step_s`` and at the end."""
    track_step_s: float
    feasible: bool
    """Whether the vehicle completes the mission without using the battery's reserve."""
    reason: str
    """Reason why the mission is infeasible; empty if feasible."""
    duration_interval_s: tuple[float, float] | None = None
    """Interval that contains the durations of 90 % of the flights, if disturbances are random."""
    energy_interval_wh: tuple[float, float] | None = None
    energy_bound_wh: float | None = None
    """Energy that suffices for one flight with `sim_vehicle.prediction.predict.BOUND_PROBABILITY`."""
    items: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    """int64[n]: index of the item in flight at each track position; empty if unknown."""
    camera_orders: tuple[tuple[float, int], ...] = ()
    """Time and item index of each camera command."""

    @property
    def ground_length_m(self) -> float:
        """Length over ground from take-off to landing, as plans state their length.

        It is the flown length times the ratio of the track's horizontal length to its length in space. The
        length of the track alone would be wrong, because the track cuts corners and may be truncated.
        """
        steps = np.diff(self.track_m, axis=0, prepend=np.zeros((1, 3)))
        flown_m = float(np.sqrt((steps**2).sum(axis=1)).sum())
        over_m = float(np.hypot(steps[:, 0], steps[:, 1]).sum())
        return self.path_length_m * (over_m / flown_m) if flown_m > 0.0 else 0.0

    @property
    def most_wh(self) -> float:
        """Energy bound of one flight; without a bound, the expected energy."""
        return self.energy_wh if self.energy_bound_wh is None else self.energy_bound_wh


class PredictedFlight:
    """Flight to be predicted: one mission, flown once from home.

    The track has at most `track_points` positions; the track of a longer flight is truncated.
    """

    def __init__(
        self,
        mission: Mission,
        spec: VehicleSpec,
        air: Air,
        frame: LocalFrame | None,
        *,
        track_step_s: float,
        epoch_unix_s: float,
        endless: bool,
        track_points: int,
    ) -> None:
        if not track_step_s > 0.0:
            raise VehicleError(f"track_step_s {track_step_s} must be positive")
        self.spec = spec = without_end(spec) if endless else spec
        self.longest_s = _LONGEST_IDEAL_S if spec.is_ideal else _LONGEST_S
        self.executor: MissionExecutor | None = None
        self.events: list[FlightEvent] | None = None
        self.completed = False
        self._track_step_s = track_step_s
        home = frame if frame is not None else home_frame(mission)
        positions = item_positions(mission.items, home)
        takes_off = climbs_by_itself(spec)
        problems = mission_problems(mission.items, positions, spec, needs_takeoff=not takes_off)
        self._problem = next(iter(problems), None)
        if self._problem is not None:
            return
        wind, errors = air
        self.executor = executor = MissionExecutor(
            spec, home, wind=wind, takes_off=takes_off, epoch_unix_s=epoch_unix_s, estimate_errors=errors
        )
        motion = executor.motion
        tick_s = motion.step_s if spec.is_ideal else motion.step_s * _GRID_STEPS
        motion.track_every = max(1, round(track_step_s / tick_s))
        motion.track = np.empty((track_points, 3))
        self._track_step_s = motion.track_every * tick_s
        executor.mission.load(mission.items, positions)
        executor.arm()
        executor.start()

    def prediction(self) -> Prediction:
        """Return the result of the flight; fly the mission first if this has not been done."""
        executor, spec = self.executor, self.spec
        if executor is None:
            assert self._problem is not None
            track = np.zeros((1, 3))
            return Prediction(
                0.0, 0.0, 1.0, 0.0, track, self._track_step_s, feasible=False, reason=str(self._problem)
            )
        if self.events is None:
            self.events = executor.fly_through(self.longest_s)
        motion, state = executor.motion, executor.state()
        end_s, reason = self._end(executor, self.events)
        # The energy of the idling motors between touch-down and disarming does not count.
        energy_j = motion.energy_j
        if executor.time_s > end_s and spec.power is not None and not reason:
            idle_w = spec.power.avionics_w + spec.power.camera_w + spec.power.idle_w
            energy_j -= idle_w * (executor.time_s - end_s)
        self.completed = not reason
        fraction, too_little = self.left(energy_j / WH_J)
        reason = reason or too_little
        return Prediction(
            duration_s=end_s,
            energy_wh=energy_j / WH_J,
            battery_fraction=fraction,
            path_length_m=state.path_length_m,
            track_m=np.vstack([motion.track[: motion.track_points], np.array([state.position_m])]),
            track_step_s=self._track_step_s,
            feasible=not reason,
            reason=reason,
            items=self._items(motion.track_points),
            camera_orders=tuple(
                (event.time_s, event.seq) for event in self.events if isinstance(event, CameraCommand)
            ),
        )

    def _items(self, points: int) -> NDArray[np.int64]:
        """Return the item in flight at each position of the track and at the end."""
        changes = [event for event in self.events or () if isinstance(event, CurrentChanged)]
        times_s = self._track_step_s * np.arange(1, points + 2)
        since_s = np.array([event.time_s for event in changes])
        numbers = np.array([0, *(event.seq for event in changes)], dtype=np.int64)
        return numbers[np.searchsorted(since_s, times_s, side="left")]

    def left(self, energy_wh: float) -> tuple[float, str]:
        """Return the fraction of the battery left after using this energy, and a reason if it is too low."""
        battery = self.spec.battery
        if battery is None:
            return 1.0, ""
        fraction = min(1.0, max(0.0, 1.0 - energy_wh / battery.capacity_wh))
        if fraction >= battery.reserve_fraction:
            return fraction, ""
        reserve = 100.0 * battery.reserve_fraction
        left = 100.0 * fraction
        return fraction, f"{left:.0f} % of the battery is left at the end, the reserve is {reserve:.0f} %"

    @staticmethod
    def _end(executor: MissionExecutor, events: list[FlightEvent]) -> tuple[float, str]:
        """Return the end time of the flight, and a reason if the flight failed."""
        for event in events:
            if isinstance(event, CannotFly):
                return event.time_s, f"item {event.seq + 1}: {event.reason}"
            if isinstance(event, BatteryDepleted):
                item = executor.mission.current_seq + 1
                return event.time_s, f"the battery is empty after {event.time_s:.0f} s, at item {item}"
        for event in reversed(events):
            if isinstance(event, MissionComplete):
                return event.time_s, ""
        return executor.time_s, f"item {executor.mission.current_seq + 1} never ends"


def fly_all(
    missions: Sequence[Mission],
    spec: VehicleSpec,
    airs: Sequence[Air],
    frame: LocalFrame | None,
    track_step_s: float,
    *,
    epoch_unix_s: float = EPOCH_UNIX_S,
    endless: bool = False,
    track_points: int = _TRACK_POINTS,
) -> list[list[PredictedFlight]]:
    """Fly each mission in each of `airs`, all in one batch.

    The result includes missions that cannot be flown, with the reason.
    """
    flights = [
        [
            PredictedFlight(
                mission,
                spec,
                air,
                frame,
                track_step_s=track_step_s,
                epoch_unix_s=epoch_unix_s,
                endless=endless,
                track_points=track_points,
            )
            for air in airs
        ]
        for mission in missions
    ]
    flown = [flight for of_mission in flights for flight in of_mission if flight.executor is not None]
    # If there is only one flight, `prediction` flies it on demand.
    if len(flown) > 1 and not spec.is_ideal:
        _fly_together(flown)
    return flights


def _fly_together(flights: list[PredictedFlight]) -> None:
    # The import is here because the ideal vehicle needs no compiler.
    from sim_vehicle.motion.batch import VehicleBatch

    executors = [flight.executor for flight in flights if flight.executor is not None]
    batch = VehicleBatch([executor.motion for executor in executors], parallel=True)
    courses = [
        executor.course_through(flight.longest_s) for flight, executor in zip(flights, executors, strict=True)
    ]
    steps = np.zeros(len(flights), dtype=np.int64)
    stops = np.zeros(len(flights), dtype=np.bool_)
    events: list[MotionEvent | None] = [None] * len(flights)
    under_way = list(range(len(flights)))
    while under_way:
        for k in tuple(under_way):
            try:
                event = events[k]
                steps[k], stops[k] = next(courses[k]) if event is None else courses[k].send(event)
            except StopIteration as end:
                flights[k].events = end.value
                steps[k] = 0
                under_way.remove(k)
        found = batch.advance(steps, stop_each=stops)
        for k in under_way:
            events[k] = MotionEvent(int(found[k]))


def climbs_by_itself(spec: VehicleSpec) -> bool:
    """Whether the vehicle, as with PX4, takes off by itself if a mission has no take-off item."""
    firmware = firmware_of(spec)
    return spec.hovers and firmware is not None and firmware.takes_off


def without_end(spec: VehicleSpec) -> VehicleSpec:
    """Return a vehicle with a practically unlimited battery."""
    if spec.battery is None:
        return spec
    return replace(spec, battery=replace(spec.battery, capacity_wh=_ENDLESS_WH))


def home_frame(mission: Mission) -> LocalFrame:
    """Return the local frame with its origin at a mission's home, or else at its first position.

    Raises
    ------
    VehicleError
        If the mission has neither a home nor a position.
    """
    if mission.home is not None:
        return LocalFrame(mission.home.latitude_deg, mission.home.longitude_deg, mission.home.altitude_m)
    for item in mission.items:
        if item.has_position and (item.x, item.y) != (0.0, 0.0):
            return LocalFrame(item.x, item.y)
    msg = "the mission has no home and no position: where does it begin? Give the mission a home"
    raise VehicleError(msg)
