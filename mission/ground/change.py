"""Changing a mission in flight: the request, the record of its outcome, and the session."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from mission.ground.contact import Contact
from mission.ground.guard import FailsafeGuard
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import Mission, MissionItem, MissionType
from mission.transfer import Event, Output, RoundTrip, Transfer, UploadBegunAnew, VerifiedUpload

__all__ = ["ChangeOutcome", "ChangeRecord", "ChangeRequest", "ChangeSession"]


class ChangeOutcome(Enum):
    """How a change ended."""

    OPEN = "open"
    """It has not ended."""
    DONE = "done"
    """The new mission is flown."""
    REFUSED = "refused"
    """The autopilot did not take it; the old mission is flown."""
    GIVEN_UP = "given up"
    """It failed, and the vehicle flies on without it."""
    ROLLED_BACK = "rolled back"
    """The new mission had come in part; the old one was put back and is flown."""


@dataclass(slots=True)
class ChangeRecord:
    """One change of a mission in flight. Times are seconds of the run, None for what did not happen.

    Parameters
    ----------
    turned_s : float or None
        When the vehicle took the new target: with its confirmation of the whole mission, or before that where
        it is flown to aside from the mission.
    in_effect_s : float or None
        When its id, item or mode showed that it flies it.
    text : str
        Why it failed, in the autopilot's own words if there are any.
    items, resume_at : int
        Length of the new mission, and the item to go on with.
    """

    items: int
    resume_at: int
    asked_s: float = 0.0
    sent_s: float | None = None
    turned_s: float | None = None
    acknowledged_s: float | None = None
    in_effect_s: float | None = None
    ended_s: float = math.inf
    outcome: ChangeOutcome = ChangeOutcome.OPEN
    text: str = ""
    retries: int = 0

    @property
    def delay_s(self) -> float | None:
        """From the first message to the turn.

        A change that goes on to the present target may be sent later than asked for, when that is near.
        """
        return None if self.turned_s is None or self.sent_s is None else self.turned_s - self.sent_s


@dataclass(frozen=True, slots=True)
class ChangeRequest:
    """The input of a session."""

    old: Mission  # old, new: what the vehicle holds, and what it is to hold
    new: Mission
    item: int  # The item of the old mission that is flown
    resume_at: int  # The item of the new mission to fly to next
    contact: Contact
    seconds_an_item: float  # Measured time to send and read back an item
    guard: FailsafeGuard | None = None  # Sets parameters before the vehicle leaves its mission


class ChangeSession(ABC):
    """Brings a vehicle in flight from one mission to another, sans-IO.

    Feed it with `start`, `receive` (after the monitor took the message) and `poll` (at `next_deadline`);
    send the messages that they return. `record` holds the outcome.

    `held` is the mission that the vehicle holds, as far as is known.
    """

    def __init__(self, request: ChangeRequest) -> None:
        self.request = request
        self.record = ChangeRecord(len(request.new.items), request.resume_at)
        self.held = request.old
        self._contact, self._monitor = request.contact, request.contact.monitor
        # Without a measured link the change measures its own.
        self._round_trip = request.contact.round_trip or RoundTrip()
        self._transfer: Transfer | None = None
        self._texts_before = len(request.contact.texts.texts)

    @property
    def done(self) -> bool:
        """Whether it is over."""
        return self.record.outcome is not ChangeOutcome.OPEN

    @abstractmethod
    def start(self, now_s: float) -> list[Message]:
        """Begin."""

    @abstractmethod
    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Take a message of the vehicle."""

    @abstractmethod
    def poll(self, now_s: float) -> list[Message]:
        """Do what is due."""

    @abstractmethod
    def next_deadline(self) -> float:
        """When `poll` has something to do; infinity for never."""

    @abstractmethod
    def _take(self, output: Output, now_s: float) -> list[Message]:
        """Take the output of the running transfer; return the messages to send."""

    @property
    def _transfer_s(self) -> float:
        """When the running transfer has something to do; infinity for never."""
        deadline_s = None if self._transfer is None else self._transfer.next_deadline()
        return math.inf if deadline_s is None else deadline_s

    def _poll_transfer(self, now_s: float) -> list[Message]:
        if self._transfer is None or now_s < self._transfer_s:
            return []
        return self._take(self._transfer.poll(now_s), now_s)

    def _end(self, outcome: ChangeOutcome, text: str, now_s: float) -> None:
        """Note how it ended."""
        if outcome is ChangeOutcome.DONE:
            self.held = self.request.new
        self.record.outcome, self.record.text, self.record.ended_s = outcome, text, now_s

    _flown_meanwhile = ""
    """The vehicle's behaviour while a change is sent again, for the operator."""

    def _note_begun_anew(self, event: Event, now_s: float) -> None:
        """Note for the operator that the vehicle gave up the upload and that it is sent again."""
        if isinstance(event, UploadBegunAnew):
            text = f"change not accepted, {self._flown_meanwhile}, trying again"
            self._contact.texts.note(text, now_s, m.MAV_SEVERITY_NOTICE)

    def _upload(
        self, items: tuple[MissionItem, ...], start_sequence: int | Callable[[], int] | None
    ) -> VerifiedUpload:
        """Return an upload of a mission."""
        way = {"home": self.request.old.home, "round_trip": self._round_trip}
        return self._contact.upload(items, MissionType.MISSION, start_sequence=start_sequence, **way)

    def _said(self, otherwise: str) -> str:
        """The latest warning since the beginning; it says more than a result code."""
        return self._contact.texts.last_warning(otherwise, self._texts_before)
