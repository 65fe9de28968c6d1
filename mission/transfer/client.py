"""Ground station's side of the mission protocol, sans-IO: transition table and base class of the transfers.

Each row of the table maps a state and an input to an action (the method of that name) and the next state. An
input is a timer, a call of the owner, or a message, classified for the present state. Source:
https://mavlink.io/en/services/mission.html. Real autopilots continue after some error ACKs (ArduPilot: out of
order; PX4: busy before an upload starts). Such an ACK is "trouble": the transfer fails only if no progress
follows. An ERROR after an item was sent ends an upload immediately, because PX4 has aborted the upload.
"""

# ruff: noqa: ARG002 - the actions of the transition table share one signature

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from mission.autopilots import GENERIC
from mission.autopilots.profile import Profile
from mission.link.codec.dialect import Message
from mission.model import MissionType
from mission.transfer import wire
from mission.transfer.events import (
    NOTHING,
    FailureReason,
    LocalTransferError,
    Output,
    PlanState,
    TransferFailed,
    TransferStatistics,
)
from mission.transfer.round_trip import RoundTrip


class ClientState(Enum):
    """State of a transfer on the ground station."""

    READY = "not started"
    COUNTING = "upload: COUNT sent"
    UPLOADING = "upload: answering requests"
    CONFIRMING = "upload: every item sent, waiting for the ACK"
    LISTING = "download: LIST sent"
    DOWNLOADING = "download: requesting items"
    CLEARING = "clear: CLEAR_ALL sent"
    COMPLETE = "complete"
    FAILED = "failed"


class ClientInput(Enum):
    """Input of the transition table."""

    START_UPLOAD = "start of an upload"
    START_DOWNLOAD = "start of a download"
    START_CLEAR = "start of a clear, or of the upload of an empty plan"
    REQUEST = "REQUEST of an item"
    REQUEST_LAST = "REQUEST of the last unsent item"
    REQUEST_REPEATED = "REQUEST of an item that was answered less than a round trip ago"
    COUNT = "COUNT"
    COUNT_EMPTY = "COUNT 0"
    ITEM = "a missing item"
    ITEM_LAST = "the last missing item"
    ITEM_BROKEN = "an item with impossible values"
    ACK_ACCEPTED = "ACK ACCEPTED"
    ACK_TROUBLE = "ACK ERROR, INVALID_SEQUENCE or DENIED"
    ACK_GIVEN_UP = "ACK ERROR after an item was sent"
    ACK_REFUSED = "any other ACK"
    STRAY = "anything else: echoes, other plan types, ACCEPTED too early"
    RETRY = "retry timer"
    RESTART = "retry timer after too many requests for an item"
    GIVE_UP = "no progress for too long"
    CANCEL = "the owner cancels"


_I = ClientInput
READY, COUNTING, UPLOADING, CONFIRMING, LISTING, DOWNLOADING, CLEARING, COMPLETE, FAILED = ClientState

