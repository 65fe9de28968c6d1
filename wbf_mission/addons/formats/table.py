"""Reads and writes CSV for spreadsheets: missions of this program, and tables of places."""

from __future__ import annotations

import csv
import io
from typing import Any

from geo.features import DEGREES, LATITUDES, LONGITUDES, column_name
from geo.texts import decimal_point
from mission.errors import MissionFileError
from mission.files.common import TEXT_KIND, UTF_16_KIND, Firmware, decode_text, kind_of, wrong_kind
from mission.model import Frame, Mission
from wbf_mission.addons.formats.drawn import Drawing, DrawnPath, Point
from wbf_mission.addons.formats.records import Record, mission_of, records_of, text_of

_COLUMNS = (
    *("role", "index", "command", "name", "frame", "latitude", "longitude", "altitude_m"),
    *("param1", "param2", "param3", "param4", "param5", "param6", "param7", "autocontinue"),
    *("version", "cruise_speed_m_s", "hover_speed_m_s"),
)
_LATITUDES = (*LATITUDES, "y")
_LONGITUDES = (*LONGITUDES, "x")
_ALTITUDES = {
    Frame.GLOBAL_RELATIVE_ALT: (
        "altitude_m",
        "altitude",
        "alt",
        "height",
        "rel_alt",
        "relative_altitude",
        "agl",
        "z",
    ),
    Frame.GLOBAL: ("amsl", "msl", "alt_msl", "alt_amsl", "altitude_amsl", "altitude_msl", "elevation", "ele"),
}
_METRES = ("m", "metre", "metres", "meter", "meters")
_LONGEST_LINE = 10_000
_MOST_LINES = 2_000_000


def loads(data: bytes) -> Mission | Drawing:
    """Read a mission that this program wrote, or a table with columns of latitude, longitude and altitude.

    Columns are separated by commas, tabs or semicolons; with semicolons, numbers may have a decimal comma.
    Altitudes are above home, or above sea level if the column is named ``amsl``, ``elevation`` or similar.
    Litchi's altitudes above the ground (``altitudemode`` 1) are refused.
    """
    kind = kind_of(data)
    if kind not in (TEXT_KIND, UTF_16_KIND):
        raise wrong_kind(data, "a CSV table")
    rows = _rows(decode_text(data))
    header, comma = rows[0][1], rows[0][2] == ";"
    latitude, longitude = _column(header, _LATITUDES), _column(header, _LONGITUDES)
    if latitude is None or longitude is None:
        raise MissionFileError(
            f"line {rows[0][0]}: no columns of latitude and longitude; the first line must name the columns"
        )
    records = []
    for line, words, _ in rows[1:]:
        if any(word.strip() for word in words[len(header) :]):
            raise MissionFileError(f"line {line}: {len(words)} columns, but the header names {len(header)}")
        texts = dict(zip(header, (word.strip() for word in words), strict=False))
        if comma:
            texts = {name: decimal_point(text) for name, text in texts.items()}
        records.append(Record({name: text for name, text in texts.items() if name}, (), f"line {line}"))
    if "command" in header:
        return mission_of([_placed(record, latitude, longitude) for record in records])
    columns = {frame: _column(header, names) for frame, names in _ALTITUDES.items()}
    frame = next((frame for frame, name in columns.items() if name is not None), None)
    altitude = None if frame is None else columns[frame]
    for record in records:
        if record.number("altitudemode"):  # In Litchi's tables 0 is above the take-off, 1 above the ground
            shown = record.fields["altitudemode"][:40]
            raise MissionFileError(
                f"{record.where}: altitudemode is {shown}, not 0 (above home); give altitudes"
                " above home (in Litchi without 'above ground') and 0"
            )
    points = [
        Point(
            _degrees(record, latitude),
            _degrees(record, longitude),
            None if altitude is None else record.number(altitude),
            frame,
            record.where,
        )
        for record in records
    ]
    return Drawing([DrawnPath("the table", points)] if points else [], 0, "there is no column of altitudes")


def _rows(text: str) -> list[tuple[int, list[str], str]]:
    """Return each row that is not empty, with line number and delimiter; column names are normalised."""
    if text.count("\n") + text.count("\r") > _MOST_LINES:
        raise MissionFileError(f"more than {_MOST_LINES} lines; thin the path out")
    lines = (line.strip() for line in io.StringIO(text, newline=None))
    first = next((line for line in lines if line and not line.startswith("#")), "")
    delimiter = max(",;\t", key=first.count)
    rows: list[tuple[int, list[str], str]] = []
    reader = csv.reader(
        io.StringIO(text, newline=None), delimiter=delimiter, skipinitialspace=True, strict=True
    )
    try:
        for words in reader:
            if sum(map(len, words)) > _LONGEST_LINE:
                raise MissionFileError(f"line {reader.line_num}: longer than {_LONGEST_LINE} characters")
            if any(word.strip() for word in words) and not words[0].lstrip().startswith("#"):
                rows.append((reader.line_num, words, delimiter))
    except csv.Error as error:
        raise MissionFileError(f"line {reader.line_num}: {error}; the table is damaged") from None
    if not rows:
        raise MissionFileError("the file has no table; its first line must name the columns")
    line, names, _ = rows[0]
    rows[0] = (line, [_plain(name, line) for name in names], delimiter)
    return rows


def _plain(name: str, line: int) -> str:
    """Return a column name in lower case without its unit, which must be metres or degrees.

    >>> _plain("Altitude (m)", 1), _plain("Rel Alt", 1)
    ('altitude', 'rel_alt')
    """
    plain, unit = column_name(name)
    known = {*_LATITUDES, *_LONGITUDES, *(name for names in _ALTITUDES.values() for name in names)}
    if plain in known and unit not in (*DEGREES, *_METRES):
        raise MissionFileError(
            f"line {line}: column {name.strip()[:40]!r} is not in metres or degrees; convert it"
        )
    return plain


def _column(header: list[str], names: tuple[str, ...]) -> str | None:
    return next((name for name in names if name in header), None)


def _degrees(record: Record, name: str) -> float:
    value = record.number(name)
    if value is None:
        raise MissionFileError(f"{record.where}: {name} is missing; give degrees")
    return value


def _placed(record: Record, latitude: str, longitude: str) -> Record:
    """Move a record's coordinates from the record's fields to its places."""
    texts: dict[str, Any] = dict(record.fields)
    place = (texts.pop(latitude, ""), texts.pop(longitude, ""))
    if not any(place):
        return Record(texts, (), record.where)
    return Record(texts, ((_degrees(record, latitude), _degrees(record, longitude)),), record.where)


def dumps(mission: Mission, firmware: Firmware = Firmware.GENERIC) -> str:  # noqa: ARG001  one signature
    """Write a mission as CSV, one row per record."""
    made = io.StringIO()
    table = csv.writer(made, lineterminator="\n")
    table.writerow(_COLUMNS)
    for record in records_of(mission, polygons=False):
        fields = dict(record.fields)
        for latitude_deg, longitude_deg in record.places:
            fields |= {"latitude": latitude_deg, "longitude": longitude_deg}
        table.writerow([text_of(fields.get(name)) for name in _COLUMNS])
    return made.getvalue()
