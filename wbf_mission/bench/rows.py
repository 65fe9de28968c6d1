"""Rows of a benchmark, one for each run, and the folder that stores each row when its run ends.

Each finished run appends a line to ``journal.jsonl``. When a benchmark begins or ends, the journal is merged
into ``rows.parquet``, which is rewritten. A process that is killed loses only its unfinished runs.
"""

from __future__ import annotations

import contextlib
import itertools
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from operator import attrgetter
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, TypeAlias

import msgspec
import numpy as np

from geo.atomic import disk_errors_named, lock_file
from geo.reading import misfit
from geo.system import Closing
from wbf_mission.results.storage import ResultError, read_batches, write_table

_SHORT = 8
_CHANGES = "+changes"

if TYPE_CHECKING:
    Floats: TypeAlias = array[float]
else:
    Floats = array
    """Array of type code ``d``, since lists of numbers would take four times the memory."""


def as_floats(kind: type, value: Any) -> Floats:
    """Convert a list of numbers to an array (a decoding hook of msgspec); TypeError for any other value."""
    if kind is not array or not isinstance(value, list):
        raise TypeError(f"Expected `array` of numbers, got `{type(value).__name__}`")
    return array("d", value)


def _no_floats() -> Floats:
    return array("d")


class BenchRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Result of a successful or failed run.

    Losses are means per cell, by field name. Only the costs may differ when a run is flown again.

    Attributes
    ----------
    key, scenario, planner, estimator, seed
        Identity of the run (`wbf_mission.bench.spec.BenchRun`).
    error : str or None
        Cause of the failure; a run without a score has failed.
    score, final_score : float or None
        Mean score over the run and score at its end; 0 is perfect.
    losses : dict
        Losses at the end of the run.
    calibration : dict
        Calibration of the last estimate on cells not observed (`sensors.scoring.expected`).
    predicted_time_s : float or None
        Predicted time of the flights; for a policy, the predicted time of its last accepted paths, or None if
        its budget is not a time.
    budget : str or None
        Budget of a flight, in words.
    battery_used : float or None
        Largest battery fraction used by a flight.
    wall_time_s, cpu_time_s : float
        Costs of the whole run; `timings_s` has the wall time of its parts.
    times_s, scores, history
        Flight time (s), score and losses at the scored times.
    versions : dict
        Versions of the program and libraries, with the ``commit`` if known (`wbf_mission.bench.provenance`).
    codes : dict
        Behaviour numbers and digests (`wbf_mission.bench.spec.BenchRun`).
    hardware : dict
        The machine: ``processor``, ``cores``, ``memory_gb`` and ``system``.
    objects : dict
        Description, with parameters, of a ``planner`` (or policy) and an ``estimator`` given as objects.
    bad_answers : dict
        Number of the policy's answers that were not flown or came too late, by kind of fault.
    """

    key: str
    scenario: str
    planner: str
    estimator: str
    seed: int
    outcome: str | None = None
    error: str | None = None
    score: float | None = None
    final_score: float | None = None
    losses: dict[str, float] = {}
    calibration: dict[str, float] = {}
    observations: int | None = None
    cells_observed: int | None = None
    path_length_m: float | None = None
    flight_time_s: float | None = None
    predicted_time_s: float | None = None
    budget: str | None = None
    battery_used: float | None = None
    decisions: int | None = None
    wall_time_s: float = 0.0
    cpu_time_s: float = 0.0
    timings_s: dict[str, float] = {}
    times_s: Floats = msgspec.field(default_factory=_no_floats)
    scores: Floats = msgspec.field(default_factory=_no_floats)
    history: dict[str, Floats] = {}
    versions: dict[str, str] = {}
    codes: dict[str, str] = {}
    hardware: dict[str, str] = {}
    objects: dict[str, str] = {}
    bad_answers: dict[str, int] = {}

    def __post_init__(self) -> None:
        # A run without a score counts as failed; else comparisons would drop its environment for all runs.
        known = (score is not None and np.isfinite(score) for score in (self.score, self.final_score))
        if self.error is None and not all(known):
            why = "no score" if self.observations else "no score: no cell of the farm was observed"
            msgspec.structs.force_setattr(self, "error", why)

    @property
    def named(self) -> str:
        """Scenario, planner, estimator and seed of the run, in words."""
        return f"{self.scenario}, {self.planner}, {self.estimator}, seed {self.seed}"


KEY_DIGITS = 8
"""Number of digits of a key that are shown; `wbf-mission bench replay` accepts such a short key."""
TABLE = "rows.parquet"
_JOURNAL = "journal.jsonl"
_LOCK = ".lock"
_TEXT, _SEED, _WHOLE, _NUMBER, _NUMBERS = "text", "seed", "whole number", "number", "numbers"
_DICTS = {
    "losses": ("loss_", _NUMBER),
    "calibration": ("calibration_", _NUMBER),
    "history": ("history_", _NUMBERS),
    "timings_s": ("timing_", _NUMBER),
    "versions": ("version_", _TEXT),
    "codes": ("code_", _TEXT),
    "hardware": ("hardware_", _TEXT),
    "objects": ("object_", _TEXT),
    "bad_answers": ("bad_", _WHOLE),
}
"""Dicts of a row, with the prefix of their columns and the type of their values."""
_COLUMNS = {
    **dict.fromkeys(("key", "scenario", "planner", "estimator", "outcome", "error", "budget"), _TEXT),
    "seed": _SEED,
    **dict.fromkeys(("observations", "cells_observed", "decisions"), _WHOLE),
    **dict.fromkeys(("times_s", "scores"), _NUMBERS),
}
"""Types of the other columns; a number by default."""
_GROUP_ROWS = 1000
_NEEDED = ("key", "scenario", "planner", "estimator", "seed")
_SHARED_TEXTS = ("scenario", "planner", "estimator", "outcome", "error", "budget")
_SHARED_DICTS = ("versions", "codes", "hardware", "objects", "bad_answers")
_decoder = msgspec.json.Decoder(BenchRow, dec_hook=as_floats)
_encoder = msgspec.json.Encoder(enc_hook=list)


def build_of(row: BenchRow) -> str:
    """Return the program version of a row's run, with commit or, if unknown, behaviour numbers.

    >>> row = BenchRow(key="", scenario="", planner="", estimator="", seed=0)
    >>> made = {"wbf-mission": "0.1.0", "commit": "4622a3d6f0+changes"}
    >>> build_of(msgspec.structs.replace(row, versions=made))
    '0.1.0, 4622a3d6+changes'
    """
    return f"{row.versions.get('wbf-mission', 'unknown version')}, {commit_of(row) or digest_of(row, 'code')}"


def commit_of(row: BenchRow) -> str:
    """Return the short commit of a row's run, with ``+changes`` if files were changed; "" if unknown."""
    commit, changes, _ = row.versions.get("commit", "").partition(_CHANGES)
    return commit[:_SHORT] + changes


