"""When which telemetry message is due.

Times are whole microseconds and every rate has its phase at zero, so messages of different rates fall on the
same instants and one step of the vehicle serves them all.
"""

from __future__ import annotations

from collections.abc import Mapping

from mission.link.codec.dialect import mavlink as m

__all__ = ["STREAMS"]

SHORTEST_US = 5_000
"""A peer cannot ask for more than 200 messages a second."""
LONGEST_US = 2**31 - 1
"""Longest interval that MESSAGE_INTERVAL can hold, in microseconds."""


class Schedule:
    """Message intervals and their next times.

    Parameters
    ----------
    rates_hz : mapping of int to float
        Message id to default rate; the order is the order of sending.

    Examples
    --------
    >>> schedule = Schedule({0: 1.0, 33: 10.0})
    >>> schedule.due(0), schedule.due(50_000), schedule.due(100_000)
    ([0, 33], [], [33])
    >>> schedule.next_us
    200000
    """

    def __init__(self, rates_hz: Mapping[int, float]) -> None:
        self._default_us = {message_id: round(1e6 / rate) for message_id, rate in rates_hz.items()}
        self._interval_us = dict(self._default_us)
        self._groups: dict[int, list[int]] = {}
        self._due_us: dict[int, int] = {}
        self.next_us = 0
        self._regroup(0)

    def interval_us(self, message_id: int) -> int:
        """Interval of a message, -1 when it is not sent."""
        return self._interval_us.get(message_id, -1)

    def set_interval(self, message_id: int, interval_us: int, now_us: int) -> int:
        """Change an interval: 0 is the default, negative is off; returns what holds now (-1 is off)."""
        if interval_us == 0:
            interval_us = self._default_us.get(message_id, -1)
        if interval_us < 0:
            self._interval_us.pop(message_id, None)
        else:
            self._interval_us[message_id] = min(max(SHORTEST_US, interval_us), LONGEST_US)
        self._regroup(now_us)
        return self.interval_us(message_id)

    def due(self, now_us: int) -> list[int]:
        """Return the ids whose time has come, once each, and plan their next times."""
        if now_us < self.next_us:
            return []
        found: list[int] = []
        due_us = self._due_us
        for interval_us, ids in self._groups.items():
            if due_us[interval_us] <= now_us:
                found += ids
                due_us[interval_us] = (now_us // interval_us + 1) * interval_us
        self.next_us = min(due_us.values(), default=1 << 62)
        return found

    def _regroup(self, now_us: int) -> None:
        groups: dict[int, list[int]] = {}
        for message_id, interval_us in self._interval_us.items():
            groups.setdefault(interval_us, []).append(message_id)
        self._due_us = {
            interval_us: self._due_us.get(interval_us, -(-now_us // interval_us) * interval_us)
            for interval_us in groups
        }
        self._groups = groups
        self.next_us = min(self._due_us.values(), default=1 << 62)


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
