"""Flight procedures: motion, take-off, return, landing, and their parameters.

This module has the base classes for firmwares, and the generic procedures of vehicles without an autopilot.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot.parameters import parameter_value
from sim_vehicle.motion.legs import ALONG, KEEP, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot.parameters import ParameterSpec
    from sim_vehicle.motion.legs import Heading, Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind

_SLOW_LANDING_M = 5.0


class FlightProcedures(ABC):
    """Flight procedures of a firmware; one object serves all vehicles, which differ by `VehicleSpec`."""

    name: str
    """Name of the autopilot."""
    parameters: Mapping[str, ParameterSpec]
    """Motion parameters by name."""
    orbit_within_m: float | None = None
    """Distance from a commanded orbit at which its leg begins; None if orbits are flown as chords."""

    def value(self, spec: VehicleSpec, name: str) -> float:
        """Return the value of a parameter for a vehicle, in the parameter's own unit."""
        return parameter_value(spec, name, self.parameters)

    def values(self, spec: VehicleSpec) -> dict[str, float]:
        """Return the values of all parameters for a vehicle, in their own units."""
        own = dict(spec.parameters)
        return {name: own.get(name, known.default) for name, known in self.parameters.items()}

    def numbers(self, spec: VehicleSpec, law: type | None = None) -> dict[str, float]:
        """Return the constants of motion set by parameters (SI units); with `law`, only fields of `law`."""
        value = self.values(spec)
        wanted = None if law is None else {field.name for field in fields(law)}
        return {
            known.law: known.in_si(value[name])
            for name, known in self.parameters.items()
            if known.law and (wanted is None or known.law in wanted)
        }

    @abstractmethod
    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle with radii, speeds and heights from its parameters."""

    @abstractmethod
    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion model of a vehicle that stands at home."""

    @abstractmethod
    def takeoff_legs(
        self, spec: VehicleSpec, here: Position, target: Position, speed: float, heading: Heading
    ) -> list[Leg]:
        """Return the legs from the ground to the end of a take-off item."""

    @abstractmethod
    def landing_legs(self, spec: VehicleSpec, above: Position, last: Position, speed: float) -> list[Leg]:
        """Return the legs from ``last`` to the position ``above``, and down to the ground."""

    @abstractmethod
    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Return the legs to the return point and down to the ground.

        ``return_point`` is home or another position, with the minimum height of the return. If the vehicle's
        return altitude is higher, the vehicle returns at this altitude.
        """


def vertical_landing(spec: VehicleSpec, x_m: float, y_m: float) -> Leg:
    """Return the last leg of a landing: straight down to the ground at a position (east, north)."""
    down = spec.landing_speed_m_s
    return Leg((x_m, y_m, 0.0), None, heading=KEEP, kind=LegKind.LAND, vertical_speed_m_s=down)


def over_and_down(
    spec: VehicleSpec, above: Position, last: Position, speed: float, near_m: float = 0.05
) -> list[Leg]:
    """Return the leg to a position (none within ``near_m`` of it), and the leg down to the ground."""
    x, y, _ = above
    away = math.hypot(x - last[0], y - last[1]) > near_m
    over = [Leg(above, speed, kind=LegKind.HOME)] if away else []
    return [*over, vertical_landing(spec, x, y)]


class GenericProcedures(FlightProcedures):
    """Generic procedures: straight up, straight home, straight down; also for the paper's ideal robot."""

    name = "generic"
    parameters: Mapping[str, ParameterSpec] = {}

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle unchanged; there are no parameters."""
        return spec

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion model of the ideal robot or a generic multirotor that stands at home."""
        if spec.is_ideal:
            from sim_vehicle.motion.model import IdealRobot

            return IdealRobot(spec, yaw_rad)
        from sim_vehicle.motion.multirotor.model import Multirotor

        return Multirotor(spec, wind, yaw_rad)

    def takeoff_legs(
        self, spec: VehicleSpec, here: Position, target: Position, speed: float, heading: Heading
    ) -> list[Leg]:
        """Return a vertical climb and, if the item's position is beside the start, a leg to the position."""
        x, y, z = target
        radius = spec.acceptance_radius_m
        keep = KEEP if heading == ALONG else heading
        legs = [Leg((here[0], here[1], max(z, here[2])), speed, radius, keep, LegKind.TAKEOFF)]
        if math.hypot(x - here[0], y - here[1]) > radius:
            legs.append(Leg((x, y, z), speed, radius, heading))
        return legs

    def landing_legs(self, spec: VehicleSpec, above: Position, last: Position, speed: float) -> list[Leg]:
        """Return the legs to a position and down to the ground, the last 5 m at landing speed."""
        legs = over_and_down(spec, above, last, speed)
        if above[2] > _SLOW_LANDING_M:
            low = (above[0], above[1], _SLOW_LANDING_M)
            down = spec.descent_speed_m_s
            legs.insert(-1, Leg(low, None, 0.3, KEEP, LegKind.DESCEND, vertical_speed_m_s=down))
        return legs

    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Return a climb, a leg home and a landing; within the acceptance radius of home only a landing."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedWingBounds:
    """Limits of a fixed wing for planning, in SI units and radians."""

    airspeed_min: float
    airspeed_trim: float
    """Cruise airspeed."""
    bank_limit: float
    landing_slope: float
    """Slope of an approach: descent divided by path length."""
    loiter_radius: float
    """Default radius of circles; positive for clockwise."""

    def tightest_m(self, airspeed_m_s: float) -> float:
        """Return the radius of a level turn at the bank limit (m)."""
        return airspeed_m_s * airspeed_m_s / (GRAVITY_M_S2 * math.tan(self.bank_limit))


class FixedWingProcedures(FlightProcedures):
    """Procedures of vehicles that hold their position by circling."""

    # Names of the parameters for the minimum airspeed (m/s), the take-off height and the return height (m).
    least_airspeed: str
    takeoff_height: str
    return_height: str
    land_start_needs_position: bool
    """Whether DO_LAND_START needs a position."""
    holds_at_waypoints: bool
    """Whether the hold time of a waypoint is used."""
    climbs_ahead: bool
    """Whether a take-off climbs straight ahead, not towards its position."""
    turns_to_zero: bool
    """Whether the firmware reads a return item without coordinates as the position 0 N, 0 E."""

    @abstractmethod
    def limits(self, spec: VehicleSpec) -> FixedWingBounds:
        """Return the limits within which missions for a vehicle are planned."""

    @abstractmethod
    def lands_as_mission(self, spec: VehicleSpec) -> bool:
        """Return whether a return ends with the landing of the mission, if the mission has a landing."""

    def steepest_approach(self, spec: VehicleSpec) -> tuple[str, float] | None:
        """Return the name and value (degrees) of the parameter that limits the approach slope, or None."""
        return None
