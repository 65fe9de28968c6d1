"""Conversion between MAVLink fence items and the ``geoFence`` of a QGroundControl plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from mission.errors import MissionFileError
from mission.files.common import make_item
from mission.model import Command, Frame, MissionItem

_POLYGONS = {
    True: Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    False: Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
}
POLYGON_COMMANDS = frozenset(_POLYGONS.values())
_CIRCLES = {True: Command.NAV_FENCE_CIRCLE_INCLUSION, False: Command.NAV_FENCE_CIRCLE_EXCLUSION}


class Polygon(msgspec.Struct):
    """A polygon of [latitude, longitude] vertices; the vehicle stays inside if `inclusion`, else outside."""

    polygon: list[tuple[float, float]]
    inclusion: bool = True


class CircleShape(msgspec.Struct):
    """A centre [latitude, longitude] and a radius in metres."""

    center: tuple[float, float]
    radius: float


class Circle(msgspec.Struct):
    """A circle; the vehicle stays inside if `inclusion`, else outside."""

    circle: CircleShape
    inclusion: bool = True


class GeoFence(msgspec.Struct):
    """The object ``geoFence`` of a plan, version 2."""

    polygons: list[Polygon] = []
    circles: list[Circle] = []
    breach_return: tuple[float, float, float] | None = msgspec.field(default=None, name="breachReturn")
    # This key holds a fence of version 1, which QGroundControl itself no longer reads.
    polygon: msgspec.Raw = msgspec.Raw(b"[]")


def fence_items(fence: GeoFence) -> tuple[MissionItem, ...]:
    """Return MAVLink fence items in QGroundControl's order: polygons, circles, return point."""
    if bytes(fence.polygon) not in (b"[]", b"null"):
        msg = "geoFence: a fence of version 1 is too old to be read; draw it again in QGroundControl"
        raise MissionFileError(msg)
    items = []
    for index, polygon in enumerate(fence.polygons):
        where = f"geoFence, polygon {index + 1}"
        count = len(polygon.polygon)
        if count < 3:
            raise MissionFileError(f"{where}: {count} vertices; a polygon has at least 3")
        items += [
            _place(f"{where}, vertex {i + 1}", _POLYGONS[polygon.inclusion], float(count), *vertex)
            for i, vertex in enumerate(polygon.polygon)
        ]
    for index, circle in enumerate(fence.circles):
        where = f"geoFence, circle {index + 1}"
        radius_m = circle.circle.radius
        if not radius_m > 0.0:
            raise MissionFileError(f"{where}: radius {radius_m}; give metres above 0")
        items.append(_place(where, _CIRCLES[circle.inclusion], radius_m, *circle.circle.center))
    if fence.breach_return is not None:
        items.append(
            make_item(
                "geoFence, breachReturn",
                Command.NAV_FENCE_RETURN_POINT,
                Frame.GLOBAL_RELATIVE_ALT,
                (0.0, 0.0, 0.0, 0.0),
                fence.breach_return,
                autocontinue=False,
            )
        )
    return tuple(items)


def _place(
    where: str, command: Command, first: float, latitude_deg: float, longitude_deg: float
) -> MissionItem:
    place = (latitude_deg, longitude_deg, 0.0)
    return make_item(where, command, Frame.GLOBAL, (first, 0.0, 0.0, 0.0), place, autocontinue=False)


def geo_fence(items: Sequence[MissionItem]) -> dict[str, Any]:
    """Return the object ``geoFence`` for MAVLink fence items; raises MissionFileError for other items."""
    fence: dict[str, Any] = {"circles": [], "polygons": [], "version": 2}
    index = 0
    while index < len(items):
        item = items[index]
        if item.command in POLYGON_COMMANDS:
            vertices = polygon_at(items, index)
            fence["polygons"].append(
                {
                    "inclusion": item.command == _POLYGONS[True],
                    "polygon": [[float(vertex.x), float(vertex.y)] for vertex in vertices],
                    "version": 1,
                }
            )
            index += len(vertices)
            continue
        if item.command in _CIRCLES.values():
            if item.param1 is None or not item.param1 > 0.0:
                msg = f"fence item {index + 1}: radius {item.param1}; give metres above 0 as param1"
                raise MissionFileError(msg)
            circle = {"center": [float(item.x), float(item.y)], "radius": float(item.param1)}
            fence["circles"].append(
                {"circle": circle, "inclusion": item.command == _CIRCLES[True], "version": 1}
            )
        elif item.command == Command.NAV_FENCE_RETURN_POINT:
            if "breachReturn" in fence:
                msg = f"fence item {index + 1}: a second return point; a fence has one at most"
                raise MissionFileError(msg)
            fence["breachReturn"] = [float(item.x), float(item.y), float(item.z)]
        else:
            msg = f"fence item {index + 1}: command {item.command} is not a fence command (5000 to 5004)"
            raise MissionFileError(msg)
        index += 1
    return fence


def polygon_at(items: Sequence[MissionItem], start: int) -> Sequence[MissionItem]:
    """Return the vertices of the polygon that starts at index `start` of the fence items."""
    first = items[start]
    count = first.param1 or 0.0
    if not float(count).is_integer() or count < 3.0:
        msg = f"fence item {start + 1}: param1 is {first.param1}; give the number of vertices, at least 3"
        raise MissionFileError(msg)
    vertices = items[start : start + min(int(count), len(items))]
    same = [vertex for vertex in vertices if (vertex.command, vertex.param1) == (first.command, first.param1)]
    if len(same) < int(count):
        msg = f"fence item {start + 1}: a polygon of {int(count)} vertices, but only {len(same)} are listed"
        raise MissionFileError(msg)
    return vertices
