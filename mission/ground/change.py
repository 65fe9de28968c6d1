"""Change of a mission in flight: request, record of the outcome, and base class of the session."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from mission.autopilots.profile import NeededParameter
from mission.ground.contact import Contact, retry_s_over, tries_over
from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import Mission, MissionItem, MissionType
from mission.transfer import Event, Output, RoundTrip, Transfer, UploadBegunAnew, VerifiedUpload


class FailsafeGuard:
    """Sets the failsafe parameters that a change in flight needs, sans-IO; one guard serves a whole flight.

    The parameters are set one after the other, because the link may be lost at any time: the last parameter
    enables a failsafe that depends on the other parameters.
    """

    def __init__(self, needed: Sequence[NeededParameter], contact: Contact, was_set: list[str]) -> None:
        self.refused = ""  # reason of a failure, empty if none
        self.due_s = math.inf
        self._was_set = was_set  # log of the parameters set, with old and new value
        self._before: dict[str, int] = {}
        self._vehicle, self._round_trip = contact.vehicle, contact.round_trip
        self._open = {parameter.name: parameter for parameter in needed}
        self._set: dict[str, tuple[int, int]] = {}
        self._sent: set[str] = set()
        self._asked: Counter[str] = Counter()
        self._tries = 0

    @property
    def ready(self) -> bool:
        """Whether all parameters have the required values."""
        return not self._open

    def begin(self, now_s: float) -> list[Message]:
        """Begin to read and set the parameters, also again after a failure."""
        self.refused, self._tries = "", 0
        return self.poll(now_s)

    def poll(self, now_s: float) -> list[Message]:
        """Request unknown parameters, and set an unconfirmed parameter again."""
        if self.ready:
            return []
        if self._tries >= tries_over(self._round_trip):
            self._refuse(f"{', '.join(sorted(self._open))} could not be read or set")
            return []
        self._tries += 1
        self.due_s = now_s + retry_s_over(self._round_trip, self._tries - 1)
        questions: list[Message] = []
        for name in self._open:
            if name not in self._set:
                self._asked[name] += 1
                questions.append(m.MAVLink_param_request_read_message(*self._vehicle, name.encode(), -1))
        return questions + self._next_setting(again=True)

    def receive(self, message: m.MAVLink_param_value_message) -> list[Message]:
        """Handle the value of a parameter."""
        name = str(message.param_id)
        needed = self._open.get(name)
        if needed is None or not math.isfinite(message.param_value):
            return []
        value = round(message.param_value)
        wanted = needed.wanted(value)
        if wanted == value:
            if name in self._before:
                self._was_set.append(f"{name} was {self._before[name]}, is set to {value} and stays so")
            del self._open[name]
            self._tries = 0
            self.due_s = math.inf if self.ready else self.due_s
            return self._next_setting()
        # After repeated requests, a late answer may still hold the value from before the parameter was set.
        self._asked[name] -= 1
        if name in self._sent and self._asked[name] < 0:
            self._refuse(f"{name} stays {value}, but must be {wanted}")
            return []
        self._set[name] = wanted, message.param_type
        self._before.setdefault(name, value)
        return self._next_setting()

    def _next_setting(self, *, again: bool = False) -> list[Message]:
        """Return the message that sets the next parameter; none if the parameter's value is still unknown."""
        name = next(iter(self._open), None)
        if name is None or name not in self._set or (name in self._sent and not again):
            return []
        self._sent.add(name)
        value, kind = self._set[name]
        return [m.MAVLink_param_set_message(*self._vehicle, name.encode(), float(value), kind)]

    def _refuse(self, why: str) -> None:
        self.refused = f"a vehicle without its ground station would not come home: {why}"
        self.due_s = math.inf
        self._set.clear()
        self._sent.clear()
        self._asked.clear()


class ChangeOutcome(Enum):
    """Outcome of a change."""

    OPEN = "open"
    """The change is in progress."""
    DONE = "done"
    """The vehicle flies the new mission."""
    REFUSED = "refused"
    """The autopilot refused the change, and the vehicle flies the old mission."""
    GIVEN_UP = "given up"
    """The change failed or never began, for the reason in `ChangeRecord.text`."""
    ROLLED_BACK = "rolled back"
    """The upload of the new mission failed, and the vehicle flies the old mission, which was sent again."""


