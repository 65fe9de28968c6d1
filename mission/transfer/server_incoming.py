"""The vehicle's side of a transfer: asking for items, taking and keeping them; sending them."""

from __future__ import annotations

from mission.autopilots.profile import Profile
from mission.link.codec.dialect import mavlink
from mission.link.codec.typed import is_a
from mission.model import MissionItem, MissionType
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
from mission.transfer.plan_store import PlanStore
from mission.transfer.server_session import EndedUpload, ServerReplies, ServerSession
from mission.transfer.server_table import RECEIVING, SENDING
from mission.transfer.storage import as_read_back, frame_on_wire
from mission.transfer.wire import from_wire_order, to_wire_order

_CRITICAL = mavlink.MAV_SEVERITY_CRITICAL
_INFO = mavlink.MAV_SEVERITY_INFO
_Sender = tuple[int, int]


class _PlanOnWire:
    """One way of a plan.

    Parameters
    ----------
    profile : Profile
        Whose habits to follow.
    store : PlanStore
        Where the plan goes, or comes from.
    session : ServerSession
        The transfer that runs; the fields of this way are written here.
    replies : ServerReplies
        How to answer.
    """

    def __init__(
        self, profile: Profile, store: PlanStore, session: ServerSession, replies: ServerReplies
    ) -> None:
        self._profile = profile
        self._store = store
        self._session = session
        self._replies = replies


