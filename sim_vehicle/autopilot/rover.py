"""Procedures common to rovers under any autopilot: the compiled motion; they drive straight and stop."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from sim_vehicle.airframe.parameters import parameter_value
from sim_vehicle.motion.legs import Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.parameters import ParameterSpec
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.motion.rover.model import RoverLimits
    from sim_vehicle.weather.wind import Wind

__all__ = ["RoverProcedures"]


class RoverProcedures(ABC):
    """Procedures of a firmware for rovers; see `sim_vehicle.autopilot.flight_procedures.FlightProcedures`."""

    name: str
    parameters: Mapping[str, ParameterSpec]

    @abstractmethod
    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Vehicle with the values that parameters decide."""

    @abstractmethod
    def limits(self, spec: VehicleSpec) -> RoverLimits:
        """Limits of a vehicle's driving."""

    def value(self, spec: VehicleSpec, name: str) -> float:
        """Value of a parameter for a vehicle, in the parameter's own unit."""
        return parameter_value(spec, name, self.parameters)

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Motion of a vehicle that stands at home."""
        from sim_vehicle.motion.rover.model import Rover

        return Rover(spec, self.limits, wind, yaw_rad)

    def takeoff_legs(
        self,
        spec: VehicleSpec,  # noqa: ARG002
        here: Position,
        target: Position,  # noqa: ARG002
        speed: float,
        heading: Heading,  # noqa: ARG002
    ) -> list[Leg]:
        """A leg that is done at once: there is nothing to take off."""
        return [Leg((here[0], here[1], 0.0), speed, kind=LegKind.TAKEOFF)]

    def landing_legs(
        self,
        spec: VehicleSpec,  # noqa: ARG002
        above: Position,
        last: Position,  # noqa: ARG002
        speed: float,
    ) -> list[Leg]:
        """Route to the position, where it stops."""
        return [Leg((above[0], above[1], 0.0), speed, kind=LegKind.HOME)]

    def return_legs(
        self,
        spec: VehicleSpec,  # noqa: ARG002
        last: Position,  # noqa: ARG002
        speed: float,
        return_point: Position,
    ) -> list[Leg]:
        """Route home, where it stops."""
        return [Leg((return_point[0], return_point[1], 0.0), speed, kind=LegKind.HOME)]
