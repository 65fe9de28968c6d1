"""Tables in Parquet files: each written complete or not at all, and read back without trust."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from geo.atomic import atomic_write
from geo.errors import WbfMissionError

_BATCH_ROWS = 256


class ResultError(WbfMissionError, ValueError):
    """A folder that holds no result, or one that cannot be read or must not be replaced."""


def write_table(path: Path, table: Any, *, group_rows: int | None = None) -> None:
    """Write a pyarrow table as Parquet; with `group_rows` in groups that are read one after the other."""
    import pyarrow.parquet as pq

    with atomic_write(path, "wb") as stream:
        pq.write_table(table, stream, compression="zstd", row_group_size=group_rows)


def read_table(path: Path, columns: tuple[str, ...]) -> Any:
    """Read a Parquet file as a pyarrow table.

    Raises
    ------
    ResultError
        If it cannot be read, or lacks one of the columns.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise _unreadable(path, error) from None
    _require(path, table.column_names, columns)
    return table


def read_batches(path: Path, columns: tuple[str, ...]) -> Iterator[Any]:
    """Read a Parquet file in parts, as pyarrow record batches of a few hundred rows.

    Raises
    ------
    ResultError
        As `read_table`; if a later part is damaged, after the parts before it.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            _require(path, file.schema_arrow.names, columns)
            yield from file.iter_batches(batch_size=_BATCH_ROWS)
    except (pa.ArrowException, OSError) as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: Exception) -> ResultError:
    return ResultError(f"{path}: is not a Parquet file that can be read ({str(error).splitlines()[0]})")


def _require(path: Path, names: list[str], columns: tuple[str, ...]) -> None:
    missing = [name for name in columns if name not in names]
    if missing:
        msg = f"{path}: no column {missing[0]}"
        raise ResultError(msg)
