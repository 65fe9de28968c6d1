"""Waypoints for autopilots that turn before they reach a waypoint."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from mission.errors import PlanningError
from mission.planners.path import COINCIDENT_M, Area, Points, distinct

# The lengths of legs are in multiples of the acceptance radius.
_LEAST_LEG = 0.15  # Shorter legs never overshoot.
_SHORT_LEG = 0.75  # Shorter legs do not overshoot in a curve or between two antiparallel rows.
_CURVED = math.cos(math.radians(40.0))  # Smaller turns are part of a curve.
_BACK = -math.cos(math.radians(30.0))
# Legs do not overshoot at a corner between two legs longer than this: the vehicle cuts off little there.
_LONG_LEG = 10.0
_BEFORE_M = 0.5  # Radius minus overshoot. A vehicle that turns shortly before a corner swings out less.
_STRAIGHT = math.cos(math.radians(15.0))  # In smaller turns the vehicle cuts off almost nothing.


@dataclass(frozen=True, slots=True, eq=False)
class Waypoints:
    """The waypoints of a planned path."""

    points_m: Points  # Positions in metres of the farm frame, float64[n, 2].
    of_point: NDArray[np.int64]  # Index of the path point of each waypoint, ascending, int64[n].
    radius_m: float  # Acceptance radius; 0: the autopilot's default.
    loiters: NDArray[np.int64]  # Number of immediate repetitions of each point in the path, int64[n].


@dataclass(frozen=True, slots=True)
class Cornering:
    """The way an autopilot turns at the corners of a path.

    PX4 turns to the next waypoint as soon as the vehicle is inside the acceptance radius. The radius cannot
    be small, because it must exceed the error of the height estimate: with a radius of 0.5 m a real PX4 waits
    at waypoints for seconds. Legs therefore overshoot the corners, so that the camera covers the path up to
    the corners: the radius minus 0.5 m is added at both ends of each leg.

    Parameters
    ----------
    radius_m : float
        Acceptance radius of the waypoints; 0: the autopilot's default radius.
    overshoots : bool
        Whether legs are extended beyond corners, for a vehicle that turns inside the radius.

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
        """Length of the overshoot at each end of a leg."""
        return max(self.radius_m - _BEFORE_M, 0.0) if self.overshoots else 0.0

    def waypoints(
        self, path_m: Points, start_m: tuple[float, float] | None = None, *, avoid: Area | None = None
    ) -> Waypoints:
        """Return the waypoints of a path flown from `start_m`, without overshoots into the land `avoid`.

        A point within 1 cm of the previous point counts as a loiter at that point.
        """
        of_point = distinct(path_m)
        points = path_m[of_point]
        loiters = np.diff(of_point, append=len(path_m)) - 1
        if self.overshoot_m > 0.0 and len(points):
            places, overshot = self._overshot(points, start_m, avoid)
            kept = distinct(overshot)
            # If a path point has several waypoints, only the last of these has the loiter.
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
        """Return the waypoints with overshoots, each preceded by the index of its path point."""
        come, go = self._directions(points, start_m)
        # Each point has three candidates: end of the incoming leg, start of the outgoing leg, itself.
        places = np.stack((points + self.overshoot_m * come, points - self.overshoot_m * go, points), axis=1)
        use = np.stack((come.any(axis=1), go.any(axis=1), np.ones(len(points), np.bool_)), axis=1)
        if avoid is not None:
            ways = np.stack((np.repeat(points[:, None], 2, axis=1), places[:, :2]), axis=2)
            use[:, :2] &= ~shapely.intersects(shapely.linestrings(ways), avoid)
        use[:, 2] = ~use[:, :2].any(axis=1)
        return np.nonzero(use)[0], places[use]

    def _directions(self, points: Points, start_m: tuple[float, float] | None) -> tuple[Points, Points]:
        """Return unit vectors of the legs to and from each point; a leg that does not overshoot has zeros."""
        flown = points if start_m is None else np.vstack((start_m, points))
        steps = np.diff(flown, axis=0)
        length_m = np.hypot(steps[:, 0], steps[:, 1])
        # If the start is at the first point, the leg between them has zero length and no direction.
        every = np.where((length_m < COINCIDENT_M)[:, None], 0.0, steps / np.maximum(length_m, 1e-9)[:, None])
        as_planned = (length_m < _LEAST_LEG * self.radius_m) | self._between_rows(every, length_m)
        overshot = np.where(as_planned[:, None], 0.0, every)
        # If the start is unknown, the first point has no incoming leg. The last point has no outgoing leg.
        before = 0 if start_m is not None else 1
        come, go = _at_both_ends(overshot, before)
        come_far, go_far = _at_both_ends(length_m > _LONG_LEG * self.radius_m, before)
        come_short, go_short = _at_both_ends(length_m < _SHORT_LEG * self.radius_m, before)
        along = (come * go).sum(axis=1)
        as_it_is, curved = (along > _STRAIGHT) | (come_far & go_far), along > _CURVED
        come[as_it_is | (curved & come_short)] = go[as_it_is | (curved & go_short)] = 0.0
        # The last point is not a corner, so the leg to it always overshoots.
        if len(every):
            come[-1] = every[-1]
        return come, go

    def _between_rows(self, every: Points, length_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether each leg is a short connection from the end of a row to the next row."""
        between = length_m < _SHORT_LEG * self.radius_m
        back = (every[:-2] * every[2:]).sum(axis=1) < _BACK
        between[1:-1] &= back & ~between[:-2] & ~between[2:]
        between[:1] = between[-1:] = False
        return between


def _at_both_ends(of_leg: NDArray[Any], before: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return, for each point, the values of the leg to it and of the leg from it; zero without a leg."""
    none = np.zeros((1, *of_leg.shape[1:]), of_leg.dtype)
    return np.concatenate((none[:before], of_leg)), np.concatenate((of_leg[1 - before :], none))
