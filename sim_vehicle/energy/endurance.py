"""How long and how far a vehicle goes on one battery, in steady motion without wind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.energy.battery import WH_J
from sim_vehicle.energy.power import flight_power_w
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec

__all__ = ["Best", "best_speeds", "endurance_s"]

_STEP_M_S = 0.1
# Of the cruise speed, where nothing tells how slowly a fixed wing may fly.
_SLOWEST = 0.8


@dataclass(frozen=True, slots=True)
class Best:
    """What a vehicle can do at most with a full battery."""

    # The longest time and the longest distance, and the speeds of these.
    endurance_s: float
    endurance_speed_m_s: float
    range_m: float
    range_speed_m_s: float


def endurance_s(spec: VehicleSpec, airspeed_m_s: float, *, used_fraction: float = 1.0) -> float:
    """Return the time of steady motion until a vehicle has used a share of its battery, seconds.

    An airspeed of 0 hovers. VehicleError if the vehicle has no battery or no power model.

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


def best_speeds(spec: VehicleSpec, *, least_airspeed_m_s: float | None = None) -> Best:
    """Return the longest time and the longest distance of a vehicle, with their speeds.

    ``least_airspeed_m_s`` is how slowly a fixed wing may fly, as its autopilot limits it; 0.8 of the cruise
    speed without. VehicleError if the vehicle has no battery or no power model.
    """
    slowest, fastest = 0.0, spec.fastest_m_s
    if spec.circles:
        slowest = _SLOWEST * spec.cruise_speed_m_s if least_airspeed_m_s is None else least_airspeed_m_s
        fastest = spec.airspeed_limit_m_s
    elif spec.drives:
        slowest = _STEP_M_S
    speeds = np.arange(slowest, fastest + 0.5 * _STEP_M_S, _STEP_M_S)
    times = np.array([endurance_s(spec, float(speed)) for speed in speeds])
    distances = times * speeds
    longest, farthest = int(np.argmax(times)), int(np.argmax(distances))
    return Best(
        float(times[longest]), float(speeds[longest]), float(distances[farthest]), float(speeds[farthest])
    )
