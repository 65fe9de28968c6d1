"""State of a vehicle from its last telemetry: position, velocity, battery, item, mode."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from geo.frame import LocalFrame
from mission.autopilots import profile_for
from mission.autopilots.profile import Profile
from mission.ground.modes import VehicleModes, is_in_mission, mode_name
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import handler
from mission.model import DEGREES_E7

_RESTART_MS = 5000
"""A longer backward step of the time since boot means a reboot (ms), a smaller step a delayed message."""
_MOST_RESTARTS, _RESTARTS_S = 3, 10.0
"""More reboots than this number in this time (s) mean two vehicles with one system id."""
SHARED_ID = "two vehicles use this system id, and both would obey"


class BootClock:
    """Continuous clock, from a vehicle's times since boot; a reboot of the autopilot does not reset it.

    >>> clock = BootClock()
    >>> [clock.take(time_ms, now_s) for time_ms, now_s in ((90_000, 10.0), (91_000, 11.0), (200, 13.0))]
    [90000, 91000, 93000]
    >>> clock.restarts
    1
    """

    def __init__(self) -> None:
        self.restarts = 0
        self.is_shared = False  # whether two vehicles seem to send the times
        self._restarts_s: deque[float] = deque([-math.inf] * _MOST_RESTARTS, _MOST_RESTARTS)
        self.offset_ms = 0  # continuous clock minus the time since the last boot
        self._last_ms = -1
        self._last_s = -math.inf

    def take(self, time_boot_ms: int, now_s: float) -> int:
        """Convert a time since boot to the continuous clock (ms)."""
        time_ms = time_boot_ms + self.offset_ms
        if self._last_ms >= 0 and time_ms < self._last_ms - _RESTART_MS:
            self.restarts += 1
            self.is_shared = now_s - self._restarts_s[0] < _RESTARTS_S
            self._restarts_s.append(now_s)
            passed_ms = max(1, round(1000.0 * (now_s - self._last_s)))
            time_ms = self._last_ms + passed_ms
            self.offset_ms = time_ms - time_boot_ms
        if time_ms >= self._last_ms:
            self._last_ms, self._last_s = time_ms, now_s
        return time_ms


UNKNOWN_ITEM = 65535
"""Sequence number in MISSION_CURRENT that stands for no item."""
_NO_HEADING = 65535
_OLD_S = 10.0  # Age at which neither mode nor item counts as present.


@dataclass(frozen=True, slots=True)
class Battery:
    """Battery of the vehicle: remaining fraction and consumed energy, or None if unknown."""

    remaining: float | None = None
    consumed_wh: float | None = None

    def drained(self, reading: Battery, *, armed: bool) -> Battery:
        """Return the lowest remaining fraction while armed, and the largest consumed energy.

        Readings on the ground would be too high, because a battery recovers or is replaced. PX4's simulator
        recharges the battery of a disarmed vehicle.

        >>> Battery(0.9).drained(Battery(0.5), armed=True).drained(Battery(0.98), armed=False)
        Battery(remaining=0.5, consumed_wh=None)
        """
        known = [part for part in (self.remaining, reading.remaining if armed else None) if part is not None]
        used = [energy for energy in (self.consumed_wh, reading.consumed_wh) if energy is not None]
        return Battery(min(known, default=None), max(used, default=None))

    def used_since(self, before: Battery, capacity_wh: float) -> float | None:
        """Return the fraction of the battery used since ``before``, by energy or else by remaining fraction.

        >>> Battery(0.9, 10.0).used_since(Battery(1.0, 2.0), 80.0)
        0.1
        >>> Battery(0.5).used_since(Battery(0.75), 80.0)
        0.25
        >>> Battery(0.5).used_since(Battery(), 80.0) is None
        True
        """
        if self.consumed_wh is not None:
            used = (self.consumed_wh - (before.consumed_wh or 0.0)) / capacity_wh
        elif self.remaining is None or before.remaining is None:
            return None
        else:
            used = before.remaining - self.remaining
        # Rounding, or a real capacity above the nominal capacity, can give values outside 0 to 1.
        return min(max(used, 0.0), 1.0)


@dataclass(frozen=True, slots=True)
class VehicleState:
    """State of a vehicle from its last telemetry."""

    heard_s: float = -math.inf  # time of the last position, -inf before any
    latitude_deg: float = math.nan
    longitude_deg: float = math.nan
    height_m: float = 0.0  # Above home.
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)  # east, north, up.
    heading_rad: float | None = None  # Compass heading.
    battery: Battery = Battery()
    armed: bool = False
    custom_mode: int = 0  # Flight mode, in the autopilot's numbering.
    item: int | None = None  # Current item, counted like `Mission.items`; None if unknown.
    total: int | None = None  # Items of the mission on the vehicle, without home; None if unknown.
    mission_id: int = 0  # Opaque id of the mission on the vehicle, 0 without one.

    def position_m(self, frame: LocalFrame) -> tuple[float, float]:
        """Return the position in ``frame``: x and y (m)."""
        return frame.from_wgs84(self.latitude_deg, self.longitude_deg)

    def velocity_in(self, frame: LocalFrame) -> tuple[float, float]:
        """Return the horizontal velocity in ``frame``: x and y (m/s)."""
        return frame.from_east_north(*self.velocity_m_s[:2])

    @property
    def ground_speed_m_s(self) -> float:
        """Horizontal speed over ground (m/s)."""
        return math.hypot(*self.velocity_m_s[:2])


_POSITION_KNOWN, _POSITION_HELD = int(m.EKF_POS_HORIZ_ABS), int(m.EKF_CONST_POS_MODE)
# PX4 sets EKF_PRED_POS_HORIZ_ABS while it uses GNSS; otherwise EKF_CONST_POS_MODE means no position.
_POSITION_AIDED = int(m.EKF_PRED_POS_HORIZ_ABS)
_LANDED_UNKNOWN = 0  # MAV_LANDED_STATE_UNDEFINED.
_NO_MISSION = 1  # MISSION_STATE_NO_MISSION.
# Value of MISSION_CURRENT.mission_mode outside the mission mode; 0 means unknown, 1 mission mode.
_SUSPENDED = 2
_NO_TOTAL = 65535
"""MISSION_CURRENT.total without a mission; 0 means that the vehicle does not report the total."""


class VehicleMonitor:
    """Last telemetry of a vehicle."""

    def __init__(self) -> None:
        self.vehicle_type = 0  # MAV_TYPE in the heartbeat.
        self.autopilot = 0  # MAV_AUTOPILOT in the heartbeat.
        # Times of the last HEARTBEAT, MISSION_CURRENT and GLOBAL_POSITION_INT, -inf before the first.
        self.mode_heard_s = self.item_heard_s = self.position_heard_s = -math.inf
        self.heartbeat: m.MAVLink_heartbeat_message | None = None
        self._position: m.MAVLink_global_position_int_message | None = None
        self._current: m.MAVLink_mission_current_message | None = None
        self.gps_fix: int | None = None
        self.satellites: int | None = None
        self._estimate: int | None = None
        self.battery = Battery()
        self.lowest_battery = Battery()  # lowest reading since `begin_flight`
        self._percents: dict[int, int] = {}  # Last known BATTERY_STATUS.battery_remaining, by battery id.
        self.battery_percent: int | None = None  # Value on the wire, up to 127.
        self.flies: bool | None = None  # Whether in the air, by EXTENDED_SYS_STATE; None if unknown.
        self.clock = BootClock()  # Clock of positions and of SYSTEM_TIME.
        self._boot_ms = 0
        self._takes: dict[int, Callable[[Any, float], None]] = dict(
            (
                handler(m.MAVLink_heartbeat_message, self._on_heartbeat),
                handler(m.MAVLink_global_position_int_message, self._on_position),
                handler(m.MAVLink_mission_current_message, self._on_mission_current),
                handler(m.MAVLink_extended_sys_state_message, self._on_landed_state),
                handler(m.MAVLink_battery_status_message, self._on_battery),
                handler(m.MAVLink_sys_status_message, self._on_sys_status),
                handler(m.MAVLink_gps_raw_int_message, self._on_fix),
                handler(m.MAVLink_ekf_status_report_message, self._on_estimate),
                handler(m.MAVLink_estimator_status_message, self._on_estimate),
            )
        )

    def receive(self, message: Message, now_s: float) -> None:
        """Handle any message of the vehicle's autopilot."""
        take = self._takes.get(type(message).id)
        if take is not None:
            take(message, now_s)

    def doubt(self, now_s: float) -> None:
        """Count mode and item as old, because the program was suspended."""
        self.mode_heard_s = min(self.mode_heard_s, now_s - _OLD_S)
        self.item_heard_s = min(self.item_heard_s, now_s - _OLD_S)

    def _on_heartbeat(self, message: m.MAVLink_heartbeat_message, now_s: float) -> None:
        self.vehicle_type, self.autopilot = message.type, message.autopilot
        self.heartbeat, self.mode_heard_s = message, now_s

    def _on_position(self, message: m.MAVLink_global_position_int_message, now_s: float) -> None:
        self._position, self.position_heard_s = message, now_s
        self._boot_ms = self.clock.take(message.time_boot_ms, now_s)

    def _on_fix(self, message: m.MAVLink_gps_raw_int_message, _now_s: float) -> None:
        self.gps_fix, self.satellites = message.fix_type, message.satellites_visible

    def _on_estimate(
        self, message: m.MAVLink_ekf_status_report_message | m.MAVLink_estimator_status_message, _now_s: float
    ) -> None:
        """Store the estimator flags; their lower bits are equal in EKF_STATUS_REPORT and ESTIMATOR_STATUS."""
        self._estimate = message.flags

    def _on_mission_current(self, message: m.MAVLink_mission_current_message, now_s: float) -> None:
        self._current, self.item_heard_s = message, now_s

    def _on_landed_state(self, message: m.MAVLink_extended_sys_state_message, _now_s: float) -> None:
        known = message.landed_state != _LANDED_UNKNOWN
        self.flies = message.landed_state != m.MAV_LANDED_STATE_ON_GROUND if known else None

    def _on_battery(self, message: m.MAVLink_battery_status_message, _now_s: float) -> None:
        """Store the lowest remaining fraction and the consumed energy; a negative value means unknown."""
        if not drives(message):
            return
        remaining, consumed_wh = self.battery.remaining, self.battery.consumed_wh
        if message.battery_remaining >= 0:
            self._percents[message.id] = message.battery_remaining
            remaining = self._fraction(min(self._percents.values()))
        if message.energy_consumed >= 0:
            consumed_wh = message.energy_consumed * 100.0 / 3600.0
        self._note_battery(Battery(remaining, consumed_wh))

    def _on_sys_status(self, message: m.MAVLink_sys_status_message, _now_s: float) -> None:
        """Store the remaining fraction of the battery, if BATTERY_STATUS does not report this fraction."""
        if message.battery_remaining >= 0 and not self._percents:
            self._note_battery(replace(self.battery, remaining=self._fraction(message.battery_remaining)))

    def _fraction(self, percent: int) -> float:
        """Store the remaining percentage of the battery, and return it as a fraction of at most 1."""
        self.battery_percent = percent
        return min(percent, 100) / 100.0

    def _note_battery(self, reading: Battery) -> None:
        self.battery = reading
        self.lowest_battery = self.lowest_battery.drained(reading, armed=self.is_armed)

    def begin_flight(self) -> None:
        """Reset the lowest battery reading to the present reading."""
        self.lowest_battery = self.battery

    @property
    def is_armed(self) -> bool:
        """Whether the last heartbeat shows the vehicle armed."""
        heartbeat = self.heartbeat
        return heartbeat is not None and bool(heartbeat.base_mode & m.MAV_MODE_FLAG_SAFETY_ARMED)

    @property
    def knows_position(self) -> bool:
        """Whether the vehicle knows its position, by its estimator flags, or else by its GNSS fix.

        GLOBAL_POSITION_INT alone is not proof: ArduPilot sends it without a position, too, even with 0/0.
        """
        position = self._position
        if position is None or position.lat == position.lon == 0:
            return False
        if self._estimate is not None:
            held = self._estimate & (_POSITION_HELD | _POSITION_AIDED) == _POSITION_HELD
            return bool(self._estimate & _POSITION_KNOWN) and not held
        return self.gps_fix is None or self.gps_fix >= m.GPS_FIX_TYPE_3D_FIX

    @property
    def boot_s(self) -> float:
        """Time of the vehicle's last position on its continuous clock (s), 0 before the first position."""
        return self._boot_ms / 1e3

    @property
    def custom_mode(self) -> int:
        """Flight mode in the autopilot's numbering, 0 before the first heartbeat."""
        return 0 if self.heartbeat is None else int(self.heartbeat.custom_mode)

    @property
    def mode(self) -> str:
        """Name of the flight mode, empty before the first heartbeat."""
        return "" if self.heartbeat is None else mode_name(self.heartbeat)

    @property
    def profile(self) -> Profile:
        """Profile of the autopilot."""
        return profile_for(self.autopilot)

    @property
    def modes(self) -> VehicleModes:
        """Flight modes of the vehicle's autopilot and type."""
        return VehicleModes(self.autopilot, self.vehicle_type)

    @property
    def in_mission(self) -> bool:
        """Whether the vehicle is in a mission mode."""
        return self.heartbeat is not None and is_in_mission(self.heartbeat)

    @property
    def left_mission(self) -> bool:
        """Whether MISSION_CURRENT shows that the vehicle is not in the mission mode (mission suspended)."""
        current = self._current
        return current is not None and current.mission_mode == _SUSPENDED

    @property
    def seq(self) -> int | None:
        """Current item in the numbering of MISSION_CURRENT, None if unknown."""
        current = self._current
        return None if current is None or current.seq == UNKNOWN_ITEM else current.seq

    @property
    def home_altitude_m(self) -> float:
        """Altitude of home above mean sea level (m), 0 before the first position."""
        position = self._position
        return 0.0 if position is None else (position.alt - position.relative_alt) / 1e3

    @property
    def item(self) -> int | None:
        """Current mission item, counted from 0 without home; None if unknown."""
        current, home = self._current, 1 if self.profile.home_at_zero else 0
        if current is None or current.seq == UNKNOWN_ITEM or current.seq < home:
            return None
        return current.seq - home

    @property
    def state(self) -> VehicleState:
        """State of the vehicle, put together from its last messages."""
        values: dict[str, Any] = {"battery": self.battery}
        heartbeat, position, current = self.heartbeat, self._position, self._current
        if heartbeat is not None:
            values["armed"] = self.is_armed
            values["custom_mode"] = heartbeat.custom_mode
        if position is not None:
            values |= {
                "heard_s": self.position_heard_s,
                "latitude_deg": position.lat / DEGREES_E7,
                "longitude_deg": position.lon / DEGREES_E7,
                "height_m": position.relative_alt / 1e3,
                "velocity_m_s": (position.vy / 100.0, position.vx / 100.0, -position.vz / 100.0),
            }
            if position.hdg != _NO_HEADING:
                values["heading_rad"] = math.radians(position.hdg / 100.0)
        if current is not None:
            values["item"] = self.item
            values["total"] = _total(current)
            values["mission_id"] = current.mission_id
        return VehicleState(**values)


def drives(message: m.MAVLink_battery_status_message) -> bool:
    """Whether a BATTERY_STATUS is of the motors' battery: function unknown (0), all (1) or propulsion (2)."""
    return message.battery_function <= m.MAV_BATTERY_FUNCTION_PROPULSION


def _total(current: m.MAVLink_mission_current_message) -> int | None:
    if current.total == _NO_TOTAL or current.mission_state == _NO_MISSION:
        return 0
    return current.total or None
