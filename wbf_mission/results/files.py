"""Files of a run: plans, tracks, arrays, tables and the record."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec
import numpy as np
from numpy.typing import NDArray

from geo import Farm, farm_names, load_farm, save_farm
from geo.atomic import atomic_write
from mission.errors import MissionFileError
from mission.files import read_mission, write_mission
from mission.ground.tracks import Track
from mission.model import Mission
from mission.policies.decision import Alternative
from sensors.estimation import ScoreHistory
from sensors.field_files import field_from_table, field_to_table
from sensors.fields import FieldSet
from sensors.observations import Observations
from sensors.scoring.information import CLASSES, InformationModel
from sensors.scoring.score import Score
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.prediction.flight import Prediction
from wbf_mission.planning import PlanResult, flown_vehicle
from wbf_mission.planning.fleet import single_vehicles
from wbf_mission.replanning.record import DecisionRecord, PathChange, decision_table
from wbf_mission.results.storage import (
    SUFFIX,
    ResultError,
    lazy_array,
    read_array,
    read_maps,
    read_table,
    write_array,
    write_maps,
    write_strips,
    write_table,
)
from wbf_mission.run.record import DayRecord, FlightRecord, RunRecord, keeps_days
from wbf_mission.scenario import Scenario, scenario_with

TRACK, TRUE_TRACK = "track.parquet", "true_track.parquet"
_FLIGHT = ("day", "flight", "vehicle")
_TRACK = ("time_s", "latitude_deg", "longitude_deg", "relative_altitude_m", "x_m", "y_m")


def _entry_of(record: type[Any], **other: Any) -> type[Any]:
    """Return a strict struct type with the fields of a record.

    `other` gives the types of fields that differ in the file (arrays and nested records), or that only the
    file has. The file omits a field whose type is None.
    """
    kinds = get_type_hints(record) | other
    fields: list[Any] = []
    for field in dataclasses.fields(record):
        default = msgspec.NODEFAULT if field.default is dataclasses.MISSING else field.default
        if field.default_factory is not dataclasses.MISSING:
            default = msgspec.field(default_factory=field.default_factory)
        if kinds[field.name] is not None:
            fields.append((field.name, kinds.pop(field.name), default))
    fields += [(name, kind) for name, kind in kinds.items() if name in other and kind is not None]
    return msgspec.defstruct(f"{record.__name__}Entry", fields, kw_only=True, forbid_unknown_fields=True)


_POINTS = list[tuple[float, float]]
_APART = dict.fromkeys(("farm", "vehicle", "seed", "mission", "imaging"))
_Plan = _entry_of(PlanResult, path_m=_POINTS, prediction=None, **_APART)
_Prediction = _entry_of(Prediction, track_m=list[tuple[float, float, float]], items=list[int])
_Flight = _entry_of(FlightRecord, plan=_Plan, track=None, true_track=None, prediction=_Prediction)
_Decision = _entry_of(
    DecisionRecord,
    changes=list[_entry_of(PathChange, path_m=_POINTS)],  # type: ignore[misc]
    alternatives=tuple[_entry_of(Alternative, points_m=_POINTS), ...],  # type: ignore[misc]
)


def plan_name(number: int, flight: Any) -> str:
    """Return the name of a flight's mission files without suffix; it is ``plan`` for the first flight."""
    return "plan" if number == 0 else f"plan-day{flight.day}-flight{flight.flight}-vehicle{flight.system_id}"


def write_flights(flights: Sequence[FlightRecord], folder: Path, warn: Callable[[str], None]) -> list[Path]:
    """Write missions and tracks of flights, and return the files."""
    written = []
    for number, one in enumerate(flights):
        written += _write_mission(one.plan.mission, folder / f"{plan_name(number, one)}.plan", warn)
    write_table(folder / TRACK, track_table(flights))
    written.append(folder / TRACK)
    if any(flight.true_track is not None for flight in flights):
        write_table(folder / TRUE_TRACK, true_track_table(flights))
        written.append(folder / TRUE_TRACK)
    return written