CLIENT_TABLE: Final[dict[tuple[ClientState, ClientInput], tuple[str, ClientState]]] = {
    # not started
    (READY, _I.START_UPLOAD): ("send opening", COUNTING),
    (READY, _I.START_DOWNLOAD): ("send opening", LISTING),
    (READY, _I.START_CLEAR): ("send opening", CLEARING),
    (READY, _I.STRAY): ("ignore", READY),
    (READY, _I.CANCEL): ("fail unstarted", FAILED),
    # upload: COUNT sent
    (COUNTING, _I.REQUEST): ("send item", UPLOADING),
    (COUNTING, _I.REQUEST_LAST): ("send item", CONFIRMING),
    (COUNTING, _I.ACK_TROUBLE): ("note trouble", COUNTING),
    (COUNTING, _I.ACK_REFUSED): ("fail refused", FAILED),
    (COUNTING, _I.STRAY): ("ignore", COUNTING),
    (COUNTING, _I.RETRY): ("repeat opening", COUNTING),
    (COUNTING, _I.GIVE_UP): ("fail silent", FAILED),
    (COUNTING, _I.CANCEL): ("fail cancelled", FAILED),
    # upload: answering requests
    (UPLOADING, _I.REQUEST): ("send item", UPLOADING),
    (UPLOADING, _I.REQUEST_LAST): ("send item", CONFIRMING),
    (UPLOADING, _I.REQUEST_REPEATED): ("note request", UPLOADING),
    (UPLOADING, _I.ACK_TROUBLE): ("note trouble", UPLOADING),
    (UPLOADING, _I.ACK_GIVEN_UP): ("fail given up", FAILED),
    (UPLOADING, _I.ACK_REFUSED): ("fail refused", FAILED),
    (UPLOADING, _I.STRAY): ("ignore", UPLOADING),
    (UPLOADING, _I.RETRY): ("repeat item", UPLOADING),
    (UPLOADING, _I.GIVE_UP): ("fail silent", FAILED),
    (UPLOADING, _I.CANCEL): ("fail cancelled", FAILED),
    # upload: every item sent
    (CONFIRMING, _I.REQUEST): ("send item", CONFIRMING),
    (CONFIRMING, _I.REQUEST_REPEATED): ("note request", CONFIRMING),
    (CONFIRMING, _I.ACK_ACCEPTED): ("complete", COMPLETE),
    (CONFIRMING, _I.ACK_TROUBLE): ("note trouble", CONFIRMING),
    (CONFIRMING, _I.ACK_GIVEN_UP): ("fail given up", FAILED),
    (CONFIRMING, _I.ACK_REFUSED): ("fail refused", FAILED),
    (CONFIRMING, _I.STRAY): ("ignore", CONFIRMING),
    (CONFIRMING, _I.RETRY): ("repeat item", CONFIRMING),
    (CONFIRMING, _I.GIVE_UP): ("fail silent", FAILED),
    (CONFIRMING, _I.CANCEL): ("fail cancelled", FAILED),
    # download: LIST sent
    (LISTING, _I.COUNT): ("ask first", DOWNLOADING),
    (LISTING, _I.COUNT_EMPTY): ("complete", COMPLETE),
    (LISTING, _I.ACK_TROUBLE): ("note trouble", LISTING),
    (LISTING, _I.ACK_REFUSED): ("fail refused", FAILED),
    (LISTING, _I.STRAY): ("ignore", LISTING),
    (LISTING, _I.RETRY): ("repeat opening", LISTING),
    (LISTING, _I.GIVE_UP): ("fail silent", FAILED),
    (LISTING, _I.CANCEL): ("fail cancelled", FAILED),
    # download: requesting items
    (DOWNLOADING, _I.ITEM): ("take item", DOWNLOADING),
    (DOWNLOADING, _I.ITEM_LAST): ("complete", COMPLETE),
    (DOWNLOADING, _I.ITEM_BROKEN): ("fail broken", FAILED),
    (DOWNLOADING, _I.ACK_TROUBLE): ("note trouble", DOWNLOADING),
    (DOWNLOADING, _I.ACK_REFUSED): ("fail refused", FAILED),
    (DOWNLOADING, _I.STRAY): ("ignore", DOWNLOADING),
    (DOWNLOADING, _I.RETRY): ("ask again", DOWNLOADING),
    (DOWNLOADING, _I.RESTART): ("restart", LISTING),
    (DOWNLOADING, _I.GIVE_UP): ("fail silent", FAILED),
    (DOWNLOADING, _I.CANCEL): ("fail cancelled", FAILED),
    # clear
    (CLEARING, _I.ACK_ACCEPTED): ("complete", COMPLETE),
    (CLEARING, _I.ACK_TROUBLE): ("note trouble", CLEARING),
    (CLEARING, _I.ACK_REFUSED): ("fail refused", FAILED),
    (CLEARING, _I.STRAY): ("ignore", CLEARING),
    (CLEARING, _I.RETRY): ("repeat opening", CLEARING),
    (CLEARING, _I.GIVE_UP): ("fail silent", FAILED),
    (CLEARING, _I.CANCEL): ("fail cancelled", FAILED),
    # over
    (COMPLETE, _I.STRAY): ("ignore", COMPLETE),
    (FAILED, _I.STRAY): ("ignore", FAILED),
}


_TROUBLE = frozenset({wire.ERROR, wire.INVALID_SEQUENCE, wire.DENIED})
MORE_OPENINGS = 3
"""Factor by which the opening message is repeated more often on a link that loses frames."""


@dataclass(frozen=True, slots=True)
class ClientTimers:
    """Timers of the ground station; the defaults come from the MAVLink specification.

    Parameters
    ----------
    reply_s : float
        Timeout of COUNT, LIST and CLEAR_ALL (s). With a known round trip time, the timeout follows the round
        trip and is at least twice ``item_s``.
    item_s : float
        Timeout of a request for an item (s). With a known round trip time, the timeout is four round trips,
        at least ``floor_s`` (`RoundTrip.wait`).
    retries : int
        Number of repetitions of COUNT, LIST and CLEAR_ALL.
    silence_s : float
        Timeout without a new item (s), longer than the vehicle's timeout of 5 or 8 s. On slow links it is up
        to 20 ``reply_s``, and at least six times the timeout of a request.
    floor_s : float
        Shortest timeout derived from the round trip time (s).
    """

    reply_s: float = 1.5
    item_s: float = 0.25
    retries: int = 5
    silence_s: float = 10.0
    floor_s: float = 0.1


