"""ArduCopter: its take-off, landing and return."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from sim_vehicle.airframe.parameters import ParameterSpec
from sim_vehicle.autopilot.procedures import FlightProcedures, over_and_down, vertical_landing
from sim_vehicle.motion.arducopter.parameters import PARAMETERS, fastest_airspeed_m_s
from sim_vehicle.motion.legs import ALONG, KEEP, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.weather.wind import Wind

_RTL_ALT_MIN_M = 2.0
_LEAST_CONE = 0.5
# From landed to disarmed: the motors spool down.
_SPOOL_DOWN_S = 0.35


class ArduCopterProcedures(FlightProcedures):
    """See `sim_vehicle.autopilot.procedures.FlightProcedures`."""

    name = "ardupilot"
    parameters: Mapping[str, ParameterSpec] = PARAMETERS

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle with those of its values that parameters decide."""
        value = self.values(spec)
        return replace(
            spec,
            cruise_speed_m_s=min(0.01 * value["WPNAV_SPEED"], spec.top_speed_m_s),
            climb_speed_m_s=0.01 * value["WPNAV_SPEED_UP"],
            descent_speed_m_s=0.01 * value["WPNAV_SPEED_DN"],
            landing_speed_m_s=0.01 * value["LAND_SPEED"],
            airspeed_limit_m_s=min(spec.airspeed_limit_m_s, fastest_airspeed_m_s(spec)),
            acceleration_m_s2=0.01 * value["WPNAV_ACCEL"],
            vertical_acceleration_m_s2=0.01 * value["WPNAV_ACCEL_Z"],
            yaw_rate_rad_s=math.radians(0.01 * value["ATC_SLEW_YAW"]),
            yaw_acceleration_rad_s2=math.radians(0.01 * (value["ATC_ACCEL_Y_MAX"] or 72_000.0)),
            acceptance_radius_m=0.01 * value["WPNAV_RADIUS"],
            takeoff_altitude_m=0.01 * value["PILOT_TKOFF_ALT"] or spec.takeoff_altitude_m,
            return_altitude_m=0.01 * value["RTL_ALT"],
            disarm_delay_s=_SPOOL_DOWN_S,
        )

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion of a vehicle that stands at home."""
        from sim_vehicle.motion.arducopter.model import ArduCopter

        return ArduCopter(spec, wind, yaw_rad)

    def takeoff_legs(
        self, spec: VehicleSpec, here: Position, target: Position, speed: float, heading: Heading
    ) -> list[Leg]:
        """Return the leg of a take-off: straight up, wherever its position is."""
        keep = KEEP if heading == ALONG else heading
        top = (here[0], here[1], max(target[2], here[2]))
        return [Leg(top, speed, heading=keep, kind=LegKind.TAKEOFF)]

    def landing_legs(self, spec: VehicleSpec, above: Position, last: Position, speed: float) -> list[Leg]:
        """Return the legs to a position and down to the ground there."""
        return over_and_down(spec, above, last, speed)

    def return_legs(
        self, spec: VehicleSpec, last: Position, speed: float, return_point: Position
    ) -> list[Leg]:
        """Return the legs home: up, less near home, straight home, a wait, and down."""
        value = self.values(spec)
        x, y, z = last
        home_x, home_y, least = return_point
        lowest = max(_RTL_ALT_MIN_M, z + 0.01 * value["RTL_CLIMB_MIN"])
        height = max(spec.return_altitude_m, least, lowest)
        slope = value["RTL_CONE_SLOPE"]
        if slope >= _LEAST_CONE:
            height = min(height, max(slope * math.hypot(x - home_x, y - home_y), lowest))
        back = 0.01 * value["RTL_SPEED"] or spec.cruise_speed_m_s
        heading = ALONG if value["WP_YAW_BEHAVIOR"] in (1.0, 3.0) else KEEP
        wait = 0.001 * value["RTL_LOIT_TIME"]
        return [
            Leg((x, y, height), back, spec.acceptance_radius_m, KEEP, LegKind.CLIMB),
            Leg((home_x, home_y, height), back, heading=heading, kind=LegKind.HOME, pause_s=wait),
            vertical_landing(spec, home_x, home_y),
        ]


ARDUCOPTER = ArduCopterProcedures()