def _write_mission(mission: Mission, path: Path, warn: Callable[[str], None]) -> list[Path]:
    """Write a mission as exact JSON, and as the plan `path` if a plan can hold it; return the files."""
    exact = path.with_suffix(".json")
    write_mission(mission, exact)
    try:
        write_mission(mission, path)
    except MissionFileError as error:
        if isinstance(error.__cause__, OSError):
            raise
        warn(f"{path.name} is left out, use {exact.name}: a plan cannot hold the mission: {error.__cause__}")
        return [exact]
    return [exact, path]


def read_flights(
    entries: Sequence[Any], folder: Path, farm: Farm, vehicles: Sequence[VehicleSpec], seed: int
) -> tuple[FlightRecord, ...]:
    """Read the flights of a folder."""
    if not entries or not all(1 <= entry.system_id <= len(vehicles) for entry in entries):
        raise ValueError("the record has no flights, or flights of vehicles that it does not name")
    tracks = _read_tracks(folder / TRACK)
    true_path = folder / TRUE_TRACK
    true_tracks = _read_tracks(true_path) if true_path.is_file() else {}
    nowhere = Track(*(np.empty(0) for _ in _TRACK))
    flights = []
    for number, one in enumerate(entries):
        key = (one.day, one.flight, one.system_id)
        predicted = _record_of(Prediction, one.prediction)
        plan = PlanResult(
            farm=farm,
            vehicle=vehicles[one.system_id - 1],
            mission=read_mission(folder / f"{plan_name(number, one)}.json"),
            prediction=replace(predicted, track_m=predicted.track_m.reshape(-1, 3)),
            seed=seed,
            **(msgspec.structs.asdict(one.plan) | {"path_m": np.reshape(one.plan.path_m, (-1, 2))}),
        )
        read = {"plan": plan, "track": tracks.get(key, nowhere), "true_track": true_tracks.get(key)}
        held = {name: kept for name, kept in msgspec.structs.asdict(one).items() if name != "prediction"}
        flights.append(FlightRecord(**(held | read)))
    return tuple(flights)


def track_table(flights: Sequence[FlightRecord]) -> Any:
    """Return the tracks of flights as one pyarrow table, with the true positions if they are known."""
    known = any(flight.true_track is not None for flight in flights)
    return _table(flights, [flight.track for flight in flights], with_true=known)


def true_track_table(flights: Sequence[FlightRecord]) -> Any:
    """Return the true tracks of flights as one pyarrow table."""
    return _table(flights, [flight.true_track for flight in flights])


def _table(
    flights: Sequence[FlightRecord], tracks: Sequence[Track | None], *, with_true: bool = False
) -> Any:
    import pyarrow as pa

    tables = []
    for one, track in zip(flights, tracks, strict=True):
        if track is None:
            continue
        numbers = [np.full(len(track.time_s), k, np.int32) for k in (one.day, one.flight, one.system_id)]
        columns = dict(zip([*_FLIGHT, *_TRACK], [*numbers, track.time_s, *_positions(track)], strict=True))
        if with_true:
            true = track if one.true_track is None else one.true_track.at(track.time_s)
            columns |= zip([f"true_{name}" for name in _TRACK[1:]], _positions(true), strict=True)
        tables.append(pa.table(columns))
    return pa.concat_tables(tables)


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


def _entry(kind: type[Any], record: object, **other: Any) -> Any:
    """Return the file's entry for a record; `other` has the fields whose values differ from the record."""
    names = [name for name in kind.__struct_fields__ if name not in other]
    return kind(**{name: getattr(record, name) for name in names}, **other)


def _record_of(kind: type[T], entry: Any) -> T:
    """Return the record that a file's entry describes."""
    return msgspec.convert(entry, kind, from_attributes=True, dec_hook=_array)


R = TypeVar("R", bound=RunRecord)
T = TypeVar("T")

FORMAT = 4
MAX_JSON_BYTES = 64 * 2**20
RECORD = "result.json"
REST = "rest.plan"
"""Unflown rest of a mission, if some of its sorties were not flown."""
PROBABILITIES = "probabilities_"
DECISIONS = "decisions.parquet"
WORLD = "world.toml"
"""File of the fields' true dynamics, if the user gave such a file."""
_DAYS = "_days"
_SCORE = ("field_loss", "field_mse", "field_mae", "field_weighted_mae")


