"""The vehicle's side of the mission protocol, sans-IO."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, assert_never

from mission.autopilots import PX4
from mission.autopilots.profile import Profile
from mission.link.codec.dialect import Message, mavlink
from mission.model import GeoPoint, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.events import NOTHING, Output
from mission.transfer.plan_store import PlanStore, StoredPlan
from mission.transfer.server_incoming import IncomingPlan, OutgoingPlan
from mission.transfer.server_session import ServerReplies, ServerSession
from mission.transfer.server_table import (
    IDLE,
    RECEIVING,
    SERVER_TABLE,
    ServerAction,
    ServerInput,
    ServerState,
)
from mission.transfer.server_validator import ServerJudge, Validator

_I = ServerInput
_A = ServerAction
_COMPONENTS = frozenset({0, mavlink.MAV_COMP_ID_MISSIONPLANNER})


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
        self._replies = ServerReplies(profile, self._store, self._session)
        self._incoming = IncomingPlan(profile, self._store, self._session, self._replies)
        self._outgoing = OutgoingPlan(profile, self._store, self._session, self._replies)
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

    def live_plan(self, mission_type: MissionType) -> tuple[MissionItem, ...]:
        """Return what a vehicle that overwrites in place would fly now, in the middle of an upload too."""
        return self._incoming.live(mission_type)

    def set_card(self, mission_type: MissionType, kib: float) -> None:
        """Take the room for a plan from the parameter of its card, as at a start of the vehicle."""
        self._store.capacity[mission_type] = self.profile.room(mission_type, kib)

    def count(self, mission_type: MissionType) -> int:
        """Return how many items a download has (with home, where the autopilot counts it)."""
        return len(self._store.wire_items(mission_type))

    def items_on_wire(self, mission_type: MissionType) -> list[mavlink.MAVLink_mission_item_int_message]:
        """Return the MISSION_ITEM_INT of all items of a plan, as a download has them."""
        return self._outgoing.all_items(mission_type)

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

    def restart(self, now_s: float) -> Output:
        """Forget the transfer that runs, without a word: the vehicle starts again. The plans stay."""
        if self._session.state is IDLE:
            return NOTHING
        return Output((), self._step(_I.ABORT, None, self._session.partner, now_s).events)

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

    def _step(
        self, found: ServerInput, message: wire.MissionMessage | None, sender: tuple[int, int], now_s: float
    ) -> Output:
        action, following = SERVER_TABLE[self._session.state, found]
        output = self._act(action, message, sender, now_s)
        self._session.state = following
        return output

    def _act(self, action: ServerAction, message: Any, sender: tuple[int, int], now_s: float) -> Output:
        """Do what a row of the table says, before the state changes.

        The judge gives each input to messages of one kind only, so ``message`` is what the action takes.
        """
        incoming, outgoing, replies = self._incoming, self._outgoing, self._replies
        match action:
            case _A.ASK_FIRST:
                return incoming.ask_first(message, sender, now_s)
            case _A.CLEAR_BY_COUNT:
                return incoming.clear_by_count(message, sender, now_s)
            case _A.REFUSE_SPACE:
                return replies.refuse_space(message, sender)
            case _A.REFUSE_BUSY:
                return replies.refuse_busy(message, sender)
            case _A.REFUSE_TYPE:
                return replies.refuse_type(message, sender)
            case _A.REPEAT_ACK:
                return replies.repeat_ack()
            case _A.IGNORE:
                return NOTHING
            case _A.REFUSE_UNEXPECTED_ITEM:
                return replies.refuse_unexpected_item(message, sender)
            case _A.SEND_COUNT:
                return outgoing.send_count(message, sender, now_s)
            case _A.SEND_ITEM:
                return outgoing.send_item(message, sender, self.current_sequence)
            case _A.ANSWER_BEYOND:
                return outgoing.answer_beyond(message, sender)
            case _A.REFUSE_REQUEST:
                return replies.refuse_request(message, sender)
            case _A.CLEAR:
                return incoming.clear(message, sender)
            case _A.REFUSE_CLEAR:
                return replies.refuse_clear(message, sender)
            case _A.REFUSE_CLEAR_NOW:
                return replies.refuse_clear_now(message, sender)
            case _A.REFUSE_PARTIAL:
                return replies.refuse_partial(message, sender)
            case _A.ASK_PART:
                return incoming.ask_part(message, sender, now_s)
            case _A.TAKE_ITEM:
                return incoming.take_item(message, now_s)
            case _A.TAKE_LAST_ITEM:
                return incoming.take_last_item(message, sender)
            case _A.REFUSE_ITEM:
                return incoming.refuse_item(message, sender)
            case _A.ANSWER_ORDER:
                return replies.answer_order(sender)
            case _A.REFUSE_ITEM_TYPE:
                return replies.refuse_item_type(message, sender)
            case _A.REFUSE_FOREIGN_ITEM:
                return replies.refuse_foreign_item(message, sender)
            case _A.REFUSE_LIST:
                return replies.refuse_list(message, sender)
            case _A.REFUSE_REQUEST_NOW:
                return replies.refuse_request_now(message, sender)
            case _A.END_CANCELLED:
                return incoming.cancelled()
            case _A.ASK_AGAIN:
                return incoming.ask(now_s)
            case _A.ABORT_UPLOAD:
                return incoming.abort(sender)
            case _A.SAY_BUSY:
                return replies.say_busy()
            case _A.REFUSE_CHANGED:
                return replies.refuse_changed(message, sender)
            case _A.REFUSE_JUMP:
                return outgoing.refuse_jump(message, sender)
            case _A.END_SENT:
                return outgoing.end()
            case _A.END_REFUSED:
                return outgoing.refused(message)
            case _A.ABORT_DOWNLOAD:
                return outgoing.abort()
            case _:
                assert_never(action)
