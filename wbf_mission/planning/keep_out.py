"""Keep-out areas around obstacles, paths around them, and the geofence of a mission."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.polygon import orient

from geo import Farm, LocalFrame, Obstacle
from geo.farm import united
from geo.linear_algebra import cos, sin
from mission.model import Command, Frame, MissionItem
from mission.planners.path import Area, Points
from mission.planners.terrain import Terrain, area_of, parts_of, polygons_of
from wbf_mission.scenario import ScenarioError

_SMOOTH_M = 0.25
_GRAZES_M = 0.01
_WIDE_M = 200_000.0
_SLIVER = 0.5  # In cells: land narrower than twice this is ignored
_SPARE, _SPARE_IN_GUSTS = 1.25, 2.0
"""Safety factors on the deviation from the probe path, in calm air and in gusts: real paths have other turns,
and a flight of an hour meets stronger gusts than the probe's flight of minutes."""
_PROBE_S, _SHORTEST_PROBE_M = 6.0, 20.0
# Turns of the probe path (degrees), with rows back and forth, squares and triangles in both directions.
_TURNS_DEG = (90, 90, 90, 45, 120, 120, 120, 30, -90, -90, -90, -45, -120, -120, -120, 180, 75, 180)


@dataclass(frozen=True, slots=True, eq=False)
class KeepOut:
    """Area around obstacles that planned paths do not enter."""

    # Obstacles widened by at least `distance_m`, in metres of the farm frame; enclosed gaps are filled
    area: Area
    distance_m: float  # Least distance of planned legs from the obstacles.
    near: Area  # Obstacles widened by the margins that the flown path must keep.
    outside: Terrain  # Plane without the area, in which paths are searched.
    _crossed: Area

    @classmethod
    def of(cls, obstacles: Sequence[Obstacle], margin_m: float, stray: float) -> KeepOut:
        """Return the area within `margin_m` + `stray` of obstacles, for vehicles that deviate by `stray` (m).

        If an obstacle has a margin, this margin replaces `margin_m`.
        """
        distance_m = margin_m + stray
        wide = [obstacle.widened(margin_m, stray + _SMOOTH_M + _GRAZES_M) for obstacle in obstacles]
        # Simplifying moves the outline by at most the added width.
        parts = parts_of(united(shapely.simplify(wide, _SMOOTH_M)))
        area = united([shapely.Polygon(part.exterior) for part in parts])
        x0, y0, x1, y1 = area.bounds
        plane = shapely.box(x0 - _WIDE_M, y0 - _WIDE_M, x1 + _WIDE_M, y1 + _WIDE_M)
        crossed = shapely.buffer(area, -_GRAZES_M)
        shapely.prepare(crossed)
        near = united([obstacle.widened(margin_m) for obstacle in obstacles])
        return cls(area, distance_m, near, Terrain(shapely.difference(plane, area), 0.0), crossed)

    def around(self, path_m: Points) -> tuple[Points, NDArray[np.int64]]:
        """Return a path round the obstacles, and for each of its points the index of the next given point.

        Legs outside the area do not change. From a point inside the area (home may be there), the path takes
        the shortest way out.
        """
        numbers = np.arange(len(path_m))
        if len(path_m) < 2:
            return path_m, numbers
        legs = shapely.linestrings(np.stack((path_m[:-1], path_m[1:]), axis=1))
        crossing = np.flatnonzero(shapely.intersects(legs, self._crossed)) + 1
        if not len(crossing):
            return path_m, numbers
        pieces, owners, done = [], [], 0
        for k in crossing.tolist():
            way = self._way(path_m[k - 1], path_m[k])
            pieces += [path_m[done:k], way]
            owners += [numbers[done:k], np.full(len(way), k)]
            done = k
        return np.vstack((*pieces, path_m[done:])), np.concatenate((*owners, numbers[done:]))

    def _way(self, begin_m: Points, end_m: Points) -> Points:
        """Return the points of the shortest path between two points, float64[n, 2]."""
        leave, enter = self._border(begin_m), self._border(end_m)
        inner = self.outside.legs([enter[None]], leave)[0][:-1]
        ends = [np.array([one]) for one, at in ((leave, begin_m), (enter, end_m)) if one is not at]
        first = ends[:1] if leave is not begin_m else []
        last = ends[-1:] if enter is not end_m else []
        return np.vstack((*first, inner, *last))

    def _border(self, point_m: Points) -> Points:
        """Return the point, or the nearest point of the area's border if the point is inside the area."""
        point = shapely.Point(point_m)
        if not shapely.intersects(self._crossed, point):
            return point_m
        return np.asarray(shapely.get_coordinates(shapely.shortest_line(point, self.area.boundary))[-1])


