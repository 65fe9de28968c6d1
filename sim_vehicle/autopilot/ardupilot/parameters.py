"""ArduPilot's parameters that ground software reads or sets, besides those of the flight procedures.

Source: ArduCopter, ArduPlane and Rover parameter references, 4.6.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_vehicle.autopilot.mav_parameter import MavParameter

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec

__all__ = ["copter_parameters", "vehicle_parameters"]

_SAFETY = (
    MavParameter("BATT_FS_CRT_ACT", "critical_battery_action", integer=True, low=0, high=7),
    MavParameter("BATT_FS_LOW_ACT", "low_battery_action", integer=True, low=0, high=7),
    MavParameter("FENCE_ACTION", "fence_action", integer=True, low=0, high=5),
    MavParameter("FENCE_ALT_MAX", "fence_ceiling_m", low=10.0, high=1000.0),
    MavParameter("FENCE_ENABLE", "fence_enable", integer=True, low=0, high=1),
    MavParameter("FENCE_RADIUS", "fence_radius_m", low=30.0, high=10_000.0),
    MavParameter("FENCE_TYPE", "fence_type", integer=True, low=0, high=7),
    MavParameter("FS_GCS_ENABLE", "link_action", integer=True, low=0, high=7),
    MavParameter("FS_GCS_TIMEOUT", "link_timeout_s", low=2.0, high=120.0),
    MavParameter("GUID_TIMEOUT", "setpoint_timeout_s", low=0.1, high=5.0),
)

# The gimbal (`sim_vehicle.pilot.gimbal`). It rests straight down, as that of a mapping camera.
_MOUNT = tuple(
    MavParameter(f"MNT1_{name}", integer=integer, bits=8, value=value, stored=True, low=low, high=high)
    for name, integer, value, low, high in (
        ("DEFLT_MODE", True, 1, 0, 6),
        ("NEUTRAL_X", False, 0, -180, 180),
        ("NEUTRAL_Y", False, -90, -180, 180),
        ("NEUTRAL_Z", False, 0, -180, 180),
        ("PITCH_MAX", False, 20, -90, 90),
        ("PITCH_MIN", False, -90, -90, 90),
        ("RETRACT_X", False, 0, -180, 180),
        ("RETRACT_Y", False, 0, -180, 180),
        ("RETRACT_Z", False, 0, -180, 180),
        ("ROLL_MAX", False, 30, -180, 180),
        ("ROLL_MIN", False, -30, -180, 180),
        ("YAW_MAX", False, 180, -180, 180),
        ("YAW_MIN", False, -180, -180, 180),
    )
)


def copter_parameters(spec: VehicleSpec, system_id: int) -> list[MavParameter]:
    """Parameters of ArduCopter."""
    ceiling_cm = 100.0 * spec.max_altitude_m
    return [
        *vehicle_parameters(spec, system_id),
        MavParameter("DISARM_DELAY", integer=True, value=10.0, stored=True, bits=8, low=0, high=127),
        MavParameter("FRAME_CLASS", integer=True, value=1),
        MavParameter("FRAME_TYPE", integer=True, value=1),
        MavParameter("FS_OPTIONS", "failsafe_options", integer=True, low=0, high=63),
        MavParameter("LAND_SPEED", "landing_speed_m_s", True, 100.0, 10, 100.0 * spec.descent_speed_m_s),
        MavParameter("PILOT_TKOFF_ALT", "takeoff_altitude_m", False, 100.0, 50.0, ceiling_cm),
        MavParameter("RTL_ALT", "return_altitude_m", True, 100.0, 50, ceiling_cm),
        MavParameter("WPNAV_ACCEL", value=100.0 * spec.acceleration_m_s2),
        MavParameter("WPNAV_RADIUS", "acceptance_radius_m", False, 100.0, 5.0, 20_000.0),
        MavParameter("WPNAV_SPEED", "cruise_speed_m_s", False, 100.0, 10.0, 100.0 * spec.top_speed_m_s),
        MavParameter("WPNAV_SPEED_DN", value=100.0 * spec.descent_speed_m_s),
        MavParameter("WPNAV_SPEED_UP", value=100.0 * spec.climb_speed_m_s),
    ]


def vehicle_parameters(spec: VehicleSpec, system_id: int) -> list[MavParameter]:
    """Parameters of ArduPlane and Rover, which ArduCopter has too.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> "LAND_SPEED" in [parameter.name for parameter in vehicle_parameters(get_vehicle("rover"), 1)]
    False
    """
    return [
        *_SAFETY,
        # KiB on the SD card for the plan, 0 for the board's own storage; read at the start.
        MavParameter("BRD_SD_FENCE", integer=True, value=0.0, stored=True, bits=16, low=0, high=64),
        MavParameter("BRD_SD_MISSION", integer=True, value=0.0, stored=True, bits=16, low=0, high=64),
        *_battery_parameters(spec),
        *_MOUNT,
        MavParameter("FENCE_TOTAL", integer=True),
        MavParameter("MIS_TOTAL", integer=True),
        MavParameter("RALLY_TOTAL", integer=True),
        MavParameter("MAV_SYSID", integer=True, value=system_id),
    ]


def _battery_parameters(spec: VehicleSpec) -> list[MavParameter]:
    if spec.battery is None:
        return []
    mah = spec.battery.capacity_mah
    return [
        MavParameter("BATT_CAPACITY", integer=True, value=round(mah)),
        MavParameter("BATT_CRT_VOLT", "critical_voltage_v", low=0.0, high=100.0),
        MavParameter("BATT_FS_VOLTSRC", "low_voltage_source", integer=True, low=0, high=1),
        MavParameter("BATT_LOW_TIMER", "low_voltage_timer_s", integer=True, low=0, high=120),
        MavParameter("BATT_LOW_VOLT", "low_voltage_v", low=0.0, high=100.0),
        MavParameter("BATT_CRT_MAH", "critical_fraction", scale=mah, low=0.0, high=0.5 * mah),
        MavParameter("BATT_LOW_MAH", "low_fraction", scale=mah, low=0.0, high=0.9 * mah),
    ]