@dataclass(slots=True)
class ChangeRecord:
    """Record of one change of a mission in flight. Times (s) count from the start of the run.

    Parameters
    ----------
    items, resume_at : int
        Number of items of the new mission, and the item at which to resume.
    turned_s : float or None
        Time at which the vehicle turned to the new target, that is, acknowledged the whole mission or the
        position in guided mode.
    in_effect_s : float or None
        Time at which plan id, item or mode showed that the vehicle flies the new mission.
    text : str
        Reason of a failure, if possible the autopilot's text.
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
        """Time from the first message of the change to the turn (s), or None if the vehicle has not turned.

        If the change keeps the present target, the first message may be sent only shortly before the target.
        """
        return None if self.turned_s is None or self.sent_s is None else self.turned_s - self.sent_s


@dataclass(frozen=True, slots=True)
class ChangeRequest:
    """Input of a `ChangeSession`: the old and the new mission, and access to the vehicle."""

    old: Mission  # mission on the vehicle
    new: Mission
    item: int  # Current item of the old mission.
    resume_at: int  # Item of the new mission to fly to next.
    contact: Contact
    seconds_an_item: float  # Measured upload and read-back time per item.
    guard: FailsafeGuard | None = None  # Sets failsafe parameters before the vehicle leaves its mission.


class ChangeSession(ABC):
    """Change of the mission of a vehicle in flight, sans-IO.

    Call `start`, `receive` (after the monitor has handled the message) and `poll` (at `next_deadline`), and
    send the returned messages. `record` has the outcome. `held` is the mission that the vehicle is believed
    to hold.
    """

    def __init__(self, request: ChangeRequest) -> None:
        self.request = request
        self.record = ChangeRecord(len(request.new.items), request.resume_at)
        self.held = request.old
        self._contact, self._monitor = request.contact, request.contact.monitor
        # The change measures the round trip time itself if the link does not.
        self._round_trip = request.contact.round_trip or RoundTrip()
        self._transfer: Transfer | None = None
        self._texts_before = request.contact.texts.count

    @property
    def done(self) -> bool:
        """Whether the change has ended."""
        return self.record.outcome is not ChangeOutcome.OPEN

    @abstractmethod
    def start(self, now_s: float) -> list[Message]:
        """Begin the change."""

    @abstractmethod
    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Handle a message of the vehicle."""

    @abstractmethod
    def poll(self, now_s: float) -> list[Message]:
        """Return the messages that are due."""

    @abstractmethod
    def next_deadline(self) -> float:
        """Return the time of the next `poll` that has an effect; infinity if there is none."""

    @abstractmethod
    def _take(self, output: Output, now_s: float) -> list[Message]:
        """Handle an output of the transfer in progress; return the messages to send."""

    @property
    def _transfer_s(self) -> float:
        """Deadline of the transfer in progress (s); infinity if there is none."""
        deadline_s = None if self._transfer is None else self._transfer.next_deadline()
        return math.inf if deadline_s is None else deadline_s

    def _poll_transfer(self, now_s: float) -> list[Message]:
        if self._transfer is None or now_s < self._transfer_s:
            return []
        return self._take(self._transfer.poll(now_s), now_s)

    def _end(self, outcome: ChangeOutcome, text: str, now_s: float) -> None:
        """Record the outcome."""
        if outcome is ChangeOutcome.DONE:
            self.held = self.request.new
        self.record.outcome, self.record.text, self.record.ended_s = outcome, text, now_s

    _flown_meanwhile = ""
    """Text for the operator: what the vehicle does while the upload is repeated."""

    def _note_begun_anew(self, event: Event, now_s: float) -> None:
        """Report a retry of the upload to the operator."""
        if isinstance(event, UploadBegunAnew):
            text = f"change not accepted, {self._flown_meanwhile}, trying again"
            self._contact.texts.note(text, now_s, m.MAV_SEVERITY_NOTICE)

    def _upload(
        self, items: tuple[MissionItem, ...], start_sequence: int | Callable[[], int] | None
    ) -> VerifiedUpload:
        return self._contact.upload(
            items,
            MissionType.MISSION,
            start_sequence=start_sequence,
            home=self.request.old.home,
            round_trip=self._round_trip,
        )

    def _said(self, otherwise: str) -> str:
        """Return the vehicle's latest warning since the start of the change, or ``otherwise``."""
        return self._contact.texts.last_warning(otherwise, self._texts_before)
