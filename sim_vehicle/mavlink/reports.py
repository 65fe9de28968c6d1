"""Messages without a request: scheduled telemetry, status texts, reports of reached items."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import Command
from sim_vehicle.component import NEVER
from sim_vehicle.execution.state import FlightEvent, ItemReached
from sim_vehicle.mavlink.telemetry import built

if TYPE_CHECKING:
    from mission.model import MissionItem
    from sim_vehicle.mavlink.wire_state import WireState

SHORTEST_US = 5_000
"""Shortest interval, for 200 messages per second (microseconds)."""
LONGEST_US = 2**31 - 1
"""Longest interval that MESSAGE_INTERVAL can hold (microseconds)."""
# Length of the text field of STATUSTEXT.
_TEXT_BYTES = 50
_REPEAT_S = 1.0


class Schedule:
    """Intervals and due times of messages; `rates_hz` has the initial rates, in the order of sending.

    Times are whole microseconds, and messages are due at multiples of their intervals. Messages of different
    rates therefore fall due together, and one motion step serves all of them.

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
        """Return the interval of a message, or -1 if the message is off."""
        return self._interval_us.get(message_id, -1)

    def set_interval(self, message_id: int, interval_us: int, now_us: int) -> int:
        """Set an interval (0: the default, negative: message off) and return the interval in force."""
        if interval_us == 0:
            interval_us = self._default_us.get(message_id, -1)
        if interval_us < 0:
            self._interval_us.pop(message_id, None)
        else:
            self._interval_us[message_id] = min(max(SHORTEST_US, interval_us), LONGEST_US)
        self._regroup(now_us)
        return self.interval_us(message_id)

    def due(self, now_us: int) -> list[int]:
        """Return the ids of the messages that are due, and schedule when each is due next."""
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


class StatusTexts:
    """STATUSTEXT messages, split into numbered chunks if a text exceeds one message.

    Examples
    --------
    >>> texts = StatusTexts()
    >>> [(part.id, part.chunk_seq) for part in texts.messages(6, "a" * 120)]
    [(1, 0), (1, 1), (1, 2)]
    """

    def __init__(self) -> None:
        self._number = 0

    def messages(self, severity: int, text: str) -> list[Message]:
        """Return the messages of one text with a MAV_SEVERITY."""
        data = text.encode("ascii", "replace")
        if len(data) <= _TEXT_BYTES:
            return [m.MAVLink_statustext_message(int(severity), data)]
        self._number = self._number % 65535 + 1
        # The text ends with a chunk that is not full, and may be empty.
        return [
            m.MAVLink_statustext_message(
                int(severity), data[k * _TEXT_BYTES : (k + 1) * _TEXT_BYTES], self._number, k
            )
            for k in range(len(data) // _TEXT_BYTES + 1)
        ]


class ItemReports:
    """Reports of reached items, with the autopilot's repetitions, and the delayed MISSION_CURRENT."""

    def __init__(self, state: WireState) -> None:
        self._state = state
        self._merges = state.mavlink.reached_merged
        self._repeats = state.mavlink.reached_repeats
        self._current_due_s = NEVER
        self._returning = -1
        self._latest: tuple[int, int, float] | None = None

    def restart(self) -> None:
        """Reset for a new mission."""
        self._returning = -1

    def merged(self, events: list[FlightEvent], items: Sequence[MissionItem]) -> list[FlightEvent]:
        """If the autopilot merges reports, keep only the last report of items that end at the same time.

        A return to launch that follows a reached item is reported in the item's place, and not again later.
        """
        if not self._merges:
            return events
        last = {event.time_s: event for event in events if isinstance(event, ItemReached)}
        kept: list[FlightEvent] = []
        for event in events:
            if not isinstance(event, ItemReached):
                kept.append(event)
            elif event.seq == self._returning:
                self._returning = -1
            elif last[event.time_s] is event:
                following = event.seq + 1
                if following < len(items) and items[following].command == Command.NAV_RETURN_TO_LAUNCH:
                    self._returning = following
                    kept.append(replace(event, seq=following))
                else:
                    kept.append(event)
        return kept

    def reached(self, seq: int, now_s: float) -> Message:
        """Return the report of a reached item; `poll` repeats the report."""
        wire_seq = self._state.wire_seq(seq)
        self._latest = (wire_seq, self._repeats, now_s + _REPEAT_S) if self._repeats else None
        return m.MAVLink_mission_item_reached_message(wire_seq)

    def send_current(self, due_s: float) -> None:
        """Schedule MISSION_CURRENT."""
        self._current_due_s = due_s

    def poll(self, now_s: float) -> list[Message]:
        """Return the next repeat of the latest report, and MISSION_CURRENT, if they are due."""
        messages: list[Message] = []
        if self._latest is not None and self._latest[2] <= now_s:
            seq, left, due_s = self._latest
            self._latest = (seq, left - 1, due_s + _REPEAT_S) if left > 1 else None
            messages.append(m.MAVLink_mission_item_reached_message(seq))
        if self._current_due_s <= now_s:
            self._current_due_s = NEVER
            messages += built(m.MAVLINK_MSG_ID_MISSION_CURRENT, self._state)
        return messages

    @property
    def due_s(self) -> float:
        """Time of the next report (s); infinite if there is none."""
        return self._current_due_s if self._latest is None else min(self._latest[2], self._current_due_s)


# ArduPilot has these data streams (``GCS_MAVLink_Copter.cpp``).
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
"""Messages of each data stream of ArduPilot, by the stream number in REQUEST_DATA_STREAM."""
