"""The folder of a benchmark: rows that are kept as soon as they are there.

``journal.jsonl`` takes a line for each run that ends; ``rows.parquet`` takes what is in the journal when the
benchmark ends or begins, written whole. A process that is killed loses the runs that it was at.
"""

from __future__ import annotations

import contextlib
import fcntl
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

import msgspec

from geo.decoding import misfit
from wbf_mission.bench.row import BenchRow
from wbf_mission.tables import ResultError, read_table, write_table

__all__ = ["BenchStore", "read_rows", "rows_table"]

TABLE = "rows.parquet"
_JOURNAL = "journal.jsonl"
_LOCK = ".lock"
_LOSS, _HISTORY, _TIMING, _VERSION = "loss_", "history_", "timing_", "version_"
_DICTS = {"losses": _LOSS, "history": _HISTORY, "timings_s": _TIMING, "versions": _VERSION}
_decoder = msgspec.json.Decoder(BenchRow)


class BenchStore:
    """The folder of a benchmark, opened by the one who writes it.

    Parameters
    ----------
    folder : Path
        It is made if need be.

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
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._lock.close()
            msg = f"{folder}: another process writes this benchmark; wait for it, or give another folder"
            raise ResultError(msg) from None
        try:
            self.rows: list[BenchRow] = []
            self.done = {row.key: row.error is None for row in self._keep_all()}
            self._journal: IO[bytes] = (folder / _JOURNAL).open("ab")
        except BaseException:
            self._lock.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def add(self, row: BenchRow) -> None:
        """Keep a row; it is there when this returns, whatever happens to the process."""
        self._journal.write(msgspec.json.encode(row) + b"\n")
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
        if (self._folder / _JOURNAL).exists():
            if rows:
                write_table(self._folder / TABLE, rows_table(rows))
            (self._folder / _JOURNAL).unlink()
        return rows


def read_rows(folder: Path) -> list[BenchRow]:
    """Return the rows of a benchmark, also of one that is running, in the order of scenario, row and seed.

    Of a run that was flown twice the later row counts.

    Raises
    ------
    ResultError
        If there is none, or a file is damaged.
    """
    found: dict[str, BenchRow] = {}
    table = folder / TABLE
    if table.exists():
        for row in _rows_of(table):
            found[row.key] = row
    with contextlib.suppress(FileNotFoundError), (folder / _JOURNAL).open("rb") as journal:
        for number, line in enumerate(journal, 1):
            if not line.endswith(b"\n"):
                break  # the process was killed while it wrote
            try:
                row = _decoder.decode(line)
            except (msgspec.MsgspecError, UnicodeDecodeError):
                msg = f"{folder / _JOURNAL}: line {number} is no row of a benchmark; remove it"
                raise ResultError(msg) from None
            found[row.key] = row
    return sorted(found.values(), key=lambda row: (row.scenario, row.planner, row.estimator, row.seed))


def rows_table(rows: Iterable[BenchRow]) -> Any:
    """Return rows as a pyarrow table, a column for each value such as ``loss_tylcv``; histories are lists."""
    import pyarrow as pa

    values = [msgspec.structs.asdict(row) for row in rows]
    flat = []
    for one in values:
        plain = {key: value for key, value in one.items() if key not in _DICTS}
        for key, prefix in _DICTS.items():
            plain |= {prefix + name: value for name, value in one[key].items()}
        flat.append(plain)
    names = list(dict.fromkeys(name for one in flat for name in one))
    return pa.table({name: pa.array([one.get(name) for one in flat], _type(name)) for name in names})


def _type(name: str) -> Any:
    import pyarrow as pa

    if name in {"key", "scenario", "planner", "estimator", "outcome", "error"} or name.startswith(_VERSION):
        return pa.string()
    if name == "seed":
        return pa.uint64()
    if name in {"observations", "cells_observed", "decisions"}:
        return pa.int64()
    if name in {"times_s", "scores"} or name.startswith(_HISTORY):
        return pa.list_(pa.float64())
    return pa.float64()


def _rows_of(path: Path) -> list[BenchRow]:
    found = []
    for one in read_table(path, ("key", "scenario", "planner", "estimator", "seed")).to_pylist():
        row: dict[str, Any] = {key: {} for key in _DICTS}
        for name, value in one.items():
            where = next((key for key, prefix in _DICTS.items() if name.startswith(prefix)), None)
            if value is None:
                continue
            if where is None:
                row[name] = value
            else:
                row[where][name.removeprefix(_DICTS[where])] = value
        try:
            found.append(msgspec.convert(row, BenchRow))
        except msgspec.ValidationError as error:
            msg = f"{path}: holds no rows of a benchmark ({misfit(error)}); remove it, or give another folder"
            raise ResultError(msg) from None
    return found
