"""Reads farm files of all formats and checks them in the same way; see docs/farm-files.md."""

from __future__ import annotations

import math
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from geo.errors import FarmError
from geo.farm import MAX_CELLS, Farm, Obstacle, Patch
from geo.features import (
    DEFAULT_CROP,
    DEFAULT_OWNER,
    MAX_VERTICES,
    Document,
    Feature,
    Place,
    number_member,
    position_of,
    read_entry,
    short_line,
    shortened,
    text_member,
)
from geo.frame import LocalFrame
from geo.geojson import read_geojson
from geo.grid import CROP_NAMES, is_crop_name
from geo.imports import entry_points, load_named
from geo.texts import FOOT_M, one_line

FORMATS_GROUP = "wbf_mission.farm_formats"
"""Group of entry points, each named by a file suffix without the dot. Each is a function of a path, an
optional layer and an optional coordinate system, which returns the file's `geo.features.Document`."""
REPAIRS_GROUP = "wbf_mission.farm_repairs"
"""Group of the entry point ``mended``, a function that repairs a feature and adds notes on the repair."""
_GEOJSON = (".geojson", ".json", ".geojsonl", ".geojsons", ".ndjson", ".jsonl")
_ADDED = (".kml", ".kmz", ".shp", ".zip", ".gpkg", ".gpx", ".poly")  # The add-on `formats` reads these
_MAX_RALLY = 100
_MAX_RASTER_STEPS = 20_000_000  # Painting takes minutes if edges cross more cell columns than this.
_MAX_GAP = 2.0  # The side that closes a ring may be at most twice as long as the ring's longest side.
_MAX_SPAN_M = 20_000.0  # Features farther apart belong to several farms, or have wrong coordinates.
_SENSIBLE_CELLS = 4_000_000  # Farms with more cells get larger cells, unless the file gives the size.
_ROUND_CELLS_M = (FOOT_M, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
_MIN_CELL_M = 0.01
_MAX_CELL_M = 1000.0
_COUNT_SLACK = 1e-6  # Rounding errors may move a border by this part of a cell.
_ORIGIN_SLACK_M = 1e-3  # PROJ moves positions within 1e-10 earth radii onto the origin.
_THIN_M = 1e-3  # A polygon with a smaller ratio of area to perimeter is refused.


def load_farm(
    path: str | os.PathLike[str],
    *,
    crop: str | None = None,
    crs: str | None = None,
    repair: bool = False,
) -> Farm:
    """Read a farm from a file in GeoJSON or a format that an installed package reads (`FORMATS_GROUP`).

    Parameters
    ----------
    path : path-like
        The file; ``FILE|layername=LAYER`` reads only this layer.
    crop : str, optional
        Crop of each patch for which the file gives no crop.
    crs : str, optional
        Coordinate system, such as ``EPSG:32617``, for a file that names no coordinate system.
    repair : bool
        Whether invalid geometry is repaired where that is safe, by an add-on (`REPAIRS_GROUP`);
        `Farm.notes` lists the repairs.

    Raises
    ------
    FarmError
        If the file cannot be read, is not a farm file, or has an unusable feature, which the text names.
    """
    text = os.fspath(path)
    try:
        if crop is not None and not is_crop_name(crop):
            raise FarmError(f"{crop!r:.60} is not a crop name; {CROP_NAMES}")
        file, layer = split_layer(text)
        return _farm_of(_document(file, layer, crs), file.stem, crop, repair=repair)
    except FarmError as error:
        raise FarmError(" ".join(f"farm file {text}: {error}".split())) from None


def _document(file: Path, layer: str | None, crs: str | None) -> Document:
    suffix = file.suffix.lower()
    if suffix not in _GEOJSON and suffix in farm_suffixes():
        read = load_named(FORMATS_GROUP, suffix[1:], "reads farms in", "the farm format", FarmError)
        return read(file, layer, crs)
    if layer is not None:
        raise FarmError(f"GeoJSON has no layers; leave |{layer} out")
    return read_geojson(file, crs)


def farm_suffixes() -> tuple[str, ...]:
    """Return the suffixes of farm files: GeoJSON suffixes, then suffixes of formats that packages read.

    >>> farm_suffixes()[:2]
    ('.geojson', '.json')
    """
    return tuple(
        dict.fromkeys((*_GEOJSON, *_ADDED, *(f".{entry.name}" for entry in entry_points(FORMATS_GROUP))))
    )


def split_layer(text: str) -> tuple[Path, str | None]:
    """Split QGIS's ``FILE|layername=LAYER`` into file and layer; without a layer, None.

    >>> split_layer("farm.gpkg|layername=fields 2026"), split_layer("farm.gpkg")
    ((PosixPath('farm.gpkg'), 'fields 2026'), (PosixPath('farm.gpkg'), None))
    """
    file, bar, layer = text.rpartition("|")
    if not bar or "\0" in text or Path(text).exists():
        return Path(text), None
    return Path(file), layer.removeprefix("layername=")


def _farm_of(document: Document, default_name: str, crop: str | None, *, repair: bool) -> Farm:
    members, notes = document.members, document.notes
    name = text_member(members, "name", short_line(default_name) or "farm", "the farm")
    features, places = _contents(document, repair=repair)
    home = _home(document, places)
    features = [_closed(feature, notes) for feature in _near(features, home, notes, repair=repair)]
    if repair:
        mended = load_named(REPAIRS_GROUP, "mended", "repairs farms, as", "farms", FarmError)
        features = [part for feature in features for part in mended(feature, notes)]
    systems = dict.fromkeys(entry.crs for entry in document.entries if entry.crs is not None)
    # Each layer has its own Coordinates object; layers with equal notes get a single note.
    notes.extend(filter(None, dict.fromkeys(crs.accuracy_note() for crs in systems)))
    features = _completed(features, crop, notes)
    fields = [feature for feature in features if not feature.obstacle]
    if not fields:
        raise FarmError("has only obstacles; add a polygon for each field")
    owner = text_member(members, "owner", str(fields[0].owner), "the farm")
    frame, origin_given = _frame(document, fields)
    polygons = [(feature, _polygon(feature, frame)) for feature in features]
    patches = tuple(
        Patch(feature.name, str(feature.crop), str(feature.owner), polygon)
        for feature, polygon in polygons
        if not feature.obstacle
    )
    obstacles = tuple(
        Obstacle(polygon, feature.height_m, feature.margin_m, feature.name)
        for feature, polygon in polygons
        if feature.obstacle
    )
    bounds = shapely.total_bounds([patch.polygon for patch in patches])
    cell_size_m = _cell_size(members, bounds, notes)
    if origin_given:
        for feature, polygon in polygons:
            if not feature.obstacle and min(polygon.bounds[:2]) < -_ORIGIN_SLACK_M:
                raise FarmError(f'{feature.where}: lies partly south or west of the farm\'s "origin"')
    width, height = _size(members, bounds[2] / cell_size_m, bounds[3] / cell_size_m, cell_size_m)
    # Painting edges that cross too many columns of cells takes minutes.
    columns = (np.abs(np.diff(shapely.get_coordinates(polygon)[:, 0])).sum() for _, polygon in polygons)
    if (steps := float(sum(columns)) / cell_size_m) > _MAX_RASTER_STEPS:
        msg = f"the polygons are too detailed: their edges cross {steps:.3g} columns of cells; simplify them"
        raise FarmError(msg)
    if all(patch.owner != owner for patch in patches):
        owners = ", ".join(sorted({repr(patch.owner) for patch in patches})[:8])
        raise FarmError(f"no feature belongs to the owner {owner!r}; the owners are {owners}")
    rally = _rally(document, places, frame)
    rally_m = tuple(frame.from_wgs84(latitude_deg, longitude_deg) for longitude_deg, latitude_deg in rally)
    farm = Farm(name, frame, width, height, patches, owner, (0.0, 0.0), cell_size_m, obstacles, rally_m)
    if home is None:
        nearest = shapely.shortest_line(farm.owner_area, shapely.Point(0.0, 0.0))
        latitude_deg, longitude_deg = frame.to_wgs84(*(nearest.coords[0] if nearest else (0.0, 0.0)))
        home = longitude_deg, latitude_deg
    degrees = np.concatenate([*(ring for feature in features for ring in feature.rings), [home, *rally]])
    home_m = frame.from_wgs84(home[1], home[0])
    return replace(farm, home_m=home_m, degrees=degrees, notes=tuple(notes))


def _closed(feature: Feature, notes: list[str]) -> Feature:
    """Return a feature with closed rings; raise FarmError if part of a ring is missing.

    Many programs (DJI Pilot 2, scripts) leave out the last position, which repeats the first. A part is
    missing if the side that closes a ring is more than twice as long as the ring's longest side.
    """
    if all(np.array_equal(ring[0], ring[-1]) for ring in feature.rings):
        return feature
    rings = []
    for ring in feature.rings:
        longitude_deg, latitude_deg = np.vstack([ring, ring[:1]]).T
        frame = LocalFrame(float(latitude_deg[0]), float(longitude_deg[0]))
        steps_m = np.hypot(*np.diff(frame.from_wgs84(latitude_deg, longitude_deg), axis=1))
        gap_m, longest_m = steps_m[-1], steps_m[:-1].max()
        if gap_m > _MAX_GAP * longest_m:
            raise FarmError(
                f"{feature.where}: a ring is open over {gap_m:.1f} m, but its longest side is only "
                f"{longest_m:.1f} m long: part of the ring is missing; draw it anew"
            )
        is_open = not np.array_equal(ring[0], ring[-1])
        if is_open:
            notes.append(f"{feature.where}: an open ring was closed over {gap_m:.2f} m")
        rings.append(np.vstack([ring, ring[:1]]) if is_open else ring)
    return replace(feature, rings=tuple(rings))


def _contents(document: Document, *, repair: bool) -> tuple[list[Feature], list[Place]]:
    """Return the features and places of a file; add a note for each reason to leave out features."""
    features: list[Feature] = []
    places: list[Place] = []
    vertices = 0
    left_out: dict[tuple[str, str], list[str]] = {}
    for entry in document.entries:
        found = read_entry(entry, document.notes, repair=repair)
        if isinstance(found, str):
            called = entry.properties.get("name")
            name = called if isinstance(called, str) and called else f"feature {entry.number}"
            left_out.setdefault((entry.layer, found), []).append(name)
            continue
        places += [part for part in found if isinstance(part, Place)]
        features += [part for part in found if isinstance(part, Feature)]
        vertices += sum(len(ring) for part in found if isinstance(part, Feature) for ring in part.rings)
        if vertices > MAX_VERTICES:
            msg = f"{features[-1].where}: more than {MAX_VERTICES} vertices up to here; simplify the polygons"
            raise FarmError(msg)
    for (layer, reason), names in left_out.items():
        some = ", ".join(one_line(name, 40) for name in names[:5]) + (", ..." if len(names) > 5 else "")
        what = f"{len(names)} feature{'s' if len(names) > 1 else ''}"
        document.notes.append(f"{layer}{what} left out ({reason}): {some}")
    if not features:
        why = "; ".join(document.notes[:3])
        raise FarmError(f"holds no polygons{': ' if why else ''}{why}; draw the fields as polygons")
    return features, places


def _completed(features: list[Feature], crop: str | None, notes: list[str]) -> list[Feature]:
    """Fill in a crop or owner that no patch names; raise FarmError if only some patches name it."""
    patches = [feature for feature in features if not feature.obstacle]
    given = {"crop": crop, "owner": None}
    for key, default in (("crop", DEFAULT_CROP), ("owner", DEFAULT_OWNER)):
        without = [feature for feature in patches if getattr(feature, key) is None]
        if given[key] is None and 0 < len(without) < len(patches):
            advice = ", or give --crop for patches without a crop" if key == "crop" else ""
            raise FarmError(
                f'{without[0].where}: property "{key}" is missing; give each patch its {key}{advice}'
            )
        if given[key] is None and without:
            given[key] = default
            if key == "crop":
                notes.append(f"no patch names its crop: the crop is called {default!r}; --crop gives a name")
    return [
        replace(
            feature,
            crop=given["crop"] if feature.crop is None else feature.crop,
            owner=given["owner"] if feature.owner is None else feature.owner,
        )
        for feature in features
    ]


def _home(document: Document, places: list[Place]) -> tuple[float, float] | None:
    given = document.members.get("home")
    found = [place for place in places if place.kind == "home"]
    if len(found) + (given is not None) > 1:
        raise FarmError(f"{found[-1].where}: is a second home; give only one home")
    if found:
        return found[0].position
    return None if given is None else position_of(given, 'member "home"', document.crs)


def _cell_size(members: dict[str, Any], bounds: Any, notes: list[str]) -> float:
    """Return the file's cell size (m), by default a foot; cells are larger if there would be too many."""
    if members.get("cell_size_m") is not None or members.get("size_cells") is not None:
        return number_member(members, "cell_size_m", FOOT_M, _MIN_CELL_M, _MAX_CELL_M)
    area_m2 = float(bounds[2] * bounds[3])
    fitting = (size_m for size_m in _ROUND_CELLS_M if area_m2 <= _SENSIBLE_CELLS * size_m**2)
    size_m = next(fitting, _ROUND_CELLS_M[-1])
    if size_m != FOOT_M:
        notes.append(
            f"cells are {size_m:g} m wide; one foot would give {area_m2 / FOOT_M**2 / 1e6:.1f} million cells"
        )
    return size_m


def _rally(document: Document, places: list[Place], frame: LocalFrame) -> list[tuple[float, float]]:
    """Return longitude and latitude of each rally point in the file."""
    given = document.members.get("rally", [])
    points = [place for place in places if place.kind == "rally"]
    if not isinstance(given, list):
        raise FarmError(f'member "rally": {shortened(given)} is not a list of positions')
    if (count := len(given) + len(points)) > _MAX_RALLY:
        raise FarmError(f"has {count} rally points; give at most {_MAX_RALLY}")
    named = [(f'member "rally", entry {k}', position) for k, position in enumerate(given, 1)]
    positions = [(where, position_of(position, where, document.crs)) for where, position in named]
    positions += [(place.where, place.position) for place in points]
    for where, (longitude_deg, latitude_deg) in positions:
        if not math.hypot(*frame.from_wgs84(latitude_deg, longitude_deg)) <= 2 * _MAX_SPAN_M:
            raise FarmError(f"{where}: lies more than {2 * _MAX_SPAN_M / 1000:g} km from the farm")
    return [position for _, position in positions]


def _near(
    features: list[Feature], home: tuple[float, float] | None, notes: list[str], *, repair: bool
) -> list[Feature]:
    """Return the features if all are near `home` (default: near the first feature); else raise FarmError.

    With `repair`, latitudes and longitudes given in the wrong order are exchanged. With `repair` and without
    a home, all features must be near one reference: the feature closest to their median position.
    """
    anchor, is_sure = ('the farm\'s "home"', True) if home is not None else ("the first feature", False)
    longitude_deg, latitude_deg = features[0].rings[0][0] if home is None else home
    if home is None and repair:
        middle = np.median([feature.rings[0][0] for feature in features], axis=0)
        longitude_deg, latitude_deg = min(
            (feature.rings[0][0] for feature in features), key=lambda corner: np.hypot(*(corner - middle))
        )
        anchor = "most features"
    reference = LocalFrame(float(latitude_deg), float(longitude_deg))
    spans_m = [max(_reach_m(reference, ring[:, 1], ring[:, 0]) for ring in one.rings) for one in features]
    is_sure = is_sure or 2 * sum(span_m <= _MAX_SPAN_M for span_m in spans_m) > len(features)
    found = []
    for feature, span_m in zip(features, spans_m, strict=True):
        if span_m > _MAX_SPAN_M:
            turned_m = [_reach_m(reference, ring[:, 0], ring[:, 1]) for ring in feature.rings]
            swapped = max(turned_m) <= _MAX_SPAN_M
            if not (repair and swapped and is_sure):
                advice = (
                    "its latitude and longitude are swapped, positions are [longitude, latitude]"
                    if swapped
                    else f"the limit is {_MAX_SPAN_M / 1000:g} km"
                )
                raise FarmError(f"{feature.where}: lies {span_m / 1000:.0f} km from {anchor}; {advice}")
            feature = replace(feature, rings=tuple(ring[:, ::-1].copy() for ring in feature.rings))
            notes.append(f"{feature.where}: latitude and longitude were swapped")
        found.append(feature)
    return found


def _reach_m(frame: LocalFrame, latitude_deg: Any, longitude_deg: Any) -> float:
    if np.abs(latitude_deg).max() > 90.0:
        return math.inf
    return float(np.max(np.hypot(*frame.from_wgs84(latitude_deg, longitude_deg))))


def _frame(document: Document, patches: list[Feature]) -> tuple[LocalFrame, bool]:
    """Return the local frame, and whether the file gives the origin (default: the corner of the patches)."""
    members = document.members
    altitude_m = number_member(members, "ground_altitude_m", 0.0, -1000.0, 9000.0)
    rotation_deg = number_member(members, "rotation_deg", 0.0, -360.0, 360.0)
    if members.get("origin") is not None:
        longitude_deg, latitude_deg = position_of(members["origin"], 'member "origin"', document.crs)
        frame = LocalFrame(latitude_deg, longitude_deg, altitude_m, rotation_deg)
        if _reach_m(frame, patches[0].rings[0][:, 1], patches[0].rings[0][:, 0]) > 2 * _MAX_SPAN_M:
            limit_km = 2 * _MAX_SPAN_M / 1000
            raise FarmError(f'{patches[0].where}: lies more than {limit_km:g} km from the farm\'s "origin"')
        return frame, True
    points = np.concatenate([patch.rings[0] for patch in patches])
    frame = LocalFrame(float(points[0, 1]), float(points[0, 0]), altitude_m, rotation_deg)
    # Iterations are needed, as corner and direction of north depend on each other (meridian convergence).
    for _ in range(4):
        x_m, y_m = frame.from_wgs84(points[:, 1], points[:, 0])
        latitude_deg, longitude_deg = frame.to_wgs84(float(x_m.min()), float(y_m.min()))
        frame = LocalFrame(latitude_deg, longitude_deg, altitude_m, rotation_deg)
    return frame, False


def _polygon(feature: Feature, frame: LocalFrame) -> shapely.Polygon:
    rings = [np.column_stack(frame.from_wgs84(ring[:, 1], ring[:, 0])) for ring in feature.rings]
    polygon = shapely.Polygon(rings[0], rings[1:])
    if not shapely.is_valid(polygon):
        reason = re.sub(r"\[\S+ \S+\]", lambda at: _at(at[0], frame), shapely.is_valid_reason(polygon))
        raise FarmError(
            f"{feature.where}: the polygon is not valid: {reason}; --repair mends what is safe to mend"
        )
    if polygon.area <= _THIN_M * polygon.length:
        raise FarmError(f"{feature.where}: the polygon has no area")
    return orient(polygon)


def _at(point: str, frame: LocalFrame) -> str:
    x_m, y_m = (float(value) for value in point.strip("[]").split())
    latitude_deg, longitude_deg = frame.to_wgs84(x_m, y_m)
    return f" near [{longitude_deg:.7f}, {latitude_deg:.7f}]"


def _size(members: dict[str, Any], right: float, top: float, cell_size_m: float) -> tuple[int, int]:
    needed = (max(math.ceil(right - _COUNT_SLACK), 1), max(math.ceil(top - _COUNT_SLACK), 1))
    size = members.get("size_cells")
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
            f"a grid of {needed[0]} x {needed[1]} has more than {MAX_CELLS} cells; "
            f'set a "cell_size_m" above {cell_size_m:g}'
        )
    return needed
