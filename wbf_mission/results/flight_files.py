"""The files of a run's flights: plans, tracks, and what the record says of each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from geo import Farm
from mission.files import read_mission, write_mission
from mission.ground.tracks import Track
from mission.outcome import Outcome
from mission.transfer.events import TransferStatistics
from sensors.camera.wire import AssemblerStatistics
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.prediction.flight import Prediction
from wbf_mission.planning import PlanResult
from wbf_mission.results.tables import read_table, write_table
from wbf_mission.run.flight_record import FlightRecord

TRACK, TRUE_TRACK = "track.parquet", "true_track.parquet"
_FLIGHT = ("day", "flight", "vehicle")
_TRACK = ("time_s", "latitude_deg", "longitude_deg", "relative_altitude_m", "x_m", "y_m")


class PlanEntry(msgspec.Struct, forbid_unknown_fields=True):
    """The parts of a `PlanResult` that have no file of their own."""

    planner: str | None
    path_m: list[tuple[float, float]]
    spacing_m: float | None
    budget_text: str
    length_m: float
    coverage: float
    batteries: int | None


class PredictionEntry(msgspec.Struct, forbid_unknown_fields=True):
    """A `Prediction` in plain values."""

    duration_s: float
    energy_wh: float
    battery_fraction: float
    path_length_m: float
    track_m: list[tuple[float, float, float]]
    track_step_s: float
    feasible: bool
    reason: str
    duration_interval_s: tuple[float, float] | None = None
    energy_interval_wh: tuple[float, float] | None = None
    energy_bound_wh: float | None = None
    items: list[int] = msgspec.field(default_factory=list)


class FlightEntry(msgspec.Struct, forbid_unknown_fields=True):
    """A `FlightRecord` without its mission and tracks."""

    day: int
    flight: int
    system_id: int
    outcome: str
    reason: str
    plan: PlanEntry
    prediction: PredictionEntry
    camera: AssemblerStatistics
    transfers: list[TransferStatistics]
    battery_used: float | None
    flight_time_s: float
    seen_before: int
    texts: list[tuple[float, int, str]]
    warnings: list[str]


def plan_name(number: int, flight: FlightRecord | FlightEntry) -> str:
    """Return the name of a flight's mission files without their ending; the first one's is ``plan``."""
    return "plan" if number == 0 else f"plan-day{flight.day}-flight{flight.flight}-vehicle{flight.system_id}"


def write_flights(flights: Sequence[FlightRecord], folder: Path) -> list[Path]:
    """Write the missions and tracks of flights, and return the files."""
    written = []
    for number, one in enumerate(flights):
        for suffix in (".plan", ".json"):
            path = folder / (plan_name(number, one) + suffix)
            write_mission(one.plan.mission, path)
            written.append(path)
    write_table(folder / TRACK, track_table(flights))
    written.append(folder / TRACK)
    if any(one.true_track is not None for one in flights):
        write_table(folder / TRUE_TRACK, true_track_table(flights))
        written.append(folder / TRUE_TRACK)
    return written


def flight_entries(flights: Sequence[FlightRecord]) -> list[FlightEntry]:
    """Return what a record holds of flights."""
    return [_entry(one) for one in flights]


def read_flights(
    entries: Sequence[FlightEntry], folder: Path, farm: Farm, vehicles: Sequence[VehicleSpec], seed: int
) -> tuple[FlightRecord, ...]:
    """Return the flights of a folder.

    Parameters
    ----------
    entries : sequence of FlightEntry
        Of its record.
    vehicles : sequence of VehicleSpec
        In the order of their system ids.
    seed : int
        The run's.

    Raises
    ------
    ValueError
        If the record or a table is damaged.
    """
    if not entries or not all(1 <= one.system_id <= len(vehicles) for one in entries):
        msg = "the record has no flights, or of vehicles that are not there"
        raise ValueError(msg)
    tracks = _read_tracks(folder / TRACK)
    true_path = folder / TRUE_TRACK
    true_tracks = _read_tracks(true_path) if true_path.is_file() else {}
    nowhere = Track(*(np.empty(0) for _ in _TRACK))
    flights = []
    for number, one in enumerate(entries):
        key = (one.day, one.flight, one.system_id)
        flights.append(
            FlightRecord(
                day=one.day,
                flight=one.flight,
                system_id=one.system_id,
                plan=_plan(number, one, folder, farm, vehicles[one.system_id - 1], seed),
                outcome=Outcome(one.outcome),
                reason=one.reason,
                track=tracks.get(key, nowhere),
                true_track=true_tracks.get(key),
                camera=one.camera,
                transfers=one.transfers,
                battery_used=one.battery_used,
                flight_time_s=one.flight_time_s,
                seen_before=one.seen_before,
                texts=one.texts,
                warnings=one.warnings,
            )
        )
    return tuple(flights)


def track_table(flights: Sequence[FlightRecord]) -> Any:
    """Return the tracks of flights as one pyarrow table, with the true positions where they are known."""
    import pyarrow as pa

    known = any(one.true_track is not None for one in flights)
    tables = []
    for one in flights:
        columns = [*_numbers(one, len(one.track.time_s)), one.track.time_s, *_positions(one.track)]
        names = [*_FLIGHT, *_TRACK]
        if known:
            true = one.track if one.true_track is None else one.true_track.at(one.track.time_s)
            columns += _positions(true)
            names += [f"true_{name}" for name in _TRACK[1:]]
        tables.append(pa.table(dict(zip(names, columns, strict=True))))
    return pa.concat_tables(tables)


def true_track_table(flights: Sequence[FlightRecord]) -> Any:
    """Return the true tracks of flights as one pyarrow table."""
    import pyarrow as pa

    tables = []
    for one in flights:
        if one.true_track is not None:
            track = one.true_track
            columns = [*_numbers(one, len(track.time_s)), track.time_s, *_positions(track)]
            tables.append(pa.table(dict(zip([*_FLIGHT, *_TRACK], columns, strict=True))))
    return pa.concat_tables(tables)


def _numbers(flight: FlightRecord, rows: int) -> list[np.ndarray[Any, Any]]:
    return [np.full(rows, one, np.int32) for one in (flight.day, flight.flight, flight.system_id)]


def _positions(track: Track) -> list[np.ndarray[Any, Any]]:
    return [track.latitude_deg, track.longitude_deg, track.altitude_m, track.x_m, track.y_m]


def _read_tracks(path: Path) -> dict[tuple[int, int, int], Track]:
    table = read_table(path, (*_FLIGHT, *_TRACK))
    numbers = np.stack([table.column(name).to_numpy() for name in _FLIGHT], axis=1)
    columns = [table.column(name).to_numpy().astype(np.float64, copy=False) for name in _TRACK]
    found = {}
    for row in np.unique(numbers, axis=0):
        mine = (numbers == row).all(axis=1)
        found[(int(row[0]), int(row[1]), int(row[2]))] = Track(*(column[mine] for column in columns))
    return found


def _entry(flight: FlightRecord) -> FlightEntry:
    plan, prediction = flight.plan, flight.plan.prediction
    return FlightEntry(
        day=flight.day,
        flight=flight.flight,
        system_id=flight.system_id,
        outcome=flight.outcome.value,
        reason=flight.reason,
        plan=PlanEntry(
            planner=plan.planner,
            path_m=plan.path_m.tolist(),
            spacing_m=plan.spacing_m,
            budget_text=plan.budget_text,
            length_m=plan.length_m,
            coverage=plan.coverage,
            batteries=plan.batteries,
        ),
        prediction=PredictionEntry(
            **{
                **{name: getattr(prediction, name) for name in prediction.__dataclass_fields__},
                "items": prediction.items.tolist(),
                "track_m": prediction.track_m.tolist(),
            }
        ),
        camera=flight.camera,
        transfers=flight.transfers,
        battery_used=flight.battery_used,
        flight_time_s=flight.flight_time_s,
        seen_before=flight.seen_before,
        texts=[(time_s, int(severity), text) for time_s, severity, text in flight.texts],
        warnings=list(flight.warnings),
    )


def _plan(
    number: int, entry: FlightEntry, folder: Path, farm: Farm, vehicle: VehicleSpec, seed: int
) -> PlanResult:
    planned = msgspec.structs.asdict(entry.plan)
    predicted = msgspec.structs.asdict(entry.prediction)
    track_m = np.asarray(predicted.pop("track_m"), np.float64).reshape(-1, 3)
    items = np.asarray(predicted.pop("items"), np.int64)
    return PlanResult(
        farm=farm,
        vehicle=vehicle,
        mission=read_mission(folder / f"{plan_name(number, entry)}.json"),
        path_m=np.asarray(planned.pop("path_m"), np.float64).reshape(-1, 2),
        prediction=Prediction(track_m=track_m, items=items, **predicted),
        seed=seed,
        **planned,
    )
