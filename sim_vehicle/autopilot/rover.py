"""Ground vehicles, as PX4 and as ArduPilot's Rover drive them: parameters, stops, return.

Names, defaults and ranges are those of PX4 1.16 and 1.17 (``rovercontrol_params.yaml``, ``rover_ackermann``
and ``rover_differential`` modules, ``pure_pursuit``) and of Rover 4.6 (``AR_WPNav``, ``AR_PivotTurn``,
``AR_AttitudeControl``). Where PX4 has no default because each rover has its own, that of the vehicle holds.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from sim_vehicle.airframe.parameters import ParameterSpec, parameter_value
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.motion.legs import Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Heading, Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.motion.rover.model import RoverLimits
    from sim_vehicle.weather.wind import Wind

_DIFFERENTIAL = 6.0
_SKID = 73.0
_GRIP_M_S2 = 0.4 * GRAVITY_M_S2
# Rover's target goes round corners on its own; the vehicle follows it this near.
_FOLLOWS_M = 0.3

PX4_PARAMETERS: Mapping[str, ParameterSpec] = MappingProxyType(
    {
        "CA_AIRFRAME": ParameterSpec(5.0, 5.0, 6.0, "", "5 Ackermann, 6 differential", integer=True),
        "NAV_ACC_RAD": ParameterSpec(0.5, 0.05, 200.0, "m", "least acceptance radius"),
        "PP_LOOKAHD_GAIN": ParameterSpec(1.0, 0.1, 100.0, "s", "look-ahead over speed"),
        "PP_LOOKAHD_MAX": ParameterSpec(10.0, 0.1, 100.0, "m", "greatest look-ahead"),
        "PP_LOOKAHD_MIN": ParameterSpec(1.0, 0.1, 100.0, "m", "least look-ahead"),
        "RA_ACC_RAD_GAIN": ParameterSpec(2.0, 1.0, 100.0, "", "corner cutting"),
        "RA_ACC_RAD_MAX": ParameterSpec(
            3.0, -1.0, 100.0, "m", "greatest acceptance radius, -1 cuts no corner"
        ),
        "RA_MAX_STR_ANG": ParameterSpec(0.5236, 0.1, 1.5, "rad", "greatest steering angle"),
        "RA_WHEEL_BASE": ParameterSpec(0.5, 0.001, 100.0, "m", "wheel base"),
        "RD_TRANS_DRV_TRN": ParameterSpec(
            0.174533, 0.001, 3.14159, "rad", "error at which it turns on the spot"
        ),
        "RD_TRANS_TRN_DRV": ParameterSpec(0.0872665, 0.001, 3.14159, "rad", "error at which it drives on"),
        "RO_ACCEL_LIM": ParameterSpec(-1.0, -1.0, 100.0, "m/s^2", "acceleration, -1: the vehicle's"),
        "RO_DECEL_LIM": ParameterSpec(-1.0, -1.0, 100.0, "m/s^2", "deceleration, -1: the vehicle's"),
        "RO_SPEED_LIM": ParameterSpec(-1.0, -1.0, 100.0, "m/s", "speed, -1: the vehicle's"),
        "RO_YAW_RATE_LIM": ParameterSpec(0.0, 0.0, 10000.0, "deg/s", "rate of turning, 0: the vehicle's"),
    }
)
ARDUPILOT_PARAMETERS: Mapping[str, ParameterSpec] = MappingProxyType(
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


class GroundRover:
    """See `sim_vehicle.autopilot.model.FlightProcedures`.

    Parameters
    ----------
    ardupilot : bool
        Whether it is ArduPilot's Rover, otherwise PX4.
    """

    def __init__(self, *, ardupilot: bool) -> None:
        self.name = "ardupilot" if ardupilot else "px4"
        self.ardupilot = ardupilot
        self.parameters: Mapping[str, ParameterSpec] = ARDUPILOT_PARAMETERS if ardupilot else PX4_PARAMETERS

    def _of(self, spec: VehicleSpec, name: str) -> float:
        return parameter_value(spec, name, self.parameters)

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Return the vehicle with what parameters decide of its values."""
        if self.ardupilot:
            cruise, limit = self._of(spec, "WP_SPEED"), spec.speed_limit_m_s
        else:
            limit = self._of(spec, "RO_SPEED_LIM")
            cruise = limit if limit > 0.0 else spec.cruise_speed_m_s
            limit = limit / 0.95 if limit > 0.0 else spec.speed_limit_m_s
        limits = self.limits(spec)
        return replace(
            spec,
            cruise_speed_m_s=cruise,
            speed_limit_m_s=max(limit, cruise / 0.95),
            acceptance_radius_m=limits.acceptance,
        )

    def limits(self, spec: VehicleSpec) -> RoverLimits:
        """Return the limits of a vehicle's driving."""
        from sim_vehicle.motion.rover.model import RoverLimits

        value = {name: self._of(spec, name) for name in self.parameters}
        if self.ardupilot:
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
        skid = value["CA_AIRFRAME"] == _DIFFERENTIAL
        rate = value["RO_YAW_RATE_LIM"]
        limit = value["RO_SPEED_LIM"]
        return RoverLimits(
            speed_max=limit if limit > 0.0 else spec.speed_limit_m_s,
            acceleration=_own(value["RO_ACCEL_LIM"], spec.acceleration_m_s2),
            deceleration=_own(value["RO_DECEL_LIM"], spec.acceleration_m_s2),
            turn_radius=0.0 if skid else value["RA_WHEEL_BASE"] / math.tan(value["RA_MAX_STR_ANG"]),
            turn_rate=math.radians(rate) if rate > 0.0 else spec.yaw_rate_rad_s * 2.0,
            lateral=_GRIP_M_S2,
            steering_s=0.2,
            ahead_gain=value["PP_LOOKAHD_GAIN"],
            ahead_min=value["PP_LOOKAHD_MIN"],
            ahead_max=max(value["PP_LOOKAHD_MAX"], value["PP_LOOKAHD_MIN"]),
            pivot_begin=value["RD_TRANS_DRV_TRN"] if skid else 0.0,
            pivot_end=min(value["RD_TRANS_TRN_DRV"], value["RD_TRANS_DRV_TRN"]),
            pivot_rate=math.radians(rate) if rate > 0.0 else spec.yaw_rate_rad_s,
            acceptance=value["NAV_ACC_RAD"],
            corner_gain=value["RA_ACC_RAD_GAIN"] if not skid and value["RA_ACC_RAD_MAX"] > 0.0 else 0.0,
            corner_max=max(value["RA_ACC_RAD_MAX"], value["NAV_ACC_RAD"]),
            passes=False,
        )

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Return the motion of a vehicle that stands at home."""
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
        """Return a leg that is done at once: there is nothing to take off."""
        return [Leg((here[0], here[1], 0.0), speed, kind=LegKind.TAKEOFF)]

    def landing_legs(
        self,
        spec: VehicleSpec,  # noqa: ARG002
        above: Position,
        last: Position,  # noqa: ARG002
        speed: float,
    ) -> list[Leg]:
        """Return the way to the place, where it stops."""
        return [Leg((above[0], above[1], 0.0), speed, kind=LegKind.HOME)]

    def return_legs(
        self,
        spec: VehicleSpec,  # noqa: ARG002
        last: Position,  # noqa: ARG002
        speed: float,
        haven: Position,
    ) -> list[Leg]:
        """Return the way home, where it stops."""
        return [Leg((haven[0], haven[1], 0.0), speed, kind=LegKind.HOME)]


def _own(value: float, otherwise: float) -> float:
    return value if value > 0.0 else otherwise


PX4_ROVER = GroundRover(ardupilot=False)
ARDUROVER = GroundRover(ardupilot=True)
