"""Values of a vehicle that parameters change while it runs, independent of their names in an autopilot."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.autopilot.failsafe_rules import FailsafeDefaults

__all__ = ["RuntimeParameters"]


@dataclass(slots=True)
class RuntimeParameters:
    """The values of one vehicle, which its parameters change while it runs; SI units.

    Parameters
    ----------
    low_voltage_v, critical_voltage_v, low_voltage_timer_s : float
        Voltages of the whole pack that are low and critical after that time; 0 is none. Of ArduPilot only.
    fence_enable, fence_action, fence_type : int
        The autopilot's own values; ``fence_type`` as FENCE_TYPE: 1 ceiling, 2 radius, 4 areas.
    """

    # As in `sim_vehicle.airframe.spec.VehicleSpec`.
    cruise_speed_m_s: float
    acceptance_radius_m: float
    takeoff_altitude_m: float
    return_altitude_m: float
    landing_speed_m_s: float
    disarm_delay_s: float
    """Time from touch-down to disarming."""
    # Battery levels of the two failsafes.
    low_fraction: float
    critical_fraction: float
    # The autopilot's own values (see the failsafe rules); the second is used by ArduPilot only.
    low_battery_action: int
    critical_battery_action: int
    fence_enable: int
    fence_action: int
    # Height above and distance from home; 0 is no limit.
    fence_ceiling_m: float
    fence_radius_m: float
    link_timeout_s: float
    """Silence of the ground station after which it is lost."""
    setpoint_timeout_s: float
    """Age at which setpoints hold no more."""
    low_voltage_v: float
    emergency_fraction: float = 0.05
    """Level of the last battery failsafe."""
    critical_voltage_v: float = 0.0
    low_voltage_timer_s: float = 10.0
    low_voltage_source: int = 0
    """0 for the voltage as it is, 1 for it without the sag of the load."""
    fence_type: int = 7
    link_action: int = 0
    """The autopilot's own value; 0 is none."""
    failsafe_options: int = 0
    """Bits of FS_OPTIONS (ArduPilot)."""
    mission_requirement: int = 0
    """What a mission has to have (MIS_TKO_LAND_REQ of PX4); 0 is nothing."""
    settings: dict[str, float] = field(default_factory=dict)
    """The autopilot's parameters that move the vehicle and are not at their defaults, in their own units."""
    stored: dict[str, float] = field(default_factory=dict)
    """All others that are not at their defaults, in their own units; see `kept`."""

    def kept(self, name: str, default: float) -> float:
        """Value of a parameter of the autopilot's that is none of the above, in its own unit."""
        return self.stored.get(name, self.settings.get(name, default))

    @classmethod
    def of(cls, spec: VehicleSpec, defaults: FailsafeDefaults) -> RuntimeParameters:
        """Take the values of a vehicle as built, and of its firmware's safety functions."""
        battery = spec.battery
        return cls(
            spec.cruise_speed_m_s,
            spec.acceptance_radius_m,
            spec.takeoff_altitude_m,
            spec.return_altitude_m,
            spec.landing_speed_m_s,
            spec.disarm_delay_s,
            battery.reserve_fraction if battery else 0.0,
            battery.critical_fraction if battery else 0.0,
            defaults.low_battery_action,
            defaults.critical_battery_action,
            defaults.fence_enable,
            defaults.fence_action,
            defaults.fence_ceiling_m,
            defaults.fence_radius_m,
            defaults.link_timeout_s,
            defaults.setpoint_timeout_s,
            defaults.low_voltage_for(spec),
            failsafe_options=defaults.failsafe_options,
            mission_requirement=defaults.mission_requirement,
            settings=dict(spec.parameters),
        )
