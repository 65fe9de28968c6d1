"""ArduPilot's Rover: its parameters and limits.

Names, defaults and ranges are those of Rover 4.6 (``AR_WPNav``, ``AR_PivotTurn``, ``AR_AttitudeControl``).
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from sim_vehicle.airframe.parameters import ParameterSpec
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot.rover import RoverProcedures

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.rover.model import RoverLimits

__all__ = ["ARDUROVER"]

_SKID = 73.0
# Rover's target goes round corners on its own; the vehicle follows it this near.
_FOLLOWS_M = 0.3
PARAMETERS: Mapping[str, ParameterSpec] = MappingProxyType(
    {
        "ATC_ACCEL_MAX": ParameterSpec(1.0, 0.0, 10.0, "m/s^2", "acceleration"),
        "ATC_DECEL_MAX": ParameterSpec(0.0, 0.0, 10.0, "m/s^2", "deceleration, 0: as the acceleration"),
        "ATC_STR_RAT_MAX": ParameterSpec(120.0, 0.0, 1000.0, "deg/s", "rate of turning"),
        "ATC_TURN_MAX_G": ParameterSpec(0.6, 0.1, 10.0, "g", "lateral acceleration"),
        "SERVO1_FUNCTION": ParameterSpec(26.0, 0.0, 200.0, "", "26 steering, 73 skid steering", integer=True),
        "TURN_RADIUS": ParameterSpec(0.9, 0.0, 10.0, "m", "tightest turn"),
        "WP_PIVOT_ANGLE": ParameterSpec(
            60.0, 0.0, 360.0, "deg", "error at which it turns on the spot", integer=True
        ),
        "WP_PIVOT_RATE": ParameterSpec(
            60.0, 0.0, 360.0, "deg/s", "rate of turning on the spot", integer=True
        ),
        "WP_RADIUS": ParameterSpec(2.0, 0.1, 100.0, "m", "radius of waypoints"),
        "WP_SPEED": ParameterSpec(2.0, 0.1, 100.0, "m/s", "speed"),
    }
)


class ArduRover(RoverProcedures):
    """See `sim_vehicle.autopilot.rover.RoverProcedures`."""

    name = "ardupilot"
    parameters = PARAMETERS

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Vehicle with the speeds and the radius that parameters decide."""
        cruise, limit = self.value(spec, "WP_SPEED"), spec.speed_limit_m_s
        return replace(
            spec,
            cruise_speed_m_s=cruise,
            speed_limit_m_s=max(limit, cruise / 0.95),
            acceptance_radius_m=self.limits(spec).acceptance,
        )

    def limits(self, spec: VehicleSpec) -> RoverLimits:
        """Limits of a vehicle's driving."""
        from sim_vehicle.motion.rover.model import RoverLimits

        value = {name: self.value(spec, name) for name in self.parameters}
        skid = value["SERVO1_FUNCTION"] == _SKID
        acceleration = value["ATC_ACCEL_MAX"] or spec.acceleration_m_s2
        turns = skid and value["WP_PIVOT_ANGLE"] > 5.0
        return RoverLimits(
            speed_max=max(spec.speed_limit_m_s, value["WP_SPEED"]),
            acceleration=acceleration,
            deceleration=value["ATC_DECEL_MAX"] or acceleration,
            turn_radius=0.0 if skid else value["TURN_RADIUS"],
            turn_rate=math.radians(value["ATC_STR_RAT_MAX"] or 1000.0),
            lateral=value["ATC_TURN_MAX_G"] * GRAVITY_M_S2,
            steering_s=0.2,
            ahead_gain=0.7,
            ahead_min=0.6,
            ahead_max=5.0,
            pivot_begin=math.radians(value["WP_PIVOT_ANGLE"]) if turns else 0.0,
            pivot_end=math.radians(5.0),
            pivot_rate=math.radians(value["WP_PIVOT_RATE"] or 60.0),
            acceptance=min(value["WP_RADIUS"], _FOLLOWS_M),
            corner_gain=1.0,
            corner_max=value["WP_RADIUS"],
            passes=True,
        )


ARDUROVER = ArduRover()
