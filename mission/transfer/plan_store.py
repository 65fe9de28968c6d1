"""The plans that a vehicle holds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from mission.autopilots.profile import Profile
from mission.model import GeoPoint, MissionItem, MissionType
from mission.transfer import wire
from mission.transfer.wire import home_items, to_wire_order


@dataclass(frozen=True, slots=True)
class StoredPlan:
    """A plan as the vehicle holds it, with its id (0 for none)."""

    items: tuple[MissionItem, ...] = ()
    opaque_id: int = 0


class PlanStore:
    """The vehicle's three plans, and how they look on the wire.

    Parameters
    ----------
    profile : Profile
        Whether plans have ids, and home is item 0.
    capacity : mapping of MissionType to int, optional
        The most items per plan; default: the profile's.
    home : GeoPoint, optional
        Home, which profiles with a home item show as item 0; assign `home` when it changes.

    Attributes
    ----------
    capacity : dict of MissionType to int
        The most items per plan.
    """

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
