"""PX4's parameters that ground software reads or sets, besides those of the flight procedures.

Source: PX4 parameter reference, v1.17.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.mav_parameter import MavParameter

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec

__all__ = ["copter_parameters", "fixed_wing_parameters", "rover_parameters"]

_SAFETY = (
    MavParameter("BAT_EMERGEN_THR", "emergency_fraction", low=0.0, high=0.3),
    MavParameter("COM_RCL_EXCEPT", "failsafe_options", integer=True, low=0, high=31),
    MavParameter("COM_DL_LOSS_T", "link_timeout_s", integer=True, low=5, high=300),
    MavParameter("COM_OF_LOSS_T", "setpoint_timeout_s", low=0.1, high=60.0),
    MavParameter("GF_ACTION", "fence_action", integer=True, low=0, high=5),
    MavParameter("GF_MAX_HOR_DIST", "fence_radius_m", low=0.0, high=10_000.0),
    MavParameter("GF_MAX_VER_DIST", "fence_ceiling_m", low=0.0, high=10_000.0),
    MavParameter("MIS_TKO_LAND_REQ", "mission_requirement", integer=True, low=0, high=5),
    MavParameter("NAV_DLL_ACT", "link_action", integer=True, low=0, high=6),
)


def copter_parameters(spec: VehicleSpec, system_id: int) -> list[MavParameter]:
    """Parameters of a multirotor.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> [parameter.name for parameter in copter_parameters(get_vehicle("quad"), 1)][-2:]
    ['MPC_Z_VEL_MAX_DN', 'MPC_Z_VEL_MAX_UP']
    """
    return [
        *_common(spec, system_id, m.MAV_TYPE_QUADROTOR),
        MavParameter("MPC_ACC_HOR", value=spec.acceleration_m_s2),
        MavParameter("MPC_JERK_AUTO", value=spec.jerk_m_s3),
        MavParameter("MPC_LAND_SPEED", "landing_speed_m_s", low=0.1, high=spec.descent_speed_m_s),
        MavParameter("MPC_XY_CRUISE", "cruise_speed_m_s", low=0.1, high=spec.top_speed_m_s),
        MavParameter("MPC_XY_VEL_MAX", value=spec.speed_limit_m_s),
        MavParameter("MPC_Z_VEL_MAX_DN", value=spec.descent_speed_m_s),
        MavParameter("MPC_Z_VEL_MAX_UP", value=spec.climb_speed_m_s),
    ]


def fixed_wing_parameters(spec: VehicleSpec, system_id: int) -> list[MavParameter]:
    """Parameters of a fixed wing."""
    return [
        *_common(spec, system_id, m.MAV_TYPE_FIXED_WING),
        MavParameter("FW_MAN_P_MAX", value=30.0, stored=True, low=0.0, high=90.0, unit="deg"),
        MavParameter("FW_MAN_R_MAX", value=45.0, stored=True, low=0.0, high=90.0, unit="deg"),
    ]


def rover_parameters(spec: VehicleSpec, system_id: int) -> list[MavParameter]:
    """Parameters of a rover."""
    return _common(spec, system_id, m.MAV_TYPE_GROUND_ROVER)


def _common(spec: VehicleSpec, system_id: int, mav_type: int) -> list[MavParameter]:
    return [
        *_SAFETY,
        MavParameter("BAT1_N_CELLS", integer=True, value=spec.battery.cells if spec.battery else 0),
        MavParameter("BAT_CRIT_THR", "critical_fraction", low=0.0, high=0.5),
        MavParameter("BAT_LOW_THR", "low_fraction", low=0.0, high=0.9),
        MavParameter("COM_DISARM_LAND", "disarm_delay_s", low=0.0, high=600.0),
        MavParameter("COM_LOW_BAT_ACT", "low_battery_action", integer=True, low=0, high=3),
        MavParameter("CAL_ACC0_ID", integer=True, value=1310988),
        MavParameter("CAL_GYRO0_ID", integer=True, value=1310988),
        MavParameter("CAL_MAG0_ID", integer=True, value=197388),
        MavParameter("COM_RC_IN_MODE", integer=True, value=1),
        MavParameter("MAV_COMP_ID", integer=True, value=1),
        MavParameter("MAV_SYS_ID", integer=True, value=system_id),
        MavParameter("MAV_TYPE", integer=True, value=mav_type),
        MavParameter("MIS_TAKEOFF_ALT", "takeoff_altitude_m", low=0.5, high=spec.max_altitude_m),
        MavParameter("NAV_ACC_RAD", "acceptance_radius_m", low=0.05, high=200.0),
        MavParameter("RTL_RETURN_ALT", "return_altitude_m", low=0.5, high=spec.max_altitude_m),
        MavParameter("SYS_AUTOSTART", integer=True, value=4001),
    ]
