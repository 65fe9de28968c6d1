"""A link opened by MAVSDK, and plan transfers by its plugin mission_raw, as steps of a verified upload."""

from __future__ import annotations

import contextlib
import socket
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any

from mavsdk import Configuration, ConnectionResult, ForwardingOption, Mavsdk, System
from mavsdk.logging import LogLevel, log_subscribe, log_unsubscribe
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from mavsdk.plugins.mission_raw import MissionRaw, MissionRawError, MissionRawResult

from mission.autopilots import GENERIC
from mission.autopilots.profile import Profile
from mission.errors import LinkError, MissionError
from mission.link.address import SERIAL, LinkAddress, parse_link_url
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import MissionItem, MissionType
from mission.transfer import (
    DownloadComplete,
    FailureReason,
    LocalTransferError,
    MissionUpload,
    Output,
    PlanState,
    Progress,
    TransferFailed,
    TransferMaker,
    TransferStatistics,
    UploadComplete,
    VerifiedUpload,
    wire,
)
from mission.transfer.events import NOTHING, Event, NoVehicleError
from mission.transfer.wire import GROUND_STATION, from_wire_order

_SCHEMES = {"udpin": "udpin", "udpout": "udpout", "tcp": "tcpout", "tcpin": "tcpin", SERIAL: "serial"}
_WIRELESS = "raw://"
_MOST_PIECES = 100_000
_KNOWN_S = 2.0
_LOOK_S = 0.01


def mavsdk_url(address: LinkAddress) -> str:
    """Return a link address in MAVSDK's syntax.

    >>> mavsdk_url(parse_link_url("tcp:127.0.0.1:5760")), mavsdk_url(parse_link_url("serial:/dev/ttyACM0"))
    ('tcpout://127.0.0.1:5760', 'serial:///dev/ttyACM0:57600')
    """
    return f"{_SCHEMES[address.scheme]}://{address.host}:{address.port}"


