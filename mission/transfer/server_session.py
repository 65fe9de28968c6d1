"""Vehicle's mission server: transition table, plan storage, transfer state and message classification.

Each row of the table maps a state and an input to an action (a refusal, or the method of that name) and the
next state. An input is a timer, or a message classified by sender and state. Sources:
https://mavlink.io/en/services/mission.html and PX4's ``mavlink_mission.cpp``. The profile changes the
classification of messages where ArduPilot differs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from mission.autopilots.profile import Profile
from mission.errors import MissionError
from mission.link.codec.dialect import mavlink
from mission.link.codec.typed import is_a
from mission.model import Command, GeoPoint, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.storage import UncheckedItem, as_stored, validate_item, validate_numbers
from mission.transfer.wire import home_items, to_wire_order


class ServerState(Enum):
    """State of the vehicle's mission server."""

    IDLE = "idle"
    RECEIVING = "receiving a plan"
    SENDING = "sending a plan"


class ServerInput(Enum):
    """Input of the transition table."""

    COUNT = "COUNT that fits"
    COUNT_EMPTY = "COUNT 0"
    COUNT_TOO_LARGE = "COUNT beyond the capacity"
    COUNT_REPEATED = "COUNT again from the partner before item 0 (ArduPilot: at any time)"
    COUNT_BUSY = "COUNT while a transfer runs (PX4: also for a while after COUNT 0)"
    BAD_TYPE = "COUNT, LIST or CLEAR (ArduPilot: any message) of an unknown plan type"
    ITEM_NEXT = "the requested item"
    ITEM_LAST = "the last missing item"
    ITEM_REFUSED = "the requested item, but invalid"
    ITEM_OUT_OF_ORDER = "an item out of order"
    ITEM_WRONG_TYPE = "item of another plan type"
    ITEM_FOREIGN = "item from another ground station"
    ITEM_REPEATED = "the last item of the last upload, again (PX4)"
    ITEM_UNEXPECTED = "unrequested item"
    LIST = "LIST"
    LIST_STATELESS = "LIST (stateless profile)"
    LIST_BUSY = "LIST while another transfer runs"
    REQUEST = "REQUEST of the next item or the last one sent"
    REQUEST_STATELESS = "REQUEST of any item (stateless profile)"
    REQUEST_JUMP = "REQUEST of any other item"
    REQUEST_BEYOND = "REQUEST beyond the plan"
    REQUEST_UNEXPECTED = "REQUEST without a LIST, or of another plan type"
    REQUEST_FOREIGN = "REQUEST from another ground station"
    ACK_DONE = "ACK ACCEPTED from the partner after the last item"
    ACK_CANCEL = "ACK OPERATION_CANCELLED from the partner"
    ACK_ERROR = "any other ACK from the partner"
    ACK_OTHER = "ACK from another ground station, of another type, or too early"
    CLEAR = "CLEAR_ALL"
    CLEAR_UNSUPPORTED = "CLEAR_ALL of all types, which the profile does not support"
    CLEAR_LOCKED = "CLEAR_ALL while the plan is flown (ArduPilot)"
    CLEAR_BUSY = "CLEAR_ALL while a transfer runs"
    PARTIAL = "REQUEST_PARTIAL_LIST or WRITE_PARTIAL_LIST"
    WRITE = "WRITE_PARTIAL_LIST within the plan (ArduPilot)"
    REQUEST_CHANGED = "REQUEST (float) after REQUEST_INT in one download"
    IMPLIED_END = "COUNT or CLEAR_ALL from the partner after the last item was sent"
    ABANDONED = "LIST from the partner before it sent any item"
    RETRY = "re-request timer"
    ABORT = "abort timer"


_I = ServerInput
IDLE, RECEIVING, SENDING = ServerState

