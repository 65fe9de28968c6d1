"""Reads fence and rally files of MAVProxy and Mission Planner: text files with one point per line.

The first point of a fence (``.fen``, MAVProxy's ``fence.txt``) is the return point. The other points are
corners, and the first corner is repeated at the end. A line of a rally file (``.ral``, ``rally.txt``) is
``RALLY``, latitude, longitude, altitude above home, break altitude, landing direction, flags. A MAVLink item
has no room for break altitude, landing direction and flags. Sources: pymavlink, mavwp.py;
ArduPilot/MissionPlanner, FlightPlanner.cs.
"""

from __future__ import annotations

import io
from collections.abc import Iterator

from geo.texts import decimal_point, parse_number
from mission.errors import MissionFileError
from mission.files.common import (
    FENCE_KIND,
    RALLY_KIND,
    WithNotes,
    decode_text,
    kind_of,
    make_mission,
    rally_item,
    wrong_kind,
)
from mission.files.fence import GeoFence, Polygon, fence_items
from mission.model import MAX_ITEMS, MissionItem

_LONGEST_LINE = 2000
_MOST_LINES = 500_000
_RALLY_WORDS = (4, 7)


def loads(data: bytes) -> WithNotes:
    """Read a fence or rally points; a MissionFileError names the line that is invalid."""
    kind = kind_of(data)
    if kind == FENCE_KIND:
        return _fence([_numbers(words, number, 2) for number, words in _lines(data)])
    if kind == RALLY_KIND:
        return _rally(data)
    raise wrong_kind(data, "a fence or rally file")


def _lines(data: bytes) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the words of each line that is neither empty nor a comment."""
    for number, line in enumerate(io.StringIO(decode_text(data), newline=None), start=1):
        if len(line) > _LONGEST_LINE or number > _MOST_LINES:
            raise MissionFileError(f"line {number}: the line or the file is too long; the file is damaged")
        words = line.split()
        if words and not words[0].startswith("#"):
            yield number, words


def _numbers(words: list[str], line: int, count: int) -> list[float]:
    if len(words) != count:
        raise MissionFileError(
            f"line {line}: {len(words)} numbers instead of {count}; correct or remove the line"
        )
    try:
        return [parse_number(decimal_point(word)) for word in words]
    except ValueError as error:
        raise MissionFileError(f"line {line}: {error}; give degrees and metres") from None


def _fence(points: list[list[float]]) -> WithNotes:
    corners, back = points[1:], points[0]
    if points[0] == points[-1]:
        corners, note = points[:-1], "the fence has no return point: its first corner is repeated at the end"
    else:
        if corners[0] == corners[-1]:
            del corners[-1]
        note = f"the first point, {back[0]:.6f}, {back[1]:.6f}, is the fence's return point"
    if len(corners) < 3:
        raise MissionFileError(f"{len(points)} points; a fence has a return point and at least 3 corners")
    fence = GeoFence(
        [Polygon([(latitude_deg, longitude_deg) for latitude_deg, longitude_deg in corners])],
        breach_return=None if corners[0] is back else (back[0], back[1], 0.0),
    )
    note += f"; {len(corners)} corners are an inclusion zone"
    return WithNotes(make_mission([], None, fence=fence_items(fence)), (note,))


def _rally(data: bytes) -> WithNotes:
    items: list[MissionItem] = []
    lost = 0
    for number, words in _lines(data):
        if words[0].lower() != "rally" or not _RALLY_WORDS[0] <= len(words) <= _RALLY_WORDS[1]:
            raise MissionFileError(
                f"line {number}: not RALLY, latitude, longitude and altitude; correct or remove the line"
            )
        numbers = _numbers(words[1:], number, len(words) - 1)
        if len(items) >= MAX_ITEMS:
            raise MissionFileError(f"line {number}: more than {MAX_ITEMS} points, the maximum of MAVLink")
        place = (numbers[0], numbers[1], numbers[2])
        lost += any(numbers[3:])
        items.append(rally_item(f"line {number}", place))
    notes = [f"{len(items)} rally points, altitudes above home"]
    if lost:
        notes.append(f"break altitudes, landing directions and flags of {lost} rally points are left out")
    return WithNotes(make_mission([], None, rally=items), tuple(notes))
