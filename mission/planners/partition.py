"""Partitions of an area among several vehicles, as strips or as cells of a power diagram."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from geo.linear_algebra import product
from mission.errors import PlanningError
from mission.planners.path import Area, Points
from mission.planners.terrain import area_of, polygons_of

Divide: TypeAlias = Callable[[Area, Sequence[float]], list[Area]]
"""Function that divides an area into parts with given fractions of its size, which add up to 1."""

STRIPS, VORONOI = "strips", "voronoi"
_SAMPLES = 4000  # Number of grid points in the area, so that shares are accurate to about 0.1 %
_LLOYD_ROUNDS = 60
_WEIGHT_ROUNDS = 12
_BALANCE_ROUNDS = 25
_MOVED = 1e-3  # Lloyd's algorithm stops if no site moves by more than this fraction of the area's size.
_LEAST_SHARE = 0.02  # Least fraction of a vehicle's reach for rows, even if approach and return leave less.
_LEAST_M2 = 1e-9  # Smaller pieces are artefacts of rounding.
_ROUNDING = 1e-8
# Low-discrepancy sequence R2, based on the plastic number (Roberts 2018).
_EVEN = (0.7548776662466927, 0.5698402909980532)


def strips(area: Area, shares: Sequence[float]) -> list[Area]:
    """Return strips across the longer side of an area, in order along this side.

    >>> [part.bounds for part in strips(shapely.box(0.0, 0.0, 8.0, 2.0), [0.25, 0.75])]
    [(0.0, 0.0, 2.0, 2.0), (2.0, 0.0, 8.0, 2.0)]
    """
    shares = _checked(shares)
    across, along = _axes(area)
    turned = shapely.transform(area, lambda points: product(points, np.column_stack((along, across))))
    low, _, high, _ = turned.bounds
    cuts = [_cut(turned, low, high, share) for share in np.cumsum(shares)[:-1]]
    edges = [-math.inf, *cuts, math.inf]
    slabs = [_slab(along, across, turned, begin, end) for begin, end in itertools.pairwise(edges)]
    return _parts(area, slabs)


def power_cells(area: Area, shares: Sequence[float]) -> list[Area]:
    """Return the compact cells of a centroidal power diagram.

    A point belongs to the site with the least power distance: squared distance minus the site's weight
    (Aurenhammer 1987). Each round chooses the weights so that each cell has its share of the area, then moves
    the sites to the centroids of their cells, as in Lloyd's algorithm (for equal shares: Balzer, Schloemer
    and Deussen 2009).

    >>> cells = power_cells(shapely.box(0.0, 0.0, 3.0, 3.0), [0.5, 0.25, 0.25])
    >>> [round(cell.area / 9.0, 2) for cell in cells]
    [0.5, 0.25, 0.25]
    """
    wanted = np.array(_checked(shares))
    points = _samples(area)
    sites = _spread(area, points, len(wanted))
    weights = np.zeros(len(wanted))
    size = math.sqrt(area.area)
    for _ in range(_LLOYD_ROUNDS):
        weights = _weights(points, sites, weights, wanted)
        owner = _owners(points, sites, weights)
        moved = np.array(
            [points[owner == k].mean(axis=0) if (owner == k).any() else sites[k] for k in range(len(sites))]
        )
        step = float(np.hypot(*(moved - sites).T).max())
        sites = moved
        if step < _MOVED * size:
            break
    weights = _weights(points, sites, weights, wanted)
    return _parts(area, [_power_cell(area, sites, weights, k) for k in range(len(sites))])


PARTITIONS: Mapping[str, Divide] = {STRIPS: strips, VORONOI: power_cells}


def balanced(
    area: Area, divide: Divide, reach_m: Sequence[float], ways_m: Callable[[int, Area], float]
) -> list[Area]:
    """Return parts of an area, one per vehicle, so that all vehicles fly the same fraction of their reach.

    A vehicle's reach is the distance that it can fly. Rows with spacing s over a part of area A are A / s
    long. `ways_m` maps a vehicle's number and part to the length of approach and return. The areas are
    corrected, up to 25 times, until the used fractions differ by less than 4 %; the best areas are returned.
    """
    reach = np.asarray(reach_m, dtype=np.float64)
    shares = reach / reach.sum()
    best, best_spread = list[Area](), math.inf
    for _ in range(_BALANCE_ROUNDS):
        parts = divide(area, shares.tolist())
        ways = np.array([ways_m(number, part) for number, part in enumerate(parts)])
        use = shares_of_reach(parts, reach, ways)
        spread = float(use.max() / use.min()) - 1.0
        if spread < best_spread:
            best, best_spread = parts, spread
        if spread < 0.04:
            break
        rows = np.maximum(reach - ways, _LEAST_SHARE * reach)
        wanted = np.maximum(rows / rows.sum(), _LEAST_SHARE / len(rows))
        shares = 0.5 * shares + 0.5 * wanted / wanted.sum()
    return best


def shares_of_reach(parts: Sequence[Area], reach_m: ArrayLike, ways_m: ArrayLike) -> NDArray[np.float64]:
    """Return, for each vehicle, the fraction of its reach that it flies at a row spacing common to all parts.

    At this spacing, the flights of all vehicles together are as long as the sum of the reaches.
    """
    areas = np.array([part.area for part in parts])
    reach, ways = np.asarray(reach_m, dtype=np.float64), np.asarray(ways_m, dtype=np.float64)
    rows = max(float((reach - ways).sum()), _LEAST_SHARE * float(reach.sum()))
    return (areas * rows / areas.sum() + ways) / reach


def _checked(shares: Sequence[float]) -> list[float]:
    given = np.asarray(shares, dtype=np.float64)
    if not len(given) or not np.isfinite(given).all() or not (given > 0.0).all():
        raise PlanningError(f"partition: shares must be finite numbers above zero, not {list(shares)}")
    return (given / given.sum()).tolist()


def _axes(area: Area) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return unit vectors along the area's shorter and longer side; the second points to +x or +y."""
    low_x, low_y, high_x, high_y = area.bounds
    box = np.array([[low_x, low_y], [high_x, low_y], [high_x, high_y], [low_x, high_y]])
    tight = shapely.get_coordinates(shapely.oriented_envelope(area))[:4]
    # Prefer an axis-aligned rectangle unless the oriented rectangle is clearly smaller.
    if len(tight) == 4 and _extent(tight) < 0.9 * _extent(box):
        box = tight
    first, second = box[1] - box[0], box[2] - box[1]
    along = first if np.hypot(*first) >= np.hypot(*second) - 1e-9 else second
    along = along / np.hypot(*along)
    if along[0] < -1e-9 or (abs(along[0]) <= 1e-9 and along[1] < 0.0):
        along = -along
    return np.array([-along[1], along[0]]), along


