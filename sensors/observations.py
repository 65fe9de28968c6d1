"""Observations of the leaf camera as arrays, the files that store them, and an array that grows."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from geo.atomic import atomic_write
from geo.texts import parse_number
from sensors.errors import ObservationError
from sensors.fields import PAPER_FIELDS

COLUMNS = ("x", "y", "time_s", "day")
"""First columns of an observation file; after them, each field has a column with the field's name."""
MAX_FILE_ROWS = 100_000_000
_ARRAYS = (*COLUMNS, "values")
_INT32 = np.iinfo(np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Observations in the order in which they were made.

    Anything that numpy turns into an array of the right shape is accepted. The stored arrays are read-only.

    Parameters
    ----------
    x, y : int32[n]
        The observed cell.
    time_s : float64[n]
        Seconds since the start of the run.
    day : int32[n]
        Day of the environment.
    values : float32[n, k]
        Measured value of each field, or NaN if the field was not sensed.
    fields : tuple of str
        Names of the k fields; by default the benchmark's fields.

    Raises
    ------
    ObservationError
        If lengths differ, a time is not finite, a value is infinite, or a cell or day is not a whole number.

    Examples
    --------
    >>> seen = Observations([3, 4], [0, 0], [1.0, 2.0], [6, 6], [[1, 1, 0.5], [0.5, 1, float("nan")]])
    >>> len(seen), len(seen[1:]), seen.sensed.tolist()
    (2, 1, [[True, True, True], [True, True, False]])
    """

    x: NDArray[np.int32]
    y: NDArray[np.int32]
    time_s: NDArray[np.float64]
    day: NDArray[np.int32]
    values: NDArray[np.float32]
    fields: tuple[str, ...] = PAPER_FIELDS.names

    def __post_init__(self) -> None:
        for name in ("x", "y", "day"):
            object.__setattr__(self, name, read_only(_whole(getattr(self, name), name)))
        time_s = _numbers(self.time_s, "time_s", np.float64)
        values = _numbers(self.values, "values", np.float32)
        n, k = len(self.x), len(self.fields)
        if values.size == 0:
            values = values.reshape(-1, k) if values.ndim == 2 else values.reshape(0, k)
        for name, array, shape in (
            ("y", self.y, (n,)),
            ("time_s", time_s, (n,)),
            ("day", self.day, (n,)),
            ("values", values, (n, k)),
        ):
            if array.shape != shape:
                msg = f"observations: {name} has shape {array.shape}, expected {shape} for {n} cells in x"
                raise ObservationError(msg)
        if not np.isfinite(time_s).all():
            msg = f"observations: time_s of observation {int(np.argmin(np.isfinite(time_s)))} is not finite"
            raise ObservationError(msg)
        if np.isinf(values).any():
            i = int(np.argmax(np.isinf(values).any(axis=1)))
            raise ObservationError(f"observations: a value of observation {i} is infinite")
        object.__setattr__(self, "time_s", read_only(time_s))
        object.__setattr__(self, "values", read_only(values))

    def __len__(self) -> int:
        return len(self.x)

    def __getitem__(self, key: slice | NDArray[Any]) -> Observations:
        """Select observations by a slice, a boolean mask or an index array."""
        if not isinstance(key, slice | np.ndarray):
            msg = f"observations: indexed by {type(key).__name__}, expected a slice or an array"
            raise ObservationError(msg)
        x, y, time_s, day, values = (getattr(self, name)[key] for name in _ARRAYS)
        return Observations(x, y, time_s, day, values, self.fields)

    @property
    def sensed(self) -> NDArray[np.bool_]:
        """Mask of the fields that were sensed, bool[n, k]."""
        return ~np.isnan(self.values)

    @classmethod
    def empty(cls, fields: tuple[str, ...] = PAPER_FIELDS.names) -> Observations:
        """Return an empty set of observations."""
        nothing = np.empty(0, np.int32)
        values = np.empty((0, len(fields)), np.float32)
        return cls(nothing, nothing, np.empty(0), nothing, values, fields)

    @classmethod
    def concatenate(
        cls, parts: Iterable[Observations], fields: tuple[str, ...] = PAPER_FIELDS.names
    ) -> Observations:
        """Join parts of observations, in the given order.

        Raise ObservationError if a part has other fields than `fields`.
        """
        kept = []
        for part in parts:
            part.check_fields(fields)
            if len(part):
                kept.append(part)
        if not kept:
            return cls.empty(fields)
        if len(kept) == 1:
            return kept[0]
        x, y, time_s, day, values = (
            np.concatenate([getattr(part, name) for part in kept]) for name in _ARRAYS
        )
        return cls(x, y, time_s, day, values, fields)

    def check_fields(self, fields: tuple[str, ...]) -> None:
        """Raise ObservationError unless these are the fields of the observations, in the same order."""
        if self.fields != fields:
            msg = f"observations: the fields are {', '.join(self.fields)} instead of {', '.join(fields)}"
            raise ObservationError(msg)

    def check_inside(self, shape: tuple[int, int]) -> None:
        """Raise ObservationError, which names the first cell at fault, if a cell is off a farm of `shape`."""
        width, height = shape
        outside = (self.x < 0) | (self.x >= width) | (self.y < 0) | (self.y >= height)
        if outside.any():
            i = int(np.argmax(outside))
            cell = f"cell ({self.x[i]}, {self.y[i]})"
            msg = f"observation {i}: {cell} lies outside the farm of {width} x {height} cells"
            raise ObservationError(msg)

    def to_table(self) -> Any:
        """Return the observations as a pyarrow table with the columns that `save` writes."""
        import pyarrow as pa

        arrays = [pa.array(column) for column in (self.x, self.y, self.time_s, self.day)]
        # from_pandas turns NaN ("not sensed") into null, so that other tools do not take it for a number.
        arrays += [pa.array(column, from_pandas=True) for column in np.ascontiguousarray(self.values.T)]
        return pa.table(dict(zip((*COLUMNS, *self.fields), arrays, strict=True)))

    def save(self, path: str | Path) -> None:
        """Write a `.parquet` or `.csv` file atomically.

        The columns are x, y, time_s, day and a column for each field, which has the field's name. The value
        of a field that was not sensed is null (in CSV: empty).
        """
        path = Path(path)
        save, _ = _format_of(path)
        try:
            save(self, path)
        except OSError as error:
            msg = f"{path}: cannot be written ({error.strerror or _first_line(error)})"
            raise ObservationError(msg) from None

    @classmethod
    def load(cls, path: str | Path, fields: tuple[str, ...] = PAPER_FIELDS.names) -> Observations:
        """Read a `.parquet` or `.csv` file with the columns that `save` writes; other columns are ignored.

        Parameters
        ----------
        path : path-like
            The file.
        fields : tuple of str
            Names of the fields, and thus of the columns, to read.

        Raises
        ------
        ObservationError
            If the file is missing, lacks a column, has values that are not numbers, or has another format
            than its suffix says.
        """
        path = Path(path)
        _, load = _format_of(path)
        if not path.is_file():
            raise ObservationError(f"{path}: no such observation file")
        try:
            return load(path, fields)
        except ObservationError as error:
            text = str(error)
            raise ObservationError(text if text.startswith(str(path)) else f"{path}: {text}") from None
        except OSError as error:
            raise ObservationError(f"{path}: cannot be read ({_first_line(error)})") from None


_SPARE = 2_000_000  # An array grows by half, but at most by so many numbers (8 MB in float32) or an eighth


class GrowingArray:
    """An array that grows: rows are appended in amortised constant time.

    Examples
    --------
    >>> rows = GrowingArray((), np.int32)
    >>> rows.append([1, 2]); rows.append([3])
    >>> rows.array.tolist()
    [1, 2, 3]
    """

    def __init__(self, row_shape: tuple[int, ...], dtype: DTypeLike) -> None:
        self._buffer = np.empty((0, *row_shape), dtype)
        self._rows = 0

    def __len__(self) -> int:
        return self._rows

    @property
    def array(self) -> NDArray[Any]:
        """View of the present rows; rows that are appended later are not in it."""
        return self._buffer[: self._rows]

    def append(self, rows: ArrayLike) -> None:
        """Append rows at the end."""
        new = np.asarray(rows)
        total = self._rows + len(new)
        if total > len(self._buffer):
            room, row_shape = len(self._buffer), self._buffer.shape[1:]
            spare = min(room // 2, max(room // 8, _SPARE // max(1, math.prod(row_shape))))
            buffer = np.empty((max(total, room + spare), *row_shape), self._buffer.dtype)
            buffer[: self._rows] = self.array
            self._buffer = buffer
        self._buffer[self._rows : total] = new
        self._rows = total


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view of an array."""
    view = array.view()
    view.flags.writeable = False
    return view


def _array(data: ArrayLike, name: str) -> NDArray[Any]:
    try:
        array = np.asarray(data)
    except ValueError:
        raise ObservationError(f"observations: {name} is not a regular array") from None
    if array.dtype.kind not in "iuf":
        raise ObservationError(f"observations: {name} holds something that is not a number")
    return array


def _numbers(data: ArrayLike, name: str, dtype: type[np.floating[Any]]) -> NDArray[Any]:
    array = _array(data, name)
    if array.dtype == dtype:
        return array
    with np.errstate(over="ignore"):
        return array.astype(dtype)


def _whole(data: ArrayLike, name: str) -> NDArray[np.int32]:
    array = _array(data, name)
    if array.ndim != 1:
        msg = f"observations: {name} has shape {array.shape}, expected one number per observation"
        raise ObservationError(msg)
    if array.dtype == np.int32:
        return array
    if array.size == 0:
        return np.empty(0, np.int32)
    bad = ~((array >= _INT32.min) & (array <= _INT32.max))
    if array.dtype.kind == "f":
        bad |= array != np.floor(array)
    if bad.any():
        i = int(np.argmax(bad))
        msg = f"observations: {name} of observation {i} is {array[i]}, expected a whole number of 32 bits"
        raise ObservationError(msg)
    return array.astype(np.int32)


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__


def _save_csv(observations: Observations, path: Path) -> None:
    columns = [observations.x, observations.y, observations.time_s, observations.day, *observations.values.T]
    # str() of a numpy scalar is the shortest exact text, so float32 values are read back unchanged.
    texts = [["" if v != v else str(v) for v in column] for column in columns]

    with atomic_write(path, newline="\n") as stream:
        stream.write(",".join((*COLUMNS, *observations.fields)) + "\n")
        stream.writelines(",".join(row) + "\n" for row in zip(*texts, strict=True))


def _load_csv(path: Path, fields: tuple[str, ...]) -> Observations:
    wanted = (*COLUMNS, *fields)
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream, strict=True)
            header = [name.strip() for name in next(reader, [])]
            missing = [name for name in wanted if name not in header]
            if missing:
                msg = f"{path}: no column {', '.join(missing)}, expected the header {','.join(wanted)}"
                raise ObservationError(msg)
            positions = {name: header.index(name) for name in wanted}
            columns: dict[str, list[float]] = {name: [] for name in wanted}
            for row in reader:
                if row:
                    _read_row(row, positions, columns, f"{path}: line {reader.line_num}")
    except (UnicodeDecodeError, csv.Error) as error:
        raise ObservationError(f"{path}: is not a CSV file ({_first_line(error)})") from None
    return _from_columns([np.asarray(column, np.float64) for column in columns.values()], fields)


