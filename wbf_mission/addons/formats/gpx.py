"""Reads and writes GPX 1.1 (topografix.com/GPX/1/1) for GNSS receivers and map programs.

A mission that this program writes has a route with the places to fly to, and waypoints for home, fence, rally
points and other places. All other data of an item is in ``extensions``, in an element of this program's
namespace. Commands without a place are in the extensions of the route.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree

from geo.texts import parse_number
from mission.errors import MissionFileError
from mission.files.common import GPX_KIND, Firmware
from mission.model import Frame, Mission
from wbf_mission.addons.base.markup import GPX, add, decimal, document
from wbf_mission.addons.formats.drawn import Drawing, DrawnPath, Point
from wbf_mission.addons.formats.records import (
    LatLon,
    Record,
    are_ours,
    is_flown,
    mission_of,
    records_of,
    xml_texts,
)
from wbf_mission.addons.formats.xml import Node, parse

_SPACE = "urn:wbf-mission:gpx:1"
_NO_ALTITUDES = "it has no ele"


def loads(data: bytes) -> Mission | Drawing:
    """Read a mission that this program wrote, or routes and tracks; without these, waypoints form a path.

    Elevations are above mean sea level.
    """
    root = parse(data, "gpx", GPX_KIND)
    records = []
    for node in (root, *root.iter("metadata", "rte", "wpt", "rtept")):
        extensions = node.child("extensions")
        for record in () if extensions is None else extensions.children:
            if record.tag != "record":
                continue
            places: list[LatLon] = []
            if node.tag in ("wpt", "rtept"):
                point = _point(node)
                places = [(point.latitude_deg, point.longitude_deg)]
            records.append(Record(record.attributes, places, f"line {record.line}, record"))
    if are_ours(records):
        return mission_of(records)
    paths = []
    for node in root.children:
        name = node.child_text("name") or f"the {node.tag} of line {node.line}"
        if node.tag == "rte":
            paths.append(_path(name, node, "rtept"))
        elif node.tag == "trk":
            parts = [part for part in node.children if part.tag == "trkseg"]
            for number, part in enumerate(parts, 1):
                title = name if len(parts) == 1 else f"{name}, segment {number}"
                paths.append(_path(title, part, "trkpt"))
    paths = [path for path in paths if path.points]
    if not paths and root.child("wpt"):
        paths = [_path("the waypoints", root, "wpt")]
    return Drawing(paths, 0, _NO_ALTITUDES)


def _path(name: str, node: Node, tag: str) -> DrawnPath:
    return DrawnPath(name, [_point(child) for child in node.children if child.tag == tag])


def _point(node: Node) -> Point:
    where = f"line {node.line}, {node.tag}"
    latitude_deg, longitude_deg = (
        _number(node.attributes.get(name, ""), name, where) for name in ("lat", "lon")
    )
    text = node.child_text("ele")
    altitude_m = _number(text, "ele", where) if text else None
    return Point(latitude_deg, longitude_deg, altitude_m, Frame.GLOBAL, where)


def _number(text: str, name: str, where: str) -> float:
    try:
        return parse_number(text)
    except ValueError:
        raise MissionFileError(f"{where}: {name} is {text[:40]!r}; give a number") from None


def dumps(mission: Mission, firmware: Firmware = Firmware.GENERIC) -> str:  # noqa: ARG001  one signature
    """Write a mission as GPX; ``ele`` is the altitude above mean sea level, and omitted if it is unknown."""
    header, *records = records_of(mission, polygons=False)
    gpx = ElementTree.Element("gpx", GPX | {"xmlns:wbf": _SPACE})
    _extend(add(gpx, "metadata"), header.fields)
    route = ElementTree.Element("rte")
    add(route, "name", "Mission")
    for record in records:
        if not record.places:
            _extend(route, record.fields)  # GPX requires extensions before the points.
    for record in records:
        for latitude_deg, longitude_deg in record.places:
            fields = dict(record.fields)
            flown = fields["role"] == "item" and is_flown(mission.items[fields["index"]])
            place = {"lat": decimal(latitude_deg), "lon": decimal(longitude_deg)}
            point = add(route if flown else gpx, "rtept" if flown else "wpt", **place)
            frame = fields.get("frame", Frame.GLOBAL)
            if frame == Frame.GLOBAL:
                add(point, "ele", decimal(fields["altitude_m"]))
            elif frame == Frame.GLOBAL_RELATIVE_ALT and mission.home is not None:
                add(point, "ele", decimal(fields["altitude_m"] + mission.home.altitude_m))
            title = "Home" if fields["role"] == "home" else f"{fields['index']} {fields.pop('name')}"
            add(point, "name", title)
            _extend(point, fields)
    if len(route) > 1:
        gpx.append(route)
    return document(gpx)


def _extend(node: ElementTree.Element, fields: Mapping[str, Any]) -> None:
    extensions = node.find("extensions")
    if extensions is None:
        extensions = add(node, "extensions")
    add(extensions, "wbf:record", **xml_texts(fields))
