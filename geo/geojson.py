"""Farm files as GeoJSON documents (RFC 7946): read into entries, written; see docs/farm-files.md."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import shapely
from shapely.geometry.polygon import orient

from geo.atomic import atomic_write
from geo.coordinates import coordinates_of, member_crs
from geo.errors import FarmError
from geo.farm import Farm
from geo.features import Document, Entry
from geo.frame import LocalFrame
from geo.reading import UnreadableError, not_json, read_text

MAX_FILE_BYTES = 32 * 2**20


def read_geojson(path: Path, crs: str | None = None) -> Document:
    """Return what a feature collection holds; ``crs`` is that of a file that does not tell its own.

    FarmError if the file holds no feature collection, or tells another coordinate system.
    """
    document = _members(path)
    if crs is not None and document.get("crs") is not None:
        raise FarmError(f"has a coordinate system of its own; leave out that it is {crs!r:.60}")
    own = member_crs(document, "the file", None if crs is None else coordinates_of(crs))
    raw = document.pop("features", None)
    if not isinstance(raw, list) or not raw:
        raise FarmError('has no "features"')
    entries = []
    for number, one in enumerate(raw, 1):
        where = f"feature {number}"
        if not isinstance(one, dict) or one.get("type") != "Feature":
            raise FarmError(f'{where}: is not a GeoJSON "Feature"')
        properties = one.get("properties")
        if not isinstance(properties, dict):
            raise FarmError(f'{where}: has no "properties" with crop and owner')
        name = properties.get("name")
        named = f"{where} ({name!r:.60})" if isinstance(name, str) else where
        entry_crs = member_crs(one, named, own)
        geometry = one.get("geometry")
        if isinstance(geometry, dict):
            entry_crs = member_crs(geometry, named, entry_crs)
        entries.append(Entry(where, number, properties, geometry, entry_crs))
    return Document(document, entries, own)


def _members(path: Path) -> dict[str, Any]:
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


def save_farm(farm: Farm, path: str | os.PathLike[str]) -> None:
    """Write a farm as a GeoJSON file that `load_farm` reads back; the file appears whole or not at all.

    Raises
    ------
    FarmError
        If the file cannot be written.
    """
    try:
        with atomic_write(path, "wb") as file:
            file.write(msgspec.json.format(msgspec.json.encode(farm_document(farm)), indent=1))
    except (OSError, ValueError) as error:
        msg = f"farm file {os.fspath(path)}: cannot be written ({getattr(error, 'strerror', None) or error})"
        raise FarmError(msg) from None


def farm_document(farm: Farm) -> dict[str, Any]:
    """Return what `save_farm` writes."""
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
    return {
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
