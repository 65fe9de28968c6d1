"""What a message means to the vehicle in its present state: the inputs of `mission.transfer.server_table`."""

from __future__ import annotations

from collections.abc import Callable

from mission.autopilots.profile import Profile
from mission.errors import MissionError
from mission.link.codec.dialect import mavlink
from mission.link.codec.typed import is_a
from mission.model import Command, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.server_state import PlanStore, ServerSession
from mission.transfer.server_table import IDLE, RECEIVING, SENDING, ServerInput
from mission.transfer.storage import UncheckedItem, as_stored, validate_item, validate_numbers

Validator = Callable[[MissionItem], int]
_I = ServerInput
_FENCE = frozenset(range(Command.NAV_FENCE_RETURN_POINT, Command.NAV_FENCE_CIRCLE_EXCLUSION + 1))
_POLYGON = frozenset({Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION})


class ServerInputs:
    """The part of a server that only looks: which input a message is; the session keeps the item it read."""

    def __init__(self, profile: Profile, store: PlanStore, validator: Validator | None) -> None:
        self.profile = profile
        self.validator = validator
        self.locked = False
        self._store = store
        self._session = ServerSession()

    def _input_of(self, message: wire.MissionMessage, sender: tuple[int, int], now_s: float) -> ServerInput:
        """Return the input of the table that a message is in the session's state."""
        session = self._session
        if wire.is_item(message):
            return self._of_item(message, sender)
        if wire.is_request(message):
            return self._of_request(message, sender)
        if is_a(message, mavlink.MAVLink_mission_ack_message):
            return self._of_ack(message, sender)
        if wire.is_partial(message):
            return self._of_partial(message)
        number = type(message).id
        mission_type = wire.plan_type(message.mission_type)
        everything = number == wire.CLEAR and message.mission_type == wire.ALL_TYPES
        if mission_type is None and not everything:
            return _I.BAD_TYPE
        if number == wire.LIST:
            return self._of_list(sender)
        if session.state is SENDING and sender == session.partner and session.all_sent:
            return _I.IMPLIED_END
        if number == wire.CLEAR:
            if everything and not self.profile.clear_all_types:
                return _I.CLEAR_UNSUPPORTED if session.state is IDLE else _I.BAD_TYPE
            if session.state is not IDLE:
                return _I.CLEAR_BUSY
            locked = self.locked and mission_type == MissionType.MISSION
            return _I.CLEAR_LOCKED if locked else _I.CLEAR
        assert mission_type is not None and is_a(message, mavlink.MAVLink_mission_count_message)
        return self._of_count(message.count, mission_type, sender, now_s)

    def _of_count(
        self, number: int, mission_type: MissionType, sender: tuple[int, int], now_s: float
    ) -> ServerInput:
        session, fits = self._session, number <= self._store.room(mission_type)
        if session.state is IDLE:
            if now_s < session.held_until_s:
                return _I.COUNT_BUSY
            return _I.COUNT_EMPTY if number == 0 else _I.COUNT if fits else _I.COUNT_TOO_LARGE
        if session.state is SENDING or not session.is_with(sender, mission_type):
            return _I.COUNT_BUSY
        again = not session.items or self.profile.restart_on_count
        return _I.COUNT_REPEATED if again and fits and number else _I.COUNT_BUSY

    def _of_partial(self, message: wire.PartialMessage) -> ServerInput:
        kind = wire.plan_type(message.mission_type)
        if not is_a(message, mavlink.MAVLink_mission_write_partial_list_message) or kind is None:
            return _I.PARTIAL
        number = len(self._store.wire_items(kind))
        within = 0 <= message.start_index <= message.end_index <= number
        return _I.WRITE if within and self.profile.partial_write else _I.PARTIAL

    def _of_item(self, message: wire.ItemMessage, sender: tuple[int, int]) -> ServerInput:
        session = self._session
        if session.state is not RECEIVING:
            return self._of_late_item(message, sender)
        if sender != session.partner:
            return _I.ITEM_FOREIGN
        if message.mission_type != session.type:
            return _I.ITEM_WRONG_TYPE
        if message.seq != session.expected:
            return _I.ITEM_OUT_OF_ORDER
        session.candidate, session.verdict = self._read_item(message)
        if session.verdict != wire.ACCEPTED:
            return _I.ITEM_REFUSED
        return _I.ITEM_LAST if message.seq == session.count - 1 else _I.ITEM_NEXT

    def _of_late_item(self, message: wire.ItemMessage, sender: tuple[int, int]) -> ServerInput:
        """Tell an echo of the last upload from an item that makes no sense."""
        idle, ended = self._session.state is IDLE, self._session.ended
        unexpected = _I.ITEM_UNEXPECTED if idle else _I.ITEM_FOREIGN
        if ended is None or sender != ended.sender or message.mission_type != ended.mission_type:
            return unexpected
        item = self._item_of(message)
        item = None if item is None else as_stored(item, self.profile)
        if message.seq == ended.sequence and (ended.result != wire.ACCEPTED or item == ended.item):
            return _I.ITEM_REPEATED if idle else _I.ITEM_STALE
        if ended.result != wire.ACCEPTED:
            return _I.ITEM_STALE if message.seq < ended.sequence else unexpected
        items = self._store.wire_items(ended.mission_type)
        home = message.seq < self._store.home_items(ended.mission_type)
        same = home or (message.seq < len(items) and item == items[message.seq])
        return _I.ITEM_STALE if same else unexpected

    def _of_list(self, sender: tuple[int, int]) -> ServerInput:
        session = self._session
        if session.state is IDLE:
            return _I.LIST_STATELESS if self.profile.stateless_download else _I.LIST
        if sender != session.partner:
            return _I.LIST_BUSY
        if session.state is SENDING:
            return _I.LIST
        return _I.LIST_BUSY if session.items or self.profile.stateless_download else _I.ABANDONED

    def _of_request(self, message: wire.RequestMessage, sender: tuple[int, int]) -> ServerInput:
        session = self._session
        if session.state is IDLE:
            mission_type = wire.plan_type(message.mission_type)
            if not self.profile.stateless_download or mission_type is None:
                return _I.REQUEST_UNEXPECTED
            within = message.seq < len(self._store.wire_items(mission_type))
            return _I.REQUEST_STATELESS if within else _I.REQUEST_BEYOND
        if session.state is RECEIVING or not session.is_with(sender, message.mission_type):
            return _I.REQUEST_FOREIGN
        if message.seq >= len(session.outgoing):
            return _I.REQUEST_BEYOND
        if session.asked_int and type(message).id == wire.REQUEST and self.profile.float_answers:
            return _I.REQUEST_CHANGED
        return _I.REQUEST if message.seq <= session.next else _I.REQUEST_JUMP

    def _of_ack(self, message: wire.AckMessage, sender: tuple[int, int]) -> ServerInput:
        session = self._session
        if not session.is_with(sender, message.mission_type):
            return _I.ACK_OTHER
        if message.type == wire.OPERATION_CANCELLED:
            return _I.ACK_CANCEL
        if session.state is RECEIVING:
            return _I.ACK_OTHER
        if message.type != wire.ACCEPTED:
            return _I.ACK_ERROR
        return _I.ACK_DONE if session.all_sent else _I.ACK_OTHER

    def _read_item(self, message: wire.ItemMessage) -> tuple[MissionItem | None, int]:
        """Return the item and the verdict on it."""
        kind = self._session.type
        if self._store.home_items(kind) and message.seq == 0:
            return MissionItem(Command.NAV_WAYPOINT), int(wire.ACCEPTED)
        verdict = validate_numbers(message, self.profile)
        if verdict != wire.ACCEPTED:
            return None, verdict
        item = self._item_of(message)
        if item is None:
            return None, wire.refusal(message)
        fence, rally = item.command in _FENCE, item.command == Command.NAV_RALLY_POINT
        verdict = validate_item(item, self._session.count, self.profile)
        if verdict == wire.ACCEPTED and (fence, rally) != (
            kind == MissionType.FENCE,
            kind == MissionType.RALLY,
        ):
            verdict = int(wire.ERROR if fence or rally else wire.UNSUPPORTED)
        if verdict == wire.ACCEPTED and item.command in _POLYGON and not (item.param1 or 0.0) >= 3.0:
            verdict = int(wire.ERROR)
        if verdict == wire.ACCEPTED and self.validator is not None:
            verdict = int(self.validator(item))
        return as_stored(item, self.profile), verdict

    def _item_of(self, message: wire.ItemMessage) -> MissionItem | None:
        """Read an item; None when its numbers make no sense and the autopilot would see that."""
        try:
            return wire.item_from_message(message)
        except MissionError:
            return None if self.profile.range_checked else UncheckedItem.of(message)