class IncomingPlan(_PlanOnWire):
    """Receives a plan and puts it in force."""

    def ask_first(self, message: wire.CountMessage, sender: _Sender, now_s: float) -> Output:
        """Begin the upload of a whole plan; a vehicle that overwrites in place forgets what is beyond it."""
        session, before = self._session, self._kept()
        session.partner, session.type, session.count = (
            sender,
            MissionType(message.mission_type),
            message.count,
        )
        if not self._profile.atomic and message.count < len(self._store.wire_items(session.type)):
            session.items, session.first, session.part = [], 0, False
            self._store.put(session.type, self._merged())
            session.cut = True
            before = (*before, PlanPart(session.type))
        return Output(events=before) + self._begin(0, now_s)

    def ask_part(
        self, message: mavlink.MAVLink_mission_write_partial_list_message, sender: _Sender, now_s: float
    ) -> Output:
        """Begin the upload of a part of the plan."""
        self._session.partner, self._session.type = sender, MissionType(message.mission_type)
        self._session.count = message.end_index + 1
        return self._begin(message.start_index, now_s, part=True)

    def _begin(self, first: int, now_s: float, *, part: bool = False) -> Output:
        session = self._session
        session.items, session.start, session.ended = [], None, None
        session.first, session.part, session.warned = first, part, False
        session.heard_s = now_s
        started = TransferStarted(session.type, upload=True, count=session.count - first)
        return self.ask(now_s) + Output(events=(started,))

    def ask(self, now_s: float) -> Output:
        """Ask for the item that is expected."""
        session = self._session
        session.asked_s = now_s
        build = (
            mavlink.MAVLink_mission_request_int_message
            if self._profile.request_int
            else mavlink.MAVLink_mission_request_message
        )
        return Output((build(*session.partner, session.expected, session.type),))

    def take_item(self, message: wire.ItemMessage, now_s: float) -> Output:
        """Keep the item and ask for the next one."""
        said = self._take(message)
        part = () if self._profile.atomic else (PlanPart(self._session.type),)
        return self.ask(now_s) + Output(events=(*said, *part))

    def take_last_item(self, message: wire.ItemMessage, sender: _Sender) -> Output:
        """Keep the item and put the plan in force."""
        session = self._session
        said = self._take(message)
        last = session.candidate if message.seq or not self._store.home_items(session.type) else None
        session.ended = EndedUpload(sender, session.type, message.seq, last, wire.ACCEPTED)
        replaced = self._put(self._merged(), start=session.start)
        return self._replies.ack(wire.ACCEPTED, session.type, sender, replaced, *said, *self._received())

    def _take(self, message: wire.ItemMessage) -> tuple[Event, ...]:
        """Keep the item that was judged; ArduPilot complains once about items of the old kind."""
        session = self._session
        assert session.candidate is not None
        if message.current and message.seq >= self._store.home_items(session.type):
            session.start = message.seq - self._store.home_items(session.type)
        session.items.append(session.candidate)
        text = "got MISSION_ITEM; GCS should send MISSION_ITEM_INT"
        return self._replies.warn_of_floats(text, message, wire.ITEM)

    def refuse_item(self, message: wire.ItemMessage, sender: _Sender) -> Output:
        """End the upload with the verdict on the item."""
        session = self._session
        session.ended = EndedUpload(sender, session.type, message.seq, None, session.verdict)
        text = f"item {message.seq}: {wire.result_text(session.verdict)}"
        failed = self._fail(FailureReason.REFUSED, text, session.verdict)
        told = None if session.verdict == wire.ERROR else self._profile.item_text
        said = () if told is None else (StatusText(session.type, _CRITICAL, told),)
        return self._replies.ack(session.verdict, session.type, sender, *failed, *said)

    def clear(self, message: wire.MissionMessage, sender: _Sender) -> Output:
        """Empty one plan or all."""
        everything = message.mission_type == wire.ALL_TYPES
        kinds = tuple(MissionType) if everything else (MissionType(message.mission_type),)
        self._store.clear(kinds)
        self._session.ended = None
        cleared = (PlanCleared(kind) for kind in kinds)
        return self._replies.ack(wire.ACCEPTED, message.mission_type, sender, *cleared)

    def clear_by_count(self, message: wire.CountMessage, sender: _Sender, now_s: float) -> Output:
        """Empty a plan: a COUNT of 0."""
        self._session.held_until_s = now_s + self._profile.empty_hold_s
        self._session.type = MissionType(message.mission_type)
        return self.clear(message, sender) + Output(events=self._received())

    def cancelled(self) -> Output:
        """End the transfer, an upload or a download, for the ground station wants no more of it."""
        text = "the ground station cancelled the transfer"
        return Output(events=self._fail(FailureReason.CANCELLED, text))

    def abort(self, partner: _Sender) -> Output:
        """End the upload, for nothing comes any more."""
        session = self._session
        item = f"item {session.expected} of {session.count}"
        text = f"{item} did not come in {self._profile.abort_s:g} s"
        said = StatusText(session.type, _CRITICAL, self._profile.timeout_text)
        events = (*self._fail(FailureReason.TIMEOUT, text), said)
        if self._profile.abort_result is None:
            return Output(events=events)
        return self._replies.ack(self._profile.abort_result, session.type, partner, *events)

    def _received(self) -> tuple[Event, ...]:
        texts = self._profile.received_texts
        return () if texts is None else (StatusText(self._session.type, _INFO, texts[self._session.type]),)

    def _merged(self) -> tuple[MissionItem, ...]:
        """Return the plan after what has come: the whole new one, or the old one with a part replaced."""
        session = self._session
        came = tuple(session.items)
        if session.first or session.part or len(came) < session.count:
            old = self._store.wire_items(session.type)
            if not old and came:
                old = to_wire_order(came[:1], session.type, self._profile, self._store.home)[:1]
            end = len(old) if session.part else session.count
            came = old[: session.first] + came + old[session.first + len(came) : end]
        return from_wire_order(came, session.type, self._profile)[0]

    def live(self, mission_type: MissionType) -> tuple[MissionItem, ...]:
        """Return the plan in force, with what has come of an upload that overwrites it in place."""
        session = self._session
        if session.state is not RECEIVING or session.type is not mission_type or self._profile.atomic:
            return self._store.plan(mission_type).items
        return self._merged()

    def _put(
        self, items: tuple[MissionItem, ...], *, start: int | None = None, complete: bool = True
    ) -> Event:
        plan, changed = self._store.received(self._session.type, items)
        changed |= self._session.cut
        self._session.items, self._session.cut = [], False
        return PlanReplaced(self._session.type, items, plan.opaque_id, changed, start, complete)

    def _fail(self, reason: FailureReason, text: str, result: int | None = None) -> tuple[Event, ...]:
        """End the transfer; a vehicle that overwrites in place now holds what has come, and the old rest."""
        failed = TransferFailed(self._session.type, reason, text, result)
        kept = self._kept()
        self._session.items = []
        return (failed, *kept)

    def _kept(self) -> tuple[Event, ...]:
        """Put in force what has come of an upload that is given up, where it overwrites in place."""
        session = self._session
        came = session.items or session.cut
        if session.state is not RECEIVING or self._profile.atomic or not came:
            return ()
        return (self._put(self._merged(), complete=False),)


