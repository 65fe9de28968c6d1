"""Telemetry of the vehicle, with a table of message builders by message id.

To add a message, add a row to `BUILDERS`. Vehicle extras have further builders.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from sim_vehicle.airframe.navigation_errors import HDOP, VDOP, SensorNoise
from sim_vehicle.airframe.power_spec import GRAVITY_M_S2
from sim_vehicle.autopilot.behaviour import Mode
from sim_vehicle.execution.state import FlightPhase, LandedState
from sim_vehicle.mavlink.wire_state import UNUSED, Vector, centidegrees, int16, int16_vector
from sim_vehicle.pilot.controls import MissionState

if TYPE_CHECKING:
    from sim_vehicle.mavlink.wire_state import WireState

_GPS = 32
_FENCE = 1 << 20
_PREARM = 1 << 28
# Gyroscope, accelerometer, magnetometer, barometer, GPS, motors, RC, geofence, AHRS, battery, pre-arm check.
# Without the geofence bit, MAVProxy reports a breach; without the pre-arm bit, MAVSDK reports "not armable".
_SENSORS = 1 | 2 | 4 | 8 | _GPS | 1 << 15 | 1 << 16 | 1 << 20 | 1 << 21 | 1 << 25 | _PREARM
# The index is the battery level: normal, low, critical, almost empty.
_CHARGE_STATES = (
    m.MAV_BATTERY_CHARGE_STATE_OK,
    m.MAV_BATTERY_CHARGE_STATE_LOW,
    m.MAV_BATTERY_CHARGE_STATE_CRITICAL,
    m.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
)
_NO_BATTERY = (0, 1, 1, 32767, [UNUSED] * 10, -1, -1, -1, -1, 0, 0)
_HOME_Q = [1.0, 0.0, 0.0, 0.0]
# Flags of all estimates, and of the estimates that need no position (attitude and vertical motion).
ESTIMATES_OK = 1 | 2 | 4 | 8 | 16 | 32 | 256 | 512
ESTIMATES_BLIND = 1 | 4 | 32
_FIX_3D = 3


def _heartbeat(source: WireState) -> Message:
    pilot, profile = source.pilot, source.mavlink
    # Clients ignore the custom mode without this flag.
    base_mode = m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | profile.modes.base.of(pilot.mode)
    if pilot.armed:
        base_mode |= m.MAV_MODE_FLAG_SAFETY_ARMED
    if pilot.failsafe.active:
        status = m.MAV_STATE_EMERGENCY if pilot.state.phase is FlightPhase.DEPLETED else m.MAV_STATE_CRITICAL
    else:
        status = m.MAV_STATE_ACTIVE if pilot.armed else m.MAV_STATE_STANDBY
    identity = profile.identity
    return m.MAVLink_heartbeat_message(
        identity.mav_type, identity.mav_autopilot, int(base_mode), source.custom_mode, status, 3
    )


def _sys_status(source: WireState) -> Message:
    pilot = source.pilot
    health = _SENSORS
    enabled = _SENSORS if pilot.parameters.fence_enable else _SENSORS & ~_FENCE
    if not pilot.position_ok:
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


def _gps_raw_int(source: WireState) -> Message:
    boot = source.boot
    if not source.pilot.position_ok or (boot is not None and boot.fix < _FIX_3D):
        fix = 1 if boot is None else min(boot.fix, 1)
        return m.MAVLink_gps_raw_int_message(source.unix_us, fix, 0, 0, 0, UNUSED, UNUSED, UNUSED, UNUSED, 0)
    east, north, _ = source.pilot.state.velocity_m_s
    position, accuracy, (eph, epv) = source.position_e7, (500, 800), (70, 90)
    if source.errors is not None:
        position = source.e7_of(source.sensed.gps_m)
        noise = source.errors.noise
        if noise.gps_m > 0.0:
            eph, epv = round(100.0 * HDOP), round(100.0 * VDOP)
            accuracy = (
                round(1000.0 * noise.horizontal_accuracy_m),
                round(1000.0 * noise.vertical_accuracy_m),
            )
    speed_cm_s = min(65534, round(100.0 * math.hypot(east, north)))
    course_cdeg = centidegrees(math.atan2(east, north))
    return m.MAVLink_gps_raw_int_message(
        source.unix_us,
        source.mavlink.gps_fix,
        *position,
        *(eph, epv, speed_cm_s, course_cdeg),
        16,
        position[2],
        *accuracy,
        100,
    )


def _global_position_int(source: WireState) -> Message:
    return m.MAVLink_global_position_int_message(
        source.boot_ms,
        *source.position_e7,
        round(1000.0 * (source.sensed.believed_m[2] - source.pilot.home_m[2])),
        *int16_vector(source.ned_m_s, 100.0),
        centidegrees(source.pilot.state.yaw_rad),
    )


def _vfr_hud(source: WireState) -> Message:
    state = source.pilot.state
    east, north, up = source.velocity_m_s
    flies = state.armed and state.landed is not LandedState.ON_GROUND
    return m.MAVLink_vfr_hud_message(
        state.airspeed_m_s,
        math.hypot(east, north),
        int(math.degrees(state.yaw_rad)) % 360,
        # A rover that brakes or reverses has a negative throttle, but the field is a percentage.
        min(100, round(100.0 * abs(state.throttle))) if flies else 0,
        source.altitude_m,
        up,
    )


def _battery_status(source: WireState) -> Message:
    battery = source.pilot.state.battery
    if battery is None:
        return m.MAVLink_battery_status_message(*_NO_BATTERY)
    cell = min(65534, round(1000.0 * battery.voltage_v / battery.cells))
    return m.MAVLink_battery_status_message(
        0,
        m.MAV_BATTERY_FUNCTION_ALL,
        m.MAV_BATTERY_TYPE_LIPO,
        2500,
        [cell] * min(10, battery.cells) + [UNUSED] * max(0, 10 - battery.cells),
        int16(100.0 * battery.current_a),
        round(battery.used_mah),
        round(36.0 * battery.used_wh),
        math.ceil(100.0 * battery.fraction),
        _remaining_s(source),
        _CHARGE_STATES[source.pilot.failsafe.battery.level()],
    )


def _remaining_s(source: WireState) -> int:
    """Return the remaining flight time (s); 0 means unknown, as on the ground and with ArduPilot."""
    battery = source.pilot.state.battery
    known = source.mavlink.tells_remaining_time and source.pilot.landed is not LandedState.ON_GROUND
    if battery is None or not known or not math.isfinite(battery.remaining_s):
        return 0
    return min(round(battery.remaining_s), 2**31 - 1)


def _mission_current(source: WireState) -> Message:
    pilot = source.pilot
    size = pilot.mission.size
    in_mode = pilot.mode is Mode.MISSION
    seq = source.wire_seq(pilot.mission.current_seq) if size else 0
    state = pilot.mission.state
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
    total = size or source.mavlink.no_mission_total
    return m.MAVLink_mission_current_message(seq, total, int(state), mode, *source.plan_ids)


def _autopilot_version(source: WireState) -> Message:
    identity, system_id = source.mavlink.identity, source.system_id
    return m.MAVLink_autopilot_version_message(
        source.capabilities,
        identity.flight_sw_version,
        *(0, 0, 0),
        *(list(identity.custom_version), [0] * 8, [0] * 8),
        *(0, 0, system_id),
        [system_id] + [0] * 17,
    )


def _ekf_status_report(source: WireState) -> Message:
    flags = ESTIMATES_OK if source.pilot.position_ok else ESTIMATES_BLIND
    boot, cold = source.boot, source.firmware.cold_boot
    if cold is not None and boot is not None and not boot.knows_position:
        flags = cold.blind_flags
    return m.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, 0.1, 0.0)


def _true_velocity(source: WireState) -> Vector:
    """Return the true velocity: to the north, east and down."""
    (east, north, up), drift = source.pilot.state.velocity_m_s, source.sensed.drift_m_s
    return north + drift[1], east + drift[0], -(up + drift[2])


def _hil_state_quaternion(source: WireState) -> Message:
    """Build HIL_STATE_QUATERNION with the true state, which PX4's simulators send beside the estimate."""
    airspeed = min(65535, round(100.0 * source.pilot.state.airspeed_m_s))
    return m.MAVLink_hil_state_quaternion_message(
        source.unix_us,
        list(source.quaternion),
        *source.turning_rad_s,
        *source.e7_of(source.sensed.true_m),
        *int16_vector(_true_velocity(source), 100.0),
        airspeed,
        airspeed,
        *int16_vector(source.force_m_s2, 1000.0, GRAVITY_M_S2),
    )


