"""Upload and clear of a plan on the ground station's side, sans-IO."""

# ruff: noqa: ARG002 - the actions of the transition table share one signature

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

from mission.autopilots.profile import Profile
from mission.link.codec.dialect import Message, mavlink
from mission.link.codec.typed import is_a
from mission.model import GeoPoint, Mission, MissionItem, MissionType, plan_of
from mission.transfer import wire
from mission.transfer.client import (
    CLEARING,
    COMPLETE,
    CONFIRMING,
    COUNTING,
    MORE_OPENINGS,
    UPLOADING,
    ClientInput,
    ClientTransfer,
)
from mission.transfer.events import (
    NOTHING,
    ClearComplete,
    FailureReason,
    LocalTransferError,
    Output,
    PlanState,
    Progress,
    UploadComplete,
)
from mission.transfer.remarks import longer_plan_fix
from mission.transfer.wire import to_wire_order

_I = ClientInput
_SHORTEST_TRIP_S = 0.02
START_S = 30.0
_START_TRIPS = 6.6
"""The vehicle must accept an item within this number of round trips (six, plus 10 %), or within `START_S`,
whichever is longer."""


@dataclass(slots=True)
class _Answers:
    """Copies of an item sent within a round trip: number of copies, times of the first and the last copy."""

    first_s: float
    last_s: float
    copies: int = 1
    repeated: bool = False


def check_plan(items: Sequence[MissionItem], mission_type: MissionType) -> None:
    """Raise LocalTransferError for a plan with more than 65534 items or with items of another plan type.

    The values need no check: `MissionItem` accepts only finite values in range.

    >>> check_plan([MissionItem(5100, 3, x=28.0, y=-82.0)], MissionType.MISSION)
    Traceback (most recent call last):
        ...
    mission.transfer.events.LocalTransferError: item 1: command 5100 does not belong in a mission plan
    """
    if len(items) >= wire.MAX_ITEMS:
        msg = f"{len(items)} items: MAVLink allows fewer than {wire.MAX_ITEMS}; send a shorter plan"
        raise LocalTransferError(msg)
    for sequence, item in enumerate(items):
        if plan_of(item.command) != mission_type:
            plan = mission_type.name.lower()
            msg = f"item {sequence + 1}: command {item.command} does not belong in a {plan} plan"
            raise LocalTransferError(msg)


