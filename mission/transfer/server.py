"""The vehicle's side of the mission protocol, sans-IO."""

# ruff: noqa: ARG002 - the actions of the transition table share one signature

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from mission.autopilots import PX4
from mission.autopilots.profile import Profile
from mission.link.codec.dialect import Message, mavlink
from mission.link.codec.typed import is_a
from mission.model import GeoPoint, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.events import (
    NOTHING,
    Event,
    FailureReason,
    Output,
    PlanCleared,
    PlanPart,
    PlanReplaced,
    PlanSent,
    StatusText,
    TransferFailed,
    TransferStarted,
)
from mission.transfer.server_session import EndedUpload, PlanStore, ServerInputs, StoredPlan, Validator
from mission.transfer.server_table import (
    IDLE,
    RECEIVING,
    SENDING,
    SERVER_TABLE,
    ServerInput,
    ServerState,
)
from mission.transfer.storage import as_read_back, frame_on_wire
from mission.transfer.wire import from_wire_order, to_wire_order

_I = ServerInput
_COMPONENTS = frozenset({0, mavlink.MAV_COMP_ID_MISSIONPLANNER})
_CRITICAL = mavlink.MAV_SEVERITY_CRITICAL
_WARNING = mavlink.MAV_SEVERITY_WARNING
_INFO = mavlink.MAV_SEVERITY_INFO
_Sender = tuple[int, int]


class _Refusal(NamedTuple):
    """An answer that changes nothing.

    ``result`` is the MAV_MISSION_RESULT to answer, None for no answer; ``text`` is said with it,
    ``silent_text`` where there is none.
    """

    result: Callable[[Profile], int | None]
    text: str = ""
    silent_text: str = ""
    prefixed: bool = True  # The text begins as the autopilot's texts about commands do


def _always(result: int) -> Callable[[Profile], int]:
    return lambda _: int(result)


def _where_denied(result: int) -> Callable[[Profile], int | None]:
    """Return the result for autopilots that deny messages while busy; the others only report busy."""
    return lambda profile: int(result) if profile.busy_result == wire.DENIED else None


_IGNORED = "IGN. CMD: Busy"
_REFUSALS = {
    "refuse busy": _Refusal(lambda profile: profile.busy_result, "REJ. CMD: Busy"),
    "refuse type": _Refusal(lambda profile: profile.type_result),
    "refuse partial": _Refusal(lambda profile: profile.partial_result),
    "refuse unexpected item": _Refusal(_always(wire.ERROR), "IGN MISSION_ITEM: No transfer", prefixed=False),
    "refuse item type": _Refusal(_always(wire.ERROR)),
    "refuse foreign item": _Refusal(_where_denied(wire.DENIED), silent_text=_IGNORED),
    "answer order": _Refusal(lambda profile: profile.order_result),
    "refuse list": _Refusal(_where_denied(wire.DENIED), silent_text=_IGNORED),
    "refuse request": _Refusal(_always(wire.ERROR), "REJ. request: no LIST before it"),
    "refuse request now": _Refusal(lambda profile: wire.DENIED if profile.stateless_download else None),
    "refuse changed": _Refusal(_always(wire.ERROR), "REJ. MISSION_REQUEST after _INT"),
    "refuse clear": _Refusal(_always(wire.UNSUPPORTED)),
    "refuse clear now": _Refusal(_where_denied(wire.ERROR), silent_text=_IGNORED),
    "say busy": _Refusal(lambda _: None, silent_text=_IGNORED),
}


