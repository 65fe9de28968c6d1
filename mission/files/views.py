"""The path of a mission for viewing: KML (Google Earth) and GeoJSON (GIS); these are written, not read.

Sources: OGC KML 2.3 (12-007r2), RFC 7946.
"""

from __future__ import annotations

import itertools
from typing import Any
from xml.etree import ElementTree

import msgspec

from mission.files.common import Firmware
from mission.files.fence import polygon_at
from mission.model import Command, Frame, Mission, MissionItem

_POLYGON_COMMANDS: dict[int, str] = {
    Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION: "inclusion",
    Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION: "exclusion",
}
_ALTITUDES = {
    Frame.GLOBAL: "above mean sea level",
    Frame.GLOBAL_RELATIVE_ALT: "above home",
    Frame.GLOBAL_TERRAIN_ALT: "above terrain",
}
# Places in the list of items that the vehicle does not fly to.
_NOT_FLOWN = frozenset({Command.DO_SET_HOME, Command.DO_SET_ROI_LOCATION, Command.DO_SET_ROI, 80, 252, 611})


def _path(mission: Mission) -> list[tuple[int, MissionItem]]:
    return [
        (index, item)
        for index, item in enumerate(mission.items)
        # Some autopilots take 0, 0 as "here".
        if item.has_position and item.command not in _NOT_FLOWN and (item.x, item.y) != (0.0, 0.0)
    ]


def _name(command: int) -> str:
    return Command(command).name if command in {*Command} else f"command {command}"


def _polygons(mission: Mission) -> list[tuple[str, list[tuple[float, float]]]]:
    """Return the fence polygons as closed rings of (longitude, latitude), counterclockwise (RFC 7946)."""
    rings = []
    index = 0
    while index < len(mission.fence):
        kind = _POLYGON_COMMANDS.get(mission.fence[index].command)
        if kind is None:
            index += 1
            continue
        vertices = polygon_at(mission.fence, index)
        index += len(vertices)
        ring = [(float(vertex.y), float(vertex.x)) for vertex in vertices]
        ring.append(ring[0])
        doubled_area = sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in itertools.pairwise(ring))
        rings.append((kind, ring if doubled_area >= 0.0 else ring[::-1]))
    return rings


def geojson_dumps(mission: Mission, firmware: Firmware = Firmware.GENERIC) -> str:  # noqa: ARG001  one signature
    """Write the path, its items, home, fence polygons and rally points as a GeoJSON FeatureCollection.

    Altitudes are not in the coordinates (which RFC 7946 counts from the ellipsoid) but in the properties.
    """
    features: list[dict[str, Any]] = []

    def add(shape: str, coordinates: Any, **properties: Any) -> None:
        geometry = {"type": shape, "coordinates": coordinates}
        features.append({"type": "Feature", "geometry": geometry, "properties": properties})

    def add_point(role: str, index: int, item: MissionItem) -> None:
        add(
            "Point",
            [float(item.y), float(item.x)],
            role=role,
            index=index,
            command=item.command,
            name=_name(item.command),
            altitude_m=float(item.z),
            altitude=_ALTITUDES[Frame(item.frame)],
        )

    path = _path(mission)
    if len(path) > 1:
        add("LineString", [[float(item.y), float(item.x)] for _, item in path], role="path")
    for index, item in path:
        add_point("item", index, item)
    if (home := mission.home) is not None:
        add(
            "Point",
            [float(home.longitude_deg), float(home.latitude_deg)],
            role="home",
            altitude_m=float(home.altitude_m),
            altitude=_ALTITUDES[Frame.GLOBAL],
        )
    for kind, ring in _polygons(mission):
        add("Polygon", [ring], role="fence", kind=kind)
    for index, item in enumerate(mission.rally):
        if item.has_position:
            add_point("rally", index, item)
    collection = {"type": "FeatureCollection", "features": features}
    return msgspec.json.format(msgspec.json.encode(collection), indent=1).decode() + "\n"


def kml_dumps(mission: Mission, firmware: Firmware = Firmware.GENERIC) -> str:  # noqa: ARG001  one signature
    """Write the path, its items, home and fence polygons as KML.

    A path with different kinds of altitude is drawn on the ground.
    """
    path = _path(mission)
    frames = {item.frame for _, item in path}
    mode = _kml_mode(frames.pop()) if len(frames) == 1 else "clampToGround"
    kml = ElementTree.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = ElementTree.SubElement(kml, "Document")
    ElementTree.SubElement(document, "name").text = "Mission"
    if len(path) > 1:
        line = _placemark(document, "Path", "LineString", mode)
        line.text = " ".join(_kml_place(item) for _, item in path)
    for index, item in path:
        point = _placemark(document, f"{index} {_name(item.command)}", "Point", _kml_mode(item.frame))
        point.text = _kml_place(item)
    if (home := mission.home) is not None:
        point = _placemark(document, "Home", "Point", "clampToGround")
        point.text = f"{float(home.longitude_deg)!r},{float(home.latitude_deg)!r},{float(home.altitude_m)!r}"
    for kind, ring in _polygons(mission):
        coordinates = _placemark(document, f"Fence ({kind})", "Polygon", "clampToGround")
        coordinates.text = " ".join(f"{longitude!r},{latitude!r},0" for longitude, latitude in ring)
    ElementTree.indent(kml)
    return ElementTree.tostring(kml, encoding="unicode", xml_declaration=True) + "\n"


def _kml_mode(frame: int) -> str:
    return "absolute" if frame == Frame.GLOBAL else "relativeToGround"


def _kml_place(item: MissionItem) -> str:
    return f"{float(item.y)!r},{float(item.x)!r},{float(item.z)!r}"


def _placemark(document: ElementTree.Element, name: str, kind: str, mode: str) -> ElementTree.Element:
    """Add a placemark and return its empty coordinates element."""
    placemark = ElementTree.SubElement(document, "Placemark")
    ElementTree.SubElement(placemark, "name").text = name
    shape = ElementTree.SubElement(placemark, kind)
    ElementTree.SubElement(shape, "altitudeMode").text = mode
    if kind == "Polygon":
        boundary = ElementTree.SubElement(shape, "outerBoundaryIs")
        shape = ElementTree.SubElement(boundary, "LinearRing")
    return ElementTree.SubElement(shape, "coordinates")
