"""Reads and writes KML and KMZ (zipped KML): missions of this program, and paths drawn in Google Earth.

Sources: OGC KML 2.3 (12-007r2); developers.google.com/kml/documentation/kmlreference (gx:Track, KMZ).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

from geo.texts import parse_number
from mission.errors import MissionFileError
from mission.files.common import KML_KIND, KMZ_KIND, MAX_BYTES, Firmware, WithNotes, kind_of, wrong_kind
from mission.model import Frame, Mission
from wbf_mission.addons.base.archive import Archive, ArchiveError, archive_of
from wbf_mission.addons.base.markup import add, decimal, document
from wbf_mission.addons.formats.drawn import Drawing, DrawnPath, Point
from wbf_mission.addons.formats.records import (
    PATH,
    LatLon,
    Record,
    are_ours,
    is_flown,
    mission_of,
    records_of,
    xml_texts,
)
from wbf_mission.addons.formats.xml import Node, parse

_LINES = ("LineString", "LinearRing", "Track")
_FRAMES = {"absolute": Frame.GLOBAL, "relativeToGround": Frame.GLOBAL_RELATIVE_ALT}
_NO_ALTITUDES = "the path lies on the ground: altitudeMode is clampToGround"


def loads(data: bytes) -> Mission | Drawing:
    """Read a mission that this program wrote, or lines and tracks; without these, points form a path."""
    root = parse(data, "kml", KML_KIND)
    header = [node for node in root.children if node.tag == "Document"]
    records = [Record(fields, (), f"line {node.line}") for node in header if (fields := _fields(node))]
    marks = list(root.iter("Placemark"))
    for node in marks:
        fields = _fields(node)
        record = Record(fields, (), _where(node))
        records.append(_placed(record, node) if record.role not in ("", PATH) else record)
    if are_ours(records):
        return mission_of(records)
    paths = [path for node in marks for path in _paths(node)]
    pins = [point for node in marks for shape in node.iter("Point") for point in _points(shape, _where(node))]
    if not paths and pins:
        paths = [DrawnPath("the placemarks", pins)]
    areas = sum(1 for node in marks for _ in node.iter("Polygon"))
    return Drawing(paths, areas, _NO_ALTITUDES)


def _where(node: Node) -> str:
    name = node.child_text("name")
    return f"line {node.line}, placemark {name[:60]!r}" if name else f"line {node.line}, placemark"


def _fields(node: Node) -> dict[str, str]:
    """Return the data of a feature by name, in the form of this program or of GDAL (SchemaData)."""
    extended = node.child("ExtendedData")
    if extended is None:
        return {}
    return {
        data.attributes.get("name", ""): data.child_text("value") if data.tag == "Data" else data.text
        for data in extended.iter("Data", "SimpleData")
    }


def _placed(record: Record, node: Node) -> Record:
    """Add the position of a placemark to its record."""
    shapes = list(node.iter("Point", "Polygon"))
    if not shapes:
        return record
    if len(shapes) > 1:
        raise MissionFileError(f"{record.where}: {len(shapes)} shapes; give one")
    shape = next(shapes[0].iter("LinearRing"), shapes[0])
    points = _points(shape, record.where)
    places: list[LatLon] = [(point.latitude_deg, point.longitude_deg) for point in points]
    if shapes[0].tag == "Point":
        altitude_m = points[0].altitude_m if points else None
        return Record(dict(record.fields) | {"altitude_m": altitude_m}, places, record.where)
    return Record(record.fields, places[:-1] if places[0] == places[-1] else places, record.where)


def _paths(node: Node) -> list[DrawnPath]:
    boundaries = {id(ring) for polygon in node.iter("Polygon") for ring in polygon.iter("LinearRing")}
    lines = [shape for shape in node.iter(*_LINES) if id(shape) not in boundaries]
    name = node.child_text("name") or f"the placemark of line {node.line}"
    outer = {id(track): several for several in node.iter("MultiTrack") for track in several.iter("Track")}
    parts = [_points(shape, "", outer.get(id(shape), shape).child_text("altitudeMode")) for shape in lines]
    if len(parts) == 1:
        return [DrawnPath(name, parts[0])]
    return [DrawnPath(f"{name}, part {k}", points) for k, points in enumerate(parts, 1)]


def _points(shape: Node, where: str, outer_mode: str = "") -> list[Point]:
    frame = _FRAMES.get(shape.child_text("altitudeMode") or outer_mode)
    made = []
    for number, text in enumerate(_tuples(shape), 1):
        place = f"{where or f'line {shape.line}'}, point {number}"
        longitude_deg, latitude_deg, *more = _numbers(text, place)
        if abs(latitude_deg) > 90.0 >= abs(longitude_deg):
            raise MissionFileError(
                f"{place}: latitude {latitude_deg:g} is outside -90..90; the longitude comes first in KML"
            )
        made.append(Point(latitude_deg, longitude_deg, more[0] if more else None, frame, place))
    if not made:
        raise MissionFileError(
            f"{where or f'line {shape.line}'}: the {shape.tag} has no coordinates; remove it"
        )
    return made


def _tuples(shape: Node) -> Iterator[str]:
    if shape.tag == "Track":
        return (",".join(child.text.split()) for child in shape.children if child.tag == "coord")
    return iter(re.sub(r"\s*,\s*", ",", shape.child_text("coordinates")).split())


def _numbers(text: str, where: str) -> list[float]:
    try:
        numbers = [parse_number(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not 2 <= len(numbers) <= 3:
        raise MissionFileError(
            f"{where}: {text[:40]!r} is not longitude,latitude,altitude in degrees and metres"
        )
    return numbers


def dumps(mission: Mission, firmware: Firmware = Firmware.GENERIC) -> str:  # noqa: ARG001  one signature
    """Write a mission as KML: one placemark per item, with all its fields as data, and a line for the path.

    If the path's items have several altitude modes, the line is drawn on the ground.
    """
    kml = ElementTree.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    top = add(kml, "Document")
    add(top, "name", "Mission")
    header, *records = records_of(mission, polygons=True)
    _add_data(top, header.fields)
    path = [item for item in mission.items if is_flown(item)]
    if len(path) > 1:
        frames = {item.frame for item in path}
        mark = add(top, "Placemark")
        add(mark, "name", "Path")
        _add_data(mark, {"role": PATH})
        line = add(mark, "LineString")
        add(line, "altitudeMode", _mode(frames.pop()) if len(frames) == 1 else "clampToGround")
        add(line, "coordinates", " ".join(_place((item.x, item.y), item.z) for item in path))
    for record in records:
        fields = dict(record.fields)
        mark = add(top, "Placemark")
        add(mark, "name", _title(fields))
        altitude_m = (
            fields.get("altitude_m", 0.0) if len(record.places) > 1 else fields.pop("altitude_m", 0.0)
        )
        _add_data(mark, fields)
        if not record.places:
            continue
        if len(record.places) == 1:
            shape = add(mark, "Point")
            add(shape, "altitudeMode", _mode(fields.get("frame", Frame.GLOBAL)))
        else:
            polygon = add(mark, "Polygon")
            add(polygon, "altitudeMode", "clampToGround")
            shape = add(add(polygon, "outerBoundaryIs"), "LinearRing")
        ring = [*record.places, record.places[0]] if len(record.places) > 1 else record.places
        add(shape, "coordinates", " ".join(_place(place, altitude_m) for place in ring))
    return document(kml)


def _mode(frame: int) -> str:
    return "absolute" if frame == Frame.GLOBAL else "relativeToGround"


def _place(place: LatLon, altitude_m: float) -> str:
    return f"{decimal(place[1])},{decimal(place[0])},{decimal(altitude_m)}"


def _title(fields: dict[str, Any]) -> str:
    if fields["role"] == "home":
        return "Home"
    title = f"{fields['index']} {fields.pop('name')}"
    return title if fields["role"] == "item" else f"{str(fields['role']).capitalize()} {title}"


def _add_data(parent: ElementTree.Element, fields: Mapping[str, Any]) -> None:
    extended = add(parent, "ExtendedData")
    for name, text in xml_texts(fields).items():
        add(add(extended, "Data", name=name), "value", text)


def kmz_loads(data: bytes) -> Mission | WithNotes | Drawing:
    """Read the main .kml file of a KMZ archive."""
    if kind_of(data) != KMZ_KIND:
        raise wrong_kind(data, "a KMZ archive")
    try:
        with Archive(data, MAX_BYTES) as archive:
            if any(name.lower().endswith(".wpml") for name in archive.names):
                raise MissionFileError(
                    "this is a DJI wayline file (WPML), which can be written, but not read; give another"
                    " format, or plan a flight over its mapping area (wbf-mission plan --farm FILE)"
                )
            mains, note = archive.kml()
            if not mains:
                raise MissionFileError("the archive has no .kml file; give a KMZ of Google Earth")
            content = archive.read(mains[0])
    except ArchiveError as error:
        raise MissionFileError(f"the archive {error}") from None
    try:
        made = loads(content)
    except MissionFileError as error:
        raise MissionFileError(f"{mains[0]}: {error}") from None
    if not note:
        return made
    return WithNotes(made, (note,)) if isinstance(made, Mission) else replace(made, notes=(note,))


def kmz_dumps(mission: Mission, firmware: Firmware = Firmware.GENERIC) -> bytes:
    """Write a mission as KMZ: an archive with doc.kml."""
    return archive_of({"doc.kml": dumps(mission, firmware)})
