"""Rows that cover a whole area: parallel rows, rings along the border, and lines through narrow land.

This module also cuts concave land into parts that need fewer rows, and finds candidate row directions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import LineString, Polygon
from shapely.geometry.polygon import orient
from shapely.ops import split, substring

from geo.linear_algebra import arctan2, cos, product, sin
from mission.planners.path import Area, Points, path_length
from mission.planners.sweep import rotation, row_chains
from mission.planners.terrain import TOLERANCE_M, parts_of, polygons_of

_LEAST_M2 = 1e-9  # Smaller pieces are artefacts of rounding.
_LEAST_UNSEEN = 0.25  # Smaller uncovered pieces get no row (fraction of a footprint or squared spacing).
_TOUCH_M = 1e-6  # Intervals closer than this distance are merged.
# Points on the border that determine the middle line: distance (in widths of the land), greatest number.
_STEP, _MOST_POINTS = 0.5, 3000
# Tolerances for simplifying the middle line, in image widths. The coarsest line that covers enough is used.
_COARSENESS = (0.5, 0.25, 0.12, 0.06, 0.03, 0.015)
_AS_MUCH = 0.003  # Fraction of the land that a coarser line may miss in addition
_MOST_BRANCHES = 100
_ARM = 2.0  # Least length of an arm in image widths: a shorter arm is covered by the rows next to it
_MOST_CORNERS = 12
_MOST_CUTS = 3
_CANDIDATES = 2
_WORTH = 0.97  # A cut adds turns, so it must reduce the total width of the parts below this fraction of it.
_SHORTEST_EDGE = 1e-3  # Shorter edges are ignored, as noise (fraction of the land's size).
_LONGEST_DETOUR = 5.0  # Greatest length of a detour into a tip of the land (depths of the ring).
_MOST_OF_IT = 0.9  # The hull is simplified if its long edges make up a smaller fraction of its outline.


@dataclass(frozen=True, slots=True)
class Swath:
    """Camera footprint along a row, and row spacing, in metres."""

    across_m: float  # Width of the footprint.
    along_m: float  # Length of the footprint in the direction of flight.
    spacing_m: float  # Greatest row spacing.
    overshoot_m: float = 0.0  # Length of a row beyond its strip; a negative value shortens the row.
    # A row is as long as the land within this distance of the row; None: as long as the land in its strip
    reach_m: float | None = None

    @property
    def end_m(self) -> float:
        """Distance from the end of a row to the end of the row's strip."""
        return 0.5 * self.along_m - self.overshoot_m

    @property
    def least_m2(self) -> float:
        """Least area of an uncovered piece that gets an additional row."""
        return _LEAST_UNSEEN * max(self.across_m, self.spacing_m) * max(self.along_m, self.spacing_m)

    def seen_from(self, path: Points) -> shapely.Geometry:
        """Return the area that square images along a path cover (too small an area at turns above 97°)."""
        line = shapely.LineString(path) if path_length(path) > TOLERANCE_M else shapely.Point(path[0])
        return _valid(
            shapely.buffer(line, 0.5 * self.across_m, cap_style="square", join_style="mitre", mitre_limit=1.5)
        )

    def seen_along(self, left: float, right: float, y: float) -> Polygon:
        """Return the area that images along a horizontal row cover, at least one row spacing wide."""
        ahead, aside = max(0.5 * self.along_m, self.end_m), 0.5 * max(self.across_m, self.spacing_m)
        return shapely.box(left - ahead, y - aside, right + ahead, y + aside)


