"""Cuts geometries of GeoJSON at 180 degrees longitude (RFC 7946, 3.1.9)."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import shapely
from shapely.affinity import translate


def cut(geometry: dict[str, Any]) -> dict[str, Any]:
    """Return a line or polygon, or its parts if it crosses 180 degrees.

    >>> cut({"type": "LineString", "coordinates": [[179.0, 2.0], [-179.0, 4.0]]})["coordinates"]
    [[[179.0, 2.0], [180.0, 3.0]], [[-180.0, 3.0], [-179.0, 4.0]]]
    """
    if geometry["type"] == "LineString" and len(geometry["coordinates"]) < 2:
        return geometry
    shape = shapely.from_geojson(msgspec.json.encode(geometry))
    places = shapely.get_coordinates(shape, include_z=shape.has_z)
    if np.ptp(places[:, 0]) <= 180.0:
        return geometry
    places[:, 0] += 360.0 * (places[:, 0] < 0.0)
    whole = shapely.set_coordinates(shape, places)
    east, west = (shapely.clip_by_rect(whole, at, -90.0, at + 180.0, 90.0) for at in (0.0, 180.0))
    parts = shapely.orient_polygons(shapely.get_parts([east, translate(west, -360.0)]))
    texts = shapely.to_geojson(parts[shapely.get_type_id(parts) == shapely.get_type_id(shape)])
    coordinates = [msgspec.json.decode(text)["coordinates"] for text in texts]
    return {"type": f"Multi{geometry['type']}", "coordinates": coordinates}