class ClientTransfer(ABC):
    """One upload, download or clear.

    Call `start`, `receive`, `poll` (at `next_deadline`) and `cancel`, and send the messages of each output.
    The transfer always ends, with one event: a completion or `TransferFailed`.

    Parameters
    ----------
    target : tuple of int
        System and component id of the vehicle.
    source : tuple of int
        System and component id of the ground station.
    round_trip : RoundTrip, optional
        Round trip time of the link, shared with other transfers.
    """

    _opening_input: ClientInput

    def __init__(
        self,
        mission_type: MissionType,
        *,
        target: tuple[int, int] = (1, 1),
        source: tuple[int, int] = wire.GROUND_STATION,
        profile: Profile = GENERIC,
        timers: ClientTimers | None = None,
        round_trip: RoundTrip | None = None,
    ) -> None:
        self.mission_type = mission_type
        self.target = target
        self.source = source
        self.profile = profile
        self.timers = ClientTimers() if timers is None else timers
        self.round_trip = RoundTrip() if round_trip is None else round_trip
        self._state = READY
        self._started_s = 0.0
        self._ended_s: float | None = None
        self._sent_s = 0.0
        self._opened_s = 0.0
        self._progress_s = 0.0
        self._openings = 0
        self._trouble: tuple[int, float] | None = None
        self._messages_sent = 0
        self._messages_received = 0
        self._retries = 0

    @property
    def state(self) -> ClientState:
        """State of the transfer."""
        return self._state

    @property
    def done(self) -> bool:
        """Whether the transfer has ended, successfully or not."""
        return self._state is COMPLETE or self._state is FAILED

    def start(self, now_s: float) -> Output:
        """Start the transfer; raise LocalTransferError if it was started before."""
        if self._state is not READY:
            raise LocalTransferError("this transfer was started before; make a new one")
        self._started_s = self._progress_s = now_s
        return self._step(self._opening_input, None, now_s)

    def receive(self, message: Message, now_s: float) -> Output:
        """Handle one message; ignore messages of other transfers."""
        if not wire.to_client(message) or not self._is_ours(message):
            return NOTHING
        self._messages_received += 1
        return self._step(_I.STRAY if self.done else self._input_of(message, now_s), message, now_s)

    def poll(self, now_s: float) -> Output:
        """Handle the timers that are due."""
        if self._state is READY or self.done:
            return NOTHING
        if now_s >= self._give_up_s():
            return self._step(_I.GIVE_UP, None, now_s)
        if now_s >= self._retry_s():
            return self._step(self._retry_input(), None, now_s)
        return NOTHING

    def next_deadline(self) -> float | None:
        """Return the time of the next `poll` that has an effect; None before the start and after the end."""
        if self._state is READY or self.done:
            return None
        return min(self._give_up_s(), self._retry_s())

    def cancel(self, now_s: float) -> Output:
        """Cancel the transfer and notify the vehicle; raise LocalTransferError if the transfer has ended."""
        if self.done:
            raise LocalTransferError("this transfer is over; there is nothing to cancel")
        return self._step(_I.CANCEL, None, now_s)

    def statistics(self, now_s: float | None = None) -> TransferStatistics:
        """Return the statistics; before the end of the transfer, the duration counts up to ``now_s``."""
        end_s = self._ended_s if self._ended_s is not None else now_s
        return TransferStatistics(
            self.mission_type,
            self._item_count(),
            self._messages_sent,
            self._messages_received,
            self._retries,
            0.0 if end_s is None or self._state is READY else end_s - self._started_s,
        )

    @abstractmethod
    def _input_of(self, message: Message, now_s: float) -> ClientInput:
        """Classify a message as an input of the transition table."""

    @abstractmethod
    def _opening(self) -> Message:
        """Return the message that starts the transfer."""

    @abstractmethod
    def _complete(self, message: Any, now_s: float) -> Output:
        """Return the output of a successful transfer, which ``message`` completed."""

    @abstractmethod
    def _item_count(self) -> int:
        """Return the number of items of the plan."""

    def _retry_s(self) -> float:
        return self._sent_s + self._retry_wait_s()

    def _retry_wait_s(self) -> float:
        timers = self.timers
        return self.round_trip.wait(timers.reply_s, 2.0 * timers.item_s, timers.reply_s)

    def _retry_input(self) -> ClientInput:
        return _I.RETRY

    def _opening_limit_s(self) -> float:
        """Return the time until which the opening message is repeated."""
        timers = self.timers
        each_s = self.round_trip.wait(timers.reply_s, timers.reply_s, timers.reply_s)
        tries = (timers.retries + 1) * (MORE_OPENINGS if self.round_trip.is_lossy else 1)
        return self._opened_s + tries * each_s

    def _silence_s(self) -> float:
        """Return the longest wait for a new item (s); on a slow link, it suffices for twenty requests."""
        timers = self.timers
        wait_s = self.round_trip.wait(timers.item_s, timers.floor_s, timers.reply_s)
        return max(timers.silence_s, min(20.0 * wait_s, 20.0 * timers.reply_s), 6.0 * wait_s)

    def _give_up_s(self) -> float:
        return self._opening_limit_s()

    def _plan_state(self, reason: FailureReason, result: int | None) -> PlanState:
        return PlanState.OLD

    def _is_ours(self, message: wire.MissionMessage) -> bool:
        if message.target_system not in (self.source[0], 0):
            return False
        if message.target_component not in (self.source[1], 0):
            return False
        if message.mission_type != self.mission_type or message.get_srcSystem() != self.target[0]:
            return False
        return self.target[1] in (0, message.get_srcComponent())

    def _input_of_ack(self, message: wire.AckMessage, *, accepted: bool) -> ClientInput:
        if message.type == wire.ACCEPTED:
            return _I.ACK_ACCEPTED if accepted else _I.STRAY
        return _I.ACK_TROUBLE if message.type in _TROUBLE else _I.ACK_REFUSED

    def _step(self, found: ClientInput, message: Message | None, now_s: float) -> Output:
        """Run the action of a row of the transition table (the method of that name) and change the state.

        Each input has one message type (None for timers), so ``message`` has the type the action expects.
        """
        action, following = CLIENT_TABLE[self._state, found]
        output: Output = getattr(self, "_" + action.replace(" ", "_"))(message, now_s)
        self._state = following
        self._messages_sent += len(output.messages)
        if self.done and self._ended_s is None:
            self._ended_s = now_s
        return output

    def _ignore(self, message: Message, now_s: float) -> Output:
        return NOTHING

    def _send_opening(self, message: None, now_s: float) -> Output:
        self._openings += 1
        self._sent_s = now_s
        if self._openings == 1:
            self._opened_s = now_s
        return Output((self._opening(),))

    def _repeat_opening(self, message: None, now_s: float) -> Output:
        self._retries += 1
        return self._send_opening(None, now_s)

    def _measure_opening(self, now_s: float) -> None:
        """Measure the round trip time of the opening message.

        A repeated opening gives only an upper bound.
        """
        if self._openings == 1:
            self.round_trip.sample(now_s - self._sent_s)
        else:
            self.round_trip.limit(now_s - self._opened_s)

    def _note_trouble(self, message: wire.AckMessage, now_s: float) -> Output:
        """Store an error ACK. The timeout counts from the first error ACK, not from later error ACKs."""
        self._trouble = (message.type, now_s if self._trouble is None else self._trouble[1])
        return NOTHING

    def _failed(self, reason: FailureReason, text: str, result: int | None, *, notify: bool) -> Output:
        item = self._refused_item() if reason is FailureReason.REFUSED else None
        held = self._plan_state(reason, result)
        failed = TransferFailed(self.mission_type, reason, text, result, held, item)
        messages = (wire.ack(self.target, wire.OPERATION_CANCELLED, self.mission_type),) if notify else ()
        return Output(messages, (failed,))

    def _fail_refused(self, message: wire.AckMessage, now_s: float) -> Output:
        text = f"{self._what()} was refused{self._at()}: {wire.result_text(message.type)}"
        return self._failed(FailureReason.REFUSED, text, message.type, notify=False)

    def _fail_given_up(self, message: wire.AckMessage, now_s: float) -> Output:
        """Fail as refused, and cancel the transfer: a vehicle that expects items refuses the next COUNT."""
        refused = self._fail_refused(message, now_s)
        return Output((wire.ack(self.target, wire.OPERATION_CANCELLED, self.mission_type),)) + refused

    def _fail_silent(self, message: None, now_s: float) -> Output:
        where = self._where()
        if self._trouble is not None:
            result = self._trouble[0]
            text = f"{self._what()} failed{self._at() or ' ' + where}: {wire.result_text(result)}"
            return self._failed(FailureReason.REFUSED, text, result, notify=True)
        text = f"{self._what()} failed {where}: the vehicle did not answer; check the link and try again"
        return self._failed(FailureReason.TIMEOUT, text, None, notify=True)

    def _fail_cancelled(self, message: None, now_s: float) -> Output:
        text = f"{self._what()} was cancelled {self._where()}"
        return self._failed(FailureReason.CANCELLED, text, None, notify=True)

    def _fail_unstarted(self, message: None, now_s: float) -> Output:
        return self._failed(FailureReason.CANCELLED, f"{self._what()} was cancelled", None, notify=False)

    def _what(self) -> str:
        verb = type(self).__name__.removeprefix("Mission").lower()
        return f"{verb} of the {self.mission_type.name.lower()}"

    def _where(self) -> str:
        return "at the start"

    def _refused_item(self) -> int | None:
        """Return the number of the last item sent, or None before the first item."""
        return None

    def _at(self) -> str:
        """Return a text that names the last item sent; empty before the first item."""
        return ""