def _sim_state(source: WireState) -> Message:
    """Build SIM_STATE, by which ArduPilot's simulator sends true state and accuracy of the sensors."""
    latitude, longitude, _ = source.e7_of(source.sensed.true_m)
    noise = source.errors.noise if source.errors is not None else SensorNoise()
    return m.MAVLink_sim_state_message(
        *source.quaternion,
        *source.angles_rad,
        *source.force_m_s2,
        *source.turning_rad_s,
        latitude / 1e7,
        longitude / 1e7,
        source.sensed.true_m[2] + source.home.altitude_m,
        noise.horizontal_accuracy_m,
        noise.barometer_m,
        *_true_velocity(source),
        latitude,
        longitude,
    )


_ESTIMATE_RATIOS = (0.1, 0.1, 0.1, 0.1, 0.0, 0.0, 0.5, 0.8)  # six test ratios, two accuracies (m)

BUILDERS: dict[int, Callable[[WireState], Message | None]] = {
    m.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    m.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    m.MAVLINK_MSG_ID_SYSTEM_TIME: lambda s: m.MAVLink_system_time_message(s.unix_us, s.boot_ms),
    m.MAVLINK_MSG_ID_GPS_RAW_INT: _gps_raw_int,
    m.MAVLINK_MSG_ID_ATTITUDE: lambda s: m.MAVLink_attitude_message(
        s.boot_ms, *s.angles_rad, *s.turning_rad_s
    ),
    m.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: lambda s: m.MAVLink_attitude_quaternion_message(
        s.boot_ms, *s.quaternion, *s.turning_rad_s
    ),
    m.MAVLINK_MSG_ID_LOCAL_POSITION_NED: lambda s: m.MAVLink_local_position_ned_message(
        s.boot_ms, *s.ned_m, *s.ned_m_s
    ),
    m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _global_position_int,
    m.MAVLINK_MSG_ID_VFR_HUD: _vfr_hud,
    m.MAVLINK_MSG_ID_BATTERY_STATUS: _battery_status,
    m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: lambda s: m.MAVLink_extended_sys_state_message(
        0, int(s.pilot.landed)
    ),
    m.MAVLINK_MSG_ID_HOME_POSITION: lambda s: m.MAVLink_home_position_message(
        *s.home_e7, 0.0, 0.0, 0.0, _HOME_Q, 0.0, 0.0, 1.0, s.boot_ms * 1000
    ),
    m.MAVLINK_MSG_ID_MISSION_CURRENT: _mission_current,
    m.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: _hil_state_quaternion,
    m.MAVLINK_MSG_ID_SIM_STATE: _sim_state,
    m.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _autopilot_version,
    m.MAVLINK_MSG_ID_CURRENT_MODE: lambda s: m.MAVLink_current_mode_message(0, s.custom_mode, s.custom_mode),
    m.MAVLINK_MSG_ID_AVAILABLE_MODES_MONITOR: lambda _: m.MAVLink_available_modes_monitor_message(0),
    m.MAVLINK_MSG_ID_PROTOCOL_VERSION: lambda _: m.MAVLink_protocol_version_message(
        200, 100, 200, [0] * 8, [0] * 8
    ),
    m.MAVLINK_MSG_ID_ESTIMATOR_STATUS: lambda s: m.MAVLink_estimator_status_message(
        s.unix_us, ESTIMATES_OK if s.pilot.position_ok else ESTIMATES_BLIND, *_ESTIMATE_RATIOS
    ),
    m.MAVLINK_MSG_ID_EKF_STATUS_REPORT: _ekf_status_report,
    m.MAVLINK_MSG_ID_TIMESYNC: lambda s: m.MAVLink_timesync_message(0, s.unix_us * 1000),
    m.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: lambda s: m.MAVLink_gps_global_origin_message(
        *s.e7_of((0.0, 0.0, 0.0)), s.unix_us
    ),
}
"""Builders by message id; a builder returns None if there is nothing to send."""


def built(message_id: int, source: WireState) -> tuple[Message, ...]:
    """Return the message with this id for the present state; empty if there is none to send."""
    builder = BUILDERS.get(message_id)
    message = None if builder is None else builder(source)
    return () if message is None else (message,)
