"""Flights that follow the ground: its heights about a farm, the vehicle's slopes, and what obstacles bar."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from geo import Farm, Obstacle
from geo.ground import Ground
from mission.model import Command, Frame, Mission
from mission.planners.heights import TOLERANCE_M, HeightProfile, slope
from mission.planners.path import Points
from sim_vehicle.airframe.spec import VehicleSpec
from wbf_mission.planning.conditions import FlightLevel

_AROUND_M = 300.0
# Of the ground's pixels, and at least so wide.
_STEPS_A_PIXEL, _FINEST_M = 2.0, 0.5
# Of the rates that the vehicle climbs and descends with: what wind and corners leave.
_OF_RATE = 0.8


def above_terrain(mission: Mission) -> Mission:
    """Return a mission whose waypoints' altitudes are above the terrain, which its autopilot follows."""
    items = tuple(
        replace(one, frame=int(Frame.GLOBAL_TERRAIN_ALT)) if one.command == Command.NAV_WAYPOINT else one
        for one in mission.items
    )
    return replace(mission, items=items)


@dataclass(frozen=True, slots=True, eq=False)
class FarmGround:
    """The heights of the ground of a farm, in metres of its frame."""

    farm: Farm
    ground: Ground

    @classmethod
    def read(cls, farm: Farm, home_m: tuple[float, float], files: tuple[str, ...]) -> FarmGround:
        """Read the rasters about a farm and home; GroundError as of `Ground.read`."""
        width, height = farm.width_cells * farm.cell_size_m, farm.height_cells * farm.cell_size_m
        x = np.array([0.0, width, home_m[0]])
        y = np.array([0.0, height, home_m[1]])
        low_x, high_x = x.min() - _AROUND_M, x.max() + _AROUND_M
        low_y, high_y = y.min() - _AROUND_M, y.max() + _AROUND_M
        latitude, longitude = farm.frame.to_wgs84(
            np.array([low_x, high_x, low_x, high_x]), np.array([low_y, low_y, high_y, high_y])
        )
        south, north = float(latitude.min()), float(latitude.max())
        west, east = float(longitude.min()), float(longitude.max())
        return cls(farm, Ground.read(files, (south, west, north, east)))

    def __call__(self, points_m: Points) -> NDArray[np.float64]:
        """Return the heights at points, float64[n, 2]."""
        return self.ground.heights(*self.farm.frame.to_wgs84(points_m[:, 0], points_m[:, 1]))

    @property
    def step_m(self) -> float:
        """How far apart the ground is looked at."""
        return max(self.ground.step_m / _STEPS_A_PIXEL, _FINEST_M)

    def profile(self, level: FlightLevel, vehicle: VehicleSpec, home_m: tuple[float, float]) -> HeightProfile:
        """Return how a vehicle follows the ground."""
        return HeightProfile(
            self,
            level.altitude_m,
            self.step_m,
            slope(_OF_RATE * vehicle.climb_speed_m_s, level.speed_m_s),
            slope(_OF_RATE * vehicle.descent_speed_m_s, level.speed_m_s),
            home_m,
        )

    def relief_m(self, obstacle: Obstacle, margin_m: float) -> float:
        """Return how much lower than the top's ground a flight over an obstacle may be, metres.

        An obstacle stands on the highest ground under it; a flight may be over the lowest, and as much lower
        as legs may deviate.
        """
        polygon = obstacle.widened(margin_m)
        low_x, low_y, high_x, high_y = polygon.bounds
        step = max(self.step_m, (high_x - low_x) / 200.0, (high_y - low_y) / 200.0)
        x, y = np.meshgrid(np.arange(low_x, high_x + step, step), np.arange(low_y, high_y + step, step))
        inside = shapely.contains_xy(polygon, x, y)
        corners = shapely.get_coordinates(polygon)
        heights = self(np.vstack((np.column_stack((x[inside], y[inside])), corners)))
        return float(np.ptp(heights)) + TOLERANCE_M
