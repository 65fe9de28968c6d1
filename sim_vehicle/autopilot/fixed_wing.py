"""Flight procedures common to fixed wings under any autopilot: the compiled motion, the approach."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING

from sim_vehicle.airframe.parameters import parameter_value
from sim_vehicle.motion.legs import KEEP, Circle, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.parameters import ParameterSpec
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.fixed_wing.limits import ArduPlaneControl, FixedWingLimits
    from sim_vehicle.motion.legs import Heading, Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind

__all__ = ["ROLL_M_S2", "THROW_M_S2", "THROW_SHARE", "FixedWingProcedures", "in_order"]

THROW_M_S2 = 20.0
"""Acceleration of a thrown or catapulted take-off."""
ROLL_M_S2 = 3.0
"""Acceleration of a take-off that rolls."""
THROW_SHARE = 0.85
"""Airspeed that a throw gives over the least airspeed."""
# Nearer than this there is no direction from which a landing could be approached.
_APPROACH_M = 30.0


class FixedWingProcedures(ABC):
    """Procedures for fixed wings; see `sim_vehicle.autopilot.flight_procedures.FlightProcedures`."""

    name: str
    parameters: Mapping[str, ParameterSpec]
    least_airspeed: str
    """Parameter with the least airspeed, in m/s."""
    takeoff_height: str
    """Parameter with the height of a take-off, in metres."""
    return_height: str
    """Parameter with the return altitude, in metres."""
    land_start_needs_position: bool
    """Whether DO_LAND_START has to have a position."""
    holds_at_waypoints: bool
    """Whether the hold time of a waypoint counts."""
    turns_to_zero: bool
    """Whether the coordinates that a return does not have count as 0 N 0 E, to which the way to it leads."""

    @abstractmethod
    def limits(self, spec: VehicleSpec) -> FixedWingLimits:
        """Limits of a vehicle's flight."""

    def control(self, spec: VehicleSpec) -> ArduPlaneControl | None:  # noqa: ARG002
        """Gains of ArduPlane's control of energy; None for others."""
        return None

    def start_of_flight(self, spec: VehicleSpec, rotation: float, least: float) -> tuple[float, float]:
        """Airspeed at which the ground is left, and acceleration up to there (0: that of its thrust).

        Parameters
        ----------
        rotation : float
            Airspeed at which a runway is left; 0 without a runway.
        least : float
            Least airspeed.
        """
        lifts_off = None if spec.airframe is None else spec.airframe.liftoff_airspeed_m_s
        if lifts_off is not None:
            return max(lifts_off, rotation), 0.0
        return (rotation, ROLL_M_S2) if rotation > 0.0 else (THROW_SHARE * least, THROW_M_S2)

    @abstractmethod
    def lands_as_mission(self, spec: VehicleSpec) -> bool:
        """Whether a return flies the landing of the mission, if it has one."""

    @abstractmethod
    def steepest_approach(self, spec: VehicleSpec) -> tuple[str, float] | None:
        """Parameter that bounds the slope of an approach and its value in degrees; None without a bound."""

    @abstractmethod
    def takeoff_legs(
        self, spec: VehicleSpec, here: Position, target: Position, speed: float, heading: Heading
    ) -> list[Leg]:
        """Climb-out to the height of a take-off item."""

    @abstractmethod
    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Route home and what follows there."""

    def value(self, spec: VehicleSpec, name: str) -> float:
        """Value of a parameter for a vehicle, in the parameter's own unit."""
        return parameter_value(spec, name, self.parameters)

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Vehicle with the values that parameters decide."""
        limits = self.limits(spec)
        return replace(
            spec,
            cruise_speed_m_s=limits.airspeed_trim,
            speed_limit_m_s=limits.airspeed_max / 0.95,
            airspeed_limit_m_s=limits.airspeed_max,
            climb_speed_m_s=limits.climb_max,
            descent_speed_m_s=limits.sink_max,
            landing_speed_m_s=max(limits.flare_sink, 0.1),
            acceptance_radius_m=limits.acceptance,
            takeoff_altitude_m=max(self.value(spec, self.takeoff_height), 1.0),
            return_altitude_m=max(self.value(spec, self.return_height), 1.0),
        )

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Motion of a vehicle that stands at home."""
        from sim_vehicle.motion.fixed_wing.model import FixedWing

        return FixedWing(spec, self.limits, wind, yaw_rad, self.control)

    def landing_legs(
        self,
        spec: VehicleSpec,
        above: Position,
        last: Position,
        speed: float,  # noqa: ARG002
    ) -> list[Leg]:
        """Straight approach from the position before; without one, a circle down to the ground."""
        x, y, z = above
        landing = self.limits(spec).landing_airspeed
        if math.hypot(x - last[0], y - last[1]) >= _APPROACH_M:
            return [Leg((x, y, 0.0), landing, kind=LegKind.LAND)]
        return [
            Leg((x, y, z), spec.cruise_speed_m_s, heading=KEEP, kind=LegKind.LOITER, circle=Circle()),
            Leg((x, y, 0.0), landing, heading=KEEP, kind=LegKind.LAND, circle=Circle()),
        ]


def in_order(least: float, trim: float, most: float) -> tuple[float, float, float]:
    """Airspeeds in order, whatever the parameters say."""
    trim = max(trim, 3.0)
    return min(least, trim), trim, max(most, trim)