def rows_that_see(part: Polygon, room: Area, swath: Swath, angle_rad: float) -> list[NDArray[np.float64]]:
    """Return rows that cover a part of the area, grouped into cells (stacks of rows that no border splits).

    The rows have the angle `angle_rad`, anticlockwise from x. The outermost rows lie half a footprint inside
    the part, the other rows at equal distances between them. A row is as long as its strip of land: at an
    oblique border the row extends beyond the border, but not beyond `room`. Pieces of a strip that the row
    does not cover get additional rows. A cell is float64[n, 2, 2]: row, end, (x, y).
    """
    turn = rotation(angle_rad)
    turned, turned_room = (
        _valid(shapely.transform(land, lambda xy: product(xy, turn.T))) for land in (part, room)
    )
    heights, bounds = _heights(turned, swath)
    row, left, right, y = _intervals(turned, turned_room, swath, heights, bounds)
    ends = product(np.stack((np.stack((left, y), axis=-1), np.stack((right, y), axis=-1)), axis=1), turn)
    return [ends[chain] for chain in row_chains(row, left, right)]


def _valid(shape: shapely.Geometry) -> Any:
    """Return a shape without the self-crossings that GEOS's buffers and the rounding of a rotation leave."""
    return shape if shape.is_valid else shapely.make_valid(shape)


def _heights(turned: Polygon, swath: Swath) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the heights (y) of the rows, float64[n], and the bounds of their strips, float64[2, n]."""
    _, low, _, high = turned.bounds
    inner = high - low - swath.across_m
    if inner <= 0.0:
        middle = np.array([0.5 * (low + high)])
        return middle, _strips(middle, np.array([low, high]), swath)
    count = math.ceil(inner / swath.spacing_m - 1e-9) + 1
    heights = np.linspace(low + 0.5 * swath.across_m, high - 0.5 * swath.across_m, count)
    return heights, _strips(
        heights, np.concatenate(([low], 0.5 * (heights[1:] + heights[:-1]), [high])), swath
    )


def _strips(heights: NDArray[np.float64], bounds: NDArray[np.float64], swath: Swath) -> NDArray[np.float64]:
    """Return the lower and upper bounds (y) of each row's strip, float64[2, n]."""
    if swath.reach_m is None:
        return np.stack((bounds[:-1], bounds[1:]))
    return np.stack((heights - swath.reach_m, heights + swath.reach_m))


