"""Telemetry messages from the state of the vehicle: one table, message id to builder."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.airframe.sensor_errors import HDOP, VDOP
from sim_vehicle.autopilot.modes import Mode
from sim_vehicle.execution.state import FlightPhase, LandedState
from sim_vehicle.mavlink.true_state import hil_state_quaternion, int16, quaternion, sim_state, to_body
from sim_vehicle.pilot.fence import Breach

if TYPE_CHECKING:
    from sim_vehicle.mavlink.wire_state import WireState

__all__ = ["BUILDERS", "STREAMS", "built"]

_UNUSED_CELL = 65535
_GPS = 32
_FENCE = 1 << 20
_PREARM = 1 << 28
# gyro, accelerometer, magnetometer, barometer, GPS, motors, radio control, geofence, AHRS, battery, arming
# checks; without the geofence bit MAVProxy reports a breach, without the last one MAVSDK says not armable.
_SENSORS = 1 | 2 | 4 | 8 | _GPS | 1 << 15 | 1 << 16 | 1 << 20 | 1 << 21 | 1 << 25 | _PREARM
# attitude, velocities, positions and height above ground; without a position only what the sensors give
_ESTIMATES_OK = 1 | 2 | 4 | 8 | 16 | 32 | 256 | 512
_ESTIMATES_BLIND = 1 | 4 | 32
# by the level of the battery: fine, low, critical, almost empty
_CHARGE_STATES = (
    m.MAV_BATTERY_CHARGE_STATE_OK,
    m.MAV_BATTERY_CHARGE_STATE_LOW,
    m.MAV_BATTERY_CHARGE_STATE_CRITICAL,
    m.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
)
_HOME_Q = [1.0, 0.0, 0.0, 0.0]
_NAN = math.nan
_BASE_MODE = {
    Mode.MANUAL: m.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED,
    Mode.ALTITUDE: m.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | m.MAV_MODE_FLAG_STABILIZE_ENABLED,
    Mode.POSITION: (
        m.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        | m.MAV_MODE_FLAG_STABILIZE_ENABLED
        | m.MAV_MODE_FLAG_GUIDED_ENABLED
    ),
}
_AUTO_MODE = m.MAV_MODE_FLAG_AUTO_ENABLED | m.MAV_MODE_FLAG_STABILIZE_ENABLED | m.MAV_MODE_FLAG_GUIDED_ENABLED


def base_mode(mode: Mode, armed: bool) -> int:
    """Return the base mode of HEARTBEAT; its custom mode bit makes peers read the custom mode."""
    flags = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | _BASE_MODE.get(mode, _AUTO_MODE)
    return int(flags | m.MAV_MODE_FLAG_SAFETY_ARMED if armed else flags)


def _heartbeat(source: WireState) -> Message:
    pilot, persona = source.pilot, source.firmware.persona
    if pilot.failsafe.active:
        status = m.MAV_STATE_EMERGENCY if pilot.state.phase is FlightPhase.DEPLETED else m.MAV_STATE_CRITICAL
    else:
        status = m.MAV_STATE_ACTIVE if pilot.armed else m.MAV_STATE_STANDBY
    return m.MAVLink_heartbeat_message(
        persona.identity.mav_type,
        persona.identity.mav_autopilot,
        base_mode(pilot.mode, pilot.armed),
        persona.modes[pilot.mode],
        status,
        3,
    )


def _sys_status(source: WireState) -> Message:
    pilot = source.pilot
    health = _SENSORS
    if not pilot.controls.position_ok:
        health &= ~_GPS
    if pilot.failsafe.fence.breach and pilot.armed:
        health &= ~_FENCE
    if not pilot.armed and pilot.arming.health_problem() is not None:
        health &= ~_PREARM
    battery = pilot.state.battery
    millivolts, centiamps, percent = _UNUSED_CELL, -1, -1
    if battery is not None:
        millivolts, centiamps = round(1000.0 * battery.voltage_v), int16(100.0 * battery.current_a)
        percent = math.ceil(100.0 * battery.fraction)
    return m.MAVLink_sys_status_message(
        _SENSORS, _SENSORS, health, 100, millivolts, centiamps, percent, 0, 0, 0, 0, 0, 0
    )


def _system_time(source: WireState) -> Message:
    return m.MAVLink_system_time_message(source.unix_us, source.boot_ms)


def _gps_raw_int(source: WireState) -> Message:
    state = source.pilot.state
    position = source.position_e7
    if not source.pilot.controls.position_ok:
        return m.MAVLink_gps_raw_int_message(
            source.unix_us, 1, 0, 0, 0, _UNUSED_CELL, _UNUSED_CELL, _UNUSED_CELL, _UNUSED_CELL, 0
        )
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
        3,
        position[0],
        position[1],
        position[2],
        eph,
        epv,
        min(65534, round(100.0 * math.hypot(east, north))),
        _centidegrees(math.atan2(east, north)),
        16,
        position[2],
        horizontal_mm,
        vertical_mm,
        100,
    )


def _global_position_int(source: WireState) -> Message:
    state = source.pilot.state
    position = source.position_e7
    east, north, up = state.velocity_m_s
    return m.MAVLink_global_position_int_message(
        source.boot_ms,
        position[0],
        position[1],
        position[2],
        round(1000.0 * source.sensed.believed_m[2]),
        int16(100.0 * north),
        int16(100.0 * east),
        int16(-100.0 * up),
        _centidegrees(state.yaw_rad),
    )


def _local_position_ned(source: WireState) -> Message:
    state = source.pilot.state
    east, north, up = source.sensed.believed_m
    v_east, v_north, v_up = state.velocity_m_s
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


def _vfr_hud(source: WireState) -> Message:
    state = source.pilot.state
    east, north, up = state.velocity_m_s
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
        return m.MAVLink_battery_status_message(0, 1, 1, 32767, [_UNUSED_CELL] * 10, -1, -1, -1, -1, 0, 0)
    cell = min(65534, round(1000.0 * battery.voltage_v / battery.cells))
    cells = [cell] * min(10, battery.cells) + [_UNUSED_CELL] * max(0, 10 - battery.cells)
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
    told = source.firmware.persona.tells_remaining_time and pilot.landed is not LandedState.ON_GROUND
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
    in_mode = 1 if pilot.mode is Mode.MISSION else 2
    seq = source.wire_seq(pilot.mission.current_seq) if size else 0
    state = pilot.mission_state
    if state == m.MISSION_STATE_COMPLETE:
        seq = 0
    return m.MAVLink_mission_current_message(
        seq, size or source.firmware.persona.no_mission_total, int(state), in_mode, *source.plan_ids
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
    identity = source.firmware.persona.identity
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


def _estimator_status(source: WireState) -> Message:
    ok = source.pilot.controls.position_ok
    return m.MAVLink_estimator_status_message(
        source.unix_us, _ESTIMATES_OK if ok else _ESTIMATES_BLIND, 0.1, 0.1, 0.1, 0.1, 0.0, 0.0, 0.5, 0.8
    )


def _ekf_status_report(source: WireState) -> Message:
    ok = source.pilot.controls.position_ok
    flags = _ESTIMATES_OK if ok else _ESTIMATES_BLIND
    return m.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, 0.1, 0.0)


def _rc_channels(source: WireState) -> Message:
    channels_and_rssi = [_UNUSED_CELL] * 18 + [255]
    return m.MAVLink_rc_channels_message(source.boot_ms, 0, *channels_and_rssi)


def _vibration(source: WireState) -> Message:
    return m.MAVLink_vibration_message(source.unix_us, 0.0, 0.0, 0.0, 0, 0, 0)


def _scaled_pressure(source: WireState) -> Message:
    pressure_hpa = _pressure_hpa(source)
    return m.MAVLink_scaled_pressure_message(source.boot_ms, pressure_hpa, 0.0, 2500)


def _pressure_hpa(source: WireState) -> float:
    """Pressure of the ICAO standard atmosphere at the vehicle's height above the sea."""
    height_m = min(11_000.0, _barometer_m(source))
    return float(1013.25 * (1.0 - 2.25577e-5 * height_m) ** 5.25588)


