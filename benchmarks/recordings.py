"""Recorded flights of real autopilots, and how far a simulated one is from them."""

from __future__ import annotations

import csv
import gzip
import io
import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geo.frame import LocalFrame
from mission.model import MissionItem
from sim_vehicle.autopilot import get_autopilot
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.state import CannotFly, Disarmed, FlightEvent, ItemReached

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim_vehicle.airframe.spec import VehicleSpec

__all__ = ["Comparison", "Flight", "Recording", "compare", "fly_recording", "load_recording"]

_SAMPLE_S = 0.1
_LIMIT_S = 7200.0
_WAYPOINT, _SPLINE = 16, 82
_COLUMNS = ("t_s", "east_m", "north_m", "up_m", "ve_m_s", "vn_m_s", "vu_m_s", "heading_deg")


@dataclass(frozen=True, slots=True)
class Flight:
    """A flight as a table.

    Parameters
    ----------
    time_s : float64[n]
        Since any moment.
    position_m, velocity_m_s : float64[n, 3]
        East, north, up about home.
    reached : tuple of (float, int)
        When each item was reached for the first time.
    end_s : float
        When the vehicle disarmed; NaN if it did not.
    """

    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    reached: tuple[tuple[float, int], ...]
    end_s: float

    def window(self, items: tuple[MissionItem, ...]) -> tuple[float, float]:
        """Return when the first and the last waypoint were reached.

        PX4 tells the item after the last waypoint in its place, when the two end together.

        Raises
        ------
        VehicleError
            If one of them was not.
        """
        seqs = [seq for seq, item in enumerate(items) if item.command in (_WAYPOINT, _SPLINE)]
        if len(seqs) < 2:
            msg = "a comparison needs a mission of two waypoints or more"
            raise VehicleError(msg)
        first = [time_s for time_s, seq in self.reached if seqs[0] <= seq < seqs[1]]
        last = [time_s for time_s, seq in self.reached if seq >= seqs[-1]]
        if not first or not last:
            msg = f"waypoint {seqs[-1] if first else seqs[0]} was never reached"
            raise VehicleError(msg)
        return min(first), min(last)


@dataclass(frozen=True, slots=True)
class Recording:
    """A recorded flight with its mission.

    Parameters
    ----------
    name, autopilot : str
    frame : LocalFrame
        About the recorded home.
    items : tuple of MissionItem
        As uploaded, without ArduPilot's home item.
    flight : Flight
    """

    name: str
    autopilot: str
    frame: LocalFrame
    items: tuple[MissionItem, ...]
    flight: Flight


@dataclass(frozen=True, slots=True)
class Comparison:
    """How far a flight is from a recorded one, from the first to the last waypoint.

    Parameters
    ----------
    recorded_s, simulated_s : float
        Time from the first to the last waypoint.
    mean_m, p95_m : float
        Distance of the flown path to the recorded path.
    correlation : float
        Of the speeds over time, both counted from the first waypoint.
    """

    recorded_s: float
    simulated_s: float
    mean_m: float
    p95_m: float
    correlation: float

    @property
    def time_error(self) -> float:
        """Relative error of the time."""
        return self.simulated_s / self.recorded_s - 1.0


def load_recording(path: Path) -> Recording:
    """Read ``<autopilot>-<mission>.json`` and the ``.csv.gz`` beside it.

    Raises
    ------
    VehicleError
        If a file cannot be read or is no recording.
    """
    try:
        data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        raw = gzip.decompress(path.with_suffix(".csv.gz").read_bytes()).decode("ascii")
        rows = csv.DictReader(io.StringIO(raw))
        table = np.array([[float(row[name]) for name in _COLUMNS] for row in rows])
        items = tuple(_item(item) for item in data["items"])
        reached = tuple((float(time_s), int(seq)) for time_s, seq in data["reached"])
        disarmed = [time_s for time_s, armed, _ in data["mode_changes"] if not armed and time_s > 3.0]
        latitude, longitude = data["home"]
        autopilot = str(data["autopilot"])
    except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
        msg = f"recording {path}: {error}"
        raise VehicleError(msg) from None
    if get_autopilot(autopilot).for_vehicle("multirotor").profile.home_at_zero:
        # Item 0 on the wire is home.
        items = items[1:]
        reached = tuple((time_s, seq - 1) for time_s, seq in reached)
    flight = Flight(
        table[:, 0], table[:, 1:4], table[:, 4:7], reached, float(disarmed[0]) if disarmed else float("nan")
    )
    return Recording(str(data["mission"]), autopilot, LocalFrame(latitude, longitude), items, flight)


