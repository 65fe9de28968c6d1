"""Flight logs of a vehicle, and answers to the LOG_REQUEST messages.

A log begins when the vehicle arms and ends one second after it has disarmed, as with real autopilots
(ArduPilot's LOG_DISARMED 0, PX4's SDLOG_MODE 0). The log is a .tlog of the messages that the vehicle sent and
received. Sources: ArduPilot's ``AP_Logger_MAVLinkLogTransfer.cpp``, PX4's ``mavlink_log_handler.cpp``.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.link.codec.signing import SETUP_SIGNING
from mission.link.codec.typed import is_a
from mission.link.tlog import tlog_record
from sim_vehicle.component import NEVER

if TYPE_CHECKING:
    from sim_vehicle.pilot.pilot import Pilot

_MOST_BYTES = 16 * 2**20
_MOST_LOGS = 32
_AFTER_S = 1.0
# Signing keys must not be logged. Log and file messages would make a log grow while a client reads it.
_UNLOGGED = frozenset(
    {
        SETUP_SIGNING,
        m.MAVLINK_MSG_ID_LOG_ENTRY,
        m.MAVLINK_MSG_ID_LOG_DATA,
        m.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL,
    }
)
LogMessage = (
    m.MAVLink_log_request_list_message
    | m.MAVLink_log_request_data_message
    | m.MAVLink_log_request_end_message
    | m.MAVLink_log_erase_message
)
_PART = 90
# Number of messages per batch, as in ArduPilot's simulator.
_BATCH = 40
_BATCH_S = 0.01


@dataclass(slots=True)
class FlightLog:
    """One flight log; after the logs were erased, numbers start again at 1."""

    number: int
    begun_unix_s: float
    data: bytearray = field(default_factory=bytearray)

    def path(self, *, by_date: bool) -> str:
        """Return the path below the log directory: date and time as on PX4, or the number as on ArduPilot.

        >>> log = FlightLog(3, 1_700_000_000.0)
        >>> log.path(by_date=True), log.path(by_date=False)
        ('2023-11-14/22_13_20.tlog', '00000003.tlog')
        """
        if by_date:
            return time.strftime("%Y-%m-%d/%H_%M_%S.tlog", time.gmtime(self.begun_unix_s))
        return f"{self.number:08d}.tlog"


class FlightLogs:
    """Flight logs of a vehicle.

    The oldest logs are deleted to make room for new logs. A log that fills all the space stops growing.
    `epoch_unix_s` is the Unix time at time 0 of the simulation.

    >>> logs = FlightLogs(1_700_000_000.0)
    >>> logs.write(b"frame", 0, 1.0, armed=True)
    >>> [len(log.data) for log in logs.all]
    [13]
    """

    def __init__(
        self, epoch_unix_s: float, *, most_bytes: int = _MOST_BYTES, most_logs: int = _MOST_LOGS
    ) -> None:
        self._epoch_unix_s = epoch_unix_s
        self._most_bytes, self._most_logs = most_bytes, most_logs
        self._logs: list[FlightLog] = []
        self._open: FlightLog | None = None
        self._last = 0
        self._ends_s = 0.0
        self._size = 0

    @property
    def all(self) -> tuple[FlightLog, ...]:
        """All logs of the vehicle, oldest first."""
        return tuple(self._logs)

    def files(self, *, by_date: bool) -> Mapping[str, bytearray]:
        """Return the contents of the logs, keyed by path."""
        return {log.path(by_date=by_date): log.data for log in self._logs}

    def write(self, frame: bytes, message_id: int, now_s: float, *, armed: bool) -> None:
        """Log a frame at time `now_s` if the vehicle is armed, or was armed within the last second."""
        if armed:
            self._ends_s = now_s + _AFTER_S
            if self._open is None:
                self._begin(now_s)
        elif self._open is not None and now_s > self._ends_s:
            self._open = None
        if self._open is None or message_id in _UNLOGGED:
            return
        record = tlog_record(frame, self._epoch_unix_s + now_s)
        while self._size + len(record) > self._most_bytes and self._logs[0] is not self._open:
            self._drop_oldest()
        if self._size + len(record) <= self._most_bytes:
            self._open.data += record
            self._size += len(record)

    def erase(self, *, armed: bool) -> None:
        """Delete all logs except the log being written."""
        if not armed:
            self._open = None
        self._logs = [log for log in self._logs if log is self._open]
        self._size = sum(len(log.data) for log in self._logs)
        self._last = max((log.number for log in self._logs), default=0)

    def _begin(self, now_s: float) -> None:
        if len(self._logs) >= self._most_logs:
            self._drop_oldest()
        self._last += 1
        self._open = FlightLog(self._last, self._epoch_unix_s + now_s)
        self._logs.append(self._open)

    def _drop_oldest(self) -> None:
        self._size -= len(self._logs.pop(0).data)


@dataclass(slots=True)
class _Sending:
    """The part of a log that is still to be sent to a client."""

    peer: tuple[int, int]
    log: FlightLog
    number: int
    offset: int
    end: int


class LogTransfer:
    """Server that sends the list of logs, and the data of one log at a time."""

    def __init__(self, logs: FlightLogs, pilot: Pilot) -> None:
        self._logs = logs
        self._pilot = pilot
        self._behaviour = pilot.firmware.mavlink.logs
        self._sending: _Sending | None = None
        self._warned = False
        self.due_s = NEVER

    def receive(self, message: LogMessage, now_s: float) -> list[Message]:
        """Answer a request; `poll` sends the log data."""
        armed = self._pilot.armed
        if armed and self._behaviour.refusal_armed:
            if not self._warned:
                self._pilot.warn(self._behaviour.refusal_armed)
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

    def poll(self, now_s: float) -> list[Message]:
        """Return the log data that is due."""
        if now_s < self.due_s:
            return []
        messages: list[Message] = []
        while self._sending is not None and len(messages) < _BATCH:
            messages.append(self._next_part(self._sending))
        self.due_s = NEVER if self._sending is None else now_s + _BATCH_S
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
                self._pilot.warn(self._behaviour.busy_text)
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
        self.due_s = now_s
        return self.poll(now_s)

    def _next_part(self, sending: _Sending) -> Message:
        """Return the next part of the log; the transfer ends at a short part or at the requested end."""
        part = bytes(sending.log.data[sending.offset : min(sending.end, sending.offset + _PART)])
        message = m.MAVLink_log_data_message(
            sending.number, sending.offset, len(part), list(part.ljust(_PART, b"\0"))
        )
        sending.offset += len(part)
        if len(part) < _PART or sending.offset >= sending.end:
            self._stop()
        return message

    def _stop(self) -> None:
        self._sending, self.due_s = None, NEVER