def probe_path(start_m: tuple[float, float], speed_m_s: float) -> Points:
    """Return a path with turns of many angles, float64[n, 2]; its legs are long enough for cruise speed."""
    length_m = max(_SHORTEST_PROBE_M, _PROBE_S * speed_m_s)
    heading = np.radians(np.cumsum((0.0, *_TURNS_DEG)))
    steps = length_m * np.column_stack((cos(heading), sin(heading)))
    first = (start_m[0] + length_m, start_m[1])
    return np.vstack((first, first + np.cumsum(steps, axis=0)))


def stray_m(planned_m: Points, flown: Iterable[Points], *, gusty: bool) -> float:
    """Return the expected largest deviation from a planned path (m), rounded up to 0.1 m."""
    planned = shapely.LineString(planned_m)
    shapely.prepare(planned)
    farthest_m = max(
        float(shapely.distance(shapely.points(track), planned).max(initial=0.0)) for track in flown
    )
    spare = _SPARE_IN_GUSTS if gusty else _SPARE
    return math.ceil(spare * farthest_m * 10.0 - 1e-9) / 10.0


def land_of(farm: Farm, keep_out: KeepOut | None) -> tuple[Area, Area | None]:
    """Return the owner's land to scout, and the land open to paths (None if both are the same)."""
    room = flyable_area(farm, keep_out)
    parts = [
        part
        for part in polygons_of(shapely.intersection(room, farm.scouted_area))
        if not shapely.buffer(part, -_SLIVER * farm.cell_size_m).is_empty
    ]
    seen = area_of(parts) if parts else room
    rest = shapely.buffer(shapely.difference(room, seen), -_SLIVER * farm.cell_size_m)
    return (room, None) if rest.is_empty else (seen, room)


def flyable_area(farm: Farm, keep_out: KeepOut | None) -> Area:
    """Return the owner's land that is open to a vehicle's path."""
    if keep_out is None:
        return farm.without_obstacles(farm.owner_area)
    wide = [
        part
        for part in parts_of(shapely.difference(farm.owner_area, keep_out.area))
        if not shapely.buffer(part, -_SLIVER * farm.cell_size_m).is_empty
    ]
    if not wide:
        raise ScenarioError(
            f"farm {farm.name}: no land is {keep_out.distance_m:.1f} m away from every obstacle; the margin"
            " and the vehicle's drift in that wind need this distance: give a smaller --margin, or fly slower"
        )
    return wide[0] if len(wide) == 1 else shapely.MultiPolygon(wide)


MOST_VERTICES = 60
"""Largest number of vertices of a fence, since PX4 stores 64 items (NUM_MISSIONS_SUPPORTED, dataman)."""
_LEAST_M = 0.05
_NEAR_M = 0.01
_OF_OBSTACLES = MOST_VERTICES // 2  # Largest number of vertices of all exclusion polygons together.
_LEAST_VERTICES = 4  # Every outline can be replaced by its smallest rectangle.


def border_fence(
    farm: Farm, path_m: Points, distance_m: float, barred: Sequence[Obstacle] = ()
) -> tuple[MissionItem, ...]:
    """Return a fence around the owner's land and the path `path_m`, float64[n, 2], from home back to home.

    The inclusion polygon lies at least `distance_m` outside the land's border and the path. Each obstacle of
    `barred` has an exclusion polygon without margin. Outlines are simplified to few vertices; this makes
    polygons slightly larger, and a polygon that still has too many vertices becomes its convex hull.
    """
    count = min(_OF_OBSTACLES // _LEAST_VERTICES, len(barred))
    if count < len(barred):
        text = f"the fence excludes only the {count} obstacles nearest to the path, of {len(barred)}"
        warnings.warn(f"{text}, as autopilots store no more; the path avoids all obstacles", stacklevel=2)
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
    """Return the corners of a polygon with at most `most` vertices, `distance_m` or more outside an area."""
    held, tolerance_m, more_m = area, _LEAST_M, 0.0
    while True:
        # Simplifying moves the outline inwards by at most the added tolerance.
        wide = shapely.buffer(area, distance_m + tolerance_m + more_m, join_style="mitre", mitre_limit=2.0)
        # Separate lands get one hull around all, because a vehicle flies between them.
        whole = wide if isinstance(wide, shapely.Polygon) else shapely.convex_hull(wide)
        outline = shapely.simplify(shapely.Polygon(whole.exterior), tolerance_m)
        corners: Points = shapely.get_coordinates(orient(outline))[:-1]
        if len(corners) <= most:
            # The mitre limit cuts sharp corners, so the outline may come too near to the area.
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
