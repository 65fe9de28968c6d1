"""One transfer of the vehicle with a ground station, as far as it has come."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from mission.autopilots.profile import Profile
from mission.link.codec.dialect import mavlink
from mission.model import MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.events import NOTHING, Event, Output, StatusText
from mission.transfer.plan_store import PlanStore
from mission.transfer.server_table import IDLE, ServerState


class EndedUpload(NamedTuple):
    """How the last upload ended, to know echoes of it.

    Parameters
    ----------
    sender : tuple of int
        Who sent it.
    mission_type : MissionType
        Which plan.
    sequence : int
        The item that ended it.
    item : MissionItem or None
        What was kept of that item.
    result : int
        The MAV_MISSION_RESULT that was answered.
    """

    sender: tuple[int, int]
    mission_type: MissionType
    sequence: int
    item: MissionItem | None
    result: int


@dataclass(slots=True)
class ServerSession:
    """What the server remembers of the transfer that runs, or of the last one.

    Parameters
    ----------
    state : ServerState
        What the server is doing.
    partner : tuple of int
        System and component id of the other side.
    type : MissionType
        Which plan.
    count, first : int
        Upload: items on the wire, and the first one that is sent (above 0 in a partial upload).
    part : bool
        Upload: whether it replaces a part of the plan.
    items : list of MissionItem
        Upload: what has come.
    cut : bool
        Upload: whether a smaller count has shortened the plan already.
    start : int or None
        Upload: the item marked as current.
    candidate, verdict : MissionItem or None, int
        Upload: the item judged last, and the MAV_MISSION_RESULT for it.
    outgoing : tuple of MissionItem
        Download: what is sent.
    next : int
        Download: one more than the highest item that was asked for.
    asked_int : bool
        Download: whether MISSION_REQUEST_INT was used.
    warned : bool
        Whether the float messages were complained about.
    heard_s, asked_s : float
        When the partner was heard, and when an item was asked for.
    held_until_s : float
        Until when a COUNT is refused after an empty one.
    ended : EndedUpload or None
        The last upload.
    """

    state: ServerState = IDLE
    partner: tuple[int, int] = (0, 0)
    type: MissionType = MissionType.MISSION
    count: int = 0
    first: int = 0
    part: bool = False
    items: list[MissionItem] = field(default_factory=list)
    cut: bool = False
    start: int | None = None
    candidate: MissionItem | None = None
    verdict: int = int(wire.ACCEPTED)
    outgoing: tuple[MissionItem, ...] = ()
    next: int = 0
    asked_int: bool = False
    warned: bool = False
    heard_s: float = 0.0
    asked_s: float = 0.0
    held_until_s: float = -1.0
    ended: EndedUpload | None = None

    @property
    def expected(self) -> int:
        """Upload: the number of the item that is asked for."""
        return self.first + len(self.items)


_WARNING = mavlink.MAV_SEVERITY_WARNING
_Sender = tuple[int, int]


class ServerReplies:
    """Acknowledges and refuses.

    Parameters
    ----------
    profile : Profile
        Whose results and texts to use.
    store : PlanStore
        The vehicle's plans, for their ids and capacities.
    session : ServerSession
        The transfer that runs; only read.
    """

    def __init__(self, profile: Profile, store: PlanStore, session: ServerSession) -> None:
        self._profile = profile
        self._store = store
        self._session = session

    def ack(self, result: int, mission_type: int, target: _Sender, *events: Event) -> Output:
        """A MISSION_ACK, with the plan's id where it is accepted."""
        plan = wire.plan_type(mission_type)
        opaque_id = self._store.plan(plan).opaque_id if plan is not None and result == wire.ACCEPTED else 0
        return Output((wire.ack(target, result, mission_type, opaque_id),), events)

    def status(self, text: str) -> StatusText:
        """A warning, as this autopilot begins its texts."""
        return StatusText(self._session.type, _WARNING, self._profile.text_prefix + text)

    def warn_of_floats(
        self, text: str, message: wire.ItemMessage | wire.RequestMessage, old: int
    ) -> tuple[Event, ...]:
        """ArduPilot complains once a transfer about messages of the old kind ``old``."""
        if self._session.warned or type(message).id != old or not self._profile.stateless_download:
            return ()
        self._session.warned = True
        return (StatusText(self._session.type, _WARNING, text),)

    def repeat_ack(self) -> Output:
        """The answer to the last upload, once more."""
        ended = self._session.ended
        assert ended is not None
        return self.ack(ended.result, ended.mission_type, ended.sender)

    def say_busy(self) -> Output:
        """A warning, and no answer."""
        return Output(events=(self.status("IGN. CMD: Busy"),))

    def refuse_busy(self, message: wire.MissionMessage, sender: _Sender) -> Output:
        """A transfer is running."""
        return self.ack(
            self._profile.busy_result, message.mission_type, sender, self.status("REJ. CMD: Busy")
        )

    def refuse_type(self, message: wire.MissionMessage, sender: _Sender) -> Output:
        """No such kind of plan."""
        return self.ack(self._profile.type_result, message.mission_type, sender)

    def refuse_space(self, message: wire.CountMessage, sender: _Sender) -> Output:
        """Too many items."""
        mission_type = MissionType(message.mission_type)
        room = self._store.capacity[mission_type] + self._store.home_items(mission_type)
        text = self._profile.space_text
        said = () if text is None else (StatusText(mission_type, _WARNING, text.format(room)),)
        return self.ack(wire.NO_SPACE, mission_type, sender, *said)

    def refuse_partial(self, message: wire.PartialMessage, sender: _Sender) -> Output:
        """No partial lists."""
        if self._profile.partial_result is None:
            return NOTHING
        return self.ack(self._profile.partial_result, message.mission_type, sender)

    def refuse_list(self, message: wire.MissionMessage, sender: _Sender) -> Output:
        """A download while another transfer is running."""
        if self._profile.busy_result == wire.DENIED:
            return self.ack(wire.DENIED, message.mission_type, sender)
        return self.say_busy()

    def refuse_unexpected_item(self, message: wire.ItemMessage, sender: _Sender) -> Output:
        """An item, and no upload is running."""
        said = self.status("REJ. item: no transfer is running")
        return self.ack(wire.ERROR, message.mission_type, sender, said)

    def refuse_item_type(self, message: wire.ItemMessage, sender: _Sender) -> Output:
        """An item of another plan than the one that is uploaded."""
        return self.ack(wire.ERROR, message.mission_type, sender)

    def refuse_foreign_item(self, message: wire.ItemMessage, sender: _Sender) -> Output:
        """An item of another station: PX4 says so and sends nothing; ArduPilot answers."""
        return self.refuse_list(message, sender)

    def answer_order(self, sender: _Sender) -> Output:
        """An item out of order."""
        if self._profile.order_result is None:
            return NOTHING
        return self.ack(self._profile.order_result, self._session.type, sender)

    def refuse_request(self, message: wire.RequestMessage, sender: _Sender) -> Output:
        """A request, and no download is running."""
        said = self.status("REJ. request: no LIST before it")
        return self.ack(wire.ERROR, message.mission_type, sender, said)

    def refuse_request_now(self, message: wire.RequestMessage, sender: _Sender) -> Output:
        """A request while an upload is running."""
        if self._profile.stateless_download:
            return self.ack(wire.DENIED, message.mission_type, sender)
        return NOTHING

    def refuse_changed(self, message: wire.RequestMessage, sender: _Sender) -> Output:
        """MISSION_REQUEST after MISSION_REQUEST_INT in one download."""
        said = self.status("REJ. MISSION_REQUEST after _INT")
        return self.ack(wire.ERROR, message.mission_type, sender, said)

    def refuse_clear(self, message: wire.MissionMessage, sender: _Sender) -> Output:
        """Plans that this autopilot does not clear."""
        return self.ack(wire.UNSUPPORTED, message.mission_type, sender)

    def refuse_clear_now(self, message: wire.MissionMessage, sender: _Sender) -> Output:
        """A plan in use."""
        if self._profile.busy_result == wire.DENIED:
            return self.ack(wire.ERROR, message.mission_type, sender)
        return self.say_busy()
