"""Telemetry of sensors, wind and estimates that ground stations show."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.execution.state import LandedState
from sim_vehicle.mavlink.telemetry import ESTIMATES_BLIND, ESTIMATES_OK
from sim_vehicle.pilot.fence import Breach

if TYPE_CHECKING:
    from sim_vehicle.mavlink.wire_state import WireState

__all__ = ["BUILDERS"]

_UNKNOWN_COVARIANCE = [math.nan] * 21


def _odometry(source: WireState) -> Message:
    return m.MAVLink_odometry_message(
        source.boot_ms * 1000,
        m.MAV_FRAME_LOCAL_NED,
        m.MAV_FRAME_BODY_FRD,
        *source.ned_m,
        source.quaternion,
        *source.to_body(*source.ned_m_s),
        *source.turning_rad_s,
        _UNKNOWN_COVARIANCE,
        _UNKNOWN_COVARIANCE,
        0,
        m.MAV_ESTIMATOR_TYPE_AUTOPILOT,
        100,
    )


def _altitude(source: WireState) -> Message:
    up, amsl = source.sensed.believed_m[2], source.altitude_m
    above_home = up - source.pilot.home_m[2]
    return m.MAVLink_altitude_message(source.boot_ms * 1000, amsl, amsl, up, above_home, up, up)


def _fence_status(source: WireState) -> Message:
    watch = source.pilot.failsafe.fence
    breached, count = int(watch.breach is not Breach.NONE), min(watch.count, 65535)
    return m.MAVLink_fence_status_message(breached, count, int(watch.breach), round(1000.0 * watch.broken_s))


def _wind_cov(source: WireState) -> Message:
    east, north = source.pilot.state.wind_m_s
    return m.MAVLink_wind_cov_message(
        source.boot_ms * 1000, north, east, 0.0, 0.0, 0.0, source.altitude_m, 0.5, 0.5
    )


def _wind(source: WireState) -> Message:
    east, north = source.pilot.state.wind_m_s
    direction = math.degrees(math.atan2(-east, -north)) if east or north else 0.0
    return m.MAVLink_wind_message(direction, math.hypot(east, north), 0.0)


def _highres_imu(source: WireState) -> Message:
    return m.MAVLink_highres_imu_message(
        source.unix_us,
        *source.force_m_s2,
        *source.turning_rad_s,
        *source.to_body(0.25, 0.0, 0.41),
        _pressure_hpa(source),
        0.0,
        _barometer_m(source),
        25.0,
        0x1FFF,
    )


def _state_for_gimbals(source: WireState) -> Message:
    """AUTOPILOT_STATE_FOR_GIMBAL_DEVICE, which in PX4 never reports TAKEOFF or LANDING."""
    on_ground = source.pilot.landed is LandedState.ON_GROUND
    return m.MAVLink_autopilot_state_for_gimbal_device_message(
        *(0, 0, source.boot_ms * 1000),
        source.quaternion,
        0,
        *source.ned_m_s,
        0,
        source.turning_rad_s[2],
        ESTIMATES_OK if source.pilot.position_ok else ESTIMATES_BLIND,
        m.MAV_LANDED_STATE_ON_GROUND if on_ground else m.MAV_LANDED_STATE_IN_AIR,
    )


def _pressure_hpa(source: WireState) -> float:
    """Return the pressure of the ICAO standard atmosphere at the barometer's altitude."""
    height_m = min(11_000.0, _barometer_m(source))
    return float(1013.25 * (1.0 - 2.25577e-5 * height_m) ** 5.25588)


def _barometer_m(source: WireState) -> float:
    """Return the barometer's altitude above sea level."""
    if source.errors is None:
        return source.altitude_m
    return source.sensed.barometer_m + source.home.altitude_m


BUILDERS: dict[int, Callable[[WireState], Message | None]] = {
    m.MAVLINK_MSG_ID_ODOMETRY: _odometry,
    m.MAVLINK_MSG_ID_ALTITUDE: _altitude,
    m.MAVLINK_MSG_ID_FENCE_STATUS: _fence_status,
    m.MAVLINK_MSG_ID_WIND_COV: _wind_cov,
    m.MAVLINK_MSG_ID_WIND: _wind,
    # The simulated vehicle does not vibrate.
    m.MAVLINK_MSG_ID_VIBRATION: lambda s: m.MAVLink_vibration_message(s.unix_us, 0.0, 0.0, 0.0, 0, 0, 0),
    m.MAVLINK_MSG_ID_SCALED_PRESSURE: lambda s: m.MAVLink_scaled_pressure_message(
        s.boot_ms, _pressure_hpa(s), 0.0, 2500
    ),
    m.MAVLINK_MSG_ID_HIGHRES_IMU: _highres_imu,
    m.MAVLINK_MSG_ID_AUTOPILOT_STATE_FOR_GIMBAL_DEVICE: _state_for_gimbals,
}
"""Builders by message id."""