def digest_of(row: BenchRow, key: str) -> str:
    """Return a row's behaviour numbers, the start of its digest, or "built in"."""
    return shown_digest(row.codes.get(key, "built in"), 12)


def shown_digest(digest: str, digits: int = _SHORT) -> str:
    """Return the first digits of a digest; return behaviour numbers unchanged."""
    return digest if "." in digest else digest[:digits].strip()


class BenchStore(Closing):
    """Folder of a benchmark, created if missing and locked for writing.

    Attributes
    ----------
    done : dict of str to bool
        Keys of the stored runs, and whether each succeeded.
    rows : list of BenchRow
        All rows in the order of `read_rows`; empty until the store is closed.

    Raises
    ------
    ResultError
        If another process writes to the folder, or a file in it is damaged.
    OSError
        If the folder cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._lock = (folder / _LOCK).open("w", encoding="utf-8")
        try:
            if not lock_file(self._lock.fileno(), wait=False):
                msg = f"{folder}: another process writes this benchmark; wait for it, or give another folder"
                raise ResultError(msg)
            self.rows: list[BenchRow] = []
            self.done = {row.key: row.error is None for row in self._keep_all()}
            self._journal: IO[bytes] = (folder / _JOURNAL).open("ab")
        except BaseException:
            self._lock.close()
            raise

    def add(self, row: BenchRow) -> None:
        """Store a row; when this returns, the row survives the death of the process."""
        with disk_errors_named(self._folder / _JOURNAL):
            self._journal.write(_encoder.encode(row) + b"\n")
            self._journal.flush()
        self.done[row.key] = row.error is None

    def close(self) -> None:
        """Merge the journal into the table and release the lock."""
        self._journal.close()
        try:
            self.rows = self._keep_all()
        finally:
            self._lock.close()

    def _keep_all(self) -> list[BenchRow]:
        """Merge the journal into the table, and return all rows."""
        rows = read_rows(self._folder)
        journal = self._folder / _JOURNAL
        if journal.exists():
            if rows and journal.stat().st_size:
                write_table(self._folder / TABLE, rows_table(rows), group_rows=_GROUP_ROWS)
            journal.unlink()
        return rows


def holds_rows(folder: Path) -> bool:
    """Return whether a folder contains the rows of a finished or running benchmark."""
    return any((folder / name).is_file() for name in (TABLE, _JOURNAL))


def read_rows(folder: Path) -> list[BenchRow]:
    """Return the rows of a finished or running benchmark, ordered by scenario, planner, estimator and seed.

    If a run was flown twice, only the later row is returned.

    ResultError if a file is damaged.
    """
    found: dict[str, BenchRow] = {}
    common = _Common()
    table, journal = folder / TABLE, folder / _JOURNAL
    if table.exists():
        for row in rows_of(table):
            found[row.key] = common.of(row)
    with contextlib.suppress(FileNotFoundError, NotADirectoryError), journal.open("rb") as lines:
        for number, line in enumerate(lines, 1):
            if not line.endswith(b"\n"):
                break  # the process was killed while writing
            try:
                row = _decoder.decode(line)
            except (msgspec.MsgspecError, UnicodeDecodeError):
                msg = f"{journal}: line {number} is not a row of a benchmark; remove the line"
                raise ResultError(msg) from None
            found[row.key] = common.of(row)
    return sorted(found.values(), key=lambda row: (row.scenario, row.planner, row.estimator, row.seed))


def by_pair(rows: Iterable[BenchRow]) -> dict[tuple[str, str], list[BenchRow]]:
    """Group rows by planner and estimator, sorted by these names."""
    return _grouped(rows, attrgetter("planner", "estimator"))


def by_scenario(rows: Iterable[BenchRow]) -> dict[str, list[BenchRow]]:
    """Group rows by scenario, sorted by its name."""
    return _grouped(rows, attrgetter("scenario"))


def by_method(rows: Iterable[BenchRow]) -> dict[tuple[str, str, str], list[BenchRow]]:
    """Group rows by scenario, planner and estimator, sorted by these names."""
    return _grouped(rows, attrgetter("scenario", "planner", "estimator"))


def _grouped(rows: Iterable[BenchRow], key: Callable[[BenchRow], Any]) -> dict[Any, list[BenchRow]]:
    return {name: list(group) for name, group in itertools.groupby(sorted(rows, key=key), key)}


def rows_table(rows: Sequence[BenchRow]) -> Any:
    """Return rows as a pyarrow table with a column for each value (``loss_tylcv``); histories are lists."""
    import pyarrow as pa

    names = [name for name in BenchRow.__struct_fields__ if name not in _DICTS]
    columns = {
        name: _column(_COLUMNS.get(name, _NUMBER), (getattr(row, name) for row in rows)) for name in names
    }
    for where, (prefix, holds) in _DICTS.items():
        for key in dict.fromkeys(key for row in rows for key in getattr(row, where)):
            columns[prefix + key] = _column(holds, (getattr(row, where).get(key) for row in rows))
    return pa.table(columns)


def _column(holds: str, values: Iterator[Any]) -> Any:
    """Return the values of a column as an arrow array."""
    import pyarrow as pa

    kind = {
        _TEXT: pa.string(),
        _SEED: pa.uint64(),
        _WHOLE: pa.int64(),
        _NUMBER: pa.float64(),
        _NUMBERS: pa.list_(pa.float64()),
    }[holds]
    if not pa.types.is_list(kind):
        return pa.array(values, kind)
    joined, ends, missing = array("d"), [0], []
    for value in values:
        joined.extend(value or ())
        ends.append(len(joined))
        missing.append(value is None)
    return pa.ListArray.from_arrays(
        pa.array(ends, pa.int32()),
        pa.array(np.array(joined), pa.float64()),
        mask=pa.array(missing, pa.bool_()),
    )


class _Common:
    """Cache that lets rows share equal texts, dicts and times."""

    def __init__(self) -> None:
        self._texts: dict[str | None, str | None] = {}
        self._dicts: dict[tuple[tuple[str, Any], ...], dict[str, Any]] = {}
        self._times: dict[bytes, Floats] = {}

    def of(self, row: BenchRow) -> BenchRow:
        """Return an equal row that uses the cached texts, dicts and times."""
        texts = {key: getattr(row, key) for key in _SHARED_TEXTS}
        texts = {key: self._texts.setdefault(text, text) for key, text in texts.items()}
        dicts = {key: getattr(row, key) for key in _SHARED_DICTS}
        dicts = {key: self._dicts.setdefault(tuple(values.items()), values) for key, values in dicts.items()}
        times_s = self._times.setdefault(row.times_s.tobytes(), row.times_s)
        return msgspec.structs.replace(row, **texts, **dicts, times_s=times_s)


def rows_of(path: Path, content: bytes | None = None) -> Iterator[BenchRow]:
    """Yield the rows of a table, read from `path` or from the untrusted bytes `content`.

    ResultError if the table holds no benchmark rows.
    """
    for batch in read_batches(path, _NEEDED, content):
        wheres = [_where(name) for name in batch.schema.names]
        for values in zip(*(column.to_pylist() for column in batch.columns), strict=True):
            row: dict[str, Any] = {key: {} for key in _DICTS}
            for (where, key), value in zip(wheres, values, strict=True):
                if value is not None:
                    (row if where is None else row[where])[key] = value
            try:
                yield msgspec.convert(row, BenchRow, dec_hook=as_floats)
            except msgspec.ValidationError as error:
                what = f"holds no rows of a benchmark ({misfit(error)})"
                raise ResultError(f"{path}: {what}; remove the file, or give another folder") from None


def _where(column: str) -> tuple[str | None, str]:
    """Return the name of the row's dict that holds a column (None if no dict does), and the column's key."""
    for where, (prefix, _) in _DICTS.items():
        if column.startswith(prefix):
            return where, column.removeprefix(prefix)
    return None, column
