"""Fence and rally points of a plan, from the farm's border, obstacles and rally points."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from geo import Farm, LocalFrame, Obstacle
from mission.model import Command, Frame, MissionItem
from mission.planners.path import Area, Points

MOST_VERTICES = 60
"""Largest number of vertices of a fence: PX4 stores 64 items (NUM_MISSIONS_SUPPORTED, dataman)."""
_LEAST_M = 0.05
_NEAR_M = 0.01
_OF_OBSTACLES = MOST_VERTICES // 2  # Largest number of vertices for exclusion polygons
_LEAST_VERTICES = 4  # Enough for every outline: its smallest rectangle


def border_fence(
    farm: Farm, path_m: Points, distance_m: float, barred: Sequence[Obstacle] = ()
) -> tuple[MissionItem, ...]:
    """Return a fence around the owner's land and a path, float64[n, 2], from home and back.

    The inclusion polygon is at least `distance_m` outside the land's border and the path; each obstacle of
    `barred` has an exclusion polygon without margin. Outlines are simplified to few vertices: the inclusion
    polygon becomes slightly wider, and an exclusion polygon with too many vertices becomes its convex hull.
    """
    count = min(_OF_OBSTACLES // _LEAST_VERTICES, len(barred))
    if count < len(barred):
        text = f"the fence keeps out of the {count} obstacles nearest to the path, of {len(barred)}"
        warnings.warn(f"{text}: autopilots hold no more; the path leads round all", stacklevel=2)
    way = shapely.LineString(path_m)
    nearest = sorted(barred, key=lambda one: float(one.polygon.distance(way)))[:count]
    each = _OF_OBSTACLES // max(count, 1)
    outlines = [_around(one.polygon, 0.0, each) for one in nearest]
    left = MOST_VERTICES - sum(len(outline) for outline in outlines)
    land = shapely.union_all([farm.owner_area, way])
    inside = _around(land, distance_m, left)
    return (
        *_polygon(inside, farm.frame, Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION),
        *(
            item
            for outline in outlines
            for item in _polygon(outline, farm.frame, Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
        ),
    )


def _around(area: Area, distance_m: float, most: int) -> Points:
    """Return the corners of a polygon with at most `most` vertices around an area and its surroundings."""
    held, tolerance_m, more_m = area, _LEAST_M, 0.0
    while True:
        # Simplifying moves the outline inwards by at most the added tolerance.
        wide = shapely.buffer(area, distance_m + tolerance_m + more_m, join_style="mitre", mitre_limit=2.0)
        # One hull around separate lands: a vehicle flies between them.
        whole = wide if isinstance(wide, shapely.Polygon) else shapely.convex_hull(wide)
        outline = shapely.simplify(shapely.Polygon(whole.exterior), tolerance_m)
        corners: Points = shapely.get_coordinates(orient(outline))[:-1]
        if len(corners) <= most:
            # The mitre limit cuts sharp corners, which brings the outline too near.
            short_m = distance_m - float(shapely.distance(outline.exterior, held))
            if short_m < _NEAR_M:
                return corners
            more_m += short_m
            continue
        if tolerance_m > max(distance_m, 5.0):
            area, tolerance_m = shapely.convex_hull(area), _LEAST_M
            if len(shapely.get_coordinates(area)) - 1 > most:
                area = shapely.oriented_envelope(area)
        tolerance_m *= 1.5


def _polygon(corners_m: Points, frame: LocalFrame, command: Command) -> list[MissionItem]:
    latitudes, longitudes = frame.to_wgs84(corners_m[:, 0].copy(), corners_m[:, 1].copy())
    count = float(len(corners_m))
    return [
        MissionItem(command, Frame.GLOBAL, count, x=latitude, y=longitude, autocontinue=False)
        for latitude, longitude in zip(np.asarray(latitudes).tolist(), longitudes.tolist(), strict=True)
    ]


def rally_items(farm: Farm, altitude_m: float) -> tuple[MissionItem, ...]:
    """Return the farm's rally points as mission items, `altitude_m` above home."""
    places = [farm.frame.to_wgs84(*place) for place in farm.rally_m]
    return tuple(
        MissionItem(
            Command.NAV_RALLY_POINT, Frame.GLOBAL_RELATIVE_ALT, x=x, y=y, z=altitude_m, autocontinue=False
        )
        for x, y in places
    )
