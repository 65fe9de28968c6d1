"""Terrain following: ground heights around a farm, slope limits of a vehicle, relief at obstacles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import shapely
from numpy.typing import NDArray

from geo import Farm, Obstacle
from geo.errors import GroundError
from geo.imports import load_named
from mission.model import Command, Frame, Mission
from mission.planners.build import TOLERANCE_M, HeightProfile, slope
from mission.planners.path import Points
from sim_vehicle.airframe.spec import VehicleSpec
from wbf_mission.planning.conditions import FlightLevel

_AROUND_M = 300.0
# Ground samples per raster pixel, and least distance between samples (m).
_STEPS_A_PIXEL, _FINEST_M = 2.0, 0.5
# Usable fraction of climb and descent rates; wind and corners need the remainder.
_OF_RATE = 0.8


def above_terrain(mission: Mission) -> Mission:
    """Return the mission with waypoint altitudes above terrain, for an autopilot that follows the terrain."""
    items = tuple(
        replace(item, frame=int(Frame.GLOBAL_TERRAIN_ALT)) if item.command == Command.NAV_WAYPOINT else item
        for item in mission.items
    )
    return replace(mission, items=items)


class Ground(Protocol):
    """Terrain heights above mean sea level; an add-on reads them from rasters."""

    @property
    def step_m(self) -> float:
        """Width of the smallest pixel (m)."""

    def heights(
        self, latitude_deg: NDArray[np.float64], longitude_deg: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the heights at points (m); GroundError if no raster gives the height of a point."""


@dataclass(frozen=True, slots=True, eq=False)
class FarmGround:
    """Ground heights of a farm, for positions in the farm frame (m)."""

    farm: Farm
    ground: Ground

    @classmethod
    def read(cls, farm: Farm, home_m: tuple[float, float], files: tuple[str, ...]) -> FarmGround:
        """Read the rasters around a farm and home; GroundError if they cannot be read."""
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
        group = "wbf_mission.ground"
        read = load_named(group, "rasters", "reads heights of the ground from", "the ground", GroundError)
        return cls(farm, read(files, (south, west, north, east)))

    def __call__(self, points_m: Points) -> NDArray[np.float64]:
        """Return the ground heights at points, float64[n, 2] (m)."""
        return self.ground.heights(*self.farm.frame.to_wgs84(points_m[:, 0], points_m[:, 1]))

    @property
    def step_m(self) -> float:
        """Distance between samples of the ground (m)."""
        return max(self.ground.step_m / _STEPS_A_PIXEL, _FINEST_M)

    def profile(self, level: FlightLevel, vehicle: VehicleSpec, home_m: tuple[float, float]) -> HeightProfile:
        """Return the height profile by which a vehicle follows the ground."""
        return HeightProfile(
            self,
            level.altitude_m,
            self.step_m,
            slope(_OF_RATE * vehicle.climb_speed_m_s, level.speed_m_s),
            slope(_OF_RATE * vehicle.descent_speed_m_s, level.speed_m_s),
            home_m,
        )

    def relief_m(self, obstacle: Obstacle, margin_m: float) -> float:
        """Return the largest loss of height above an obstacle that terrain following can cause (m).

        The height of the obstacle counts from the highest ground under it. The flight may follow the lowest
        ground there, and legs may be lower than planned by the allowed deviation.
        """
        polygon = obstacle.widened(margin_m)
        low_x, low_y, high_x, high_y = polygon.bounds
        step = max(self.step_m, (high_x - low_x) / 200.0, (high_y - low_y) / 200.0)
        x, y = np.meshgrid(np.arange(low_x, high_x + step, step), np.arange(low_y, high_y + step, step))
        inside = shapely.contains_xy(polygon, x, y)
        corners = shapely.get_coordinates(polygon)
        heights = self(np.vstack((np.column_stack((x[inside], y[inside])), corners)))
        return float(np.ptp(heights)) + TOLERANCE_M
