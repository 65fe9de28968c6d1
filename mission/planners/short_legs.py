"""Removal of short legs: an autopilot skips waypoints when several fall within its acceptance radius."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mission.planners.path import Points, path_length
from mission.planners.terrain import Terrain

# Candidate shifts of a corner, across and along the transit, in multiples of the least leg.
_ASIDE = (0.25, 0.5, 1.0, 1.5, 2.0)
_ALONG = (0.0, -0.5, 0.5, -1.0, 1.0)
# Points closer to the direct leg are dropped: the autopilot cuts corners by as much anyway (in least legs).
_NEAR = 0.5


def without_short_legs(points: Points, corner: NDArray[np.bool_], least_m: float, terrain: Terrain) -> Points:
    """Return the path without short legs next to a transit corner or next to another short leg.

    `corner`, bool[n], marks the points that are corners of transits between rows. Legs below `least_m` are
    short. Transit corners on the border are moved into the land, and points close to the path are removed.
    Short legs remain where neither is possible. A single short leg from row to row is kept.
    """
    k = 0
    while k < len(points) - 1:
        bad = _bad(points, corner, least_m)
        if not bad[k:].any():
            break
        k += int(np.argmax(bad[k:]))
        count = int(bad.sum())
        found = [
            (left, path_length(other), other, corners)
            for other, corners in _changed(points, corner, k, least_m, terrain)
            if (left := int(_bad(other, corners, least_m).sum())) < count
        ]
        if found:
            *_, points, corner = min(found, key=lambda change: change[:2])
            k = max(k - 2, 0)
        else:
            k += 1
    return points


def _bad(points: Points, corner: NDArray[np.bool_], least_m: float) -> NDArray[np.bool_]:
    """Return whether each leg is short and next to a transit corner or another short leg, bool[n - 1]."""
    short = np.hypot(*np.diff(points, axis=0).T) < least_m
    beside = corner[:-1] | corner[1:]
    beside[1:] |= short[:-1]
    beside[:-1] |= short[1:]
    bad: NDArray[np.bool_] = short & beside
    return bad


def _changed(
    points: Points, corner: NDArray[np.bool_], k: int, least_m: float, terrain: Terrain
) -> Iterator[tuple[Points, NDArray[np.bool_]]]:
    """Yield paths that differ at leg k, with their `corner` arrays."""
    for j in (k, k + 1):
        if not 0 < j < len(points) - 1:
            continue
        first, last = j, j
        if corner[j]:
            # All corners of a transit between two rows are replaced by a single corner.
            while first > 1 and corner[first - 1]:
                first -= 1
            while last < len(points) - 2 and corner[last + 1]:
                last += 1
            before, after = points[first - 1], points[last + 1]
            for place in _moved(before, points[first : last + 1], after, least_m, terrain):
                yield (
                    np.vstack((points[:first], place, points[last + 1 :])),
                    np.concatenate((corner[:first], [True], corner[last + 1 :])),
                )
        before, after = points[j - 1], points[j + 1]
        if _distance(points[j], before, after) <= _NEAR * least_m and terrain.sees(before, after)[0]:
            yield np.delete(points, j, axis=0), np.delete(corner, j)


def _moved(before: Points, way: Points, after: Points, least_m: float, terrain: Terrain) -> Points:
    """Return candidate positions for one corner that replaces a transit, `least_m` from its ends."""
    along = after - before
    along = along / max(float(np.hypot(*along)), 1e-9)
    across = np.array((-along[1], along[0]))
    side = np.sign(((way - before) * across).sum(axis=1))
    shifts = least_m * np.array([(aside, ahead) for aside in _ASIDE for ahead in _ALONG])
    places = np.vstack(
        [
            point + shifts[:, :1] * (sign or 1.0) * across + shifts[:, 1:] * along
            for point, sign in zip(way, side, strict=True)
        ]
    )
    far = (np.hypot(*(places - before).T) >= least_m) & (np.hypot(*(places - after).T) >= least_m)
    places = places[far]
    seen = terrain.sees(np.broadcast_to(before, places.shape), places)
    seen &= terrain.sees(places, np.broadcast_to(after, places.shape))
    found: Points = places[seen]
    return found


def _distance(point: Points, start: Points, end: Points) -> float:
    """Return the distance from a point to a leg."""
    leg = end - start
    share = float(((point - start) * leg).sum()) / max(float((leg * leg).sum()), 1e-12)
    return float(np.hypot(*(start + min(max(share, 0.0), 1.0) * leg - point)))
