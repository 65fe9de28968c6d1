"""Readings of a CSV table, joined to the camera positions of a flight log."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from geo.features import DEGREES, LATITUDES, LONGITUDES, column_name
from geo.reading import UnreadableError, read_text
from geo.texts import parse_number, parse_whole
from sensors.camera.leaf_camera import footprint_offsets
from sensors.errors import ObservationError
from sensors.fields import Field, FieldSet
from sensors.observations import COLUMNS, Observations
from wbf_mission.addons.treatment.logs import LogTrack

Floats: TypeAlias = NDArray[np.float64]

_MOST_BYTES = 2**28
_MOST_ROWS = 5_000_000
_SAME_PLACE_DEG = 2e-5  # About 2 m: reports of one image may differ by this much.


@dataclass(slots=True)
class Readings:
    """Rows of a table of readings."""

    key: tuple[str, ...]  # A key of `_KEY_READERS`
    # Key of each row: (latitude, longitude), name, image or seconds (`logs.track.LEAST_UTC_S`)
    keys: list[object] = field(default_factory=list)
    # Values of each row, by field; NaN for a field that was not sensed
    values: list[list[float]] = field(default_factory=list)


def is_cells(path: Path) -> bool:
    """Return whether a file holds observations of farm cells, as `fly` writes them."""
    return path.suffix.lower() == ".parquet" or set(COLUMNS) <= set(_header(path)[0])


def read_readings(path: Path, fields: FieldSet) -> Readings:
    """Read a table of readings: key columns, which locate a row, and a column for each sensed field.

    The key is the first entry of `_KEY_READERS` whose columns the table has. An empty cell of the
    table means that the field was not sensed. Raises ObservationError if the file cannot be read, has no key
    or none of the fields, or has an invalid value.
    """
    header, lines = _header(path)
    key = next((names for names in _KEY_READERS if set(names) <= set(header)), None)
    if key is None:
        wanted = "latitude and longitude, name, image, or time"
        if len(header) == 1 and re.search("[;\t]", header[0]):  # Spreadsheets often use these separators
            wanted += "; separate the columns by commas, and write decimals with a point"
        raise ObservationError(f"{path}: no column gives the place of a reading; give {wanted}")
    columns = [header.index(name) if name in header else None for name in fields.names]
    if not any(column is not None for column in columns):
        raise ObservationError(
            f"{path}: no column is named after a field; give one or more of {', '.join(fields.names)}"
        )
    places = [header.index(name) for name in key]
    found = Readings(key)
    try:
        for row in lines:
            if not row:
                continue
            where = f"{path}: line {lines.line_num}"
            if len(found.keys) >= _MOST_ROWS:
                raise ObservationError(f"{where}: more than {_MOST_ROWS} readings; give them in parts")
            texts = [row[place].strip() if place < len(row) else "" for place in places]
            try:
                found.keys.append(_KEY_READERS[key](texts))
            except ValueError as error:
                raise ObservationError(f"{where}: {' and '.join(key)}: {error}") from None
            found.values.append(
                [
                    _value(where, field, row[column] if column is not None and column < len(row) else "")
                    for field, column in zip(fields, columns, strict=True)
                ]
            )
    except csv.Error as error:
        raise ObservationError(f"{path}: line {lines.line_num}: is not a CSV line ({error})") from None
    if not found.keys:
        raise ObservationError(f"{path}: holds no readings below its header")
    return found


def _header(path: Path) -> tuple[list[str], Any]:
    """Return the column names of the first line and a CSV reader of the remaining lines."""
    try:
        lines = csv.reader(io.StringIO(read_text(path, _MOST_BYTES), newline=""), strict=True)
        return _named(next(lines, [])), lines
    except UnreadableError as error:
        raise ObservationError(f"{path}: cannot be read: {error}") from None
    except csv.Error as error:
        raise ObservationError(f"{path}: is not a CSV file ({error})") from None


def _named(header: list[str]) -> list[str]:
    """Return column names in lower case, with latitude and longitude renamed to "latitude" and "longitude".

    >>> _named(["Lon", "Lat (deg)", "tylcv"]), _named(["lat", "latitude"])
    (['longitude', 'latitude', 'tylcv'], ['lat', 'latitude'])
    """
    names = [name.strip().lower() for name in header]
    for key, spellings in (("latitude", LATITUDES), ("longitude", LONGITUDES)):
        plain = (column_name(name) for name in names)
        found = [k for k, (name, unit) in enumerate(plain) if name in spellings and unit in DEGREES]
        if found and key not in names:
            names[found[0]] = key
    return names


def _value(where: str, field: Field, text: str) -> float:
    """Return a reading, scaled from its field's range to 0..1."""
    text = text.strip()
    if not text or text.lower() == "nan":
        return math.nan
    try:
        value = parse_number(text)
    except ValueError as error:
        raise ObservationError(
            f"{where}: {field.name}: {error}; leave the cell empty where nothing was read"
        ) from None
    low, high = field.range
    if not low <= value <= high:
        raise ObservationError(f"{where}: {field.name} is {value:g}; values lie in {low:g}..{high:g}")
    return float(field.from_unit(value))


def _position(texts: list[str]) -> tuple[float, float]:
    latitude, longitude = map(parse_number, texts)
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
        raise ValueError(f"{', '.join(texts)} is not a position in degrees")
    return latitude, longitude


