"""Reads and writes farm files in GeoJSON (RFC 7946); see docs/farm-files.md.

A file holds a feature collection, a feature or a geometry, or several of these, one per line or divided by
record separators (RFC 8142; GDAL's GeoJSONSeq, ``.geojsonl``).
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import shapely
from shapely.geometry.polygon import orient

from geo.atomic import atomic_write
from geo.errors import FarmError
from geo.farm import Farm
from geo.features import GEOMETRIES, MAX_FEATURES, Document, Entry, shortened
from geo.frame import EXAMPLE_CRS, Coordinates, coordinates_of
from geo.reading import UnreadableError, json_texts, not_json, read_text

MAX_FILE_BYTES = 32 * 2**20  # This is enough for MAX_VERTICES vertices and their properties


def read_geojson(path: Path, crs: str | None = None) -> Document:
    """Return the content of a GeoJSON file; `crs` names the coordinate system if the file does not.

    Raise FarmError if the file is no GeoJSON, or both the file and `crs` give a coordinate system.
    """
    given = None if crs is None else coordinates_of(crs)
    members: dict[str, Any] = {}
    entries: list[Entry] = []
    own = None
    for document in _documents(path):
        if crs is not None and document.get("crs") is not None:
            raise FarmError(f"names a coordinate system; do not give {crs!r:.60}, too")
        features = _features(document)
        own = given if features is None else _crs(document, "the file", given)
        if features is not None:
            members = {**document, **members}
        is_geometry = document["type"] in GEOMETRIES
        found = features or [{"type": "Feature", "geometry": document} if is_geometry else document]
        if len(entries) + len(found) > MAX_FEATURES:
            raise FarmError(f"has more than {MAX_FEATURES} features; take only the features of one farm")
        entries += [_entry(feature, number, own) for number, feature in enumerate(found, len(entries) + 1)]
    return Document(members, entries, own)


def _features(document: dict[str, Any]) -> list[Any] | None:
    """Take the features out of a collection; return None if the document is not a feature collection."""
    if document.get("type") != "FeatureCollection":
        return None
    features = document.pop("features", None)
    if not isinstance(features, list) or not features:
        raise FarmError('has no "features"')
    return features


def _entry(feature: Any, number: int, own: Coordinates | None) -> Entry:
    where = f"feature {number}"
    if not isinstance(feature, dict) or feature.get("type") != "Feature":
        raise FarmError(f'{where}: is not a GeoJSON "Feature"')
    properties = feature.get("properties")
    if not isinstance(properties, dict | None):
        raise FarmError(f'{where}: its "properties" are {shortened(properties)}, not an object')
    if "geometry" not in feature:
        raise FarmError(f'{where}: has no "geometry"; write null for a feature without geometry')
    properties = properties or {}
    name = properties.get("name")
    named = f"{where} ({name!r:.60})" if isinstance(name, str) else where
    crs, geometry = _crs(feature, named, own), feature["geometry"]
    if isinstance(geometry, dict):
        crs = _crs(geometry, named, crs)
    return Entry(number, properties, geometry, crs)


def _crs(holder: dict[str, Any], where: str, default: Coordinates | None) -> Coordinates | None:
    """Return the coordinate system of the member "crs" (GeoJSON 2008, not RFC 7946), or else `default`."""
    crs = holder.get("crs")
    if crs is None:
        return default
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str):
        raise FarmError(
            f'{where}: member "crs" names no coordinate system; give {{"type": "name", "properties": '
            f'{{"name": "{EXAMPLE_CRS}"}}}}, or leave it out for WGS 84'
        )
    try:
        return coordinates_of(name)
    except FarmError as error:
        raise FarmError(f'{where}: member "crs": {error}') from None


def _documents(path: Path) -> Iterator[dict[str, Any]]:
    try:
        data = read_text(path, MAX_FILE_BYTES).encode()
    except UnreadableError as error:
        raise FarmError(f"cannot be read: {error}") from None
    for line, text in json_texts(data):
        try:
            document = msgspec.json.decode(text)
        except RecursionError:
            raise FarmError("is nested too deeply") from None
        except msgspec.DecodeError as error:
            raise FarmError(f"is not JSON ({not_json(error, text, line)})") from None
        if not isinstance(document, dict) or document.get("type") not in (
            "FeatureCollection",
            "Feature",
            *GEOMETRIES,
        ):
            raise FarmError('is not a GeoJSON "FeatureCollection", "Feature" or geometry')
        yield document


def save_farm(farm: Farm, path: str | os.PathLike[str], document: dict[str, Any] | None = None) -> None:
    """Write a farm atomically as a GeoJSON file that `load_farm` reads back.

    `document` replaces its `farm_document`. Raise FarmError if the file cannot be written.
    """
    try:
        with atomic_write(path, "wb") as file:
            file.write(msgspec.json.format(msgspec.json.encode(document or farm_document(farm)), indent=1))
    except (OSError, ValueError) as error:
        msg = f"farm file {os.fspath(path)}: cannot be written ({getattr(error, 'strerror', None) or error})"
        raise FarmError(msg) from None


def farm_document(farm: Farm) -> dict[str, Any]:
    """Return the GeoJSON document that `save_farm` writes."""
    frame, degrees_of = farm.frame, _DegreesOf(farm)
    patches = [
        _feature(degrees_of, patch.polygon, name=patch.name, crop=str(patch.crop), owner=patch.owner)
        for patch in farm.patches
    ]
    obstacles = [
        _feature(
            degrees_of,
            obstacle.polygon,
            name=obstacle.name or f"obstacle {number}",
            obstacle=True,
            **({} if obstacle.height_m is None else {"height_m": obstacle.height_m}),
            **({} if obstacle.margin_m is None else {"margin_m": obstacle.margin_m}),
        )
        for number, obstacle in enumerate(farm.obstacles, 1)
    ]
    return {
        "type": "FeatureCollection",
        "name": farm.name,
        "owner": farm.owner,
        "cell_size_m": farm.cell_size_m,
        "origin": [frame.longitude_deg, frame.latitude_deg],
        "ground_altitude_m": frame.altitude_m,
        "rotation_deg": frame.rotation_deg,
        "size_cells": [farm.width_cells, farm.height_cells],
        "home": degrees_of(farm.home_m)[0],
        **({"rally": degrees_of(*farm.rally_m)} if farm.rally_m else {}),
        "features": patches + obstacles,
    }


class _DegreesOf:
    """Converts a farm's points to degrees; points read from the farm's file get their original degrees.

    Converting a point to metres and back moves it by a nanometre, which can change a planner's choice.
    """

    def __init__(self, farm: Farm) -> None:
        self._frame = farm.frame
        known = farm.degrees
        x_m, y_m = self._frame.from_wgs84(known[:, 1], known[:, 0])
        self._known = dict(zip(zip(x_m.tolist(), y_m.tolist(), strict=True), known.tolist(), strict=True))

    def __call__(self, *places_m: Sequence[float]) -> list[list[float]]:
        places = np.array(places_m)
        latitude_deg, longitude_deg = self._frame.to_wgs84(places[:, 0], places[:, 1])
        made = np.column_stack([longitude_deg, latitude_deg]).tolist()
        return [self._known.get((x, y), new) for (x, y), new in zip(places.tolist(), made, strict=True)]


def _feature(degrees_of: _DegreesOf, polygon: shapely.Polygon, **properties: object) -> dict[str, object]:
    # By the right-hand rule of RFC 7946 the exterior is anticlockwise, and holes are clockwise.
    oriented = orient(polygon)
    rings = [degrees_of(*ring.coords) for ring in (oriented.exterior, *oriented.interiors)]
    shape = {"type": "Polygon", "coordinates": rings}
    return {"type": "Feature", "properties": properties, "geometry": shape}