class MavsdkLink:
    """MAVSDK as a `mission.link.address.Link`.

    MAVSDK has two connections, one to the vehicle and one to this program, and forwards between them. Bytes
    from the vehicle are returned by `receive`, and bytes given to `send` go to the vehicle. MAVSDK is the
    ground station on the link: it sends the heartbeat, and does not forward answers to its commands and
    transfers.

    Raises LinkError if the address is wrong or MAVSDK cannot open it.
    """

    def __init__(self, url: str) -> None:
        address = parse_link_url(url)
        self.name = str(address)
        self._arrived: deque[bytes] = deque(maxlen=_MOST_PIECES)
        self._complaint = ""
        self._plugins: dict[tuple[type, int], Any] = {}
        self._systems: dict[int, System] = {}
        self._wake, self._woken = socket.socketpair()
        self._wake.setblocking(False)
        self._woken.setblocking(False)
        self._closed = False
        log_subscribe(self._on_log)
        self._mavsdk = Mavsdk(Configuration.create_manual(*GROUND_STATION, True))
        try:
            self._mavsdk.subscribe_raw_bytes_to_be_sent(self._on_bytes)
            for connection in (_WIRELESS, mavsdk_url(address)):
                self._connect(connection)
        except BaseException:
            self.close()
            raise

    def _connect(self, url: str) -> None:
        result = self._mavsdk.add_any_connection_with_forwarding(url, ForwardingOption.ON)
        if result != ConnectionResult.SUCCESS:
            why = self._complaint or ConnectionResult(result).name.lower().replace("_", " ")
            raise LinkError(f"{self.name}: MAVSDK cannot open it: {why}; check the address")

    def _on_log(self, level: LogLevel, text: str, _file: str | None, _line: int) -> bool:
        """Keep MAVSDK's log off the terminal; the log's last error says why a connection cannot be opened."""
        if level is LogLevel.ERROR:
            self._complaint = text
        return True

    def _on_bytes(self, data: bytes) -> None:
        """Queue a frame; MAVSDK calls this in its own thread."""
        self._arrived.append(data)
        with contextlib.suppress(OSError):
            self._wake.send(b"\0")

    def send(self, data: bytes) -> None:
        """Send frames to the vehicle."""
        if not self._closed:
            self._mavsdk.pass_received_raw_bytes(data)

    def receive(self) -> list[bytes]:
        """Return the frames received since the last call."""
        with contextlib.suppress(OSError):
            self._woken.recv(65536)
        found: list[bytes] = []
        with contextlib.suppress(IndexError):
            while True:
                found.append(self._arrived.popleft())
        return found

    def fileno(self) -> int | None:
        """Return a file descriptor that is readable when frames have arrived."""
        return None if self._closed else self._woken.fileno()

    def plugin(self, kind: type, system_id: int) -> Any:
        """Return MAVSDK's plugin for a vehicle; raise NoVehicleError if MAVSDK does not know the vehicle."""
        key = (kind, system_id)
        if key not in self._plugins:
            self._plugins[key] = kind(self._system(system_id))
        return self._plugins[key]

    def _system(self, system_id: int) -> System:
        """Return a vehicle, waiting until MAVSDK has connected to it.

        Before that, MAVSDK does not know the vehicle's autopilot, and would not answer an ArduPilot.
        """
        if system_id in self._systems:
            return self._systems[system_id]
        end_s = time.monotonic() + _KNOWN_S
        while time.monotonic() < end_s:
            for system in self._mavsdk.get_systems():
                if system.get_system_id() == system_id and system.has_autopilot() and system.is_connected():
                    self._systems[system_id] = system
                    return system
            time.sleep(_LOOK_S)
        raise NoVehicleError(f"{self.name}: MAVSDK knows of no vehicle with system id {system_id}")

    def close(self) -> None:
        """Stop MAVSDK and its threads; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        self._mavsdk.destroy()
        log_unsubscribe()
        self._plugins.clear()
        self._systems.clear()
        self._wake.close()
        self._woken.close()


class Call:
    """A call of one of MAVSDK's ``..._async`` functions, answered in another thread."""

    def __init__(self, begin: Callable[..., None], *arguments: Any) -> None:
        self._answers: SimpleQueue[tuple[Any, ...]] = SimpleQueue()
        begin(*arguments, self._on_answer)

    def _on_answer(self, *answer: Any) -> None:
        # The last argument is MAVSDK's unused user data.
        self._answers.put(answer[:-1])

    def answer(self) -> tuple[Any, ...] | None:
        """Return MAVSDK's answer, with the result first; None while pending."""
        try:
            return self._answers.get_nowait()
        except Empty:
            return None


_UPLOADS = {
    MissionType.MISSION: "upload_mission_async",
    MissionType.FENCE: "upload_geofence_async",
    MissionType.RALLY: "upload_rally_points_async",
}
_DOWNLOADS = {
    MissionType.MISSION: "download_mission_async",
    MissionType.FENCE: "download_geofence_async",
    MissionType.RALLY: "download_rallypoints_async",
}
_ITEM_FIELDS = (
    "seq", "frame", "command", "current", "autocontinue",
    "param1", "param2", "param3", "param4", "x", "y", "z", "mission_type",
)  # fmt: skip
_REASONS = {
    MissionRawResult.TIMEOUT: FailureReason.TIMEOUT,
    MissionRawResult.NO_SYSTEM: FailureReason.TIMEOUT,
    MissionRawResult.TRANSFER_CANCELLED: FailureReason.CANCELLED,
}
_POLL_S = 0.02
# MAVSDK has its own timeouts; this timeout ends a call that MAVSDK never answers.
_LONGEST_S = 300.0


def mavsdk_transfers(link: Callable[[], MavsdkLink]) -> TransferMaker:
    """Return a maker of MAVSDK's transfers; each transfer uses the link that is open when it starts."""
    return TransferMaker(partial(MavsdkUpload, link=link), partial(MavsdkDownload, link=link))


