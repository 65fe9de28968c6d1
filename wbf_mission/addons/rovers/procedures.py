"""Procedures of a rover's autopilot: motion, return, stop."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

from sim_vehicle.autopilot.procedures import FlightProcedures
from sim_vehicle.motion.legs import Heading, Leg, LegKind, Position

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind
    from wbf_mission.addons.rovers.motion.layout import RoverLimits


class RoverProcedures(FlightProcedures):
    """Procedures of a rover's firmware, with the compiled motion: straight legs and stops."""

    @abstractmethod
    def limits(self, spec: VehicleSpec) -> RoverLimits:
        """Return the driving limits of a vehicle."""

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion of a vehicle at rest at home."""
        from wbf_mission.addons.rovers.motion.model import Rover

        return Rover(spec, self.limits, wind, yaw_rad)

    def takeoff_legs(
        self, spec: VehicleSpec, here: Position, target: Position, speed: float, heading: Heading
    ) -> list[Leg]:
        """Return a leg without effect, because rovers do not take off."""
        return [Leg((here[0], here[1], 0.0), speed, kind=LegKind.TAKEOFF)]

    def landing_legs(self, spec: VehicleSpec, above: Position, last: Position, speed: float) -> list[Leg]:
        """Return a leg to the position, with a stop at the end."""
        return [Leg((above[0], above[1], 0.0), speed, kind=LegKind.HOME)]

    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Return a leg home, with a stop at the end."""
        return self.landing_legs(spec, return_point, last, speed)
