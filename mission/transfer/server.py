"""The vehicle's side of the mission protocol, sans-IO."""

# ruff: noqa: ARG002 - the actions of the transition table share one signature

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import assert_never

from mission.link.codec.dialect import mavlink
from mission.model import GeoPoint, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.events import (
    NOTHING,
    Event,
    FailureReason,
    Message,
    Output,
    PlanCleared,
    PlanReplaced,
    PlanSent,
    StatusText,
    TransferFailed,
    TransferStarted,
)
from mission.transfer.plan_store import PlanStore, StoredPlan
from mission.transfer.profile import PX4, Profile, from_wire_order, to_wire_order
from mission.transfer.server_judge import ServerJudge, Validator
from mission.transfer.server_session import EndedUpload, ServerSession
from mission.transfer.server_table import (
    IDLE,
    RECEIVING,
    SENDING,
    SERVER_TABLE,
    ServerAction,
    ServerInput,
    ServerState,
)
from mission.transfer.storage import frame_on_wire

_I = ServerInput
_A = ServerAction
_COMPONENTS = frozenset({0, mavlink.MAV_COMP_ID_MISSIONPLANNER})
_WARNING = mavlink.MAV_SEVERITY_WARNING
_CRITICAL = mavlink.MAV_SEVERITY_CRITICAL
_INFO = mavlink.MAV_SEVERITY_INFO