class MissionUpload(ClientTransfer):
    """Upload of a plan; ends with `UploadComplete` or `TransferFailed`. Raises the error of `check_plan`.

    An empty plan is sent as MISSION_CLEAR_ALL, because PX4 is blocked for a while after a COUNT of 0.

    Parameters
    ----------
    items : sequence of MissionItem
        Plan without a home item, in the form that the autopilot accepts (`mission.transfer.rendering`).
    home : GeoPoint, optional
        Home position, for autopilots that store home as item 0.
    start_sequence : int or None
        Item to mark as current, or None for none.
    origins : sequence of int, optional
        Number of each item in the user's plan, from 0, for error messages. Default: the position in
        ``items``.
    begun_s : float, optional
        Start time of the first attempt, if this upload is a retry.
    **options
        See `mission.transfer.client.ClientTransfer`.

    Examples
    --------
    >>> upload = MissionUpload([MissionItem.waypoint(28.05, -82.15, 10.0)])
    >>> upload.start(now_s=0.0).messages[0].get_type()
    'MISSION_COUNT'
    >>> upload.next_deadline()
    1.5
    """

    def __init__(
        self,
        items: Sequence[MissionItem],
        mission_type: MissionType = MissionType.MISSION,
        *,
        home: GeoPoint | None = None,
        start_sequence: int | None = 0,
        origins: Sequence[int] | None = None,
        begun_s: float | None = None,
        **options: Any,
    ) -> None:
        super().__init__(mission_type, **options)
        check_plan(items, mission_type)
        self.items = tuple(items)
        self._wire = to_wire_order(self.items, mission_type, self.profile, home)
        self._origins = range(len(self.items)) if origins is None else origins
        self._current = None if start_sequence is None else start_sequence + len(self._wire) - len(self.items)
        self._answers: list[_Answers | None] = [None] * len(self._wire)
        self._unsent = len(self._wire)
        self._highest = -1
        self._last = -1
        self._begun_s = begun_s
        self._opening_input = _I.START_UPLOAD if self._wire else _I.START_CLEAR

    @property
    def under_way(self) -> bool:
        """Whether the vehicle has accepted an item."""
        return self._highest > 0 or self._state in (CONFIRMING, COMPLETE)

    def _item_count(self) -> int:
        return len(self.items)

    def _opening(self) -> Message:
        if self._wire:
            return wire.count(self.target, len(self._wire), self.mission_type)
        return wire.clear_all(self.target, self.mission_type)

    def _input_of(self, message: Message, now_s: float) -> ClientInput:
        if wire.is_request(message) and self._state is not CLEARING:
            # A request that skips items at the start of an upload belongs to a previous upload.
            skips = message.seq > self._highest + 1 and (self._highest < 0 or self._begun_s is not None)
            if message.seq >= len(self._wire) or skips:
                return _I.STRAY
            answers = self._answers[message.seq]
            if answers is None:
                return _I.REQUEST_LAST if self._unsent == 1 else _I.REQUEST
            return _I.REQUEST if self._was_lost(answers, now_s) else _I.REQUEST_REPEATED
        if is_a(message, mavlink.MAVLink_mission_ack_message):
            if message.type == wire.ERROR and self._state in (UPLOADING, CONFIRMING):
                return _I.ACK_GIVEN_UP
            return self._input_of_ack(message, accepted=self._state in (CONFIRMING, CLEARING))
        return _I.STRAY

    @property
    def _trip_s(self) -> float:
        return max(self.round_trip.known_s or 0.0, _SHORTEST_TRIP_S)

    def _was_lost(self, answers: _Answers, now_s: float) -> bool:
        """Return whether a repeated request means that the item was lost, and is not still in transit."""
        if now_s >= answers.first_s + self._trip_s:
            return True
        copies, apart_s = self.round_trip.copies(self.profile.abort_s)
        return answers.copies < copies and now_s >= answers.last_s + apart_s

    def _note_request(self, message: wire.RequestMessage, now_s: float) -> Output:
        self._trouble = None
        return NOTHING

    def _send_item(self, message: wire.RequestMessage, now_s: float) -> Output:
        sequence = message.seq
        self._trouble = None
        events: tuple[Progress, ...] = ()
        if self._answers[sequence] is None:
            # The round trip is measured from messages that were sent only once (Karn's algorithm).
            before = self._answers[sequence - 1] if sequence else None
            if sequence == 0:
                self._measure_opening(now_s)
            elif before is not None and not before.repeated:
                self.round_trip.sample(now_s - before.first_s)
            self._unsent -= 1
            events = (Progress(self.mission_type, len(self._wire) - self._unsent, len(self._wire)),)
        else:
            self._retries += 1
        if sequence > self._highest:
            self._highest = sequence
            self._progress_s = now_s
        return Output(self._item(sequence, now_s).messages, events)

    def _item(self, sequence: int, now_s: float) -> Output:
        self._last = sequence
        self._sent_s = now_s
        answers = self._answers[sequence]
        if answers is None:
            self._answers[sequence] = _Answers(now_s, now_s)
        elif now_s < answers.first_s + self._trip_s:
            self._answers[sequence] = _Answers(answers.first_s, now_s, answers.copies + 1, repeated=True)
        else:
            self._answers[sequence] = _Answers(now_s, now_s, repeated=True)
        return Output((self._item_message(sequence),))

    def _item_message(self, sequence: int) -> wire.ItemMessage:
        current = self.mission_type == MissionType.MISSION and sequence == self._current
        return wire.item_to_message(
            self._wire[sequence], sequence, self.mission_type, self.target, current=current
        )

    def item_messages(self) -> list[wire.ItemMessage]:
        """Return the item messages of the plan, for programs that send them in another way."""
        return [self._item_message(sequence) for sequence in range(len(self._wire))]

    def _repeat_item(self, message: None, now_s: float) -> Output:
        """Repeat the last item, because the item or the vehicle's next request was lost."""
        self._retries += 1
        return self._item(self._last, now_s)

    def _retry_s(self) -> float:
        if self._state is UPLOADING:  # usually the vehicle repeats its request before this timer ends
            return self._sent_s + max(self.timers.reply_s, self._retry_wait_s())
        return super()._retry_s()

    def _retry_wait_s(self) -> float:
        wait_s = super()._retry_wait_s()
        if self._state is COUNTING and self.round_trip.is_lossy:
            return max(self.timers.reply_s, wait_s / MORE_OPENINGS)
        return wait_s

    def _start_limit_s(self) -> float:
        """Return the deadline for the vehicle to accept an item, counted from the first attempt."""
        trips_s = _START_TRIPS * (self.round_trip.known_s or 0.0)
        return (self._started_s if self._begun_s is None else self._begun_s) + max(START_S, trips_s)

    def _give_up_s(self) -> float:
        if self._state is CLEARING:
            return self._opening_limit_s()
        if self._state is COUNTING:
            return min(self._opening_limit_s(), self._start_limit_s())
        limit_s = self._progress_s + self._silence_s()
        if not self.under_way:
            limit_s = min(limit_s, self._start_limit_s())
        if self._trouble is not None:
            trip_s = self.round_trip.known_s or 0.0
            limit_s = min(limit_s, self._trouble[1] + 2.0 * (self.timers.reply_s + trip_s))
        return limit_s

    def _complete(self, message: wire.AckMessage, now_s: float) -> Output:
        return Output(events=(UploadComplete(self.mission_type, len(self.items), message.opaque_id),))

    def _plan_state(self, reason: FailureReason, result: int | None) -> PlanState:
        if self._state is CONFIRMING or self._state is CLEARING:
            return PlanState.UNKNOWN
        # At a smaller COUNT, a vehicle that overwrites in place truncates its plan; its answer may be lost.
        refused = reason is FailureReason.REFUSED and result != wire.OPERATION_CANCELLED
        untouched = not self._openings or (self._highest < 0 and refused)
        return PlanState.OLD if self.profile.atomic or untouched else PlanState.UNKNOWN

    def _where(self) -> str:
        if self._state is CONFIRMING:
            return "after the last item"
        if self._refused_item() is None:
            return "at the start"
        return f"after item {self._named_item()}, {len(self._wire) - self._unsent} of {len(self._wire)} sent"

    def _fail_refused(self, message: wire.AckMessage, now_s: float) -> Output:
        self._trouble = message.type, now_s
        if message.type != wire.NO_SPACE or self.profile.card is None:
            return super()._fail_refused(message, now_s)
        fix = longer_plan_fix(len(self.items), self.mission_type, self.profile)
        text = (
            f"{self._what()} was refused: no space for {len(self._wire)} items (MAV_MISSION_NO_SPACE): {fix}"
        )
        return self._failed(FailureReason.REFUSED, text, message.type, notify=False)

    def _refused_item(self) -> int | None:
        own = self._last - (len(self._wire) - len(self.items))
        return self._origins[own] if own >= 0 else None

    def _at(self) -> str:
        if self._refused_item() is None:
            return ""
        return f" at item {self._named_item()}"

    def _named_item(self) -> str:
        """Return the number (from 1) and the command of the last item sent, as text."""
        number = self._refused_item()
        assert number is not None
        return f"{number + 1} ({wire.command_name(self._wire[self._last].command)})"