SERVER_TABLE: Final[dict[tuple[ServerState, ServerInput], tuple[str, ServerState]]] = {
    # idle
    (IDLE, _I.COUNT): ("ask first", RECEIVING),
    (IDLE, _I.COUNT_EMPTY): ("clear by count", IDLE),
    (IDLE, _I.COUNT_TOO_LARGE): ("refuse space", IDLE),
    (IDLE, _I.COUNT_BUSY): ("refuse busy", IDLE),
    (IDLE, _I.BAD_TYPE): ("refuse type", IDLE),
    (IDLE, _I.ITEM_REPEATED): ("repeat ack", IDLE),
    (IDLE, _I.ITEM_WRONG_TYPE): ("refuse item type", IDLE),
    (IDLE, _I.ITEM_FOREIGN): ("refuse new item", IDLE),
    (IDLE, _I.ITEM_UNEXPECTED): ("refuse unexpected item", IDLE),
    (IDLE, _I.LIST): ("send count", SENDING),
    (IDLE, _I.LIST_STATELESS): ("send count", IDLE),
    (IDLE, _I.REQUEST_STATELESS): ("send item", IDLE),
    (IDLE, _I.REQUEST_BEYOND): ("answer beyond", IDLE),
    (IDLE, _I.REQUEST_UNEXPECTED): ("ignore", IDLE),
    (IDLE, _I.REQUEST_FOREIGN): ("refuse foreign request", IDLE),
    (IDLE, _I.ACK_OTHER): ("ignore", IDLE),
    (IDLE, _I.CLEAR): ("clear", IDLE),
    (IDLE, _I.CLEAR_UNSUPPORTED): ("refuse clear", IDLE),
    (IDLE, _I.CLEAR_LOCKED): ("refuse clear now", IDLE),
    (IDLE, _I.PARTIAL): ("refuse partial", IDLE),
    (IDLE, _I.WRITE): ("ask part", RECEIVING),
    # receiving
    (RECEIVING, _I.COUNT_REPEATED): ("ask first", RECEIVING),
    (RECEIVING, _I.COUNT_BUSY): ("refuse busy", RECEIVING),
    (RECEIVING, _I.BAD_TYPE): ("refuse type", RECEIVING),
    (RECEIVING, _I.ITEM_NEXT): ("take item", RECEIVING),
    (RECEIVING, _I.ITEM_LAST): ("take last item", IDLE),
    (RECEIVING, _I.ITEM_REFUSED): ("refuse item", IDLE),
    (RECEIVING, _I.ITEM_OUT_OF_ORDER): ("answer order", RECEIVING),
    (RECEIVING, _I.ITEM_WRONG_TYPE): ("refuse item type", RECEIVING),
    (RECEIVING, _I.ITEM_FOREIGN): ("refuse foreign item", RECEIVING),
    (RECEIVING, _I.LIST_BUSY): ("refuse list", RECEIVING),
    (RECEIVING, _I.REQUEST_UNEXPECTED): ("refuse request now", RECEIVING),
    (RECEIVING, _I.REQUEST_FOREIGN): ("refuse foreign request", RECEIVING),
    (RECEIVING, _I.ACK_CANCEL): ("end cancelled", IDLE),
    (RECEIVING, _I.ACK_OTHER): ("ignore", RECEIVING),
    (RECEIVING, _I.CLEAR_BUSY): ("refuse clear now", RECEIVING),
    (RECEIVING, _I.PARTIAL): ("ignore", RECEIVING),
    (RECEIVING, _I.WRITE): ("ignore", RECEIVING),
    (RECEIVING, _I.ABANDONED): ("end cancelled", IDLE),
    (RECEIVING, _I.RETRY): ("ask again", RECEIVING),
    (RECEIVING, _I.ABORT): ("abort upload", IDLE),
    # sending
    (SENDING, _I.COUNT_BUSY): ("refuse count now", SENDING),
    (SENDING, _I.BAD_TYPE): ("refuse type", SENDING),
    (SENDING, _I.ITEM_WRONG_TYPE): ("refuse item type", SENDING),
    (SENDING, _I.ITEM_UNEXPECTED): ("refuse item now", SENDING),
    (SENDING, _I.ITEM_FOREIGN): ("refuse foreign item", SENDING),
    (SENDING, _I.LIST): ("send count", SENDING),
    (SENDING, _I.LIST_BUSY): ("refuse list", SENDING),
    (SENDING, _I.REQUEST): ("send item", SENDING),
    (SENDING, _I.REQUEST_CHANGED): ("refuse changed", SENDING),
    (SENDING, _I.REQUEST_JUMP): ("refuse jump", IDLE),
    (SENDING, _I.REQUEST_BEYOND): ("ignore", SENDING),
    (SENDING, _I.REQUEST_UNEXPECTED): ("ignore", SENDING),
    (SENDING, _I.REQUEST_FOREIGN): ("refuse foreign request", SENDING),
    (SENDING, _I.ACK_DONE): ("end sent", IDLE),
    (SENDING, _I.ACK_CANCEL): ("end cancelled", IDLE),
    (SENDING, _I.ACK_ERROR): ("end refused", IDLE),
    (SENDING, _I.ACK_OTHER): ("ignore", SENDING),
    (SENDING, _I.CLEAR_BUSY): ("refuse clear now", SENDING),
    (SENDING, _I.PARTIAL): ("ignore", SENDING),
    (SENDING, _I.IMPLIED_END): ("end sent", IDLE),
    (SENDING, _I.ABORT): ("abort download", IDLE),
}


