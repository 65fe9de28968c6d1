"""Waypoints of a planned path for autopilots that turn before they reach a waypoint."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from mission.errors import PlanningError
from mission.planners.path import COINCIDENT_M, Area, Points, distinct

__all__ = ["Cornering", "Waypoints"]

_LEAST_LEG = 0.15  # Legs shorter than this many radii never overshoot
# Legs shorter than this many radii do not overshoot in a curve (at most 40 degrees a point), nor from a row
# to the next: between two longer legs there and back.
_SHORT_LEG = 0.75
_CURVED = math.cos(math.radians(40.0))
_BACK = -math.cos(math.radians(30.0))
# Nor do legs overshoot at a corner between two legs longer than this many radii: the part cut off is small,
# and a stop costs a vehicle seconds.
_LONG_LEG = 10.0
_BEFORE_M = 0.5  # Overshoot is the radius less this: a vehicle that turns before the corner swings less wide
_STRAIGHT = math.cos(math.radians(15.0))  # At smaller turns hardly anything is cut off


@dataclass(frozen=True, slots=True, eq=False)
class Waypoints:
    """The waypoints of a path."""

    points_m: Points  # float64[n, 2]: in metres of the farm frame
    of_point: NDArray[np.int64]  # int64[n]: number of the path's point of each waypoint, ascending
    radius_m: float  # Acceptance radius; 0: the autopilot's own
    loiters: NDArray[np.int64]  # int64[n]: number of times that the path repeats each point at once


@dataclass(frozen=True, slots=True)
class Cornering:
    """Turns of an autopilot at the corners of a path.

    PX4 turns to the next waypoint within the acceptance radius of a waypoint. The radius cannot be small,
    because the error of the height estimate counts in it: with 0.5 m a real PX4 hangs at waypoints for
    seconds. So that the camera still sees a path up to its corners, legs overshoot: they begin before their
    start and end beyond their end, by the radius less half a metre.

    Parameters
    ----------
    radius_m : float
        Acceptance radius of the waypoints; 0: the autopilot's own.
    overshoots : bool
        Whether legs overshoot, because the vehicle turns within the radius.

    Raises
    ------
    PlanningError
        If the radius is negative or not finite.

    Examples
    --------
    >>> rows = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 1.0], [0.0, 1.0]])
    >>> Cornering(2.0, overshoots=True).waypoints(rows, (0.0, 0.0)).points_m.tolist()
    [[-1.5, 0.0], [31.5, 0.0], [31.5, 1.0], [-1.5, 1.0]]
    """

    radius_m: float = 0.0
    overshoots: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.radius_m < math.inf:
            msg = f"mission: acceptance radius {self.radius_m} m must be a finite number, not below zero"
            raise PlanningError(msg)

    @property
    def overshoot_m(self) -> float:
        """Length by which legs overshoot."""
        return max(self.radius_m - _BEFORE_M, 0.0) if self.overshoots else 0.0

    def waypoints(
        self, path_m: Points, start_m: tuple[float, float] | None = None, *, avoid: Area | None = None
    ) -> Waypoints:
        """Return the waypoints of a path flown from `start_m`; no leg overshoots into the land to `avoid`.

        Points closer than 1 cm to the point before are loiters there.
        """
        of_point = distinct(path_m)
        points = path_m[of_point]
        loiters = np.diff(of_point, append=len(path_m)) - 1
        if self.overshoot_m > 0.0 and len(points):
            places, overshot = self._overshot(points, start_m, avoid)
            kept = distinct(overshot)
            # It stays at the last waypoint of a point.
            last = np.diff(places[kept], append=len(of_point)) > 0
            points, of_point, loiters = (
                overshot[kept],
                of_point[places[kept]],
                np.where(last, loiters[places[kept]], 0),
            )
        return Waypoints(points, of_point, self.radius_m, loiters)

    def _overshot(
        self, points: Points, start_m: tuple[float, float] | None, avoid: Area | None
    ) -> tuple[NDArray[np.int64], Points]:
        """Return the waypoints of overshooting legs, and the number of the point of each."""
        come, go = self._directions(points, start_m)
        # The end of the leg before, the start of the leg after, and the point itself.
        places = np.stack((points + self.overshoot_m * come, points - self.overshoot_m * go, points), axis=1)
        use = np.stack((come.any(axis=1), go.any(axis=1), np.ones(len(points), np.bool_)), axis=1)
        if avoid is not None:
            ways = np.stack((np.repeat(points[:, None], 2, axis=1), places[:, :2]), axis=2)
            use[:, :2] &= ~shapely.intersects(shapely.linestrings(ways), avoid)
        use[:, 2] = ~use[:, :2].any(axis=1)
        return np.nonzero(use)[0], places[use]

    def _directions(self, points: Points, start_m: tuple[float, float] | None) -> tuple[Points, Points]:
        """Return the directions of the legs to and from each point; zero for legs that do not overshoot."""
        flown = points if start_m is None else np.vstack((start_m, points))
        steps = np.diff(flown, axis=0)
        length_m = np.hypot(steps[:, 0], steps[:, 1])
        # A vehicle at the first point has no leg to it.
        every = np.where((length_m < COINCIDENT_M)[:, None], 0.0, steps / np.maximum(length_m, 1e-9)[:, None])
        as_planned = (length_m < _LEAST_LEG * self.radius_m) | self._between_rows(every, length_m)
        overshot = np.where(as_planned[:, None], 0.0, every)
        # Without a known start there is no leg to the first point; there is none from the last.
        before = 0 if start_m is not None else 1
        come, go = _at_both_ends(overshot, before)
        come_far, go_far = _at_both_ends(length_m > _LONG_LEG * self.radius_m, before)
        come_short, go_short = _at_both_ends(length_m < _SHORT_LEG * self.radius_m, before)
        along = (come * go).sum(axis=1)
        as_it_is, curved = (along > _STRAIGHT) | (come_far & go_far), along > _CURVED
        come[as_it_is | (curved & come_short)] = go[as_it_is | (curved & go_short)] = 0.0
        # The last point is no corner.
        if len(every):
            come[-1] = every[-1]
        return come, go

    def _between_rows(self, every: Points, length_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether each leg is the short way from the end of a row to the beginning of the next."""
        between = length_m < _SHORT_LEG * self.radius_m
        back = (every[:-2] * every[2:]).sum(axis=1) < _BACK
        between[1:-1] &= back & ~between[:-2] & ~between[2:]
        between[:1] = between[-1:] = False
        return between


def _at_both_ends(of_leg: NDArray[Any], before: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the values of the legs to and from each point; zero without a leg."""
    none = np.zeros((1, *of_leg.shape[1:]), of_leg.dtype)
    return np.concatenate((none[:before], of_leg)), np.concatenate((of_leg[1 - before :], none))
