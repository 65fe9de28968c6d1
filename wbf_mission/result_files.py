"""The files of a run's folder: each written complete or not at all, and read back without trust."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from geo import Farm, farm_names, get_farm, load_farm, save_farm
from geo.atomic import atomic_write
from geo.errors import WbfMissionError
from mission.files import read_mission, write_mission
from mission.outcome import Outcome
from mission.transfer.events import TransferStatistics
from sensors.camera.wire import AssemblerStatistics
from sensors.field_files import field_from_table, field_to_table
from sensors.fields import FieldSet
from sensors.observations import Observations
from sensors.scoring.information import CLASSES, InformationModel
from sensors.scoring.score import Score
from sim_vehicle.prediction.flight import Prediction
from wbf_mission.arrays import SUFFIX, read_array, write_array
from wbf_mission.estimation import ScoreHistory
from wbf_mission.map_files import read_maps, write_maps
from wbf_mission.outcome import Track
from wbf_mission.planning import PlanResult, flown_vehicle
from wbf_mission.run_record import RunRecord
from wbf_mission.scenario import Scenario, VehicleOptions

R = TypeVar("R", bound=RunRecord)

FORMAT = 2
MAX_JSON_BYTES = 64 * 2**20
RECORD = "result.json"
PROBABILITIES = "probabilities_"
_TRACK = ("time_s", "latitude_deg", "longitude_deg", "relative_altitude_m", "x_m", "y_m")
_SCORE = ("field_loss", "field_mse", "field_mae", "field_weighted_mae")


class ResultError(WbfMissionError, ValueError):
    """A folder that holds no result, or one that cannot be read or must not be replaced."""


class _Plan(msgspec.Struct, forbid_unknown_fields=True):
    """The parts of a `PlanResult` that have no file of their own."""

    planner: str | None
    path_m: list[tuple[float, float]]
    spacing_m: float | None
    budget_text: str
    length_m: float
    coverage: float
    batteries: int | None


class _Prediction(msgspec.Struct, forbid_unknown_fields=True):
    """A `Prediction` in plain values."""

    duration_s: float
    energy_wh: float
    battery_fraction: float
    path_length_m: float
    track_m: list[tuple[float, float, float]]
    track_step_s: float
    feasible: bool
    reason: str


class _Record(msgspec.Struct, forbid_unknown_fields=True):
    """What `RECORD` holds: all of a result that has no file of its own."""

    format: int
    scenario: dict[str, Any]
    outcome: str
    reason: str
    plan: _Plan
    prediction: _Prediction
    camera: AssemblerStatistics
    transfers: list[TransferStatistics]
    battery_used: float | None
    flight_time_s: float
    simulated_s: float
    frames: int
    timings_s: dict[str, float]
    texts: list[tuple[float, int, str]]
    warnings: list[str]
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
    begun = {
        folder / f"{name}{SUFFIX}": pool.submit(write_array, folder / f"{name}{SUFFIX}", array, fields)
        for name, array in arrays.items()
        if array is not None
    }
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


def write_table(path: Path, table: Any) -> None:
    """Write a pyarrow table as Parquet."""
    import pyarrow.parquet as pq

    with atomic_write(path, "wb") as stream:
        pq.write_table(table, stream, compression="zstd")


def write_json(path: Path, values: Any) -> None:
    """Write plain values as JSON that people can read."""
    with atomic_write(path) as stream:
        stream.write(msgspec.json.format(msgspec.json.encode(values)).decode() + "\n")


def track_table(track: Track, true_track: Track | None) -> Any:
    """Return a track as a pyarrow table, with the true positions at the same times where they are known."""
    import pyarrow as pa

    names = list(_TRACK)
    columns = [track.time_s, *_positions(track)]
    if true_track is not None:
        columns += _positions(true_track.at(track.time_s))
        names += [f"true_{name}" for name in _TRACK[1:]]
    return pa.table(dict(zip(names, columns, strict=True)))


def history_table(history: ScoreHistory, fields: tuple[str, ...]) -> Any:
    """Return the scored times as a pyarrow table: time, observations, score, losses and errors by field."""
    import pyarrow as pa

    columns: dict[str, Any] = {
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
    written = [folder / name for name in (RECORD, "summary.json", "plan.plan", "plan.json")]
    write_json(written[1], result.summary())
    write_mission(result.plan.mission, written[2])
    write_mission(result.plan.mission, written[3])
    result.observations.save(folder / "observations.parquet")
    write_table(folder / "track.parquet", track_table(result.track, result.true_track))
    write_table(folder / "scores.parquet", history_table(result.history, result.fields.names))
    written += [folder / f"{name}.parquet" for name in ("observations", "track", "scores")]
    if result.true_track is not None:
        write_table(folder / "true_track.parquet", track_table(result.true_track, None))
        written.append(folder / "true_track.parquet")
    if result.maps:
        write_maps(folder / "maps.npz", {"estimate": result.maps, "truth": result.true_maps})
        written.append(folder / "maps.npz")
    if result.scenario.farm.name.lower() not in farm_names():
        save_farm(result.farm, folder / "farm.geojson")
        written.append(folder / "farm.geojson")
    vehicle = Path(result.scenario.vehicle.name)
    if vehicle.is_file():
        shutil.copyfile(vehicle, folder / "vehicle.toml")
        written.append(folder / "vehicle.toml")
    needed = tuple(path.name for path in (*written[3:], *arrays))
    write_json(written[0], _record(result, needed))
    return written


def read_result(folder: Path, kind: type[R]) -> R:
    """Read what `write_result` wrote; see `wbf_mission.result.load_result`."""
    record = _read_record(folder / RECORD)
    for name in record.files:
        if not (folder / name).is_file():
            msg = f"{folder / name}: is missing, so the result is not whole; save or fly it again"
            raise ResultError(msg)
    fields = FieldSet(tuple(field_from_table(one, str(folder / RECORD)) for one in record.fields))
    scenario = Scenario(**record.scenario)
    own_farm, own_vehicle = folder / "farm.geojson", folder / "vehicle.toml"
    vehicle = scenario.vehicle
    if own_vehicle.is_file():
        vehicle = VehicleOptions(str(own_vehicle), vehicle.autopilot, vehicle.parameters)
    planned, predicted = msgspec.structs.asdict(record.plan), msgspec.structs.asdict(record.prediction)
    track_m = np.asarray(predicted.pop("track_m"), np.float64).reshape(-1, 3)
    plan = PlanResult(
        farm=load_farm(own_farm) if own_farm.is_file() else get_farm(scenario.farm.name),
        vehicle=flown_vehicle(vehicle),
        mission=read_mission(folder / "plan.json"),
        path_m=np.asarray(planned.pop("path_m"), np.float64).reshape(-1, 2),
        prediction=Prediction(track_m=track_m, **predicted),
        seed=scenario.seed,
        **planned,
    )
    truth, value, uncertainty = (
        _read_array(folder / f"{name}{SUFFIX}", fields.names, plan.farm)
        for name in ("truth", "value", "uncertainty")
    )
    model = None
    if value is not None and uncertainty is not None:
        probabilities = {}
        for field in fields.diseases:
            array = _read_array(_probabilities_path(folder, field.name), CLASSES, plan.farm)
            if array is not None:
                probabilities[field.name] = array
        model = InformationModel(value, uncertainty, fields=fields.names, probabilities=probabilities or None)
    true_track = folder / "true_track.parquet"
    return kind(
        scenario=scenario,
        plan=plan,
        outcome=Outcome(record.outcome),
        reason=record.reason,
        track=_read_track(folder / "track.parquet"),
        true_track=_read_track(true_track) if true_track.is_file() else None,
        observations=Observations.load(folder / "observations.parquet", fields.names),
        camera=record.camera,
        transfers=record.transfers,
        truth=truth,
        model=model,
        history=_read_history(folder / "scores.parquet", fields.names),
        battery_used=record.battery_used,
        flight_time_s=record.flight_time_s,
        simulated_s=record.simulated_s,
        frames=record.frames,
        timings_s=record.timings_s,
        texts=record.texts,
        warnings=record.warnings,
        environment_cached=record.environment_cached,
        fields=fields,
        maps=read_maps(folder / "maps.npz", "estimate", plan.farm, fields),
        true_maps=read_maps(folder / "maps.npz", "truth", plan.farm, fields),
    )


def _record(result: RunRecord, files: tuple[str, ...]) -> _Record:
    plan, prediction = result.plan, result.plan.prediction
    return _Record(
        format=FORMAT,
        scenario=result.scenario.to_dict(),
        outcome=result.outcome.value,
        reason=result.reason,
        plan=_Plan(
            planner=plan.planner,
            path_m=plan.path_m.tolist(),
            spacing_m=plan.spacing_m,
            budget_text=plan.budget_text,
            length_m=plan.length_m,
            coverage=plan.coverage,
            batteries=plan.batteries,
        ),
        prediction=_Prediction(**{**_fields_of(prediction), "track_m": prediction.track_m.tolist()}),
        camera=result.camera,
        transfers=result.transfers,
        battery_used=result.battery_used,
        flight_time_s=result.flight_time_s,
        simulated_s=result.simulated_s,
        frames=result.frames,
        timings_s=result.timings_s,
        texts=[(time_s, int(severity), text) for time_s, severity, text in result.texts],
        warnings=list(result.warnings),
        environment_cached=result.environment_cached,
        fields=tuple(field_to_table(field) for field in result.fields),
        files=files,
    )


def _read_array(path: Path, fields: tuple[str, ...], farm: Farm) -> NDArray[np.float32] | None:
    """Return the array of a file; None without one."""
    return read_array(path, (len(fields), farm.width_cells, farm.height_cells)) if path.is_file() else None


def _fields_of(value: Any) -> dict[str, Any]:
    return {name: getattr(value, name) for name in value.__dataclass_fields__}


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


def _positions(track: Track) -> list[NDArray[np.float64]]:
    return [track.latitude_deg, track.longitude_deg, track.altitude_m, track.x_m, track.y_m]


def _read_track(path: Path) -> Track:
    table = _read_table(path, _TRACK)
    return Track(*(table.column(name).to_numpy().astype(np.float64, copy=False) for name in _TRACK))


def _read_history(path: Path, fields: tuple[str, ...]) -> ScoreHistory:
    names = [f"{what.removeprefix('field_')}_{field}" for what in _SCORE for field in fields]
    table = _read_table(path, ("time_s", "observations", "score", "authors_axis_max", *names)).to_pydict()
    history = ScoreHistory(table["time_s"], table["observations"])
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


def _read_table(path: Path, columns: tuple[str, ...]) -> Any:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        msg = f"{path}: is not a Parquet file that can be read ({str(error).splitlines()[0]})"
        raise ResultError(msg) from None
    missing = [name for name in columns if name not in table.column_names]
    if missing:
        msg = f"{path}: no column {missing[0]}"
        raise ResultError(msg)
    return table
