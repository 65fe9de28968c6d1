"""Telemetry messages from the state of the vehicle: one table, message id to builder."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.execution.state import FlightPhase, LandedState
from sim_vehicle.mavlink.flight_messages import FLIGHT_BUILDERS
from sim_vehicle.mavlink.gimbal_messages import GIMBAL_BUILDERS
from sim_vehicle.mavlink.sensor_messages import (
    UNUSED,
    centidegrees,
    ekf_status_report,
    estimator_status,
    gps_raw_int,
    highres_imu,
    scaled_pressure,
    vibration,
)
from sim_vehicle.mavlink.true_state import hil_state_quaternion, int16, quaternion, sim_state, to_body
from sim_vehicle.pilot.fence import Breach
from sim_vehicle.pilot.notices import MissionState

if TYPE_CHECKING:
    from sim_vehicle.mavlink.wire_state import WireState

__all__ = ["BUILDERS", "built"]

_GPS = 32
_FENCE = 1 << 20
_PREARM = 1 << 28
# gyro, accelerometer, magnetometer, barometer, GPS, motors, radio control, geofence, AHRS, battery, arming
# checks; without the geofence bit MAVProxy reports a breach, without the last one MAVSDK says not armable.
_SENSORS = 1 | 2 | 4 | 8 | _GPS | 1 << 15 | 1 << 16 | 1 << 20 | 1 << 21 | 1 << 25 | _PREARM
# by the level of the battery: fine, low, critical, almost empty
_CHARGE_STATES = (
    m.MAV_BATTERY_CHARGE_STATE_OK,
    m.MAV_BATTERY_CHARGE_STATE_LOW,
    m.MAV_BATTERY_CHARGE_STATE_CRITICAL,
    m.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
)
_HOME_Q = [1.0, 0.0, 0.0, 0.0]
_NAN = math.nan
_UNKNOWN_COVARIANCE = [_NAN] * 21


def _heartbeat(source: WireState) -> Message:
    pilot, profile = source.pilot, source.firmware.mavlink
    # Without the custom mode bit peers do not read the custom mode.
    base_mode = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | profile.modes.base.of(pilot.mode)
    if pilot.armed:
        base_mode |= m.MAV_MODE_FLAG_SAFETY_ARMED
    if pilot.failsafe.active:
        status = m.MAV_STATE_EMERGENCY if pilot.state.phase is FlightPhase.DEPLETED else m.MAV_STATE_CRITICAL
    else:
        status = m.MAV_STATE_ACTIVE if pilot.armed else m.MAV_STATE_STANDBY
    return m.MAVLink_heartbeat_message(
        profile.identity.mav_type,
        profile.identity.mav_autopilot,
        int(base_mode),
        source.custom_mode,
        status,
        3,
    )


def _sys_status(source: WireState) -> Message:
    pilot = source.pilot
    health = _SENSORS
    enabled = _SENSORS if pilot.parameters.fence_enable else _SENSORS & ~_FENCE
    if not pilot.controls.position_ok:
        health &= ~_GPS
    if pilot.failsafe.fence.breach and pilot.armed:
        health &= ~_FENCE
    if not pilot.armed and pilot.arming.health_problem() is not None:
        health &= ~_PREARM
    battery = pilot.state.battery
    millivolts, centiamps, percent = UNUSED, -1, -1
    if battery is not None:
        millivolts, centiamps = round(1000.0 * battery.voltage_v), int16(100.0 * battery.current_a)
        percent = math.ceil(100.0 * battery.fraction)
    return m.MAVLink_sys_status_message(
        _SENSORS, enabled, health, 100, millivolts, centiamps, percent, 0, 0, 0, 0, 0, 0
    )


def _system_time(source: WireState) -> Message:
    return m.MAVLink_system_time_message(source.unix_us, source.boot_ms)


def _global_position_int(source: WireState) -> Message:
    state = source.pilot.state
    position = source.position_e7
    east, north, up = source.velocity_m_s
    return m.MAVLink_global_position_int_message(
        source.boot_ms,
        position[0],
        position[1],
        position[2],
        round(1000.0 * source.sensed.believed_m[2]),
        int16(100.0 * north),
        int16(100.0 * east),
        int16(-100.0 * up),
        centidegrees(state.yaw_rad),
    )


def _local_position_ned(source: WireState) -> Message:
    east, north, up = source.sensed.believed_m
    v_east, v_north, v_up = source.velocity_m_s
    return m.MAVLink_local_position_ned_message(source.boot_ms, north, east, -up, v_north, v_east, -v_up)


def _attitude(source: WireState) -> Message:
    state = source.pilot.state
    yaw = math.remainder(state.yaw_rad, 2.0 * math.pi)
    return m.MAVLink_attitude_message(
        source.boot_ms, state.roll_rad, state.pitch_rad, yaw, 0.0, 0.0, state.yaw_rate_rad_s
    )


def _attitude_quaternion(source: WireState) -> Message:
    state = source.pilot.state
    return m.MAVLink_attitude_quaternion_message(
        source.boot_ms, *quaternion(state), 0.0, 0.0, state.yaw_rate_rad_s
    )


def _odometry(source: WireState) -> Message:
    state = source.pilot.state
    east, north, up = source.sensed.believed_m
    v_east, v_north, v_up = source.velocity_m_s
    return m.MAVLink_odometry_message(
        source.boot_ms * 1000,
        m.MAV_FRAME_LOCAL_NED,
        m.MAV_FRAME_BODY_FRD,
        north,
        east,
        -up,
        quaternion(state),
        *to_body(state, v_north, v_east, -v_up),
        0.0,
        0.0,
        state.yaw_rate_rad_s,
        _UNKNOWN_COVARIANCE,
        _UNKNOWN_COVARIANCE,
        0,
        m.MAV_ESTIMATOR_TYPE_AUTOPILOT,
        100,
    )


def _vfr_hud(source: WireState) -> Message:
    state = source.pilot.state
    east, north, up = source.velocity_m_s
    flies = state.armed and state.landed is not LandedState.ON_GROUND
    return m.MAVLink_vfr_hud_message(
        state.airspeed_m_s,
        math.hypot(east, north),
        int(math.degrees(state.yaw_rad)) % 360,
        # A rover that brakes or drives backwards has a negative one; the field is a share of the power.
        min(100, round(100.0 * abs(state.throttle))) if flies else 0,
        source.position_e7[2] / 1000.0,
        up,
    )


def _altitude(source: WireState) -> Message:
    up = source.sensed.believed_m[2]
    amsl = source.position_e7[2] / 1000.0
    return m.MAVLink_altitude_message(source.boot_ms * 1000, amsl, amsl, up, up, up, up)


def _fence_status(source: WireState) -> Message:
    watch = source.pilot.failsafe.fence
    return m.MAVLink_fence_status_message(
        int(watch.breach is not Breach.NONE),
        min(watch.count, 65535),
        int(watch.breach),
        round(1000.0 * watch.broken_s),
    )


def _battery_status(source: WireState) -> Message:
    battery = source.pilot.state.battery
    if battery is None:
        return m.MAVLink_battery_status_message(0, 1, 1, 32767, [UNUSED] * 10, -1, -1, -1, -1, 0, 0)
    cell = min(65534, round(1000.0 * battery.voltage_v / battery.cells))
    cells = [cell] * min(10, battery.cells) + [UNUSED] * max(0, 10 - battery.cells)
    return m.MAVLink_battery_status_message(
        0,
        m.MAV_BATTERY_FUNCTION_ALL,
        m.MAV_BATTERY_TYPE_LIPO,
        2500,
        cells,
        int16(100.0 * battery.current_a),
        round(battery.used_mah),
        round(36.0 * battery.used_wh),
        math.ceil(100.0 * battery.fraction),
        _remaining_s(source),
        _CHARGE_STATES[source.pilot.failsafe.battery.level()],
    )


def _remaining_s(source: WireState) -> int:
    """Return how long the battery lasts in flight; 0 (unknown) on the ground and from an ArduPilot."""
    battery, pilot = source.pilot.state.battery, source.pilot
    told = source.firmware.mavlink.tells_remaining_time and pilot.landed is not LandedState.ON_GROUND
    if battery is None or not told or not math.isfinite(battery.remaining_s):
        return 0
    return min(round(battery.remaining_s), 2**31 - 1)


def _extended_sys_state(source: WireState) -> Message:
    return m.MAVLink_extended_sys_state_message(0, int(source.pilot.landed))


def _home_position(source: WireState) -> Message:
    latitude, longitude, altitude = source.home_e7
    return m.MAVLink_home_position_message(
        latitude, longitude, altitude, 0.0, 0.0, 0.0, _HOME_Q, 0.0, 0.0, 1.0, source.boot_ms * 1000
    )


def _mission_current(source: WireState) -> Message:
    pilot = source.pilot
    size = pilot.mission.size
    in_mode = pilot.mode is Mode.MISSION
    seq = source.wire_seq(pilot.mission.current_seq) if size else 0
    state = pilot.mission_state
    hovers = pilot.behaviour.stays_after_last and pilot.landed is not LandedState.ON_GROUND
    if state is MissionState.COMPLETE and not (hovers or pilot.mission.returns):
        seq = 0
    if not source.item_known:
        seq = UNUSED
    mode = 1 if in_mode else 2
    if pilot.behaviour.stopped_state and (not in_mode or pilot.mission.waits):
        mode = int(in_mode)
        if state is MissionState.PAUSED:
            state = MissionState.NOT_STARTED
    return m.MAVLink_mission_current_message(
        seq, size or source.firmware.mavlink.no_mission_total, int(state), mode, *source.plan_ids
    )


def _wind_cov(source: WireState) -> Message:
    east, north = source.pilot.state.wind_m_s
    return m.MAVLink_wind_cov_message(
        source.boot_ms * 1000, north, east, 0.0, 0.0, 0.0, source.position_e7[2] / 1000.0, 0.5, 0.5
    )


def _wind(source: WireState) -> Message:
    east, north = source.pilot.state.wind_m_s
    direction = math.degrees(math.atan2(-east, -north)) if east or north else 0.0
    return m.MAVLink_wind_message(direction, math.hypot(east, north), 0.0)


def _autopilot_version(source: WireState) -> Message:
    identity = source.firmware.mavlink.identity
    nothing = [0] * 8
    return m.MAVLink_autopilot_version_message(
        identity.capabilities,
        identity.flight_sw_version,
        0,
        0,
        0,
        nothing,
        nothing,
        nothing,
        0,
        0,
        source.system_id,
        [source.system_id] + [0] * 17,
    )


def _protocol_version(_state: WireState) -> Message:
    return m.MAVLink_protocol_version_message(200, 100, 200, [0] * 8, [0] * 8)


def _modes_monitor(_state: WireState) -> Message:
    return m.MAVLink_available_modes_monitor_message(0)


def _gps_global_origin(source: WireState) -> Message:
    return m.MAVLink_gps_global_origin_message(*source.home_e7, source.unix_us)


def _current_mode(source: WireState) -> Message:
    return m.MAVLink_current_mode_message(0, source.custom_mode, source.custom_mode)


BUILDERS: dict[int, Callable[[WireState], Message | None]] = {
    m.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    m.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    m.MAVLINK_MSG_ID_SYSTEM_TIME: _system_time,
    m.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw_int,
    m.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    m.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: _attitude_quaternion,
    m.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _local_position_ned,
    m.MAVLINK_MSG_ID_ODOMETRY: _odometry,
    m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _global_position_int,
    m.MAVLINK_MSG_ID_VFR_HUD: _vfr_hud,
    m.MAVLINK_MSG_ID_ALTITUDE: _altitude,
    m.MAVLINK_MSG_ID_BATTERY_STATUS: _battery_status,
    m.MAVLINK_MSG_ID_FENCE_STATUS: _fence_status,
    m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _extended_sys_state,
    m.MAVLINK_MSG_ID_HOME_POSITION: _home_position,
    m.MAVLINK_MSG_ID_MISSION_CURRENT: _mission_current,
    m.MAVLINK_MSG_ID_WIND_COV: _wind_cov,
    m.MAVLINK_MSG_ID_WIND: _wind,
    m.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: hil_state_quaternion,
    m.MAVLINK_MSG_ID_SIM_STATE: sim_state,
    m.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _autopilot_version,
    m.MAVLINK_MSG_ID_CURRENT_MODE: _current_mode,
    m.MAVLINK_MSG_ID_AVAILABLE_MODES_MONITOR: _modes_monitor,
    m.MAVLINK_MSG_ID_PROTOCOL_VERSION: _protocol_version,
    m.MAVLINK_MSG_ID_ESTIMATOR_STATUS: estimator_status,
    m.MAVLINK_MSG_ID_EKF_STATUS_REPORT: ekf_status_report,
    m.MAVLINK_MSG_ID_VIBRATION: vibration,
    m.MAVLINK_MSG_ID_SCALED_PRESSURE: scaled_pressure,
    m.MAVLINK_MSG_ID_HIGHRES_IMU: highres_imu,
    m.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: _gps_global_origin,
    **FLIGHT_BUILDERS,
    **GIMBAL_BUILDERS,
}


def built(message_id: int, source: WireState) -> tuple[Message, ...]:
    """The message with this id from the state now; none when there is none such, or nothing to tell."""
    builder = BUILDERS.get(message_id)
    message = None if builder is None else builder(source)
    return () if message is None else (message,)
