"""Runs of the comparison figure, with data that benchmark rows lack: path, truth and estimate."""

from __future__ import annotations

import zipfile
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from geo.atomic import atomic_write
from geo.processes import CallsAhead
from mission.ground.tracks import Track
from mission.outcome import Outcome
from wbf_mission.addons.base.plots import shown_every
from wbf_mission.bench.spec import BenchRun
from wbf_mission.flight import fly
from wbf_mission.progress import Progress
from wbf_mission.results.storage import ResultError
from wbf_mission.run.resolve import FlightError

_ARRAYS = {"path_m": 2, "truth": 3, "estimate": 3}


@dataclass(frozen=True, slots=True)
class ShownRun:
    """The data of one run that the figure shows."""

    path_m: NDArray[np.float32]
    """[n, 2]: the path flown; rows of NaN separate flights."""
    truth: NDArray[np.float32]
    """[fields, w, h] at the end of the run, like `estimate`; subsampled on a large farm."""
    estimate: NDArray[np.float32]
    axis_max: float
    """Score of the last estimate by the published code (`sensors.scoring.score.Score.authors_axis_max`)."""

    @classmethod
    def flown(cls, run: BenchRun) -> Self:
        """Fly a run and return its data; raise WbfMissionError if the run fails, or has no estimate."""
        result = fly(run.scenario)
        if result.outcome is Outcome.INTERRUPTED:
            raise KeyboardInterrupt
        if result.truth is None or result.model is None or not result.history.entries:
            msg = f"{run.planner}, {run.estimator}, seed {run.seed}: {result.reason or 'it saw nothing'}"
            raise FlightError(msg)
        track: Track = result.track
        stride = shown_every(result.truth.shape)
        return cls(
            np.stack([track.x_m, track.y_m], axis=1).astype(np.float32),
            result.truth[:, ::stride, ::stride].astype(np.float32),
            result.model.value[:, ::stride, ::stride].astype(np.float32),
            float(result.history.entries[-1].authors_axis_max),
        )

    def save(self, path: Path) -> None:
        """Write the run to `path`; the file is complete or absent."""
        with atomic_write(path, "wb") as file:
            np.savez_compressed(
                file,
                path_m=self.path_m,
                truth=self.truth,
                estimate=self.estimate,
                axis_max=np.float64(self.axis_max),
            )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file that `save` wrote; raise ResultError if the file is not a saved run."""
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: np.asarray(file[name], np.float32) for name in _ARRAYS}
                axis_max = float(file["axis_max"])
        except (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile) as error:
            msg = f"{path}: holds no run to be shown ({str(error).splitlines()[0]}); remove it"
            raise ResultError(msg) from None
        found = cls(**arrays, axis_max=axis_max)
        fit = all(arrays[name].ndim == axes for name, axes in _ARRAYS.items())
        if not fit or found.path_m.shape[1] != 2 or found.truth.shape != found.estimate.shape:
            raise ResultError(f"{path}: holds no run to be shown (its arrays have wrong shapes); remove it")
        return found


def _keep(run: BenchRun, path: Path) -> None:
    ShownRun.flown(run).save(path)


def shown_runs(
    runs: list[BenchRun], folder: Path, *, jobs: int, progress: Progress
) -> dict[tuple[str, str], ShownRun]:
    """Return each run's data to draw, by planner and estimator; runs absent from the folder are flown.

    Raises ResultError if a file in the folder is damaged, another WbfMissionError if a run has no result. At
    Ctrl-C, finished runs stay in the folder.
    """
    from joblib import effective_n_jobs

    folder.mkdir(parents=True, exist_ok=True)
    files = {run.key: folder / f"{run.key}.npz" for run in runs}
    missing = [(run, files[run.key]) for run in runs if not files[run.key].exists()]
    jobs = min(effective_n_jobs(jobs), len(missing))
    with ExitStack() as stack:
        calls = stack.enter_context(closing(CallsAhead(_keep, missing, jobs))) if jobs > 1 else None
        for number, (run, file) in enumerate(missing):
            progress("maps", len(runs) - len(missing) + number, len(runs))
            if calls is None:
                _keep(run, file)
            else:
                calls.result(number)
    progress("maps", len(runs), len(runs))
    return {(run.planner, run.estimator): ShownRun.load(files[run.key]) for run in runs}
