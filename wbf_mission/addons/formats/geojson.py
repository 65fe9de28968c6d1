"""Reads and writes GeoJSON (RFC 7946) for a GIS: missions of this program, and drawn lines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec

from geo.reading import json_texts
from geo.texts import is_number, one_line
from mission.errors import MissionFileError
from mission.files.common import BOM, GEOJSON_KIND, Firmware, check_json, decode_json
from mission.model import Mission
from wbf_mission.addons.base.antimeridian import cut
from wbf_mission.addons.formats.drawn import Drawing, DrawnPath, Point
from wbf_mission.addons.formats.records import (
    PATH,
    LatLon,
    Record,
    are_ours,
    is_flown,
    mission_of,
    records_of,
)

_NO_ALTITUDES = "GeoJSON has altitudes above the ellipsoid, which no autopilot uses"
_DEEPEST = 20


class _Feature(msgspec.Struct):
    type: str = ""
    properties: dict[str, Any] | None = None
    geometry: dict[str, Any] | None = None
    crs: Any = None


class _File(_Feature):
    features: list[_Feature] = []
    # A file may also be a single geometry, which has these members.
    coordinates: Any = None
    geometries: Any = None


_FILE = msgspec.json.Decoder(_File)


def loads(data: bytes) -> Mission | Drawing:
    """Read a mission that this program wrote, or lines; without lines, the points form a path.

    A farm file, and coordinates other than WGS 84 longitude and latitude, are refused.
    """
    check_json(data, GEOJSON_KIND)
    features: list[_Feature] = []
    for line, text in json_texts(data.removeprefix(BOM)):
        file = decode_json(text, _FILE, line=line)
        _check_crs("the file", file.crs)
        if file.type == "FeatureCollection":
            features += file.features
        elif file.type == "Feature":
            features.append(file)
        else:
            shape = {"type": file.type, "coordinates": file.coordinates, "geometries": file.geometries}
            features.append(_Feature("Feature", None, shape))
    for number, feature in enumerate(features, 1):
        _check_crs(f"feature {number}", feature.crs)
    records = []
    for number, feature in enumerate(features, 1):
        fields, where = feature.properties or {}, f"feature {number}"
        if isinstance(name := fields.get("name"), str):
            where = one_line(f"{where} ({name[:60]!r})")
        records.append(Record(fields, (), where))
    if are_ours(records):
        return mission_of(list(map(_placed, records, features)))
    if any("crop" in record.fields for record in records):
        raise MissionFileError(
            "this is a farm file, not a mission; plan a flight over it (wbf-mission plan --farm FILE)"
        )
    shapes = [
        (record, shape)
        for record, feature in zip(records, features, strict=True)
        for shape in _shapes(record.where, feature.geometry)
    ]
    paths = [path for record, shape in shapes for path in _paths(record, shape)]
    pins = [
        point
        for record, shape in shapes
        if shape.get("type") in ("Point", "MultiPoint")
        for point in _points(shape, record.where)
    ]
    if not paths and pins:
        paths = [DrawnPath("the points", pins)]
    areas = sum(1 for _, shape in shapes if shape.get("type") in ("Polygon", "MultiPolygon"))
    return Drawing(paths, areas, _NO_ALTITUDES)


def _check_crs(where: str, crs: Any) -> None:
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = str(properties.get("name") if isinstance(properties, dict) else crs)
    if crs is not None and not name.upper().endswith(("CRS84", "4326")):
        msg = f"{where}: crs is {name[:60]!r}, not WGS 84; convert it (ogr2ogr -t_srs EPSG:4326)"
        raise MissionFileError(one_line(msg))


def _placed(record: Record, feature: _Feature) -> Record:
    """Add the position of a feature to its record."""
    shape = feature.geometry
    if shape is None or record.role == PATH:
        return record
    kind, coordinates = shape.get("type"), shape.get("coordinates")
    if kind == "Polygon" and isinstance(coordinates, list) and len(coordinates) == 1:
        places = _places(coordinates[0], record.where)
        return Record(record.fields, places[:-1] if places[0] == places[-1] else places, record.where)
    if kind == "Point":
        return Record(record.fields, _places([coordinates], record.where), record.where)
    shown = str(kind)[:40]
    raise MissionFileError(
        f"{record.where}: the geometry is {shown!r}; give a Point, or for a fence a Polygon without holes"
    )


def _places(positions: Any, where: str) -> list[LatLon]:
    return [(point.latitude_deg, point.longitude_deg) for point in _positions(positions, where)]


def _positions(positions: Any, where: str) -> list[Point]:
    if not isinstance(positions, list) or not positions:
        raise MissionFileError(f"{where}: the geometry has no coordinates; remove it")
    made = []
    for number, position in enumerate(positions, 1):
        place = f"{where}, point {number}"
        if not isinstance(position, list) or not 2 <= len(position) <= 4 or not all(map(is_number, position)):
            shown = one_line(str(position)[:60])
            raise MissionFileError(f"{place}: {shown} is not [longitude, latitude] in degrees")
        longitude_deg, latitude_deg = float(position[0]), float(position[1])
        if abs(latitude_deg) > 90.0 >= abs(longitude_deg):
            raise MissionFileError(
                f"{place}: latitude {latitude_deg:g} is outside -90..90; the longitude comes first in GeoJSON"
            )
        made.append(Point(latitude_deg, longitude_deg, where=place))
    return made


def _shapes(where: str, geometry: Any, depth: int = 0) -> Iterator[Mapping[str, Any]]:
    if geometry is None:
        return
    if not isinstance(geometry, dict) or depth > _DEEPEST:
        raise MissionFileError(
            f"{where}: a geometry is {one_line(str(geometry)[:40])}; give an object with a type"
        )
    parts = geometry.get("geometries")
    if geometry.get("type") == "GeometryCollection" and isinstance(parts, list):
        for part in parts:
            yield from _shapes(where, part, depth + 1)
    else:
        yield geometry


def _points(shape: Mapping[str, Any], where: str) -> Sequence[Point]:
    coordinates = shape.get("coordinates")
    return _positions([coordinates] if shape.get("type") == "Point" else coordinates, where)


def _paths(record: Record, shape: Mapping[str, Any]) -> Iterator[DrawnPath]:
    name = record.fields.get("name")
    title = name if isinstance(name, str) and name else record.where
    if shape.get("type") == "LineString":
        yield DrawnPath(title, _points(shape, record.where))
    elif shape.get("type") == "MultiLineString" and isinstance(parts := shape.get("coordinates"), list):
        for number, part in enumerate(parts, 1):
            yield DrawnPath(
                title if len(parts) == 1 else f"{title}, part {number}", _positions(part, record.where)
            )


def dumps(mission: Mission, firmware: Firmware = Firmware.GENERIC) -> str:  # noqa: ARG001  one signature
    """Write a mission as a FeatureCollection: one feature per record, and a line for the path.

    Altitudes are in the properties, because by RFC 7946 altitudes in coordinates are above the ellipsoid.
    """
    header, *records = records_of(mission, polygons=True)
    path = [(item.x, item.y) for item in mission.items if is_flown(item)]
    features = [_feature(header, None)]
    if len(path) > 1:
        line = cut({"type": "LineString", "coordinates": _coordinates(path)})
        features.append(_feature(Record({"role": PATH}), line))
    for record in records:
        geometry: dict[str, Any] | None = None
        if len(record.places) == 1:
            geometry = {"type": "Point", "coordinates": _coordinates(record.places)[0]}
        elif record.places:
            ring = [*record.places, record.places[0]]
            geometry = {"type": "Polygon", "coordinates": [_coordinates(ring)]}
        features.append(_feature(record, geometry))
    collection = {"type": "FeatureCollection", "features": features}
    return msgspec.json.format(msgspec.json.encode(collection), indent=1).decode() + "\n"


def _coordinates(places: Sequence[LatLon]) -> list[list[float]]:
    return [[float(longitude_deg), float(latitude_deg)] for latitude_deg, longitude_deg in places]


def _feature(record: Record, geometry: Mapping[str, Any] | None) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": record.fields}
