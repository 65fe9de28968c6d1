"""Farm files: GeoJSON (RFC 7946) with documented properties; see docs/farm-files.md."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
import shapely
from shapely.geometry.polygon import orient

from geo.atomic import atomic_write
from geo.errors import FarmError
from geo.farm import MAX_CELLS, Farm, Obstacle, Patch
from geo.frame import LocalFrame
from geo.grid import CROP_NAMES, Crop, is_crop_name
from geo.reading import UnreadableError, not_json, read_text
from geo.units import FOOT_M

MAX_FILE_BYTES = 32 * 2**20
MAX_VERTICES = 100_000
MAX_LATITUDE_DEG = 75.0
MAX_RALLY = 100
_WGS84 = re.compile(
    r"(urn:ogc:def:crs:|https?://www\.opengis\.net/def/crs/)?"
    r"(OGC[:/]+(1\.3[:/])?CRS84|EPSG[:/]+(0[:/])?4326|WGS ?84)",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class Feature:
    """A feature as the file has it: rings of float64[n, 2] longitude, latitude."""

    where: str
    name: str
    crop: str
    owner: str
    obstacle: bool
    height_m: float | None
    margin_m: float | None
    rings: tuple[np.ndarray[Any, np.dtype[np.float64]], ...]


def read_document(path: Path) -> dict[str, Any]:
    """Return the members of a feature collection; FarmError if the file holds none."""
    try:
        text = read_text(path, MAX_FILE_BYTES)
        document = msgspec.json.decode(text)
    except UnreadableError as error:
        raise FarmError(f"cannot be read: {error}") from None
    except RecursionError:
        raise FarmError("is nested too deeply") from None
    except msgspec.DecodeError as error:
        raise FarmError(f"is not JSON ({not_json(error, text.encode())})") from None
    if not isinstance(document, dict) or document.get("type") != "FeatureCollection":
        raise FarmError('is not a GeoJSON "FeatureCollection"')
    return document


def check_crs(holder: dict[str, Any], where: str) -> None:
    """Refuse what GeoJSON of 2008 could say and RFC 7946 cannot: coordinates that are not WGS 84."""
    crs = holder.get("crs")
    if crs is None:
        return
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not (isinstance(name, str) and _WGS84.fullmatch(name.strip())):
        shown = shortened(name if isinstance(name, str) else crs)
        raise FarmError(
            f'{where}: member "crs" is {shown!r}, but a farm file holds longitudes and latitudes of WGS 84: '
            "convert it (ogr2ogr -t_srs EPSG:4326)"
        )


def read_feature(entry: object, index: int) -> Feature:
    """Return a member of "features"; FarmError, naming it, if it is no patch and no obstacle."""
    where = f"feature {index + 1}"
    if not isinstance(entry, dict) or entry.get("type") != "Feature":
        raise FarmError(f'{where}: is not a GeoJSON "Feature"')
    properties = entry.get("properties")
    if not isinstance(properties, dict):
        raise FarmError(f'{where}: has no "properties" with crop and owner')
    name = text_member(properties, "name", f"patch {index}", where)
    where = f"feature {index + 1} ({name!r})"
    check_crs(entry, where)
    obstacle = properties.get("obstacle", False)
    if not isinstance(obstacle, bool):
        raise FarmError(f'{where}: property "obstacle" is not true or false')
    no_fly = properties.get("no_fly", False)
    if not isinstance(no_fly, bool):
        raise FarmError(f'{where}: property "no_fly" is not true or false')
    height_m = number_member(properties, "height_m", None, 0.0, 1000.0, f"{where}: property")
    margin_m = number_member(properties, "margin_m", None, 0.0, 1000.0, f"{where}: property")
    if no_fly and height_m is not None:
        raise FarmError(f'{where}: is a no-fly zone, of any height; leave "height_m" out, or "no_fly"')
    obstacle = obstacle or no_fly
    crop, owner = str(Crop.NONE), ""
    if not obstacle:
        for key in ("crop", "owner"):
            if properties.get(key) is None:
                raise FarmError(f'{where}: property "{key}" is missing')
        crop = text_member(properties, "crop", "", where).lower()
        if not is_crop_name(crop):
            raise FarmError(f"{where}: {crop!r} is no name of a crop; {CROP_NAMES}")
        owner = text_member(properties, "owner", "", where)
    geometry = entry.get("geometry")
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if not isinstance(geometry, dict) or kind != "Polygon":
        kind = kind if isinstance(kind, str) else "nothing"
        advice = "; make each part a feature of its own" if kind == "MultiPolygon" else ""
        raise FarmError(f"{where}: geometry is {shortened(kind)!r}, not a Polygon{advice}")
    check_crs(geometry, where)
    rings = geometry.get("coordinates")
    if not isinstance(rings, list) or not rings or not rings[0]:
        raise FarmError(f"{where}: the polygon is empty")
    shape = tuple(_ring(ring, where) for ring in rings)
    return Feature(where, name, crop, owner, obstacle, height_m, margin_m, shape)


def _ring(ring: object, where: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    if not isinstance(ring, list) or len(ring) < 4:
        raise FarmError(f"{where}: a ring has fewer than four positions")
    if len(ring) > MAX_VERTICES:
        msg = f"{where}: a ring of {len(ring)} positions is longer than {MAX_VERTICES}; simplify it"
        raise FarmError(msg)
    positions = np.array([position_of(position, where) for position in ring])
    if not np.array_equal(positions[0], positions[-1]):
        raise FarmError(f"{where}: a ring is not closed (its last position must repeat the first)")
    return positions


def position_of(position: object, where: str) -> tuple[float, float]:
    """Return longitude and latitude of a GeoJSON position."""
    if (
        not isinstance(position, list)
        or not 2 <= len(position) <= 4
        or not all(type(value) in (int, float) and abs(value) < 1e300 for value in position)
    ):
        msg = f"{where}: {shortened(position)} is not a position [longitude, latitude] of finite numbers"
        raise FarmError(msg)
    longitude_deg, latitude_deg = float(position[0]), float(position[1])
    if abs(latitude_deg) > 90.0:
        msg = f"{where}: latitude {latitude_deg:g} is outside -90..90; positions are [longitude, latitude]"
        raise FarmError(msg)
    if abs(longitude_deg) > 180.0:
        raise FarmError(f"{where}: longitude {longitude_deg:g} is outside -180..180")
    if abs(latitude_deg) > MAX_LATITUDE_DEG:
        raise FarmError(
            f"{where}: nothing grows at latitude {latitude_deg:g}; "
            "are latitude and longitude swapped? positions are [longitude, latitude]"
        )
    return longitude_deg, latitude_deg


def text_member(members: dict[str, Any], key: str, default: str, where: str) -> str:
    """Return a member that is a short line of text, its default if it is missing, or raise FarmError."""
    value = members.get(key)
    if value is None:
        return default
    if not isinstance(value, str) or not value.strip() or len(value) > 200 or not value.isprintable():
        raise FarmError(f'{where}: "{key}" is {shortened(value)}, not a short line of text')
    return value.strip()


T = TypeVar("T", float, None)


def number_member(
    members: dict[str, Any], key: str, default: T, low: float, high: float, what: str = "member"
) -> float | T:
    """Return a member that is a number in low..high, its default if it is missing, or raise FarmError."""
    value = members.get(key)
    if value is None:
        return default
    if type(value) not in (int, float) or not low <= value <= high:
        raise FarmError(f'{what} "{key}": {shortened(value)} is not a number in {low:g}..{high:g}')
    return float(value)


def shortened(value: object) -> str:
    """Return a value as an error shows it."""
    text = value if isinstance(value, str) else repr(value)[:200]
    return text if len(text) <= 60 else text[:57] + "..."


MAX_RASTER_STEPS = 20_000_000
MAX_SPAN_M = 20_000.0
_MIN_CELL_M = 0.01
_MAX_CELL_M = 1000.0
_COUNT_SLACK = 1e-6
_THIN_M = 1e-3


def load_farm(path: str | os.PathLike[str]) -> Farm:
    """Read a farm from a GeoJSON file.

    Raises
    ------
    FarmError
        If the file cannot be read, is no farm file, or a feature cannot be used; the text names the feature.
    """
    text = os.fspath(path)
    try:
        return _farm_of(read_document(Path(text)), default_name=Path(text).stem)
    except FarmError as error:
        msg = f"farm file {text}: {error}"
        raise FarmError(" ".join(msg.split())) from None


def save_farm(farm: Farm, path: str | os.PathLike[str]) -> None:
    """Write a farm as a GeoJSON file that `load_farm` reads back; the file appears whole or not at all.

    Raises
    ------
    FarmError
        If the file cannot be written.
    """
    frame = farm.frame
    patches = [
        _feature(farm, patch.polygon, name=patch.name, crop=str(patch.crop), owner=patch.owner)
        for patch in farm.patches
    ]
    obstacles = [
        _feature(
            farm,
            one.polygon,
            name=one.name or f"obstacle {number}",
            obstacle=True,
            **({} if one.height_m is None else {"height_m": one.height_m}),
            **({} if one.margin_m is None else {"margin_m": one.margin_m}),
        )
        for number, one in enumerate(farm.obstacles, 1)
    ]
    document = {
        "type": "FeatureCollection",
        "name": farm.name,
        "owner": farm.owner,
        "cell_size_m": farm.cell_size_m,
        "origin": [frame.longitude_deg, frame.latitude_deg],
        "ground_altitude_m": frame.altitude_m,
        "rotation_deg": frame.rotation_deg,
        "size_cells": [farm.width_cells, farm.height_cells],
        "home": _position(frame, farm.home_m),
        **({"rally": [_position(frame, place) for place in farm.rally_m]} if farm.rally_m else {}),
        "features": patches + obstacles,
    }
    try:
        with atomic_write(path, "wb") as file:
            file.write(msgspec.json.format(msgspec.json.encode(document), indent=1))
    except (OSError, ValueError) as error:
        msg = f"farm file {os.fspath(path)}: cannot be written ({getattr(error, 'strerror', None) or error})"
        raise FarmError(msg) from None


def _position(frame: LocalFrame, place_m: tuple[float, float]) -> list[float]:
    latitude_deg, longitude_deg = frame.to_wgs84(*place_m)
    return [longitude_deg, latitude_deg]


def _feature(farm: Farm, polygon: shapely.Polygon, **properties: object) -> dict[str, object]:
    rings = []
    # Right-hand rule of RFC 7946: the exterior anticlockwise, holes clockwise.
    oriented = orient(polygon)
    for ring in (oriented.exterior, *oriented.interiors):
        xy = shapely.get_coordinates(ring)
        latitude_deg, longitude_deg = farm.frame.to_wgs84(xy[:, 0].copy(), xy[:, 1].copy())
        rings.append(np.column_stack([longitude_deg, latitude_deg]).tolist())
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": "Polygon", "coordinates": rings},
    }


def _farm_of(document: dict[str, Any], default_name: str) -> Farm:
    check_crs(document, "the file")
    name = text_member(document, "name", default_name, "the farm")
    raw = document.get("features")
    if not isinstance(raw, list) or not raw:
        raise FarmError('has no "features"')
    features = []
    vertices = 0
    for index, entry in enumerate(raw):
        features.append(read_feature(entry, index))
        vertices += sum(len(ring) for ring in features[-1].rings)
        if vertices > MAX_VERTICES:
            msg = f"{features[-1].where}: more than {MAX_VERTICES} vertices up to here; simplify the polygons"
            raise FarmError(msg)
    patches = [feature for feature in features if not feature.obstacle]
    if not patches:
        raise FarmError("has obstacles only, no patch with a crop")
    owner = text_member(document, "owner", patches[0].owner, "the farm")
    cell_size_m = number_member(document, "cell_size_m", FOOT_M, _MIN_CELL_M, _MAX_CELL_M)
    home = position_of(document["home"], 'member "home"') if document.get("home") is not None else None
    _check_span(features, home)
    frame, origin_given = _frame(document, patches)
    polygons = [_polygon(feature, frame) for feature in features]
    bounds = shapely.total_bounds(
        [polygon for feature, polygon in zip(features, polygons, strict=True) if not feature.obstacle]
    )
    if origin_given:
        for feature, polygon in zip(features, polygons, strict=True):
            if not feature.obstacle and min(polygon.bounds[:2]) < -_COUNT_SLACK * cell_size_m:
                msg = f'{feature.where}: reaches beyond the farm\'s "origin" to the south or west of the grid'
                raise FarmError(msg)
    width, height = _size(document, bounds[2] / cell_size_m, bounds[3] / cell_size_m, cell_size_m)
    _check_detail(polygons, cell_size_m)
    kept = tuple(
        Patch(feature.name, feature.crop, feature.owner, polygon)
        for feature, polygon in zip(features, polygons, strict=True)
        if not feature.obstacle
    )
    if all(patch.owner != owner for patch in kept):
        owners = ", ".join(sorted({repr(patch.owner) for patch in kept})[:8])
        raise FarmError(f"no feature belongs to the owner {owner!r}; the owners are {owners}")
    obstacles = tuple(
        Obstacle(polygon, feature.height_m, feature.margin_m, feature.name)
        for feature, polygon in zip(features, polygons, strict=True)
        if feature.obstacle
    )
    rally_m = _rally(document, frame)
    farm = Farm(name, frame, width, height, kept, owner, (0.0, 0.0), cell_size_m, obstacles, rally_m)
    if home is not None:
        home_m = frame.from_wgs84(home[1], home[0])
    else:
        nearest = shapely.shortest_line(farm.owner_area, shapely.Point(0.0, 0.0))
        home_m = (float(nearest.coords[0][0]), float(nearest.coords[0][1])) if nearest else (0.0, 0.0)
    return replace(farm, home_m=home_m)


def _rally(document: dict[str, Any], frame: LocalFrame) -> tuple[tuple[float, float], ...]:
    """Return the rally points, in metres of the farm's frame."""
    given = document.get("rally", [])
    if not isinstance(given, list) or len(given) > MAX_RALLY:
        msg = f'member "rally": {shortened(given)} is no list of at most {MAX_RALLY} positions'
        raise FarmError(msg)
    places = [position_of(one, f'member "rally", entry {k}') for k, one in enumerate(given, 1)]
    rally_m = tuple(frame.from_wgs84(latitude, longitude) for longitude, latitude in places)
    for number, place_m in enumerate(rally_m, 1):
        if not math.hypot(*place_m) <= 2 * MAX_SPAN_M:
            msg = f'member "rally", entry {number}: lies more than {2 * MAX_SPAN_M / 1000:g} km from the farm'
            raise FarmError(msg)
    return rally_m


