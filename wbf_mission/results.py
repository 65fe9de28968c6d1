"""The folder that a run leaves: plan, telemetry log, observations, arrays, summary, pictures."""

from __future__ import annotations

import hashlib
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from geo.atomic import atomic_path, atomic_write
from mission.files import write_mission
from sensors.fields import PAPER_FIELDS
from wbf_mission.arrays import write_array
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
    "truth.zarr.zip",
    "value.zarr.zip",
    "uncertainty.zarr.zip",
    "scores.csv",
    "path.png",
    "score.png",
    *(f"field_{field}.png" for field in PAPER_FIELDS.names),
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
            for name in _FILES:
                (path / name).unlink(missing_ok=True)
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

        ``plan.plan``, ``observations.parquet``, ``truth``, ``value`` and ``uncertainty`` (float32[3, W, H] in
        the order tylcv, ccr, soil; `wbf_mission.arrays`), ``track.csv`` (what was flown), ``scores.csv``,
        ``summary.json`` and, with `plots`, the pictures.
        """
        written: list[Path] = []
        jobs: list[tuple[str, Any]] = [
            ("plan.plan", lambda path: write_mission(result.plan.mission, path)),
            ("observations.parquet", result.observations.save),
            ("track.csv", lambda path: _write_track(result, path)),
        ]
        arrays = {} if result.truth is None else {"truth.zarr.zip": result.truth}
        if result.model is not None:
            arrays["value.zarr.zip"] = result.model.value
            arrays["uncertainty.zarr.zip"] = result.model.uncertainty
            jobs.append(("scores.csv", lambda path: _write_scores(result, path)))
        jobs.insert(0, ("summary.json", lambda path: _write_summary(result, path)))
        if plots:
            jobs += _plot_jobs(result)
        # Compressing lets go of the interpreter's lock, so the pictures are drawn meanwhile.
        with ThreadPoolExecutor(1) as pool:
            writing = [
                pool.submit(write_array, self.path / name, array, PAPER_FIELDS.names)
                for name, array in arrays.items()
            ]
            try:
                for number, (name, job) in enumerate(jobs):
                    if progress is not None:
                        progress("writing results", number, len(jobs))
                    job(self.path / name)
                    written.append(self.path / name)
                for name, done in zip(arrays, writing, strict=True):
                    done.result()
                    written.append(self.path / name)
            finally:
                for done in writing:
                    done.cancel()
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
    names = [f"loss_{field}" for field in PAPER_FIELDS.names]
    header = ",".join(["time_s", "observations", "score", *names])
    columns = [history.times_s, history.observations, history.scores, *history.field_losses.T]
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
                    ),
                )
            )
    return jobs