def _barometer_m(source: WireState) -> float:
    """Return the barometer's height above the sea."""
    if source.errors is None:
        return source.position_e7[2] / 1000.0
    return source.sensed.barometer_m + source.home.altitude_m


def _highres_imu(source: WireState) -> Message:
    """Tell what the sensors would read: specific force and magnetic field along forward, right, down."""
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


def _gps_global_origin(source: WireState) -> Message:
    return m.MAVLink_gps_global_origin_message(*source.home_e7, source.unix_us)


def _current_mode(source: WireState) -> Message:
    number = source.firmware.persona.modes[source.pilot.mode]
    return m.MAVLink_current_mode_message(0, number, number)


def _centidegrees(angle_rad: float) -> int:
    return round(math.degrees(angle_rad) * 100.0) % 36000


BUILDERS: dict[int, Callable[[WireState], Message]] = {
    m.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    m.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    m.MAVLINK_MSG_ID_SYSTEM_TIME: _system_time,
    m.MAVLINK_MSG_ID_GPS_RAW_INT: _gps_raw_int,
    m.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    m.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: _attitude_quaternion,
    m.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _local_position_ned,
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
    m.MAVLINK_MSG_ID_ESTIMATOR_STATUS: _estimator_status,
    m.MAVLINK_MSG_ID_EKF_STATUS_REPORT: _ekf_status_report,
    m.MAVLINK_MSG_ID_RC_CHANNELS: _rc_channels,
    m.MAVLINK_MSG_ID_VIBRATION: _vibration,
    m.MAVLINK_MSG_ID_SCALED_PRESSURE: _scaled_pressure,
    m.MAVLINK_MSG_ID_HIGHRES_IMU: _highres_imu,
    m.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: _gps_global_origin,
}