class MissionServer(ServerInputs):
    """Stores the three plans of a vehicle and talks about them with ground stations.

    No socket and no clock: the owner feeds messages and the time, sends what comes out, and calls `poll` at
    `next_deadline`. Nothing that arrives raises. The rules are in `mission.transfer.server_table`: an action
    of it is a row of the refusals above, or the method of its name.

    Parameters
    ----------
    system_id, component_id : int
        The vehicle's ids; messages for others are ignored.
    profile : Profile
        Whose behaviour to follow: `PX4` (atomic, strict) or `ARDUPILOT` (in place, stateless download).
    capacity : mapping of MissionType to int, optional
        The most items per plan; default 65535.
    validator : callable, optional
        Validates each mission item by itself: returns a MAV_MISSION_RESULT, 0 to accept.
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
        super().__init__(profile, PlanStore(profile, capacity, home), validator)
        self.system_id = system_id
        self.component_id = component_id
        self.current_sequence = 0

    @property
    def home(self) -> GeoPoint | None:
        """Home, as profiles with a home item show it."""
        return self._store.home

    @home.setter
    def home(self, home: GeoPoint | None) -> None:
        self._store.home = home

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

    def live_plan(self, mission_type: MissionType) -> tuple[MissionItem, ...]:
        """Return what a vehicle that overwrites in place would fly now, in the middle of an upload too."""
        session = self._session
        if session.state is not RECEIVING or session.type is not mission_type or self.profile.atomic:
            return self._store.plan(mission_type).items
        return self._merged()

    def set_card(self, mission_type: MissionType, kib: float) -> None:
        """Take the room for a plan from the parameter of its card, as at a start of the vehicle."""
        self._store.capacity[mission_type] = self.profile.room(mission_type, kib)

    def count(self, mission_type: MissionType) -> int:
        """Return how many items a download has (with home, where the autopilot counts it)."""
        return len(self._store.wire_items(mission_type))

    def items_on_wire(self, mission_type: MissionType) -> list[mavlink.MAVLink_mission_item_int_message]:
        """Return the MISSION_ITEM_INT of all items of a plan, as a download has them, addressed to nobody."""
        items = []
        for seq, item in enumerate(self._store.wire_items(mission_type)):
            message = self._item_message(item, seq, mission_type, (0, 0), None, integer=True)
            assert is_a(message, mavlink.MAVLink_mission_item_int_message)
            items.append(message)
        return items

    def set_plan(self, mission_type: MissionType, items: Sequence[MissionItem]) -> StoredPlan:
        """Put a plan in force from inside the vehicle and return it with its id."""
        self._session.ended = None
        return self._store.put(mission_type, tuple(items))

    def receive(self, message: Message, now_s: float) -> Output:
        """Take one message; what is not a mission message for this vehicle is ignored."""
        if not wire.to_server(message):
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
            found = self._input_of(message, sender, now_s)
            if state is not IDLE and sender == self._session.partner:
                self._session.heard_s = now_s
            output = before + self._step(found, message, sender, now_s)
            if found is not _I.IMPLIED_END and found is not _I.ABANDONED:
                return output
            before = output

    def poll(self, now_s: float) -> Output:
        """Act on the timers that are due."""
        session = self._session
        if session.state is IDLE:
            return NOTHING
        if now_s >= session.heard_s + self.profile.abort_s:
            return self._step(_I.ABORT, None, session.partner, now_s)
        if session.state is RECEIVING and now_s >= session.asked_s + self.profile.re_request_s:
            return self._step(_I.RETRY, None, session.partner, now_s)
        return NOTHING

    def restart(self, now_s: float) -> Output:
        """Forget the transfer that runs, without a word: the vehicle starts again. The plans stay."""
        if self._session.state is IDLE:
            return NOTHING
        return Output((), self._step(_I.ABORT, None, self._session.partner, now_s).events)

    def next_deadline(self) -> float | None:
        """Time of the next `poll`; None if no transfer runs."""
        session = self._session
        if session.state is IDLE:
            return None
        abort_s = session.heard_s + self.profile.abort_s
        if session.state is not RECEIVING:
            return abort_s
        return min(abort_s, session.asked_s + self.profile.re_request_s)

    # The machinery.

    def _step(
        self, found: ServerInput, message: wire.MissionMessage | None, sender: _Sender, now_s: float
    ) -> Output:
        """Do what a row of the table says, then change the state.

        Each input belongs to messages of one kind only, so the message is what the action takes.
        """
        action, following = SERVER_TABLE[self._session.state, found]
        refusal = _REFUSALS.get(action)
        output: Output
        if refusal is not None:
            assert message is not None
            output = self._refuse(refusal, message, sender)
        else:
            output = getattr(self, "_" + action.replace(" ", "_"))(message, sender, now_s)
        self._session.state = following
        return output

    def _refuse(self, refusal: _Refusal, message: wire.MissionMessage, sender: _Sender) -> Output:
        result = refusal.result(self.profile)
        text = refusal.silent_text if result is None else refusal.text
        prefix = self.profile.text_prefix if refusal.prefixed else ""
        said = (self._status(prefix + text),) if text else ()
        if result is None:
            return Output(events=said)
        return self._answer(result, message.mission_type, sender, *said)

    def _answer(self, result: int, mission_type: int, target: _Sender, *events: Event) -> Output:
        """A MISSION_ACK, with the plan's id where it is accepted."""
        plan = wire.plan_type(mission_type)
        opaque_id = self._store.plan(plan).opaque_id if plan is not None and result == wire.ACCEPTED else 0
        return Output((wire.ack(target, result, mission_type, opaque_id),), events)

    def _status(self, text: str) -> StatusText:
        return StatusText(self._session.type, _WARNING, text)

    def _warn_of_floats(
        self, text: str, message: wire.ItemMessage | wire.RequestMessage, old: int
    ) -> tuple[Event, ...]:
        """ArduPilot complains once a transfer about messages of the old kind ``old``."""
        if self._session.warned or type(message).id != old or not self.profile.stateless_download:
            return ()
        self._session.warned = True
        return (StatusText(self._session.type, _WARNING, text),)

    def _failed(self, reason: FailureReason, text: str, result: int | None = None) -> TransferFailed:
        return TransferFailed(self._session.type, reason, text, result)

    def _ignore(self, message: Any, sender: _Sender, now_s: float) -> Output:
        return NOTHING

    # A plan comes.

    def _ask_first(self, message: wire.CountMessage, sender: _Sender, now_s: float) -> Output:
        """Begin the upload of a whole plan; a vehicle that overwrites in place forgets what is beyond it."""
        session, before = self._session, self._kept()
        session.partner, session.type = sender, MissionType(message.mission_type)
        session.count = message.count
        if not self.profile.atomic and message.count < len(self._store.wire_items(session.type)):
            session.items, session.first, session.part = [], 0, False
            self._store.put(session.type, self._merged())
            session.cut = True
            before = (*before, PlanPart(session.type))
        return Output(events=before) + self._begin(0, now_s, part=False)

    def _ask_part(
        self, message: mavlink.MAVLink_mission_write_partial_list_message, sender: _Sender, now_s: float
    ) -> Output:
        """Begin the upload of a part of the plan."""
        self._session.partner, self._session.type = sender, MissionType(message.mission_type)
        self._session.count = message.end_index + 1
        return self._begin(message.start_index, now_s, part=True)

    def _begin(self, first: int, now_s: float, *, part: bool) -> Output:
        session = self._session
        session.items, session.start, session.ended = [], None, None
        session.first, session.part, session.warned = first, part, False
        session.heard_s = now_s
        started = TransferStarted(session.type, upload=True, count=session.count - first)
        return self._ask(now_s) + Output(events=(started,))

    def _ask(self, now_s: float) -> Output:
        """Ask for the item that is expected."""
        session = self._session
        session.asked_s = now_s
        build = (
            mavlink.MAVLink_mission_request_int_message
            if self.profile.request_int
            else mavlink.MAVLink_mission_request_message
        )
        return Output((build(*session.partner, session.expected, session.type),))

    def _ask_again(self, message: None, sender: _Sender, now_s: float) -> Output:
        return self._ask(now_s)

    def _take_item(self, message: wire.ItemMessage, sender: _Sender, now_s: float) -> Output:
        """Keep the item and ask for the next one."""
        said = self._keep(message)
        part = () if self.profile.atomic else (PlanPart(self._session.type),)
        return self._ask(now_s) + Output(events=(*said, *part))

    def _take_last_item(self, message: wire.ItemMessage, sender: _Sender, now_s: float) -> Output:
        """Keep the item and put the plan in force."""
        session = self._session
        said = self._keep(message)
        last = session.candidate if message.seq or not self._store.home_items(session.type) else None
        session.ended = EndedUpload(sender, session.type, message.seq, last, wire.ACCEPTED)
        replaced = self._put(self._merged(), start=session.start)
        return self._answer(wire.ACCEPTED, session.type, sender, replaced, *said, *self._received())

    def _keep(self, message: wire.ItemMessage) -> tuple[Event, ...]:
        """Keep the item that was validated; ArduPilot complains once about items of the old kind."""
        session = self._session
        assert session.candidate is not None
        own = message.seq - self._store.home_items(session.type)
        if message.current and own >= 0:
            session.start = own
        session.items.append(session.candidate)
        return self._warn_of_floats("got MISSION_ITEM; GCS should send MISSION_ITEM_INT", message, wire.ITEM)

    def _refuse_item(self, message: wire.ItemMessage, sender: _Sender, now_s: float) -> Output:
        """End the upload with the verdict on the item."""
        session = self._session
        session.ended = EndedUpload(sender, session.type, message.seq, None, session.verdict)
        text = f"item {message.seq}: {wire.result_text(session.verdict)}"
        failed = self._given_up(FailureReason.REFUSED, text, session.verdict)
        told = None if session.verdict == wire.ERROR else self.profile.item_text
        said = () if told is None else (StatusText(session.type, _CRITICAL, told),)
        return self._answer(session.verdict, session.type, sender, *failed, *said)

    def _repeat_ack(self, message: wire.ItemMessage, sender: _Sender, now_s: float) -> Output:
        """The answer to the last upload, once more."""
        ended = self._session.ended
        assert ended is not None
        return self._answer(ended.result, ended.mission_type, ended.sender)

    def _refuse_space(self, message: wire.CountMessage, sender: _Sender, now_s: float) -> Output:
        mission_type, text = MissionType(message.mission_type), self.profile.space_text
        room = self._store.room(mission_type)
        said = () if text is None else (StatusText(mission_type, _WARNING, text.format(room)),)
        return self._answer(wire.NO_SPACE, mission_type, sender, *said)

    def _clear(self, message: wire.MissionMessage, sender: _Sender, now_s: float) -> Output:
        """Empty one plan or all."""
        everything = message.mission_type == wire.ALL_TYPES
        kinds = tuple(MissionType) if everything else (MissionType(message.mission_type),)
        self._store.clear(kinds)
        self._session.ended = None
        cleared = (PlanCleared(kind) for kind in kinds)
        return self._answer(wire.ACCEPTED, message.mission_type, sender, *cleared)

    def _clear_by_count(self, message: wire.CountMessage, sender: _Sender, now_s: float) -> Output:
        """Empty a plan: a COUNT of 0."""
        self._session.held_until_s = now_s + self.profile.empty_hold_s
        self._session.type = MissionType(message.mission_type)
        return self._clear(message, sender, now_s) + Output(events=self._received())

    def _end_cancelled(self, message: Any, sender: _Sender, now_s: float) -> Output:
        """End the transfer, an upload or a download, for the ground station wants no more of it."""
        text = "the ground station cancelled the transfer"
        return Output(events=self._given_up(FailureReason.CANCELLED, text))

    def _abort_upload(self, message: None, sender: _Sender, now_s: float) -> Output:
        """End the upload, for nothing comes any more."""
        session = self._session
        item = f"item {session.expected} of {session.count}"
        text = f"{item} did not come in {self.profile.abort_s:g} s"
        said = StatusText(session.type, _CRITICAL, self.profile.timeout_text)
        events = (*self._given_up(FailureReason.TIMEOUT, text), said)
        if self.profile.abort_result is None:
            return Output(events=events)
        return self._answer(self.profile.abort_result, session.type, sender, *events)

    def _received(self) -> tuple[Event, ...]:
        texts = self.profile.received_texts
        return () if texts is None else (StatusText(self._session.type, _INFO, texts[self._session.type]),)

    def _merged(self) -> tuple[MissionItem, ...]:
        """Return the plan after what has come: the whole new one, or the old one with a part replaced."""
        session = self._session
        came = tuple(session.items)
        if session.first or session.part or len(came) < session.count:
            old = self._store.wire_items(session.type)
            if not old and came:
                old = to_wire_order(came[:1], session.type, self.profile, self._store.home)[:1]
            end = len(old) if session.part else session.count
            came = old[: session.first] + came + old[session.first + len(came) : end]
        return from_wire_order(came, session.type, self.profile)[0]

    def _put(
        self, items: tuple[MissionItem, ...], *, start: int | None = None, complete: bool = True
    ) -> Event:
        session = self._session
        plan, changed = self._store.received(session.type, items)
        changed |= session.cut
        session.items, session.cut = [], False
        return PlanReplaced(session.type, items, plan.opaque_id, changed, start, complete)

    def _given_up(self, reason: FailureReason, text: str, result: int | None = None) -> tuple[Event, ...]:
        """End the transfer; a vehicle that overwrites in place now holds what has come, and the old rest."""
        failed, kept = self._failed(reason, text, result), self._kept()
        self._session.items = []
        return (failed, *kept)

    def _kept(self) -> tuple[Event, ...]:
        """Put in force what has come of an upload that is given up, where it overwrites in place."""
        session = self._session
        came = session.items or session.cut
        if session.state is not RECEIVING or self.profile.atomic or not came:
            return ()
        return (self._put(self._merged(), complete=False),)

    # A plan goes.

    def _send_count(self, message: wire.MissionMessage, sender: _Sender, now_s: float) -> Output:
        """Begin the download."""
        session = self._session
        session.partner, session.type = sender, MissionType(message.mission_type)
        session.outgoing, session.next, session.heard_s = self._store.wire_items(session.type), 0, now_s
        session.asked_int = session.warned = False
        number = len(session.outgoing)
        reply = wire.count(sender, number, session.type, self._store.plan(session.type).opaque_id)
        return Output((reply,), (TransferStarted(session.type, upload=False, count=number),))

    def _send_item(self, message: wire.RequestMessage, sender: _Sender, now_s: float) -> Output:
        """Send the item that is asked for, marked where it is the current one."""
        session = self._session
        mission_type = MissionType(message.mission_type)
        items = session.outgoing if session.state is SENDING else self._store.wire_items(mission_type)
        session.next = max(session.next, message.seq + 1)
        asked_int = type(message).id == wire.REQUEST_INT
        session.asked_int |= asked_int
        integer = asked_int or not self.profile.float_answers
        current = self.current_sequence + self._store.home_items(mission_type)
        item = items[message.seq]
        reply = self._item_message(item, message.seq, mission_type, sender, current, integer=integer)
        said = self._warn_of_floats("got MISSION_REQUEST; use MISSION_REQUEST_INT!", message, wire.REQUEST)
        return Output((reply,), said)

    def _item_message(
        self,
        item: MissionItem,
        seq: int,
        mission_type: MissionType,
        target: _Sender,
        current: int | None,
        *,
        integer: bool,
    ) -> wire.ItemMessage:
        """Return an item as it is read back; ``current`` is the number of the one that is marked."""
        item = as_read_back(item, self.profile)
        marked = self.profile.marks_current and mission_type == MissionType.MISSION and seq == current
        frame = frame_on_wire(item, self.profile, integer=integer)
        return wire.item_to_message(
            item, seq, mission_type, target, current=marked, integer=integer, frame=frame
        )

    def _answer_beyond(self, message: wire.RequestMessage, sender: _Sender, now_s: float) -> Output:
        """Answer a request for an item that the plan does not have."""
        if self.profile.range_result is None:
            return NOTHING
        refused = self._answer(self.profile.range_result, message.mission_type, sender)
        if not self.profile.stateless_download:
            return refused
        number = self.count(MissionType(message.mission_type))
        return Output((wire.count(sender, number, message.mission_type),)) + refused

    def _refuse_jump(self, message: wire.RequestMessage, sender: _Sender, now_s: float) -> Output:
        """End the download: an item was asked for before the one that comes next."""
        following = self._session.next
        said = self._status(self.profile.text_prefix + f"REJ. request of {message.seq}: next is {following}")
        text = f"item {message.seq} was requested, {following} is next"
        failed = self._failed(FailureReason.BROKEN, text)
        return self._answer(wire.ERROR, message.mission_type, sender, failed, said)

    def _end_sent(self, message: Any, sender: _Sender, now_s: float) -> Output:
        return Output(events=(PlanSent(self._session.type),))

    def _end_refused(self, message: wire.AckMessage, sender: _Sender, now_s: float) -> Output:
        """End the download, for the ground station refuses it."""
        text = f"the ground station answers: {wire.result_text(message.type)}"
        return Output(events=(self._failed(FailureReason.REFUSED, text, message.type),))

    def _abort_download(self, message: None, sender: _Sender, now_s: float) -> Output:
        """End the download, for nothing is asked for any more."""
        session = self._session
        if session.all_sent:
            return Output(events=(self._failed(FailureReason.TIMEOUT, "the last item was never confirmed"),))
        text = f"item {session.next} was not requested in {self.profile.abort_s:g} s"
        said = StatusText(session.type, _CRITICAL, "Operation timeout")
        return Output(events=(self._failed(FailureReason.TIMEOUT, text), said))
