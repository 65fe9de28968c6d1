"""One transfer of the vehicle with a ground station, as far as it has come."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from mission.model import MissionItem, MissionType
from mission.transfer import wire
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
