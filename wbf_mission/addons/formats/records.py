"""Records of a mission: named fields with places, shared by the GeoJSON, KML, GPX and CSV formats.

===========  ======================================================================================
role         the other fields
===========  ======================================================================================
mission      version (1), cruise_speed_m_s, hover_speed_m_s
home         altitude_m above mean sea level; its place
item         index (from 0; the target of a DO_JUMP), command, name, frame, param1 to param4, autocontinue
fence        as an item; a polygon may be one record with the places of its vertices
rally        as an item
===========  ======================================================================================

A record with a place has altitude_m; a record without a place has param5 to param7. An empty parameter is the
vehicle's default, and a missing parameter is 0. Names, and records of role ``path``, are for human readers;
the program ignores them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, TypeAlias

from geo.texts import is_number, parse_number
from mission.errors import MissionFileError
from mission.files.common import Parameters, check_jumps, home_of, make_item, make_mission, resolve_jumps
from mission.files.fence import POLYGON_COMMANDS, polygon_at
from mission.model import Command, GeoPoint, Mission, MissionItem

VERSION = 1
PATH = "path"
_SPEEDS = ("cruise_speed_m_s", "hover_speed_m_s")
ROLES = frozenset({"mission", "home", "item", "fence", "rally", PATH})
# Commands with a place to which the vehicle does not fly.
_NOT_FLOWN = frozenset({Command.DO_SET_HOME, Command.DO_SET_ROI_LOCATION, Command.DO_SET_ROI, 80, 252, 611})

_USUAL: Mapping[str, Any] = {
    **dict.fromkeys(("param1", "param2", "param3", "param4"), 0.0),
    "autocontinue": True,
}
# Spellings of true and false, including those of GDAL.
_FLAGS = {"true": True, "1": True, "1.0": True, "false": False, "0": False, "0.0": False}

LatLon: TypeAlias = tuple[float, float]  # Latitude and longitude, degrees.


@dataclass(frozen=True, slots=True)
class Record:
    """One record of a mission file: an item, home, a fence or rally item, or the header."""

    fields: Mapping[str, Any]  # Numbers, bools, texts of numbers or bools, or None, keyed by the names above.
    places: Sequence[LatLon] = ()  # No place, one place, or a polygon's vertices (the first is not repeated).
    where: str = ""  # Position of the record in the file, for error messages.

    @property
    def role(self) -> str:
        """Role of the record; a record that has a command, but no role, is an item."""
        role = self.fields.get("role")
        return str(role) if role else "item" if self.fields.get("command") is not None else ""

    def number(self, name: str, default: float | None = None) -> float | None:
        """Return a number; None if the field is empty or NaN, `default` if it is missing."""
        value = self.fields.get(name, default)
        if isinstance(value, str):
            try:
                value = parse_number(value) if value.strip() else None
            except ValueError:
                raise MissionFileError(f"{self.where}: {name} is {value[:40]!r}; give a number") from None
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return None
        if not is_number(value):
            raise MissionFileError(f"{self.where}: {name} is {str(value)[:40]!r}; give a finite number")
        return float(value)

    def whole(self, name: str) -> int:
        """Return a whole number; MissionFileError if the field is missing."""
        value = self.number(name)
        if value is None or not value.is_integer() or abs(value) > 1e9:
            shown = "missing" if value is None else f"{value:g}"
            raise MissionFileError(f"{self.where}: {name} is {shown}; give a whole number")
        return int(value)

    def flag(self, name: str, *, default: bool) -> bool:
        """Return a bool; `default` if the field is empty or missing."""
        value = self.fields.get(name)
        if value is None or value == "":
            return default
        text = str(value).strip().lower()
        if text not in _FLAGS:
            raise MissionFileError(f"{self.where}: {name} is {text[:40]!r}; give true or false")
        return _FLAGS[text]


def text_of(value: Any, *, empty: str = "") -> str:
    """Return the value of a field as text.

    >>> text_of(True), text_of(16), text_of(1.5), text_of(None, empty="NaN")
    ('true', '16', '1.5', 'NaN')
    """
    if value is None:
        return empty
    return str(value).lower() if isinstance(value, bool) else str(value)


def xml_texts(fields: Mapping[str, Any]) -> dict[str, str]:
    """Return the fields as texts, except fields with the value that a missing field has by default."""
    kept = {name: value for name, value in fields.items() if name not in _USUAL or value != _USUAL[name]}
    return {name: text_of(value, empty="NaN") for name, value in kept.items()}


def is_flown(item: MissionItem) -> bool:
    """Return whether the vehicle flies to the place of an item."""
    return is_placed(item) and item.command not in _NOT_FLOWN


def is_placed(item: MissionItem) -> bool:
    """Return whether an item has a place on the map; the position 0, 0 means "here" to some autopilots."""
    return item.has_position and (item.x, item.y) != (0.0, 0.0)


def command_name(command: int) -> str:
    """Return the name of a command.

    >>> command_name(16), command_name(1)
    ('NAV_WAYPOINT', 'command 1')
    """
    return Command(command).name if command in {*Command} else f"command {command}"


def records_of(mission: Mission, *, polygons: bool) -> list[Record]:
    """Convert a mission to records; with `polygons`, each fence polygon is a single record.

    Raises MissionFileError for a jump to an item that does not exist.
    """
    check_jumps(mission)
    speeds = {name: float(getattr(mission, name)) for name in _SPEEDS}
    records = [Record({"role": "mission", "version": VERSION, **speeds})]
    if (home := mission.home) is not None:
        place = (float(home.latitude_deg), float(home.longitude_deg))
        records.append(Record({"role": "home", "altitude_m": float(home.altitude_m)}, (place,)))
    records += [_record("item", index, (item,)) for index, item in enumerate(mission.items)]
    index = 0
    while index < len(mission.fence):
        vertices = _uniform_polygon(mission.fence, index) if polygons else mission.fence[index : index + 1]
        records.append(_record("fence", index, vertices))
        index += len(vertices)
    return records + [_record("rally", index, (item,)) for index, item in enumerate(mission.rally)]


def _uniform_polygon(items: Sequence[MissionItem], start: int) -> Sequence[MissionItem]:
    """Return a polygon's vertices if they differ only in place, on one side of 180 degrees; else one item."""
    alone = items[start : start + 1]
    if items[start].command not in POLYGON_COMMANDS:
        return alone
    try:
        vertices = polygon_at(items, start)
    except MissionFileError:
        return alone
    is_cut = max(vertex.y for vertex in vertices) - min(vertex.y for vertex in vertices) > 180.0
    is_one = not is_cut and len({replace(vertex, x=0.0, y=0.0) for vertex in vertices}) == 1
    return vertices if is_one and all(vertex.has_position for vertex in vertices) else alone


