"""The rows of a benchmark, one for each run, and the folder that keeps them as soon as they are there.

``journal.jsonl`` takes a line for each run that ends; ``rows.parquet`` takes what is in the journal when the
benchmark ends or begins, written whole. A process that is killed loses the runs that it was at.
"""

from __future__ import annotations

import contextlib
from array import array
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, TypeAlias

import msgspec
import numpy as np

from geo.atomic import disk_errors_named
from geo.closing import Closing
from geo.locks import lock_file
from geo.reading import misfit
from wbf_mission.results.storage import ResultError, read_batches, write_table

if TYPE_CHECKING:
    Floats: TypeAlias = array[float]
else:
    Floats = array
    """Of type code ``d``: in a list a number takes four times as much, and a table has thousands of rows."""


def as_floats(kind: type, value: Any) -> Floats:
    """Return a list of numbers as an array, how msgspec reads the lists of a row; TypeError if it is none."""
    if kind is not array or not isinstance(value, list):
        raise TypeError(f"Expected `array` of numbers, got `{type(value).__name__}`")
    return array("d", value)


def _no_floats() -> Floats:
    return array("d")


class BenchRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A run that was flown, or that failed.

    Losses are means a cell, by the names of the fields; the history has the scored times. Everything but the
    costs is decided by the run alone.

    Attributes
    ----------
    key, scenario, planner, estimator, seed
        Which run (`wbf_mission.bench.spec.BenchRun`).
    error : str or None
        Why it failed; a run without a score has failed.
    score, final_score : float or None
        Over the run and at its end; 0 is perfect.
    losses : dict
        At the end.
    calibration : dict
        What the estimate at the end states, on cells that nobody looked at (`sensors.scoring.calibration`).
    predicted_time_s : float or None
        Of a policy by the last paths that it chose; None if its budget is no time.
    budget : str or None
        Of a flight, in words.
    battery_used : float or None
        The share of a battery that the flight took which took most.
    wall_time_s, cpu_time_s : float
        The costs: of the whole run, and by its parts in `timings_s`.
    times_s, scores, history
        Seconds of flight, the score and the losses at the scored times.
    versions : dict
        Of what flew it, with its ``commit`` if that is known (`wbf_mission.bench.provenance`).
    codes : dict
        Behaviour numbers and digests (`wbf_mission.bench.spec.BenchRun`); empty in rows of old stores.
    hardware : dict
        The machine: ``processor``, ``cores``, ``memory_gb`` and ``system``.
    objects : dict
        In words, with its parameters, a ``planner`` (or policy) and an ``estimator`` given as an object.
    bad_answers : dict
        How many answers of the policy were not flown, or came too late, by what was wrong with them.
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
        # A run without a score that were no failure would take its environment from all others.
        known = (one is not None and np.isfinite(one) for one in (self.score, self.final_score))
        if self.error is None and not all(known):
            why = "no score" if self.observations else "no score: no cell of the farm was observed"
            msgspec.structs.force_setattr(self, "error", why)

    @property
    def named(self) -> str:
        """Which run it is of, in words."""
        return f"{self.scenario}, {self.planner}, {self.estimator}, seed {self.seed}"


KEY_DIGITS = 8
"""So many digits of a key are shown; `wbf-mission bench replay` takes them."""
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
"""The dicts of a row: how the columns of each begin, and what they hold."""
_COLUMNS = {
    **dict.fromkeys(("key", "scenario", "planner", "estimator", "outcome", "error", "budget"), _TEXT),
    "seed": _SEED,
    **dict.fromkeys(("observations", "cells_observed", "decisions"), _WHOLE),
    **dict.fromkeys(("times_s", "scores"), _NUMBERS),
}
"""What the other columns hold; a number where nothing is said."""
_GROUP_ROWS = 1000
_NEEDED = ("key", "scenario", "planner", "estimator", "seed")
_SHARED_TEXTS = ("scenario", "planner", "estimator", "outcome", "error", "budget")
_SHARED_DICTS = ("versions", "codes", "hardware", "objects", "bad_answers")
_decoder = msgspec.json.Decoder(BenchRow, dec_hook=as_floats)
_encoder = msgspec.json.Encoder(enc_hook=list)


