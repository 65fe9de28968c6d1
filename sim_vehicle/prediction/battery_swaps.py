"""Number of batteries that a mission needs if the vehicle returns home to change them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mission.model import Command, MissionItem
from sim_vehicle.energy.battery import WH_J
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.items import item_positions, mission_problems
from sim_vehicle.execution.state import CannotFly, Disarmed, ItemReached, MissionComplete
from sim_vehicle.prediction.flight import climbs_by_itself, home_frame, without_end
from sim_vehicle.prediction.predict import rehearsals

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from geo.frame import LocalFrame
    from mission.model import Mission
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.execution.state import FlightEvent
    from sim_vehicle.prediction.flight import Prediction
    from sim_vehicle.weather.wind import Wind

_SAMPLE_S = 1.0


@dataclass(frozen=True, slots=True)
class BatteryChange:
    """Interruption of a mission for a battery change."""

    time_s: float
    """Time at which the uninterrupted mission is at the place of the change."""
    place_m: tuple[float, float, float]
    """Position at which the next battery continues: east, north, up relative to home."""
    seq: int
    """Index of the item in flight."""
    energy_wh: float
    """Energy that the old battery has given by the time the vehicle is home."""


def batteries_needed(
    mission: Mission,
    spec: VehicleSpec,
    prediction: Prediction,
    *,
    wind: Wind | None = None,
    frame: LocalFrame | None = None,
) -> int | None:
    """Return the number of full batteries, used down to their reserves, that a mission needs.

    If one battery is too little, the vehicle interrupts the mission when the remaining charge just suffices
    for the return; the next battery continues there (see `battery_changes`). The result is 0 for a vehicle
    without a battery, and None if no number suffices, because the mission cannot be flown, or because a full
    battery does not suffice to reach a position and return.

    Examples
    --------
    >>> from mission.model import GeoPoint, Mission, MissionItem
    >>> from sim_vehicle.prediction.predict import predict_flight
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> takeoff = MissionItem(22, 3, 0, 0, 0, None, 28.05, -82.15, 10.0)
    >>> rows = [MissionItem.waypoint(28.05 + 0.008 * (k % 2), -82.15, 10.0) for k in range(1, 21)]
    >>> long = Mission((takeoff, *rows, MissionItem(20, 2)), GeoPoint(28.05, -82.15))
    >>> quad = get_vehicle("quad")
    >>> batteries_needed(long, quad, predict_flight(long, quad))
    2
    """
    if spec.battery is None:
        return 0 if prediction.feasible else None
    if prediction.feasible:
        return 1
    changes = battery_changes(mission, spec, wind=wind, frame=frame)
    return None if changes is None else len(changes) + 1


# Number of attempts to find the place of a battery change; each flies a return and corrects the place.
_MAX_TRIALS = 6
# Fraction of the battery that may remain unused.
_UNUSED_SHARE = 0.003


def battery_changes(
    mission: Mission, spec: VehicleSpec, *, wind: Wind | None = None, frame: LocalFrame | None = None
) -> tuple[BatteryChange, ...] | None:
    """Return the battery changes of a mission, or None if no number of changes suffices.

    The mission is flown once with an unlimited battery. Trial flights to a place and home, with the mission's
    take-off, return and wind, find the place of each change. Each battery, without its reserve, lasts for the
    flight out, a part of the mission and the return. In a gusty wind all flights meet one sample of gusts.
    """
    battery = spec.battery
    if battery is None:
        return ()
    home = frame if frame is not None else home_frame(mission)
    positions = item_positions(mission.items, home)
    if any(mission_problems(mission.items, positions, spec, needs_takeoff=not climbs_by_itself(spec))):
        return None
    ground = TrialFlights(mission, spec, home, wind)
    whole = ground.fly(mission.items)
    if whole is None:
        return None
    usable = battery.capacity_wh * (1.0 - battery.reserve_fraction)
    used, track = whole.energy_wh, whole.place_m
    # This is a first estimate of the return energy; flights of the return correct it.
    mean_w = used[-1] / max(whole.time_s[-1], 1.0)
    rough = mean_w * time_home_s(track, spec)
    changes: list[BatteryChange] = []
    begin, out, more = 0, 0.0, 0.0
    while out + used[-1] - used[begin] > usable:
        spent = out + used - used[begin]
        last, back = begin, math.inf
        for _ in range(_MAX_TRIALS):
            over = np.flatnonzero(spent[begin + 1 :] + rough[begin + 1 :] + more > usable)
            at = begin + (int(over[0]) if len(over) else len(spent) - 2 - begin)
            if at in (begin, last):
                break
            last = at
            transits = ground.there_and_back(track[at], int(whole.seq[at]))
            if transits is None:
                return None
            next_out, back = transits.out_wh, transits.back_wh
            more = back - float(rough[at])
            if usable - _UNUSED_SHARE * battery.capacity_wh <= spent[at] + back <= usable:
                break
        while last > begin and spent[last] + back > usable:
            # If the last correction increased the return energy, turn back earlier by the excess.
            last -= max(1, math.ceil((spent[last] + back - usable) * WH_J / mean_w / _SAMPLE_S))
            transits = ground.there_and_back(track[max(last, begin)], int(whole.seq[max(last, begin)]))
            if transits is None:
                return None
            next_out, back = transits.out_wh, transits.back_wh
        if last <= begin:
            return None
        x, y, z = track[last].tolist()
        energy = float(spent[last]) + back
        changes.append(BatteryChange(float(whole.time_s[last]), (x, y, z), int(whole.seq[last]), energy))
        begin, out = last, next_out
    return tuple(changes)


def time_home_s(positions_m: NDArray[np.float64], spec: VehicleSpec) -> NDArray[np.float64]:
    """Estimate the time of a return at cruise speed and a descent, from positions, float64[n, 3]."""
    time_s: NDArray[np.float64] = np.hypot(positions_m[:, 0], positions_m[:, 1]) / spec.cruise_speed_m_s
    if not spec.drives:
        time_s += positions_m[:, 2] / spec.descent_speed_m_s
    return time_s


@dataclass(frozen=True, slots=True)
class TrialFlight:
    """A flight, sampled n times at short intervals."""

    time_s: NDArray[np.float64]
    """float64[n]."""
    place_m: NDArray[np.float64]
    """float64[n, 3]: east, north, up relative to home."""
    energy_wh: NDArray[np.float64]
    """float64[n]: energy drawn from the battery."""
    seq: NDArray[np.int64]
    """int64[n]: index of the item in flight."""
    reached_s: dict[int, float]
    """Completion time of each item."""


@dataclass(frozen=True, slots=True)
class Transit:
    """Time and energy of the flights from home to a position and back."""

    out_s: float
    out_wh: float
    back_s: float
    back_wh: float


_LONGEST_S = 86_400.0
_GROUND_M = 0.5


class TrialFlights:
    """Trial flights of a mission, and of transits to and from its positions, with an unlimited battery.

    In a gusty wind all flights meet the same sample of gusts.
    """

    def __init__(self, mission: Mission, spec: VehicleSpec, home: LocalFrame, wind: Wind | None) -> None:
        self._items = mission.items
        endless, air = without_end(spec), rehearsals(wind)[0]
        self._new: Callable[[], MissionExecutor] = lambda: MissionExecutor(
            endless, home, wind=air, takes_off=climbs_by_itself(spec)
        )
        self._home = home
        takeoff = [k for k, item in enumerate(mission.items) if item.command == Command.NAV_TAKEOFF]
        self._begin = mission.items[: takeoff[0] + 1] if takeoff else ()
        landing = [k for k, item in enumerate(mission.items) if item.command == Command.DO_LAND_START]
        self._end = mission.items[landing[0] :] if landing else (MissionItem(20, 2),)

    def there_and_back(self, place_m: NDArray[np.float64], seq: int) -> Transit | None:
        """Return time and energy of the transits to a position in the mission and back; None if impossible.

        `place_m` is east, north, up relative to home.
        """
        x, y, z = place_m.tolist()
        speeds = [item for item in self._items[:seq] if item.command == Command.DO_CHANGE_SPEED][-1:]
        latitude, longitude = self._home.to_wgs84(x, y)
        there = MissionItem.waypoint(latitude, longitude, max(z, _GROUND_M))
        record = self.fly((*self._begin, *speeds, there, *self._end))
        if record is None:
            return None
        arrived_s = record.reached_s[len(self._begin) + len(speeds)]
        out = float(np.interp(arrived_s, record.time_s, record.energy_wh))
        back_s = float(record.time_s[-1]) - arrived_s
        return Transit(arrived_s, out, back_s, float(record.energy_wh[-1]) - out)

    def fly(self, items: tuple[MissionItem, ...]) -> TrialFlight | None:
        """Fly items to their end and return the flight; None if they never end or cannot be flown."""
        executor = self._new()
        motion = executor.motion
        executor.mission.load(items)
        executor.arm()
        executor.start()
        samples: list[tuple[float, float, float, float, float, float]] = []
        reached: dict[int, float] = {}
        end_s = math.inf

        def sample() -> None:
            samples.append(
                (motion.time_s, *motion.position_m, motion.energy_j / WH_J, executor.mission.current_seq)
            )

        sample()
        while executor.flight.armed and end_s == math.inf:
            events: list[FlightEvent] = executor.advance(executor.time_s + _SAMPLE_S)
            sample()
            for event in events:
                if isinstance(event, ItemReached):
                    reached.setdefault(event.seq, event.time_s)
                elif isinstance(event, MissionComplete):
                    end_s = event.time_s
                elif isinstance(event, CannotFly | Disarmed) and end_s == math.inf:
                    return None
            if executor.time_s > _LONGEST_S:
                return None
        if end_s == math.inf:
            return None
        table = np.array(samples)
        return TrialFlight(table[:, 0], table[:, 1:4], table[:, 4], table[:, 5].astype(np.int64), reached)
