"""Radio range of the ground station: the horizontal distance that it reaches at flight height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.planners.path import Points
from mission.policies.observation import ContactArea
from sim_vehicle.airframe.spec import VehicleSpec
from sim_vehicle.autopilot import firmware_of
from wbf_mission.planning.conditions import FlightLevel

SLOWER, SPARE_S = 1.2, 5.0
"""A flight beyond radio range may take this factor longer than predicted, plus these seconds."""
ENDING_S = 3.0
"""A policy is asked for the next path this many seconds before the end of a path."""
_STEP_M, _MOST_STEPS = 0.5, 20_000
_WELL_INSIDE = 0.9
_ASIDE_S, _WHOLE_S = 8.0, 2.0
"""Largest duration of a mission change (s): `_ASIDE_S` if the vehicle leaves its mission for the change, and
otherwise `_WHOLE_S`. The vehicle must stay in radio range during the change."""
_HEARD_S = 2.0
"""A vehicle is certainly heard this many seconds after it enters radio range."""


@dataclass(frozen=True, slots=True)
class StationRange:
    """Radio range of the ground station, for paths at one height and speed."""

    range_m: float  # Slant range of the radio.
    station_xy_m: tuple[float, float]  # Position of the ground station, in metres of the farm frame.
    height_m: float  # Flight height above the ground station.
    speed_m_s: float  # Speed of the flight.
    leaves_mission: bool = False  # Whether the vehicle leaves its mission during a change (ArduPilot).

    @classmethod
    def of(
        cls, range_m: float, station_xy_m: tuple[float, float], level: FlightLevel, vehicle: VehicleSpec
    ) -> StationRange:
        """Return the range of a radio at `station_xy_m` for a vehicle at a flight level."""
        firmware = firmware_of(vehicle)
        aside = {} if firmware is None else firmware.profile.change_modes or {}
        leaves = firmware is not None and firmware.mavlink.identity.mav_type in aside
        speed_m_s = min(level.speed_m_s, vehicle.top_speed_m_s)
        return cls(range_m, station_xy_m, level.altitude_m, speed_m_s, leaves)

    @property
    def radius_m(self) -> float:
        """Horizontal range at flight height (m); 0 if the flight height exceeds the slant range."""
        return float(np.sqrt(max(self.range_m**2 - self.height_m**2, 0.0)))

    def absence_s(self, position_m: tuple[float, float], onward_m: Points, mean_speed_m_s: float) -> float:
        """Return how long a vehicle, last heard at `position_m`, may stay out of range (s).

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
            # A path that only grazes the border may give no contact.
            back = np.flatnonzero(away_m[left:] < _WELL_INSIDE * self.radius_m - _STEP_M)
            length_m = float(flown_m[left + back[0]]) if len(back) else total_m
        return SLOWER * length_m / min(mean_speed_m_s, self.speed_m_s) + SPARE_S

    def is_near_border(self, position_m: tuple[float, float], delay_s: float = 0.0) -> bool:
        """Return whether a vehicle may leave radio range during a change of its mission.

        `delay_s` is the usual time between sending a change and the vehicle's turn.
        """
        distance_m = float(np.hypot(*np.subtract(position_m, self.station_xy_m)))
        return distance_m + (self._change_s + delay_s) * self.speed_m_s > self.radius_m

    def contact_area(self, delay_s: float = 0.0) -> ContactArea:
        """Return the area in which a path must end, so that the vehicle receives its next path in time.

        The next path is decided shortly before the end of the present path. The vehicle must be in range at
        that decision, and stay in range until its mission is changed.
        """
        deep_s = ENDING_S + max(self._change_s + 2.0 * delay_s, _HEARD_S)
        return ContactArea(self.station_xy_m, self.radius_m - deep_s * self.speed_m_s)

    @property
    def _change_s(self) -> float:
        return _ASIDE_S if self.leaves_mission else _WHOLE_S
