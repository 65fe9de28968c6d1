"""The planner spiral: rings from the border inwards, as tight as the budget allows."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry import Polygon

from mission.planners.path import Area, PlannedPath, Points, drop_coincident
from mission.planners.request import PlanningRequest
from mission.planners.search import densest_feasible, densest_over, spacing_limits
from mission.planners.terrain import Terrain, is_rectangle, parts_of

SPACING_RATIO = 1e-3
"""Relative difference between successive spacings that the search tries."""

_SMALLEST = 1e-4  # Ratio of the least to the widest spacing; a mission cannot have items for more rings.
_LEAST_AREA_M2 = 1e-9  # Smaller pieces of an offset are artefacts of rounding.


def spiral(
    request: PlanningRequest,
    /,
    *,
    min_spacing_m: float | None = None,
    max_spacing_m: float | None = None,
) -> PlannedPath:
    """Plan a spiral from the border inwards, with the smallest spacing that the budget allows.

    An axis-aligned rectangle gets the paper's spiral, see `rectangle_spiral`, from the corner nearest to the
    start. Any other area gets rings parallel to its border and round its holes, a spacing apart; if the land
    inside a ring falls into pieces, each piece gets its own rings. Rings may cross passable land between the
    parts of the area; rings without crossings are used if they can lie at least 5 % closer together.

    The search tries spacings down to the footprint, each 0.1 % smaller than the previous spacing. With the
    next smaller spacing, the path would exceed the budget.

    Parameters
    ----------
    min_spacing_m, max_spacing_m : float, optional
        Least and greatest distance between rings. Default: a footprint, no limit.

    Raises
    ------
    PlanningError
        If the budget is too small for the outer ring, or for rings at `max_spacing_m`; the text gives the
        least budget. If a parameter is out of range.

    Examples
    --------
    >>> from mission.planners.budget import LengthBudget
    >>> request = PlanningRequest(shapely.box(0, 0, 30, 30), (0, 0), LengthBudget(360.0), footprint_m=0.0)
    >>> path = spiral(request)
    >>> path.length_m <= 360.0, round(path.spacing_m, 2)
    (True, 2.67)
    """
    limits = spacing_limits("spiral", request.footprint_m, min_spacing_m, max_spacing_m)
    return densest_over(request, lambda land: _spiral(request, land, limits))


def _spiral(request: PlanningRequest, land: Area, limits: tuple[float, float]) -> PlannedPath:
    """Return the densest rings over the land within the budget."""
    least, most = limits
    terrain = Terrain(land, request.footprint_m, request.passable, request.least_leg_m)
    widest = max(_half_width(part) for part in parts_of(terrain.flyable))
    tightest = min(max(least, widest * _SMALLEST), widest)
    highest = _steps(widest / tightest)

    lowest = 0 if most >= widest else min(_steps(widest / most), highest)

    def spacing(index: int) -> float:
        return max(widest * (1.0 - SPACING_RATIO) ** index, tightest)

    def build(index: int) -> Points:
        pieces = spiral_pieces(terrain.flyable, spacing(index), request.start_xy_m)
        return drop_coincident(terrain.join(pieces, request.start_xy_m), 1e-6)

    found = densest_feasible(
        request,
        build,
        lowest,
        highest,
        what=f"spiral with rings {spacing(lowest):.3g} m apart" if lowest else "spiral with one ring",
        density=lambda index: 1.0 / spacing(index),
        look_ahead=(1, 3, 10, 30),
    )
    return PlannedPath(found.points_m, spacing(found.index), "spiral")


def _steps(ratio: float) -> int:
    """Return the number of search steps that reduce a spacing to 1 / `ratio` of its value."""
    return math.ceil(math.log(ratio) / -math.log1p(-SPACING_RATIO) - 1e-9)


def _half_width(part: Polygon) -> float:
    """Return the least spacing at which a part has only its outer ring, accurate to about 2 %."""
    x_min, y_min, x_max, y_max = part.bounds
    high = float(min(x_max - x_min, y_max - y_min)) / 2
    if is_rectangle(part):
        return high
    rough = shapely.simplify(part, 0.02 * high)
    low = 0.0
    while high - low > 0.02 * high:
        middle = (low + high) / 2
        if shapely.buffer(rough, -middle, quad_segs=1).is_empty:
            high = middle
        else:
            low = middle
    return high


def rectangle_spiral(
    bounds_m: tuple[float, float, float, float], spacing_m: float, corner: int = 0
) -> Points:
    """Return the corners of the paper's anticlockwise inward spiral over a rectangle.

    After each side flown, the bound at that side moves inward by the spacing. The spiral ends when a bound
    passes the centre. `corner` is the first corner: 0 is (x_min, y_min), 1 to 3 follow anticlockwise.

    >>> rectangle_spiral((0, 0, 4, 4), 2.0).tolist()
    [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 4.0], [2.0, 2.0]]
    """
    x_min, y_min, x_max, y_max = bounds_m
    origin = np.array(
        [(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)][corner % 4], dtype=float
    )
    along = np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][corner % 4])
    across = np.array([-along[1], along[0]])
    extents = (x_max - x_min, y_max - y_min)
    length, width = extents if corner % 2 == 0 else extents[::-1]
    step = min(spacing_m, length / 2, width / 2)
    low, high = [0.0, 0.0], [float(length), float(width)]
    centre = (length / 2, width / 2)
    corners: list[tuple[float, float]] = []
    while True:
        corners.append((low[0], low[1]))
        low[0] += step
        if low[0] > centre[0]:
            break
        corners.append((high[0], low[1]))
        low[1] += step
        if low[1] > centre[1]:
            break
        corners.append((high[0], high[1]))
        high[0] -= step
        if high[0] < centre[0]:
            break
        corners.append((low[0], high[1]))
        high[1] -= step
        if high[1] < centre[1]:
            break
    local = np.array(corners)
    return np.asarray(origin + local[:, :1] * along + local[:, 1:] * across)


def spiral_pieces(area: Area, spacing_m: float, start_m: ArrayLike) -> list[Points]:
    """Return the spirals or rings over the area in flight order, nearest part first."""
    here = np.asarray(start_m, dtype=np.float64)
    parts = parts_of(area)
    borders = np.array([part.exterior for part in parts])
    waiting = np.arange(len(parts))
    pieces: list[Points] = []
    while len(waiting):
        nearest = int(np.argmin(shapely.distance(shapely.points(here), borders[waiting])))
        part = parts[waiting[nearest]]
        waiting = np.delete(waiting, nearest)
        if is_rectangle(part):
            x_min, y_min, x_max, y_max = part.bounds
            corners = np.array([(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)])
            corner = int(np.argmin(np.round(np.hypot(*(corners - here).T), 9)))
            pieces.append(rectangle_spiral(part.bounds, spacing_m, corner))
        else:
            pieces += _rings(part, spacing_m, here)
        here = pieces[-1][-1]
    return pieces


def _rings(polygon: Polygon, spacing_m: float, here: Points) -> Iterator[Points]:
    """Yield the rings of a polygon from outside to inside; the nearest piece inside a ring comes first."""
    branches: list[list[Polygon]] = [[polygon]]
    while branches:
        if not branches[-1]:
            branches.pop()
            continue
        distances = shapely.distance(shapely.points(here), np.array(branches[-1]))
        piece = branches[-1].pop(int(np.argmin(distances)))
        lines = [shapely.get_coordinates(ring) for ring in (piece.exterior, *piece.interiors)]
        while lines:
            # The outer ring comes first, then the nearest hole.
            gaps = [np.hypot(*(line - here).T).min() for line in lines]
            nearest = 0 if len(lines) > len(piece.interiors) else int(np.argmin(gaps))
            yield (ring := ring_from(lines.pop(nearest), here, spacing_m))
            here = ring[-1]
        inner = shapely.buffer(piece, -spacing_m, join_style="mitre", mitre_limit=2.0)
        branches.append([part for part in parts_of(inner) if part.area > _LEAST_AREA_M2])


def ring_from(ring_m: NDArray[np.float64], start_m: ArrayLike, gap_m: float) -> Points:
    """Return an anticlockwise lap of a closed ring, from the ring's point nearest to the start.

    The lap ends `gap_m` (at most half a lap) before its first point, where the path goes on to the next ring.

    >>> square = np.array([(0.0, 0.0), (4, 0), (4, 4), (0, 4), (0, 0)])
    >>> ring_from(square, (2.0, -1.0), 1.0).tolist()
    [[2.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [0.0, 0.0], [1.0, 0.0]]
    """
    x, y = ring_m[:, 0], ring_m[:, 1]
    ring = ring_m if float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) > 0 else ring_m[::-1]
    start = np.asarray(start_m, dtype=np.float64)
    edges = np.diff(ring, axis=0)
    squares = np.maximum((edges**2).sum(axis=1), 1e-300)
    fractions = np.clip(((start - ring[:-1]) * edges).sum(axis=1) / squares, 0.0, 1.0)
    nearest = ring[:-1] + fractions[:, None] * edges
    edge = int(np.argmin(np.round(np.hypot(*(nearest - start).T), 9)))
    entry = nearest[edge]
    turn = np.vstack((entry, ring[edge + 1 : -1], ring[: edge + 1], entry))
    reach = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(turn, axis=0).T))))
    end = reach[-1] - min(gap_m, reach[-1] / 2)
    last = int(np.searchsorted(reach, end))
    if last == 0:
        return turn[:1]
    share = (end - reach[last - 1]) / (reach[last] - reach[last - 1])
    return np.vstack((turn[:last], turn[last - 1] + share * (turn[last] - turn[last - 1])))
