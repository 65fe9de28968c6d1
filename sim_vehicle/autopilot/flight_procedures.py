"""The part of a flight that the autopilot decides: dynamics, take-off, return, landing, and parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from sim_vehicle.motion.legs import KEEP, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.parameters import ParameterSpec
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind


class FlightProcedures(Protocol):
    """The flight procedures of a firmware. One object serves all vehicles; they differ by their spec."""

    name: str
    parameters: Mapping[str, ParameterSpec]

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle with what parameters decide of its values (radii, speeds, heights)."""

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion of a vehicle that stands at home."""

    def takeoff_legs(
        self, spec: VehicleSpec, here: Position, target: Position, speed: float, heading: Heading
    ) -> list[Leg]:
        """Return the legs from the ground to the end of a take-off item."""

    def landing_legs(self, spec: VehicleSpec, above: Position, last: Position, speed: float) -> list[Leg]:
        """Return the legs from ``last`` to the height ``above[2]`` over a position and down to the ground."""

    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Return the legs home and down.

        ``return_point`` is home or another position to return to, and the least height of the path there if
        that is more than the return altitude.
        """


def vertical_landing(spec: VehicleSpec, x_m: float, y_m: float) -> Leg:
    """Return the last leg of a landing: straight down to the ground at a position (east, north)."""
    down = spec.landing_speed_m_s
    return Leg((x_m, y_m, 0.0), None, heading=KEEP, kind=LegKind.LAND, vertical_speed_m_s=down)
