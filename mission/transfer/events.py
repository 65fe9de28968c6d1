"""The interface of a transfer: its methods, the output of one step, and its events."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from mission.link.codec.dialect import Message
from mission.model import GeoPoint, MissionItem, MissionType


class FailureReason(Enum):
    """Why a transfer failed."""

    REFUSED = "refused"
    TIMEOUT = "timeout"
    CANCELLED = "cancelled"
    BROKEN = "broken"
    DIFFERENT = "different"


class PlanState(Enum):
    """What the vehicle holds after a failed upload, as far as the client can know.

    ``OLD``: the plan from before. ``UNKNOWN``: the old or the new one, since the last confirmation was
    lost; on a vehicle that overwrites in place (ArduPilot) perhaps a mixture. Only a download can tell.
    """

    OLD = "old"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened in a transfer of one kind of plan."""

    mission_type: MissionType


@dataclass(frozen=True, slots=True)
class Progress(Event):
    """An item has crossed: ``done`` of ``total``."""

    done: int
    total: int


@dataclass(frozen=True, slots=True)
class UploadBegunAnew(Event):
    """Client: the vehicle gave the upload up, and it is sent once more; ``text`` is the failure."""

    text: str


@dataclass(frozen=True, slots=True)
class UploadComplete(Event):
    """Client: the vehicle has confirmed the whole plan of ``count`` items."""

    count: int
    opaque_id: int = 0


@dataclass(frozen=True, slots=True)
class DownloadComplete(Event):
    """Client: the whole plan has arrived; ``home`` is item 0 of autopilots that have one."""

    items: tuple[MissionItem, ...]
    opaque_id: int = 0
    home: GeoPoint | None = None


@dataclass(frozen=True, slots=True)
class ClearComplete(Event):
    """Client: the vehicle has confirmed that the plan is empty."""


@dataclass(frozen=True, slots=True)
class UploadVerified(Event):
    """Client: the plan was uploaded, read back and found equal."""

    count: int


@dataclass(frozen=True, slots=True)
class TransferFailed(Event):
    """The transfer has ended without success.

    Parameters
    ----------
    text : str
        One line for people.
    result : int or None
        The MAV_MISSION_RESULT that was received or sent, if any.
    item : int or None
        The item, from 0, that was sent last when a vehicle refused an upload.
    """

    reason: FailureReason
    text: str
    result: int | None = None
    vehicle_plan: PlanState = PlanState.OLD
    item: int | None = None


@dataclass(frozen=True, slots=True)
class TransferStarted(Event):
    """Vehicle: a ground station has begun an upload (``count`` items) or a download."""

    upload: bool
    count: int


@dataclass(frozen=True, slots=True)
class PlanReplaced(Event):
    """Vehicle: a plan is in force from now on.

    Parameters
    ----------
    opaque_id : int
        Its checksum; equal plans have equal ids.
    changed : bool
        False if the same plan was sent again: progress along it should be kept.
    start_sequence : int or None
        The item that was marked as current, None if none was.
    complete : bool
        False if the upload was broken off on a vehicle that overwrites its plan in place.
    """

    items: tuple[MissionItem, ...]
    opaque_id: int
    changed: bool = True
    start_sequence: int | None = None
    complete: bool = True


@dataclass(frozen=True, slots=True)
class PlanPart(Event):
    """Vehicle: a part of a plan has come and is in force already (`MissionServer.live_plan`)."""


@dataclass(frozen=True, slots=True)
class PlanCleared(Event):
    """Vehicle: the plan is empty now."""


@dataclass(frozen=True, slots=True)
class PlanSent(Event):
    """Vehicle: a ground station has confirmed that it has the plan."""


@dataclass(frozen=True, slots=True)
class StatusText(Event):
    """Vehicle: a text for a STATUSTEXT (at most 50 characters; MAV_SEVERITY)."""

    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class Output:
    """Output of one step of a state machine: messages to send, in order, and events."""

    messages: tuple[Message, ...] = ()
    events: tuple[Event, ...] = ()

    def __add__(self, other: Output) -> Output:
        return Output(self.messages + other.messages, self.events + other.events)


NOTHING = Output()


@dataclass(frozen=True, slots=True)
class TransferStatistics:
    """Cost of a transfer.

    Parameters
    ----------
    messages_sent, messages_received : int
        Mission messages of this transfer.
    retries : int
        Messages sent again because no answer came in time, requests answered again, and transfers that were
        begun anew.
    duration_s : float
        From the start to the end.
    verified : bool
        The plan was read back and found equal.
    """

    mission_type: MissionType
    items: int
    messages_sent: int
    messages_received: int
    retries: int
    duration_s: float
    verified: bool = False


class Transfer(Protocol):
    """An upload, download, clear or verified upload. It ends with one event, see `Output`."""

    @property
    def done(self) -> bool:
        """Whether it is over."""

    def start(self, now_s: float) -> Output:
        """Begin."""

    def receive(self, message: Message, now_s: float) -> Output:
        """Take one message."""

    def poll(self, now_s: float) -> Output:
        """Act on timers."""

    def next_deadline(self) -> float | None:
        """When to poll."""

    def cancel(self, now_s: float) -> Output:
        """Break off."""

    def statistics(self, now_s: float | None = None) -> TransferStatistics:
        """Return the cost."""