class OutgoingPlan(_PlanOnWire):
    """Sends a plan."""

    def send_count(self, message: wire.MissionMessage, sender: _Sender, now_s: float) -> Output:
        """Begin the download."""
        session = self._session
        session.partner, session.type = sender, MissionType(message.mission_type)
        session.outgoing, session.next, session.heard_s = self._store.wire_items(session.type), 0, now_s
        session.asked_int = session.warned = False
        number = len(session.outgoing)
        reply = wire.count(sender, number, session.type, self._store.plan(session.type).opaque_id)
        return Output((reply,), (TransferStarted(session.type, upload=False, count=number),))

    def send_item(self, message: wire.RequestMessage, sender: _Sender, current_sequence: int) -> Output:
        """Send the item that is asked for, marked where it is the current one."""
        session = self._session
        mission_type = MissionType(message.mission_type)
        items = session.outgoing if session.state is SENDING else self._store.wire_items(mission_type)
        session.next = max(session.next, message.seq + 1)
        asked_int = type(message).id == wire.REQUEST_INT
        session.asked_int |= asked_int
        integer = asked_int or not self._profile.float_answers
        current = current_sequence + self._store.home_items(mission_type)
        reply = self._message(items[message.seq], message.seq, mission_type, sender, current, integer=integer)
        text = "got MISSION_REQUEST; use MISSION_REQUEST_INT!"
        return Output((reply,), self._replies.warn_of_floats(text, message, wire.REQUEST))

    def all_items(self, mission_type: MissionType) -> list[mavlink.MAVLink_mission_item_int_message]:
        """The MISSION_ITEM_INT of all items of a plan, addressed to nobody."""
        items = []
        for seq, item in enumerate(self._store.wire_items(mission_type)):
            message = self._message(item, seq, mission_type, (0, 0), None, integer=True)
            assert is_a(message, mavlink.MAVLink_mission_item_int_message)
            items.append(message)
        return items

    def _message(
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
        item = as_read_back(item, self._profile)
        marked = self._profile.marks_current and mission_type == MissionType.MISSION and seq == current
        frame = frame_on_wire(item, self._profile, integer=integer)
        return wire.item_to_message(
            item, seq, mission_type, target, current=marked, integer=integer, frame=frame
        )

    def answer_beyond(self, message: wire.RequestMessage, sender: _Sender) -> Output:
        """Answer a request for an item that the plan does not have."""
        if self._profile.range_result is None:
            return NOTHING
        refused = self._replies.ack(self._profile.range_result, message.mission_type, sender)
        if not self._profile.stateless_download:
            return refused
        number = len(self._store.wire_items(MissionType(message.mission_type)))
        return Output((wire.count(sender, number, message.mission_type),)) + refused

    def refuse_jump(self, message: wire.RequestMessage, sender: _Sender) -> Output:
        """End the download: an item was asked for before the one that comes next."""
        said = self._replies.status(f"REJ. request of {message.seq}: next is {self._session.next}")
        text = f"item {message.seq} was requested, {self._session.next} is next"
        failed = self._fail(FailureReason.BROKEN, text)
        return self._replies.ack(wire.ERROR, message.mission_type, sender, failed, said)

    def end(self) -> Output:
        """End the download well."""
        return Output(events=(PlanSent(self._session.type),))

    def refused(self, message: wire.AckMessage) -> Output:
        """End the download, for the ground station refuses it."""
        text = f"the ground station answers: {wire.result_text(message.type)}"
        return Output(events=(self._fail(FailureReason.REFUSED, text, message.type),))

    def abort(self) -> Output:
        """End the download, for nothing is asked for any more."""
        session = self._session
        if session.next >= len(session.outgoing):
            return Output(events=(self._fail(FailureReason.TIMEOUT, "the last item was never confirmed"),))
        text = f"item {session.next} was not requested in {self._profile.abort_s:g} s"
        said = StatusText(session.type, _CRITICAL, "Operation timeout")
        return Output(events=(self._fail(FailureReason.TIMEOUT, text), said))

    def _fail(self, reason: FailureReason, text: str, result: int | None = None) -> Event:
        return TransferFailed(self._session.type, reason, text, result)
