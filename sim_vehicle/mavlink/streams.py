"""Messages of ArduPilot's data streams (``GCS_MAVLink_Copter.cpp``)."""

from __future__ import annotations

from mission.link.codec.dialect import mavlink as m

__all__ = ["STREAMS", "group_number"]

_GROUPS = {
    "RAW_SENSORS": "RAW_IMU SCALED_IMU2 SCALED_PRESSURE",
    "EXTENDED_STATUS": "SYS_STATUS POWER_STATUS MEMINFO MISSION_CURRENT GPS_RAW_INT NAV_CONTROLLER_OUTPUT "
    "POSITION_TARGET_GLOBAL_INT EXTENDED_SYS_STATE",
    "POSITION": "GLOBAL_POSITION_INT LOCAL_POSITION_NED",
    "RC_CHANNELS": "SERVO_OUTPUT_RAW RC_CHANNELS",
    "EXTRA1": "ATTITUDE AHRS2",
    "EXTRA2": "VFR_HUD",
    "EXTRA3": "AHRS SYSTEM_TIME WIND TERRAIN_REPORT BATTERY_STATUS GIMBAL_DEVICE_ATTITUDE_STATUS "
    "EKF_STATUS_REPORT VIBRATION",
}


def _ids(names: str) -> tuple[int, ...]:
    return tuple(getattr(m, f"MAVLINK_MSG_ID_{name}") for name in names.split())


def group_number(name: str) -> int:
    """Return the number of a MAV_DATA_STREAM from its name."""
    return int(getattr(m, f"MAV_DATA_STREAM_{name}"))


STREAMS: dict[int, tuple[int, ...]] = {
    m.MAV_DATA_STREAM_ALL: _ids(" ".join(_GROUPS.values())),
    **{group_number(name): _ids(names) for name, names in _GROUPS.items()},
}
"""Messages of each REQUEST_DATA_STREAM stream on ArduPilot."""