def built(message_id: int, source: WireState) -> tuple[Message, ...]:
    """The message with this id from the state now; none when there is none such."""
    builder = BUILDERS.get(message_id)
    return () if builder is None else (builder(source),)


_POSITION = (m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, m.MAVLINK_MSG_ID_LOCAL_POSITION_NED)
_STATUS = (
    m.MAVLINK_MSG_ID_SYS_STATUS,
    m.MAVLINK_MSG_ID_MISSION_CURRENT,
    m.MAVLINK_MSG_ID_GPS_RAW_INT,
    m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
)
_EXTRA_3 = (
    m.MAVLINK_MSG_ID_SYSTEM_TIME,
    m.MAVLINK_MSG_ID_BATTERY_STATUS,
    m.MAVLINK_MSG_ID_VIBRATION,
    m.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    m.MAVLINK_MSG_ID_WIND,
)
_SENSOR = (m.MAVLINK_MSG_ID_SCALED_PRESSURE,)
_RADIO = (m.MAVLINK_MSG_ID_RC_CHANNELS,)
STREAMS: dict[int, tuple[int, ...]] = {
    m.MAV_DATA_STREAM_ALL: (
        *_POSITION,
        *_STATUS,
        *_SENSOR,
        *_RADIO,
        m.MAVLINK_MSG_ID_ATTITUDE,
        m.MAVLINK_MSG_ID_VFR_HUD,
        *_EXTRA_3,
    ),
    m.MAV_DATA_STREAM_RAW_SENSORS: _SENSOR,
    m.MAV_DATA_STREAM_EXTENDED_STATUS: _STATUS,
    m.MAV_DATA_STREAM_RC_CHANNELS: _RADIO,
    m.MAV_DATA_STREAM_POSITION: _POSITION,
    m.MAV_DATA_STREAM_EXTRA1: (m.MAVLINK_MSG_ID_ATTITUDE,),
    m.MAV_DATA_STREAM_EXTRA2: (m.MAVLINK_MSG_ID_VFR_HUD,),
    m.MAV_DATA_STREAM_EXTRA3: _EXTRA_3,
}
"""What REQUEST_DATA_STREAM switches on an ArduPilot."""