_PLAIN = ("simulated_s", "frames", "timings_s", "environment_cached", "stopped")
"""Fields that have the same values in a result and in its record in the file."""


_Day = _entry_of(DayRecord, truth=None, model=None)


class _Record(msgspec.Struct, forbid_unknown_fields=True):
    """Contents of `RECORD`: the parts of a result for which there is no other file."""

    format: int
    scenario: dict[str, Any]
    flights: list[_Flight]  # type: ignore[valid-type]
    decisions: list[_Decision]  # type: ignore[valid-type]
    days: list[_Day]  # type: ignore[valid-type]
    simulated_s: float
    frames: int
    timings_s: dict[str, float]
    environment_cached: bool
    fields: tuple[dict[str, Any], ...]
    files: tuple[str, ...]
    """Files without which the result is incomplete."""
    stopped: str = ""


def write_arrays(result: RunRecord, folder: Path, pool: Executor) -> dict[Path, Future[None]]:
    """Start writing truth, estimate and class probabilities; return a future for each file.

    Compression releases the interpreter's lock, so other files can be written meanwhile.
    """
    model = result.model
    arrays: dict[str, Any] = {
        "truth": result.truth,
        "value": None if model is None else model.value,
        "uncertainty": None if model is None else model.uncertainty,
    }
    fields = result.observations.fields
    if len(result.days) > 1:
        models = [day.model for day in result.days]
        days: dict[str, list[Any]] = {
            "truth": [day.truth for day in result.days],
            "value": [None if model is None else model.value for model in models],
            "uncertainty": [None if model is None else model.uncertainty for model in models],
        }
        arrays |= {
            f"{name}{_DAYS}": each for name, each in days.items() if all(one is not None for one in each)
        }
    jobs: dict[Path, Callable[[], None]] = {}
    for name, array in arrays.items():
        if array is not None:
            path = folder / f"{name}{SUFFIX}"
            jobs[path] = partial(write_array, path, array, fields)
    for disease in (model.probabilities if model is not None else None) or {}:
        path = _probabilities_path(folder, disease)
        assert model is not None
        # Probabilities are written in strips: they are large on large farms, and may be computed on access.
        strip = partial(model.probabilities_in, disease)
        jobs[path] = partial(write_strips, path, strip, (len(CLASSES), *model.shape), CLASSES)
    # Probabilities need the most memory, so they are written first, before another thread draws pictures.
    begun = {path: pool.submit(job) for path, job in reversed(jobs.items())}
    return {path: begun[path] for path in jobs}


def _probabilities_path(folder: Path, disease: str) -> Path:
    return folder / f"{PROBABILITIES}{disease}{SUFFIX}"


def _array(kind: Any, value: Any) -> NDArray[Any]:
    ((number,),) = (get_args(one) for one in get_args(kind)[1:])
    return np.asarray(value, number)


def write_json(path: Path, values: Any) -> None:
    """Write plain values as indented JSON."""
    with atomic_write(path) as stream:
        stream.write(
            msgspec.json.format(msgspec.json.encode(values, enc_hook=np.ndarray.tolist)).decode() + "\n"
        )


def history_table(history: ScoreHistory, fields: tuple[str, ...]) -> Any:
    """Return the scores over time as a pyarrow table, with observations, and losses and errors by field."""
    import pyarrow as pa

    columns: dict[str, Any] = {
        "day": pa.array(history.days, pa.int32()),
        "time_s": pa.array(history.times_s, pa.float64()),
        "observations": pa.array(history.observations, pa.int64()),
        "score": pa.array(history.scores, pa.float64()),
        "authors_axis_max": pa.array([entry.authors_axis_max for entry in history.entries], pa.float64()),
    }
    for what in _SCORE:
        for number, field in enumerate(fields):
            values = [getattr(entry, what)[number] for entry in history.entries]
            columns[f"{what.removeprefix('field_')}_{field}"] = pa.array(values, pa.float64())
    return pa.table(columns)


