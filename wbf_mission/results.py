"""The folder of a run: when it may be written, how a new result takes the place of an older one."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import msgspec
import numpy as np

from mission.outcome import Outcome
from wbf_mission.arrays import SUFFIX
from wbf_mission.estimation import resolved
from wbf_mission.outcome import joined
from wbf_mission.progress import Progress, silent
from wbf_mission.result_files import DECISIONS, PROBABILITIES, RECORD, write_arrays, write_result
from wbf_mission.run_record import RunRecord
from wbf_mission.scenario import Scenario
from wbf_mission.tables import ResultError

if TYPE_CHECKING:
    from wbf_mission.field_maps import FieldMap

__all__ = ["ResultFolder", "run_name"]

ANIMATION = "run.gif"


class ResultFolder:
    """Where a run's files go.

    Nothing is made before the flight begins: `tlog` lies in a temporary folder beside the target, which a
    flight makes when it opens its log. `write` fills that folder and puts it in the target's place; an older
    result stays until then. Leaving the ``with`` block removes what was not put there.

    Parameters
    ----------
    path : Path
        The folder for the result.
    inputs : iterable of path
        Files that the run reads: the folder must not hold one of them.
    scenario : dict, optional
        The options of the run, as of `Scenario.to_dict`: an older result of the same run is replaced.
    overwrite : bool
        Replace any older result, and write into a folder that holds other files (which stay).

    Raises
    ------
    ResultError
        If the folder must not be written.
    """

    def __init__(
        self,
        path: Path,
        *,
        inputs: Iterable[str | Path | None] = (),
        scenario: dict[str, Any] | None = None,
        overwrite: bool = False,
    ) -> None:
        self.path = path
        """Where the result is or will be."""
        _check_target(path, inputs, scenario, overwrite=overwrite)
        target = path.resolve()
        self._staging = target.parent / f".{target.name[:40]}-{secrets.token_hex(6)}"

    @property
    def tlog(self) -> Path:
        """The telemetry log of the flight, in the temporary folder."""
        return self._staging / "flight.tlog"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self._staging, ignore_errors=True)

    def write(
        self,
        result: RunRecord,
        *,
        plots: bool = True,
        animation: bool = False,
        release: bool = False,
        progress: Progress | None = None,
    ) -> list[Path]:
        """Write everything that the run has, put the folder in its place, and return the files.

        With ``release`` truth and estimate leave the result once they are written: on a large farm the moving
        picture, whose estimator takes as much, finds room there. Ctrl-C while the pictures are drawn keeps
        the rest. The result of an interrupted flight goes beside an
        older result, into a folder whose name ends in ``.interrupted``.

        Raises
        ------
        OSError
            If a file cannot be written; then an older result is as it was.
        """
        from wbf_mission.animation import animate

        tell = progress or silent
        self._staging.mkdir(parents=True, exist_ok=True)
        jobs = _plot_jobs(result) if plots else []
        if animation and any(len(one.track.time_s) for one in result.flights):
            jobs.append((ANIMATION, lambda path: animate(result, path, progress=progress)))
        tell("writing results", 0, len(jobs) + 1)
        if result.outcome is Outcome.INTERRUPTED and (self.path / RECORD).is_file():
            self.path = self.path.with_name(f"{self.path.name}.interrupted")
            _check_target(self.path, (), None, overwrite=(self.path / RECORD).is_file())
        interrupted = None
        with ThreadPoolExecutor(1) as pool:
            arrays = write_arrays(result, self._staging, pool)
            written = write_result(result, self._staging, arrays)
            try:
                for number, (name, job) in enumerate(jobs):
                    tell("writing results", number + 1, len(jobs) + 1)
                    if release and name == ANIMATION:
                        wait(arrays.values())
                        result.truth = result.model = None
                    job(self._staging / name)
                    written.append(self._staging / name)
            except KeyboardInterrupt as error:
                interrupted = error
            for path, done in arrays.items():
                done.result()
                written.append(path)
        self._put_in_place()
        if interrupted is not None:
            raise interrupted
        return [self.path / path.name for path in written]

    def _put_in_place(self) -> None:
        """Give the temporary folder the target's name; what is not ours in an older one is kept."""
        target = self.path.resolve()
        for entry in self._staging.iterdir():
            _sync(entry)
        _sync(self._staging)
        if not target.exists():
            self._staging.replace(target)
        elif target.is_mount() or Path.cwd().is_relative_to(target):
            # A folder that somebody is in cannot be exchanged.
            for name in [entry.name for entry in target.iterdir() if _is_ours(entry.name)]:
                if not (self._staging / name).exists():
                    (target / name).unlink()
            for entry in self._staging.iterdir():
                entry.replace(target / entry.name)
        else:
            self._staging.chmod(stat.S_IMODE(target.stat().st_mode))
            older = target.with_name(f"{self._staging.name}-old")
            kept = [entry.name for entry in target.iterdir() if not _is_ours(entry.name)]
            target.replace(older)
            try:
                self._staging.replace(target)
            except BaseException:
                older.replace(target)
                raise
            for name in kept:
                (older / name).replace(target / name)
            shutil.rmtree(older, ignore_errors=True)
        _sync(target.parent)


