"""LOG_REQUEST_LIST, LOG_REQUEST_DATA, LOG_REQUEST_END and LOG_ERASE.

Sources: ArduPilot's ``AP_Logger_MAVLinkLogTransfer.cpp``, PX4's ``mavlink_log_handler.cpp``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.typed import is_a
from sim_vehicle.autopilot.mavlink_profile import LogBehaviour
from sim_vehicle.component import NEVER
from sim_vehicle.mavlink.logs.flight_logs import FlightLog, FlightLogs

__all__ = ["LOG_MESSAGES", "LogMessage", "LogTransfer"]

LogMessage = (
    m.MAVLink_log_request_list_message
    | m.MAVLink_log_request_data_message
    | m.MAVLink_log_request_end_message
    | m.MAVLink_log_erase_message
)
LOG_MESSAGES = frozenset(
    {
        m.MAVLINK_MSG_ID_LOG_REQUEST_LIST,
        m.MAVLINK_MSG_ID_LOG_REQUEST_DATA,
        m.MAVLINK_MSG_ID_LOG_REQUEST_END,
        m.MAVLINK_MSG_ID_LOG_ERASE,
    }
)
"""Ids of the messages that `LogTransfer.receive` takes."""
_PART = 90
# As many at a time as ArduPilot's simulator sends.
_BATCH = 40
_BATCH_S = 0.01


@dataclass(slots=True)
class _Sending:
    """A part of a log that is being sent."""

    peer: tuple[int, int]
    log: FlightLog
    number: int
    offset: int
    end: int


class LogTransfer:
    """Lists and sends logs; one of them at a time.

    Parameters
    ----------
    refuse : callable
        Is given the reason where a request is refused with a text.
    """

    def __init__(self, logs: FlightLogs, behaviour: LogBehaviour, refuse: Callable[[str], None]) -> None:
        self._logs = logs
        self._behaviour = behaviour
        self._refuse = refuse
        self._sending: _Sending | None = None
        self._warned = False
        self._due_s = NEVER

    def receive(self, message: LogMessage, now_s: float, *, armed: bool) -> list[Message]:
        """Answer a request; the data follow in time."""
        if armed and self._behaviour.refusal_armed:
            if not self._warned:
                self._refuse(self._behaviour.refusal_armed)
            self._warned = True
            return []
        self._warned = False
        if is_a(message, m.MAVLink_log_request_list_message):
            return self._list(message)
        if is_a(message, m.MAVLink_log_request_data_message):
            return self._send(message, now_s)
        self._stop()
        if is_a(message, m.MAVLink_log_erase_message):
            self._logs.erase(armed=armed)
        return []

    def next_deadline(self) -> float:
        """When the next data are due."""
        return self._due_s

    def poll(self, now_s: float) -> list[Message]:
        """Return the data that are due."""
        if now_s < self._due_s:
            return []
        messages: list[Message] = []
        while self._sending is not None and len(messages) < _BATCH:
            messages.append(self._next_part(self._sending))
        self._due_s = NEVER if self._sending is None else now_s + _BATCH_S
        return messages

    def _list(self, message: m.MAVLink_log_request_list_message) -> list[Message]:
        logs, first = self._logs.all, self._behaviour.first_number
        if not logs:
            return [m.MAVLink_log_entry_message(0, 0, 0, 0, 0)]
        last = len(logs) - 1 + first
        end = min(message.end, last)
        return [
            m.MAVLink_log_entry_message(
                number,
                len(logs),
                end,
                int(logs[number - first].begun_unix_s),
                len(logs[number - first].data),
            )
            for number in range(max(message.start, first), end + 1)
        ]

    def _send(self, message: m.MAVLink_log_request_data_message, now_s: float) -> list[Message]:
        peer = (message.get_srcSystem(), message.get_srcComponent())
        busy = self._sending
        if busy is not None and self._behaviour.busy_text:
            if busy.peer != peer:
                self._refuse(self._behaviour.busy_text)
            return []
        logs, place = self._logs.all, message.id - self._behaviour.first_number
        if not 0 <= place < len(logs):
            self._stop()
            return []
        log = logs[place]
        size = len(log.data)
        offset = min(message.ofs, size)
        end = min(size, offset + message.count)
        self._sending = _Sending(peer, log, message.id, offset, end)
        self._due_s = now_s
        return self.poll(now_s)

    def _next_part(self, sending: _Sending) -> Message:
        """Return the next part; one that is not whole, or the last one asked for, ends it."""
        part = bytes(sending.log.data[sending.offset : min(sending.end, sending.offset + _PART)])
        message = m.MAVLink_log_data_message(
            sending.number, sending.offset, len(part), list(part.ljust(_PART, b"\0"))
        )
        sending.offset += len(part)
        if len(part) < _PART or sending.offset >= sending.end:
            self._stop()
        return message

    def _stop(self) -> None:
        self._sending, self._due_s = None, NEVER
