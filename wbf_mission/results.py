"""The folder that a run leaves: plan, telemetry log, observations, arrays, summary, pictures."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from geo.atomic import atomic_path, atomic_write
from mission.files import write_mission
from wbf_mission.scenario import Scenario, ScenarioError

if TYPE_CHECKING:
    from wbf_mission.flight import Progress
    from wbf_mission.flight_result import FlightResult
    from wbf_mission.report import FieldMap


_FILES = (
    "summary.json",
    "plan.plan",
    "flight.tlog",
    "observations.parquet",
    "track.csv",
    "truth.npy",
    "value.npy",
    "uncertainty.npy",
    "scores.csv",
    "path.png",
    "score.png",
)


@dataclass(frozen=True, slots=True)
class RunFolder:
    """Where a run's files go; files of that name are replaced, others in the folder are left alone.

    Parameters
    ----------
    path : Path
        The folder; it exists.
    """

    path: Path

    @classmethod
    def for_scenario(cls, scenario: Scenario, path: Path | None = None) -> RunFolder:
        """Make the folder and clear it of an older run's files; others are left alone.

        By default ``runs/FARM_PLANNER_ESTIMATOR_VEHICLE_SEED`` and a digest of what else is not the default.

        Raises
        ------
        ScenarioError
            If the folder cannot be made.
        """
        if path is None:
            path = Path("runs") / run_name(scenario)
        try:
            path.mkdir(parents=True, exist_ok=True)
            for file in (*(path / name for name in _FILES), *path.glob("field_*.png")):
                file.unlink(missing_ok=True)
        except OSError as error:
            msg = f"{path}: cannot be made a folder for the results ({error.strerror}); give another --out"
            raise ScenarioError(msg) from error
        return cls(path)

    @property
    def tlog(self) -> Path:
        """The telemetry log."""
        return self.path / "flight.tlog"

    def write(
        self, result: FlightResult, *, plots: bool = True, progress: Progress | None = None
    ) -> list[Path]:
        """Write everything that the run has, and return the files.

        ``plan.plan``, ``observations.parquet``, ``truth.npy``, ``value.npy`` and ``uncertainty.npy``
        (float32[3, W, H] in the order tylcv, ccr, soil), ``track.csv`` (what was flown), ``scores.csv``,
        ``summary.json`` and, with `plots`, the pictures.
        """
        written: list[Path] = []
        jobs: list[tuple[str, Any]] = [
            ("plan.plan", lambda path: write_mission(result.plan.mission, path)),
            ("observations.parquet", result.observations.save),
            ("track.csv", lambda path: _write_track(result, path)),
        ]
        if result.truth is not None:
            jobs.append(("truth.npy", lambda path: _write_array(path, result.truth)))
        if result.model is not None:
            model = result.model
            jobs.append(("value.npy", lambda path: _write_array(path, model.value)))
            jobs.append(("uncertainty.npy", lambda path: _write_array(path, model.uncertainty)))
            jobs.append(("scores.csv", lambda path: _write_scores(result, path)))
        jobs.insert(0, ("summary.json", lambda path: _write_summary(result, path)))
        if plots:
            jobs += _plot_jobs(result)
        for number, (name, job) in enumerate(jobs):
            if progress is not None:
                progress("writing results", number, len(jobs))
            job(self.path / name)
            written.append(self.path / name)
        return written


def run_name(scenario: Scenario) -> str:
    """Return a name for a run: farm, planner or mission, estimator, vehicle, seed, and a digest of the rest.

    The digest covers whatever is not the default and not told by the name, such as the folders of files and
    the parameters of a planner; so runs that differ have names that differ.
    """
    mission, default = scenario.mission, Scenario().to_dict()
    planner = mission.planner.name if mission.file is None else Path(mission.file).stem
    told = {
        "farm": Path(scenario.farm.name).stem,
        "planner": planner,
        "estimator": scenario.estimate.estimator.name,
        "vehicle": Path(scenario.vehicle.name).stem,
        "seed": scenario.seed,
    }
    rest = {
        key: value for key, value in scenario.to_dict().items() if value not in (told.get(key), default[key])
    }
    words = "_".join(re.sub(r"[^\w.-]", "-", str(told[key])) for key in list(told)[:-1])
    name = f"{words}_seed{scenario.seed}"
    if not rest:
        return name
    return f"{name}_{hashlib.sha256(msgspec.json.encode(sorted(rest.items()))).hexdigest()[:6]}"


def _write_array(path: Path, array: Any) -> None:
    with atomic_write(path, "wb") as stream:
        np.save(stream, np.asarray(array, dtype=np.float32), allow_pickle=False)


def _write_summary(result: FlightResult, path: Path) -> None:
    with atomic_write(path) as stream:
        stream.write(msgspec.json.format(msgspec.json.encode(result.summary())).decode() + "\n")


def _write_csv(path: Path, header: str, columns: list[Any], form: str | list[str]) -> None:
    with atomic_path(path) as temporary:
        table = np.column_stack(columns) if len(columns[0]) else np.empty((0, len(columns)))
        np.savetxt(temporary, table, delimiter=",", header=header, comments="", fmt=form)


def _write_track(result: FlightResult, path: Path) -> None:
    track = result.track
    columns = [track.time_s, track.latitude_deg, track.longitude_deg, track.altitude_m, track.x_m, track.y_m]
    names = ["latitude_deg", "longitude_deg", "relative_altitude_m", "x_m", "y_m"]
    form = ["%.7f", "%.7f", "%.3f", "%.3f", "%.3f"]
    header = ["time_s", *names]
    if result.true_track is not None:
        true = result.true_track.at(track.time_s)
        columns += [true.latitude_deg, true.longitude_deg, true.altitude_m, true.x_m, true.y_m]
        header += [f"true_{name}" for name in names]
        form *= 2
    _write_csv(path, ",".join(header), columns, ["%.3f", *form])


def _write_scores(result: FlightResult, path: Path) -> None:
    history = result.history
    names = [f"loss_{field}" for field in result.fields.names]
    header = ",".join(["time_s", "observations", "score", *names])
    columns: list[Any] = [history.times_s, history.observations, history.scores]
    columns += list(history.field_losses.T) if history.entries else [[] for _ in names]
    _write_csv(path, header, columns, "%.9g")


def _plot_jobs(result: FlightResult) -> list[tuple[str, Any]]:
    from wbf_mission import plots

    scenario, farm = result.scenario, result.farm
    mission, estimator = scenario.mission, scenario.estimate.estimator
    how = str(mission.planner) if mission.file is None else Path(mission.file).name
    title = f"{farm.name}: {how}, {result.plan.vehicle.name}"
    about = f"{farm.name}, day {scenario.farm.day}, {estimator}"
    track = np.column_stack((result.track.x_m, result.track.y_m))
    jobs: list[tuple[str, Any]] = [
        ("path.png", lambda path: plots.plot_paths(farm, result.plan.path_m, track, path, title))
    ]
    if result.maps:
        for estimate, truth in zip(result.maps, result.true_maps, strict=True):

            def draw(path: Path, estimate: FieldMap = estimate, truth: FieldMap = truth) -> None:
                plots.plot_field(farm, estimate, path, truth=truth, flown_m=track, about=about)

            jobs.append((f"field_{estimate.field.name}.png", draw))
        history = result.history
        if len(history.times_s):
            jobs.append(
                (
                    "score.png",
                    lambda path: plots.plot_score(
                        history.times_s,
                        history.scores,
                        history.field_losses,
                        path,
                        f"{title}, {estimator}",
                        result.fields,
                    ),
                )
            )
    return jobs
