"""Decomposition of concave land into parts that need fewer rows, and candidate row directions."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import shapely
from shapely.geometry import Polygon
from shapely.geometry.polygon import orient
from shapely.ops import split

from geo.linear_algebra import arctan2, cos, product, sin
from mission.planners.path import Area, Points
from mission.planners.terrain import parts_of, polygons_of

_MOST_CORNERS = 12
_MOST_CUTS = 3
_CANDIDATES = 2
_WORTH = 0.97  # A cut pays for its additional turns if it reduces the sum of widths to this fraction
_SHORTEST_EDGE = 1e-3  # Shorter edges have a random direction (fraction of the land's size)
_MOST_OF_IT = 0.9  # The hull is simplified if long edges make up a smaller fraction of its outline


def hull_angles(area: Area) -> list[float]:
    """Return the directions of the convex hull's edges, in radians in [0, pi), narrowest width first.

    The least width of an area is always measured across an edge of its hull (Freeman and Shapira 1975).

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
    kept: Points = edges[np.hypot(*edges.T) > shortest_m]
    return kept


def width(part: Polygon) -> float:
    """Return the least width of a part, which decides the number of rows."""
    angle = hull_angles(part)[0]
    return float(
        np.ptp(product(shapely.get_coordinates(part), np.array([-math.sin(angle), math.cos(angle)])))
    )


def cut_parts(part: Polygon, spacing_m: float) -> list[list[Polygon]]:
    """Return candidate decompositions of a concave part, the best of each round of cuts first.

    Cuts extend the sides of reflex corners. The sum of the widths decides the number of rows (minimal sum of
    altitudes, Huang 2001). Each decomposition reduces this sum, and each of its parts has at least one row.
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
