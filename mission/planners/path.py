"""Planned paths, their length and their coincident points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from shapely.geometry import MultiPolygon, Polygon

from mission.errors import AnswerError

Area: TypeAlias = Polygon | MultiPolygon
Points: TypeAlias = NDArray[np.float64]

COINCIDENT_M = 0.01
"""Points closer than this distance coincide; the errors of GNSS positions are about a metre."""


@dataclass(frozen=True, slots=True, eq=False)
class PlannedPath:
    """Result of a planner: a path of straight legs.

    Parameters
    ----------
    points_m : float64[n, 2]
        Points of the path, x and y in metres of the farm frame, n >= 1; stored read-only. The leg from the
        request's start to the first point is not part of the path.
    spacing_m : float or None
        Distance between neighbouring rows or rings, or None for a path without rows.
    planner : str
        Name of the planner.

    Raises
    ------
    AnswerError
        If there are no points, a coordinate is not finite, the array has another shape, or the spacing is
        negative or not finite.
    """

    points_m: Points
    spacing_m: float | None
    planner: str

    def __post_init__(self) -> None:
        points = path_points(self.points_m)
        if not len(points):
            raise AnswerError("a path needs one or more (x, y) points, but it has none", "no points")
        if self.spacing_m is not None and not (math.isfinite(self.spacing_m) and self.spacing_m >= 0):
            raise AnswerError(f"spacing_m {self.spacing_m} of a path is not a distance", "not finite")
        object.__setattr__(self, "points_m", points)

    @property
    def length_m(self) -> float:
        """Length of the path, without approach and return."""
        return path_length(self.points_m)


def path_points(points_m: ArrayLike, whose: str = "") -> Points:
    """Return a read-only copy of a path's points; AnswerError if a point is not finite or no (x, y) pair."""
    points = np.array(points_m, dtype=np.float64)
    points = points if points.size else np.empty((0, 2))
    fault = f"{whose}a path must be finite (x, y) points"
    if points.ndim != 2 or points.shape[1] != 2:
        raise AnswerError(f"{fault}; its shape is {points.shape}", "no points")
    wrong = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(wrong):
        x_m, y_m = points[wrong[0]]
        raise AnswerError(f"{fault}, but the point at index {wrong[0]} is ({x_m:g}, {y_m:g})", "not finite")
    points.flags.writeable = False
    return points


def path_length(path_xy_m: ArrayLike) -> float:
    """Return the length of a polyline.

    >>> path_length([[0.0, 0.0], [3.0, 4.0], [3.0, 5.0]])
    6.0
    """
    path = np.asarray(path_xy_m, dtype=np.float64).reshape(-1, 2)
    steps = np.diff(path, axis=0)
    return float(np.hypot(steps[:, 0], steps[:, 1]).sum())


def drop_coincident(path_xy_m: ArrayLike, tolerance_m: float = COINCIDENT_M) -> Points:
    """Return the path without points that are closer than `tolerance_m` to the last kept point.

    >>> drop_coincident([[0.0, 0.0], [0.001, 0.0], [1.0, 0.0]]).tolist()
    [[0.0, 0.0], [1.0, 0.0]]
    """
    path = np.asarray(path_xy_m, dtype=np.float64).reshape(-1, 2)
    return path[distinct(path, tolerance_m)]


def distinct(path_xy_m: Points, tolerance_m: float = COINCIDENT_M) -> NDArray[np.int64]:
    """Return the indices of the points that `drop_coincident` keeps, int64[n]."""
    steps = np.diff(path_xy_m, axis=0)
    count = len(path_xy_m)
    if count < 2 or bool((np.hypot(steps[:, 0], steps[:, 1]) >= tolerance_m).all()):
        return np.arange(count)
    kept = [0]
    for index in range(1, count):
        x, y = path_xy_m[index] - path_xy_m[kept[-1]]
        if math.hypot(x, y) >= tolerance_m:
            kept.append(index)
    return np.array(kept, dtype=np.int64)


def keep_within(
    at: NDArray[np.float64], values: NDArray[np.float64], tolerance: float, kept: NDArray[np.bool_]
) -> None:
    """Add to `kept` the samples that polylines need to stay within the tolerance of `values`, float64[k, n].

    `at` has the samples' positions along the polylines; `kept` contains both ends. Algorithm of D. H. Douglas
    and T. K. Peucker, "Algorithms for the reduction of the number of points required to represent a digitized
    line or its caricature", Cartographica 10 (1973).
    """
    parts = list(pairwise(np.flatnonzero(kept).tolist()))
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        share = (at[inner] - at[first]) / max(at[last] - at[first], 1e-9)
        line = values[:, [first]] + share * (values[:, [last]] - values[:, [first]])
        off = np.abs(values[:, inner] - line).max(axis=0)
        worst = int(off.argmax())
        if off[worst] > tolerance:
            middle = first + 1 + worst
            kept[middle] = True
            parts += [(first, middle), (middle, last)]
