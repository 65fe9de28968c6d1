"""The land of a path: inset area, visibility of straight legs, shortest paths, random positions."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from operator import is_

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.polygon import orient

from mission.errors import PlanningError
from mission.planners.path import Area, Points

TOLERANCE_M = 5e-7
MAX_VERTICES = 500
_MOST_SEEN = 60_000  # Greatest number of pairs in a visibility graph of all corners: the graph takes a second
_NO_POINTS: Points = np.empty((0, 2))


def parts_of(area: Area) -> tuple[Polygon, ...]:
    """Return the polygons of an area."""
    return tuple(area.geoms) if isinstance(area, MultiPolygon) else (area,)


def polygons_of(geometry: shapely.Geometry, least_m2: float = 0.0) -> list[Polygon]:
    """Return the polygons of a geometry larger than `least_m2`."""
    parts = shapely.get_parts(geometry)
    return [part for part in parts if isinstance(part, Polygon) and part.area > least_m2]


def area_of(polygons: Sequence[Polygon]) -> Area:
    """Return the polygons as one area, or an empty polygon if there are none."""
    if not polygons:
        return Polygon()
    return polygons[0] if len(polygons) == 1 else MultiPolygon(polygons)


def is_rectangle(area: Area) -> bool:
    """Return whether the area is an axis-aligned rectangle."""
    if not isinstance(area, Polygon) or area.interiors:
        return False
    x_min, y_min, x_max, y_max = area.bounds
    box = (x_max - x_min) * (y_max - y_min)
    return bool(box - area.area <= 1e-9 * box)


def inset(area: Area, distance_m: float, least_leg_m: float = 0.0) -> Area:
    """Return the area without a margin of `distance_m` along its border.

    For a part too narrow for the margin, the margin is halved until some land remains, so that the path can
    visit every part. Convex corners stay sharp. Reflex corners are bevelled inward, so that the result lies
    inside the exact inset.

    A border of more than 500 vertices is smoothed inward by at most `distance_m`. A border with successive
    edges shorter than `least_leg_m` is smoothed inward by at most half of `least_leg_m`.

    >>> inset(shapely.box(0, 0, 10, 4), 1.0).bounds
    (1.0, 1.0, 9.0, 3.0)
    """
    if distance_m <= 0:
        return smoothed(area, 0.0, least_leg_m)
    pieces: list[Polygon] = []
    for part in parts_of(area):
        margin = distance_m
        left: list[Polygon] = []
        while not left and margin > distance_m * 2.0**-30:
            left = [piece for piece in parts_of(_shrunk(part, margin)) if piece.area > 0]
            margin /= 2
        pieces += left or [part]
    return smoothed(area_of(pieces), distance_m, least_leg_m)


def smoothed(area: Area, most_m: float, least_leg_m: float = 0.0) -> Area:
    """Return the area, smoothed inward as in `inset`, or the same object if it needs no smoothing."""
    parts = parts_of(area)
    found = [piece for part in parts for piece in _smoothed(part, most_m, _has_many)]
    if least_leg_m > 0.0:
        rough = partial(_is_rough, least_leg_m=least_leg_m)
        found = [piece for part in found for piece in _smoothed(part, 0.5 * least_leg_m, rough)]
    return area if len(found) == len(parts) and all(map(is_, found, parts)) else area_of(found)


def _has_many(parts: Sequence[Polygon]) -> bool:
    return int(np.sum(shapely.get_num_coordinates(parts))) > MAX_VERTICES


def _is_rough(parts: Sequence[Polygon], least_leg_m: float) -> bool:
    """Return whether two successive edges are shorter than `least_leg_m`."""
    for part in parts:
        for ring in (part.exterior, *part.interiors):
            short = np.hypot(*np.diff(shapely.get_coordinates(ring), axis=0).T) < least_leg_m
            if (short & np.roll(short, 1)).any():
                return True
    return False


def _smoothed(part: Polygon, most_m: float, needs: Callable[[Sequence[Polygon]], bool]) -> Sequence[Polygon]:
    """Return simpler polygons inside the part, with borders at most `2 most_m` from the part's border."""
    tolerance = most_m / 64
    pieces: Sequence[Polygon] = [part]
    while needs(pieces) and 0.0 < tolerance <= most_m:
        # `simplify` moves the border by at most the tolerance, so the shrunk part stays inside the part.
        simple = shapely.simplify(shapely.buffer(part, -tolerance, quad_segs=2), tolerance)
        found = [piece for piece in parts_of(simple) if piece.area > 0]
        if not found:
            break
        pieces = found
        tolerance *= 2
    return pieces


