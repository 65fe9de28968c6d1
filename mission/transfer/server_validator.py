"""What a message means to the vehicle in its present state: the inputs of `mission.transfer.server_table`."""

from __future__ import annotations

from collections.abc import Callable

from mission.autopilots.profile import Profile
from mission.errors import MissionError
from mission.link.codec.dialect import mavlink
from mission.link.codec.typed import is_a
from mission.model import Command, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.plan_store import PlanStore
from mission.transfer.server_session import ServerSession
from mission.transfer.server_table import IDLE, RECEIVING, SENDING, ServerInput
from mission.transfer.storage import UncheckedItem, as_stored, judge_item, judge_numbers

Validator = Callable[[MissionItem], int]
_I = ServerInput
_FENCE = frozenset(range(Command.NAV_FENCE_RETURN_POINT, Command.NAV_FENCE_CIRCLE_EXCLUSION + 1))
_POLYGON = frozenset({Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION})


class ServerJudge:
    """Tells what a message is to a session; keeps the item that it judged last in the session.

    Parameters
    ----------
    profile : Profile
        Whose habits decide.
    store : PlanStore
        The vehicle's plans.
    session : ServerSession
        The transfer that runs.
    validator : callable, optional
        Judges each mission item by itself: returns a MAV_MISSION_RESULT, 0 to accept.
    """

    def __init__(
        self,
        profile: Profile,
        store: PlanStore,
        session: ServerSession,
        validator: Validator | None = None,
    ) -> None:
        self.validator = validator
        self.locked = False
        self._profile = profile
        self._store = store
        self._session = session

    def judge(self, message: wire.MissionMessage, sender: tuple[int, int], now_s: float) -> ServerInput:
        """Return the input of the table that a message is in the session's state."""
        if wire.is_item(message):
            return self._judge_item(message, sender)
        if wire.is_request(message):
            return self._judge_request(message, sender)
        if is_a(message, mavlink.MAVLink_mission_ack_message):
            return self._judge_ack(message, sender)
        if wire.is_partial(message):
            return self._judge_partial(message)
        number = type(message).id
        mission_type = wire.plan_type(message.mission_type)
        everything = number == wire.CLEAR and message.mission_type == wire.ALL_TYPES
        if mission_type is None and not everything:
            return _I.BAD_TYPE
        if number == wire.LIST:
            return self._judge_list(sender)
        if (
            self._session.state is SENDING
            and sender == self._session.partner
            and self._session.next >= len(self._session.outgoing)
        ):
            return _I.IMPLIED_END
        if number == wire.CLEAR:
            if everything and not self._profile.clear_all_types:
                return _I.CLEAR_UNSUPPORTED if self._session.state is IDLE else _I.BAD_TYPE
            if self._session.state is not IDLE:
                return _I.CLEAR_BUSY
            locked = self.locked and mission_type == MissionType.MISSION
            return _I.CLEAR_LOCKED if locked else _I.CLEAR
        assert mission_type is not None and is_a(message, mavlink.MAVLink_mission_count_message)
        return self._judge_count(message.count, mission_type, sender, now_s)

    def _judge_count(
        self, number: int, mission_type: MissionType, sender: tuple[int, int], now_s: float
    ) -> ServerInput:
        fits = number <= self._store.capacity[mission_type] + self._store.home_items(mission_type)
        if self._session.state is IDLE:
            if now_s < self._session.held_until_s:
                return _I.COUNT_BUSY
            return _I.COUNT_EMPTY if number == 0 else _I.COUNT if fits else _I.COUNT_TOO_LARGE
        if (
            self._session.state is SENDING
            or sender != self._session.partner
            or mission_type != self._session.type
        ):
            return _I.COUNT_BUSY
        again = not self._session.items or self._profile.restart_on_count
        return _I.COUNT_REPEATED if again and fits and number else _I.COUNT_BUSY

    def _judge_partial(self, message: wire.PartialMessage) -> ServerInput:
        kind = wire.plan_type(message.mission_type)
        if not is_a(message, mavlink.MAVLink_mission_write_partial_list_message) or kind is None:
            return _I.PARTIAL
        if not self._profile.partial_write:
            return _I.PARTIAL
        number = len(self._store.wire_items(kind))
        within = 0 <= message.start_index <= message.end_index <= number
        return _I.WRITE if within else _I.PARTIAL

    def _judge_item(self, message: wire.ItemMessage, sender: tuple[int, int]) -> ServerInput:
        if self._session.state is not RECEIVING:
            return self._judge_late_item(message, sender)
        if sender != self._session.partner:
            return _I.ITEM_FOREIGN
        if message.mission_type != self._session.type:
            return _I.ITEM_WRONG_TYPE
        if message.seq != self._session.expected:
            return _I.ITEM_OUT_OF_ORDER
        self._session.candidate, self._session.verdict = self._read_item(message)
        if self._session.verdict != wire.ACCEPTED:
            return _I.ITEM_REFUSED
        return _I.ITEM_LAST if message.seq == self._session.count - 1 else _I.ITEM_NEXT

    def _judge_late_item(self, message: wire.ItemMessage, sender: tuple[int, int]) -> ServerInput:
        """Tell an echo of the last upload from an item that makes no sense."""
        unexpected = _I.ITEM_UNEXPECTED if self._session.state is IDLE else _I.ITEM_FOREIGN
        ended = self._session.ended
        if ended is None or sender != ended.sender or message.mission_type != ended.mission_type:
            return unexpected
        item = self._item_of(message)
        item = None if item is None else as_stored(item, self._profile)
        if message.seq == ended.sequence and (ended.result != wire.ACCEPTED or item == ended.item):
            return _I.ITEM_REPEATED if self._session.state is IDLE else _I.ITEM_STALE
        if ended.result != wire.ACCEPTED:
            return _I.ITEM_STALE if message.seq < ended.sequence else unexpected
        items = self._store.wire_items(ended.mission_type)
        home = message.seq < self._store.home_items(ended.mission_type)
        same = home or (message.seq < len(items) and item == items[message.seq])
        return _I.ITEM_STALE if same else unexpected

    def _judge_list(self, sender: tuple[int, int]) -> ServerInput:
        if self._session.state is IDLE:
            return _I.LIST_STATELESS if self._profile.stateless_download else _I.LIST
        if sender != self._session.partner:
            return _I.LIST_BUSY
        if self._session.state is SENDING:
            return _I.LIST
        return _I.LIST_BUSY if self._session.items or self._profile.stateless_download else _I.ABANDONED

    def _judge_request(self, message: wire.RequestMessage, sender: tuple[int, int]) -> ServerInput:
        if self._session.state is IDLE:
            mission_type = wire.plan_type(message.mission_type)
            if not self._profile.stateless_download or mission_type is None:
                return _I.REQUEST_UNEXPECTED
            within = message.seq < len(self._store.wire_items(mission_type))
            return _I.REQUEST_STATELESS if within else _I.REQUEST_BEYOND
        if (
            self._session.state is RECEIVING
            or sender != self._session.partner
            or message.mission_type != self._session.type
        ):
            return _I.REQUEST_FOREIGN
        if message.seq >= len(self._session.outgoing):
            return _I.REQUEST_BEYOND
        if self._session.asked_int and type(message).id == wire.REQUEST and self._profile.float_answers:
            return _I.REQUEST_CHANGED
        return _I.REQUEST if message.seq <= self._session.next else _I.REQUEST_JUMP

    def _judge_ack(self, message: wire.AckMessage, sender: tuple[int, int]) -> ServerInput:
        if (
            self._session.state is IDLE
            or sender != self._session.partner
            or message.mission_type != self._session.type
        ):
            return _I.ACK_OTHER
        if message.type == wire.OPERATION_CANCELLED:
            return _I.ACK_CANCEL
        if self._session.state is RECEIVING:
            return _I.ACK_OTHER
        if message.type != wire.ACCEPTED:
            return _I.ACK_ERROR
        return _I.ACK_DONE if self._session.next >= len(self._session.outgoing) else _I.ACK_OTHER

    def _read_item(self, message: wire.ItemMessage) -> tuple[MissionItem | None, int]:
        """Return the item and the verdict on it."""
        if self._store.home_items(self._session.type) and message.seq == 0:
            return MissionItem(Command.NAV_WAYPOINT), int(wire.ACCEPTED)
        verdict = judge_numbers(message, self._profile)
        if verdict != wire.ACCEPTED:
            return None, verdict
        item = self._item_of(message)
        if item is None:
            return None, wire.refusal(message)
        fence, rally = item.command in _FENCE, item.command == Command.NAV_RALLY_POINT
        verdict = judge_item(item, self._session.count, self._profile)
        if verdict == wire.ACCEPTED and (fence, rally) != (
            self._session.type == MissionType.FENCE,
            self._session.type == MissionType.RALLY,
        ):
            verdict = int(wire.ERROR if fence or rally else wire.UNSUPPORTED)
        if verdict == wire.ACCEPTED and item.command in _POLYGON and not (item.param1 or 0.0) >= 3.0:
            verdict = int(wire.ERROR)
        if verdict == wire.ACCEPTED and self.validator is not None:
            verdict = int(self.validator(item))
        return as_stored(item, self._profile), verdict

    def _item_of(self, message: wire.ItemMessage) -> MissionItem | None:
        """Read an item; None when its numbers make no sense and the autopilot would see that."""
        try:
            return wire.item_from_message(message)
        except MissionError:
            return None if self._profile.range_checked else UncheckedItem.of(message)
