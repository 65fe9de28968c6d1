"""Mission server: the vehicle's side of the mission protocol, sans-IO."""

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
from mission.transfer.remarks import zone_problems
from mission.transfer.server_session import (
    IDLE,
    RECEIVING,
    SENDING,
    SERVER_TABLE,
    PlanStore,
    ServerInput,
    ServerInputs,
    ServerState,
    StoredPlan,
    Validator,
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
    """Refusal of a message: an ACK or a STATUSTEXT, without any other effect.

    ``result`` returns the MAV_MISSION_RESULT to send, or None for no ACK. ``text`` is the STATUSTEXT sent
    with the ACK, ``silent_text`` the STATUSTEXT sent without an ACK; ArduPilot sends no text.
    """

    result: Callable[[Profile], int | None]
    text: str = ""
    silent_text: str = ""
    prefixed: bool = True  # whether the text begins with the autopilot's prefix (`Profile.text_prefix`)
    severity: int = _CRITICAL


def _always(result: int) -> Callable[[Profile], int]:
    return lambda _: int(result)


def _where_denied(result: int) -> Callable[[Profile], int | None]:
    """Return ``result`` if the autopilot sends DENIED while busy; None if it sends a STATUSTEXT instead."""
    return lambda profile: int(result) if profile.busy_result == wire.DENIED else None


_FOREIGN_ITEM = "REJ. MIS ITEM: partner id mismatch"
_IGNORED_LIST = "Mission download request ignored, already active"
_REFUSALS = {
    "refuse busy": _Refusal(lambda profile: profile.busy_result, "REJ. CMD: Busy"),
    "refuse type": _Refusal(lambda profile: profile.type_result),
    "refuse partial": _Refusal(lambda profile: profile.partial_result),
    "refuse count now": _Refusal(lambda profile: profile.busy_result, "IGN MISSION_COUNT: Busy"),
    "refuse unexpected item": _Refusal(_always(wire.ERROR), "IGN MISSION_ITEM: No transfer", prefixed=False),
    "refuse item now": _Refusal(_always(wire.ERROR), "IGN MISSION_ITEM: Busy", prefixed=False),
    "refuse item type": _Refusal(_always(wire.ERROR)),
    "refuse new item": _Refusal(_where_denied(wire.ERROR), silent_text=_FOREIGN_ITEM, prefixed=False),
    "refuse foreign item": _Refusal(_where_denied(wire.DENIED), silent_text=_FOREIGN_ITEM, prefixed=False),
    "answer order": _Refusal(lambda profile: profile.order_result),
    "refuse list": _Refusal(
        _where_denied(wire.DENIED), silent_text=_IGNORED_LIST, prefixed=False, severity=_INFO
    ),
    "refuse request now": _Refusal(_where_denied(wire.DENIED), silent_text="REJ. CMD: Busy"),
    "refuse foreign request": _Refusal(
        _where_denied(wire.DENIED), silent_text="REJ. CMD: partner id mismatch"
    ),
    "refuse changed": _Refusal(_always(wire.ERROR), "REJ. MISSION_REQUEST after _INT"),
    "refuse clear": _Refusal(_always(wire.UNSUPPORTED)),
    "refuse clear now": _Refusal(_where_denied(wire.ERROR), silent_text="IGN CLEAR CMD: Busy"),
}


class MissionServer(ServerInputs):
    """Mission server of a vehicle: stores its three plans, and transfers them from and to ground stations.

    The server has no socket and no clock. The owner passes messages and the time, sends the messages of each
    output, and calls `poll` at `next_deadline`. The server raises no error for any message. The rules are in
    `mission.transfer.server_session`; each action is a row of ``_REFUSALS`` or a method of the same name.

    Parameters
    ----------
    system_id, component_id : int
        Ids of the vehicle. Messages for other targets are ignored.
    profile : Profile
        Autopilot to simulate: `PX4` (atomic, strict) or `ARDUPILOT` (in place, stateless download).
    capacity : mapping of MissionType to int, optional
        Largest number of items per plan. Default: the capacity in the profile.
    validator : callable, optional
        Returns a MAV_MISSION_RESULT for each mission item, 0 to accept.
    home : GeoPoint, optional
        Home position; item 0 of downloads if the profile has a home item. Assign `home` if it changes.

    Attributes
    ----------
    current_sequence : int
        Item marked as current in downloads.
    locked : bool
        Whether clearing the mission is refused (ArduPilot while flying the mission).

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
        """Home position; it is item 0 of downloads if the profile has a home item."""
        return self._store.home

    @home.setter
    def home(self, home: GeoPoint | None) -> None:
        self._store.home = home

    @property
    def state(self) -> ServerState:
        """State of the server."""
        return self._session.state

    @property
    def busy(self) -> bool:
        """Whether items are still to come; a download may end without an ACK, as MAVProxy's do."""
        session = self._session
        return session.state is RECEIVING or (session.state is SENDING and not session.all_sent)

    def plan(self, mission_type: MissionType) -> StoredPlan:
        """Return the stored plan without home."""
        return self._store.plan(mission_type)

    def live_plan(self, mission_type: MissionType) -> tuple[MissionItem, ...]:
        """Return the plan that the vehicle would fly now, with received items that are already in effect."""
        session = self._session
        if session.state is not RECEIVING or session.type is not mission_type or self.profile.atomic:
            return self._store.plan(mission_type).items
        return self._merged()

    def set_card(self, mission_type: MissionType, kib: float) -> None:
        """Set the capacity of a plan from the storage size parameter (KiB), as the vehicle does at boot."""
        self._store.capacity[mission_type] = self.profile.room(mission_type, kib)

    def count(self, mission_type: MissionType) -> int:
        """Return the number of items of a download, with the home item if the profile has one."""
        return len(self._store.wire_items(mission_type))

    def items_on_wire(self, mission_type: MissionType) -> list[mavlink.MAVLink_mission_item_int_message]:
        """Return the MISSION_ITEM_INT messages of a download, with target 0, 0."""
        items = []
        for seq, item in enumerate(self._store.wire_items(mission_type)):
            message = self._item_message(item, seq, mission_type, (0, 0), None, integer=True)
            assert is_a(message, mavlink.MAVLink_mission_item_int_message)
            items.append(message)
        return items

    def set_plan(self, mission_type: MissionType, items: Sequence[MissionItem]) -> StoredPlan:
        """Store a plan without a transfer; return the plan with its id."""
        self._session.ended = None
        return self._store.put(mission_type, tuple(items))

    def receive(self, message: Message, now_s: float) -> Output:
        """Handle one message; ignore messages that are not mission messages for this vehicle."""
        if not wire.to_server(message):
            return NOTHING
        if message.target_system not in (self.system_id, 0):
            return NOTHING
        own = message.target_component in (self.component_id, *_COMPONENTS)
        if not own and not self.profile.answers_unheard:
            return NOTHING
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if sender[0] == 0:  # an ACK to system 0 is a broadcast and would end the transfers of other stations
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
        """Handle the timers that are due."""
        session = self._session
        if session.state is IDLE:
            return NOTHING
        if now_s >= session.heard_s + self.profile.abort_s:
            return self._step(_I.ABORT, None, session.partner, now_s)
        if session.state is RECEIVING and now_s >= session.asked_s + self.profile.re_request_s:
            return self._step(_I.RETRY, None, session.partner, now_s)
        return NOTHING

    def restart(self, now_s: float) -> Output:
        """End the transfer in progress without a message, as at a reboot of the vehicle; the plans remain."""
        if self._session.state is IDLE:
            return NOTHING
        return Output((), self._step(_I.ABORT, None, self._session.partner, now_s).events)

    def next_deadline(self) -> float | None:
        """Return the time of the next `poll`, or None without a transfer in progress."""
        session = self._session
        if session.state is IDLE:
            return None
        abort_s = session.heard_s + self.profile.abort_s
        if session.state is not RECEIVING:
            return abort_s
        return min(abort_s, session.asked_s + self.profile.re_request_s)

    def _step(
        self, found: ServerInput, message: wire.MissionMessage | None, sender: _Sender, now_s: float
    ) -> Output:
        """Run the action of a row of the transition table and change the state.

        Each input has one message type (None for timers), so ``message`` has the type the action expects.
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
        text, prefix = refusal.silent_text if result is None else refusal.text, self.profile.text_prefix
        said: tuple[Event, ...] = ()
        if text and prefix is not None:
            said = (StatusText(self._session.type, refusal.severity, prefix * refusal.prefixed + text),)
        if result is None:
            return Output(events=said)
        return self._answer(result, message.mission_type, sender, *said)

    def _answer(self, result: int, mission_type: int, target: _Sender, *events: Event) -> Output:
        """Return a MISSION_ACK, with the plan id if accepted."""
        plan = wire.plan_type(mission_type)
        opaque_id = self._store.plan(plan).opaque_id if plan is not None and result == wire.ACCEPTED else 0
        return Output((wire.ack(target, result, mission_type, opaque_id),), events)

    def _status(self, text: str) -> StatusText:
        return StatusText(self._session.type, _WARNING, text)

    def _warn_of_floats(
        self, text: str, message: wire.ItemMessage | wire.RequestMessage, old: int
    ) -> tuple[Event, ...]:
        """Return ArduPilot's warning (once per transfer) if the message is of the deprecated type ``old``."""
        if self._session.warned or type(message).id != old or not self.profile.stateless_download:
            return ()
        self._session.warned = True
        return (StatusText(self._session.type, _WARNING, text),)

    def _failed(self, reason: FailureReason, text: str, result: int | None = None) -> TransferFailed:
        return TransferFailed(self._session.type, reason, text, result)

    def _ignore(self, message: Any, sender: _Sender, now_s: float) -> Output:
        return NOTHING

    # Uploads.

    @property
    def _in_place(self) -> bool:
        """Whether received items replace old items at once; ArduPilot replaces a fence as a whole."""
        return not self.profile.atomic and self._session.type is not MissionType.FENCE

    def _ask_first(self, message: wire.CountMessage, sender: _Sender, now_s: float) -> Output:
        """Start the upload of a whole plan; a vehicle that overwrites in place truncates its old plan."""
        session, before = self._session, self._kept()
        session.partner, session.type = sender, MissionType(message.mission_type)
        session.count = message.count
        if self._in_place and message.count < len(self._store.wire_items(session.type)):
            session.items, session.first, session.part = [], 0, False
            self._store.put(session.type, self._merged())
            session.cut = True
            before = (*before, PlanPart(session.type))
        return Output(events=before) + self._begin(0, now_s, part=False)

    def _ask_part(
        self, message: mavlink.MAVLink_mission_write_partial_list_message, sender: _Sender, now_s: float
    ) -> Output:
        """Start a partial upload."""
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
        """Request the expected item."""
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
        """Store the item and request the next item."""
        said = self._keep(message)
        part = (PlanPart(self._session.type),) if self._in_place else ()
        return self._ask(now_s) + Output(events=(*said, *part))

    def _take_last_item(self, message: wire.ItemMessage, sender: _Sender, now_s: float) -> Output:
        """Store the last item and activate the plan."""
        session = self._session
        said, plan = self._keep(message), self._merged()
        is_fence = session.type is MissionType.FENCE
        if is_fence and not self.profile.atomic and zone_problems(plan, self.profile):
            session.verdict, text = int(wire.ERROR), self._status("Fence validation failed")
            return self._refuse_item(message, sender, now_s) + Output(events=(text,))
        session.ended = message.seq
        replaced = self._put(plan, start=session.start)
        return self._answer(wire.ACCEPTED, session.type, sender, replaced, *said, *self._received())

    def _keep(self, message: wire.ItemMessage) -> tuple[Event, ...]:
        """Store the validated item; return ArduPilot's warning about MISSION_ITEM, if any."""
        session = self._session
        assert session.candidate is not None
        own = message.seq - self._store.home_items(session.type)
        if message.current and own >= 0:
            session.start = own
        session.items.append(session.candidate)
        return self._warn_of_floats("got MISSION_ITEM; GCS should send MISSION_ITEM_INT", message, wire.ITEM)

    def _refuse_item(self, message: wire.ItemMessage, sender: _Sender, now_s: float) -> Output:
        """End the upload with the MAV_MISSION_RESULT of the item."""
        session = self._session
        session.ended = None
        text = f"item {message.seq}: {wire.result_text(session.verdict)}"
        failed = self._given_up(FailureReason.REFUSED, text, session.verdict)
        item_text = None if session.verdict == wire.ERROR else self.profile.item_text
        said = () if item_text is None else (StatusText(session.type, _CRITICAL, item_text),)
        return self._answer(session.verdict, session.type, sender, *failed, *said)

    def _repeat_ack(self, message: wire.ItemMessage, sender: _Sender, now_s: float) -> Output:
        """Repeat the final ACK of the last upload."""
        return self._answer(wire.ACCEPTED, self._session.type, sender)

    def _refuse_space(self, message: wire.CountMessage, sender: _Sender, now_s: float) -> Output:
        mission_type, text = MissionType(message.mission_type), self.profile.space_text
        room = self._store.room(mission_type)
        said = () if text is None else (StatusText(mission_type, _WARNING, text.format(room)),)
        return self._answer(wire.NO_SPACE, mission_type, sender, *said)

    def _clear(self, message: wire.MissionMessage, sender: _Sender, now_s: float) -> Output:
        """Clear one plan or all plans."""
        everything = message.mission_type == wire.ALL_TYPES
        kinds = tuple(MissionType) if everything else (MissionType(message.mission_type),)
        self._store.clear(kinds)
        self._session.ended = None
        cleared = (PlanCleared(kind) for kind in kinds)
        return self._answer(wire.ACCEPTED, message.mission_type, sender, *cleared)

    def _clear_by_count(self, message: wire.CountMessage, sender: _Sender, now_s: float) -> Output:
        """Clear a plan after a COUNT of 0."""
        self._session.held_until_s = now_s + self.profile.empty_hold_s
        self._session.type = MissionType(message.mission_type)
        return self._clear(message, sender, now_s) + Output(events=self._received())

    def _end_cancelled(self, message: Any, sender: _Sender, now_s: float) -> Output:
        """End a transfer that the ground station cancelled."""
        text = "the ground station cancelled the transfer"
        return Output(events=self._given_up(FailureReason.CANCELLED, text))

    def _abort_upload(self, message: None, sender: _Sender, now_s: float) -> Output:
        """End the upload after a timeout."""
        session = self._session
        item = f"item {session.expected} of {session.count}"
        text = f"{item} did not arrive within {self.profile.abort_s:g} s"
        said = StatusText(session.type, _CRITICAL, self.profile.timeout_text)
        events = (*self._given_up(FailureReason.TIMEOUT, text), said)
        if self.profile.abort_result is None:
            return Output(events=events)
        return self._answer(self.profile.abort_result, session.type, sender, *events)

    def _received(self) -> tuple[Event, ...]:
        texts = self.profile.received_texts
        return () if texts is None else (StatusText(self._session.type, _INFO, texts[self._session.type]),)

    def _merged(self) -> tuple[MissionItem, ...]:
        """Return the stored plan with the received items in place of the old items with the same numbers."""
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
        """Return the events of a failed transfer.

        A vehicle that overwrites in place keeps the received items.
        """
        failed, kept = self._failed(reason, text, result), self._kept()
        self._session.items = []
        return (failed, *kept)

    def _kept(self) -> tuple[Event, ...]:
        """Store the received items of an aborted upload on a vehicle that overwrites in place."""
        session = self._session
        came = session.items or session.cut
        if session.state is not RECEIVING or not self._in_place or not came:
            return ()
        return (self._put(self._merged(), complete=False),)

    # Downloads.

    def _send_count(self, message: wire.MissionMessage, sender: _Sender, now_s: float) -> Output:
        """Start the download."""
        session = self._session
        session.partner, session.type = sender, MissionType(message.mission_type)
        session.outgoing, session.next, session.heard_s = self._store.wire_items(session.type), 0, now_s
        session.asked_int = session.warned = False
        number = len(session.outgoing)
        reply = wire.count(sender, number, session.type, self._store.plan(session.type).opaque_id)
        return Output((reply,), (TransferStarted(session.type, upload=False, count=number),))

    def _send_item(self, message: wire.RequestMessage, sender: _Sender, now_s: float) -> Output:
        """Send the requested item, marked if it is the current item."""
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
        """Return the message of an item in a download; ``current`` is the number of the marked item."""
        item = as_read_back(item, self.profile)
        marked = self.profile.marks_current and mission_type == MissionType.MISSION and seq == current
        frame = frame_on_wire(item, self.profile, integer=integer)
        return wire.item_to_message(
            item, seq, mission_type, target, current=marked, integer=integer, frame=frame
        )

    def _answer_beyond(self, message: wire.RequestMessage, sender: _Sender, now_s: float) -> Output:
        """Refuse a request for an item beyond the end of the plan; a mission's count comes first."""
        refused = self._answer(self.profile.range_result, message.mission_type, sender)
        if message.mission_type != MissionType.MISSION:
            return refused
        return Output((wire.count(sender, self.count(MissionType.MISSION), MissionType.MISSION),)) + refused

    def _refuse_jump(self, message: wire.RequestMessage, sender: _Sender, now_s: float) -> Output:
        """End the download, because the request is not for the next item or the last one sent."""
        text = f"item {message.seq} was requested, but item {self._session.next} is next"
        failed = self._failed(FailureReason.BROKEN, text)
        refusal = _Refusal(_always(wire.ERROR), "REJ. CMD: Req. WP was unexpected")
        return self._refuse(refusal, message, sender) + Output(events=(failed,))

    def _end_sent(self, message: Any, sender: _Sender, now_s: float) -> Output:
        return Output(events=(PlanSent(self._session.type),))

    def _end_refused(self, message: wire.AckMessage, sender: _Sender, now_s: float) -> Output:
        """End the download, because the ground station sent an error ACK."""
        text = f"the ground station answers: {wire.result_text(message.type)}"
        return Output(events=(self._failed(FailureReason.REFUSED, text, message.type),))

    def _abort_download(self, message: None, sender: _Sender, now_s: float) -> Output:
        """End the download after a timeout."""
        session = self._session
        if session.all_sent:
            return Output(events=(self._failed(FailureReason.TIMEOUT, "the last item was never confirmed"),))
        text = f"item {session.next} was not requested within {self.profile.abort_s:g} s"
        said = StatusText(session.type, _CRITICAL, "Operation timeout")
        return Output(events=(self._failed(FailureReason.TIMEOUT, text), said))
