"""The parameters of the safety functions, as each autopilot names them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_vehicle.mavlink.parameters import MavParameter

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec

__all__ = ["safety_parameters"]


def safety_parameters(autopilot: str, spec: VehicleSpec) -> list[MavParameter]:
    """Return the parameters of fence, link loss, battery failsafes and setpoints.

    Examples
    --------
    >>> from sim_vehicle.airframe.spec import get_vehicle
    >>> [p.name for p in safety_parameters("px4", get_vehicle("quad"))][:3]
    ['BAT_EMERGEN_THR', 'COM_DL_LOSS_T', 'COM_OF_LOSS_T']
    """
    return _ardupilot(spec) if autopilot == "ardupilot" else _px4()


def _px4() -> list[MavParameter]:
    return [
        MavParameter("BAT_EMERGEN_THR", "emergency_fraction", low=0.0, high=0.3),
        MavParameter("COM_DL_LOSS_T", "link_timeout_s", integer=True, low=5, high=300),
        MavParameter("COM_OF_LOSS_T", "setpoint_timeout_s", low=0.1, high=60.0),
        MavParameter("GF_ACTION", "fence_action", integer=True, low=0, high=5),
        MavParameter("GF_MAX_HOR_DIST", "fence_radius_m", low=0.0, high=10_000.0),
        MavParameter("GF_MAX_VER_DIST", "fence_ceiling_m", low=0.0, high=10_000.0),
        MavParameter("NAV_DLL_ACT", "link_action", integer=True, low=0, high=6),
    ]


def _ardupilot(spec: VehicleSpec) -> list[MavParameter]:
    parameters = [
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
    ]
    battery = spec.battery
    if battery is not None:
        capacity_mah = battery.capacity_mah
        parameters += [
            MavParameter("BATT_CAPACITY", integer=True, value=round(capacity_mah)),
            MavParameter("BATT_CRT_VOLT", "critical_voltage_v", low=0.0, high=100.0),
            MavParameter("BATT_FS_VOLTSRC", "low_voltage_source", integer=True, low=0, high=1),
            MavParameter("BATT_LOW_TIMER", "low_voltage_timer_s", integer=True, low=0, high=120),
            MavParameter("BATT_LOW_VOLT", "low_voltage_v", low=0.0, high=100.0),
            MavParameter(
                "BATT_CRT_MAH", "critical_fraction", scale=capacity_mah, low=0.0, high=0.5 * capacity_mah
            ),
            MavParameter(
                "BATT_LOW_MAH", "low_fraction", scale=capacity_mah, low=0.0, high=0.9 * capacity_mah
            ),
        ]
    return parameters
