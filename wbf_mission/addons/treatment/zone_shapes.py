"""Polygons of zones: neighbouring blocks joined and cut at the owner's border, without slivers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from geo import Farm
from wbf_mission.addons.treatment.gis import gis
from wbf_mission.addons.treatment.zones import HEALTHY, LOOK, TREAT, ZoneMap

_LEAST_OF_A_BLOCK = 0.25  # Smallest area of a zone, as a fraction of a block


@dataclass(frozen=True, slots=True)
class Zone:
    """Connected area on which one field needs the same action."""

    field: str
    zone: int  # `LOOK`, `TREAT` or `HEALTHY` of `wbf_mission.addons.treatment.zones`
    word: str
    polygon: shapely.Polygon  # Outline, metres in the farm's frame
    latitude_deg: float  # Latitude of a point inside
    longitude_deg: float
    area_ha: float  # Area of the polygon
    need: float  # Fraction of the zone that is expected to need treatment
    gain: float  # Expected saving by perfect information, in the unit of the costs
    rate: float  # Application rate, 0 without treatment
    rate_unit: str


def zones_of(farm: Farm, of: ZoneMap) -> tuple[Zone, ...]:
    """Return a field's zones: first to treat, then to look at again, then healthy; largest first."""
    found = [area for zone in (TREAT, LOOK, HEALTHY) for area in _zones(farm, of, zone)]
    return tuple(sorted(found, key=lambda area: (-area.zone, -area.area_ha)))


def _zones(farm: Farm, of: ZoneMap, zone: int) -> list[Zone]:
    from scipy import ndimage

    found, count = ndimage.label(of.zone == zone)
    labels = found.astype(np.int32)
    if not count:
        return []
    numbers, inside = labels.ravel(), labels.ravel() > 0
    weight = np.where(inside, of.hectares.ravel(), 0.0)
    hectares = np.bincount(numbers, weight, count + 1)
    need, gain = (
        np.bincount(numbers[inside], (share.ravel() * weight)[inside], count + 1)
        for share in (of.need, of.gain)
    )
    polygons, ids = _outlines(labels, of.block_m)
    land = farm.owner_area
    shapely.prepare(land)
    cut = np.where(shapely.contains(land, polygons), polygons, shapely.intersection(polygons, land))
    parts, of_parts = shapely.get_parts(cut, return_index=True)
    kept = (shapely.area(parts) >= _LEAST_OF_A_BLOCK * of.block_m**2) & (shapely.get_dimensions(parts) == 2)
    parts, numbers = parts[kept], ids[of_parts[kept]]
    whole = np.bincount(numbers, shapely.area(parts), count + 1)
    points = shapely.get_coordinates(shapely.point_on_surface(parts))
    latitude, longitude = farm.frame.to_wgs84(points[:, 0], points[:, 1])
    rate = of.costs.rate if zone == TREAT else 0.0
    return [
        Zone(
            of.field.name,
            zone,
            of.word(zone),
            part,
            float(latitude[k]),
            float(longitude[k]),
            part.area / 1e4,
            float(need[number] / hectares[number]),
            float(gain[number] * part.area / whole[number]),
            rate,
            of.costs.rate_unit,
        )
        for k, (part, number) in enumerate(zip(parts, numbers, strict=True))
    ]


def _outlines(labels: NDArray[Any], block_m: float) -> tuple[NDArray[np.object_], NDArray[np.int64]]:
    """Return the outline of each labelled group of blocks (m, farm's frame), and the group's label."""
    features, rasterio = gis("rasterio.features"), gis("rasterio")
    scale = rasterio.Affine(block_m, 0.0, 0.0, 0.0, block_m, 0.0)
    rows = np.ascontiguousarray(labels.T)
    pairs = list(features.shapes(rows, mask=rows > 0, connectivity=4, transform=scale))
    polygons = np.array([shapely.geometry.shape(outline) for outline, _ in pairs], np.object_)
    return polygons, np.array([int(label) for _, label in pairs], np.int64)