def _read_row(row: list[str], positions: dict[str, int], columns: dict[str, list[float]], where: str) -> None:
    for name, position in positions.items():
        text = row[position].strip() if position < len(row) else None
        try:
            if text is None:
                raise ValueError
            columns[name].append(float("nan") if text == "" and name not in COLUMNS else parse_number(text))
        except ValueError:
            found = "is missing" if text is None else f"is {text[:40]!r}, expected a number"
            raise ObservationError(f"{where}: {name} {found}") from None


def _save_parquet(observations: Observations, path: Path) -> None:
    import pyarrow.parquet as pq

    table = observations.to_table()
    with atomic_write(path, "wb") as stream:
        pq.write_table(table, stream, compression="zstd")


def _load_parquet(path: Path, fields: tuple[str, ...]) -> Observations:
    import pyarrow as pa
    import pyarrow.parquet as pq

    wanted = (*COLUMNS, *fields)
    try:
        with pq.ParquetFile(path) as file:
            missing = [name for name in wanted if name not in file.schema_arrow.names]
            if missing:
                msg = f"{path}: no column {', '.join(missing)}, expected {', '.join(wanted)}"
                raise ObservationError(msg)
            if file.metadata.num_rows > MAX_FILE_ROWS:
                msg = f"{path}: claims {file.metadata.num_rows} rows, more than the limit of {MAX_FILE_ROWS}"
                raise ObservationError(msg)
            table = file.read(columns=list(wanted))
    except (pa.ArrowException, OSError, ValueError) as error:
        if isinstance(error, ObservationError):
            raise
        msg = f"{path}: is not a Parquet file that can be read ({_first_line(error)})"
        raise ObservationError(msg) from None
    columns = []
    for name in wanted:
        column = table.column(name)
        if not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
            raise ObservationError(f"{path}: column {name} is {column.type}, expected numbers")
        if column.null_count and name in COLUMNS:
            raise ObservationError(f"{path}: column {name} has {column.null_count} empty entries")
        columns.append(column.to_numpy())
    return _from_columns(columns, fields)


def _from_columns(columns: list[NDArray[Any]], fields: tuple[str, ...]) -> Observations:
    x, y, time_s, day, *values = columns
    return Observations(
        _whole(x, "x"),
        _whole(y, "y"),
        time_s,
        _whole(day, "day"),
        _numbers(np.stack(values, axis=1), "values", np.float32),
        fields,
    )


_Save = Callable[[Observations, Path], None]
_Load = Callable[[Path, tuple[str, ...]], Observations]
_FORMATS: dict[str, tuple[_Save, _Load]] = {
    ".parquet": (_save_parquet, _load_parquet),
    ".csv": (_save_csv, _load_csv),
}


def _format_of(path: Path) -> tuple[_Save, _Load]:
    try:
        return _FORMATS[path.suffix.lower()]
    except KeyError:
        msg = f"{path}: observation files end in {' or '.join(_FORMATS)}, not in {path.suffix or 'nothing'!r}"
        raise ObservationError(msg) from None