class _Transfer(ABC):
    """Base of MAVSDK's uploads and downloads: a pending call and its result.

    The statistics count 0 messages, because MAVSDK does not report the number of messages.
    """

    _verb: str
    _count = 0

    def __init__(
        self,
        mission_type: MissionType,
        *,
        link: Callable[[], MavsdkLink],
        target: tuple[int, int] = (1, 1),
        profile: Profile = GENERIC,
        **_options: Any,
    ) -> None:
        self.mission_type = mission_type
        self.done = False
        self._target, self._profile = target, profile
        self._link = link
        self._call: Call | None = None
        self._began_s = self._ended_s = self._due_s = 0.0

    @property
    def _raw(self) -> Any:
        return self._link().plugin(MissionRaw, self._target[0])

    @property
    def _what(self) -> str:
        return f"{self._verb} of the {self.mission_type.name.lower()}"

    def receive(self, message: Message, now_s: float) -> Output:  # noqa: ARG002
        """Ignore a message: MAVSDK itself receives the messages of a transfer."""
        return NOTHING

    def _begin(self, now_s: float, begin: Callable[..., None], *arguments: Any) -> None:
        self._began_s = now_s
        self._due_s = now_s + _POLL_S
        self._call = Call(begin, *arguments)

    def poll(self, now_s: float) -> Output:
        """Return the result if MAVSDK has answered or the call has timed out."""
        if self._call is None or now_s < self._due_s:
            return NOTHING
        self._due_s = now_s + _POLL_S
        answer = self._call.answer()
        if answer is None and now_s > self._began_s + _LONGEST_S:
            answer = (MissionRawResult.TIMEOUT, [])
        return NOTHING if answer is None else self._finish(now_s, *self._ends(*answer))

    @abstractmethod
    def _ends(self, result: MissionRawResult, raw: Sequence[RawItem] = ()) -> tuple[Event, ...]:
        """Return the events for MAVSDK's answer."""

    def _finish(self, now_s: float, *events: Event) -> Output:
        self.done, self._call, self._ended_s = True, None, now_s
        return Output(events=events)

    def _failure(self, result: MissionRawResult, state: PlanState) -> TransferFailed:
        """Return the event of a failed transfer, with MAVSDK's result name."""
        reason = _REASONS.get(result, FailureReason.REFUSED)
        text = f"{self._what} failed: MAVSDK says {result.name}"
        if reason is FailureReason.TIMEOUT:
            text += "; the vehicle did not answer, check the link and try again"
        code = wire.UNSUPPORTED if result is MissionRawResult.UNSUPPORTED else None
        return TransferFailed(self.mission_type, reason, text, code, state)

    def next_deadline(self) -> float | None:
        """Return the time at which the next `poll` is due; None before the start or after the end."""
        return None if self._call is None else self._due_s

    def cancel(self, now_s: float) -> Output:
        """Cancel the transfer."""
        if self.mission_type is MissionType.MISSION and self._call is not None:
            with contextlib.suppress(MissionRawError):
                getattr(self._raw, f"cancel_mission_{self._verb}")()
        text = f"{self._what} was cancelled"
        return self._finish(now_s, TransferFailed(self.mission_type, FailureReason.CANCELLED, text))

    def statistics(self, now_s: float | None = None) -> TransferStatistics:
        """Return the transfer's statistics, as far as MAVSDK provides them."""
        end_s = self._ended_s if self.done or now_s is None else now_s
        return TransferStatistics(self.mission_type, self._count, 0, 0, 0, end_s - self._began_s)