def _shrunk(part: Polygon, margin: float) -> Area:
    if not is_rectangle(part):
        return shapely.buffer(part, -margin, join_style="mitre", mitre_limit=2.0)
    x_min, y_min, x_max, y_max = part.bounds
    if min(x_max - x_min, y_max - y_min) <= 2 * margin:
        return Polygon()
    return shapely.box(x_min + margin, y_min + margin, x_max - margin, y_max - margin)


class Region:
    """A polygon with visibility tests and shortest paths.

    A shortest path turns only at reflex corners. The search uses A* over the visibility graph; edges of the
    graph are computed on demand and cached.
    """

    def __init__(self, polygon: Polygon) -> None:
        self.polygon = polygon
        self.tolerant = shapely.buffer(polygon, TOLERANCE_M, join_style="mitre", mitre_limit=2.0)
        shapely.prepare(self.tolerant)

    @cached_property
    def corners(self) -> Points:
        """Corners at which a shortest path can turn, float64[n, 2]."""
        return reflex_corners(self.polygon)

    @cached_property
    def _edges(self) -> NDArray[np.int8]:
        """Visibility between each pair of corners: 1 yes, 0 no, -1 unknown."""
        return np.full((len(self.corners), len(self.corners)), -1, dtype=np.int8)

    def contains(self, points_m: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each point of float64[n, 2] lies in the polygon."""
        return np.asarray(
            shapely.covers(self.tolerant, shapely.points(np.asarray(points_m, dtype=np.float64)))
        )

    def sees(self, starts_m: ArrayLike, ends_m: ArrayLike) -> NDArray[np.bool_]:
        """Return whether the leg between each pair of points, float64[n, 2], stays in the polygon."""
        legs = np.stack(np.broadcast_arrays(starts_m, ends_m), axis=-2).astype(np.float64)
        return np.asarray(shapely.covers(self.tolerant, shapely.linestrings(legs)))

    def route(self, start_m: Points, end_m: Points) -> Points | None:
        """Return the corners of the shortest path between two points, float64[n, 2], or None without one."""
        if bool(self.sees(start_m[None], end_m[None])[0]):
            return _NO_POINTS
        from_start = np.hypot(*(self.corners - start_m).T)
        to_end = np.hypot(*(self.corners - end_m).T)
        detour = from_start + to_end
        longest = 1.5 * math.dist(start_m, end_m)
        while len(detour):
            # Only corners in an ellipse with both ends as foci can be part of a path of at most `longest`.
            longest = max(longest, float(detour.min()))
            near = np.nonzero(detour <= longest)[0]
            found, length = self._search(near, start_m, end_m, from_start[near], to_end[near])
            if found is not None and (length <= longest or len(near) == len(detour)):
                return found
            if len(near) == len(detour):
                break
            longest = max(2 * longest, length if found is not None else 0.0)
        return None

    def _search(
        self,
        near: NDArray[np.intp],
        start_m: Points,
        end_m: Points,
        from_start: Points,
        to_end: Points,
    ) -> tuple[Points | None, float]:
        """Return the shortest path that turns only at the corners `near`, and its length."""
        corners = self.corners[near]
        reaches_end = self.sees(corners, end_m)
        spent = np.where(self.sees(corners, start_m), from_start, math.inf)
        came_from = np.full(len(near), -1)
        queue = [
            (float(spent[node] + to_end[node]), int(node), False) for node in np.nonzero(spent < math.inf)[0]
        ]
        heapq.heapify(queue)
        done = np.zeros(len(near), dtype=bool)
        while queue:
            length, node, arrived = heapq.heappop(queue)
            if arrived:
                way = [node]
                while came_from[way[-1]] >= 0:
                    way.append(int(came_from[way[-1]]))
                return corners[way[::-1]], length
            if done[node]:
                continue
            done[node] = True
            if reaches_end[node]:
                heapq.heappush(queue, (float(spent[node] + to_end[node]), node, True))
            through = spent[node] + np.hypot(*(corners - corners[node]).T)
            shorter = np.nonzero(through < spent)[0]
            shorter = shorter[self._visible(int(near[node]), near[shorter])]
            spent[shorter] = through[shorter]
            came_from[shorter] = node
            for index in shorter.tolist():
                heapq.heappush(queue, (float(spent[index] + to_end[index]), index, False))
        return None, math.inf

    def _visible(self, node: int, others: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return whether each of the corners `others` is visible from the corner `node`."""
        unknown = others[self._edges[node, others] < 0]
        if len(unknown):
            seen = self.sees(self.corners[unknown], self.corners[node])
            self._edges[node, unknown] = seen
            self._edges[unknown, node] = seen
        return np.asarray(self._edges[node, others] > 0)


def reflex_corners(polygon: Polygon) -> Points:
    """Return the corners with an interior angle above 180 degrees, float64[n, 2].

    >>> reflex_corners(Polygon([(0, 0), (4, 0), (4, 4), (2, 4), (2, 2), (0, 2)])).tolist()
    [[2.0, 2.0]]
    """
    oriented = orient(polygon)
    found = []
    for ring in (oriented.exterior, *oriented.interiors):
        points = shapely.get_coordinates(ring)[:-1]
        before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
        turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        scale = np.hypot(*before.T) * np.hypot(*after.T)
        found.append(points[turn < -1e-12 * scale])
    return np.vstack(found)


class _Regions:
    """The parts of an area, each as a `Region`, with a spatial index."""

    def __init__(self, area: Area) -> None:
        self._regions: tuple[Region, ...] = tuple(Region(part) for part in parts_of(area))
        self._tree = shapely.STRtree([region.tolerant for region in self._regions])
        self._bounds = shapely.bounds(self._tree.geometries)

    def near(self, starts_m: Points, ends_m: Points) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return pairs (leg, region) of indices, sorted by region; the region may contain the leg's ends."""
        legs, numbers = self._tree.query(shapely.points(starts_m))
        low, high = self._bounds[numbers, :2], self._bounds[numbers, 2:]
        held = ((low <= ends_m[legs]) & (ends_m[legs] <= high)).all(axis=1)
        order = np.lexsort((legs[held], numbers[held]))
        return legs[held][order], numbers[held][order]

    def sees(self, starts_m: Points, ends_m: Points) -> NDArray[np.bool_]:
        """Return whether the straight leg between each pair of points stays inside one region."""
        seen = np.zeros(len(starts_m), dtype=bool)
        legs, numbers = self.near(starts_m, ends_m)
        for pairs in np.split(np.arange(len(legs)), np.nonzero(np.diff(numbers))[0] + 1):
            if len(pairs):
                open_legs = legs[pairs][~seen[legs[pairs]]]
                region: Region = self._regions[numbers[pairs[0]]]
                seen[open_legs] = region.sees(starts_m[open_legs], ends_m[open_legs])
        return seen

    def route(self, start_m: Points, end_m: Points) -> Points | None:
        """Return the corners of a path between two points inside one region, or None: see `Region.route`."""
        both = np.vstack((start_m, end_m))
        for number in self.near(both[:1], both[1:])[1]:
            region: Region = self._regions[int(number)]
            if bool(region.contains(both).all()):
                found = region.route(start_m, end_m)
                if found is not None:
                    return found
        return None


class Terrain:
    """The land of a path: the area inset by half a footprint.

    Transits between pieces of a path may cross all the `passable` land.
    """

    def __init__(
        self, area: Area, footprint_m: float, passable: Area | None = None, least_leg_m: float = 0.0
    ) -> None:
        self.flyable = inset(area, footprint_m / 2, least_leg_m)
        self._room = area if passable is None else passable
        self._inner = _Regions(
            self.flyable if passable is None else inset(passable, footprint_m / 2, least_leg_m)
        )

    @cached_property
    def _outer(self) -> _Regions:
        # A transit may pass a neck narrower than the footprint, along the exact border of the land.
        return _Regions(self._room)

    def join(self, pieces: Sequence[Points], start_m: ArrayLike) -> Points:
        """Return the path through the pieces in order, with the transits that `legs` adds."""
        return np.vstack(self.legs(pieces, start_m))

    def legs(self, pieces: Sequence[Points], start_m: ArrayLike) -> list[Points]:
        """Return the pieces, each preceded by the corners of the transit to the piece.

        The pieces lie in the inset area. A transit is a straight leg if this leg stays in the inset land,
        else the shortest path in the inset land, else the shortest path in the full land (the area, or the
        passable land). A transit between separate parts is straight. The start may lie anywhere and is not
        part of the result.
        """
        start = np.asarray(start_m, dtype=np.float64)
        leaves = np.vstack((start, *(piece[-1] for piece in pieces[:-1])))
        enters = np.vstack([piece[0] for piece in pieces])
        direct = self._inner.sees(leaves, enters)
        return [
            piece if straight else np.vstack((self._detour(leave, enter), piece))
            for piece, straight, leave, enter in zip(pieces, direct, leaves, enters, strict=True)
        ]

    def sees(self, starts_m: Points, ends_m: Points) -> NDArray[np.bool_]:
        """Return whether the leg between each pair of points, float64[n, 2], stays inside the inset land."""
        return self._inner.sees(np.atleast_2d(starts_m), np.atleast_2d(ends_m))

    def lengths(self, places_m: Points) -> NDArray[np.float64]:
        """Return the lengths of the shortest paths between positions, float64[n, n].

        The straight distance is returned if two positions lie in separate parts, and for all positions if the
        visibility graph would be too large.
        """
        # Imported here because scipy.sparse is slow to import, and only this method needs it.
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import dijkstra

        count = len(places_m)
        straight = straight_lengths(places_m)
        corners = np.vstack([reflex_corners(part) for part in parts_of(self._room)])
        nodes = np.vstack((places_m, corners))
        first, second = np.triu_indices(len(nodes), 1)
        if not len(corners) or len(first) > _MOST_SEEN:
            return straight
        seen = _Regions(self._room).sees(nodes[first], nodes[second])
        first, second = first[seen], second[seen]
        steps = np.hypot(*(nodes[first] - nodes[second]).T)
        graph = csr_array((steps, (first, second)), shape=(len(nodes), len(nodes)))
        ways = dijkstra(graph, directed=False, indices=np.arange(count))[:, :count]
        return np.where(np.isfinite(ways), np.maximum(ways, straight), straight)

    def _detour(self, leave: Points, enter: Points) -> Points:
        for regions in (self._inner, self._outer):
            found = regions.route(leave, enter)
            if found is not None:
                return found
        return _NO_POINTS


def straight_lengths(places_m: Points) -> NDArray[np.float64]:
    """Return the straight distances between positions, float64[n, n]."""
    steps = places_m[:, None] - places_m[None]
    return np.hypot(steps[..., 0], steps[..., 1])


_ATTEMPTS = 1000


def draw_places(area: Area, count: int, rng: np.random.Generator) -> Points:
    """Return about `count` uniformly distributed positions in the area, at least one.

    Positions outside the area are rejected. Rejected draws also advance `rng`, so the sequence of positions
    does not depend on `count`.
    """
    x_min, y_min, x_max, y_max = area.bounds
    share = area.area / ((x_max - x_min) * (y_max - y_min))
    size = math.ceil(min(1.1 * count / share + 16, 1_000_000))
    shapely.prepare(area)
    for _ in range(_ATTEMPTS):
        draws = np.array((x_min, y_min)) + rng.random((size, 2)) * np.array((x_max - x_min, y_max - y_min))
        kept: Points = draws[shapely.contains_xy(area, draws[:, 0], draws[:, 1])]
        if len(kept):
            return kept
    raise PlanningError("the area is too thin for random positions; use a smaller footprint or a wider area")