def _extent(corners: Points) -> float:
    return float(np.hypot(*(corners[1] - corners[0])) * np.hypot(*(corners[2] - corners[1])))


def _cut(turned: Area, low: float, high: float, share: float) -> float:
    """Return the x of the vertical cut that has the fraction `share` of the rotated area on its left."""
    _, below, _, above = turned.bounds
    begin, end, wanted = low, high, share * turned.area
    for _ in range(60):
        middle = 0.5 * (begin + end)
        left = shapely.intersection(turned, shapely.box(low - 1.0, below - 1.0, middle, above + 1.0)).area
        begin, end = (middle, end) if left < wanted else (begin, middle)
    return 0.5 * (begin + end)


def _slab(
    along: NDArray[np.float64], across: NDArray[np.float64], turned: Area, begin: float, end: float
) -> shapely.Polygon:
    low, below, high, above = turned.bounds
    begin, end = max(begin, low - 1.0), min(end, high + 1.0)
    corners = np.array([[begin, below - 1.0], [end, below - 1.0], [end, above + 1.0], [begin, above + 1.0]])
    return shapely.Polygon(product(corners, np.vstack((along, across))))


def _samples(area: Area) -> Points:
    """Return the points of a square grid inside the area, at least one."""
    low_x, low_y, high_x, high_y = area.bounds
    step = math.sqrt(area.area / _SAMPLES)
    x, y = (
        np.arange(low + 0.5 * step, high, step) if high - low > step else np.array([0.5 * (low + high)])
        for low, high in ((low_x, high_x), (low_y, high_y))
    )
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    shapely.prepare(area)
    inside: Points = grid[shapely.contains_xy(area, grid[:, 0], grid[:, 1])]
    if not len(inside):
        inside = shapely.get_coordinates(shapely.point_on_surface(area))
    return inside


def _spread(area: Area, points: Points, count: int) -> Points:
    """Return `count` positions spread evenly over the area; on very thin areas, positions from `points`."""
    low_x, low_y, high_x, high_y = area.bounds
    found: list[Points] = []
    for number in range(1, 1000 * count):
        place = np.array(
            [
                low_x + (0.5 + number * _EVEN[0]) % 1.0 * (high_x - low_x),
                low_y + (0.5 + number * _EVEN[1]) % 1.0 * (high_y - low_y),
            ]
        )
        if shapely.contains_xy(area, *place):
            found.append(place)
        if len(found) == count:
            return np.array(found)
    return np.resize(points, (count, 2))


