"""Scan conversion of polygons: which cells have their centre in a polygon."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import shapely

if TYPE_CHECKING:
    from numpy.typing import NDArray

TIE_CELLS = 1e-9
"""A centre nearer than this to an edge is on the edge; float64 errors of a crossing stay below 1e-11."""
VERTEX_DECIMALS = 6
_CROSSINGS_AT_ONCE = 2_000_000

Runs = tuple["NDArray[np.int64]", "NDArray[np.int64]", "NDArray[np.int64]"]


def polygon_edges(polygon: shapely.Polygon, cell_size_m: float) -> NDArray[np.float64]:
    """Return the edges of all rings in cells, rounded to a millionth, as float64[n, 4] x1 y1 x2 y2."""
    edges = []
    for ring in (polygon.exterior, *polygon.interiors):
        xy = np.round(shapely.get_coordinates(ring) / cell_size_m, VERTEX_DECIMALS)
        edges.append(np.hstack([xy[:-1], xy[1:]]))
    return np.concatenate(edges)


def cell_runs(edges: NDArray[np.float64], width: int, height: int) -> Iterator[Runs]:
    """Yield the cells whose centres the polygon covers, as runs along y.

    Even-odd rule over all rings; the boundary, that of holes too, belongs to the polygon.

    Edges, float64[n, 4] x1 y1 x2 y2 of closed rings, are in cells; what lies outside the grid is cut off.
    Runs are cells ``first <= y < stop`` of column x; those of one column may overlap.
    """
    flip = edges[:, 0] > edges[:, 2]
    edges = np.where(flip[:, None], edges[:, [2, 3, 0, 1]], edges)
    # Columns whose centre line meets the closed edge.
    first = np.clip(np.ceil(edges[:, 0] - 0.5 - TIE_CELLS), 0, width).astype(np.int64)
    stop = np.clip(np.floor(edges[:, 2] - 0.5 + TIE_CELLS) + 1, first, width).astype(np.int64)
    yield from _runs_between(edges, first, stop, 0, width, height)


def _runs_between(
    edges: NDArray[np.float64],
    first: NDArray[np.int64],
    stop: NDArray[np.int64],
    column: int,
    end: int,
    height: int,
) -> Iterator[Runs]:
    low = np.maximum(first, column)
    count = np.maximum(np.minimum(stop, end) - low, 0)
    total = int(count.sum())
    if total == 0:
        return
    if total > _CROSSINGS_AT_ONCE and end - column > 1:
        middle = (column + end) // 2
        yield from _runs_between(edges, first, stop, column, middle, height)
        yield from _runs_between(edges, first, stop, middle, end, height)
        return
    edge = np.repeat(np.arange(len(edges)), count)
    x = np.arange(total) - np.repeat(np.cumsum(count) - count, count) + low[edge]
    x1, y1, x2, y2 = edges[edge].T
    centre = x + 0.5
    low_y, high_y = np.minimum(y1, y2), np.maximum(y1, y2)
    upright = x1 == x2
    slope = np.divide(y2 - y1, x2 - x1, out=np.zeros(total), where=~upright)
    y = np.clip(y1 + (centre - x1) * slope, low_y, high_y)
    # The boundary: the one cell whose centre an edge passes, or the whole of an edge along the centre line.
    reach = np.where(upright, np.inf, TIE_CELLS * np.abs(slope))
    yield _clipped(x, np.maximum(y - reach, low_y), np.minimum(y + reach, high_y), height)
    # The interior: the half-open rule counts a vertex on the centre line once.
    inside = (centre >= x1) & (centre < x2)
    x, y = x[inside], y[inside]
    order = np.lexsort((y, x))
    x, y = x[order], y[order]
    yield _clipped(x[::2], y[::2], y[1::2], height)


def _clipped(
    x: NDArray[np.int64], bottom: NDArray[np.float64], top: NDArray[np.float64], height: int
) -> Runs:
    first = np.clip(np.ceil(bottom - 0.5 - TIE_CELLS), 0, height).astype(np.int64)
    stop = np.clip(np.floor(top - 0.5 + TIE_CELLS) + 1, 0, height).astype(np.int64)
    some = stop > first
    return x[some], first[some], stop[some]
