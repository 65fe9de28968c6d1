"""What a vehicle told of how it stands there, message by message."""

from __future__ import annotations

from mission.errors import MissionError
from mission.ground.vehicle_state import VehicleMonitor
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import DEGREES_E7, GeoPoint
from wbf_mission.preflight.vehicle.snapshot import FirmwareVersion, Gps

__all__ = ["ESTIMATES", "STATE_MESSAGES", "HeardState"]

_UNKNOWN = 65535
_UNKNOWN_SATELLITES = 255
_PREARM = int(m.MAV_SYS_STATUS_PREARM_CHECK)
STATE_MESSAGES = (
    int(m.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
    int(m.MAVLINK_MSG_ID_SYS_STATUS),
    int(m.MAVLINK_MSG_ID_GPS_RAW_INT),
    int(m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT),
    int(m.MAVLINK_MSG_ID_BATTERY_STATUS),
)
"""What every vehicle is asked for."""
ESTIMATES = (int(m.MAVLINK_MSG_ID_ESTIMATOR_STATUS), int(m.MAVLINK_MSG_ID_EKF_STATUS_REPORT))
"""What tells of the estimator: on most autopilots, and on ArduPilot."""


class HeardState:
    """Keeps what a vehicle told; everything is None until it did.

    Attributes
    ----------
    monitor : VehicleMonitor
        Its heartbeat and battery.
    ids : set of int
        Messages that came.
    """

    def __init__(self) -> None:
        self.monitor = VehicleMonitor()
        self.ids: set[int] = set()
        self.version: FirmwareVersion | None = None
        self.status: m.MAVLink_sys_status_message | None = None
        self.gps: Gps | None = None
        self.estimator_flags: int | None = None
        self.position: GeoPoint | None = None

    def take(self, message: Message) -> None:
        """Take a message of the vehicle."""
        self.ids.add(type(message).id)
        if isinstance(message, m.MAVLink_autopilot_version_message):
            self.version = FirmwareVersion.of(message.flight_sw_version)
        elif isinstance(message, m.MAVLink_sys_status_message):
            self.status = message
        elif isinstance(message, m.MAVLink_gps_raw_int_message):
            seen, eph = message.satellites_visible, message.eph
            self.gps = Gps(
                message.fix_type,
                None if seen == _UNKNOWN_SATELLITES else seen,
                None if eph == _UNKNOWN else eph / 100.0,
            )
        elif isinstance(message, m.MAVLink_estimator_status_message | m.MAVLink_ekf_status_report_message):
            self.estimator_flags = message.flags
        elif isinstance(message, m.MAVLink_battery_status_message):
            self.monitor.on_battery(message)
        elif isinstance(message, m.MAVLink_global_position_int_message):
            self.position = _point(message)

    @property
    def battery(self) -> float | None:
        """Fraction that is left, as BATTERY_STATUS tells, else SYS_STATUS."""
        remaining = self.monitor.battery.remaining
        if remaining is None and self.status is not None and self.status.battery_remaining >= 0:
            return self.status.battery_remaining / 100.0
        return remaining

    @property
    def says_ready(self) -> bool:
        """Whether it did not say that it cannot arm."""
        return self.status is None or bool(self.status.onboard_control_sensors_health & _PREARM)


def _point(message: m.MAVLink_global_position_int_message) -> GeoPoint | None:
    """Return a position; None without one, and for one that cannot be."""
    if message.lat == 0 and message.lon == 0:
        return None
    try:
        return GeoPoint(message.lat / DEGREES_E7, message.lon / DEGREES_E7, message.alt / 1e3)
    except MissionError:
        return None