def _check_span(features: list[Feature], home: tuple[float, float] | None) -> None:
    """Refuse positions too far from home, or else from the first feature."""
    longitude_deg, latitude_deg = home if home is not None else features[0].rings[0][0]
    reference = LocalFrame(float(latitude_deg), float(longitude_deg))
    anchor = 'the farm\'s "home"' if home is not None else "the first feature"
    for feature in features:
        for ring in feature.rings:
            span_m = _reach_m(reference, ring[:, 1], ring[:, 0])
            if span_m <= MAX_SPAN_M:
                continue
            swapped = _reach_m(reference, ring[:, 0], ring[:, 1]) <= MAX_SPAN_M
            advice = (
                "its latitude and longitude are swapped, positions are [longitude, latitude]"
                if swapped
                else f"the limit is {MAX_SPAN_M / 1000:g} km"
            )
            raise FarmError(f"{feature.where}: lies {span_m / 1000:.0f} km from {anchor}; {advice}")


def _reach_m(frame: LocalFrame, latitude_deg: Any, longitude_deg: Any) -> float:
    if np.abs(latitude_deg).max() > 90.0:
        return math.inf
    x_m, y_m = frame.from_wgs84(latitude_deg.copy(), longitude_deg.copy())
    return float(np.max(np.hypot(x_m, y_m)))


