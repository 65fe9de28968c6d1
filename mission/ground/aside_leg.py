"""Leg that a vehicle flies in guided mode while its mission is replaced."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mission.ground.items import apart_m, is_return
from mission.ground.vehicle_state import VehicleMonitor
from mission.model import GeoPoint, Mission, MissionItem

__all__ = ["Leg"]

# Defaults of PSC_POSXY_P and WPNAV_ACCEL, from which ArduCopter computes its stopping point.
_STOP_P_PER_S, _STOP_M_S2 = 1.0, 2.5
# Margin for delayed positions: a vehicle that leaves at exactly the stopping distance creeps to the target.
_LEAVE_SPARE_M, _MOST_LEAVE_M = 0.5, 12.0


@dataclass(slots=True)
class Leg:
    """Leg to an item of a plan in guided mode, or to above home if the item is the return."""

    plan: Mission
    index: int
    monitor: VehicleMonitor
    home: GeoPoint | None

    @property
    def item(self) -> MissionItem:
        """Item at the end of the leg."""
        return self.plan.items[self.index]

    @property
    def is_waypoint(self) -> bool:
        """Whether the leg ends at a waypoint, not above home."""
        return self.item.has_position and not is_return(self.item)

    @property
    def target(self) -> tuple[float, float, float]:
        """End of the leg: latitude and longitude (degrees), height above home (m)."""
        item, state, home = self.item, self.monitor.state, self.home
        if self.is_waypoint:
            return item.x, item.y, item.z
        if home is not None:
            return home.latitude_deg, home.longitude_deg, state.height_m
        return state.latitude_deg, state.longitude_deg, state.height_m

    @property
    def distance_m(self) -> float:
        """Horizontal distance to the target (m)."""
        state, (latitude, longitude, _) = self.monitor.state, self.target
        if not math.isfinite(state.latitude_deg):
            return math.inf
        return apart_m((state.latitude_deg, state.longitude_deg), (latitude, longitude))

    @property
    def nearing_m_s(self) -> float:
        """Horizontal closing speed to the target (m/s)."""
        state, (latitude, longitude, _) = self.monitor.state, self.target
        north = latitude - state.latitude_deg
        east = (longitude - state.longitude_deg) * math.cos(math.radians(latitude))
        away = math.hypot(east, north)
        return (state.velocity_m_s[0] * east + state.velocity_m_s[1] * north) / away if away > 0.0 else 0.0

    @property
    def leave_m(self) -> float:
        """Distance to the target at which to resume the mission (m): stopping distance plus a margin."""
        return min(_stopping_m(self.monitor.state.ground_speed_m_s) + _LEAVE_SPARE_M, _MOST_LEAVE_M)


def _stopping_m(speed_m_s: float) -> float:
    """Return ArduCopter's stopping distance (m), from the square-root controller of `AC_PosControl`."""
    linear_m_s = _STOP_M_S2 / _STOP_P_PER_S
    if speed_m_s < linear_m_s:
        return speed_m_s / _STOP_P_PER_S
    return 0.5 * (linear_m_s / _STOP_P_PER_S + speed_m_s**2 / _STOP_M_S2)
