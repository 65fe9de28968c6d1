"""A vehicle beyond the range of the ground station's radio: when it is to be heard again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.planners.path import Points
from wbf_mission.planning import FlightTask, PlanResult
from wbf_mission.scenario import VehicleOptions

SLOWER, SPARE_S = 1.2, 5.0
"""A flight beyond the range may take so much longer than expected, in parts and in seconds."""
_STEP_M, _MOST_STEPS = 0.5, 20_000
_WELL_INSIDE = 0.9
_SLOWEST_M_S = 0.1
ASIDE_S, WHOLE_S = 8.0, 2.0
"""So long may a change of the mission take, aside from it or as a whole; meanwhile it has to be in range."""


@dataclass(frozen=True, slots=True)
class Reach:
    """The range of the ground station's radio, as far as plans over ground go.

    Parameters
    ----------
    range_m : float
        In space.
    station_xy_m : tuple of float
        Where the ground station stands, in metres of the farm frame.
    height_m : float
        At which the vehicle flies above it.
    speed_m_s : float
        At which it flies.
    mean_speed_m_s : float
        Of its planned flight, turns included.
    """

    range_m: float
    station_xy_m: tuple[float, float]
    height_m: float
    speed_m_s: float
    mean_speed_m_s: float

    @property
    def radius_m(self) -> float:
        """How far it reaches over ground at the height of the flight; 0 if not so high."""
        return float(np.sqrt(max(self.range_m**2 - self.height_m**2, 0.0)))

    def absence_s(self, position_m: tuple[float, float], onward_m: Points) -> float:
        """Return after how long at most a vehicle that was heard here last is in range again.

        Parameters
        ----------
        position_m : tuple of float
        onward_m : float64[n, 2]
            Where it flies from there, the way home included.

        Returns
        -------
        float
            The time of the whole rest where that never comes back into range.

        Examples
        --------
        >>> reach = Reach(10.0, (0.0, 0.0), 0.0, 2.5, 2.0)
        >>> round(reach.absence_s((10.0, 0.0), np.array([[20.0, 0.0], [0.0, 0.0]])))
        18
        """
        path = np.vstack((position_m, np.asarray(onward_m, np.float64).reshape(-1, 2)))
        along_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))))
        total_m = float(along_m[-1])
        flown_m = np.linspace(0.0, total_m, 2 + int(total_m / max(_STEP_M, total_m / _MOST_STEPS)))
        x, y = (np.interp(flown_m, along_m, path[:, axis]) for axis in range(2))
        away_m = np.hypot(x - self.station_xy_m[0], y - self.station_xy_m[1])
        outside = away_m > self.radius_m
        length_m = 0.0
        if outside.any():
            left = int(np.argmax(outside))
            # Where it only grazes the border nothing may be heard of it.
            back = np.flatnonzero(away_m[left:] < _WELL_INSIDE * self.radius_m - _STEP_M)
            length_m = float(flown_m[left + back[0]]) if len(back) else total_m
        return SLOWER * length_m / self.mean_speed_m_s + SPARE_S

    def is_near_border(self, position_m: tuple[float, float], within_s: float) -> bool:
        """Return whether a vehicle may leave the range within some seconds."""
        distance_m = float(np.hypot(*np.subtract(position_m, self.station_xy_m)))
        return distance_m + within_s * self.speed_m_s > self.radius_m


def reach_of(options: VehicleOptions, task: FlightTask, plan: PlanResult) -> Reach | None:
    """Return how far the ground station at the farm's home reaches for a vehicle; None: everywhere."""
    if options.radio_range_m is None:
        return None
    level = task.builder.level
    speed_m_s = min(level.speed_m_s, task.builder.vehicle.top_speed_m_s)
    mean_m_s = max(plan.prediction.path_length_m / plan.prediction.duration_s, _SLOWEST_M_S)
    home_m = plan.farm.home_m
    return Reach(options.radio_range_m, home_m, level.altitude_m, speed_m_s, min(mean_m_s, speed_m_s))