def write_result(
    result: RunRecord, folder: Path, arrays: Iterable[Path], warn: Callable[[str], None]
) -> list[Path]:
    """Write a result without pictures into a folder, and return the files.

    `arrays` are the files of `write_arrays`. The record lists the files without which a result is incomplete.
    `warn` receives a line for each mission that a plan cannot hold.
    """
    written = [folder / name for name in (RECORD, "summary.json")]
    write_json(written[1], result.summary())
    written += write_flights(result.flights, folder, warn)
    if result.rest is not None:
        written += _write_mission(result.rest, folder / REST, warn)
    result.observations.save(folder / "observations.parquet")
    write_table(folder / "scores.parquet", history_table(result.history, result.fields.names))
    written += [folder / f"{name}.parquet" for name in ("observations", "scores")]
    if result.decisions:
        write_table(folder / DECISIONS, decision_table(result.decisions))
        written.append(folder / DECISIONS)
    if result.maps:
        write_maps(folder / "maps.npz", {"estimate": result.maps, "truth": result.true_maps})
        written.append(folder / "maps.npz")
    if result.scenario.farm.name.lower() not in farm_names():
        save_farm(result.farm, folder / "farm.geojson")
        written.append(folder / "farm.geojson")
    for number, name in enumerate(result.scenario.vehicle.names, start=1):
        if Path(name).is_file():
            path = folder / _vehicle_name(number)
            shutil.copyfile(name, path)
            written.append(path)
    if (world := result.scenario.farm.world) is not None and Path(world).is_file():
        shutil.copyfile(world, folder / WORLD)
        written.append(folder / WORLD)
    needed = tuple(path.name for path in (*written[2:], *arrays) if path.suffix != ".plan")
    write_json(written[0], _record(result, needed))
    return written


def read_result(folder: Path, kind: type[R], *, probabilities: bool = True, lazy: bool = False) -> R:
    """Read a result from the files of `write_result`; see `wbf_mission.results.result.load_result`."""
    record = _read_record(folder / RECORD)
    for name in record.files:
        if not (folder / name).is_file():
            msg = f"{folder / name}: is missing, so the result is incomplete; save or fly it again"
            raise ResultError(msg)
    fields = FieldSet(tuple(field_from_table(one, str(folder / RECORD)) for one in record.fields))
    scenario = Scenario(**record.scenario)
    if (folder / WORLD).is_file():
        scenario = scenario_with(scenario, {"world": str(folder / WORLD)})
    own_farm = folder / "farm.geojson"
    farm = load_farm(own_farm) if own_farm.is_file() else scenario.farm.load()
    farm = farm.scouting(fields.crops)
    flights = read_flights(record.flights, folder, farm, _vehicles(scenario, folder), scenario.seed)
    truth, value, uncertainty = (
        _read_array(folder / f"{name}{SUFFIX}", fields.names, farm, lazy=lazy)
        for name in ("truth", "value", "uncertainty")
    )
    model = None
    if value is not None and uncertainty is not None:
        classes = {}
        for field in fields.diseases if probabilities else ():
            array = _read_array(_probabilities_path(folder, field.name), CLASSES, farm)
            if array is not None:
                classes[field.name] = array
        model = InformationModel(value, uncertainty, fields=fields.names, probabilities=classes or None)
    rest = (folder / REST).with_suffix(".json")
    return kind(
        scenario=scenario,
        flights=flights,
        rest=read_mission(rest) if rest.name in record.files else None,
        observations=Observations.load(folder / "observations.parquet", fields.names),
        truth=truth,
        model=model,
        history=_read_history(folder / "scores.parquet", fields.names),
        **{name: getattr(record, name) for name in _PLAIN},
        fields=fields,
        maps=read_maps(folder / "maps.npz", "estimate", farm, fields),
        true_maps=read_maps(folder / "maps.npz", "truth", farm, fields),
        decisions=[_record_of(DecisionRecord, decision) for decision in record.decisions],
        days=_read_days(record.days, folder, fields.names, farm),
    )


def _vehicles(scenario: Scenario, folder: Path) -> list[VehicleSpec]:
    """Return the vehicles of a run; a user's vehicle files are read from the result's folder."""
    own_files = single_vehicles(scenario_with(scenario, {"vehicle": own_vehicles(scenario, folder)}))
    names = (Path(name).stem if name.lower().endswith(".toml") else name for name in scenario.vehicle.fleet)
    return [replace(flown_vehicle(one.vehicle), name=it) for one, it in zip(own_files, names, strict=True)]


