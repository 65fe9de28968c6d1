"""The vehicle's side of a download: telling the number of items, and sending those that are asked for."""

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
    PlanSent,
    StatusText,
    TransferFailed,
    TransferStarted,
)
from mission.transfer.plan_store import PlanStore
from mission.transfer.server_replies import ServerReplies
from mission.transfer.server_session import ServerSession
from mission.transfer.server_table import SENDING
from mission.transfer.storage import as_read_back, frame_on_wire

_CRITICAL = mavlink.MAV_SEVERITY_CRITICAL
_Sender = tuple[int, int]


class OutgoingPlan:
    """Sends a plan.

    Parameters
    ----------
    profile : Profile
        Whose habits to follow.
    store : PlanStore
        Where the plan comes from.
    session : ServerSession
        The transfer that runs; its download fields are written here.
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