def _record(role: str, index: int, items: Sequence[MissionItem]) -> Record:
    item, places = items[0], [(float(vertex.x), float(vertex.y)) for vertex in items]
    fields: dict[str, Any] = {
        "role": role,
        "index": index,
        "command": item.command,
        "name": command_name(item.command),
        "frame": item.frame,
    }
    for name in ("param1", "param2", "param3", "param4"):
        value = getattr(item, name)
        fields[name] = None if value is None else float(value)
    fields["autocontinue"] = bool(item.autocontinue)
    if len(items) == 1 and not is_placed(item):
        return Record(fields | {"param5": float(item.x), "param6": float(item.y), "param7": float(item.z)})
    fields["altitude_m"] = float(item.z)
    ring = [*places, places[0]]
    if len(items) > 1 and sum(x0 * y1 - x1 * y0 for (y0, x0), (y1, x1) in pairwise(ring)) < 0.0:
        # Polygons of GeoJSON (RFC 7946) and KML are counterclockwise.
        fields["clockwise"] = True
        places = [places[0], *places[:0:-1]]
    return Record(fields, places)


def are_ours(records: Iterable[Record]) -> bool:
    """Return whether the records are a mission that this program wrote, as opposed to drawn paths."""
    return any(record.role in ROLES for record in records)


def mission_of(records: Sequence[Record]) -> Mission:
    """Convert records to a mission; a MissionFileError names the record that has the fault.

    Items are ordered by index; an item without an index follows the item before it.
    """
    home: GeoPoint | None = None
    speeds: dict[str, float] = {}
    plans: dict[str, list[tuple[float, Record]]] = {"item": [], "fence": [], "rally": []}
    for record in records:
        role = record.role
        if role in plans:
            before = plans[role][-1][0] if plans[role] else -1.0
            index = record.number("index")
            plans[role].append((before if index is None else index, record))
        elif role == "home":
            if len(record.places) != 1:
                raise MissionFileError(f"{record.where}: home does not have exactly one point; give one")
            altitude_m = record.number("altitude_m") or 0.0
            home = home_of(f"{record.where}: home", *record.places[0], altitude_m)
        elif role == "mission":
            if (version := record.number("version") or VERSION) != VERSION:
                raise MissionFileError(
                    f"{record.where}: version {version:g} is unknown (known: {VERSION}); update wbf-mission"
                )
            speeds = {name: value for name in _SPEEDS if (value := record.number(name)) is not None}
        elif role != PATH:
            known = ", ".join(sorted(ROLES))
            raise MissionFileError(
                f"{record.where}: role {role[:40]!r} is not one of {known}; give one, or remove it"
            )
    ordered = {role: sorted(plan, key=lambda entry: entry[0]) for role, plan in plans.items()}
    items = [(index, record, item) for index, record in ordered["item"] for item in _items(record)]
    return make_mission(
        resolve_jumps(
            [int(index) for index, _, _ in items],
            ((record.where, item) for _, record, item in items),
            "index",
        ),
        home,
        fence=[item for _, record in ordered["fence"] for item in _items(record)],
        rally=[item for _, record in ordered["rally"] for item in _items(record)],
        **speeds,
    )


def _items(record: Record) -> list[MissionItem]:
    """Return the item of a record, or the vertices of its polygon."""
    first, second, third, fourth = (record.number(f"param{k}", 0.0) for k in range(1, 5))
    command, count = record.whole("command"), len(record.places)
    if count > 1 and command in POLYGON_COMMANDS:
        if count < 3:
            raise MissionFileError(f"{record.where}: {count} vertices; a polygon has at least 3")
        first = float(count)
    elif count > 1:
        raise MissionFileError(f"{record.where}: {count} places for command {command}; give one point")
    parameters: Parameters = (first, second, third, fourth)
    places: Sequence[tuple[float | None, float | None]] = record.places
    if record.flag("clockwise", default=False) and count:
        places = [places[0], *places[:0:-1]]
    altitude_m = record.number("altitude_m" if places else "param7")
    return [
        make_item(
            record.where,
            command,
            record.whole("frame"),
            parameters,
            (latitude_deg, longitude_deg, altitude_m),
            autocontinue=record.flag("autocontinue", default=True),
            keep_frame=True,
        )
        for latitude_deg, longitude_deg in places or [(record.number("param5"), record.number("param6"))]
    ]
