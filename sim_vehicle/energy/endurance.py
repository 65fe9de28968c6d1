"""How long and how far a vehicle goes on one battery, in steady motion without wind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.airframe.power_spec import FixedWingPowerSpec
from sim_vehicle.energy.battery import WH_J
from sim_vehicle.energy.power import flight_power_w
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec

__all__ = ["Best", "best_speeds", "endurance_s"]

_STEP_M_S = 0.1
# Of the cruise speed, where no autopilot's parameter tells how slowly a wing may fly.
_SLOWEST = 0.8


@dataclass(frozen=True, slots=True)
class Best:
    """What a vehicle can do at most with a full battery.

    Parameters
    ----------
    endurance_s, endurance_speed_m_s : float
        The longest time, and the speed at which it goes on so long.
    range_m, range_speed_m_s : float
        The longest way, and its speed.
    """

    endurance_s: float
    endurance_speed_m_s: float
    range_m: float
    range_speed_m_s: float


def endurance_s(spec: VehicleSpec, airspeed_m_s: float, *, used_fraction: float = 1.0) -> float:
    """Return how long a vehicle moves steadily until it has used a share of its battery, seconds.

    Parameters
    ----------
    spec : VehicleSpec
    airspeed_m_s : float
        0 hovers.
    used_fraction : float
        Share of the full battery.

    Raises
    ------
    VehicleError
        If the vehicle has no battery or no power model.

    Examples
    --------
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> round(endurance_s(get_vehicle("quad"), 0.0) / 60.0)
    30
    """
    if spec.battery is None or spec.power is None:
        msg = f"vehicle {spec.name} has no battery: it goes on for ever"
        raise VehicleError(msg)
    power_w = flight_power_w(spec.power, airspeed_m_s, battery=spec.battery)
    return used_fraction * spec.battery.capacity_wh * WH_J / power_w


def best_speeds(spec: VehicleSpec) -> Best:
    """Return the longest time and the longest way of a vehicle, with their speeds.

    Raises
    ------
    VehicleError
        If the vehicle has no battery or no power model.
    """
    slowest, fastest = 0.0, spec.fastest_m_s
    if isinstance(spec.power, FixedWingPowerSpec):
        slowest = dict(spec.parameters_for("px4")).get("FW_AIRSPD_MIN", _SLOWEST * spec.cruise_speed_m_s)
        fastest = spec.airspeed_limit_m_s
    elif spec.kind == "rover":
        slowest = _STEP_M_S
    speeds = np.arange(slowest, fastest + 0.5 * _STEP_M_S, _STEP_M_S)
    times = np.array([endurance_s(spec, float(speed)) for speed in speeds])
    ways = times * speeds
    longest, farthest = int(np.argmax(times)), int(np.argmax(ways))
    return Best(float(times[longest]), float(speeds[longest]), float(ways[farthest]), float(speeds[farthest]))
