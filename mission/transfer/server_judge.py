"""What a message means to the vehicle in its present state: the inputs of `mission.transfer.server_table`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mission.errors import MissionError
from mission.model import Command, GeoPoint, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.events import Message
from mission.transfer.profile import PX4, Profile, to_wire_order
from mission.transfer.server_table import IDLE, RECEIVING, SENDING, ServerInput

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
