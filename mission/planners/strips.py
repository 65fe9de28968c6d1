"""Rows that see an area wholly: each sees a strip of it, from one end to the other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon

from geo.linear_algebra import product
from mission.planners.path import Area, Points, path_length
from mission.planners.sweep import rotation, row_chains
from mission.planners.terrain import TOLERANCE_M, parts_of, polygons_of

_LEAST_M2 = 1e-9
# Of a square of the spacing, or of a footprint: less is not worth a row.
_LEAST_UNSEEN = 0.25
_TOUCH_M = 1e-6


@dataclass(frozen=True, slots=True)
class Swath:
    """What a camera sees along a row, and how far apart rows lie, metres."""

    across_m: float  # Width of the footprint
    along_m: float  # Its length in the direction of the flight
    spacing_m: float  # Rows are at most so far apart
    overshoot_m: float = 0.0  # Rows go on beyond what they have to see; below zero they end before it
    # So far beside a row the area decides how long it is; None: as far as its strip goes
    reach_m: float | None = None

    @property
    def end_m(self) -> float:
        """How far before the end of its strip a row may end."""
        return 0.5 * self.along_m - self.overshoot_m

    @property
    def least_m2(self) -> float:
        """What of a strip is worth a row of its own."""
        return _LEAST_UNSEEN * max(self.across_m, self.spacing_m) * max(self.along_m, self.spacing_m)

    def seen_from(self, path: Points) -> shapely.Geometry:
        """Return what is seen from a path, images as long as wide; at turns sharper than 97 degrees less."""
        line = shapely.LineString(path) if path_length(path) > TOLERANCE_M else shapely.Point(path[0])
        return shapely.buffer(
            line, 0.5 * self.across_m, cap_style="square", join_style="mitre", mitre_limit=1.5
        )

    def seen_along(self, left: float, right: float, y: float) -> Polygon:
        """Return what a horizontal row is for: what is seen along it, or its strip if that is wider."""
        ahead, aside = max(0.5 * self.along_m, self.end_m), 0.5 * max(self.across_m, self.spacing_m)
        return shapely.box(left - ahead, y - aside, right + ahead, y + aside)


def rows_that_see(part: Polygon, room: Area, swath: Swath, angle_rad: float) -> list[NDArray[np.float64]]:
    """Return rows that see a part of the area, as cells that no border splits.

    The outermost rows lie half a footprint within the part, the others at equal distances between. Each is as
    long as its strip of the part needs: where a border runs aslant a row goes on beyond it, as far as the
    room allows. What of a strip lies where the row cannot be is seen by a row of its own.

    Parameters
    ----------
    part : Polygon
        What is to be seen.
    room : Polygon or MultiPolygon
        Where rows may lie.
    swath : Swath
        What is seen at once.
    angle_rad : float
        Direction of the rows, anticlockwise from x.

    Returns
    -------
    list of float64[n, 2, 2]
        The rows of each cell: row, end, (x, y).
    """
    turn = rotation(angle_rad)
    turned, turned_room = (shapely.transform(one, lambda xy: product(xy, turn.T)) for one in (part, room))
    heights, bounds = _heights(turned, swath)
    row, left, right, y = _intervals(turned, turned_room, swath, heights, bounds)
    ends = product(np.stack((np.stack((left, y), axis=-1), np.stack((right, y), axis=-1)), axis=1), turn)
    return [ends[chain] for chain in row_chains(row, left, right)]


def _heights(turned: Polygon, swath: Swath) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the heights of the rows, and the bounds of their strips."""
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
    """Return the lower and the upper bounds of the rows' strips, float64[2, n]."""
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
    """Return number, left and right end and height of the rows' pieces, sorted by row, then by x."""
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
        seen = [swath.seen_along(*one) for one in rows]
        unseen = polygons_of(
            shapely.difference(shapely.union_all(pieces[mine]), shapely.union_all(seen)), swath.least_m2
        )
        # What lies beside the row where it has to stay out gets a row of its own.
        for one in unseen:
            left, below, right, above = one.bounds
            own = _shortened(np.array([left]), np.array([right]), swath.end_m)
            rows += _within(room, own, 0.5 * (below + above))
        found += [(number, *one) for one in sorted(rows)]
    row, left, right, y = np.array(found).reshape(-1, 4).T
    return row.astype(np.intp), left, right, y


def _shortened(
    low: NDArray[np.float64], high: NDArray[np.float64], end_m: float
) -> list[tuple[float, float]]:
    """Return intervals without their ends; of a short one its middle is left."""
    middle = 0.5 * (low + high)
    return list(
        zip(np.minimum(low + end_m, middle).tolist(), np.maximum(high - end_m, middle).tolist(), strict=True)
    )


def _merged(spans: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return intervals without those that overlap."""
    merged: list[tuple[float, float]] = []
    for left, right in sorted(spans):
        if merged and left <= merged[-1][1] + _TOUCH_M:
            merged[-1] = (merged[-1][0], max(right, merged[-1][1]))
        else:
            merged.append((left, right))
    return merged


def _within(room: Area, spans: list[tuple[float, float]], y: float) -> list[tuple[float, float, float]]:
    """Return the parts of horizontal rows that lie in the room: left, right, height."""
    lines = shapely.linestrings([[(left, y), (right, y)] for left, right in spans])
    points = np.array([right - left < _TOUCH_M for left, right in spans])
    shapes = np.where(points, shapely.points([(left, y) for left, _ in spans]), lines)
    kept = shapely.get_parts(shapely.intersection(shapes, room))
    box = shapely.bounds(kept[~shapely.is_empty(kept)]) if len(kept) else np.empty((0, 4))
    whole = _merged([(float(left), float(right)) for left, _, right, _ in box])
    return [(left, right, y) for left, right in whole]


def ring_strips(area: Area, swath: Swath, passes: int) -> tuple[list[NDArray[np.float64]], list[Polygon]]:
    """Return closed rings along the borders of an area, outermost first, and what is left for rows.

    The first ring sees the border's edge, each further one lies one spacing within. Rows of what is left,
    which is also what is too narrow for a ring, overlap with the rings as they do with each other.
    """
    rings: list[NDArray[np.float64]] = []
    for number in range(passes):
        depth = 0.5 * swath.across_m + number * swath.spacing_m
        for part in polygons_of(shapely.buffer(area, -depth, join_style="mitre", mitre_limit=2.0)):
            rings += [shapely.get_coordinates(ring) for ring in (part.exterior, *part.interiors)]
    if not rings:
        return [], list(parts_of(area))
    lines = [shapely.linestrings(ring) for ring in rings]
    seen = shapely.union_all(shapely.buffer(lines, 0.5 * swath.across_m, join_style="mitre"))
    unseen = polygons_of(shapely.difference(area, seen), swath.least_m2)
    overlap_m = max(swath.across_m - swath.spacing_m, 0.0)
    wide = shapely.buffer(unseen, overlap_m, join_style="mitre", mitre_limit=2.0)
    return rings, polygons_of(shapely.intersection(shapely.union_all(wide), area), swath.least_m2)