@dataclass(frozen=True, slots=True)
class StoredPlan:
    """Plan stored on the vehicle, with its opaque id (0 for none)."""

    items: tuple[MissionItem, ...] = ()
    opaque_id: int = 0


class PlanStore:
    """Stores the vehicle's three plans, their capacities, and home, which may be item 0 on the wire."""

    def __init__(
        self,
        profile: Profile,
        capacity: Mapping[MissionType, int] | None = None,
        home: GeoPoint | None = None,
    ) -> None:
        self.home = home
        self.capacity = dict(zip(MissionType, profile.capacity, strict=True)) | dict(capacity or {})
        self._profile = profile
        self._plans = {kind: StoredPlan() for kind in MissionType}
        # The download of a cleared mission has no home item.
        self._cleared = home is None
        self._with_home: tuple[tuple[MissionItem, ...], GeoPoint | None, tuple[MissionItem, ...]] | None = (
            None
        )

    def plan(self, mission_type: MissionType) -> StoredPlan:
        """Return the stored plan without home."""
        return self._plans[mission_type]

    def put(self, mission_type: MissionType, items: tuple[MissionItem, ...]) -> StoredPlan:
        """Store a plan; return the plan with its id."""
        plan = StoredPlan(items, wire.plan_checksum(items) if self._profile.opaque_ids else 0)
        self._plans[mission_type] = plan
        return plan

    def received(self, mission_type: MissionType, items: tuple[MissionItem, ...]) -> tuple[StoredPlan, bool]:
        """Store an uploaded plan; return the plan and whether it differs from the previous plan."""
        before = self._plans[mission_type]
        plan = self.put(mission_type, items)
        self._cleared = False
        changed = plan.opaque_id != before.opaque_id if self._profile.atomic else items != before.items
        return plan, changed

    def clear(self, mission_types: Iterable[MissionType]) -> None:
        """Clear plans."""
        for mission_type in mission_types:
            self._plans[mission_type] = StoredPlan()
            self._cleared |= mission_type == MissionType.MISSION

    def home_items(self, mission_type: MissionType) -> int:
        """Return the number of home items on the wire, 0 or 1."""
        return int(self._profile.home_at_zero and mission_type == MissionType.MISSION)

    def room(self, mission_type: MissionType) -> int:
        """Return the capacity of a plan in items on the wire, with the home item."""
        return self.capacity[mission_type] + self.home_items(mission_type)

    def wire_items(self, mission_type: MissionType) -> tuple[MissionItem, ...]:
        """Return the items that a download of the plan contains, with the home item if there is one."""
        items = self._plans[mission_type].items
        if not self.home_items(mission_type):
            return items
        cached = self._with_home
        if cached is None or cached[0] is not items or cached[1] is not self.home:
            cached = (items, self.home, to_wire_order(items, mission_type, self._profile, self.home))
            self._with_home = cached
        if not items and not self._cleared and self.home is not None:
            return home_items(self.home)
        return cached[2]


