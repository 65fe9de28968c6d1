"""Separation of vehicles: refuses new paths that lead a vehicle too close to another vehicle."""

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
"""Timing error of a predicted position: a constant (s) plus this fraction of the predicted time."""
MARGIN_M = 1.0
"""Allowance for deviations from the path in gusts (m)."""

Positions = NDArray[np.float64]
_WINDOW_S = 10
_ALOFT = (Status.CLIMBING, Status.FLYING, Status.CHANGING, Status.SILENT, Status.RETURNING)


def least_apart_m(first: Positions, second: Positions, later_s: float = 0.0) -> float:
    """Return the least horizontal distance (m) between two vehicles, allowing for timing errors.

    `first` and `second` are positions at each full second, float64[n, 2]. The second vehicle starts
    `later_s` after the first.

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
    """Check that new paths keep a least distance between vehicles in flight.

    Positions are predicted along each vehicle's path and then home, at a constant speed.
    """

    distance_m: float
    # Speeds by system id. Vehicles without an entry are ignored.
    speeds_m_s: Mapping[int, float]
    separation_margin_m: float = 0.0  # Allowance for the error of the measured distance between two vehicles

    def refusals(self, vehicles: Sequence[VehicleReport], paths: Mapping[int, Points]) -> dict[int, str]:
        """Return the system ids of refused paths with the reasons.

        A path is refused if it leads closer to another vehicle than `distance_m` plus the margins, and also
        closer than the vehicle's current path does. Paths are checked in the order of system ids, each
        against the paths accepted before it.
        """
        flying = {
            vehicle.system_id: vehicle
            for vehicle in vehicles
            if vehicle.status in _ALOFT and vehicle.system_id in self.speeds_m_s
        }
        tracks = {number: self._track(vehicle, vehicle.rest_m) for number, vehicle in flying.items()}
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
        nearest = min(apart, key=lambda system_id: apart[system_id], default=0)
        return nearest, apart.get(nearest, float("inf"))

    def _track(self, vehicle: VehicleReport, rest_m: Points) -> Positions:
        """Return the predicted positions at each full second from now until the vehicle is home."""
        points = np.vstack((vehicle.position_m, rest_m, vehicle.request.start_xy_m))
        along_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
        speed_m_s = self.speeds_m_s[vehicle.system_id]
        # A silent vehicle's last known position is old, so its prediction starts farther along the path.
        since_m = speed_m_s * vehicle.age_s if vehicle.status is Status.SILENT else 0.0
        now_m = np.arange(min(since_m, along_m[-1]), along_m[-1] + 1e-9, speed_m_s)
        return np.column_stack([np.interp(now_m, along_m, points[:, axis]) for axis in range(2)])
