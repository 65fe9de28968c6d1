"""The state of a vehicle from its motion: attitude, airspeed, battery."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sim_vehicle.airframe.spec import AIR_DENSITY_KG_M3, GRAVITY_M_S2
from sim_vehicle.execution.state import LandedState, VehicleState

if TYPE_CHECKING:
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.execution.leg_follower import LegFollower
    from sim_vehicle.motion.model import MotionState


def read_state(follower: LegFollower, current_seq: int) -> VehicleState:
    """Read the state of a vehicle that is at a mission item (-1 without a mission)."""
    motion = follower.motion
    now, time_s = motion.snapshot(), motion.time_s
    wind_x, wind_y = now.wind_m_s
    air = (now.velocity_m_s[0] - wind_x, now.velocity_m_s[1] - wind_y)
    airspeed = math.sqrt(air[0] * air[0] + air[1] * air[1])
    roll = pitch = 0.0
    throttle = 0.5
    attitude = motion.attitude()
    if attitude is not None:
        roll, pitch, airspeed, throttle = attitude
    elif follower.landed is not LandedState.ON_GROUND and not follower.spec.is_ideal:
        roll, pitch = _attitude(follower, now, air, airspeed)
    meter = follower.battery_meter
    battery = meter.read(time_s, now.energy_j, now.power_w) if meter is not None else None
    return VehicleState(
        time_s=time_s,
        position_m=now.position_m,
        velocity_m_s=now.velocity_m_s,
        acceleration_m_s2=now.acceleration_m_s2,
        roll_rad=roll,
        pitch_rad=pitch,
        yaw_rad=now.heading_rad,
        yaw_rate_rad_s=now.yaw_rate_rad_s,
        airspeed_m_s=airspeed,
        wind_m_s=now.wind_m_s,
        power_w=now.power_w,
        battery=battery,
        path_length_m=now.path_length_m,
        armed=follower.armed,
        landed=follower.landed,
        phase=follower.phase,
        current_seq=current_seq,
        throttle=throttle,
    )


def drag_1_s(spec: VehicleSpec, airspeed_m_s: float) -> float:
    """Return the drag over mass and airspeed."""
    power = spec.power
    if power is None:
        return 0.0
    return 0.5 * AIR_DENSITY_KG_M3 * power.drag_area_m2 * airspeed_m_s / power.mass_kg


def _attitude(
    follower: LegFollower, now: MotionState, air: tuple[float, float], airspeed: float
) -> tuple[float, float]:
    """Roll and pitch whose thrust gives the acceleration and holds against the drag of the air."""
    drag = drag_1_s(follower.spec, airspeed)
    ax, ay, az = now.acceleration_m_s2
    sin, cos = math.sin(now.heading_rad), math.cos(now.heading_rad)
    east, north = ax + drag * air[0], ay + drag * air[1]
    lift = GRAVITY_M_S2 + az
    pitch = -math.atan2(east * sin + north * cos, lift)
    roll = math.atan2((east * cos - north * sin) * math.cos(pitch), lift)
    return roll, pitch