@dataclass(slots=True)
class ServerSession:
    """State of the current or the last transfer."""

    state: ServerState = IDLE
    partner: tuple[int, int] = (0, 0)
    type: MissionType = MissionType.MISSION
    count: int = 0  # upload: number of items on the wire.
    first: int = 0  # upload: first item of a partial upload.
    part: bool = False  # upload: whether only a part of the plan is replaced.
    items: list[MissionItem] = field(default_factory=list)  # upload: received items.
    cut: bool = False  # upload: whether a smaller COUNT has already truncated the stored plan.
    start: int | None = None  # upload: item marked as current.
    candidate: MissionItem | None = None  # upload: last received item.
    verdict: int = int(wire.ACCEPTED)  # upload: MAV_MISSION_RESULT for `candidate`.
    outgoing: tuple[MissionItem, ...] = ()  # download: items to send.
    next: int = 0  # download: highest requested item plus one.
    asked_int: bool = False  # download: whether MISSION_REQUEST_INT was used.
    warned: bool = False  # Whether the warning about deprecated float messages was sent.
    heard_s: float = 0.0  # Time of the partner's last message.
    asked_s: float = 0.0  # Time of the last request for an item.
    held_until_s: float = -1.0  # Time until which COUNT is refused after an empty COUNT.
    ended: int | None = None  # number of the last item of the last upload, if the plan was accepted.

    @property
    def expected(self) -> int:
        """Upload: number of the item that the vehicle requests next."""
        return self.first + len(self.items)

    @property
    def all_sent(self) -> bool:
        """Download: whether every item was requested."""
        return self.next >= len(self.outgoing)

    def is_with(self, sender: tuple[int, int], mission_type: int) -> bool:
        """Whether a transfer of this plan type with this ground station is in progress."""
        return self.state is not IDLE and sender == self.partner and mission_type == self.type


Validator = Callable[[MissionItem], int]
_FENCE = frozenset(range(Command.NAV_FENCE_RETURN_POINT, Command.NAV_FENCE_CIRCLE_EXCLUSION + 1))
_POLYGON = frozenset({Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION})


class ServerInputs:
    """Base class of the server, which classifies messages as inputs of the transition table."""

    def __init__(self, profile: Profile, store: PlanStore, validator: Validator | None) -> None:
        self.profile = profile
        self.validator = validator
        self.locked = False
        self._store = store
        self._session = ServerSession()

    def _input_of(self, message: wire.MissionMessage, sender: tuple[int, int], now_s: float) -> ServerInput:
        """Classify a message as an input of the transition table."""
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
        if self.profile.stateless_download and wire.plan_type(message.mission_type) is None:
            return _I.BAD_TYPE
        if sender != session.partner:
            return _I.ITEM_FOREIGN
        if message.mission_type != session.type:
            return _I.ITEM_WRONG_TYPE
        if session.state is not RECEIVING:
            again = session.state is IDLE and message.seq == session.ended and self.profile.repeats_ack
            return _I.ITEM_REPEATED if again else _I.ITEM_UNEXPECTED
        if message.seq != session.expected:
            return _I.ITEM_OUT_OF_ORDER
        session.candidate, session.verdict = self._read_item(message)
        if session.verdict != wire.ACCEPTED:
            return _I.ITEM_REFUSED
        return _I.ITEM_LAST if message.seq == session.count - 1 else _I.ITEM_NEXT

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
        if self.profile.stateless_download and session.state is IDLE:
            mission_type = wire.plan_type(message.mission_type)
            if mission_type is None:
                return _I.BAD_TYPE
            within = message.seq < len(self._store.wire_items(mission_type))
            return _I.REQUEST_STATELESS if within else _I.REQUEST_BEYOND
        if sender != session.partner:
            return _I.REQUEST_FOREIGN
        if session.state is not SENDING or message.mission_type != session.type:
            return _I.REQUEST_UNEXPECTED
        if session.asked_int and type(message).id == wire.REQUEST and self.profile.float_answers:
            return _I.REQUEST_CHANGED
        if message.seq >= len(session.outgoing):
            return _I.REQUEST_BEYOND
        return _I.REQUEST if session.next - 1 <= message.seq <= session.next else _I.REQUEST_JUMP

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
        """Return the item of a message, and the MAV_MISSION_RESULT for the item."""
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
        """Return the item of a message, or None if a number is invalid and the autopilot checks numbers."""
        try:
            return wire.item_from_message(message)
        except MissionError:
            return None if self.profile.range_checked else UncheckedItem.of(message)
