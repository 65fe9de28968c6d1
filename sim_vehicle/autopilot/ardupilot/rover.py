"""ArduPilot's Rover: its parameters and limits.

Names, defaults and ranges are those of Rover 4.6 (``AR_WPNav``, ``AR_PivotTurn``, ``AR_PosControl``,
``AR_AttitudeControl``, ``AP_MotorsUGV``).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from sim_vehicle.airframe.parameters import ParameterSpec, whole
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot.procedures import RoverProcedures
from sim_vehicle.motion.legs import Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.ardurover.model import DriveLaw
    from sim_vehicle.motion.legs import Position
    from sim_vehicle.motion.model import MotionModel
    from sim_vehicle.motion.rover.model import RoverLimits
    from sim_vehicle.weather.wind import Wind

__all__ = ["ARDUROVER"]

_SKID = 73.0
# Rover's target goes round corners on its own; the vehicle follows it this near.
_FOLLOWS_M = 0.3
# Rover stays armed when it is home: the longest delay there is.
_NEVER_DISARM_S = 3599.0
# Change of jerk of the S-curves, m/s^4 (AR_WPNAV_SNAP_MAX); acceleration where none is limited.
_SNAP = 15.0
_ANY_ACCELERATION = 20.0
# How fast speed follows the throttle, and turns of tracks what is asked for: those of ArduPilot's simulator.
_DRIVE_LAG_S = 20.0 / 10.0
_TRACK_LAG_S = 0.2
PARAMETERS: Mapping[str, ParameterSpec] = {
    "ATC_ACCEL_MAX": ParameterSpec(1.0, 0.0, 10.0, "m/s^2", "acceleration"),
    "ATC_DECEL_MAX": ParameterSpec(0.0, 0.0, 10.0, "m/s^2", "deceleration, 0: as the acceleration"),
    "ATC_SPEED_FLTE": ParameterSpec(10.0, 0.0, 100.0, "Hz", "filter of the throttle's error"),
    "ATC_SPEED_I": ParameterSpec(0.2, 0.0, 2.0, "", "throttle, integrator"),
    "ATC_SPEED_IMAX": ParameterSpec(1.0, 0.0, 1.0, "", "throttle, greatest integrator"),
    "ATC_SPEED_P": ParameterSpec(0.2, 0.01, 2.0, "", "throttle over error of speed"),
    "ATC_STOP_SPEED": ParameterSpec(0.1, 0.0, 0.5, "m/s", "speed that counts as standing"),
    "ATC_STR_ACC_MAX": ParameterSpec(120.0, 0.0, 1000.0, "deg/s^2", "angular acceleration, 0: any"),
    "ATC_STR_ANG_P": ParameterSpec(2.0, 1.0, 10.0, "1/s", "rate of turning over error of heading"),
    "ATC_STR_RAT_FF": ParameterSpec(0.2, 0.0, 3.0, "", "steering over rate of turning"),
    "ATC_STR_RAT_FLTE": ParameterSpec(10.0, 0.0, 100.0, "Hz", "filter of the steering's error"),
    "ATC_STR_RAT_I": ParameterSpec(0.2, 0.0, 2.0, "", "steering, integrator"),
    "ATC_STR_RAT_IMAX": ParameterSpec(1.0, 0.0, 1.0, "", "steering, greatest integrator"),
    "ATC_STR_RAT_MAX": ParameterSpec(120.0, 0.0, 1000.0, "deg/s", "rate of turning"),
    "ATC_STR_RAT_P": ParameterSpec(0.2, 0.0, 2.0, "", "steering over error of the rate of turning"),
    "ATC_TURN_MAX_G": ParameterSpec(0.6, 0.1, 10.0, "g", "lateral acceleration"),
    "CRUISE_SPEED": ParameterSpec(2.0, 0.0, 100.0, "m/s", "speed at CRUISE_THROTTLE"),
    "CRUISE_THROTTLE": whole(50.0, 0.0, 100.0, "%", "throttle at CRUISE_SPEED"),
    "MOT_SPD_SCA_BASE": ParameterSpec(1.0, 0.0, 10.0, "m/s", "speed above which less is steered, 0: none"),
    "PSC_POS_P": ParameterSpec(0.2, 0.01, 2.0, "1/s", "velocity over error of position"),
    "PSC_VEL_FLTE": ParameterSpec(5.0, 0.0, 100.0, "Hz", "filter of the velocity's error"),
    "PSC_VEL_P": ParameterSpec(1.0, 0.1, 6.0, "1/s", "acceleration over error of velocity"),
    "RTL_SPEED": ParameterSpec(0.0, 0.0, 100.0, "m/s", "speed of a return, 0: WP_SPEED"),
    "SERVO1_FUNCTION": whole(26.0, 0.0, 200.0, "", "26 steering, 73 skid steering"),
    "TURN_RADIUS": ParameterSpec(0.9, 0.0, 10.0, "m", "tightest turn"),
    "WP_ACCEL": ParameterSpec(0.0, 0.0, 100.0, "m/s^2", "acceleration of the path, 0: ATC_ACCEL_MAX"),
    "WP_JERK": ParameterSpec(0.0, 0.0, 100.0, "m/s^3", "jerk of the path, 0: as the acceleration"),
    "WP_PIVOT_ANGLE": whole(60.0, 0.0, 360.0, "deg", "error at which it turns on the spot"),
    "WP_PIVOT_DELAY": ParameterSpec(0.0, 0.0, 60.0, "s", "pause after a turn on the spot"),
    "WP_PIVOT_RATE": whole(60.0, 0.0, 360.0, "deg/s", "rate of turning on the spot"),
    "WP_RADIUS": ParameterSpec(2.0, 0.1, 100.0, "m", "radius of waypoints"),
    "WP_SPEED": ParameterSpec(2.0, 0.1, 100.0, "m/s", "speed"),
}


class ArduRover(RoverProcedures):
    """See `sim_vehicle.autopilot.procedures.RoverProcedures`."""

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
            disarm_delay_s=_NEVER_DISARM_S,
        )

    def limits(self, spec: VehicleSpec) -> RoverLimits:
        """Limits of a vehicle's driving."""
        from sim_vehicle.motion.rover.model import RoverLimits

        value = self.values(spec)
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

    def law(self, spec: VehicleSpec) -> DriveLaw:
        """What Rover makes of a vehicle's parameters."""
        from sim_vehicle.motion.ardurover.model import DriveLaw

        value = self.values(spec)
        skid = value["SERVO1_FUNCTION"] == _SKID
        accel = value["ATC_ACCEL_MAX"] or _ANY_ACCELERATION
        decel = value["ATC_DECEL_MAX"] or accel
        path = min(accel, decel)
        if value["WP_ACCEL"] > 0.0:
            path = min(path, value["WP_ACCEL"])
        lateral = value["ATC_TURN_MAX_G"] * GRAVITY_M_S2
        turn_radius = 0.0 if skid else value["TURN_RADIUS"]
        cruise, throttle = value["CRUISE_SPEED"], 0.01 * value["CRUISE_THROTTLE"]
        return DriveLaw(
            position_p=value["PSC_POS_P"],
            velocity_p=value["PSC_VEL_P"],
            velocity_filter_hz=value["PSC_VEL_FLTE"],
            path_acceleration=path,
            acceleration=accel,
            deceleration=decel,
            jerk=value["WP_JERK"] or path,
            snap=_SNAP,
            lateral=lateral,
            turn_speed=math.sqrt(0.5 * lateral * turn_radius),
            radius=max(value["WP_RADIUS"], turn_radius),
            near=value["WP_RADIUS"],
            steer_acceleration=math.radians(value["ATC_STR_ACC_MAX"] or 1e5),
            steer_rate=math.radians(value["ATC_STR_RAT_MAX"] or 1e5),
            steer_ff=value["ATC_STR_RAT_FF"],
            steer_p=value["ATC_STR_RAT_P"],
            steer_i=value["ATC_STR_RAT_I"],
            steer_imax=value["ATC_STR_RAT_IMAX"],
            steer_filter_hz=value["ATC_STR_RAT_FLTE"],
            scale_base=value["MOT_SPD_SCA_BASE"],
            tightest=0.0 if skid else max(turn_radius, 0.1),
            track_lag_s=_TRACK_LAG_S,
            angle_p=value["ATC_STR_ANG_P"],
            pivot_angle=math.radians(value["WP_PIVOT_ANGLE"])
            if skid and value["WP_PIVOT_ANGLE"] > 5.0
            else 0.0,
            pivot_rate=math.radians(value["WP_PIVOT_RATE"] or value["ATC_STR_RAT_MAX"] or 1e5),
            pivot_delay_s=value["WP_PIVOT_DELAY"],
            drive_base=throttle / cruise if cruise > 0.0 else 0.0,
            drive_p=value["ATC_SPEED_P"],
            drive_i=value["ATC_SPEED_I"],
            drive_imax=value["ATC_SPEED_IMAX"],
            drive_filter_hz=value["ATC_SPEED_FLTE"],
            stop_speed=value["ATC_STOP_SPEED"],
            top_speed=spec.speed_limit_m_s,
            drive_lag_s=_DRIVE_LAG_S,
        )

    def return_legs(
        self,
        spec: VehicleSpec,
        last: Position,  # noqa: ARG002
        speed: float,
        return_point: Position,
    ) -> list[Leg]:
        """Route home, at a speed of its own, where it stops."""
        speed = self.value(spec, "RTL_SPEED") or spec.cruise_speed_m_s
        return [Leg((return_point[0], return_point[1], 0.0), speed, kind=LegKind.HOME)]

    def motion(self, spec: VehicleSpec, wind: Wind | None, yaw_rad: float) -> MotionModel:
        """Motion of a vehicle that stands at home."""
        from sim_vehicle.motion.ardurover.model import ArduRover as Driven

        return Driven(spec, self.limits, self.law, wind, yaw_rad)


ARDUROVER = ArduRover()
