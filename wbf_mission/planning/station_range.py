"""How far the radio of the ground station reaches, as far as plans over ground go."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.planners.path import Points
from mission.policies.observation import ContactArea
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import firmware_of
from wbf_mission.planning.conditions import FlightLevel

SLOWER, SPARE_S = 1.2, 5.0
"""A flight beyond the range may take so much longer than expected, in parts and in seconds."""
ENDING_S = 3.0
"""A policy is asked so long before a path ends."""
_STEP_M, _MOST_STEPS = 0.5, 20_000
_WELL_INSIDE = 0.9
_ASIDE_S, _WHOLE_S = 8.0, 2.0
"""So long may a change of the mission take, aside from it or as a whole; meanwhile it has to be in range."""
_HEARD_S = 2.0
"""So long after it came into range a vehicle is surely heard."""


@dataclass(frozen=True, slots=True)
class StationRange:
    """The range of the ground station's radio, as far as plans over ground go."""

    range_m: float  # In space
    station_xy_m: tuple[float, float]  # Where the ground station stands, in metres of the farm frame
    height_m: float  # At which the vehicle flies above it
    speed_m_s: float  # At which it flies
    leaves_mission: bool = False  # Whether it leaves its mission while that is changed (ArduPilot)

    @classmethod
    def of(
        cls, range_m: float, station_xy_m: tuple[float, float], level: FlightLevel, vehicle: VehicleSpec
    ) -> StationRange:
        """Return how far a radio in this place reaches for a vehicle that flies so."""
        firmware = firmware_of(vehicle)
        aside = {} if firmware is None else firmware.profile.change_modes or {}
        leaves = firmware is not None and firmware.mavlink.identity.mav_type in aside
        speed_m_s = min(level.speed_m_s, vehicle.top_speed_m_s)
        return cls(range_m, station_xy_m, level.altitude_m, speed_m_s, leaves)

    @property
    def radius_m(self) -> float:
        """How far it reaches over ground at the height of the flight; 0 if not so high."""
        return float(np.sqrt(max(self.range_m**2 - self.height_m**2, 0.0)))

    def absence_s(self, position_m: tuple[float, float], onward_m: Points, mean_speed_m_s: float) -> float:
        """Return after how long at most a vehicle that was heard here last is in range again.

        Examples
        --------
        >>> station = StationRange(10.0, (0.0, 0.0), 0.0, 2.5)
        >>> round(station.absence_s((10.0, 0.0), np.array([[20.0, 0.0], [0.0, 0.0]]), 2.0))
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
        return SLOWER * length_m / min(mean_speed_m_s, self.speed_m_s) + SPARE_S

    def is_near_border(self, position_m: tuple[float, float], delay_s: float = 0.0) -> bool:
        """Return whether a vehicle may leave the range before a change of its mission is over.

        Until it turned it took `delay_s` so far.
        """
        distance_m = float(np.hypot(*np.subtract(position_m, self.station_xy_m)))
        return distance_m + (self._change_s + delay_s) * self.speed_m_s > self.radius_m

    def contact_area(self, delay_s: float = 0.0) -> ContactArea:
        """Return where a path has to end so that its vehicle is heard and told of another one before.

        It is asked for a moment before the end. Then the vehicle must have come into range, and must not be
        able to leave it while the change lasts.
        """
        deep_s = ENDING_S + max(self._change_s + 2.0 * delay_s, _HEARD_S)
        return ContactArea(self.station_xy_m, self.radius_m - deep_s * self.speed_m_s)

    @property
    def _change_s(self) -> float:
        return _ASIDE_S if self.leaves_mission else _WHOLE_S
