"""QGroundControl plans (``.plan``): JSON with the mission, the fence and the rally points.

Written plans hold simple items only, with every key that QGroundControl's loaders require. Three kinds of
items are read: simple items, complex items that store their commands (surveys, corridor scans), and landing
patterns and structure scans (`mission.files.patterns`). Sources: the loaders of QGroundControl
(MissionController, SimpleMissionItem, TransectStyleComplexItem, GeoFenceController, RallyPointController) and
docs.qgroundcontrol.com, "Plan file format".
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec import Meta

from mission.errors import MissionFileError
from mission.files.common import (
    PLAN_KIND,
    Firmware,
    check_json,
    check_jumps,
    decode_json,
    file_parameters,
    home_for_file,
    home_from_file,
    jump_target,
    make_item,
    make_mission,
    rally_item,
    resolve_jumps,
)
from mission.files.fence import GeoFence, fence_items, geo_fence
from mission.files.patterns import KINDS, Pattern, commands_of
from mission.model import MAX_ITEMS, Command, Frame, GeoPoint, Mission, MissionItem

_Number = float | None
T = TypeVar("T")
_ALTITUDE_MODES = {Frame.GLOBAL_RELATIVE_ALT: 1, Frame.GLOBAL: 2, Frame.GLOBAL_TERRAIN_ALT: 4}
_MIXED = 0


class _Simple(msgspec.Struct, tag_field="type", tag="SimpleItem"):
    command: Annotated[int, Meta(ge=0, le=65535)]
    frame: Annotated[int, Meta(ge=0, le=255)]
    params: Annotated[list[_Number], Meta(min_length=4, max_length=7)]
    # QGroundControl up to 3.3 wrote the position in `coordinate`, and only four entries in `params`.
    coordinate: tuple[_Number, _Number, _Number] | None = None
    autocontinue: bool = msgspec.field(default=True, name="autoContinue")
    jump_id: int | None = msgspec.field(default=None, name="doJumpId")
    altitude: _Number = msgspec.field(default=None, name="Altitude")


class _Transect(msgspec.Struct):
    items: list[_Simple] | None = msgspec.field(default=None, name="Items")


class _Complex(msgspec.Struct, tag_field="type", tag="ComplexItem"):
    kind: str = msgspec.field(default="unnamed", name="complexItemType")
    transect: _Transect | None = msgspec.field(default=None, name="TransectStyleComplexItem")
    items: list[_Simple] | None = msgspec.field(default=None, name="Items")


class _PatternsOfMission(msgspec.Struct):
    items: list[Pattern]


class _PatternsOfPlan(msgspec.Struct):
    mission: _PatternsOfMission


class _Mission(msgspec.Struct):
    version: int
    items: list[_Simple | _Complex]
    home: Annotated[list[_Number], Meta(max_length=3)] | None = msgspec.field(
        default=None, name="plannedHomePosition"
    )
    cruise_speed_m_s: _Number = msgspec.field(default=None, name="cruiseSpeed")
    hover_speed_m_s: _Number = msgspec.field(default=None, name="hoverSpeed")


class _Rally(msgspec.Struct):
    points: list[tuple[float, float, float]] = []


class _Plan(msgspec.Struct):
    version: int
    mission: _Mission
    fence: msgspec.Raw = msgspec.field(default=msgspec.Raw(b"null"), name="geoFence")
    rally: msgspec.Raw = msgspec.field(default=msgspec.Raw(b"null"), name="rallyPoints")


_PLAN = msgspec.json.Decoder(_Plan)
_PATTERNS = msgspec.json.Decoder(_PatternsOfPlan)
_FENCE = msgspec.json.Decoder(GeoFence | None)
_RALLY = msgspec.json.Decoder(_Rally | None)
# A hostile file could hold millions of vertices; autopilots store a few hundred.
_MAX_PART_BYTES = 8 * 2**20


def loads(data: bytes) -> Mission:
    """Read a mission from the content of a plan file.

    The file is UTF-8 JSON with fileType "Plan", version 1, and a mission of version 2. Items get their
    standard frames. A survey becomes its stored commands. A landing pattern or structure scan becomes the
    commands that QGroundControl generates. Jump targets become indices of the items.

    MissionFileError names the item and the field that is damaged, invalid or of another version. It is also
    raised for a complex item whose commands are unknown.
    """
    check_json(data, PLAN_KIND)
    plan = decode_json(data, _PLAN)
    for name, version, known in (("version", plan.version, 1), ("mission, version", plan.mission.version, 2)):
        if version != known:
            msg = f"{name} is {version}, but must be {known}; save the plan with a current QGroundControl"
            raise MissionFileError(msg)
    names = ("cruise_speed_m_s", "hover_speed_m_s")
    speeds = {name: value for name in names if (value := getattr(plan.mission, name)) is not None}
    fence = _part(plan.fence, _FENCE, "geoFence")
    rally = _part(plan.rally, _RALLY, "rallyPoints")
    return make_mission(
        _items(plan.mission.items, data),
        _home(plan.mission.home),
        fence=() if fence is None else fence_items(fence),
        rally=[rally_item(f"rallyPoints, point {k}", point) for k, point in enumerate(rally.points, 1)]
        if rally
        else (),
        **speeds,
    )


def _part(raw: msgspec.Raw, decoder: msgspec.json.Decoder[T], name: str) -> T:
    data = bytes(raw)
    if len(data) > _MAX_PART_BYTES:
        size, most = len(data) / 2**20, _MAX_PART_BYTES / 2**20
        raise MissionFileError(f"{name}: {size:.0f} MiB, but at most {most:.0f} MiB are read; simplify it")
    return decode_json(data, decoder, name)


def _flat(items: list[_Simple | _Complex], data: bytes) -> Iterator[tuple[str, _Simple]]:
    """Yield every simple item with its location in the file."""
    patterns: list[Pattern] | None = None
    for index, item in enumerate(items):
        where = f"mission, item {index + 1}"
        if isinstance(item, _Simple):
            yield where, item
            continue
        transect = item.transect
        inner, path = item.items, where
        if inner is None and transect is not None:
            inner, path = transect.items, f"{where}, TransectStyleComplexItem"
        if inner is not None:
            for position, simple in enumerate(inner):
                yield f"{path}, Item {position + 1}", simple
        elif item.kind in KINDS:
            patterns = patterns or decode_json(data, _PATTERNS).mission.items
            for command, frame, values in commands_of(where, item.kind, patterns[index]):
                yield where, _Simple(command, frame, list(values))
        else:
            raise MissionFileError(
                f"{where}: the complex item {item.kind[:60]!r} has no commands in the file; "
                "replace it by simple items in QGroundControl"
            )


def _items(items: list[_Simple | _Complex], data: bytes) -> tuple[MissionItem, ...]:
    flat: list[tuple[str, _Simple]] = []
    for where, simple in _flat(items, data):
        if len(flat) == MAX_ITEMS:
            msg = f"{where}: more than {MAX_ITEMS} items, too many for MAVLink; fly the mission in parts"
            raise MissionFileError(msg)
        flat.append((where, simple))
    numbers = [simple.jump_id for _, simple in flat]
    if all(number is None for number in numbers):
        numbers = list(range(1, len(flat) + 1))
    return resolve_jumps(numbers, ((where, _item(where, simple)) for where, simple in flat), "doJumpId")


def _item(where: str, simple: _Simple) -> MissionItem:
    values = simple.params
    if len(values) == 4 and simple.coordinate is not None:
        values = [*values, *simple.coordinate]
    if len(values) != 7:
        raise MissionFileError(f"{where}, params: {len(values)} entries; give a list with 7")
    first, second, third, fourth, x, y, z = values
    return make_item(
        where,
        simple.command,
        simple.frame,
        (first, second, third, fourth),
        (x, y, simple.altitude if z is None else z),
        autocontinue=simple.autocontinue,
    )


def _home(position: list[float | None] | None) -> GeoPoint | None:
    if position is None or len(position) < 2 or position[0] is None or position[1] is None:
        return None
    altitude_m = position[2] if len(position) > 2 else None
    return home_from_file("mission, plannedHomePosition", position[0], position[1], altitude_m or 0.0)


def dumps(mission: Mission, firmware: Firmware = Firmware.PX4) -> str:
    """Return a mission as the text of a plan file.

    Fence items need MAVLink's order: the vertices of a polygon follow each other, each with the vertex count
    as param1. Rally points need altitudes above home, or a known home. An unknown home is written as the
    first position of the mission. An unset parameter is written as null, or as 0 for ArduPilot.

    Raises MissionFileError if a jump target is missing, or the fence or a rally point cannot be written.

    >>> loads(dumps(Mission((MissionItem.waypoint(28.05, -82.15, 10.0),))).encode()).items[0].param4 is None
    True
    """
    check_jumps(mission)
    home = home_for_file(mission)
    modes = {_ALTITUDE_MODES.get(Frame(item.frame), _MIXED) for item in mission.items if item.has_position}
    plan = {
        "fileType": "Plan",
        "geoFence": geo_fence(mission.fence),
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": float(mission.cruise_speed_m_s),
            "firmwareType": int(firmware),
            "globalPlanAltitudeMode": modes.pop() if len(modes) == 1 else (_MIXED if modes else 1),
            "hoverSpeed": float(mission.hover_speed_m_s),
            "items": [_simple(index, item, firmware) for index, item in enumerate(mission.items)],
            "plannedHomePosition": [float(number) for number in astuple(home)],
            "vehicleType": 2,
            "version": 2,
        },
        "rallyPoints": {
            "points": [_rally_point(index, item, mission) for index, item in enumerate(mission.rally)],
            "version": 2,
        },
        "version": 1,
    }
    return msgspec.json.format(msgspec.json.encode(plan), indent=4).decode() + "\n"


def _simple(index: int, item: MissionItem, firmware: Firmware) -> dict[str, Any]:
    item = item.in_standard_frame()
    parameters = list(file_parameters(item, firmware))
    if item.command == Command.DO_JUMP:
        parameters[0] = jump_target(item, f"item {index + 1}") + 1.0
    simple: dict[str, Any] = {
        "autoContinue": bool(item.autocontinue),
        "command": item.command,
        "doJumpId": index + 1,
        "frame": item.frame,
        "params": [*parameters, float(item.x), float(item.y), float(item.z)],
        "type": "SimpleItem",
    }
    if item.has_position:
        # QGroundControl refuses an item with only one or two of the altitude keys.
        simple |= {
            "AMSLAltAboveTerrain": None,
            "Altitude": float(item.z),
            "AltitudeMode": _ALTITUDE_MODES[Frame(item.frame)],
        }
    return simple


def _rally_point(index: int, item: MissionItem, mission: Mission) -> list[float]:
    altitude_m = float(item.z)
    if item.frame == Frame.GLOBAL and mission.home is not None:
        altitude_m -= float(mission.home.altitude_m)
    elif item.frame != Frame.GLOBAL_RELATIVE_ALT:
        raise MissionFileError(
            f"rally point {index + 1}: its altitude is in frame {item.frame}, but a plan has altitudes above"
            " home; give frame 3, or frame 0 and a home"
        )
    return [float(item.x), float(item.y), altitude_m]