def _frame(document: dict[str, Any], patches: list[Feature]) -> tuple[LocalFrame, bool]:
    """Return the frame, and whether the file gives its origin (otherwise it is the corner of the patches)."""
    altitude_m = number_member(document, "ground_altitude_m", 0.0, -1000.0, 9000.0)
    rotation_deg = number_member(document, "rotation_deg", 0.0, -360.0, 360.0)
    if document.get("origin") is not None:
        longitude_deg, latitude_deg = position_of(document["origin"], 'member "origin"')
        frame = LocalFrame(latitude_deg, longitude_deg, altitude_m, rotation_deg)
        if _reach_m(frame, patches[0].rings[0][:, 1], patches[0].rings[0][:, 0]) > 2 * MAX_SPAN_M:
            msg = f'{patches[0].where}: lies more than {2 * MAX_SPAN_M / 1000:g} km from the farm\'s "origin"'
            raise FarmError(msg)
        return frame, True
    points = np.concatenate([patch.rings[0] for patch in patches])
    frame = LocalFrame(float(points[0, 1]), float(points[0, 0]), altitude_m, rotation_deg)
    # North turns with the origin (meridian convergence), so the corner is sought again from each better one.
    for _ in range(4):
        x_m, y_m = frame.from_wgs84(points[:, 1].copy(), points[:, 0].copy())
        latitude_deg, longitude_deg = frame.to_wgs84(float(x_m.min()), float(y_m.min()))
        frame = LocalFrame(latitude_deg, longitude_deg, altitude_m, rotation_deg)
    return frame, False


