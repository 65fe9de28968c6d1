"""Messages of the sensors and the estimator: satellite navigation, barometer, IMU."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.airframe.sensor_errors import HDOP, VDOP
from sim_vehicle.mavlink.true_state import to_body

if TYPE_CHECKING:
    from sim_vehicle.mavlink.wire_state import WireState

__all__ = [
    "UNUSED",
    "centidegrees",
    "ekf_status_report",
    "estimator_status",
    "gps_raw_int",
    "highres_imu",
    "scaled_pressure",
    "vibration",
]

UNUSED = 65535
"""Value of a 16-bit field that is not known."""
# attitude, velocities, positions and height above ground; without a position only what the sensors give
_ESTIMATES_OK = 1 | 2 | 4 | 8 | 16 | 32 | 256 | 512
_ESTIMATES_BLIND = 1 | 4 | 32
_FIX_3D = 3


def gps_raw_int(source: WireState) -> Message:
    """GPS_RAW_INT."""
    state = source.pilot.state
    position = source.position_e7
    boot = source.boot
    if not source.pilot.controls.position_ok or (boot is not None and boot.fix < _FIX_3D):
        fix = 1 if boot is None else min(boot.fix, 1)
        return m.MAVLink_gps_raw_int_message(source.unix_us, fix, 0, 0, 0, UNUSED, UNUSED, UNUSED, UNUSED, 0)
    east, north, _ = state.velocity_m_s
    east_m, north_m, up_m = source.sensed.gps_m
    eph, epv, horizontal_mm, vertical_mm = 70, 90, 500, 800
    if source.errors is not None:
        latitude, longitude = source.pilot.frame.to_wgs84(east_m, north_m)
        position = (
            round(latitude * 1e7),
            round(longitude * 1e7),
            round(1000.0 * (up_m + source.home.altitude_m)),
        )
        noise = source.errors.noise
        if noise.gps_m > 0.0:
            eph, epv = round(100.0 * HDOP), round(100.0 * VDOP)
            horizontal_mm = round(1000.0 * noise.horizontal_accuracy_m)
            vertical_mm = round(1000.0 * noise.vertical_accuracy_m)
    return m.MAVLink_gps_raw_int_message(
        source.unix_us,
        source.firmware.mavlink.gps_fix,
        position[0],
        position[1],
        position[2],
        eph,
        epv,
        min(65534, round(100.0 * math.hypot(east, north))),
        centidegrees(math.atan2(east, north)),
        16,
        position[2],
        horizontal_mm,
        vertical_mm,
        100,
    )


def highres_imu(source: WireState) -> Message:
    """HIGHRES_IMU: specific force and magnetic field along forward, right, down."""
    state = source.pilot.state
    east, north, up = state.acceleration_m_s2
    force = to_body(state, north, east, -(up + GRAVITY_M_S2))
    field = to_body(state, 0.25, 0.0, 0.41)
    return m.MAVLink_highres_imu_message(
        source.unix_us,
        *force,
        0.0,
        0.0,
        state.yaw_rate_rad_s,
        *field,
        _pressure_hpa(source),
        0.0,
        _barometer_m(source),
        25.0,
        0x1FFF,
    )


def scaled_pressure(source: WireState) -> Message:
    """SCALED_PRESSURE."""
    pressure_hpa = _pressure_hpa(source)
    return m.MAVLink_scaled_pressure_message(source.boot_ms, pressure_hpa, 0.0, 2500)


def vibration(source: WireState) -> Message:
    """VIBRATION of a vehicle that does not vibrate."""
    return m.MAVLink_vibration_message(source.unix_us, 0.0, 0.0, 0.0, 0, 0, 0)


def estimator_status(source: WireState) -> Message:
    """ESTIMATOR_STATUS."""
    ok = source.pilot.controls.position_ok
    return m.MAVLink_estimator_status_message(
        source.unix_us, _ESTIMATES_OK if ok else _ESTIMATES_BLIND, 0.1, 0.1, 0.1, 0.1, 0.0, 0.0, 0.5, 0.8
    )


def ekf_status_report(source: WireState) -> Message:
    """EKF_STATUS_REPORT."""
    ok = source.pilot.controls.position_ok
    flags = _ESTIMATES_OK if ok else _ESTIMATES_BLIND
    boot, cold = source.boot, source.firmware.cold_boot
    if cold is not None and boot is not None and not boot.knows_position:
        flags = cold.blind_flags
    return m.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, 0.1, 0.0)


def _pressure_hpa(source: WireState) -> float:
    """Pressure of the ICAO standard atmosphere at the vehicle's height above the sea."""
    height_m = min(11_000.0, _barometer_m(source))
    return float(1013.25 * (1.0 - 2.25577e-5 * height_m) ** 5.25588)


def _barometer_m(source: WireState) -> float:
    """Return the barometer's height above the sea."""
    if source.errors is None:
        return source.position_e7[2] / 1000.0
    return source.sensed.barometer_m + source.home.altitude_m


def centidegrees(angle_rad: float) -> int:
    """Return a direction in hundredths of a degree, 0 to 35,999."""
    return round(math.degrees(angle_rad) * 100.0) % 36000
