"""Concave land in parts that are narrower together, and the directions along their sides."""

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
# A cut is worth its turns if it saves so much of the width that rows have to cover.
_WORTH = 0.97
_SHORTEST_EDGE = 1e-3
_MOST_OF_IT = 0.9


def hull_angles(area: Area) -> list[float]:
    """Return the directions of the convex hull's edges, radians in [0, pi), narrowest across first.

    Along one of them the area is narrowest of all (Freeman and Shapira 1975).

    Examples
    --------
    >>> [round(angle, 3) for angle in hull_angles(shapely.box(0, 0, 1, 9))]
    [1.571, 0.0]
    """
    hull = area.convex_hull
    shortest_m = _SHORTEST_EDGE * math.sqrt(hull.area)
    points = shapely.get_coordinates(hull)
    edges = _long_edges(points, shortest_m)
    # Of an outline of very many vertices too little would be left.
    if np.hypot(*edges.T).sum() < _MOST_OF_IT * hull.length:
        edges = _long_edges(shapely.get_coordinates(shapely.simplify(hull, shortest_m)), shortest_m)
    angles = np.unique(np.round(arctan2(edges[:, 1], edges[:, 0]) % math.pi, 9) % round(math.pi, 9))
    widths = np.ptp(product(points, np.stack((-sin(angles), cos(angles)))), axis=0)
    return [float(one) for one in angles[np.argsort(np.round(widths, 9), kind="stable")]]


def _long_edges(points: Points, shortest_m: float) -> Points:
    edges = np.diff(points, axis=0)
    kept: Points = edges[np.hypot(*edges.T) > shortest_m]
    return kept


def width(part: Polygon) -> float:
    """Return how wide a part is where it is narrowest: rows along that direction are the fewest."""
    angle = hull_angles(part)[0]
    return float(
        np.ptp(product(shapely.get_coordinates(part), np.array([-math.sin(angle), math.cos(angle)])))
    )


def cut_parts(part: Polygon, spacing_m: float) -> list[list[Polygon]]:
    """Return some ways to cut a concave part, along sides that end in a corner that points inwards.

    The sum of the widths decides how many rows there are (the minimal sum of altitudes of Huang 2001); ways
    that lessen it are returned, each cut in parts of at least one row, the best first.
    """
    found: list[tuple[float, list[Polygon]]] = []
    parts, whole = [part], width(part)
    for _ in range(_MOST_CUTS):
        cuts = [
            (sum(map(width, pieces)), pieces)
            for number, one in enumerate(parts)
            for piece in _cuts(one, spacing_m)
            for pieces in [[*parts[:number], *piece, *parts[number + 1 :]]]
        ]
        cuts = sorted((one for one in cuts if one[0] < _WORTH * whole), key=lambda one: round(one[0], 6))
        if not cuts:
            break
        found += cuts[:_CANDIDATES]
        whole, parts = cuts[0]
    return [pieces for _, pieces in found]


def _cuts(part: Polygon, spacing_m: float) -> Iterator[list[Polygon]]:
    """Yield the parts of a polygon in two or more, cut along a side at a corner that points inwards."""
    simple = shapely.simplify(part, 0.5 * spacing_m)
    if not isinstance(simple, Polygon) or simple.is_empty:
        return
    reach = math.hypot(*np.subtract(part.bounds[2:], part.bounds[:2]))
    least_m2 = spacing_m * spacing_m
    for corner, directions in _inward(simple)[:_MOST_CORNERS]:
        for direction in directions:
            line = shapely.linestrings([corner - reach * direction, corner + reach * direction])
            within = shapely.get_parts(shapely.intersection(line, part))
            near = [one for one in within if shapely.distance(one, shapely.points(corner)) < spacing_m]
            pieces = [part]
            for one in near:
                wide = shapely.linestrings(_longer(shapely.get_coordinates(one)))
                pieces = [new for old in pieces for new in polygons_of(split(old, wide))]
            if len(pieces) > 1 and all(one.area > least_m2 for one in pieces):
                yield pieces


def _longer(ends: Points) -> Points:
    """Return a line that reaches a little beyond both ends."""
    along = (ends[-1] - ends[0]) / max(math.dist(ends[0], ends[-1]), 1e-9)
    return np.array([ends[0] - 1e-3 * along, ends[-1] + 1e-3 * along])


def _inward(polygon: Polygon) -> list[tuple[Points, list[Points]]]:
    """Return the corners that point inwards, sharpest first, with the directions of both sides."""
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
    return [(point, sides) for _, point, sides in sorted(found, key=lambda one: one[0])]
