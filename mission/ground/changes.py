"""Changes of the mission of a vehicle in flight, by the safest method for its autopilot."""

from __future__ import annotations

import math
from dataclasses import replace

from mission.errors import MissionError
from mission.ground.change import ChangeRecord, ChangeRequest, ChangeSession, FailsafeGuard
from mission.ground.change_aside import AsideChange
from mission.ground.change_whole import WholeListChange
from mission.ground.contact import Contact
from mission.ground.items import FLOWN_TO, is_return, leads_home
from mission.link.codec.dialect import Message
from mission.model import Mission, MissionType
from mission.transfer import check_plan, refuse_errors, render

_FARTHEST_DEG = 1.0
_HIGHEST_M = 10_000.0
_SESSIONS = {False: WholeListChange, True: AsideChange}


class MissionChanges:
    """Changes of the mission of a vehicle in flight, one after the other, sans-IO.

    `held` is the mission that the vehicle is believed to hold. `records` has the outcome of each change.
    """

    def __init__(self, contact: Contact, held: Mission) -> None:
        self.held = held
        self.records: list[ChangeRecord] = []
        self.parameters_set: list[str] = []  # Vehicle parameters that were set, with old and new value.
        self.changed_s = -math.inf  # Time at which a change last started or ended.
        self.broken_off = False  # Whether the vehicle's mission is unknown, because a change was aborted.
        self._contact = contact
        self._session: ChangeSession | None = None
        self._guard: FailsafeGuard | None = None

    @property
    def running(self) -> bool:
        """Whether a change is in progress."""
        return self._session is not None and not self._session.done

    @property
    def aside(self) -> bool:
        """Whether the vehicle leaves the mission mode during a change."""
        return self._contact.monitor.vehicle_type in (self._contact.profile.change_modes or {})

    def begin(self, mission: Mission, resume_at: int, seconds_an_item: float, now_s: float) -> list[Message]:
        """Begin a change; the vehicle resumes at item ``resume_at``. Raises like `GroundStation.change`."""
        contact, held = self._contact, self.held
        rendered = render(mission, contact.profile, contact.monitor.vehicle_type)
        refuse_errors(rendered)
        mission, resume_at = rendered.mission, rendered.index_of(resume_at)
        check_change(mission, resume_at, held)
        item = contact.monitor.state.item
        needed = contact.profile.change_failsafe.get(contact.monitor.vehicle_type, ())
        if self._guard is None and needed:
            # One guard serves the whole flight.
            self._guard = FailsafeGuard(needed, contact, self.parameters_set)
        request = ChangeRequest(
            old=held,
            new=replace(mission, home=held.home, fence=held.fence, rally=held.rally),
            item=0 if item is None else min(item, len(held.items) - 1),
            resume_at=resume_at,
            contact=contact,
            seconds_an_item=seconds_an_item,
            guard=self._guard,
        )
        self._session, self.changed_s = _SESSIONS[self.aside](request), now_s
        return self._noted(self._session.start(now_s))

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Handle a message that the monitor has handled; messages matter even after the end of a change."""
        return [] if self._session is None else self._noted(self._session.receive(message, now_s))

    def poll(self, now_s: float) -> list[Message]:
        """Return the messages of the last change that are due."""
        if self._session is None or now_s < self._session.next_deadline():
            return []
        return self._noted(self._session.poll(now_s))

    def next_deadline(self) -> float:
        """Return the time of the next timeout in the last change; infinity if there is none."""
        return math.inf if self._session is None else self._session.next_deadline()

    def drop(self) -> None:
        """Abort the change in progress, because the operator orders the vehicle out of its mission."""
        self.broken_off |= self.running
        self._session = None

    def _noted(self, out: list[Message]) -> list[Message]:
        """Record the outcome of an ended change."""
        session = self._session
        if session is not None and session.done and not any(r is session.record for r in self.records):
            self.records.append(session.record)
            self.held, self.changed_s = session.held, session.record.ended_s
        return out


def check_change(new: Mission, resume_at: int, old: Mission) -> None:
    """Raise an error unless a mission may be sent to a vehicle in flight; PX4 itself checks no ranges.

    Raises MissionError if the item at which to resume does not exist or has no position, if a position is too
    high or too far from home, or if only the old mission leads home. Raises the error of `check_plan`, too.

    >>> from mission.model import MissionItem
    >>> there = Mission((MissionItem.waypoint(28.05, -82.15, 10.0),))
    >>> check_change(there, 1, there)
    Traceback (most recent call last):
        ...
    mission.errors.MissionError: mission: item 2, at which to resume, does not exist (items: 1)
    """
    items = new.items
    check_plan(items, MissionType.MISSION)
    if not 0 <= resume_at < len(items):
        msg = f"mission: item {resume_at + 1}, at which to resume, does not exist (items: {len(items)})"
        raise MissionError(msg)
    target = items[resume_at]
    if not (is_return(target) or (target.command in FLOWN_TO and target.has_position)):
        msg = f"mission: item {resume_at + 1}, at which to resume, has no position (command {target.command})"
        raise MissionError(msg)
    if leads_home(old.items) and not leads_home(items, resume_at):
        end = "end with NAV_RETURN_TO_LAUNCH or NAV_LAND"
        raise MissionError(f"mission: nothing after item {resume_at + 1} leads home; {end}")
    home = old.home
    for k, item in enumerate(items):
        if not item.has_position or item.x == item.y == 0.0:
            continue
        if abs(item.z) > _HIGHEST_M:
            limit = f"in flight, the limit is {_HIGHEST_M:g} m"
            raise MissionError(f"mission: item {k + 1} is {item.z:g} m high; {limit}")
        if (
            home is not None
            and max(abs(item.x - home.latitude_deg), abs(item.y - home.longitude_deg)) > _FARTHEST_DEG
        ):
            msg = f"mission: item {k + 1} is more than {_FARTHEST_DEG:g} degree from home; give it in degrees"
            raise MissionError(msg)
