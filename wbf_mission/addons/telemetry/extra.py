"""Telemetry of a simulated vehicle that is shown by ground stations but not needed for the flight.

Sources of ArduPilot's messages: ``GCS_Common.cpp``, ``GCS_MAVLink_Copter.cpp`` and the constants of its
simulator (SITL).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.execution.state import LandedState
from sim_vehicle.mavlink.extras import VehicleExtra
from sim_vehicle.mavlink.telemetry import ESTIMATES_BLIND, ESTIMATES_OK
from sim_vehicle.mavlink.wire_state import UNUSED, int16_vector
from sim_vehicle.pilot.fence import Breach

if TYPE_CHECKING:
    from sim_vehicle.mavlink.parameters import ParameterSet
    from sim_vehicle.mavlink.plan_receiver import PlanReceiver
    from sim_vehicle.mavlink.wire_state import Vector, WireState

_GAUSS = (0.25, 0.0, 0.41)
_CENTIDEGREES = 2500
# Longest interval over which roll and pitch rates are averaged.
_LONGEST_MEAN_S = 1.5
_UNKNOWN_COVARIANCE = [math.nan] * 21
# Type mask for a position alone, with the unused bits that ArduPilot sets.
_ONLY_GLOBAL_POSITION = 0xFDF8
_BOARD_MV, _FREE_BYTES = 5000, 131_072
# TERRAIN_SPACING, and the number of 4 x 4 blocks in a grid block.
_SPACING_M, _LOADED = 100, 56
_MIDDLE_US, _LEAST_US = 1500, 1000


class TelemetryExtra(VehicleExtra):
    """Telemetry that ground stations show."""

    def __init__(self, state: WireState, parameters: ParameterSet, plans: PlanReceiver) -> None:
        super().__init__(state, parameters, plans)
        self._pings = 0
        self._attitude: Vector = (-math.inf, 0.0, 0.0)
        self._rates = (0.0, 0.0, 0.0)
        self.builders = {
            **_BUILDERS,
            m.MAVLINK_MSG_ID_PING: self._ping,
            m.MAVLINK_MSG_ID_RAW_IMU: lambda s: m.MAVLink_raw_imu_message(
                s.boot_ms * 1000, *self._readings(s, 0, _CENTIDEGREES)
            ),
            m.MAVLINK_MSG_ID_SCALED_IMU2: lambda s: m.MAVLink_scaled_imu2_message(
                s.boot_ms, *self._readings(s, _CENTIDEGREES)
            ),
        }

    def _ping(self, source: WireState) -> Message:
        """Return a PING with the vehicle's sequence number, which starts at 0."""
        self._pings += 1
        return m.MAVLink_ping_message(source.unix_us, self._pings - 1, 0, 0)

    def _readings(self, source: WireState, *further: int) -> list[int]:
        """Return accelerometer (1e-3 g), gyroscope (mrad/s), compass (mgauss): each forward, right, down."""
        return [
            *int16_vector(source.force_m_s2, 1000.0, GRAVITY_M_S2),
            *int16_vector(self._body_rates(), 1000.0),
            *int16_vector(source.to_body(*_GAUSS), 1000.0),
            *further,
        ]

    def _body_rates(self) -> Vector:
        """Return the body rates (forward, right, down; rad/s), averaged since the previous call."""
        state, (time_s, roll, pitch) = self.state.pilot.state, self._attitude
        passed_s = state.time_s - time_s
        if passed_s > 0.0:
            rolling, pitching = 0.0, 0.0
            if passed_s < _LONGEST_MEAN_S:
                rolling = math.remainder(state.roll_rad - roll, 2.0 * math.pi) / passed_s
                pitching = (state.pitch_rad - pitch) / passed_s
            sr, cr = math.sin(state.roll_rad), math.cos(state.roll_rad)
            sp, cp = math.sin(state.pitch_rad), math.cos(state.pitch_rad)
            yawing = state.yaw_rate_rad_s
            self._attitude = (state.time_s, state.roll_rad, state.pitch_rad)
            self._rates = (
                rolling - yawing * sp,
                pitching * cr + yawing * sr * cp,
                yawing * cr * cp - pitching * sr,
            )
        return self._rates


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
        *source.to_body(*_GAUSS),
        _pressure_hpa(source),
        0.0,
        _barometer_m(source),
        25.0,
        0x1FFF,
    )