def run_name(scenario: Scenario) -> str:
    """Return a name for a run: farm, planner, policy or mission, estimator, vehicle, seed, and a digest.

    The digest covers whatever is not the default and not told by the name, such as the folders of files and
    the parameters of a planner; so runs that differ have names that differ.
    """
    scenario = resolved(scenario)
    mission, default = scenario.mission, Scenario().to_dict()
    if mission.policy is not None:
        decider = {"policy": mission.policy.name}
    else:
        decider = {"planner": mission.planner.name if mission.file is None else Path(mission.file).stem}
    told = {
        "farm": Path(scenario.farm.name).stem,
        **decider,
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


def _check_target(
    path: Path, inputs: Iterable[str | Path | None], scenario: dict[str, Any] | None, *, overwrite: bool
) -> None:
    target = path.resolve()
    for one in inputs:
        if one is None or not Path(one).is_file():
            continue
        source = Path(one).resolve()
        if source.parent == target and _is_ours(source.name):
            msg = f"{path}: holds {one}, which the run reads; give another folder"
            raise ResultError(msg)
    if not path.exists():
        if path.is_symlink():
            msg = f"{path}: is a link that leads nowhere; give another folder"
            raise ResultError(msg)
        return
    if not path.is_dir():
        msg = f"{path}: is a file, not a folder for the results; give another name"
        raise ResultError(msg)
    if overwrite or not any(path.iterdir()):
        return
    if not (path / RECORD).is_file():
        what = "holds other files and no result; give another folder, or write among them"
        msg = f"{path}: {what} (--overwrite, overwrite=True)"
        raise ResultError(msg)
    if scenario is None or _scenario_in(path) != msgspec.json.decode(msgspec.json.encode(scenario)):
        what = "holds the result of another run; give another folder, or replace it"
        msg = f"{path}: {what} (--overwrite, overwrite=True)"
        raise ResultError(msg)


def _scenario_in(path: Path) -> Any:
    with contextlib.suppress(OSError, ValueError, RecursionError, AttributeError):
        return msgspec.json.decode((path / RECORD).read_bytes()).get("scenario")
    return None


def _is_ours(name: str) -> bool:
    many = (
        ("field_", ".png"),
        (PROBABILITIES, SUFFIX),
        ("plan-day", ".plan"),
        ("plan-day", ".json"),
        ("vehicle-", ".toml"),
    )
    return name in _NAMES or any(name.startswith(start) and name.endswith(end) for start, end in many)


_NAMES = frozenset(
    {
        RECORD,
        "summary.json",
        "plan.plan",
        "plan.json",
        "flight.tlog",
        "observations.parquet",
        "track.parquet",
        DECISIONS,
        "true_track.parquet",
        "scores.parquet",
        *(f"{name}{end}{SUFFIX}" for name in ("truth", "value", "uncertainty") for end in ("", "_days")),
        "maps.npz",
        "farm.geojson",
        "vehicle.toml",
        "path.png",
        "score.png",
        ANIMATION,
    }
)


def _sync(path: Path) -> None:
    """Have a file or folder on the disk before it is relied on."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _plot_jobs(result: RunRecord) -> list[tuple[str, Any]]:
    from wbf_mission import plots
    from wbf_mission.path_plot import plot_run

    farm, estimator = result.farm, result.estimator
    title = f"{farm.name}: {result.plan.planner or 'mission file'}, {result.plan.vehicle.name}"
    day = result.days[-1].day if result.days else result.scenario.farm.day
    about = f"{farm.name}, day {day}, {estimator}"
    last = joined([one.track for one in result.flights if one.day == day] or [result.flights[-1].track])
    track = np.column_stack((last.x_m, last.y_m))
    jobs: list[tuple[str, Any]] = [("path.png", lambda path: plot_run(result, path))]
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
                        history,
                        path,
                        f"{title}, {estimator}",
                        result.fields,
                    ),
                )
            )
    return jobs