class MissionServer:
    """Stores the three plans of a vehicle and talks about them with ground stations.

    No socket and no clock: the owner feeds messages and the time, sends what comes out, and calls `poll` at
    `next_deadline`. Nothing that arrives raises. The rules are in `mission.transfer.server_table`.

    Parameters
    ----------
    system_id, component_id : int
        The vehicle's ids; messages for others are ignored.
    profile : Profile
        Whose habits to follow: `PX4` (atomic, strict) or `ARDUPILOT` (in place, stateless download).
    capacity : mapping of MissionType to int, optional
        The most items per plan; default 65535.
    validator : callable, optional
        Judges each mission item by itself: returns a MAV_MISSION_RESULT, 0 to accept.
    home : GeoPoint, optional
        Home, which profiles with a home item show as item 0; assign `home` when it changes.

    Attributes
    ----------
    current_sequence : int
        The item marked as current in downloads.
    locked : bool
        The mission may not be cleared now (ArduPilot while it flies it).

    Examples
    --------
    >>> server = MissionServer(1, 1)
    >>> server.set_plan(MissionType.MISSION, [MissionItem.waypoint(28.05, -82.15, 10.0)]).items[0].command
    16
    >>> server.next_deadline() is None
    True
    """

    def __init__(
        self,
        system_id: int,
        component_id: int = 1,
        *,
        profile: Profile = PX4,
        capacity: Mapping[MissionType, int] | None = None,
        validator: Validator | None = None,
        home: GeoPoint | None = None,
    ) -> None:
        self.system_id = system_id
        self.component_id = component_id
        self.profile = profile
        self.current_sequence = 0
        self._store = PlanStore(profile, capacity, home)
        self._session = ServerSession()
        self._judge = ServerJudge(profile, self._store, self._session, validator)

    @property
    def home(self) -> GeoPoint | None:
        """Home, as profiles with a home item show it."""
        return self._store.home

    @home.setter
    def home(self, home: GeoPoint | None) -> None:
        self._store.home = home

    @property
    def validator(self) -> Validator | None:
        """What judges each mission item by itself."""
        return self._judge.validator

    @validator.setter
    def validator(self, validator: Validator | None) -> None:
        self._judge.validator = validator

    @property
    def locked(self) -> bool:
        """Whether the mission may not be cleared now."""
        return self._judge.locked

    @locked.setter
    def locked(self, locked: bool) -> None:
        self._judge.locked = locked

    @property
    def state(self) -> ServerState:
        """What the server is doing."""
        return self._session.state

    @property
    def busy(self) -> bool:
        """Whether a transfer is running."""
        return self._session.state is not IDLE

    def plan(self, mission_type: MissionType) -> StoredPlan:
        """Return the plan in force, without home."""
        return self._store.plan(mission_type)

    def count(self, mission_type: MissionType) -> int:
        """Return how many items a download has (with home, where the autopilot counts it)."""
        return len(self._store.wire_items(mission_type))

    def set_plan(self, mission_type: MissionType, items: Sequence[MissionItem]) -> StoredPlan:
        """Put a plan in force from inside the vehicle and return it with its id."""
        self._session.ended = None
        return self._store.put(mission_type, tuple(items))

    def receive(self, message: Message, now_s: float) -> Output:
        """Take one message; what is not a mission message for this vehicle is ignored."""
        if type(message).id not in wire.SERVER_MESSAGES:
            return NOTHING
        if message.target_system not in (self.system_id, 0):
            return NOTHING
        if message.target_component != self.component_id and message.target_component not in _COMPONENTS:
            return NOTHING
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if sender[0] == 0:  # an answer to system 0 would be a broadcast, which ends other stations' transfers
            return NOTHING
        before = NOTHING
        while True:
            state = self._session.state
            found = self._judge.judge(message, sender, now_s)
            if state is not IDLE and sender == self._session.partner:
                self._session.heard_s = now_s
            output = before + self._step(found, message, sender, now_s)
            if found is not _I.IMPLIED_END and found is not _I.ABANDONED:
                return output
            before = output

    def poll(self, now_s: float) -> Output:
        """Act on the timers that are due."""
        if self._session.state is IDLE:
            return NOTHING
        if now_s >= self._session.heard_s + self.profile.abort_s:
            return self._step(_I.ABORT, None, self._session.partner, now_s)
        if self._session.state is RECEIVING and now_s >= self._session.asked_s + self.profile.re_request_s:
            return self._step(_I.RETRY, None, self._session.partner, now_s)
        return NOTHING

    def next_deadline(self) -> float | None:
        """When `poll` has something to do, None if no transfer runs."""
        if self._session.state is IDLE:
            return None
        abort = self._session.heard_s + self.profile.abort_s
        return (
            min(abort, self._session.asked_s + self.profile.re_request_s)
            if self._session.state is RECEIVING
            else abort
        )

    def _step(self, found: ServerInput, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        action, following = SERVER_TABLE[self._session.state, found]
        output = self._act(action, message, sender, now_s)
        self._session.state = following
        return output

    def _act(self, action: ServerAction, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        match action:
            case _A.ASK_FIRST:
                return self._ask_first(message, sender, now_s)
            case _A.CLEAR_BY_COUNT:
                return self._clear_by_count(message, sender, now_s)
            case _A.REFUSE_SPACE:
                return self._refuse_space(message, sender, now_s)
            case _A.REFUSE_BUSY:
                return self._refuse_busy(message, sender, now_s)
            case _A.REFUSE_TYPE:
                return self._refuse_type(message, sender, now_s)
            case _A.REPEAT_ACK:
                return self._repeat_ack(message, sender, now_s)
            case _A.IGNORE:
                return self._ignore(message, sender, now_s)
            case _A.REFUSE_UNEXPECTED_ITEM:
                return self._refuse_unexpected_item(message, sender, now_s)
            case _A.SEND_COUNT:
                return self._send_count(message, sender, now_s)
            case _A.SEND_ITEM:
                return self._send_item(message, sender, now_s)
            case _A.ANSWER_BEYOND:
                return self._answer_beyond(message, sender, now_s)
            case _A.REFUSE_REQUEST:
                return self._refuse_request(message, sender, now_s)
            case _A.CLEAR:
                return self._clear(message, sender, now_s)
            case _A.REFUSE_CLEAR:
                return self._refuse_clear(message, sender, now_s)
            case _A.REFUSE_CLEAR_NOW:
                return self._refuse_clear_now(message, sender, now_s)
            case _A.REFUSE_PARTIAL:
                return self._refuse_partial(message, sender, now_s)
            case _A.ASK_PART:
                return self._ask_part(message, sender, now_s)
            case _A.TAKE_ITEM:
                return self._take_item(message, sender, now_s)
            case _A.TAKE_LAST_ITEM:
                return self._take_last_item(message, sender, now_s)
            case _A.REFUSE_ITEM:
                return self._refuse_item(message, sender, now_s)
            case _A.ANSWER_ORDER:
                return self._answer_order(message, sender, now_s)
            case _A.REFUSE_ITEM_TYPE:
                return self._refuse_item_type(message, sender, now_s)
            case _A.REFUSE_FOREIGN_ITEM:
                return self._refuse_foreign_item(message, sender, now_s)
            case _A.REFUSE_LIST:
                return self._refuse_list(message, sender, now_s)
            case _A.REFUSE_REQUEST_NOW:
                return self._refuse_request_now(message, sender, now_s)
            case _A.END_CANCELLED:
                return self._end_cancelled(message, sender, now_s)
            case _A.ASK_AGAIN:
                return self._ask_again(message, sender, now_s)
            case _A.ABORT_UPLOAD:
                return self._abort_upload(message, sender, now_s)
            case _A.SAY_BUSY:
                return self._say_busy(message, sender, now_s)
            case _A.REFUSE_CHANGED:
                return self._refuse_changed(message, sender, now_s)
            case _A.REFUSE_JUMP:
                return self._refuse_jump(message, sender, now_s)
            case _A.END_SENT:
                return self._end_sent(message, sender, now_s)
            case _A.END_REFUSED:
                return self._end_refused(message, sender, now_s)
            case _A.ABORT_DOWNLOAD:
                return self._abort_download(message, sender, now_s)
            case _:
                assert_never(action)

    # Acting: what the rows of the table do, before the state changes.

    def _ignore(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return NOTHING

    def _ask_first(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        self._session.partner, self._session.type, self._session.count = (
            sender,
            MissionType(message.mission_type),
            message.count,
        )
        return self._begin(0, now_s)

    def _ask_part(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        self._session.partner, self._session.type = sender, MissionType(message.mission_type)
        self._session.count = message.end_index + 1
        return self._begin(message.start_index, now_s, part=True)

    def _begin(self, first: int, now_s: float, *, part: bool = False) -> Output:
        self._session.items, self._session.start, self._session.ended = [], 0, None
        self._session.first, self._session.part, self._session.warned = first, part, False
        self._session.heard_s = now_s
        started = TransferStarted(self._session.type, upload=True, count=self._session.count - first)
        return self._ask(now_s) + Output(events=(started,))

    def _ask(self, now_s: float) -> Output:
        self._session.asked_s = now_s
        build = (
            mavlink.MAVLink_mission_request_int_message
            if self.profile.request_int
            else mavlink.MAVLink_mission_request_message
        )
        return Output((build(*self._session.partner, self._session.expected, self._session.type),))

    def _ask_again(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return self._ask(now_s)

    def _take(self, message: Message) -> tuple[Event, ...]:
        """Keep the item that was judged; ArduPilot complains once about items of the old kind."""
        assert self._session.candidate is not None
        if message.current and message.seq:
            self._session.start = message.seq - self._store.home_items(self._session.type)
        self._session.items.append(self._session.candidate)
        return self._warn_of_floats("got MISSION_ITEM; GCS should send MISSION_ITEM_INT", message, wire.ITEM)

    def _warn_of_floats(self, text: str, message: Message, old: int) -> tuple[Event, ...]:
        if self._session.warned or type(message).id != old or not self.profile.stateless_download:
            return ()
        self._session.warned = True
        return (StatusText(self._session.type, _WARNING, text),)

    def _take_item(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        said = self._take(message)
        return self._ask(now_s) + Output(events=said)

    def _take_last_item(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        said = self._take(message)
        last = (
            self._session.candidate if message.seq or not self._store.home_items(self._session.type) else None
        )
        self._session.ended = EndedUpload(sender, self._session.type, message.seq, last, int(wire.ACCEPTED))
        replaced = self._put(self._merged(), start=self._session.start)
        return self._ack(wire.ACCEPTED, self._session.type, sender, replaced, *said, *self._received())

    def _received(self) -> tuple[Event, ...]:
        texts = self.profile.received_texts
        return () if texts is None else (StatusText(self._session.type, _INFO, texts[self._session.type]),)

    def _merged(self) -> tuple[MissionItem, ...]:
        """Return the plan after what has come: the whole new one, or the old one with a part replaced."""
        came = tuple(self._session.items)
        if self._session.first or self._session.part or len(came) < self._session.count:
            old = self._store.wire_items(self._session.type)
            if not old and came:
                old = to_wire_order(came[:1], self._session.type, self.profile, self.home)[:1]
            end = len(old) if self._session.part else self._session.count
            came = old[: self._session.first] + came + old[self._session.first + len(came) : end]
        return from_wire_order(came, self._session.type, self.profile)[0]

    def _put(self, items: tuple[MissionItem, ...], *, start: int = 0, complete: bool = True) -> Event:
        plan, changed = self._store.received(self._session.type, items)
        self._session.items = []
        return PlanReplaced(self._session.type, items, plan.opaque_id, changed, start, complete)

    def _refuse_item(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        self._session.ended = EndedUpload(
            sender, self._session.type, message.seq, None, self._session.verdict
        )
        text = f"item {message.seq}: {wire.result_text(self._session.verdict)}"
        failed = self._fail(FailureReason.REFUSED, text, self._session.verdict)
        said = StatusText(self._session.type, _WARNING, f"Mission item {message.seq} rejected")
        return self._ack(self._session.verdict, self._session.type, sender, *failed, said)

    def _answer_order(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        if self.profile.order_result is None:
            return NOTHING
        return self._ack(self.profile.order_result, self._session.type, sender)

    def _refuse_item_type(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return self._ack(wire.ERROR, message.mission_type, sender)

    def _repeat_ack(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        assert self._session.ended is not None
        return self._ack(self._session.ended.result, self._session.ended.mission_type, sender)

    def _refuse_unexpected_item(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        said = self._say("REJ. item: no transfer is running")
        return self._ack(wire.ERROR, message.mission_type, sender, said)

    def _refuse_busy(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        said = self._say("REJ. CMD: Busy")
        return self._ack(self.profile.busy_result, message.mission_type, sender, said)

    def _say_busy(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return Output(events=(self._say("IGN. CMD: Busy"),))

    def _say(self, text: str) -> StatusText:
        return StatusText(self._session.type, _WARNING, self.profile.text_prefix + text)

    def _refuse_foreign_item(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        """PX4 says so and sends nothing; ArduPilot answers."""
        if self.profile.busy_result == wire.DENIED:
            return self._ack(wire.DENIED, message.mission_type, sender)
        return self._say_busy(message, sender, now_s)

    def _refuse_request_now(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        if self.profile.stateless_download:
            return self._ack(wire.DENIED, message.mission_type, sender)
        return NOTHING

    def _refuse_clear_now(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        if self.profile.busy_result == wire.DENIED:
            said = self._say("Mission not cleared: it is in use")
            return self._ack(wire.ERROR, message.mission_type, sender, said)
        return self._say_busy(message, sender, now_s)

    def _refuse_changed(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        said = self._say("REJ. MISSION_REQUEST after _INT")
        return self._ack(wire.ERROR, message.mission_type, sender, said)

    def _refuse_list(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        if self.profile.busy_result == wire.DENIED:
            return self._ack(wire.DENIED, message.mission_type, sender)
        return self._say_busy(message, sender, now_s)

    def _refuse_type(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return self._ack(self.profile.type_result, message.mission_type, sender)

    def _refuse_space(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        mission_type = MissionType(message.mission_type)
        said = StatusText(
            mission_type, _WARNING, f"Only {self._store.capacity[mission_type]} items are supported"
        )
        return self._ack(wire.NO_SPACE, mission_type, sender, said)

    def _refuse_partial(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return self._ack(wire.ERROR, message.mission_type, sender)

    def _refuse_clear(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return self._ack(wire.UNSUPPORTED, message.mission_type, sender)

    def _clear(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        everything = message.mission_type == wire.ALL_TYPES
        kinds = tuple(MissionType) if everything else (MissionType(message.mission_type),)
        self._store.clear(kinds)
        self._session.ended = None
        return self._ack(wire.ACCEPTED, message.mission_type, sender, *(PlanCleared(kind) for kind in kinds))

    def _clear_by_count(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        self._session.held_until_s = now_s + self.profile.empty_hold_s
        self._session.type = MissionType(message.mission_type)
        return self._clear(message, sender, now_s) + Output(events=self._received())

    def _send_count(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        self._session.partner, self._session.type = sender, MissionType(message.mission_type)
        self._session.outgoing, self._session.next, self._session.heard_s = (
            self._store.wire_items(self._session.type),
            0,
            now_s,
        )
        self._session.asked_int = self._session.warned = False
        number = len(self._session.outgoing)
        reply = wire.count(sender, number, self._session.type, self._store.plan(self._session.type).opaque_id)
        return Output((reply,), (TransferStarted(self._session.type, upload=False, count=number),))

    def _send_item(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        mission_type = MissionType(message.mission_type)
        items = (
            self._session.outgoing if self._session.state is SENDING else self._store.wire_items(mission_type)
        )
        self._session.next = max(self._session.next, message.seq + 1)
        current = mission_type == MissionType.MISSION and message.seq == (
            self.current_sequence + self._store.home_items(mission_type)
        )
        asked_int = type(message).id == wire.REQUEST_INT
        self._session.asked_int |= asked_int
        integer = asked_int or not self.profile.float_answers
        item = items[message.seq]
        frame = frame_on_wire(item, self.profile, integer=integer)
        reply = wire.item_to_message(
            item, message.seq, mission_type, sender, current=current, integer=integer, frame=frame
        )
        text = "got MISSION_REQUEST; use MISSION_REQUEST_INT!"
        return Output((reply,), self._warn_of_floats(text, message, wire.REQUEST))

    def _answer_beyond(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        if self.profile.range_result is None:
            return NOTHING
        refused = self._ack(self.profile.range_result, message.mission_type, sender)
        if not self.profile.stateless_download:
            return refused
        number = len(self._store.wire_items(MissionType(message.mission_type)))
        return Output((wire.count(sender, number, message.mission_type),)) + refused

    def _refuse_request(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        said = self._say("REJ. request: no LIST before it")
        return self._ack(wire.ERROR, message.mission_type, sender, said)

    def _refuse_jump(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        said = self._say(f"REJ. request of {message.seq}: next is {self._session.next}")
        failed = self._fail(
            FailureReason.BROKEN, f"item {message.seq} was requested, {self._session.next} is next"
        )
        return self._ack(wire.ERROR, message.mission_type, sender, *failed, said)

    def _end_sent(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return Output(events=(PlanSent(self._session.type),))

    def _end_refused(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        text = f"the ground station answers: {wire.result_text(message.type)}"
        return Output(events=self._fail(FailureReason.REFUSED, text, message.type))

    def _end_cancelled(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return Output(events=self._fail(FailureReason.CANCELLED, "the ground station cancelled the transfer"))

    def _abort_upload(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        item = f"item {self._session.expected} of {self._session.count}"
        text = f"{item} did not come in {self.profile.abort_s:g} s"
        said = StatusText(self._session.type, _CRITICAL, self.profile.timeout_text)
        events = (*self._fail(FailureReason.TIMEOUT, text), said)
        if self.profile.abort_result is None:
            return Output(events=events)
        return self._ack(self.profile.abort_result, self._session.type, sender, *events)

    def _abort_download(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        if self._session.next >= len(self._session.outgoing):
            return Output(events=self._fail(FailureReason.TIMEOUT, "the last item was never confirmed"))
        text = f"item {self._session.next} was not requested in {self.profile.abort_s:g} s"
        said = StatusText(self._session.type, _CRITICAL, "Operation timeout")
        return Output(events=(*self._fail(FailureReason.TIMEOUT, text), said))

    # Helpers.

    def _fail(self, reason: FailureReason, text: str, result: int | None = None) -> tuple[Event, ...]:
        """End the transfer; a vehicle that overwrites in place now holds what has come, and the old rest."""
        failed = TransferFailed(self._session.type, reason, text, result)
        if self._session.state is not RECEIVING or self.profile.atomic or not self._session.items:
            self._session.items = []
            return (failed,)
        return (failed, self._put(self._merged(), complete=False))

    def _ack(self, result: int, mission_type: int, target: tuple[int, int], *events: Event) -> Output:
        plan = wire.plan_type(mission_type)
        opaque_id = self._store.plan(plan).opaque_id if plan is not None and result == wire.ACCEPTED else 0
        return Output((wire.ack(target, result, mission_type, opaque_id),), events)