def _intervals(
    turned: Polygon,
    room: Area,
    swath: Swath,
    heights: NDArray[np.float64],
    bounds: NDArray[np.float64],
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return row index, left end, right end and height of each piece of a row, sorted by row, then by x."""
    x0, _, x1, _ = turned.bounds
    strips = shapely.intersection(turned, shapely.box(x0 - 1.0, bounds[0], x1 + 1.0, bounds[1]))
    pieces, owners = shapely.get_parts(strips, return_index=True)
    large = shapely.area(pieces) > _LEAST_M2
    pieces, owners = pieces[large], owners[large]
    low_x, _, high_x, _ = shapely.bounds(pieces).T
    found: list[tuple[int, float, float, float]] = []
    for number in np.unique(owners).tolist():
        mine = owners == number
        spans = _merged(_shortened(low_x[mine], high_x[mine], swath.end_m))
        rows = _within(room, spans, float(heights[number]))
        seen = [swath.seen_along(*span) for span in rows]
        unseen = polygons_of(
            shapely.difference(shapely.union_all(pieces[mine]), shapely.union_all(seen)), swath.least_m2
        )
        for piece in unseen:
            left, below, right, above = piece.bounds
            own = _shortened(np.array([left]), np.array([right]), swath.end_m)
            rows += _within(room, own, 0.5 * (below + above))
        found += [(number, *span) for span in sorted(rows)]
    row, left, right, y = np.array(found).reshape(-1, 4).T
    return row.astype(np.intp), left, right, y


def _shortened(
    low: NDArray[np.float64], high: NDArray[np.float64], end_m: float
) -> list[tuple[float, float]]:
    """Return the intervals shortened by `end_m` at both ends; a short interval becomes its midpoint."""
    middle = 0.5 * (low + high)
    return list(
        zip(np.minimum(low + end_m, middle).tolist(), np.maximum(high - end_m, middle).tolist(), strict=True)
    )


def _merged(spans: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the unions of overlapping intervals."""
    merged: list[tuple[float, float]] = []
    for left, right in sorted(spans):
        if merged and left <= merged[-1][1] + _TOUCH_M:
            merged[-1] = (merged[-1][0], max(right, merged[-1][1]))
        else:
            merged.append((left, right))
    return merged


def _within(room: Area, spans: list[tuple[float, float]], y: float) -> list[tuple[float, float, float]]:
    """Return the pieces of horizontal rows inside `room`, as (left, right, height)."""
    lines = shapely.linestrings([[(left, y), (right, y)] for left, right in spans])
    points = np.array([right - left < _TOUCH_M for left, right in spans])
    shapes = np.where(points, shapely.points([(left, y) for left, _ in spans]), lines)
    kept = shapely.get_parts(shapely.intersection(shapes, room))
    box = shapely.bounds(kept[~shapely.is_empty(kept)]) if len(kept) else np.empty((0, 4))
    whole = _merged([(float(left), float(right)) for left, _, right, _ in box])
    return [(left, right, y) for left, right in whole]


def ring_strips(
    area: Area, swath: Swath, passes: int, least_leg_m: float | None = None
) -> tuple[list[NDArray[np.float64]], list[Polygon]]:
    """Return closed rings along the borders of an area, outermost first, and the remaining land for rows.

    The first ring covers the border, and each further ring lies a row spacing inside the previous ring. Land
    too narrow for a ring remains for rows. Rows overlap the rings as much as neighbouring rows overlap. With
    `least_leg_m`, the outermost rings have detours of at least this length into the corners of the land.
    """
    rings: list[NDArray[np.float64]] = []
    seen: list[shapely.Geometry] = []
    for number in range(passes):
        depth = 0.5 * swath.across_m + number * swath.spacing_m
        for part in polygons_of(shapely.buffer(area, -depth, join_style="mitre", mitre_limit=2.0)):
            outline = orient(part)
            for ring in map(shapely.get_coordinates, (outline.exterior, *outline.interiors)):
                line = shapely.linestrings(ring)
                seen.append(shapely.buffer(line, 0.5 * swath.across_m, join_style="mitre"))
                if number == 0 and least_leg_m is not None:
                    ring = _into_tips(ring, area, depth, swath, least_leg_m)
                rings.append(ring)
    if not rings:
        return [], list(parts_of(area))
    unseen = polygons_of(shapely.difference(area, shapely.union_all(seen)), swath.least_m2)
    overlap_m = max(swath.across_m - swath.spacing_m, 0.0)
    wide = shapely.buffer(unseen, overlap_m, join_style="mitre", mitre_limit=2.0)
    return rings, polygons_of(shapely.intersection(shapely.union_all(wide), area), swath.least_m2)


def _into_tips(ring: Points, area: Area, depth_m: float, swath: Swath, least_leg_m: float) -> Points:
    """Return a ring with a detour into each corner of the land that images along the ring do not cover.

    The land lies left of `ring`, and extends `depth_m` to its right. A detour goes straight on or, if that
    leads out of the land, along the bisector of the corner. Detours below `least_leg_m` are left out.
    """
    points = ring[:-1]
    arrive, leave = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    arrive, leave = (step / np.hypot(*step.T)[:, None] for step in (arrive, leave))
    outwards = arrive - leave
    outwards /= np.maximum(np.hypot(*outwards.T), 1e-9)[:, None]
    cosine = -(arrive * leave).sum(axis=1)  # of the angle between the two legs
    ahead_m = 0.5 * (swath.along_m or swath.across_m)
    # Distances to the land's corner: along a leg, and along the bisector.
    tip_m = depth_m * np.sqrt((1.0 + cosine) / np.maximum(1.0 - cosine, 1e-9))
    is_tip = (arrive[:, 0] * leave[:, 1] > arrive[:, 1] * leave[:, 0]) & (tip_m > ahead_m + TOLERANCE_M)
    detours = np.zeros_like(points)
    for direction, far_m in ((outwards, np.hypot(tip_m, depth_m)), (arrive, tip_m)):
        reach_m = np.minimum(far_m - ahead_m, _LONGEST_DETOUR * depth_m)
        ways = np.stack((points, points + reach_m[:, None] * direction), axis=1)
        is_possible = is_tip & (reach_m >= least_leg_m) & shapely.covers(area, shapely.linestrings(ways))
        detours[is_possible] = ways[is_possible, 1] - points[is_possible]
    places = np.flatnonzero(detours.any(axis=1))
    there_and_back = np.stack((points[places] + detours[places], points[places]), axis=1).reshape(-1, 2)
    return np.insert(ring, np.repeat(places + 1, 2), there_and_back, axis=0)


def is_narrow(part: Polygon, swath: Swath) -> bool:
    """Return whether a part is so narrow that images along its middle line cover its full width.

    Land round a hole narrower than an image is not narrow: its middle line would pass only one side.

    >>> [is_narrow(shapely.box(0, 0, 100, width_m), Swath(10, 8, 5)) for width_m in (9, 11)]
    [True, False]
    """
    covered = bool(shapely.buffer(part, -0.5 * swath.across_m).is_empty)
    return covered and all(width(Polygon(hole)) >= swath.across_m for hole in part.interiors)


def without_arms(part: Polygon, swath: Swath) -> list[Polygon]:
    """Split a part into wide pieces and arms narrower than an image; return [] if either kind is missing.

    >>> field = shapely.union(shapely.box(0, 0, 50, 50), shapely.box(50, 20, 120, 26))
    >>> [piece.bounds for piece in without_arms(field, Swath(10, 8, 5))]
    [(0.0, 0.0, 50.0, 50.0), (50.0, 20.0, 120.0, 26.0)]
    """
    half_m = 0.5 * swath.across_m
    inner = shapely.buffer(part, -half_m, join_style="mitre")
    wide = shapely.buffer(inner, half_m, join_style="mitre", mitre_limit=2.0)
    narrow = polygons_of(shapely.difference(part, wide), swath.least_m2)
    arms = [rest for rest in narrow if 0.5 * rest.length > _ARM * swath.across_m]
    if inner.is_empty or not arms:
        return []
    return [*polygons_of(shapely.difference(part, shapely.union_all(arms)), swath.least_m2), *arms]


def strip_lines(part: Polygon, room: Area, swath: Swath) -> list[Points]:
    """Return rows of a narrow part, float64[n, 2] each: the main row, and a row for each branch it misses.

    >>> strip = shapely.box(0, 0, 100, 4)
    >>> [line.tolist() for line in strip_lines(strip, strip, Swath(10, 8, 5))]
    [[[4.0, 2.0], [96.0, 2.0]]]
    """
    tolerant = shapely.buffer(room, TOLERANCE_M, join_style="mitre")
    lines, waiting = list[Points](), [part]
    while waiting and len(lines) < _MOST_BRANCHES:
        piece = waiting.pop(0)
        line = _best_line(piece, tolerant, swath)
        lines.append(shapely.get_coordinates(line))
        unseen = polygons_of(shapely.difference(piece, swath.seen_from(lines[-1])), swath.least_m2)
        # Drop a piece that its line hardly covers: the same line would be found again and again.
        waiting += [rest for rest in unseen if rest.area < 0.99 * piece.area]
    return lines


def _best_line(part: Polygon, room: Area, swath: Swath) -> LineString:
    """Return the coarsest line that covers almost as much of a part as the best line."""
    middle = _middle(part)
    lines = [_straight(part), *(shapely.simplify(middle, share * swath.across_m) for share in _COARSENESS)]
    lines = [_with_ends(line, swath.end_m) for line in lines]
    lines = [line for line in lines if shapely.covers(room, line)]
    if not lines:
        return _with_ends(middle, swath.end_m)
    unseen = [
        float(shapely.difference(part, swath.seen_from(shapely.get_coordinates(line))).area) for line in lines
    ]
    enough = min(unseen) + _AS_MUCH * part.area
    return next(line for line, area in zip(lines, unseen, strict=True) if area <= enough)


def _straight(part: Polygon) -> LineString:
    """Return the middle line of the narrowest rectangle around a part."""
    turn = rotation(hull_angles(part)[0])
    turned = product(shapely.get_coordinates(part), turn.T)
    (left, low), (right, high) = turned.min(axis=0), turned.max(axis=0)
    middle = 0.5 * (low + high)
    return LineString(product(np.array([(left, middle), (right, middle)]), turn))


def _middle(part: Polygon) -> LineString:
    """Return the middle line: the longest path along the Voronoi edges of points on the border."""
    # Imported here because scipy.sparse is slow to import, and only narrow land needs it.
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components, dijkstra

    step_m = max(_STEP * 2.0 * part.area / part.length, part.length / _MOST_POINTS)
    border = shapely.MultiPoint(shapely.get_coordinates(shapely.segmentize(part, step_m)))
    edges = shapely.get_parts(shapely.voronoi_polygons(border, only_edges=True))
    shapely.prepare(part)
    edges = edges[shapely.contains_properly(part, edges)]
    if not len(edges):
        return _straight(part)
    ends = np.round(shapely.get_coordinates(edges), 6)
    nodes, numbers = np.unique(ends, axis=0, return_inverse=True)
    first, second = numbers.reshape(-1, 2).T
    lengths = np.hypot(*(nodes[first] - nodes[second]).T)
    graph = csr_array((lengths, (first, second)), shape=(len(nodes), len(nodes)))
    _, component = connected_components(graph, directed=False)
    longest = int(np.argmax(np.bincount(component[first], weights=lengths)))
    # In a tree, the node farthest from any node is an end of the longest path: two searches find both ends.
    begin, end = -1, int(np.flatnonzero(component == longest)[0])
    for _ in range(2):
        begin = end
        ways, came = dijkstra(graph, directed=False, indices=np.array([begin]), return_predecessors=True)
        end = int(np.argmax(np.where(np.isfinite(ways[0]), ways[0], -1.0)))
    way = [end]
    while way[-1] != begin:
        way.append(int(came[0, way[-1]]))
    return LineString(nodes[way]) if len(way) > 1 else _straight(part)


def _with_ends(line: LineString, end_m: float) -> LineString:
    """Return the line, shortened at both ends by `end_m`; a negative `end_m` extends the line."""
    if end_m >= 0.0:
        cut_m = min(end_m, 0.5 * line.length)
        cut = substring(line, cut_m, line.length - cut_m)
        return cut if isinstance(cut, LineString) else LineString(2 * list(cut.coords))
    points = shapely.get_coordinates(line)
    for at, beside in ((0, 1), (-1, -2)):
        ahead = points[at] - points[beside]
        points[at] -= end_m * ahead / math.hypot(*ahead)
    return LineString(points)


def hull_angles(area: Area) -> list[float]:
    """Return the directions of the convex hull's edges, in radians in [0, pi), least width across first.

    The least width of an area is always the width across an edge of its hull (Freeman and Shapira 1975).

    >>> [round(angle, 3) for angle in hull_angles(shapely.box(0, 0, 1, 9))]
    [1.571, 0.0]
    """
    hull = area.convex_hull
    shortest_m = _SHORTEST_EDGE * math.sqrt(hull.area)
    points = shapely.get_coordinates(hull)
    edges = _long_edges(points, shortest_m)
    if np.hypot(*edges.T).sum() < _MOST_OF_IT * hull.length:
        edges = _long_edges(shapely.get_coordinates(shapely.simplify(hull, shortest_m)), shortest_m)
    angles = np.unique(np.round(arctan2(edges[:, 1], edges[:, 0]) % math.pi, 9) % round(math.pi, 9))
    widths = np.ptp(product(points, np.stack((-sin(angles), cos(angles)))), axis=0)
    return [float(angle) for angle in angles[np.argsort(np.round(widths, 9), kind="stable")]]


def _long_edges(points: Points, shortest_m: float) -> Points:
    edges = np.diff(points, axis=0)
    return edges[np.hypot(*edges.T) > shortest_m]


def width(part: Polygon) -> float:
    """Return the least width of a part, which decides the number of rows."""
    angle = hull_angles(part)[0]
    return float(
        np.ptp(product(shapely.get_coordinates(part), np.array([-math.sin(angle), math.cos(angle)])))
    )


def cut_parts(part: Polygon, spacing_m: float) -> list[list[Polygon]]:
    """Return candidate decompositions of a concave part, found by one, two and three cuts.

    Each cut extends a side of a reflex corner. The sum of the widths decides the number of rows (minimal sum
    of altitudes, Huang 2001). Each decomposition reduces the sum, and its parts have at least one row each.
    """
    found: list[tuple[float, list[Polygon]]] = []
    parts, whole = [part], width(part)
    for _ in range(_MOST_CUTS):
        cuts = [
            (sum(map(width, pieces)), pieces)
            for number, uncut in enumerate(parts)
            for piece in _cuts(uncut, spacing_m)
            for pieces in [[*parts[:number], *piece, *parts[number + 1 :]]]
        ]
        cuts = sorted((cut for cut in cuts if cut[0] < _WORTH * whole), key=lambda cut: round(cut[0], 6))
        if not cuts:
            break
        found += cuts[:_CANDIDATES]
        whole, parts = cuts[0]
    return [pieces for _, pieces in found]


def _cuts(part: Polygon, spacing_m: float) -> Iterator[list[Polygon]]:
    """Yield the pieces of a polygon for each cut along a side of a reflex corner."""
    simple = shapely.simplify(part, 0.5 * spacing_m)
    if not isinstance(simple, Polygon) or simple.is_empty:
        return
    reach = math.hypot(*np.subtract(part.bounds[2:], part.bounds[:2]))
    least_m2 = spacing_m * spacing_m
    for corner, directions in _inward(simple)[:_MOST_CORNERS]:
        for direction in directions:
            line = shapely.linestrings([corner - reach * direction, corner + reach * direction])
            within = shapely.get_parts(shapely.intersection(line, part))
            near = [line for line in within if shapely.distance(line, shapely.points(corner)) < spacing_m]
            pieces = [part]
            for line in near:
                # Extended by 1 mm at both ends, the line cuts through the border.
                ends = shapely.get_coordinates(line)
                along = (ends[-1] - ends[0]) / max(math.dist(ends[0], ends[-1]), 1e-9)
                wide = shapely.linestrings(np.array([ends[0] - 1e-3 * along, ends[-1] + 1e-3 * along]))
                pieces = [new for old in pieces for new in polygons_of(split(old, wide))]
            if len(pieces) > 1 and all(piece.area > least_m2 for piece in pieces):
                yield pieces


def _inward(polygon: Polygon) -> list[tuple[Points, list[Points]]]:
    """Return the reflex corners, sharpest first, with the unit vectors of both sides."""
    found = []
    for part in parts_of(polygon):
        oriented = orient(part)
        for ring in (oriented.exterior, *oriented.interiors):
            points = shapely.get_coordinates(ring)[:-1]
            before = points - np.roll(points, 1, axis=0)
            after = np.roll(points, -1, axis=0) - points
            before /= np.maximum(np.hypot(*before.T), 1e-9)[:, None]
            after /= np.maximum(np.hypot(*after.T), 1e-9)[:, None]
            turns = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
            found += [
                (float(turns[k]), points[k], [before[k], after[k]])
                for k in np.flatnonzero(turns < -0.1).tolist()
            ]
    return [(point, sides) for _, point, sides in sorted(found, key=lambda corner: corner[0])]
