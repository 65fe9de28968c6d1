"""Recorded flights of real autopilots, and their comparison with simulated flights."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.frame import LocalFrame
from mission.model import MissionItem
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.airframe.navigation_errors import EstimateErrors
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import flight_procedures, get_autopilot, with_autopilot
from sim_vehicle.errors import VehicleError
from sim_vehicle.execution.executor import MissionExecutor
from sim_vehicle.execution.state import CannotFly, Disarmed, FlightEvent, ItemReached
from sim_vehicle.weather.atmosphere import WindShear
from sim_vehicle.weather.wind import Wind

START_S = 3.0
"""Time of the change to mission mode in each recording (s)."""
_SAMPLE_S = 0.1
_LIMIT_S = 7200.0
_AFTER_S = 20.0
_WAYPOINT, _SPLINE = 16, 82
_COLUMNS = ("t_s", "east_m", "north_m", "up_m", "ve_m_s", "vn_m_s", "vu_m_s", "heading_deg")
# Simulated vehicle by the recording's vehicle name: a vehicle of the package, or the file of a vehicle of an
# autopilot's simulator.
_OWN = Path(__file__).parent / "vehicles"
_VEHICLES = {
    "copter": "quad",
    "10040": "quad",
    "plane": str(_OWN / "arduplane-sitl.toml"),
    "10041": str(_OWN / "px4-sih-airplane.toml"),
    "rover": str(_OWN / "ardurover-sitl.toml"),
    "10045": "rover",
}
_TURBULENCE_S = 0.1


@dataclass(frozen=True, slots=True)
class Flight:
    """Flight as a table of samples.

    Parameters
    ----------
    time_s : float64[n]
        Time since an arbitrary origin.
    position_m, velocity_m_s : float64[n, 3]
        East, north and up, relative to home.
    reached : tuple of (float, int)
        Time at which each item was first reached, and the item's number.
    end_s : float
        Time of disarming; NaN if the vehicle did not disarm.
    """

    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    reached: tuple[tuple[float, int], ...]
    end_s: float

    def window(self, items: tuple[MissionItem, ...]) -> tuple[float, float]:
        """Return the times at which the first and the last waypoint were reached.

        If the last waypoint and the next item end together, PX4 reports only the next item.

        Raises
        ------
        VehicleError
            If one of the two was not reached.
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
    """Recorded flight with its mission.

    Parameters
    ----------
    name, autopilot : str
    frame : LocalFrame
        Frame with the recorded home as origin.
    items : tuple of MissionItem
        Uploaded items, without ArduPilot's home item.
    flight : Flight
    vehicle : str
        Name or file of the simulated vehicle.
    parameters : dict
        Stored parameters of the autopilot. The oldest recordings, with default parameters, have none.
    heading_deg : float
        Heading at the start.
    """

    name: str
    autopilot: str
    frame: LocalFrame
    items: tuple[MissionItem, ...]
    flight: Flight
    vehicle: str = "quad"
    parameters: dict[str, float] = field(default_factory=dict)
    heading_deg: float = 0.0

    def spec(self) -> VehicleSpec:
        """Return the vehicle with those recorded parameters that affect the simulated motion."""
        bare = get_vehicle(self.vehicle)
        table = flight_procedures(with_autopilot(bare, self.autopilot)).parameters
        known = {name: value for name, value in self.parameters.items() if name in table}
        return with_autopilot(bare, self.autopilot, known)

    def wind(self) -> Wind | None:
        """Return the recorded wind (``SIM_WIND_*`` of ArduPilot's simulator); None for calm air.

        The simulator filters white noise of ten times ``SIM_WIND_TURB`` by 0.98 a step, which leaves a
        deviation of ``SIM_WIND_TURB`` m/s and a memory of 50 steps (``SIM_Aircraft.cpp``). Below 60 m the
        wind is less unless ``SIM_WIND_T`` is 1.
        """
        speed = self.parameters.get("SIM_WIND_SPD", 0.0)
        if speed == 0.0:
            return None
        gust = self.parameters.get("SIM_WIND_TURB", 0.0)
        from_deg = self.parameters.get("SIM_WIND_DIR", 180.0)
        shear = None if self.parameters.get("SIM_WIND_T") == 1.0 else WindShear("sitl")
        return Wind.from_direction(speed, from_deg, gust_m_s=gust, correlation_s=_TURBULENCE_S, shear=shear)


