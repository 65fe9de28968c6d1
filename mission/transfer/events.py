"""Interface of transfers, their output, their events and their exceptions.

::

    TransferError
    +-- LocalTransferError     wrong use by the caller
    +-- RemoteTransferError    the vehicle refused, violated the protocol or did not answer
        +-- NoVehicleError     no vehicle heartbeat was received
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from mission.errors import TransferError
from mission.link.codec.dialect import Message
from mission.model import GeoPoint, MissionItem, MissionType


class FailureReason(Enum):
    """Reason of a failed transfer."""

    REFUSED = "refused"
    TIMEOUT = "timeout"
    CANCELLED = "cancelled"
    BROKEN = "broken"
    DIFFERENT = "different"


class PlanState(Enum):
    """Plan on the vehicle after a failed upload.

    ``OLD``: the previous plan. ``UNKNOWN``: the previous or the new plan, since the final ACK may be lost. A
    vehicle that overwrites items in place (ArduPilot) may hold items of both plans; a download shows which.
    """

    OLD = "old"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Event:
    """Base class of the events of a transfer of one plan type."""

    mission_type: MissionType


@dataclass(frozen=True, slots=True)
class Progress(Event):
    """An item was transferred: ``done`` of ``total`` items."""

    done: int
    total: int


@dataclass(frozen=True, slots=True)
class UploadBegunAnew(Event):
    """Client: the vehicle aborted the upload, and the client retries the upload; ``text`` is the failure."""

    text: str


@dataclass(frozen=True, slots=True)
class UploadComplete(Event):
    """Client: the vehicle acknowledged the complete plan of ``count`` items."""

    count: int
    opaque_id: int = 0


@dataclass(frozen=True, slots=True)
class DownloadComplete(Event):
    """Client: the complete plan has arrived; ``home`` is item 0 of autopilots that store home there."""

    items: tuple[MissionItem, ...]
    opaque_id: int = 0
    home: GeoPoint | None = None


@dataclass(frozen=True, slots=True)
class ClearComplete(Event):
    """Client: the vehicle acknowledged that the plan is empty."""


@dataclass(frozen=True, slots=True)
class UploadVerified(Event):
    """Client: the plan was uploaded, and the plan read back from the vehicle equals it."""

    count: int


@dataclass(frozen=True, slots=True)
class TransferFailed(Event):
    """The transfer failed.

    Parameters
    ----------
    text : str
        Error message, one line.
    result : int or None
        MAV_MISSION_RESULT that was received or sent, if any.
    item : int or None
        Last item sent before the vehicle refused the upload, counted from 0.
    """

    reason: FailureReason
    text: str
    result: int | None = None
    vehicle_plan: PlanState = PlanState.OLD
    item: int | None = None


@dataclass(frozen=True, slots=True)
class TransferStarted(Event):
    """Vehicle: a ground station has started an upload of ``count`` items, or a download."""

    upload: bool
    count: int


@dataclass(frozen=True, slots=True)
class PlanReplaced(Event):
    """Vehicle: an uploaded plan has replaced the previous plan.

    Parameters
    ----------
    opaque_id : int
        Checksum of the plan; equal plans have equal ids.
    changed : bool
        False if the new plan equals the previous plan, so the vehicle keeps its progress along the mission.
    start_sequence : int or None
        Item marked as current, or None if no item was marked.
    complete : bool
        False if the upload was aborted on a vehicle that overwrites its plan in place.
    """

    items: tuple[MissionItem, ...]
    opaque_id: int
    changed: bool = True
    start_sequence: int | None = None
    complete: bool = True


@dataclass(frozen=True, slots=True)
class PlanPart(Event):
    """Vehicle: a received part of a plan is already in effect (`MissionServer.live_plan`)."""


@dataclass(frozen=True, slots=True)
class PlanCleared(Event):
    """Vehicle: a plan was cleared."""


@dataclass(frozen=True, slots=True)
class PlanSent(Event):
    """Vehicle: a ground station has acknowledged the download of a plan."""


@dataclass(frozen=True, slots=True)
class StatusText(Event):
    """Vehicle: a STATUSTEXT to send (at most 50 characters) with its MAV_SEVERITY."""

    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class Output:
    """Output of one step of a transfer: messages to send, in this order, and events that happened."""

    messages: tuple[Message, ...] = ()
    events: tuple[Event, ...] = ()

    def __add__(self, other: Output) -> Output:
        return Output(self.messages + other.messages, self.events + other.events)


NOTHING = Output()


@dataclass(frozen=True, slots=True)
class TransferStatistics:
    """Statistics of a transfer.

    Parameters
    ----------
    messages_sent, messages_received : int
        Number of mission messages of this transfer.
    retries : int
        Number of messages repeated after a timeout, repeated answers to requests, and restarts together.
    duration_s : float
        Time from start to end (s).
    verified : bool
        Whether the plan read back from the vehicle equals the plan sent.
    """

    mission_type: MissionType
    items: int
    messages_sent: int
    messages_received: int
    retries: int
    duration_s: float
    verified: bool = False


class Transfer(Protocol):
    """Interface of uploads, downloads, clears and verified uploads; each ends with completion or failure."""

    @property
    def done(self) -> bool:
        """Whether the transfer has ended."""

    def start(self, now_s: float) -> Output:
        """Start the transfer."""

    def receive(self, message: Message, now_s: float) -> Output:
        """Handle one message."""

    def poll(self, now_s: float) -> Output:
        """Handle the timers that are due."""

    def next_deadline(self) -> float | None:
        """Return the time of the next `poll`, or None if no timer runs."""

    def cancel(self, now_s: float) -> Output:
        """Cancel the transfer."""

    def statistics(self, now_s: float | None = None) -> TransferStatistics:
        """Return the statistics up to ``now_s``."""


class LocalTransferError(TransferError):
    """A transfer was started twice, used after its end, or given a plan that cannot be sent."""


class RemoteTransferError(TransferError):
    """The vehicle refused, violated the protocol or did not answer; ``failure`` is the last event."""

    def __init__(self, text: str, failure: TransferFailed | None = None) -> None:
        super().__init__(text)
        self.failure = failure


class NoVehicleError(RemoteTransferError):
    """No vehicle heartbeat was received."""
