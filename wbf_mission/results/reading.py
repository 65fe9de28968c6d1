"""The files of a run's folder: each written complete or not at all, and read back without trust."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from geo import Farm, farm_names, get_farm, load_farm, save_farm
from geo.atomic import atomic_write
from sensors.field_files import field_from_table, field_to_table
from sensors.fields import FieldSet
from sensors.observations import Observations
from sensors.scoring.information import CLASSES, InformationModel
from sensors.scoring.score import Score
from sim_vehicle.airframe.spec import VehicleSpec
from wbf_mission.maps.report import FarmReport
from wbf_mission.planning import flown_vehicle
from wbf_mission.replanning.files import DecisionEntry, decision_table
from wbf_mission.results.arrays import SUFFIX, read_array, read_maps, write_array, write_maps
from wbf_mission.results.flight_files import FlightEntry, flight_entries, read_flights, write_flights
from wbf_mission.results.tables import ResultError, read_table, write_table
from wbf_mission.run.estimation import ScoreHistory
from wbf_mission.run.fleet import single_scenarios
from wbf_mission.run.run_record import DayRecord, RunRecord, keeps_days
from wbf_mission.scenario import Scenario, scenario_with

R = TypeVar("R", bound=RunRecord)

FORMAT = 4
MAX_JSON_BYTES = 64 * 2**20
RECORD = "result.json"
PROBABILITIES = "probabilities_"
DECISIONS = "decisions.parquet"
_DAYS = "_days"
_SCORE = ("field_loss", "field_mse", "field_mae", "field_weighted_mae")


class _Day(msgspec.Struct, forbid_unknown_fields=True):
    """A `DayRecord` without its arrays."""

    day: int
    report: FarmReport | None


class _Record(msgspec.Struct, forbid_unknown_fields=True):
    """What `RECORD` holds: all of a result that has no file of its own."""

    format: int
    scenario: dict[str, Any]
    flights: list[FlightEntry]
    decisions: list[DecisionEntry]
    days: list[_Day]
    simulated_s: float
    frames: int
    timings_s: dict[str, float]
    environment_cached: bool
    fields: tuple[dict[str, Any], ...]
    files: tuple[str, ...]
    """Without which the result is not whole."""


def write_arrays(result: RunRecord, folder: Path, pool: Executor) -> dict[Path, Future[None]]:
    """Begin to write truth, value, uncertainty and class probabilities; return the files and what ends each.

    Compressing lets go of the interpreter's lock, so that the other files can be written meanwhile.
    """
    model = result.model
    arrays = {
        "truth": result.truth,
        "value": None if model is None else model.value,
        "uncertainty": None if model is None else model.uncertainty,
    }
    fields = result.observations.fields
    begun = {}
    if len(result.days) > 1:
        days: dict[str, list[Any]] = {
            "truth": [one.truth for one in result.days],
            "value": [None if one.model is None else one.model.value for one in result.days],
            "uncertainty": [None if one.model is None else one.model.uncertainty for one in result.days],
        }
        arrays |= {
            f"{name}{_DAYS}": np.stack(each)
            for name, each in days.items()
            if all(one is not None for one in each)
        }
    for name, array in arrays.items():
        if array is not None:
            path = folder / f"{name}{SUFFIX}"
            begun[path] = pool.submit(write_array, path, array, fields)
    probabilities = (model.probabilities if model is not None else None) or {}
    for disease in probabilities:
        path = _probabilities_path(folder, disease)
        # One disease after the other, as they may be computed only now and are large on large farms.
        begun[path] = pool.submit(
            lambda path=path, disease=disease: write_array(path, probabilities[disease], CLASSES)  # type: ignore[misc]
        )
    return begun


def _probabilities_path(folder: Path, disease: str) -> Path:
    return folder / f"{PROBABILITIES}{disease}{SUFFIX}"


def write_json(path: Path, values: Any) -> None:
    """Write plain values as JSON that people can read."""
    with atomic_write(path) as stream:
        stream.write(msgspec.json.format(msgspec.json.encode(values)).decode() + "\n")


def history_table(history: ScoreHistory, fields: tuple[str, ...]) -> Any:
    """Return the scored times as a table of pyarrow: when, observations, score, losses, errors by field."""
    import pyarrow as pa

    columns: dict[str, Any] = {
        "day": pa.array(history.days, pa.int32()),
        "time_s": pa.array(history.times_s, pa.float64()),
        "observations": pa.array(history.observations, pa.int64()),
        "score": pa.array(history.scores, pa.float64()),
        "authors_axis_max": pa.array([one.authors_axis_max for one in history.entries], pa.float64()),
    }
    for what in _SCORE:
        for number, field in enumerate(fields):
            values = [getattr(one, what)[number] for one in history.entries]
            columns[f"{what.removeprefix('field_')}_{field}"] = pa.array(values, pa.float64())
    return pa.table(columns)


def write_result(result: RunRecord, folder: Path, arrays: Iterable[Path]) -> list[Path]:
    """Write a result without its pictures into a folder, and return the files.

    The arrays are those that `write_arrays` writes; the record names them with the other files that make the
    result whole.
    """
    written = [folder / name for name in (RECORD, "summary.json")]
    write_json(written[1], result.summary())
    flown = write_flights(result.flights, folder)
    written += [*flown[1:2], *flown[:1], *flown[2:]]
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
    needed = tuple(path.name for path in (*written[2:], *arrays) if path.suffix != ".plan")
    write_json(written[0], _record(result, needed))
    return written


def read_result(folder: Path, kind: type[R]) -> R:
    """Read what `write_result` wrote; see `wbf_mission.results.result.load_result`."""
    record = _read_record(folder / RECORD)
    for name in record.files:
        if not (folder / name).is_file():
            msg = f"{folder / name}: is missing, so the result is not whole; save or fly it again"
            raise ResultError(msg)
    fields = FieldSet(tuple(field_from_table(one, str(folder / RECORD)) for one in record.fields))
    scenario = Scenario(**record.scenario)
    own_farm = folder / "farm.geojson"
    farm = load_farm(own_farm) if own_farm.is_file() else get_farm(scenario.farm.name)
    flights = read_flights(record.flights, folder, farm, _vehicles(scenario, folder), scenario.seed)
    truth, value, uncertainty = (
        _read_array(folder / f"{name}{SUFFIX}", fields.names, farm)
        for name in ("truth", "value", "uncertainty")
    )
    model = None
    if value is not None and uncertainty is not None:
        probabilities = {}
        for field in fields.diseases:
            array = _read_array(_probabilities_path(folder, field.name), CLASSES, farm)
            if array is not None:
                probabilities[field.name] = array
        model = InformationModel(value, uncertainty, fields=fields.names, probabilities=probabilities or None)
    return kind(
        scenario=scenario,
        flights=flights,
        observations=Observations.load(folder / "observations.parquet", fields.names),
        truth=truth,
        model=model,
        history=_read_history(folder / "scores.parquet", fields.names),
        simulated_s=record.simulated_s,
        frames=record.frames,
        timings_s=record.timings_s,
        environment_cached=record.environment_cached,
        fields=fields,
        maps=read_maps(folder / "maps.npz", "estimate", farm, fields),
        true_maps=read_maps(folder / "maps.npz", "truth", farm, fields),
        decisions=[one.record() for one in record.decisions],
        days=_read_days(record.days, folder, fields.names, farm),
    )


def _vehicles(scenario: Scenario, folder: Path) -> list[VehicleSpec]:
    """Return the vehicles of a run; those that came from a file are in the folder."""
    names = []
    for number, name in enumerate(scenario.vehicle.names, start=1):
        own = folder / _vehicle_name(number)
        names.append(str(own) if own.is_file() else name)
    own_files = scenario_with(scenario, {"vehicle": ",".join(names)})
    return [flown_vehicle(one.vehicle) for one in single_scenarios(own_files)]


def _vehicle_name(number: int) -> str:
    return "vehicle.toml" if number == 1 else f"vehicle-{number}.toml"


def _record(result: RunRecord, files: tuple[str, ...]) -> _Record:
    return _Record(
        format=FORMAT,
        scenario=result.scenario.to_dict(),
        flights=flight_entries(result.flights),
        decisions=[DecisionEntry.of(one) for one in result.decisions],
        days=[_Day(one.day, one.report) for one in result.days],
        simulated_s=result.simulated_s,
        frames=result.frames,
        timings_s=result.timings_s,
        environment_cached=result.environment_cached,
        fields=tuple(field_to_table(field) for field in result.fields),
        files=files,
    )


def _read_array(path: Path, fields: tuple[str, ...], farm: Farm) -> NDArray[np.float32] | None:
    """Return the array of a file; None without one."""
    return read_array(path, (len(fields), farm.width_cells, farm.height_cells)) if path.is_file() else None


def _read_days(
    entries: Sequence[_Day], folder: Path, fields: tuple[str, ...], farm: Farm
) -> tuple[DayRecord, ...]:
    """Return the days of a run, with truth and estimate where these were kept."""
    shape = (len(entries), len(fields), farm.width_cells, farm.height_cells)
    # One day's arrays are those of the run.
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
        msg = f"{path}: larger than {MAX_JSON_BYTES // 2**20} MiB; no result is"
        raise ResultError(msg)
    try:
        record = msgspec.json.decode(data, type=_Record)
    except (ValueError, RecursionError) as error:
        msg = f"{path}: is not the record of a result ({error})"
        raise ResultError(msg) from None
    if record.format != FORMAT:
        msg = f"{path}: has format {record.format}, this version reads {FORMAT}"
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
