"""Tables in Parquet files: each written complete or not at all, and read back without trust."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from geo.atomic import atomic_write
from geo.errors import WbfMissionError


class ResultError(WbfMissionError, ValueError):
    """A folder that holds no result, or one that cannot be read or must not be replaced."""


def write_table(path: Path, table: Any) -> None:
    """Write a pyarrow table as Parquet."""
    import pyarrow.parquet as pq

    with atomic_write(path, "wb") as stream:
        pq.write_table(table, stream, compression="zstd")


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
        msg = f"{path}: is not a Parquet file that can be read ({str(error).splitlines()[0]})"
        raise ResultError(msg) from None
    missing = [name for name in columns if name not in table.column_names]
    if missing:
        msg = f"{path}: no column {missing[0]}"
        raise ResultError(msg)
    return table
