"""The groups of messages that REQUEST_DATA_STREAM switches.

Source: ArduCopter's ``GCS_MAVLink_Copter.cpp`` (``STREAM_..._msgs``).
"""

from __future__ import annotations

from mission.link.codec.dialect import mavlink as m

__all__ = ["STREAMS"]

_GROUPS: dict[int, tuple[int, ...]] = {
    m.MAV_DATA_STREAM_RAW_SENSORS: (
        m.MAVLINK_MSG_ID_RAW_IMU,
        m.MAVLINK_MSG_ID_SCALED_IMU2,
        m.MAVLINK_MSG_ID_SCALED_PRESSURE,
    ),
    m.MAV_DATA_STREAM_EXTENDED_STATUS: (
        m.MAVLINK_MSG_ID_SYS_STATUS,
        m.MAVLINK_MSG_ID_POWER_STATUS,
        m.MAVLINK_MSG_ID_MEMINFO,
        m.MAVLINK_MSG_ID_MISSION_CURRENT,
        m.MAVLINK_MSG_ID_GPS_RAW_INT,
        m.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
        m.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT,
        m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    ),
    m.MAV_DATA_STREAM_POSITION: (
        m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        m.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    m.MAV_DATA_STREAM_RC_CHANNELS: (m.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, m.MAVLINK_MSG_ID_RC_CHANNELS),
    m.MAV_DATA_STREAM_EXTRA1: (m.MAVLINK_MSG_ID_ATTITUDE, m.MAVLINK_MSG_ID_AHRS2),
    m.MAV_DATA_STREAM_EXTRA2: (m.MAVLINK_MSG_ID_VFR_HUD,),
    m.MAV_DATA_STREAM_EXTRA3: (
        m.MAVLINK_MSG_ID_AHRS,
        m.MAVLINK_MSG_ID_SYSTEM_TIME,
        m.MAVLINK_MSG_ID_WIND,
        m.MAVLINK_MSG_ID_TERRAIN_REPORT,
        m.MAVLINK_MSG_ID_BATTERY_STATUS,
        m.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS,
        m.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        m.MAVLINK_MSG_ID_VIBRATION,
    ),
}
STREAMS: dict[int, tuple[int, ...]] = {
    m.MAV_DATA_STREAM_ALL: tuple(message_id for group in _GROUPS.values() for message_id in group),
    **_GROUPS,
}
"""What REQUEST_DATA_STREAM switches on an ArduPilot."""
