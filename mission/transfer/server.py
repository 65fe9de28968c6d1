"""The vehicle's side of the mission protocol, sans-IO."""

# ruff: noqa: ARG002 - the actions of the transition table share one signature

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from mission.errors import MissionError
from mission.link.dialect import mavlink
from mission.model import Command, GeoPoint, MissionItem, MissionType
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
from mission.transfer.profile import PX4, Profile, from_wire_order, to_wire_order
from mission.transfer.server_table import IDLE, RECEIVING, SENDING, SERVER_TABLE, ServerInput, ServerState

Validator = Callable[[MissionItem], int]
_Items = tuple[MissionItem, ...]
_I = ServerInput
_NOBODY = (0, 0)
_FENCE = frozenset(range(Command.NAV_FENCE_RETURN_POINT, Command.NAV_FENCE_CIRCLE_EXCLUSION + 1))
_POLYGON = frozenset({Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION})
_COMPONENTS = frozenset({0, mavlink.MAV_COMP_ID_MISSIONPLANNER})
_WARNING = mavlink.MAV_SEVERITY_WARNING
_CRITICAL = mavlink.MAV_SEVERITY_CRITICAL


@dataclass(frozen=True, slots=True)
class StoredPlan:
    """A plan as the vehicle holds it, with its id (0 for none)."""

    items: tuple[MissionItem, ...] = ()
    opaque_id: int = 0


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
        self.validator = validator
        self.home = home
        self.current_sequence = 0
        self._capacity = dict.fromkeys(MissionType, wire.MAX_ITEMS) | dict(capacity or {})
        self._plans = {kind: StoredPlan() for kind in MissionType}
        self._state = IDLE
        self._partner = _NOBODY
        self._type = MissionType.MISSION
        self._count = 0
        self._items: list[MissionItem] = []
        self._outgoing: tuple[MissionItem, ...] = ()
        self._next = 0
        self._start = 0
        self._heard_s = 0.0
        self._asked_s = 0.0
        self._verdict = int(wire.ACCEPTED)
        self._candidate: MissionItem | None = None
        self._with_home: tuple[tuple[MissionItem, ...], GeoPoint | None, tuple[MissionItem, ...]] | None = (
            None
        )
        self._ended: tuple[tuple[int, int], MissionType, int, MissionItem | None, int] | None = None

    @property
    def state(self) -> ServerState:
        """What the server is doing."""
        return self._state

    @property
    def busy(self) -> bool:
        """Whether a transfer is running."""
        return self._state is not IDLE

    def plan(self, mission_type: MissionType) -> StoredPlan:
        """Return the plan in force, without home."""
        return self._plans[mission_type]

    def set_plan(self, mission_type: MissionType, items: Sequence[MissionItem]) -> StoredPlan:
        """Put a plan in force from inside the vehicle and return it with its id."""
        plan = StoredPlan(tuple(items), wire.plan_checksum(items))
        self._plans[mission_type] = plan
        self._ended = None
        return plan

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
            state = self._state
            found = self._judge(message, sender)
            if state is not IDLE and sender == self._partner:
                self._heard_s = now_s
            output = before + self._step(found, message, sender, now_s)
            if found is not _I.IMPLIED_END and found is not _I.ABANDONED:
                return output
            before = output

    def poll(self, now_s: float) -> Output:
        """Act on the timers that are due."""
        if self._state is IDLE:
            return NOTHING
        if now_s >= self._heard_s + self.profile.abort_s:
            return self._step(_I.ABORT, None, self._partner, now_s)
        if self._state is RECEIVING and now_s >= self._asked_s + self.profile.re_request_s:
            return self._step(_I.RETRY, None, self._partner, now_s)
        return NOTHING

    def next_deadline(self) -> float | None:
        """When `poll` has something to do, None if no transfer runs."""
        if self._state is IDLE:
            return None
        abort = self._heard_s + self.profile.abort_s
        return min(abort, self._asked_s + self.profile.re_request_s) if self._state is RECEIVING else abort

    def _step(self, found: ServerInput, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        action, following = SERVER_TABLE[self._state, found]
        output: Output = getattr(self, f"_{action}")(message, sender, now_s)
        self._state = following
        return output

    # Judging: which input of the table a message is.

    def _judge(self, message: Message, sender: tuple[int, int]) -> ServerInput:
        number = type(message).id
        if number in (wire.ITEM_INT, wire.ITEM):
            return self._judge_item(message, sender)
        if number in (wire.REQUEST_INT, wire.REQUEST):
            return self._judge_request(message, sender)
        if number == wire.ACK:
            return self._judge_ack(message, sender)
        if number in (wire.PARTIAL_LIST, wire.WRITE_PARTIAL):
            return _I.PARTIAL
        mission_type = wire.plan_type(message.mission_type)
        everything = number == wire.CLEAR and message.mission_type == wire.ALL_TYPES
        if mission_type is None and not everything:
            return _I.BAD_TYPE
        if number == wire.LIST:
            return self._judge_list(sender)
        if self._state is SENDING and sender == self._partner and self._next >= len(self._outgoing):
            return _I.IMPLIED_END
        if number == wire.CLEAR:
            if self._state is not IDLE:
                return _I.CLEAR_BUSY
            return _I.CLEAR_UNSUPPORTED if everything and not self.profile.clear_all_types else _I.CLEAR
        assert mission_type is not None
        return self._judge_count(message.count, mission_type, sender)

    def _judge_count(self, number: int, mission_type: MissionType, sender: tuple[int, int]) -> ServerInput:
        fits = number <= self._capacity[mission_type] + (self._home_items(mission_type))
        if self._state is IDLE:
            return _I.COUNT_EMPTY if number == 0 else _I.COUNT if fits else _I.COUNT_TOO_LARGE
        if self._state is SENDING or sender != self._partner or mission_type != self._type:
            return _I.COUNT_BUSY
        again = not self._items or self.profile.restart_on_count
        return _I.COUNT_REPEATED if again and fits and number else _I.COUNT_BUSY

    def _judge_item(self, message: Message, sender: tuple[int, int]) -> ServerInput:
        if self._state is not RECEIVING:
            return self._judge_late_item(message, sender)
        if sender != self._partner:
            return _I.ITEM_FOREIGN
        if message.mission_type != self._type:
            return _I.ITEM_WRONG_TYPE
        if message.seq != len(self._items):
            return _I.ITEM_OUT_OF_ORDER
        self._candidate, self._verdict = self._read_item(message)
        if self._verdict != wire.ACCEPTED:
            return _I.ITEM_REFUSED
        return _I.ITEM_LAST if message.seq == self._count - 1 else _I.ITEM_NEXT

    def _judge_late_item(self, message: Message, sender: tuple[int, int]) -> ServerInput:
        """Tell an echo of the last upload from an item that makes no sense."""
        unexpected = _I.ITEM_UNEXPECTED if self._state is IDLE else _I.ITEM_FOREIGN
        ended = self._ended
        if ended is None or sender != ended[0] or message.mission_type != ended[1]:
            return unexpected
        try:
            item = wire.item_from_message(message)
        except MissionError:
            item = None
        if message.seq == ended[2] and (ended[4] != wire.ACCEPTED or item == ended[3]):
            return _I.ITEM_REPEATED if self._state is IDLE else _I.ITEM_STALE
        if ended[4] != wire.ACCEPTED:
            return _I.ITEM_STALE if message.seq < ended[2] else unexpected
        items = self._wire_items(ended[1])
        home = message.seq < self._home_items(ended[1])
        same = home or (message.seq < len(items) and item == items[message.seq])
        return _I.ITEM_STALE if same else unexpected

    def _judge_list(self, sender: tuple[int, int]) -> ServerInput:
        if self._state is IDLE:
            return _I.LIST_STATELESS if self.profile.stateless_download else _I.LIST
        if sender != self._partner:
            return _I.LIST_BUSY
        if self._state is SENDING:
            return _I.LIST
        return _I.LIST_BUSY if self._items else _I.ABANDONED

    def _judge_request(self, message: Message, sender: tuple[int, int]) -> ServerInput:
        if self._state is IDLE:
            mission_type = wire.plan_type(message.mission_type)
            if not self.profile.stateless_download or mission_type is None:
                return _I.REQUEST_UNEXPECTED
            within = message.seq < len(self._wire_items(mission_type))
            return _I.REQUEST_STATELESS if within else _I.REQUEST_BEYOND
        if self._state is RECEIVING or sender != self._partner or message.mission_type != self._type:
            return _I.REQUEST_FOREIGN
        if message.seq >= len(self._outgoing):
            return _I.REQUEST_BEYOND
        return _I.REQUEST if message.seq <= self._next else _I.REQUEST_JUMP

    def _judge_ack(self, message: Message, sender: tuple[int, int]) -> ServerInput:
        if self._state is IDLE or sender != self._partner or message.mission_type != self._type:
            return _I.ACK_OTHER
        if message.type == wire.OPERATION_CANCELLED:
            return _I.ACK_CANCEL
        if self._state is RECEIVING:
            return _I.ACK_OTHER
        if message.type != wire.ACCEPTED:
            return _I.ACK_ERROR
        return _I.ACK_DONE if self._next >= len(self._outgoing) else _I.ACK_OTHER

    def _read_item(self, message: Message) -> tuple[MissionItem | None, int]:
        """Return the item and the verdict on it."""
        if self._home_items(self._type) and message.seq == 0:
            return MissionItem(Command.NAV_WAYPOINT), int(wire.ACCEPTED)
        try:
            item = wire.item_from_message(message)
        except MissionError:
            return None, wire.refusal(message)
        if self.profile.frames is not None and item.frame not in self.profile.frames:
            return None, int(wire.UNSUPPORTED_FRAME)
        fence, rally = item.command in _FENCE, item.command == Command.NAV_RALLY_POINT
        if (fence, rally) != (self._type == MissionType.FENCE, self._type == MissionType.RALLY):
            return None, int(wire.ERROR if fence or rally else wire.UNSUPPORTED)
        if item.command in _POLYGON and not (item.param1 or 0.0) >= 3.0:
            return None, int(wire.ERROR)
        verdict = wire.ACCEPTED if self.validator is None else self.validator(item)
        return item, int(verdict)

    # Acting: what the rows of the table do, before the state changes.

    def _ignore(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return NOTHING

    def _ask_first(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        self._partner, self._type, self._count = sender, MissionType(message.mission_type), message.count
        self._items, self._start, self._ended = [], 0, None
        self._heard_s = now_s
        started = TransferStarted(self._type, upload=True, count=message.count)
        return self._ask(now_s) + Output(events=(started,))

    def _ask(self, now_s: float) -> Output:
        self._asked_s = now_s
        build = (
            mavlink.MAVLink_mission_request_int_message
            if self.profile.request_int
            else mavlink.MAVLink_mission_request_message
        )
        return Output((build(*self._partner, len(self._items), self._type),))

    def _ask_again(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return self._ask(now_s)

    def _take(self, message: Message) -> None:
        assert self._candidate is not None
        if message.current and message.seq:
            self._start = message.seq - self._home_items(self._type)
        self._items.append(self._candidate)

    def _take_item(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        self._take(message)
        return self._ask(now_s)

    def _take_last_item(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        self._take(message)
        last = self._candidate if message.seq or not self._home_items(self._type) else None
        self._ended = (sender, self._type, message.seq, last, int(wire.ACCEPTED))
        items, _ = from_wire_order(tuple(self._items), self._type, self.profile)
        replaced = self._put(items, start=self._start)
        return self._ack(wire.ACCEPTED, self._type, sender, replaced)

    def _put(self, items: tuple[MissionItem, ...], *, start: int = 0, complete: bool = True) -> Event:
        plan = StoredPlan(items, wire.plan_checksum(items))
        changed = plan.opaque_id != self._plans[self._type].opaque_id
        self._plans[self._type] = plan
        self._items = []
        return PlanReplaced(self._type, items, plan.opaque_id, changed, start, complete)

    def _refuse_item(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        self._ended = (sender, self._type, message.seq, None, self._verdict)
        text = f"item {message.seq}: {wire.result_text(self._verdict)}"
        failed = self._fail(FailureReason.REFUSED, text, self._verdict)
        said = StatusText(self._type, _WARNING, f"Mission item {message.seq} rejected")
        return self._ack(self._verdict, self._type, sender, *failed, said)

    def _answer_order(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        if self.profile.order_result is None:
            return NOTHING
        return self._ack(self.profile.order_result, self._type, sender)

    def _refuse_item_type(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return self._ack(wire.ERROR, message.mission_type, sender)

    def _repeat_ack(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        assert self._ended is not None
        return self._ack(self._ended[4], self._ended[1], sender)

    def _refuse_unexpected_item(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        said = StatusText(self._type, _WARNING, "WPM: REJ. item: no transfer is running")
        return self._ack(wire.ERROR, message.mission_type, sender, said)

    def _refuse_busy(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        said = StatusText(self._type, _WARNING, "WPM: REJ. CMD: Busy")
        return self._ack(self.profile.busy_result, message.mission_type, sender, said)

    def _say_busy(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return Output(events=(StatusText(self._type, _WARNING, "WPM: IGN. CMD: Busy"),))

    def _refuse_list(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        if self.profile.busy_result == wire.DENIED:
            return self._ack(wire.DENIED, message.mission_type, sender)
        return self._say_busy(message, sender, now_s)

    def _refuse_type(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return self._ack(wire.INVALID, message.mission_type, sender)

    def _refuse_space(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        mission_type = MissionType(message.mission_type)
        said = StatusText(mission_type, _WARNING, f"Only {self._capacity[mission_type]} items are supported")
        return self._ack(wire.NO_SPACE, mission_type, sender, said)

    def _refuse_partial(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return self._ack(wire.ERROR, message.mission_type, sender)

    def _refuse_clear(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return self._ack(wire.UNSUPPORTED, message.mission_type, sender)

    def _clear(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        everything = message.mission_type == wire.ALL_TYPES
        kinds = tuple(MissionType) if everything else (MissionType(message.mission_type),)
        for kind in kinds:
            self._plans[kind] = StoredPlan()
        self._ended = None
        return self._ack(wire.ACCEPTED, message.mission_type, sender, *(PlanCleared(kind) for kind in kinds))

    def _clear_by_count(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return self._clear(message, sender, now_s)

    def _send_count(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        self._partner, self._type = sender, MissionType(message.mission_type)
        self._outgoing, self._next, self._heard_s = self._wire_items(self._type), 0, now_s
        number = len(self._outgoing)
        reply = wire.count(sender, number, self._type, self._plans[self._type].opaque_id)
        return Output((reply,), (TransferStarted(self._type, upload=False, count=number),))

    def _send_item(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        mission_type = MissionType(message.mission_type)
        items = self._outgoing if self._state is SENDING else self._wire_items(mission_type)
        self._next = max(self._next, message.seq + 1)
        current = mission_type == MissionType.MISSION and message.seq == (
            self.current_sequence + self._home_items(mission_type)
        )
        integer = type(message).id == wire.REQUEST_INT or not self.profile.float_answers
        reply = wire.item_to_message(
            items[message.seq], message.seq, mission_type, sender, current=current, integer=integer
        )
        return Output((reply,))

    def _answer_beyond(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        if self.profile.range_result is None:
            return NOTHING
        return self._ack(self.profile.range_result, message.mission_type, sender)

    def _refuse_request(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        said = StatusText(self._type, _WARNING, "WPM: REJ. request: no LIST before it")
        return self._ack(wire.ERROR, message.mission_type, sender, said)

    def _refuse_jump(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        said = StatusText(self._type, _WARNING, f"WPM: REJ. request of {message.seq}: next is {self._next}")
        failed = self._fail(FailureReason.BROKEN, f"item {message.seq} was requested, {self._next} is next")
        return self._ack(wire.ERROR, message.mission_type, sender, *failed, said)

    def _end_sent(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return Output(events=(PlanSent(self._type),))

    def _end_refused(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        text = f"the ground station answers: {wire.result_text(message.type)}"
        return Output(events=self._fail(FailureReason.REFUSED, text, message.type))

    def _end_cancelled(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        return Output(events=self._fail(FailureReason.CANCELLED, "the ground station cancelled the transfer"))

    def _abort_upload(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        text = f"item {len(self._items)} of {self._count} did not come in {self.profile.abort_s:g} s"
        said = StatusText(self._type, _CRITICAL, "Operation timeout")
        events = (*self._fail(FailureReason.TIMEOUT, text), said)
        if self.profile.abort_result is None:
            return Output(events=events)
        return self._ack(self.profile.abort_result, self._type, sender, *events)

    def _abort_download(self, message: Message, sender: tuple[int, int], now_s: float) -> Output:
        if self._next >= len(self._outgoing):
            return Output(events=self._fail(FailureReason.TIMEOUT, "the last item was never confirmed"))
        text = f"item {self._next} was not requested in {self.profile.abort_s:g} s"
        said = StatusText(self._type, _CRITICAL, "Operation timeout")
        return Output(events=(*self._fail(FailureReason.TIMEOUT, text), said))

    # Helpers.

    def _fail(self, reason: FailureReason, text: str, result: int | None = None) -> tuple[Event, ...]:
        """End the transfer; a vehicle that overwrites in place now holds what has come, and the old rest."""
        failed = TransferFailed(self._type, reason, text, result)
        if self._state is not RECEIVING or self.profile.atomic or not self._items:
            self._items = []
            return (failed,)
        came, _ = from_wire_order(tuple(self._items), self._type, self.profile)
        number = self._count - self._home_items(self._type)
        rest = self._plans[self._type].items[len(came) : number]
        return (failed, self._put(came + rest, complete=False))

    def _ack(self, result: int, mission_type: int, target: tuple[int, int], *events: Event) -> Output:
        plan = wire.plan_type(mission_type)
        opaque_id = self._plans[plan].opaque_id if plan is not None and result == wire.ACCEPTED else 0
        return Output((wire.ack(target, result, mission_type, opaque_id),), events)

    def _home_items(self, mission_type: MissionType) -> int:
        return int(self.profile.home_at_zero and mission_type == MissionType.MISSION)

    def _wire_items(self, mission_type: MissionType) -> tuple[MissionItem, ...]:
        items = self._plans[mission_type].items
        if not self._home_items(mission_type):
            return items
        cached = self._with_home
        if cached is None or cached[0] is not items or cached[1] is not self.home:
            cached = (items, self.home, to_wire_order(items, mission_type, self.profile, self.home))
            self._with_home = cached
        return cached[2]


__all__ = ["MissionServer", "StoredPlan", "Validator"]
