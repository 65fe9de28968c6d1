"""No autopilot in particular: straight up, straight home, straight down; and the paper's ideal robot."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING

from sim_vehicle.execution.legs import ALONG, KEEP
from sim_vehicle.motion.model import LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot.model import Setting
    from sim_vehicle.execution.legs import Place, Row
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind

SLOW_LANDING_M = 5.0


class GenericAutopilot:
    """See `sim_vehicle.autopilot.model.FlightProcedures`."""

    name = "generic"
    settings: Mapping[str, Setting] = MappingProxyType({})

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle as it is: there are no parameters."""
        return spec

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion of a vehicle that stands at home."""
        if spec.is_ideal:
            from sim_vehicle.motion.ideal import IdealRobot

            return IdealRobot(spec, yaw_rad)
        from sim_vehicle.motion.multirotor.model import Multirotor

        return Multirotor(spec, wind, yaw_rad)

    def takeoff_rows(
        self, spec: VehicleSpec, here: Place, target: Place, speed: float, heading: float
    ) -> list[Row]:
        """Return the legs of a take-off: straight up, then to its place if that is aside."""
        x, y, z = target
        radius = spec.acceptance_radius_m
        keep = KEEP if math.isnan(heading) else heading
        height = max(z, here[2])
        rows: list[Row] = [(here[0], here[1], height, radius, speed, keep, 0.0, LegKind.TAKEOFF)]
        if math.hypot(x - here[0], y - here[1]) > radius:
            rows.append((x, y, z, radius, speed, heading, 0.0))
        return rows

    def landing_rows(self, spec: VehicleSpec, above: Place, last: Place, speed: float) -> list[Row]:
        """Return the legs to a place and down to the ground there, the last 5 m slowly."""
        x, y, z = above
        rows: list[Row] = []
        if math.hypot(x - last[0], y - last[1]) > 0.05:
            rows.append((x, y, z, 0.0, speed, ALONG, 0.0, LegKind.HOME))
        if z > SLOW_LANDING_M:
            rows.append((x, y, SLOW_LANDING_M, 0.3, -spec.descent_speed_m_s, KEEP, 0.0, LegKind.DESCEND))
        rows.append((x, y, 0.0, 0.0, -spec.landing_speed_m_s, KEEP, 0.0, LegKind.LAND))
        return rows

    def return_rows(self, spec: VehicleSpec, last: Place, speed: float, haven: Place) -> list[Row]:
        """Return the legs home: up to the return altitude unless home is right below, over home, and down."""
        x, y, z = last
        home_x, home_y, least = haven
        if math.hypot(x - home_x, y - home_y) <= spec.acceptance_radius_m:
            return self.landing_rows(spec, (home_x, home_y, z), last, speed)
        rows: list[Row] = []
        least = max(least, spec.return_altitude_m)
        if z < least:
            z = least
            rows.append((x, y, z, spec.acceptance_radius_m, speed, KEEP, 0.0, LegKind.CLIMB))
        return rows + self.landing_rows(spec, (home_x, home_y, z), (x, y, z), speed)


GENERIC = GenericAutopilot()