def _state_for_gimbals(source: WireState) -> Message:
    """Return AUTOPILOT_STATE_FOR_GIMBAL_DEVICE; as in PX4, it never reports TAKEOFF or LANDING."""
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


def _nav_controller_output(source: WireState) -> Message:
    x, y, z = source.pilot.state.position_m
    bearing = distance = rise = aside = 0.0
    target = source.target_leg
    if target is not None:
        (ax, ay, az), (bx, by, bz) = target
        distance, bearing = math.hypot(bx - x, by - y), math.degrees(math.atan2(bx - x, by - y))
        length = math.hypot(bx - ax, by - ay)
        share = 1.0
        if length > 0.0:
            ux, uy = (bx - ax) / length, (by - ay) / length
            aside = (x - ax) * uy - (y - ay) * ux
            share = min(max(((x - ax) * ux + (y - ay) * uy) / length, 0.0), 1.0)
        rise = az + share * (bz - az) - z
    roll, pitch, yaw = map(math.degrees, source.angles_rad)
    return m.MAVLink_nav_controller_output_message(
        roll, pitch, round(yaw), round(bearing), min(round(distance), UNUSED), rise, 0.0, aside
    )


def _position_target_global_int(source: WireState) -> Message | None:
    target = source.target_leg
    if target is None:
        return None
    latitude, longitude, altitude_mm = source.e7_of(target[1])
    return m.MAVLink_position_target_global_int_message(
        source.boot_ms, 0, _ONLY_GLOBAL_POSITION, latitude, longitude, altitude_mm / 1000.0, *[0.0] * 8
    )


def _servo_output_raw(source: WireState) -> Message:
    state, spec = source.pilot.state, source.pilot.spec
    flies = state.armed and state.landed is not LandedState.ON_GROUND
    share = state.throttle if flies else 0.0
    if spec.hovers:
        if flies and source.pilot.executor.motion.attitude() is None:
            east, north, up = state.acceleration_m_s2
            share = source.mavlink.hover_share * math.hypot(east, north, up + GRAVITY_M_S2) / GRAVITY_M_S2
        outputs = (round(source.mavlink.motor_us(share if flies else None, state.armed)),) * 4
    else:
        turn = 0.0 if not flies else state.yaw_rate_rad_s / spec.yaw_rate_rad_s
        turn = state.roll_rad / (0.25 * math.pi) if spec.circles else turn
        thrust = 500.0 * share + _MIDDLE_US if spec.drives else _LEAST_US + 1000.0 * share
        steered = round(_MIDDLE_US + 500.0 * min(max(turn, -1.0), 1.0))
        outputs = (steered, _MIDDLE_US, round(thrust), _MIDDLE_US)
    return m.MAVLink_servo_output_raw_message(source.boot_ms * 1000 & 0xFFFFFFFF, 0, *outputs, 0, 0, 0, 0)


def _ahrs2(source: WireState) -> Message:
    """Return AHRS2: the second estimator reports the unfiltered GPS position."""
    latitude, longitude, altitude_mm = source.e7_of(source.sensed.gps_m)
    return m.MAVLink_ahrs2_message(*source.angles_rad, altitude_mm / 1000.0, latitude, longitude)


def _terrain_report(source: WireState) -> Message:
    """Return a TERRAIN_REPORT for flat terrain at the altitude of home."""
    height_m = source.sensed.believed_m[2]
    return m.MAVLink_terrain_report_message(
        *source.position_e7[:2], _SPACING_M, source.home.altitude_m, height_m, 0, _LOADED
    )


_BUILDERS: dict[int, Callable[[WireState], Message | None]] = {
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
    m.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: _nav_controller_output,
    m.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: _position_target_global_int,
    m.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: _servo_output_raw,
    m.MAVLINK_MSG_ID_POWER_STATUS: lambda _: m.MAVLink_power_status_message(_BOARD_MV, 0, 0),
    m.MAVLINK_MSG_ID_MEMINFO: lambda _: m.MAVLink_meminfo_message(0, UNUSED, _FREE_BYTES),
    # The simulated gyroscopes do not drift.
    m.MAVLINK_MSG_ID_AHRS: lambda _: m.MAVLink_ahrs_message(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    m.MAVLINK_MSG_ID_AHRS2: _ahrs2,
    m.MAVLINK_MSG_ID_TERRAIN_REPORT: _terrain_report,
}
"""Builders by message id; a builder returns None if there is nothing to send."""
