"""What a vehicle remembers: the plans that it holds, and the transfer that runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from mission.autopilots.profile import Profile
from mission.model import GeoPoint, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.server_table import IDLE, ServerState
from mission.transfer.wire import home_items, to_wire_order


@dataclass(frozen=True, slots=True)
class StoredPlan:
    """A plan as the vehicle holds it, with its id (0 for none)."""

    items: tuple[MissionItem, ...] = ()
    opaque_id: int = 0


class PlanStore:
    """The vehicle's three plans, how many items each may have, and how they look on the wire."""

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
        # A mission that was cleared shows no home either.
        self._cleared = home is None
        self._with_home: tuple[tuple[MissionItem, ...], GeoPoint | None, tuple[MissionItem, ...]] | None = (
            None
        )

    def plan(self, mission_type: MissionType) -> StoredPlan:
        """Return the plan in force, without home."""
        return self._plans[mission_type]

    def put(self, mission_type: MissionType, items: tuple[MissionItem, ...]) -> StoredPlan:
        """Put a plan in force and return it with its id."""
        plan = StoredPlan(items, wire.plan_checksum(items) if self._profile.opaque_ids else 0)
        self._plans[mission_type] = plan
        return plan

    def received(self, mission_type: MissionType, items: tuple[MissionItem, ...]) -> tuple[StoredPlan, bool]:
        """Put a plan of a ground station in force; tell also whether it differs from the one before."""
        before = self._plans[mission_type]
        plan = self.put(mission_type, items)
        self._cleared = False
        changed = plan.opaque_id != before.opaque_id if self._profile.atomic else items != before.items
        return plan, changed

    def clear(self, mission_types: Iterable[MissionType]) -> None:
        """Empty plans."""
        for mission_type in mission_types:
            self._plans[mission_type] = StoredPlan()
            self._cleared |= mission_type == MissionType.MISSION

    def home_items(self, mission_type: MissionType) -> int:
        """Return how many items home takes on the wire: 0 or 1."""
        return int(self._profile.home_at_zero and mission_type == MissionType.MISSION)

    def room(self, mission_type: MissionType) -> int:
        """Return how many items of a plan fit on the wire."""
        return self.capacity[mission_type] + self.home_items(mission_type)

    def wire_items(self, mission_type: MissionType) -> tuple[MissionItem, ...]:
        """Return the items of a download."""
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


class EndedUpload(NamedTuple):
    """How the last upload ended, to know echoes of it: by which item, what was kept of it, the answer."""

    sender: tuple[int, int]
    mission_type: MissionType
    sequence: int
    item: MissionItem | None
    result: int


@dataclass(slots=True)
class ServerSession:
    """What the server remembers of the transfer that runs, or of the last one."""

    state: ServerState = IDLE
    partner: tuple[int, int] = (0, 0)
    type: MissionType = MissionType.MISSION
    # count, first: upload: items on the wire, and the first one that is sent (above 0 in a partial upload)
    count: int = 0
    first: int = 0
    part: bool = False  # Upload: whether it replaces a part of the plan
    items: list[MissionItem] = field(default_factory=list)  # Upload: what has come
    cut: bool = False  # Upload: whether a smaller count has shortened the plan already
    start: int | None = None  # Upload: the item marked as current
    # candidate, verdict: upload: the item validated last, and the MAV_MISSION_RESULT for it
    candidate: MissionItem | None = None
    verdict: int = int(wire.ACCEPTED)
    outgoing: tuple[MissionItem, ...] = ()  # Download: what is sent
    next: int = 0  # Download: one more than the highest item that was asked for
    asked_int: bool = False  # Download: whether MISSION_REQUEST_INT was used
    warned: bool = False  # Whether the float messages were complained about
    heard_s: float = 0.0  # heard_s, asked_s: when the partner was heard, and when an item was asked for
    asked_s: float = 0.0
    held_until_s: float = -1.0  # Until when a COUNT is refused after an empty one
    ended: EndedUpload | None = None

    @property
    def expected(self) -> int:
        """Upload: the number of the item that is asked for."""
        return self.first + len(self.items)

    @property
    def all_sent(self) -> bool:
        """Download: whether every item was asked for."""
        return self.next >= len(self.outgoing)

    def is_with(self, sender: tuple[int, int], mission_type: int) -> bool:
        """Tell whether a transfer of this plan runs with this partner."""
        return self.state is not IDLE and sender == self.partner and mission_type == self.type
