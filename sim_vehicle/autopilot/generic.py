"""No autopilot in particular: straight up, straight home, straight down; and the paper's ideal robot."""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.flight_procedures import vertical_landing
from sim_vehicle.motion.legs import ALONG, KEEP, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.parameters import ParameterSpec
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind

SLOW_LANDING_M = 5.0


class GenericProcedures:
    """See `sim_vehicle.autopilot.flight_procedures.FlightProcedures`."""

    name = "generic"
    parameters: Mapping[str, ParameterSpec] = MappingProxyType({})

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

    def takeoff_legs(
        self, spec: VehicleSpec, here: Position, target: Position, speed: float, heading: Heading
    ) -> list[Leg]:
        """Return the legs of a take-off: straight up, then to its position if that is aside."""
        x, y, z = target
        radius = spec.acceptance_radius_m
        keep = KEEP if heading == ALONG else heading
        height = max(z, here[2])
        legs = [Leg((here[0], here[1], height), speed, radius, keep, LegKind.TAKEOFF)]
        if math.hypot(x - here[0], y - here[1]) > radius:
            legs.append(Leg((x, y, z), speed, radius, heading))
        return legs

    def landing_legs(self, spec: VehicleSpec, above: Position, last: Position, speed: float) -> list[Leg]:
        """Return the legs to a position and down to the ground there, the last 5 m slowly."""
        x, y, z = above
        legs: list[Leg] = []
        if math.hypot(x - last[0], y - last[1]) > 0.05:
            legs.append(Leg((x, y, z), speed, kind=LegKind.HOME))
        if z > SLOW_LANDING_M:
            low = (x, y, SLOW_LANDING_M)
            down = spec.descent_speed_m_s
            legs.append(Leg(low, None, 0.3, KEEP, LegKind.DESCEND, vertical_speed_m_s=down))
        legs.append(vertical_landing(spec, x, y))
        return legs

    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Return the legs home: up to the return altitude unless home is right below, over home, and down."""
        x, y, z = last
        home_x, home_y, least = return_point
        if math.hypot(x - home_x, y - home_y) <= spec.acceptance_radius_m:
            return self.landing_legs(spec, (home_x, home_y, z), last, speed)
        legs: list[Leg] = []
        least = max(least, spec.return_altitude_m)
        if z < least:
            z = least
            legs.append(Leg((x, y, z), speed, spec.acceptance_radius_m, KEEP, LegKind.CLIMB))
        return legs + self.landing_legs(spec, (home_x, home_y, z), (x, y, z), speed)


GENERIC = GenericProcedures()
