"""What a message means to the vehicle in its present state: the inputs of `mission.transfer.server_table`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mission.errors import MissionError
from mission.model import Command, GeoPoint, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.events import Message
from mission.transfer.profile import PX4, Profile, home_items, to_wire_order
from mission.transfer.server_table import IDLE, RECEIVING, SENDING, ServerInput
from mission.transfer.storage import UncheckedItem, as_stored, judge_item, judge_numbers

Validator = Callable[[MissionItem], int]
_Items = tuple[MissionItem, ...]
_I = ServerInput
_NOBODY = (0, 0)
_FENCE = frozenset(range(Command.NAV_FENCE_RETURN_POINT, Command.NAV_FENCE_CIRCLE_EXCLUSION + 1))
_POLYGON = frozenset({Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION})


@dataclass(frozen=True, slots=True)
class StoredPlan:
    """A plan as the vehicle holds it, with its id (0 for none)."""

    items: tuple[MissionItem, ...] = ()
    opaque_id: int = 0


class ServerMemory:
    """What the server knows, and its judgement of messages; `MissionServer` acts on it."""

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
        self.locked = False
        self._capacity = dict(zip(MissionType, profile.capacity, strict=True)) | dict(capacity or {})
        self._plans = {kind: StoredPlan() for kind in MissionType}
        self._state = IDLE
        self._partner = _NOBODY
        self._type = MissionType.MISSION
        self._count = 0
        self._items: list[MissionItem] = []
        self._first = 0
        self._part = False
        self._cleared = home is None
        self._now_s = 0.0
        self._held_until_s = -1.0
        self._asked_int = False
        self._warned = False
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

    def _judge(self, message: Message, sender: tuple[int, int]) -> ServerInput:
        number = type(message).id
        if number in (wire.ITEM_INT, wire.ITEM):
            return self._judge_item(message, sender)
        if number in (wire.REQUEST_INT, wire.REQUEST):
            return self._judge_request(message, sender)
        if number == wire.ACK:
            return self._judge_ack(message, sender)
        if number in (wire.PARTIAL_LIST, wire.WRITE_PARTIAL):
            return self._judge_partial(message)
        mission_type = wire.plan_type(message.mission_type)
        everything = number == wire.CLEAR and message.mission_type == wire.ALL_TYPES
        if mission_type is None and not everything:
            return _I.BAD_TYPE
        if number == wire.LIST:
            return self._judge_list(sender)
        if self._state is SENDING and sender == self._partner and self._next >= len(self._outgoing):
            return _I.IMPLIED_END
        if number == wire.CLEAR:
            if everything and not self.profile.clear_all_types:
                return _I.CLEAR_UNSUPPORTED if self._state is IDLE else _I.BAD_TYPE
            if self._state is not IDLE:
                return _I.CLEAR_BUSY
            locked = self.locked and mission_type == MissionType.MISSION
            return _I.CLEAR_LOCKED if locked else _I.CLEAR
        assert mission_type is not None
        return self._judge_count(message.count, mission_type, sender)

    def _judge_count(self, number: int, mission_type: MissionType, sender: tuple[int, int]) -> ServerInput:
        fits = number <= self._capacity[mission_type] + (self._home_items(mission_type))
        if self._state is IDLE:
            if self._now_s < self._held_until_s:
                return _I.COUNT_BUSY
            return _I.COUNT_EMPTY if number == 0 else _I.COUNT if fits else _I.COUNT_TOO_LARGE
        if self._state is SENDING or sender != self._partner or mission_type != self._type:
            return _I.COUNT_BUSY
        again = not self._items or self.profile.restart_on_count
        return _I.COUNT_REPEATED if again and fits and number else _I.COUNT_BUSY

    def _judge_partial(self, message: Message) -> ServerInput:
        kind = wire.plan_type(message.mission_type)
        if type(message).id != wire.WRITE_PARTIAL or not self.profile.partial_write or kind is None:
            return _I.PARTIAL
        number = len(self._wire_items(kind))
        within = 0 <= message.start_index <= message.end_index <= number
        return _I.WRITE if within else _I.PARTIAL

    def _judge_item(self, message: Message, sender: tuple[int, int]) -> ServerInput:
        if self._state is not RECEIVING:
            return self._judge_late_item(message, sender)
        if sender != self._partner:
            return _I.ITEM_FOREIGN
        if message.mission_type != self._type:
            return _I.ITEM_WRONG_TYPE
        if message.seq != self._expected:
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
        item = self._item_of(message)
        item = None if item is None else as_stored(item, self.profile)
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
        return _I.LIST_BUSY if self._items or self.profile.stateless_download else _I.ABANDONED

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
        if self._asked_int and type(message).id == wire.REQUEST and self.profile.float_answers:
            return _I.REQUEST_CHANGED
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
        verdict = judge_numbers(message, self.profile)
        if verdict != wire.ACCEPTED:
            return None, verdict
        item = self._item_of(message)
        if item is None:
            return None, wire.refusal(message)
        fence, rally = item.command in _FENCE, item.command == Command.NAV_RALLY_POINT
        verdict = judge_item(item, self._count, self.profile)
        if verdict == wire.ACCEPTED and (fence, rally) != (
            self._type == MissionType.FENCE,
            self._type == MissionType.RALLY,
        ):
            verdict = int(wire.ERROR if fence or rally else wire.UNSUPPORTED)
        if verdict == wire.ACCEPTED and item.command in _POLYGON and not (item.param1 or 0.0) >= 3.0:
            verdict = int(wire.ERROR)
        if verdict == wire.ACCEPTED and self.validator is not None:
            verdict = int(self.validator(item))
        return as_stored(item, self.profile), verdict

    def _item_of(self, message: Message) -> MissionItem | None:
        """Read an item; None when its numbers make no sense and the autopilot would see that."""
        try:
            return wire.item_from_message(message)
        except MissionError:
            return None if self.profile.range_checked else UncheckedItem.of(message)

    @property
    def _expected(self) -> int:
        """Number of the item that is asked for."""
        return self._first + len(self._items)

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
        if not items and not self._cleared and self.home is not None:
            return home_items(self.home)
        return cached[2]