class MavsdkDownload(_Transfer):
    """Downloads a plan; ends with `DownloadComplete` or `TransferFailed`."""

    _verb = "download"

    def start(self, now_s: float) -> Output:
        """Start the download."""
        self._begin(now_s, getattr(self._raw, _DOWNLOADS[self.mission_type]))
        return NOTHING

    def _ends(self, result: MissionRawResult, raw: Sequence[RawItem] = ()) -> tuple[Event, ...]:
        if result not in (MissionRawResult.SUCCESS, MissionRawResult.NO_MISSION_AVAILABLE):
            return (self._failure(result, PlanState.OLD),)
        try:
            came = tuple(map(_item_of, raw))
        except MissionError as error:
            return (TransferFailed(self.mission_type, FailureReason.BROKEN, f"{self._what}: {error}"),)
        items, home = from_wire_order(came, self.mission_type, self._profile)
        self._count = len(items)
        progress = Progress(self.mission_type, len(came), len(came))
        return progress, DownloadComplete(self.mission_type, items, 0, home)


class _Sending(_Transfer):
    """Uploads a plan; ends with `UploadComplete` (without the plan's id) or `TransferFailed`.

    The plan is kept in a `MissionUpload`, which is never started.
    """

    _verb = "upload"

    def __init__(self, items: Sequence[MissionItem], mission_type: MissionType, **options: Any) -> None:
        if not items and mission_type is not MissionType.MISSION:
            msg = f"MAVSDK cannot empty a vehicle's {mission_type.name.lower()} plan; leave out --via mavsdk"
            raise LocalTransferError(msg)
        super().__init__(mission_type, **options)
        del options["link"]
        # MAVSDK requires one item marked as current.
        options["start_sequence"] = options["start_sequence"] or 0
        self._plan = MissionUpload(items, mission_type, **options)
        self._count = len(items)

    def start(self, now_s: float) -> Output:
        """Start the upload."""
        raw = [
            RawItem(*(getattr(message, field) for field in _ITEM_FIELDS))
            for message in self._plan.item_messages()
        ]
        if raw:
            self._begin(now_s, getattr(self._raw, _UPLOADS[self.mission_type]), raw)
        else:
            self._begin(now_s, self._raw.clear_mission_async)
        return NOTHING

    def _ends(self, result: MissionRawResult, raw: Sequence[RawItem] = ()) -> tuple[Event, ...]:  # noqa: ARG002
        if result is MissionRawResult.SUCCESS:
            return (UploadComplete(self.mission_type, self._count),)
        # After a refusal, a vehicle that overwrites its plan in place may hold the old or the new plan. After
        # a timeout, any vehicle may hold the new plan; a download shows whether it does.
        timeout = _REASONS.get(result) is FailureReason.TIMEOUT
        state = PlanState.OLD if self._profile.atomic and not timeout else PlanState.UNKNOWN
        return (self._failure(result, state),)


class MavsdkUpload(VerifiedUpload):
    """Uploads a plan, downloads it and compares.

    A failure in MAVSDK is reported, unless only the answer was lost and the vehicle already holds the plan.
    """

    def __init__(
        self,
        items: Sequence[MissionItem],
        mission_type: MissionType,
        *,
        link: Callable[[], MavsdkLink],
        **options: Any,
    ) -> None:
        send, read = partial(_Sending, link=link), partial(MavsdkDownload, link=link)
        super().__init__(items, mission_type, readings=1, send=send, read=read, **options)
        self._failed: TransferFailed | None = None

    def _after_failure(self, failed: TransferFailed, now_s: float) -> Output:
        self._failed = self._failed or failed
        return super()._after_failure(failed, now_s)

    def _compare(self, received: DownloadComplete, now_s: float) -> Output:
        if self._refusal is not None:
            return self._refused(self._refusal, received)
        output = super()._compare(received, now_s)
        if self._verified:
            self.confirmed_s = now_s if self.confirmed_s is None else self.confirmed_s
        elif self._failed is not None:
            return Output(events=(self._failed,))
        return output


def _item_of(raw: RawItem) -> MissionItem:
    """Convert an item from MAVSDK; raise MissionError for infinite numbers or an invalid position."""
    fields = [getattr(raw, field) for field in _ITEM_FIELDS]
    return wire.item_from_message(m.MAVLink_mission_item_int_message(0, 0, *fields))