def _polygon(feature: Feature, frame: LocalFrame) -> shapely.Polygon:
    rings = []
    for ring in feature.rings:
        x_m, y_m = frame.from_wgs84(ring[:, 1].copy(), ring[:, 0].copy())
        rings.append(np.column_stack([x_m, y_m]))
    polygon = shapely.Polygon(rings[0], rings[1:])
    if not shapely.is_valid(polygon):
        reason = re.sub(
            r"\[\S+ \S+\]", lambda match: _at(match.group(), frame), shapely.is_valid_reason(polygon)
        )
        raise FarmError(f"{feature.where}: the polygon is not valid: {reason}")
    if polygon.area <= _THIN_M * polygon.length:
        raise FarmError(f"{feature.where}: the polygon has no area")
    return polygon


def _at(point: str, frame: LocalFrame) -> str:
    x_m, y_m = (float(value) for value in point.strip("[]").split())
    latitude_deg, longitude_deg = frame.to_wgs84(x_m, y_m)
    return f" near [{longitude_deg:.7f}, {latitude_deg:.7f}]"


def _size(document: dict[str, Any], right: float, top: float, cell_size_m: float) -> tuple[int, int]:
    needed = (max(math.ceil(right - _COUNT_SLACK), 1), max(math.ceil(top - _COUNT_SLACK), 1))
    size = document.get("size_cells")
    if size is not None:
        if not (
            isinstance(size, list)
            and len(size) == 2
            and all(type(value) is int and 0 < value <= MAX_CELLS for value in size)
        ):
            raise FarmError(f'member "size_cells": {shortened(size)} is not a usable [width, height]')
        wanted = f"{needed[0]} x {needed[1]}"
        if size[0] < needed[0] or size[1] < needed[1]:
            msg = f'member "size_cells": {size[0]} x {size[1]} is less than the patches need ({wanted})'
            raise FarmError(msg)
        needed = (size[0], size[1])
    if needed[0] * needed[1] > MAX_CELLS:
        raise FarmError(
            f"a grid of {needed[0]} x {needed[1]} cells is larger than {MAX_CELLS}; "
            f'set a "cell_size_m" above {cell_size_m:g}'
        )
    return needed


def _check_detail(polygons: list[shapely.Polygon], cell_size_m: float) -> None:
    """Refuse polygons whose scan conversion would take minutes: very many edges across very many columns."""
    steps = 0.0
    for polygon in polygons:
        x = shapely.get_coordinates(polygon)[:, 0]
        steps += float(np.abs(np.diff(x)).sum()) / cell_size_m
    if steps > MAX_RASTER_STEPS:
        msg = f"the polygons are too detailed: their edges cross {steps:.3g} columns of cells; simplify them"
        raise FarmError(msg)
