"""Zones as polygons: neighbouring blocks joined, cut at the owner's land, slivers left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from geo import Farm
from wbf_mission.addons.treatment.gis import gis
from wbf_mission.addons.treatment.zones import HEALTHY, LOOK, TREAT, ZoneMap

_LEAST_OF_A_BLOCK = 0.25


@dataclass(frozen=True, slots=True)
class Zone:
    """A piece of land that is treated alike."""

    field: str
    zone: int  # `wbf_mission.addons.treatment.zones.TREAT` and others
    word: str
    polygon: shapely.Polygon  # Metres of the farm's frame
    latitude_deg: float  # Of a point inside
    longitude_deg: float
    area_ha: float  # Of the polygon
    need: float  # The expected part that needs treatment
    gain: float  # What knowing it is worth, in the unit of the costs
    rate: float  # Of the product, 0 where nothing is treated
    rate_unit: str


def zones_of(farm: Farm, of: ZoneMap) -> tuple[Zone, ...]:
    """Return the zones of a field: treat, look again, healthy; in each the largest first."""
    found = [one for zone in (TREAT, LOOK, HEALTHY) for one in _zones(farm, of, zone)]
    return tuple(sorted(found, key=lambda one: (-one.zone, -one.area_ha)))


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
        np.bincount(numbers[inside], (each.ravel() * weight)[inside], count + 1)
        for each in (of.need, of.gain)
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
    """Return the outlines of labelled pieces of blocks in metres of the frame, and their labels."""
    features, rasterio = gis("rasterio.features"), gis("rasterio")
    scale = rasterio.Affine(block_m, 0.0, 0.0, 0.0, block_m, 0.0)
    rows = np.ascontiguousarray(labels.T)
    pairs = list(features.shapes(rows, mask=rows > 0, connectivity=4, transform=scale))
    polygons = np.array([shapely.geometry.shape(outline) for outline, _ in pairs], np.object_)
    return polygons, np.array([int(label) for _, label in pairs], np.int64)


def to_wgs84(farm: Farm, polygons: Sequence[shapely.Polygon]) -> NDArray[np.object_]:
    """Return polygons of the farm's frame in longitude and latitude.

    Across the date line longitudes go on beyond 180 degrees: nothing is torn apart.
    """
    origin = farm.frame.longitude_deg

    def transform(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        latitude, longitude = farm.frame.to_wgs84(xy[:, 0], xy[:, 1])
        return np.column_stack((origin + (longitude - origin + 180.0) % 360.0 - 180.0, latitude))

    moved: NDArray[np.object_] = shapely.transform(np.array(polygons, np.object_), transform)
    return moved
