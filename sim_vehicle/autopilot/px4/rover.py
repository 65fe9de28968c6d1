"""PX4 with a rover: its parameters and limits.

Names, defaults and ranges are those of PX4 1.16 and 1.17 (``rovercontrol_params.yaml``, ``rover_ackermann``
and ``rover_differential`` modules, ``pure_pursuit``). Where PX4 has no default because rovers differ, the
value of the vehicle holds.
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

__all__ = ["PX4_ROVER"]

_DIFFERENTIAL = 6.0
_GRIP_M_S2 = 0.4 * GRAVITY_M_S2
# The rover of the simulator (`sih.cpp`): force of full throttle, rolling resistance over weight, how soon it
# turns as asked, wheel base, greatest angle of the wheels and cornering stiffness.
_SIH_ROVER = 5.0
_SIH_FORCE_N = 400.0
_SIH_ROLLING = 0.3
_SIH_STEERING_S = 0.08
_SIH_WHEEL_BASE_M = 0.321
_SIH_STEERING_RAD = math.radians(30.0)
_SIH_STIFFNESS_N_RAD = 500.0
PARAMETERS: Mapping[str, ParameterSpec] = MappingProxyType(
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
        "RO_JERK_LIM": ParameterSpec(-1.0, -1.0, 100.0, "m/s^3", "jerk of slowing down, -1: any"),
        "RO_MAX_THR_SPEED": ParameterSpec(0.0, 0.0, 100.0, "m/s", "speed at full throttle, 0: RO_SPEED_LIM"),
        "RO_SPEED_I": ParameterSpec(0.0, 0.0, 100.0, "", "throttle, integrator"),
        "RO_SPEED_LIM": ParameterSpec(-1.0, -1.0, 100.0, "m/s", "speed, -1: the vehicle's"),
        "RO_SPEED_P": ParameterSpec(0.0, 0.0, 100.0, "", "throttle over error of speed"),
        "RO_SPEED_RED": ParameterSpec(
            -1.0, -1.0, 100.0, "", "slowing down at corners, -1: what the lateral acceleration allows"
        ),
        "RO_YAW_ACCEL_LIM": ParameterSpec(-1.0, -1.0, 10000.0, "deg/s^2", "angular acceleration, -1: any"),
        "RO_YAW_P": ParameterSpec(
            0.0, 0.0, 100.0, "1/s", "rate of turning over error of heading, 0: the bend of pure pursuit"
        ),
        "RO_YAW_RATE_LIM": ParameterSpec(0.0, 0.0, 10000.0, "deg/s", "rate of turning, 0: the vehicle's"),
        "SIH_KDV": ParameterSpec(1.0, 0.0, 1000.0, "N s^2/m^2", "drag of the simulated rover"),
        "SIH_KDW": ParameterSpec(0.025, 0.0, 100.0, "N m s", "damping of turns of the simulated rover"),
        "SIH_LOC_LAT0": ParameterSpec(47.397742, -90.0, 90.0, "deg", "latitude of the simulated rover"),
        "SIH_LOC_LON0": ParameterSpec(8.545594, -180.0, 180.0, "deg", "longitude of the simulated rover"),
        "SIH_MASS": ParameterSpec(1.0, 0.02, 1000.0, "kg", "mass of the simulated rover"),
        "SIH_VEHICLE_TYPE": ParameterSpec(
            0.0, 0.0, 5.0, "", "5: the vehicle is the rover of PX4's simulator", integer=True
        ),
    }
)


class Px4Rover(RoverProcedures):
    """See `sim_vehicle.autopilot.rover.RoverProcedures`."""

    name = "px4"
    parameters = PARAMETERS

    def fit(self, spec: VehicleSpec) -> VehicleSpec:
        """Vehicle with the speeds and the radius that parameters decide."""
        limit = self.value(spec, "RO_SPEED_LIM")
        cruise = limit if limit > 0.0 else spec.cruise_speed_m_s
        limit = limit / 0.95 if limit > 0.0 else spec.speed_limit_m_s
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
        skid = value["CA_AIRFRAME"] == _DIFFERENTIAL
        rate = value["RO_YAW_RATE_LIM"]
        limit = value["RO_SPEED_LIM"]
        speed_max = limit if limit > 0.0 else spec.speed_limit_m_s
        turn_rate = math.radians(rate) if rate > 0.0 else spec.yaw_rate_rad_s * 2.0
        radius = value["RA_WHEEL_BASE"] / math.tan(value["RA_MAX_STR_ANG"])
        accel = value["RO_YAW_ACCEL_LIM"]
        own = RoverLimits(
            speed_max=speed_max,
            acceleration=_own(value["RO_ACCEL_LIM"], spec.acceleration_m_s2),
            deceleration=_own(value["RO_DECEL_LIM"], spec.acceleration_m_s2),
            turn_radius=0.0 if skid else radius,
            turn_rate=turn_rate,
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
            yaw_p=value["RO_YAW_P"],
            yaw_acceleration=math.radians(accel) if accel > 0.0 else 1e5,
            jerk=max(value["RO_JERK_LIM"], 0.0),
            corner_slows=value["RO_SPEED_RED"] if value["RO_SPEED_RED"] > 0.0 else -1.0,
            corner_least=radius * turn_rate,
            corner_most=value["RO_MAX_THR_SPEED"] or speed_max,
            throttle_speed=value["RO_MAX_THR_SPEED"] or speed_max,
            speed_p=value["RO_SPEED_P"],
            speed_i=value["RO_SPEED_I"],
        )
        return _simulated(own, value) if value["SIH_VEHICLE_TYPE"] == _SIH_ROVER else own


def _simulated(law: RoverLimits, value: Mapping[str, float]) -> RoverLimits:
    """Limits of the rover of PX4's simulator: what its motor gives, and tyres that hold in every turn."""
    latitude, longitude = math.radians(value["SIH_LOC_LAT0"]), math.radians(value["SIH_LOC_LON0"])
    sine, cosine = math.sin(latitude), math.cos(latitude)
    return replace(
        law,
        lateral=math.inf,
        steering_s=_SIH_STEERING_S,
        understeer=value["SIH_KDW"] / (_SIH_WHEEL_BASE_M * _SIH_STIFFNESS_N_RAD * _SIH_STEERING_RAD),
        force=_SIH_FORCE_N / value["SIH_MASS"],
        friction=_SIH_ROLLING * GRAVITY_M_S2,
        drag=value["SIH_KDV"] / value["SIH_MASS"],
        north=(-sine * math.cos(longitude), -sine * math.sin(longitude), cosine),
        east=(-math.sin(longitude), math.cos(longitude), 0.0),
    )


def _own(value: float, otherwise: float) -> float:
    return value if value > 0.0 else otherwise


PX4_ROVER = Px4Rover()
