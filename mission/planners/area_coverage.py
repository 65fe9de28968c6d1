"""How much of an area a path sees."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from mission.errors import PlanningError
from mission.planners.path import Area, PlannedPath, Points

EXACT_LEGS = 256
_STRETCH = 16
_MOST_PAIRS = 150_000_000
# What a core's cache holds.
_CHUNK_PAIRS = 65_536
_R2 = np.array((0.7548776662466927, 0.5698402909980532))


def coverage(path_xy_m: PlannedPath | ArrayLike, area: Area, footprint_m: float) -> float:
    """Return the fraction of the area that lies within half a footprint of the path.

    Paths of up to 256 legs are measured exactly (round ends as 16-gons). For longer ones the fraction of
    5000 or more evenly spread positions that are within half a footprint is counted; it is within 1 % of the
    area.

    Parameters
    ----------
    path_xy_m : PlannedPath or float64[n, 2]
        The path, in metres of the farm frame. It breaks off at a row of NaN, where nothing is seen.
    area : shapely Polygon or MultiPolygon
        What should be seen, in the same frame.
    footprint_m : float
        Width of what the camera sees at once.

    Returns
    -------
    float
        0 to 1.

    Raises
    ------
    PlanningError
        If the footprint is not above zero, or there is no path or no area.

    Examples
    --------
    >>> round(coverage([[0.0, 5.0], [10.0, 5.0]], shapely.box(0, 0, 10, 10), 2.0), 3)
    0.2
    """
    given = path_xy_m.points_m if isinstance(path_xy_m, PlannedPath) else path_xy_m
    points = np.asarray(given, dtype=np.float64).reshape(-1, 2)
    if not (math.isfinite(footprint_m) and footprint_m > 0) or points.shape[0] < 1 or area.area <= 0:
        msg = (
            "coverage needs a footprint above zero, a path and an area "
            f"(footprint {footprint_m} m, {len(points)} points)"
        )
        raise PlanningError(msg)
    breaks = np.flatnonzero(np.isnan(points).any(axis=1))
    pieces = [one[~np.isnan(one).any(axis=1)] for one in np.split(points, breaks)]
    pieces = [np.repeat(one, 2, axis=0) if len(one) == 1 else one for one in pieces if len(one)]
    if sum(len(one) - 1 for one in pieces) > EXACT_LEGS:
        return _counted(pieces, area, footprint_m / 2)
    # Short stretches first: a long path that crosses itself often is slow to buffer at once.
    lines = np.array(
        [
            shapely.linestrings(one[first : first + _STRETCH + 1])
            for one in pieces
            for first in range(0, len(one) - 1, _STRETCH)
        ]
    )
    seen = shapely.union_all(shapely.buffer(lines, footprint_m / 2, quad_segs=4))
    return float(min(1.0, shapely.intersection(seen, area).area / area.area))


def _counted(pieces: list[Points], area: Area, reach_m: float) -> float:
    """Return the fraction of evenly spread positions of the area that are within the reach of the paths."""
    starts = np.vstack([one[:-1] for one in pieces])
    ways = np.vstack([np.diff(one, axis=0) for one in pieces])
    lengths = np.hypot(ways[:, 0], ways[:, 1])
    along = ways / np.maximum(lengths, 1e-12)[:, None]
    along[lengths < 1e-12] = (1.0, 0.0)
    across = np.column_stack((-along[:, 1], along[:, 0]))
    offsets = (starts * across).sum(axis=1)
    places = _spread(area, min(max(_MOST_PAIRS // len(starts), 5000), 100_000))
    seen = 0
    step = max(1, _CHUNK_PAIRS // len(starts))
    buffer = np.empty((step, len(starts)))
    for first in range(0, len(places), step):
        chunk = places[first : first + step]
        away = np.matmul(chunk, across.T, out=buffer[: len(chunk)])
        away -= offsets
        place, leg = np.nonzero(np.abs(away, out=away) <= reach_m)
        gap = chunk[place] - starts[leg]
        onward = (gap * along[leg]).sum(axis=1)
        beyond = onward - np.clip(onward, 0.0, lengths[leg])
        aside = (gap * across[leg]).sum(axis=1)
        seen += len(np.unique(place[beyond**2 + aside**2 <= reach_m**2]))
    return seen / len(places)


def _spread(area: Area, count: int) -> NDArray[np.float64]:
    """Return about so many positions of the area: the recurrence R2 (M. Roberts, 2018) over its bounds.

    Unlike a lattice it keeps no step with the rows of a path.
    """
    x_min, y_min, x_max, y_max = area.bounds
    share = area.area / ((x_max - x_min) * (y_max - y_min))
    size = math.ceil(min(count / share, 5_000_000)) + 64
    places = np.array((x_min, y_min)) + (0.5 + np.arange(size)[:, None] * _R2) % 1.0 * np.array(
        (x_max - x_min, y_max - y_min)
    )
    shapely.prepare(area)
    inside: NDArray[np.float64] = places[shapely.contains_xy(area, places[:, 0], places[:, 1])]
    return inside if len(inside) else shapely.get_coordinates(shapely.point_on_surface(area))