@dataclass(frozen=True, slots=True)
class Comparison:
    """Differences between a simulated and a recorded flight, from the first to the last waypoint.

    Parameters
    ----------
    recorded_s, simulated_s : float
        Time from the first to the last waypoint.
    mean_m, p95_m : float
        Mean and 95th percentile of the distance from the flown to the recorded path.
    correlation : float
        Correlation of the speeds over the time since the first waypoint.
    """

    recorded_s: float
    simulated_s: float
    mean_m: float
    p95_m: float
    correlation: float

    @property
    def time_error(self) -> float:
        """Relative error of the simulated time."""
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
        rows = np.genfromtxt(path.with_suffix(".csv.gz"), delimiter=",", names=True)
        table = np.column_stack([rows[name] for name in _COLUMNS])
        if not np.isfinite(table).all():
            raise ValueError("a sample is incomplete or no number")
        items = tuple(_item(item) for item in data["items"])
        reached = tuple((float(time_s), int(seq)) for time_s, seq in data["reached"])
        disarmed = [time_s for time_s, armed, _ in data["mode_changes"] if not armed and time_s > 3.0]
        latitude, longitude = data["home"]
        autopilot = str(data["autopilot"])
        vehicle = _VEHICLES[data.get("vehicle", "copter")]
        parameters = {str(name): float(value) for name, value in data.get("parameters", {}).items()}
    except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
        msg = f"recording {path}: {error}"
        raise VehicleError(msg) from None
    if get_autopilot(autopilot).for_vehicle(get_vehicle(vehicle).kind).profile.home_at_zero:
        # Item 0 of an ArduPilot mission is home.
        items = items[1:]
        reached = tuple((time_s, seq - 1) for time_s, seq in reached)
    flight = Flight(
        table[:, 0], table[:, 1:4], table[:, 4:7], reached, float(disarmed[0]) if disarmed else float("nan")
    )
    frame = LocalFrame(latitude, longitude)
    return Recording(
        str(data["mission"]), autopilot, frame, items, flight, vehicle, parameters, float(table[0, 7])
    )


def _item(item: dict[str, Any]) -> MissionItem:
    one, two, three, four = (None if value is None else float(value) for value in item["params"])
    place = item["x"] / 1e7, item["y"] / 1e7, float(item["z"])
    return MissionItem(int(item["command"]), int(item["frame"]), one, two, three, four, *place)


def fly_recording(
    recording: Recording, spec: VehicleSpec | None = None, estimate_errors: EstimateErrors | None = None
) -> Flight:
    """Fly the mission of a recording with a vehicle, from the ground, and sample it at 10 Hz.

    If the vehicle was still armed at the end of the recording, the simulation ends 20 s later.

    Parameters
    ----------
    recording : Recording
    spec : VehicleSpec, optional
        Vehicle, by default that of the recording.
    estimate_errors : EstimateErrors, optional
        Errors of the position estimate, by default none.

    Raises
    ------
    VehicleError
        If the vehicle cannot fly an item, or is still flying after two hours.
    """
    executor = MissionExecutor(
        recording.spec() if spec is None else spec,
        recording.frame,
        wind=recording.wind(),
        yaw_rad=math.radians(recording.heading_deg),
        takes_off=True,
        estimate_errors=estimate_errors,
    )
    executor.mission.load(recording.items)
    executor.arm()
    executor.start()
    samples, events = [], list[FlightEvent]()
    end_s = float("nan")
    enough_s = _LIMIT_S
    if math.isnan(recording.flight.end_s):
        enough_s = float(recording.flight.time_s[-1]) - START_S + _AFTER_S
    while executor.flight.armed and executor.time_s <= enough_s:
        state = executor.state()
        # Recordings contain the estimate from telemetry, so the samples include the estimate's error.
        height_m, *drift_m_s = executor.motion.estimate_error
        east_m, north_m, up_m = state.position_m
        velocity = (true + error for true, error in zip(state.velocity_m_s, drift_m_s, strict=True))
        samples.append((state.time_s, east_m, north_m, up_m + height_m, *velocity))
        for event in executor.advance(len(samples) * _SAMPLE_S):
            events.append(event)
            if isinstance(event, CannotFly):
                msg = f"{recording.name}: item {event.seq}: {event.reason}"
                raise VehicleError(msg)
            if isinstance(event, Disarmed):
                end_s = event.time_s
    if executor.flight.armed and enough_s == _LIMIT_S:
        msg = f"{recording.name}: still flying after {_LIMIT_S:.0f} s"
        raise VehicleError(msg)
    table = np.array(samples)
    reached = tuple((event.time_s, event.seq) for event in events if isinstance(event, ItemReached))
    return Flight(table[:, 0], table[:, 1:4], table[:, 4:7], reached, end_s)


def compare(recording: Recording, flight: Flight) -> Comparison:
    """Compare a flight with the recorded one, without heights for rovers, where heights are only noise.

    Raises
    ------
    VehicleError
        If one of the flights did not reach the first or the last waypoint.
    """
    spans = [one.window(recording.items) for one in (recording.flight, flight)]
    paths, speeds = [], []
    flies = get_vehicle(recording.vehicle).kind != "rover"
    length = min(last - first for first, last in spans)
    grid = np.arange(0.0, length, _SAMPLE_S)
    for one, (first, last) in zip((recording.flight, flight), spans, strict=True):
        inside = (one.time_s >= first - _SAMPLE_S) & (one.time_s <= last + _SAMPLE_S)
        paths.append(one.position_m[inside] * (1.0, 1.0, 1.0 if flies else 0.0))
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