def _distances(points: Points, sites: Points) -> NDArray[np.float64]:
    """Return the squared distances between sites and points, float64[sites, points]."""
    return ((points[None, :, :] - sites[:, None, :]) ** 2).sum(axis=-1)


def _owners(points: Points, sites: Points, weights: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.argmin(_distances(points, sites) - weights[:, None], axis=0)


def _weights(
    points: Points, sites: Points, weights: NDArray[np.float64], shares: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return weights that give the cells their shares of the area; the weights are found one by one."""
    if len(sites) == 1:
        return weights
    distances = _distances(points, sites)
    weights = weights.copy()
    for _ in range(_WEIGHT_ROUNDS):
        for k, share in enumerate(shares):
            others = np.delete(distances - weights[:, None], k, axis=0).min(axis=0)
            weights[k] = np.quantile(distances[k] - others, share)
        owner = np.bincount(_owners(points, sites, weights), minlength=len(sites)) / len(points)
        if np.abs(owner - shares).max() < 2e-3 * shares.min():
            break
    return weights - weights.mean()


def _power_cell(area: Area, sites: Points, weights: NDArray[np.float64], k: int) -> shapely.Polygon:
    """Return the cell of a site, clipped to a box around the area."""
    low_x, low_y, high_x, high_y = area.bounds
    ring = [
        np.array(corner)
        for corner in (
            (low_x - 1.0, low_y - 1.0),
            (high_x + 1.0, low_y - 1.0),
            (high_x + 1.0, high_y + 1.0),
            (low_x - 1.0, high_y + 1.0),
        )
    ]
    for other in range(len(sites)):
        if other == k or not len(ring):
            continue
        # A point x with normal . x <= bound belongs to site k rather than to the other site.
        normal = 2.0 * (sites[other] - sites[k])
        bound = float((sites[other] ** 2).sum() - (sites[k] ** 2).sum() - weights[other] + weights[k])
        ring = _clipped(ring, normal, bound)
    return shapely.Polygon(ring) if len(ring) > 2 else shapely.Polygon()


def _clipped(ring: list[NDArray[np.float64]], normal: NDArray[np.float64], bound: float) -> list[Points]:
    """Return the convex ring clipped to a half-plane (Sutherland and Hodgman 1974)."""
    kept: list[Points] = []
    for here, there in zip(ring, [*ring[1:], ring[0]], strict=True):
        before, after = (float((normal * end).sum()) - bound for end in (here, there))
        if before <= 0.0:
            kept.append(here)
        if (before < 0.0 < after) or (after < 0.0 < before):
            kept.append(here + (there - here) * (before / (before - after)))
    return kept


def _parts(area: Area, cells: Sequence[shapely.Polygon]) -> list[Area]:
    """Return the part of the area in each cell; each part of a connected area is connected if possible."""
    pieces = [polygons_of(shapely.intersection(area, cell), _LEAST_M2) for cell in cells]
    if not all(pieces):
        msg = f"partition: the area is too small for {len(cells)} vehicles; use fewer, or a larger area"
        raise PlanningError(msg)
    if isinstance(area, shapely.Polygon):
        pieces = _connected(pieces)
    return [area_of(polygons) for polygons in pieces]


def _connected(pieces: list[list[shapely.Polygon]]) -> list[list[shapely.Polygon]]:
    """Move each part's pieces, except the largest, to the part with which they share the longest border."""
    largest = [max(polygons, key=lambda piece: piece.area) for polygons in pieces]
    loose = [
        piece
        for polygons, main in zip(pieces, largest, strict=True)
        for piece in polygons
        if piece is not main
    ]
    parts: list[shapely.Geometry] = list(largest)
    # The copies of a shared border in two pieces differ by rounding.
    near_m = _ROUNDING * max(math.sqrt(piece.area) for piece in largest)
    for piece in sorted(loose, key=lambda piece: -piece.area):
        around = [shapely.intersection(piece.boundary, shapely.buffer(part, near_m)) for part in parts]
        taker = int(np.argmax(shapely.length(around)))
        # Reset the precision grid; otherwise later operations would snap to it (see `geo.Farm.crop_area`).
        parts[taker] = shapely.set_precision(shapely.union(parts[taker], piece, grid_size=near_m), 0.0)
    return [polygons_of(part, _LEAST_M2) for part in parts]
