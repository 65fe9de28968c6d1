"""Folder of a run's results: checks the folder, and writes and replaces results atomically."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import os
import re
import shlex
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any, Self

import msgspec

from geo.atomic import DISK_ERRORS, AtomicFolder, FolderError, settle
from geo.processes import interrupts_noted
from geo.system import free_unused_memory
from mission.errors import LinkError
from mission.link.codec.dialect import mavlink as m
from mission.link.tlog import read_tlog
from mission.outcome import Outcome
from wbf_mission.progress import Progress, silent
from wbf_mission.results.files import (
    DECISIONS,
    PROBABILITIES,
    RECORD,
    REST,
    TRACK,
    TRUE_TRACK,
    WORLD,
    write_arrays,
    write_result,
)
from wbf_mission.results.products import product, product_names
from wbf_mission.results.storage import SUFFIX, ResultError
from wbf_mission.run.estimation import resolved
from wbf_mission.run.record import RunRecord
from wbf_mission.scenario import Scenario


class ResultFolder:
    """Folder of a run's files.

    During the ``with`` block, the folder is locked against other runs. `write` fills a temporary folder
    beside the target, then replaces the target with it; an older result stays until then. The telemetry log
    (`tlog`) is written into the temporary folder, too. Leaving the block removes the temporary folder.

    The folder must contain none of the `inputs`. An older result of the same `scenario` (`Scenario.to_dict`)
    is replaced. With `overwrite`, any result is replaced, even in a folder with other files, which stay.
    Raises ResultError if the folder must not be written, and on entering the block, if the folder is not
    writable or is locked by another run.

    If a flight is killed, or a `real` flight ends with an error, its log is kept beside the folder, and
    `warn` receives a line about the log, and about each mission that is saved only as JSON.
    """

    def __init__(
        self,
        path: Path,
        *,
        inputs: Iterable[str | Path | None] = (),
        scenario: dict[str, Any] | None = None,
        overwrite: bool = False,
        real: bool = False,
        warn: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self.path = path
        """Path of the result."""
        self.is_written = False
        """Whether the complete result is in place."""
        settle_result(path)
        self._check = partial(_check_target, inputs=list(inputs), scenario=scenario, overwrite=overwrite)
        self._check(path)
        self._folder = AtomicFolder(path, RECORD, _is_ours, rescue=self._keep_log)
        self._real, self._warn = real, warn
        self._farm = "FARM" if scenario is None else str(scenario["farm"])

    @property
    def tlog(self) -> Path:
        """Path of the flight's telemetry log, in the temporary folder."""
        return self._folder.filled / "flight.tlog"

    def __enter__(self) -> Self:
        with _about(self.path):
            self._folder.__enter__()
        try:
            self._check(self.path)  # Checks again, because another run may just have ended
        except BaseException:
            self._folder.__exit__()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if self._real and not self.is_written:
            with contextlib.suppress(OSError):  # The error of the flight is raised instead
                self._keep_log()
        self._folder.__exit__()
        if isinstance(error, OSError):
            self._name(error)

    def write(
        self,
        result: RunRecord,
        *,
        products: Sequence[str] = (),
        release: bool = False,
        progress: Progress | None = None,
    ) -> list[Path]:
        """Write the result, move the folder into place, and return the files.

        `products` are names of `wbf_mission.results.products`; files that the run cannot give are left out.

        ``release`` frees memory on large farms: it drops the map of expected losses, which holds the
        estimator, and drops truth and estimate once they are written. The first Ctrl-C skips the remaining
        pictures and products, the second discards everything. If a flight was interrupted or pictures were
        skipped, the result never replaces an older one, but goes to NAME.interrupted, NAME.interrupted-2 ...
        """
        progress = progress or silent
        filled = self._folder.filled
        interrupted = None
        with interrupts_noted() as answer:

            def step(what: str, done: float, total: float) -> None:
                answer()
                progress(what, done, total)

            made = sorted(map(product, products), key=lambda maker: not maker.needs_estimate)
            jobs = [(name, maker) for maker in made for name in maker.files(result)]
            progress("writing results", 0, len(jobs) + 1)
            if release and result.model is not None:
                result.model = replace(result.model, loss_map=None)
            free_unused_memory()
            with ThreadPoolExecutor(1) as pool:
                arrays = write_arrays(result, filled, pool)
                written = write_result(result, filled, arrays, self._warn)
                try:
                    for number, (name, maker) in enumerate(jobs):
                        answer()
                        progress("writing results", number + 1, len(jobs) + 1)
                        if release and not maker.needs_estimate:
                            wait(arrays.values())
                            result.truth = result.model = None
                        maker.write(result, filled / name, step)
                        written.append(filled / name)
                except KeyboardInterrupt as error:
                    interrupted = error
                    shutil.rmtree(filled / name, ignore_errors=True)  # An incomplete folder
                for path, done in arrays.items():
                    done.result()
                    written.append(path)
            broken_off = interrupted is not None or result.outcome is Outcome.INTERRUPTED
            self._put_in_place(beside=broken_off and (self.path / RECORD).is_file())
            progress("writing results", len(jobs) + 1, len(jobs) + 1)
        if interrupted is not None:
            raise interrupted
        return [self.path / path.name for path in written]

    def _keep_log(self) -> None:
        """Move the log of an unsaved flight beside the folder; the warning says how to use the log."""
        if not _has_flown(self.tlog):
            return
        kept = self._free(_KEPT, ".tlog")
        self.tlog.rename(kept)
        made = f"{kept.with_suffix('')}-map"
        words = ["wbf-mission", "map", "--log", str(kept), "--farm", self._farm, "--out", made]
        self._warn(
            f"the flight for {self.path} was not saved; its telemetry log is kept as {kept}."
            f" Make its map with '{shlex.join(words)}'"
        )

    def _free(self, ending: str, suffix: str = "") -> Path:
        """Return a free path beside the temporary folder: the result's name, `ending`, a number and `suffix`.

        If the result has the same parent folder, the path begins as the user wrote the result's path.
        """
        filled = self._folder.filled
        name = f"{filled.name[1:].removesuffix('.partial')}{ending}"
        for number in itertools.count(1):
            path = filled.with_name(f"{name}-{number}{suffix}" if number > 1 else f"{name}{suffix}")
            settle_result(path)
            if not os.path.lexists(path):
                break
        shown = self.path.parent / path.name
        return shown if shown.resolve() == path else path

    def _put_in_place(self, *, beside: bool) -> None:
        """Rename the temporary folder to the target; with `beside`, to a free name beside it."""
        if not beside:
            self._folder.commit()
        else:
            path = self._free(".interrupted")
            with _about(path), AtomicFolder(path, RECORD, _is_ours) as neighbour:
                neighbour.commit(self._folder.filled)
            self.path = path
        self.is_written = True

    def _name(self, error: OSError) -> None:
        """Make an error name the result's folder in place of the temporary folder."""
        filled = self._folder.filled
        if error.filename is None and error.errno in DISK_ERRORS:
            error.filename = str(self.path)
        elif error.filename is not None:
            name = Path(str(error.filename))
            if name.is_relative_to(filled):
                error.filename, error.filename2 = str(self.path / name.relative_to(filled)), None
            elif name.name in self._folder.hidden_names:
                error.filename, error.filename2 = str(self.path), None