class MissionClear(ClientTransfer):
    """Removal of one plan from the vehicle; ends with `ClearComplete` or `TransferFailed`."""

    _opening_input = ClientInput.START_CLEAR

    def _item_count(self) -> int:
        return 0

    def _opening(self) -> Message:
        return wire.clear_all(self.target, self.mission_type)

    def _input_of(self, message: Message, now_s: float) -> ClientInput:
        if is_a(message, mavlink.MAVLink_mission_ack_message):
            return self._input_of_ack(message, accepted=True)
        return ClientInput.STRAY

    def _complete(self, message: wire.AckMessage, now_s: float) -> Output:
        return Output(events=(ClearComplete(self.mission_type),))

    def _plan_state(self, reason: FailureReason, result: int | None) -> PlanState:
        return PlanState.UNKNOWN if self._openings else PlanState.OLD


NO_MISSION_LEFT = "the old mission was cleared before the upload: the vehicle holds no mission"
"""Message text if an upload failed after the vehicle's old mission was cleared."""


def gives_up_mission(
    mission: Mission, kinds: Collection[MissionType], profile: Profile, *, armed: bool
) -> bool:
    """Return whether to clear a vehicle's old mission before new plans of these types are uploaded.

    This is necessary only for a disarmed vehicle that would check the old mission against the new fence. If
    the upload is aborted afterwards, the vehicle has no mission to fly.
    """
    both = {MissionType.MISSION, MissionType.FENCE} <= set(kinds)
    return profile.checks_stored_mission and both and bool(mission.fence) and not armed
