"""One row through land that is narrower than an image: straight where that sees it, else along its middle."""

from __future__ import annotations

import math

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon
from shapely.ops import substring

from geo.linear_algebra import product
from mission.planners.cuts import hull_angles
from mission.planners.path import Area, Points
from mission.planners.strips import Swath
from mission.planners.sweep import rotation
from mission.planners.terrain import TOLERANCE_M, polygons_of

# The middle is found between points of the border: their distance, of the width of the land; their number.
_STEP, _MOST_POINTS = 0.5, 3000
# How much the line leaves the middle, of what is seen across: the most that sees as much as the finest.
_COARSENESS = (0.5, 0.25, 0.12, 0.06, 0.03, 0.015)
_AS_MUCH = 0.003
_MOST_BRANCHES = 100
# Of the width of an image: an arm is as long, else rows of the land beside it see it, too.
_ARM = 2.0


def is_narrow(part: Polygon, swath: Swath) -> bool:
    """Return whether a line along the middle of a part sees all of it.

    Examples
    --------
    >>> [is_narrow(shapely.box(0, 0, 100, width_m), Swath(10, 8, 5)) for width_m in (9, 11)]
    [True, False]
    """
    return bool(shapely.buffer(part, -0.5 * swath.across_m).is_empty)


def without_arms(part: Polygon, swath: Swath) -> list[Polygon]:
    """Split a part into pieces wider than an image and narrow arms; empty without arms.

    Examples
    --------
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
    """Return the rows of a narrow part, float64[n, 2] each: one, and one for each branch it does not see.

    Examples
    --------
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
        # A line that sees nothing new would be found again.
        waiting += [rest for rest in unseen if rest.area < 0.99 * piece.area]
    return lines


def _best_line(part: Polygon, room: Area, swath: Swath) -> LineString:
    """Return the line with the fewest corners that sees about as much of a part as any."""
    middle = _middle(part)
    lines = [_straight(part), *(shapely.simplify(middle, share * swath.across_m) for share in _COARSENESS)]
    lines = [one for one in (_shortened(line, swath.end_m) for line in lines) if shapely.covers(room, one)]
    if not lines:
        return _shortened(middle, swath.end_m)
    unseen = [
        float(shapely.difference(part, swath.seen_from(shapely.get_coordinates(line))).area) for line in lines
    ]
    enough = min(unseen) + _AS_MUCH * part.area
    return next(line for line, area in zip(lines, unseen, strict=True) if area <= enough)


def _straight(part: Polygon) -> LineString:
    """Return the line along the middle of the narrowest rectangle about a part."""
    turn = rotation(hull_angles(part)[0])
    turned = product(shapely.get_coordinates(part), turn.T)
    (left, low), (right, high) = turned.min(axis=0), turned.max(axis=0)
    middle = 0.5 * (low + high)
    return LineString(product(np.array([(left, middle), (right, middle)]), turn))


def _middle(part: Polygon) -> LineString:
    """Return the longest way along the edges between the cells of points of the border (Voronoi)."""
    # Slow to import, and for narrow land alone.
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
    # The node that is farthest from any is one end of the longest way, that farthest from it the other.
    begin, end = -1, int(np.flatnonzero(component == longest)[0])
    for _ in range(2):
        begin = end
        ways, came = dijkstra(graph, directed=False, indices=np.array([begin]), return_predecessors=True)
        end = int(np.argmax(np.where(np.isfinite(ways[0]), ways[0], -1.0)))
    way = [end]
    while way[-1] != begin:
        way.append(int(came[0, way[-1]]))
    return LineString(nodes[way]) if len(way) > 1 else _straight(part)


def _shortened(line: LineString, end_m: float) -> LineString:
    """Return a line without its ends, or longer at both; of a short one its middle is left."""
    if end_m >= 0.0:
        cut_m = min(end_m, 0.5 * line.length)
        cut = substring(line, cut_m, line.length - cut_m)
        return cut if isinstance(cut, LineString) else LineString(2 * list(cut.coords))
    points = shapely.get_coordinates(line)
    for at, beside in ((0, 1), (-1, -2)):
        ahead = points[at] - points[beside]
        points[at] -= end_m * ahead / math.hypot(*ahead)
    return LineString(points)
