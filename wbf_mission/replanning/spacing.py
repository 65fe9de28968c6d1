"""New paths on which a vehicle would come too near to another one are not flown."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from mission.planners.path import Points
from mission.policies.observation import Status, VehicleReport

TOLERANCE_S, TOLERANCE_SHARE = 3.0, 0.12
"""A vehicle may be so much earlier or later than predicted, and by so much of the time that it has flown."""
MARGIN_M = 1.0
"""Gusts push it so far from its path."""

Positions = NDArray[np.float64]
_WINDOW_S = 10
_ALOFT = (Status.CLIMBING, Status.FLYING, Status.CHANGING, Status.SILENT, Status.RETURNING)


def least_apart_m(first: Positions, second: Positions, later_s: float = 0.0) -> float:
    """Return how near two vehicles come to each other over ground if each may be a little early or late.

    Examples
    --------
    >>> along = np.column_stack((np.arange(20.0), np.zeros(20)))
    >>> least_apart_m(along, along[::-1] + [0.0, 5.0]), least_apart_m(along, along, 60.0)
    (5.0, inf)
    """
    least = float("inf")
    for begin in range(0, len(first), _WINDOW_S):
        end = begin + _WINDOW_S
        tolerance = TOLERANCE_S + TOLERANCE_SHARE * max(end, end - later_s)
        low, high = begin - later_s - tolerance, end - later_s + tolerance
        if high < 0.0 or low > len(second) - 1:
            continue
        there = second[max(0, math.floor(low)) : math.ceil(high) + 1]
        least = min(least, float(shapely.distance(_line(first[begin : end + 1]), _line(there))))
    return least


def _line(points: Positions) -> shapely.Geometry:
    return shapely.LineString(points) if len(points) > 1 else shapely.Point(points[0])


@dataclass(frozen=True, slots=True)
class KeptDistance:
    """The distance that vehicles keep in flight.

    Vehicles are taken to fly along their paths and then home at their speeds.
    """

    distance_m: float
    # By system id; a vehicle that is not there keeps no distance and need not be kept from.
    speeds_m_s: Mapping[int, float]
    separation_margin_m: float = 0.0  # How much nearer to each other two vehicles may be than they believe

    def refusals(self, vehicles: Sequence[VehicleReport], paths: Mapping[int, Points]) -> dict[int, str]:
        """Return which new paths must not be flown, and why.

        A path is refused if it leads nearer to another vehicle than the distance, and nearer than the
        present path does. Those of smaller system ids go first.
        """
        flying = {
            one.system_id: one
            for one in vehicles
            if one.status in _ALOFT and one.system_id in self.speeds_m_s
        }
        tracks = {number: self._track(one, one.rest_m) for number, one in flying.items()}
        refused = {}
        for number in sorted(flying.keys() & paths.keys()):
            new = self._track(flying[number], paths[number])
            near, apart = self._nearest(new, number, tracks)
            if (
                apart < self.distance_m + self.separation_margin_m + MARGIN_M
                and apart < self._nearest(tracks[number], number, tracks)[1]
            ):
                refused[number] = f"it would come within {apart:.1f} m of vehicle {near}"
            else:
                tracks[number] = new
        return refused

    @staticmethod
    def _nearest(track: Positions, number: int, tracks: Mapping[int, Positions]) -> tuple[int, float]:
        apart = {other: least_apart_m(track, theirs) for other, theirs in tracks.items() if other != number}
        nearest = min(apart, key=lambda one: apart[one], default=0)
        return nearest, apart.get(nearest, float("inf"))

    def _track(self, vehicle: VehicleReport, rest_m: Points) -> Positions:
        """Return where a vehicle is at each full second from now on, until it is home."""
        points = np.vstack((vehicle.position_m, rest_m, vehicle.request.start_xy_m))
        along_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
        speed_m_s = self.speeds_m_s[vehicle.system_id]
        # What was heard last of a silent vehicle is long ago.
        since_m = speed_m_s * vehicle.age_s if vehicle.status is Status.SILENT else 0.0
        now_m = np.arange(min(since_m, along_m[-1]), along_m[-1] + 1e-9, speed_m_s)
        return np.column_stack([np.interp(now_m, along_m, points[:, axis]) for axis in range(2)])
