"""Functions shared by the mission file formats: strict JSON, file kinds, items, jumps, home."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, TypeAlias, TypeVar

import msgspec

from geo.reading import json_texts, misfit, not_json
from geo.texts import one_line
from mission.errors import MissionError, MissionFileError
from mission.model import Command, Frame, GeoPoint, Mission, MissionItem

MAX_BYTES = 64 * 2**20
PLAN_KIND = "a QGroundControl plan"
WAYPOINTS_KIND = "a QGC WPL waypoint list"
NATIVE_KIND = "a wbf-mission file"
KML_KIND = "a KML file"
KMZ_KIND = "a ZIP archive (KMZ, perhaps)"
GPX_KIND = "a GPX file"
GEOJSON_KIND = "a GeoJSON file"
FENCE_KIND = "a fence file of MAVProxy or Mission Planner"
RALLY_KIND = "a rally file of MAVProxy or Mission Planner"
_OLD_MISSION_KIND = "a mission of QGroundControl 3 (.mission)"
TEXT_KIND = "a text file of another kind"
UTF_16_KIND = "UTF-16 text (save it as UTF-8)"
_SUFFIX_OF_KIND = {
    PLAN_KIND: ".plan",
    WAYPOINTS_KIND: ".waypoints",
    NATIVE_KIND: ".json",
    KML_KIND: ".kml",
    KMZ_KIND: ".kmz",
    GPX_KIND: ".gpx",
    GEOJSON_KIND: ".geojson",
    FENCE_KIND: ".fen",
    RALLY_KIND: ".ral",
}
POINTS_OF_KIND = {kind: _SUFFIX_OF_KIND[kind] for kind in (FENCE_KIND, RALLY_KIND)}
"""Suffix of the format that reads a kind of files, even if a file has the suffix of a waypoint list."""
_TEXT_KINDS = {
    rb"qgc\s+wpl\b.*": WAYPOINTS_KIND,
    rb"rally\s.*": RALLY_KIND,
    rb"[-+]?\d[\d.,e+-]*\s+[-+]?\d[\d.,e+-]*": FENCE_KIND,
}
"""Kinds of text files, by a pattern for the first line that is not a comment (in lower case)."""
_XML_KINDS = {b"kml": KML_KIND, b"gpx": GPX_KIND, b"html": "an HTML page"}
_XML_PROLOGUE = 100_000
BOM = b"\xef\xbb\xbf"
_BEFORE_JSON = b"\x1e \t\r\n"
_UTF_16_BOMS = (b"\xff\xfe", b"\xfe\xff")

T = TypeVar("T")
Parameters: TypeAlias = tuple[float | None, float | None, float | None, float | None]
Place: TypeAlias = tuple[float | None, float | None, float | None]


class Firmware(IntEnum):
    """The autopilot for which a mission file is written (MAV_AUTOPILOT)."""

    GENERIC = 0
    ARDUPILOT = 3
    PX4 = 12


_GEOJSON_TYPES = frozenset(
    b'"%s"' % name
    for name in (
        *(b"FeatureCollection", b"Feature", b"GeometryCollection", b"Point", b"MultiPoint"),
        *(b"LineString", b"MultiLineString", b"Polygon", b"MultiPolygon"),
    )
)


class _Header(msgspec.Struct):
    # These values are not decoded, because a hostile file may hold any JSON under these keys.
    file_type: msgspec.Raw = msgspec.field(default=msgspec.Raw(b"null"), name="fileType")
    format: msgspec.Raw = msgspec.Raw(b"null")
    type: msgspec.Raw = msgspec.Raw(b"null")
    home: msgspec.Raw = msgspec.field(default=msgspec.Raw(b""), name="plannedHomePosition")
    items: msgspec.Raw = msgspec.Raw(b"")


_HEADER = msgspec.json.Decoder(_Header)
_ANY_JSON = msgspec.json.Decoder(msgspec.Raw)


def is_json(data: bytes) -> bool:
    """Return whether the content starts like JSON: an object, an array, or a text sequence (RFC 8142)."""
    return data[:1000].removeprefix(BOM).lstrip(_BEFORE_JSON)[:1] in (b"{", b"[")


def kind_of(data: bytes) -> str:
    """Return a description of the kind of a file, detected from its first bytes and JSON keys."""
    start = data[:2000].removeprefix(BOM).lstrip().lower()
    is_utf_16 = data.startswith(_UTF_16_BOMS)
    if is_utf_16:
        start = data[:4000].decode("utf-16", "ignore").encode().lstrip().lower()
    if not start:
        return "an empty file"
    if start.startswith(b"<"):
        root = re.search(rb"<(?:[\w.-]+:)?([\w.-]+)", start if is_utf_16 else data[:_XML_PROLOGUE])
        return _XML_KINDS.get(root[1].lower() if root else b"", "an XML file")
    if is_utf_16:
        return UTF_16_KIND
    if start.startswith(b"pk\x03\x04"):
        return KMZ_KIND
    if is_json(data):
        return _kind_of_json(data)
    if b"\0" in start:
        return "a binary file"
    lines = (line.strip() for line in start.splitlines())
    first = next((line for line in lines if line and not line.startswith(b"#")), b"")
    return next((kind for begin, kind in _TEXT_KINDS.items() if re.fullmatch(begin, first)), TEXT_KIND)


def decode_text(data: bytes) -> str:
    """Return the text of a UTF-8 file, or of a UTF-16 file with a byte order mark."""
    try:
        return data.decode("utf-16" if data.startswith(_UTF_16_BOMS) else "utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise MissionFileError(f"line {line}: this is not UTF-8 text; save the file as UTF-8") from None


def _kind_of_json(data: bytes) -> str:
    try:
        header = _HEADER.decode(next(text for _, text in json_texts(data.removeprefix(BOM))))
    except (ValueError, RecursionError):
        return "a JSON file of another kind"
    if bytes(header.file_type) == b'"Plan"':
        return PLAN_KIND
    if bytes(header.file_type) != b"null":
        return f"a file with fileType {one_line(bytes(header.file_type)[:80].decode(errors='replace'))}"
    if bytes(header.format) == b'"wbf-mission"':
        return NATIVE_KIND
    if bytes(header.home) and bytes(header.items):
        return _OLD_MISSION_KIND
    return GEOJSON_KIND if bytes(header.type) in _GEOJSON_TYPES else "a JSON file of another kind"


def wrong_kind(data: bytes, expected: str) -> MissionFileError:
    """Return the error to raise for content that is not of the expected kind."""
    found = kind_of(data)
    advice = "give a mission, such as a .plan or .waypoints"
    if suffix := _SUFFIX_OF_KIND.get(found):
        advice = f"rename it to end in {suffix}"
    elif found == _OLD_MISSION_KIND:
        advice = "open it in QGroundControl 4 and save it as a .plan"
    return MissionFileError(f"this is {found}, not {expected}; {advice}")


def decode_json(data: bytes, decoder: msgspec.json.Decoder[T], path: str = "", line: int = 1) -> T:
    """Decode strict JSON (no NaN, Infinity or comments).

    `path` or `line` is the location of `data` in its file, for error messages. MissionFileError names the
    line of a syntax error, or the path of a value of the wrong type.
    """
    data = data.removeprefix(BOM)
    try:
        return decoder.decode(data)
    except msgspec.ValidationError as error:
        raise MissionFileError(misfit(error, path)) from None
    except RecursionError:
        raise MissionFileError("the JSON is nested too deeply for a mission file") from None
    except ValueError as error:  # msgspec.DecodeError and UnicodeDecodeError
        raise MissionFileError(f"{not_json(error, data, line)}; the file is damaged or is not JSON") from None


def check_json(data: bytes, expected: str) -> None:
    """Raise MissionFileError unless the content is JSON of the expected kind; syntax is checked first."""
    if is_json(data) and kind_of(data) == expected:
        return
    if is_json(data):
        line, text = next(json_texts(data.removeprefix(BOM)))
        decode_json(text, _ANY_JSON, line=line)
    raise wrong_kind(data, expected)


def make_item(
    where: str,
    command: int,
    frame: int,
    parameters: Parameters,
    place: Place,
    *,
    autocontinue: bool,
    keep_frame: bool = False,
) -> MissionItem:
    """Return a mission item in the standard frame of its command; with `keep_frame`, in `frame`.

    Error messages begin with `where`. ``None`` in `place` (x, y, z) is a number missing from the file: it
    counts as 0 for a command without a position, and is an error for a command with a position.
    """
    try:
        x, y, z = (0.0 if value is None else value for value in place)
        item = MissionItem(command, frame, *parameters, x, y, z, autocontinue)
    except MissionError as error:
        raise MissionFileError(f"{where}: {error}; correct the value") from None
    if item.has_position and None in place:
        missing = ("latitude", "longitude", "altitude")[place.index(None)]
        msg = f"{where}: {missing} of command {command} is missing (null or NaN); give a number"
        raise MissionFileError(msg)
    return item if keep_frame else item.in_standard_frame()


def rally_item(where: str, place: Place) -> MissionItem:
    """Return a rally point with its altitude above home."""
    frame = Frame.GLOBAL_RELATIVE_ALT
    return make_item(where, Command.NAV_RALLY_POINT, frame, (0.0, 0.0, 0.0, 0.0), place, autocontinue=False)


def make_mission(items: Iterable[MissionItem], home: GeoPoint | None, **more: Any) -> Mission:
    """Return a mission; an invalid value raises MissionFileError in place of MissionError."""
    try:
        return Mission(tuple(items), home, **more)
    except MissionError as error:
        raise MissionFileError(str(error)) from None


def jump_target(item: MissionItem, where: str) -> int:
    """Return the target (param1) of a DO_JUMP as a whole number."""
    target = item.param1
    if target is None or not float(target).is_integer():
        raise MissionFileError(f"{where}: DO_JUMP to {target}; param1 has to be the number of an item")
    return int(target)


def resolve_jumps(
    numbers: Sequence[int | None], items: Iterable[tuple[str, MissionItem]], numbering: str
) -> tuple[MissionItem, ...]:
    """Return the items, with the targets of DO_JUMP (item numbers in the file) converted to indices.

    `numbers` are the item numbers in the file; `numbering` is the name of the numbers in error messages.
    `items` pairs each item with its location in the file.
    """
    index_of, counts = {number: index for index, number in enumerate(numbers)}, Counter(numbers)
    resolved = []
    for where, item in items:
        if item.command == Command.DO_JUMP:
            target = jump_target(item, where)
            if counts[target] != 1:
                problem = "occurs more than once" if target in index_of else "does not exist"
                raise MissionFileError(f"{where}: DO_JUMP to {numbering} {target}, which {problem}")
            item = replace(item, param1=float(index_of[target]))
        resolved.append(item)
    return tuple(resolved)


def check_jumps(mission: Mission) -> None:
    """Raise MissionFileError if the target of a DO_JUMP does not exist."""
    for index, item in enumerate(mission.items):
        if item.command == Command.DO_JUMP:
            target = jump_target(item, f"item {index + 1}")
            if not 0 <= target < len(mission.items):
                raise MissionFileError(
                    f"item {index + 1}: DO_JUMP to item {target + 1}, but items go from 1 to"
                    f" {len(mission.items)}"
                )


@dataclass(frozen=True, slots=True)
class WithNotes:
    """A mission read from a file, with notes on the interpretation of the file."""

    mission: Mission
    notes: tuple[str, ...]


def home_for_file(mission: Mission) -> GeoPoint:
    """Return the home position to write in a format that requires a home.

    An unknown home is written as the mission's first position at 0 m. If the mission has no position either,
    home is written as 0, 0, 0, which readers understand as unknown.
    """
    if mission.home is not None:
        return mission.home
    first = next((item for item in mission.items if item.has_position), None)
    return GeoPoint(0.0, 0.0) if first is None else GeoPoint(first.x, first.y)


def home_of(where: str, latitude_deg: float, longitude_deg: float, altitude_m: float) -> GeoPoint:
    """Return the home position from the numbers in a file."""
    try:
        return GeoPoint(latitude_deg, longitude_deg, altitude_m)
    except MissionError as error:
        raise MissionFileError(f"{where}: {error}; correct the value") from None


def home_from_file(
    where: str, latitude_deg: float, longitude_deg: float, altitude_m: float
) -> GeoPoint | None:
    """Return the home read from a format that requires a home; a home of 0, 0, 0 is unknown (None)."""
    if latitude_deg == longitude_deg == altitude_m == 0.0:
        return None
    return home_of(f"{where}: home", latitude_deg, longitude_deg, altitude_m)


def file_parameters(item: MissionItem, firmware: Firmware) -> Parameters:
    """Return parameters 1 to 4 for a file; unset values are None, or 0 for ArduPilot, which refuses NaN."""
    default = 0.0 if firmware == Firmware.ARDUPILOT else None
    first, second, third, fourth = (
        default if value is None else float(value)
        for value in (item.param1, item.param2, item.param3, item.param4)
    )
    return first, second, third, fourth