def _name(texts: list[str]) -> str:
    if not texts[0]:
        raise ValueError("is empty; give the file's name")
    return PurePosixPath(texts[0].replace("\\", "/")).name.lower()


def _time(texts: list[str]) -> float:
    """Return a time in seconds since boot or since 1970; a time without a time zone is UTC."""
    try:
        value = parse_number(texts[0])
    except ValueError:
        try:
            time = datetime.fromisoformat(texts[0])
        except ValueError:
            text = f"{texts[0][:40]!r} is not a time; give seconds, or a time such as 2026-05-01T09:30:00Z"
            raise ValueError(text) from None
        return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()
    if not math.isfinite(value):
        raise ValueError(f"{texts[0]} is not finite")
    return value


_KEY_READERS: dict[tuple[str, ...], Callable[[list[str]], object]] = {
    ("latitude", "longitude"): _position,
    ("name",): _name,
    ("image",): lambda texts: parse_whole(texts[0]),
    ("time",): _time,
}
"""Columns that locate a row, and their reader; the most reliable columns come first."""


def join(
    readings: Readings, track: LogTrack | None, farm: Farm, fields: tuple[str, ...], footprint: int, day: int
) -> tuple[Observations, tuple[str, ...]]:
    """Return the observations of the farm's cells, and notes about discarded readings.

    A reading counts for all cells of the camera's footprint, a square with a side of `footprint` cells.
    Observations are in order of time; if any time is unknown, they keep the order of the table. Raises
    ObservationError if the key needs a log, or all readings were discarded; LogError if the log lacks the
    clock of the times.
    """
    latitude, longitude, time_s = _places(readings, track)
    found = np.isfinite(latitude)
    x_m, y_m = farm.frame.from_wgs84(np.where(found, latitude, 0.0), np.where(found, longitude, 0.0))
    ix, iy = farm.cell_of(np.asarray(x_m, np.float64), np.asarray(y_m, np.float64))
    dx, dy = footprint_offsets(footprint)
    x, y = ix[:, None] + dx, iy[:, None] + dy
    inside = (x >= 0) & (x < farm.width_cells) & (y >= 0) & (y < farm.height_cells) & found[:, None]
    values = np.asarray(readings.values, np.float32)
    empty = np.asarray(np.isnan(values).all(axis=1))
    inside &= ~empty[:, None]
    counts = {
        "are not in the log": int(np.count_nonzero(~found)),
        "are empty": int(np.count_nonzero(found & empty)),
        f"lie outside the farm {farm.name}": int(np.count_nonzero(found & ~empty & ~inside.any(axis=1))),
    }
    notes = tuple(f"{n} of {len(found)} readings {why}" for why, n in counts.items() if n)
    if not inside.any():
        raise ObservationError(f"no reading is left: {'; '.join(notes)}")
    order = np.argsort(time_s, kind="stable")
    row, cell = np.nonzero(inside[order])
    row = order[row]
    made = Observations(
        x[row, cell].astype(np.int32),
        y[row, cell].astype(np.int32),
        time_s[row] - time_s[row].min(),
        np.full(len(row), day, np.int32),
        values[row],
        fields,
    )
    return made, notes


def _places(readings: Readings, track: LogTrack | None) -> tuple[Floats, Floats, Floats]:
    """Return latitude, longitude (NaN if missing in the log) and time of each row."""
    count = len(readings.keys)
    if readings.key == ("latitude", "longitude"):
        latitude, longitude = np.array(readings.keys, np.float64).reshape(-1, 2).T
        return latitude, longitude, np.arange(count, dtype=np.float64)
    if track is None:
        key = readings.key[0]
        msg = f"the table gives the {key} of each reading, not its position"
        raise ObservationError(f"{msg}: add the log (--log), or columns latitude and longitude")
    if readings.key == ("time",):
        time_s = np.array(readings.keys, np.float64)
        return *track.at(time_s), time_s
    images, by_name = track.images, readings.key == ("name",)
    if by_name and not images.names:
        raise ObservationError(f"the {track.kind} has no names of pictures; give a column image or time")
    keys = [name.lower() for name in images.names] if by_name else images.index.tolist()
    number = {key: k for k, key in enumerate(keys)}
    rows = np.array([number.get(key, -1) for key in readings.keys])
    time_s = images.boot_s if np.isfinite(images.boot_s).all() else images.utc_s
    placed = np.column_stack((*track.of_images(), time_s))
    off_deg = np.abs(placed[:, :2] - placed[[number[key] for key in keys], :2]).max(axis=1)
    several = {keys[k] for k in np.flatnonzero(off_deg > _SAME_PLACE_DEG)} & set(readings.keys)
    if several:
        raise ObservationError(
            f"{readings.key[0]} {min(several)!r} is at several places in the {track.kind}, as after a restart"
            " of the camera; give a column time in UTC"
        )
    found = np.full((count, 3), np.nan)
    found[rows >= 0] = placed[rows[rows >= 0]]
    latitude, longitude, time_s = found.T
    # If a picture has no time, all rows keep the order of the table.
    return latitude, longitude, time_s if np.isfinite(time_s).all() else np.arange(count, dtype=np.float64)
