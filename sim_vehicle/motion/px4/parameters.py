"""PX4's parameters that move a multirotor.

Names, defaults and ranges from PX4 v1.17 (``multicopter_*_params.yaml``, ``navigator``, ``commander``,
``land_detector``) with the defaults of multirotors (``rc.mc_defaults``).
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from sim_vehicle.airframe.parameters import ParameterSpec, parameter_value

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_vehicle.airframe.spec import VehicleSpec

PARAMETERS: Mapping[str, ParameterSpec] = MappingProxyType(
    {
        "MPC_XY_CRUISE": ParameterSpec(5.0, 3.0, 20.0, "m/s", "horizontal speed that no mission sets"),
        "MPC_XY_VEL_MAX": ParameterSpec(12.0, 0.0, 20.0, "m/s", "greatest horizontal speed"),
        "MPC_ACC_HOR": ParameterSpec(3.0, 2.0, 15.0, "m/s^2", "horizontal acceleration"),
        "MPC_JERK_AUTO": ParameterSpec(4.0, 1.0, 80.0, "m/s^3", "jerk"),
        "MPC_XY_TRAJ_P": ParameterSpec(0.5, 0.1, 1.0, "", "share of the acceleration in corners"),
        "MPC_XY_ERR_MAX": ParameterSpec(2.0, 0.1, 10.0, "m", "distance behind at which the trajectory waits"),
        "MPC_XY_P": ParameterSpec(0.95, 0.0, 2.0, "1/s", "gain of the horizontal position"),
        "MPC_Z_P": ParameterSpec(1.0, 0.1, 1.5, "1/s", "gain of the height"),
        "MPC_XY_VEL_P_ACC": ParameterSpec(
            1.8, 1.2, 5.0, "1/s", "proportional gain of the horizontal velocity"
        ),
        "MPC_XY_VEL_I_ACC": ParameterSpec(
            0.4, 0.0, 60.0, "1/s^2", "integral gain of the horizontal velocity"
        ),
        "MPC_XY_VEL_D_ACC": ParameterSpec(0.2, 0.1, 2.0, "", "derivative gain of the horizontal velocity"),
        "MPC_Z_VEL_P_ACC": ParameterSpec(4.0, 2.0, 15.0, "1/s", "proportional gain of the vertical velocity"),
        "MPC_Z_VEL_I_ACC": ParameterSpec(2.0, 0.2, 3.0, "1/s^2", "integral gain of the vertical velocity"),
        "MPC_Z_VEL_D_ACC": ParameterSpec(0.0, 0.0, 2.0, "", "derivative gain of the vertical velocity"),
        "MPC_Z_V_AUTO_UP": ParameterSpec(3.0, 0.5, 8.0, "m/s", "climb speed"),
        "MPC_Z_V_AUTO_DN": ParameterSpec(1.5, 0.5, 4.0, "m/s", "descent speed"),
        "MPC_Z_VEL_MAX_UP": ParameterSpec(3.0, 0.5, 8.0, "m/s", "greatest climb speed"),
        "MPC_Z_VEL_MAX_DN": ParameterSpec(1.5, 0.5, 4.0, "m/s", "greatest descent speed"),
        "MPC_ACC_UP_MAX": ParameterSpec(4.0, 2.0, 15.0, "m/s^2", "upward acceleration"),
        "MPC_ACC_DOWN_MAX": ParameterSpec(3.0, 2.0, 15.0, "m/s^2", "downward acceleration"),
        "MPC_TILTMAX_AIR": ParameterSpec(45.0, 20.0, 89.0, "deg", "greatest tilt"),
        "MPC_YAWRAUTO_MAX": ParameterSpec(60.0, 5.0, 360.0, "deg/s", "rate of turning"),
        "MPC_YAWRAUTO_ACC": ParameterSpec(20.0, 5.0, 360.0, "deg/s^2", "acceleration of turning"),
        "MPC_TKO_SPEED": ParameterSpec(1.5, 1.0, 5.0, "m/s", "climb speed of a take-off"),
        "MPC_TKO_RAMP_T": ParameterSpec(3.0, 0.0, 5.0, "s", "time of the thrust's build-up"),
        "MPC_LAND_SPEED": ParameterSpec(0.7, 0.6, 10.0, "m/s", "landing speed"),
        "MPC_LAND_ALT1": ParameterSpec(
            10.0, 0.0, 122.0, "m", "height at which a landing begins to slow down"
        ),
        "MPC_LAND_ALT2": ParameterSpec(5.0, 0.0, 122.0, "m", "height from which the landing speed holds"),
        "MPC_LAND_ALT3": ParameterSpec(1.0, 0.0, 122.0, "m", "height from which the crawl speed holds"),
        "MPC_LAND_CRWL": ParameterSpec(0.3, 0.1, 10.0, "m/s", "crawl speed"),
        "NAV_ACC_RAD": ParameterSpec(2.0, 0.05, 200.0, "m", "acceptance radius"),
        "NAV_MC_ALT_RAD": ParameterSpec(0.8, 0.05, 200.0, "m", "height within which a waypoint is reached"),
        "MIS_TAKEOFF_ALT": ParameterSpec(2.5, 0.0, 80.0, "m", "least height of a take-off"),
        "MIS_YAW_ERR": ParameterSpec(12.0, 0.0, 90.0, "deg", "heading within which a waypoint is reached"),
        "RTL_RETURN_ALT": ParameterSpec(30.0, 0.0, 150.0, "m", "return altitude"),
        "RTL_DESCEND_ALT": ParameterSpec(10.0, 0.0, 100.0, "m", "height to wait at before the landing"),
        "RTL_LAND_DELAY": ParameterSpec(0.0, -1.0, 300.0, "s", "time to wait there; -1 is for ever"),
        "RTL_MIN_DIST": ParameterSpec(10.0, 0.5, 100.0, "m", "distance within which the return may be lower"),
        "RTL_CONE_ANG": ParameterSpec(
            45.0, 0.0, 90.0, "deg", "half angle of the cone of lower returns", integer=True
        ),
        "COM_DISARM_LAND": ParameterSpec(2.0, -1.0, 20.0, "s", "time from landing to disarming; 0 never"),
        "COM_SPOOLUP_TIME": ParameterSpec(1.0, 0.0, 30.0, "s", "time from arming to thrust"),
        "LNDMC_TRIG_TIME": ParameterSpec(
            1.0, 0.1, 10.0, "s", "time of each of the three stages of landing detection"
        ),
        "LNDMC_Z_VEL_MAX": ParameterSpec(
            0.25, 0.0, 10.0, "m/s", "vertical speed beyond which a vehicle on the ground moves"
        ),
    }
)
# SIH_KDV over SIH_MASS of the SIH quadrotor (airframe 10040).
SIH_DRAG_1_S = 1.0


def value_of(spec: VehicleSpec, name: str) -> float:
    """Return the value of a parameter for a vehicle, in the parameter's own unit."""
    return parameter_value(spec, name, PARAMETERS)


def drag_of(spec: VehicleSpec) -> float:
    """Return the drag over mass and airspeed (1/s): the vehicle's, or that of the reference airframe."""
    return SIH_DRAG_1_S if spec.linear_drag_1_s is None else spec.linear_drag_1_s
