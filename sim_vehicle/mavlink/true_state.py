"""The true state of the vehicle, as the autopilots' simulators tell it beside what they believe."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from geo.rotation import Quaternion, quaternion_of
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.airframe.sensor_errors import SensorNoise
from sim_vehicle.execution.state import VehicleState

if TYPE_CHECKING:
    from sim_vehicle.mavlink.wire_state import WireState

__all__ = ["hil_state_quaternion", "int16", "quaternion", "sim_state", "to_body"]


def quaternion(state: VehicleState) -> Quaternion:
    """Return the attitude as a quaternion (w, x, y, z)."""
    return quaternion_of(state.roll_rad, state.pitch_rad, state.yaw_rad)


def to_body(state: VehicleState, north: float, east: float, down: float) -> tuple[float, float, float]:
    """Turn a vector from north, east, down to forward, right, down by yaw, pitch and roll in this order."""
    cy, sy = math.cos(state.yaw_rad), math.sin(state.yaw_rad)
    cp, sp = math.cos(state.pitch_rad), math.sin(state.pitch_rad)
    cr, sr = math.cos(state.roll_rad), math.sin(state.roll_rad)
    x, y = cy * north + sy * east, cy * east - sy * north
    x, z = cp * x - sp * down, sp * x + cp * down
    return x, cr * y + sr * z, cr * z - sr * y


def int16(value: float) -> int:
    """Return a number as a 16-bit integer, within what one holds."""
    return max(-32767, min(32767, round(value)))


def _truth(source: WireState) -> tuple[tuple[int, int], float, tuple[float, float, float]]:
    """Return true position (1e-7 degree), height above the sea, and velocity (north, east, down)."""
    east_m, north_m, up_m = source.sensed.true_m
    latitude, longitude = source.pilot.frame.to_wgs84(east_m, north_m)
    east, north, up = (
        believed + drift
        for believed, drift in zip(source.pilot.state.velocity_m_s, source.sensed.drift_m_s, strict=True)
    )
    position = (round(latitude * 1e7), round(longitude * 1e7))
    return position, up_m + source.home.altitude_m, (north, east, -up)


def hil_state_quaternion(source: WireState) -> Message:
    """HIL_STATE_QUATERNION, the true state as PX4's simulators send it."""
    state = source.pilot.state
    position, height_m, velocity = _truth(source)
    airspeed = min(65535, round(100.0 * state.airspeed_m_s))
    east, north, up = state.acceleration_m_s2
    force = to_body(state, north, east, -(up + GRAVITY_M_S2))
    north_cm_s, east_cm_s, down_cm_s = (int16(100.0 * part) for part in velocity)
    x_mg, y_mg, z_mg = (int16(1000.0 * part / GRAVITY_M_S2) for part in force)
    return m.MAVLink_hil_state_quaternion_message(
        source.unix_us,
        list(quaternion(state)),
        0.0,
        0.0,
        state.yaw_rate_rad_s,
        *position,
        round(1000.0 * height_m),
        north_cm_s,
        east_cm_s,
        down_cm_s,
        airspeed,
        airspeed,
        x_mg,
        y_mg,
        z_mg,
    )


def sim_state(source: WireState) -> Message:
    """SIM_STATE, the true state as ArduPilot's simulator sends it, with the accuracy of its position."""
    state = source.pilot.state
    (latitude, longitude), height_m, velocity = _truth(source)
    east, north, up = state.acceleration_m_s2
    noise = source.errors.noise if source.errors is not None else SensorNoise()
    spread = (noise.horizontal_accuracy_m, noise.barometer_m)
    return m.MAVLink_sim_state_message(
        *quaternion(state),
        state.roll_rad,
        state.pitch_rad,
        math.remainder(state.yaw_rad, 2.0 * math.pi),
        *to_body(state, north, east, -(up + GRAVITY_M_S2)),
        0.0,
        0.0,
        state.yaw_rate_rad_s,
        latitude / 1e7,
        longitude / 1e7,
        height_m,
        *spread,
        *velocity,
        latitude,
        longitude,
    )