class BenchStore(Closing):
    """The folder of a benchmark, made if need be, opened by the one who writes it.

    Attributes
    ----------
    done : dict of str to bool
        The keys of the runs that are kept, and whether each is good.
    rows : list of BenchRow
        All, as `read_rows` gives them, once it is closed; none before.

    Raises
    ------
    ResultError
        If somebody else writes it, or a file in it is damaged.
    OSError
        If it cannot be written.
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
        """Keep a row; it is there when this returns, whatever happens to the process."""
        with disk_errors_named(self._folder / _JOURNAL):
            self._journal.write(_encoder.encode(row) + b"\n")
            self._journal.flush()
        self.done[row.key] = row.error is None

    def close(self) -> None:
        """Bring everything into the table."""
        self._journal.close()
        try:
            self.rows = self._keep_all()
        finally:
            self._lock.close()

    def _keep_all(self) -> list[BenchRow]:
        """Write table and journal as one table, and return its rows."""
        rows = read_rows(self._folder)
        journal = self._folder / _JOURNAL
        if journal.exists():
            if rows and journal.stat().st_size:
                write_table(self._folder / TABLE, rows_table(rows), group_rows=_GROUP_ROWS)
            journal.unlink()
        return rows


def holds_rows(folder: Path) -> bool:
    """Return whether a folder is that of a benchmark, also of one that is running."""
    return any((folder / name).is_file() for name in (TABLE, _JOURNAL))


def read_rows(folder: Path) -> list[BenchRow]:
    """Return the rows of a benchmark, also of one that is running, in the order of scenario, row and seed.

    Of a run that was flown twice the later row counts.

    ResultError if there is none, or a file is damaged.
    """
    found: dict[str, BenchRow] = {}
    common = _Common()
    table = folder / TABLE
    if table.exists():
        for row in rows_of(table):
            found[row.key] = common.of(row)
    with contextlib.suppress(FileNotFoundError), (folder / _JOURNAL).open("rb") as journal:
        for number, line in enumerate(journal, 1):
            if not line.endswith(b"\n"):
                break  # the process was killed while it wrote
            try:
                row = _decoder.decode(line)
            except (msgspec.MsgspecError, UnicodeDecodeError):
                msg = f"{folder / _JOURNAL}: line {number} is no row of a benchmark; remove it"
                raise ResultError(msg) from None
            found[row.key] = common.of(row)
    return sorted(found.values(), key=lambda row: (row.scenario, row.planner, row.estimator, row.seed))


def by_pair(rows: Iterable[BenchRow]) -> dict[tuple[str, str], list[BenchRow]]:
    """Return rows by planner and estimator, sorted by these."""
    found: dict[tuple[str, str], list[BenchRow]] = {}
    for row in rows:
        found.setdefault((row.planner, row.estimator), []).append(row)
    return dict(sorted(found.items()))


def by_scenario(rows: Iterable[BenchRow]) -> dict[str, list[BenchRow]]:
    """Return rows by their scenarios, sorted by these."""
    found: dict[str, list[BenchRow]] = {}
    for row in rows:
        found.setdefault(row.scenario, []).append(row)
    return dict(sorted(found.items()))


def rows_table(rows: Sequence[BenchRow]) -> Any:
    """Return rows as a pyarrow table, a column for each value such as ``loss_tylcv``; histories are lists."""
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
    """Return the values of a column, one after the other, as an arrow array."""
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
    """Keeps once what many rows have in common."""

    def __init__(self) -> None:
        self._texts: dict[str, str] = {}
        self._dicts: dict[tuple[tuple[str, Any], ...], dict[str, Any]] = {}
        self._times: dict[bytes, Floats] = {}

    def of(self, row: BenchRow) -> BenchRow:
        """Return an equal row."""
        texts = {key: self._text(getattr(row, key)) for key in _SHARED_TEXTS}
        dicts = {key: self._dict(getattr(row, key)) for key in _SHARED_DICTS}
        times_s = self._times.setdefault(row.times_s.tobytes(), row.times_s)
        return msgspec.structs.replace(row, **texts, **dicts, times_s=times_s)

    def _text(self, text: str | None) -> str | None:
        return None if text is None else self._texts.setdefault(text, text)

    def _dict(self, values: dict[str, Any]) -> dict[str, Any]:
        return self._dicts.setdefault(tuple(values.items()), values)


def rows_of(path: Path, content: bytes | None = None) -> Iterator[BenchRow]:
    """Yield the rows of a table, whose `content` may be given as that of somebody whom nobody knows.

    ResultError if it is none.
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
                raise ResultError(f"{path}: {what}; remove it, or give another folder") from None


def _where(column: str) -> tuple[str | None, str]:
    """Return in which dict of a row a column stands, if in one, and under which name."""
    for where, (prefix, _) in _DICTS.items():
        if column.startswith(prefix):
            return where, column.removeprefix(prefix)
    return None, column
