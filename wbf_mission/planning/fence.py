"""The fence and the rally points of a plan, from the farm's border, its obstacles and its rally points."""

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
"""Of all polygons of a fence: a PX4 stores 64 items (NUM_MISSIONS_SUPPORTED, dataman)."""
_LEAST_M = 0.05
_NEAR_M = 0.01
_OF_OBSTACLES = MOST_VERTICES // 2  # At most so many vertices are theirs
_LEAST_VERTICES = 4  # What every outline can be told by: that of its tightest rectangle


def border_fence(
    farm: Farm, path_m: Points, distance_m: float, barred: Sequence[Obstacle] = ()
) -> tuple[MissionItem, ...]:
    """Return a fence about the owner's land and a path, float64[n, 2], from home and back.

    One polygon to stay in, at least `distance_m` outside of the land's border and of the path; one to stay
    out of about each obstacle that bars the way, as it is. Few vertices tell their outlines: those to stay in
    are drawn a little wider, those to stay out of are the convex hulls where they have too many.
    """
    count = min(_OF_OBSTACLES // _LEAST_VERTICES, len(barred))
    if count < len(barred):
        text = f"the fence keeps out of the {count} obstacles nearest to the path, of {len(barred)}"
        warnings.warn(f"{text}: autopilots hold no more; the path leads round all", stacklevel=2)
    way = shapely.LineString(path_m)
    nearest = sorted(barred, key=lambda one: float(one.polygon.distance(way)))[:count]
    each = _OF_OBSTACLES // max(count, 1)
    outlines = [_around(one.polygon, 0.0, each) for one in nearest]
    left = MOST_VERTICES - sum(len(one) for one in outlines)
    land = shapely.union_all([farm.owner_area, way])
    inside = _around(land, distance_m, left)
    return (
        *_polygon(inside, farm.frame, Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION),
        *(
            item
            for one in outlines
            for item in _polygon(one, farm.frame, Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
        ),
    )


def _around(area: Area, distance_m: float, most: int) -> Points:
    """Return the corners of a polygon of few vertices that holds an area and its surroundings."""
    held, tolerance_m, more_m = area, _LEAST_M, 0.0
    while True:
        # What is simplified moves inwards by no more than it is too wide.
        wide = shapely.buffer(area, distance_m + tolerance_m + more_m, join_style="mitre", mitre_limit=2.0)
        # Lands apart from each other: a vehicle has to fly between them.
        whole = wide if isinstance(wide, shapely.Polygon) else shapely.convex_hull(wide)
        outline = shapely.simplify(shapely.Polygon(whole.exterior), tolerance_m)
        corners: Points = shapely.get_coordinates(orient(outline))[:-1]
        if len(corners) <= most:
            # Sharp corners are cut, nearer than they should be.
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
    """Return the farm's rally points as items, at a height above home."""
    places = [farm.frame.to_wgs84(*place) for place in farm.rally_m]
    return tuple(
        MissionItem(
            Command.NAV_RALLY_POINT, Frame.GLOBAL_RELATIVE_ALT, x=x, y=y, z=altitude_m, autocontinue=False
        )
        for x, y in places
    )