def _item(item: dict[str, Any]) -> MissionItem:
    one, two, three, four = (None if value is None else float(value) for value in item["params"])
    place = item["x"] / 1e7, item["y"] / 1e7, float(item["z"])
    return MissionItem(int(item["command"]), int(item["frame"]), one, two, three, four, *place)


def fly_recording(recording: Recording, spec: VehicleSpec) -> Flight:
    """Fly the mission of a recording with a vehicle, from the ground, and sample it at 10 Hz.

    Raises
    ------
    VehicleError
        If the vehicle gives up or is still flying after two hours.
    """
    executor = MissionExecutor(spec, recording.frame, takes_off=True)
    executor.load(recording.items)
    executor.arm()
    executor.start()
    samples, events = [], list[FlightEvent]()
    end_s = float("nan")
    while executor.armed:
        state = executor.state()
        samples.append((state.time_s, *state.position_m, *state.velocity_m_s))
        for event in executor.advance(len(samples) * _SAMPLE_S):
            events.append(event)
            if isinstance(event, CannotFly):
                msg = f"{recording.name}: item {event.seq}: {event.reason}"
                raise VehicleError(msg)
            if isinstance(event, Disarmed):
                end_s = event.time_s
        if executor.time_s > _LIMIT_S:
            msg = f"{recording.name}: still flying after {_LIMIT_S:.0f} s"
            raise VehicleError(msg)
    table = np.array(samples)
    reached = tuple((event.time_s, event.seq) for event in events if isinstance(event, ItemReached))
    return Flight(table[:, 0], table[:, 1:4], table[:, 4:7], reached, end_s)


def compare(recording: Recording, flight: Flight) -> Comparison:
    """Compare a flight with the recorded one.

    Raises
    ------
    VehicleError
        If a waypoint was not reached in one of them.
    """
    spans = [one.window(recording.items) for one in (recording.flight, flight)]
    paths, speeds = [], []
    length = min(last - first for first, last in spans)
    grid = np.arange(0.0, length, _SAMPLE_S)
    for one, (first, last) in zip((recording.flight, flight), spans, strict=True):
        inside = (one.time_s >= first - _SAMPLE_S) & (one.time_s <= last + _SAMPLE_S)
        paths.append(one.position_m[inside])
        speed = np.linalg.norm(one.velocity_m_s, axis=1)
        speeds.append(np.interp(grid, one.time_s - first, speed))
    distance = _distance_to(paths[1], paths[0])
    return Comparison(
        recorded_s=spans[0][1] - spans[0][0],
        simulated_s=spans[1][1] - spans[1][0],
        mean_m=float(distance.mean()),
        p95_m=float(np.percentile(distance, 95.0)),
        correlation=float(np.corrcoef(speeds)[0, 1]),
    )


def _distance_to(points: NDArray[np.float64], path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of each point to a polyline."""
    least = np.full(len(points), np.inf)
    for begin, end in pairwise(path):
        way = end - begin
        size = float(way @ way)
        part = np.clip((points - begin) @ way / size, 0.0, 1.0) if size > 0.0 else np.zeros(len(points))
        gap = points - begin - part[:, None] * way
        np.minimum(least, np.einsum("ij,ij->i", gap, gap), out=least)
    distance: NDArray[np.float64] = np.sqrt(least)
    return distance