def own_vehicles(scenario: Scenario, folder: Path) -> str:
    """Return the names of a run's vehicles, or of their files in the result's folder."""
    own = ((folder / _vehicle_name(number), name) for number, name in enumerate(scenario.vehicle.names, 1))
    return ",".join(str(file) if file.is_file() else name for file, name in own)


def _vehicle_name(number: int) -> str:
    return "vehicle.toml" if number == 1 else f"vehicle-{number}.toml"


def _record(result: RunRecord, files: tuple[str, ...]) -> _Record:
    return _Record(
        format=FORMAT,
        scenario=result.scenario.to_dict(),
        flights=[
            _entry(_Flight, flight, plan=_entry(_Plan, flight.plan), prediction=flight.plan.prediction)
            for flight in result.flights
        ],
        decisions=result.decisions,
        days=[_entry(_Day, day) for day in result.days],
        **{name: getattr(result, name) for name in _PLAIN},
        fields=tuple(field_to_table(field) for field in result.fields),
        files=files,
    )


def _read_array(
    path: Path, fields: tuple[str, ...], farm: Farm, *, lazy: bool = False
) -> NDArray[np.float32] | None:
    """Read the array of a file, now or (if `lazy`) at each access; return None if there is no file."""
    if not path.is_file():
        return None
    shape = len(fields), farm.width_cells, farm.height_cells
    return lazy_array(path, shape) if lazy else read_array(path, shape)


def _read_days(
    entries: Sequence[Any], folder: Path, fields: tuple[str, ...], farm: Farm
) -> tuple[DayRecord, ...]:
    """Read the days of a run, with truth and estimate if the run kept them."""
    shape = (len(entries), len(fields), farm.width_cells, farm.height_cells)
    # The arrays of a single day are the arrays of the run.
    end = _DAYS if len(entries) > 1 else ""
    paths = [folder / f"{name}{end}{SUFFIX}" for name in ("truth", "value", "uncertainty")]
    kept = keeps_days(farm, len(fields), len(entries))
    truth, value, uncertainty = (
        read_array(path, shape if end else shape[1:]).reshape(shape) if kept and path.is_file() else None
        for path in paths
    )
    days = []
    for k, one in enumerate(entries):
        model = None
        if value is not None and uncertainty is not None:
            model = InformationModel(value[k], uncertainty[k], fields=fields)
        days.append(DayRecord(one.day, one.report, None if truth is None else truth[k], model))
    return tuple(days)


def _read_record(path: Path) -> _Record:
    if not path.is_file():
        msg = f"{path.parent}: holds no result ({path.name} is missing); give the folder that a run wrote"
        raise ResultError(msg)
    with path.open("rb") as file:
        data = file.read(MAX_JSON_BYTES + 1)
    if len(data) > MAX_JSON_BYTES:
        msg = f"{path}: larger than {MAX_JSON_BYTES // 2**20} MiB, so it is not the record of a result"
        raise ResultError(msg)
    try:
        record = msgspec.json.decode(data, type=_Record)
    except (ValueError, RecursionError) as error:
        raise ResultError(f"{path}: is not the record of a result ({error})") from None
    if record.format != FORMAT:
        msg = f"{path}: has format {record.format}, but this version reads {FORMAT}; use another version"
        raise ResultError(msg)
    return record


def _read_history(path: Path, fields: tuple[str, ...]) -> ScoreHistory:
    names = [f"{what.removeprefix('field_')}_{field}" for what in _SCORE for field in fields]
    columns = ("day", "time_s", "observations", "score", "authors_axis_max", *names)
    table = read_table(path, columns).to_pydict()
    history = ScoreHistory(table["time_s"], table["observations"], days=table["day"])
    for row in range(len(history.times_s)):
        by_field: dict[str, Any] = {
            what: tuple(table[f"{what.removeprefix('field_')}_{field}"][row] for field in fields)
            for what in _SCORE
        }
        axis_max = table["authors_axis_max"][row]
        history.entries.append(
            Score(-table["score"][row], authors_axis_max=axis_max, fields=fields, **by_field)
        )
    return history