@contextlib.contextmanager
def _about(path: Path) -> Iterator[None]:
    """Turn a FolderError into a ResultError that names the folder `path`."""
    try:
        yield
    except FolderError as error:
        raise ResultError(f"{path}: {error}") from error


def settle_result(path: Path) -> None:
    """Move the complete result of a killed run into place; ResultError on failure."""
    with _about(path):
        settle(path, RECORD, _is_ours)


def run_name(scenario: Scenario) -> str:
    """Return a name for a run: farm, planner (or policy or mission), estimator, vehicle, seed and a digest.

    The digest covers all other options that differ from their defaults, such as planner parameters and the
    folders of files, so different runs have different names.
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
            raise ResultError(f"{path}: holds {one}, which the run reads; give another folder")
    if not path.exists():
        if path.is_symlink():
            raise ResultError(f"{path}: is a link to a missing folder; give another folder")
        return
    if not path.is_dir():
        raise ResultError(f"{path}: is a file, not a folder for the results; give another name")
    ours = AtomicFolder(path, RECORD, _is_ours).hidden_names
    if overwrite or all(entry.name in ours or _KEPT in entry.name for entry in path.iterdir()):
        return
    if not (path / RECORD).is_file():
        what = "holds other files and no result; give another folder, or write beside these files"
        raise ResultError(f"{path}: {what} (--overwrite, overwrite=True)")
    if scenario is None or scenario_in(path) != msgspec.json.decode(msgspec.json.encode(scenario)):
        what = "holds the result of another run; give another folder, or replace the result"
        raise ResultError(f"{path}: {what} (--overwrite, overwrite=True)")


def scenario_in(path: Path) -> Any:
    """Return the recorded scenario of a results folder, or None if there is none."""
    with contextlib.suppress(OSError, ValueError, RecursionError, AttributeError):
        return msgspec.json.decode((path / RECORD).read_bytes()).get("scenario")
    return None


_KEPT = ".killed"


def _has_flown(tlog: Path) -> bool:
    """Return whether a log (truncated or not) shows running motors; True if it is too large to read."""
    if not tlog.is_file():
        return False
    try:
        return any(
            isinstance(message, m.MAVLink_heartbeat_message)
            and bool(message.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED)
            for _, message in read_tlog(tlog)
        )
    except LinkError:
        return True


def _is_ours(name: str) -> bool:
    return name in product_names() or any(fnmatchcase(name, pattern) for pattern in _PATTERNS)


_PATTERNS = (
    *(RECORD, "summary.json", "flight.tlog", "report.html", "report-*.html"),
    *("plan.plan", "plan.json", "plan-day*.plan", "plan-day*.json", REST, "rest.json"),
    *("observations.parquet", "scores.parquet", DECISIONS, TRACK, TRUE_TRACK),
    *(f"{name}{end}{SUFFIX}" for name in ("truth", "value", "uncertainty") for end in ("", "_days")),
    *(f"{PROBABILITIES}*{SUFFIX}", "maps.npz", "path.png", "score.png", "field_*.png"),
    *("farm.geojson", WORLD, "vehicle.toml", "vehicle-*.toml"),
)
"""Patterns for the names of a result's files."""
