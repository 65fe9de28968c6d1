"""Result of a run, and functions to compare, draw, save and load it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geo.errors import WbfMissionError
from sensors.estimators import Estimator
from sensors.lazy_fields import LazyFields
from sensors.scoring.information import InformationModel
from wbf_mission.progress import Progress
from wbf_mission.replanning.record import decision_table
from wbf_mission.results.files import history_table, read_result, track_table
from wbf_mission.results.products import ANIMATION, PICTURES, product
from wbf_mission.results.storage import ResultError
from wbf_mission.results.writing import ResultFolder, settle_result
from wbf_mission.run.record import RunRecord


@dataclass(slots=True, eq=False)
class Result(RunRecord):
    """Result of a run; `wbf_mission.run.record.RunRecord` lists its parts.

    Results are equal if all their saved values are equal, so a loaded result equals the saved one.
    """

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Result) and _alike(self, other)

    __hash__ = None  # type: ignore[assignment]

    def tables(self) -> dict[str, Any]:
        """Return tracks, observations, decisions and history as pyarrow tables."""
        return {
            "track": track_table(self.flights),
            "observations": self.observations.to_table(),
            "decisions": decision_table(self.decisions),
            "history": history_table(self.history, self.observations.fields),
        }

    def plot(self, path: str | Path) -> Path:
        """Draw the farm with planned and flown paths into a PNG file.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        made: Any = product(PICTURES)
        made.plot_run(self, Path(path))
        return Path(path)

    def animate(
        self,
        path: str | Path,
        *,
        frames: int = 150,
        estimator: Estimator | None = None,
        progress: Progress | None = None,
    ) -> Path:
        """Write the run as a moving picture: truth, estimate, uncertainty and vehicles over time.

        A new estimator computes the estimates again from the observations.

        Parameters
        ----------
        path : path-like
            A ``.gif`` file, or ``.mp4``, which needs the program ffmpeg.
        frames : int
            Approximate number of frames, 2 to 300.
        estimator : Estimator, optional
            Replaces the run's estimator; it is fitted again.
        progress : callable, optional
            ``progress(what, done, total)``.

        Raises
        ------
        AnimationError
            If nothing was flown, the number of frames is out of range, or the file type is unknown.
        EstimatorError
            If the run's estimator cannot be made again: a loaded result does not contain estimator objects.
        OSError
            If the file cannot be written.
        """
        made: Any = product(ANIMATION)
        made.write(self, Path(path), progress, frames=frames, estimator=estimator)
        return Path(path)

    def save(self, path: str | Path, *, plots: bool = True, overwrite: bool = False) -> Path:
        """Save the result into a folder, which `wbf_mission.load_result` reads.

        The files are written to a temporary folder, which replaces the target when it is complete. A mission
        that a plan cannot hold is saved as JSON only, with a UserWarning.

        Parameters
        ----------
        path : path-like
            The folder; parents are created.
        plots : bool
            Whether to write pictures, too.
        overwrite : bool
            Replace the result of another run, or write into a folder with other files.

        Raises
        ------
        ResultError
            If the folder contains other files, and `overwrite` is false.
        OSError
            If a file cannot be written.
        """
        scenario = self.scenario.to_dict()
        with ResultFolder(Path(path), scenario=scenario, overwrite=overwrite, warn=warnings.warn) as folder:
            folder.write(self, products=[PICTURES] if plots else ())
        return Path(path)


def load_result(path: str | Path, *, probabilities: bool = True, lazy: bool = False) -> Result:
    """Load a result from a folder of a run or of `Result.save`.

    The arrays are read into memory; for a farm like Waterberry they take 1.8 GB.

    Parameters
    ----------
    path : path-like
        The folder.
    probabilities : bool
        Whether the estimate's class probabilities are read (0.7 GB for Waterberry).
    lazy : bool
        Whether truth and estimate of the last day are read at each access (`sensors.lazy_fields`), so that
        they take no memory in between.

    Raises
    ------
    ResultError
        If the folder contains no result, or the result is damaged.

    Examples
    --------
    >>> load_result("no/such/folder")
    Traceback (most recent call last):
    ...
    wbf_mission.results.storage.ResultError: no/such/folder: holds no result (result.json is missing)...
    """
    try:
        settle_result(Path(path))
        return read_result(Path(path), Result, probabilities=probabilities, lazy=lazy)
    except (WbfMissionError, OSError, TypeError, KeyError, ValueError, OverflowError) as error:
        if isinstance(error, ResultError):
            raise
        raise ResultError(f"{path}: the result is damaged ({' '.join(str(error).split())})") from error


def _alike(one: Any, other: Any) -> bool:
    """Return whether the saved parts of two values are bit-identical."""
    one, other = (np.asarray(each) if isinstance(each, LazyFields) else each for each in (one, other))
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        same = isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and one.dtype == other.dtype
        return same and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if isinstance(one, InformationModel):
        # Other data of the model serves decisions in flight, and is not saved.
        names = ("value", "uncertainty", "fields", "probabilities")
        return isinstance(other, InformationModel) and all(
            _alike(getattr(one, name), getattr(other, name)) for name in names
        )
    if is_dataclass(one):
        return type(one) is type(other) and all(
            _alike(getattr(one, part.name), getattr(other, part.name)) for part in fields(one)
        )
    if isinstance(one, Mapping):
        return (
            isinstance(other, Mapping)
            and one.keys() == other.keys()
            and all(_alike(value, other[key]) for key, value in one.items())
        )
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(_alike, one, other))
    return bool(one == other or (one != one and other != other))
