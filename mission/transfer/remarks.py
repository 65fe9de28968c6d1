"""Remarks on items of a plan that an autopilot would refuse, change or ignore."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mission.autopilots.dialect import Severity
from mission.autopilots.profile import Profile
from mission.model import GLOBAL_FRAMES, Command, Mission, MissionItem, MissionType
from mission.transfer.wire import command_name, enum_name

_POLYGON = frozenset({5001, 5002})
_CIRCLES = frozenset({5003, 5004})


@dataclass(frozen=True, slots=True)
class Remark:
    """Remark on an item or a whole plan: a problem for an autopilot, or a change made for the autopilot.

    Parameters
    ----------
    item : int or None
        Number of the (first) item in the original plan, from 0 (users count from 1); None for the whole plan.
    text : str
        Problem, or change that is made.
    fix : str
        Alternative that the autopilot accepts, or empty if the user need not change anything.
    command : int or None
        MAV_CMD of the item.
    others : tuple of int
        Further items with the same remark.
    parameter : str
        Vehicle parameter that causes the problem, empty if none.

    Examples
    --------
    >>> print(Remark(MissionType.MISSION, 4, Severity.ERROR, "PX4 does not know it", "leave it out", 18))
    mission item 5 (NAV_LOITER_TURNS): PX4 does not know it; leave it out
    """

    plan: MissionType
    item: int | None
    severity: Severity
    text: str
    fix: str = ""
    command: int | None = None
    others: tuple[int, ...] = ()
    parameter: str = ""

    @property
    def count(self) -> int:
        """Number of items with this remark."""
        return 1 + len(self.others)

    def summary(self) -> dict[str, Any]:
        """Return the remark as JSON values; items are numbered from 1."""
        return {
            "plan": self.plan.name.lower(),
            "item": None if self.item is None else self.item + 1,
            "command": None if self.command is None else command_name(self.command),
            "count": self.count,
            "parameter": self.parameter or None,
            "severity": self.severity.value,
            "text": self.text,
            "fix": self.fix,
        }

    def __str__(self) -> str:
        where = self.plan.name.lower()
        if self.item is not None:
            where += f" item {self.item + 1}"
        if self.command is not None:
            where += f" ({command_name(self.command)})"
        if self.count > 1:
            where += f" and {self.count - 1} more"
        return f"{where}: {self.text}" + (f"; {self.fix}" if self.fix else "")


def area_remarks(mission: Mission, profile: Profile) -> list[Remark]:
    """Return remarks on invalid fence and rally items, and on frames that the autopilot refuses.

    An unknown autopilot is assumed to accept all items.
    """
    if profile.placed is None:
        return []
    kinds = (MissionType.FENCE, MissionType.RALLY)
    return [
        Remark(kind, k, Severity.ERROR, text, fix, mission.plan(kind)[k].command)
        for kind in kinds
        for k, text, fix in zone_problems(mission.plan(kind), profile)
    ]


def zone_problems(items: tuple[MissionItem, ...], profile: Profile) -> list[tuple[int, str, str]]:
    """Return the item number, the text and the fix of each problem in a fence or rally plan."""
    allowed = profile.frames or GLOBAL_FRAMES
    found = []
    due = 0  # index of the next polygon's first corner
    for k, item in enumerate(items):
        if item.frame not in allowed or not item.has_position:
            text = f"{profile.name} does not take frame {frame_name(item.frame)}"
            found.append((k, text, "give frame 3 (above home) or 0 (above sea level)"))
        if item.command in _CIRCLES and not (item.param1 or 0.0) > 0.0:
            found.append((k, f"a circle of radius {item.param1 or 0.0:g} m", "give a radius above 0 m"))
        if item.command == Command.NAV_FENCE_RETURN_POINT and any(
            before.command == item.command for before in items[:k]
        ):
            found.append((k, "a second return point", "give one return point"))
        if item.command not in _POLYGON or k < due:
            continue
        corners = int(item.param1 or 0.0)
        due = k + 1
        kind = item.command, item.param1
        while due < min(k + corners, len(items)) and (items[due].command, items[due].param1) == kind:
            due += 1
        if corners < 3 or due - k < corners:
            text = f"a polygon of {corners} corners (param1), of which {due - k} follow each other"
            found.append((k, text, "give three or more corners, and their number as param1 of each"))
    return found


def count_remarks(
    mission: Mission, sent: int, profile: Profile, parameters: Mapping[str, float]
) -> list[Remark]:
    """Return remarks on plans with more items than the autopilot, or many of its boards, can store."""
    found = []
    for kind in MissionType:
        count = sent if kind is MissionType.MISSION else len(mission.plan(kind))
        fix = longer_plan_fix(count, kind, profile)
        most, warning = profile.most(kind), count_warning(profile, kind, count)
        room = _room(profile, parameters) if kind is MissionType.MISSION else None
        if count > most:
            text = f"{count} items: {profile.name} holds at most {most}"
            found.append(Remark(kind, None, Severity.ERROR, text, fix))
        elif room is not None and count > room[0]:
            text = f"{count} items: this {profile.name} holds at most {room[0]} ({room[1]})"
            found.append(Remark(kind, None, Severity.ERROR, text, fix))
        elif warning is not None and (room is None or room[2]):
            found.append(Remark(kind, None, Severity.WARNING, warning, fix))
    return found


def _room(profile: Profile, parameters: Mapping[str, float]) -> tuple[int, str, bool] | None:
    """Return the limit of mission items, its reason, and whether the actual limit may be lower."""
    card = profile.card
    if card is None or card.parameter not in parameters:
        return None
    kib = parameters[card.parameter]
    most = profile.room(MissionType.MISSION, kib) if kib > 0.0 else card.largest_board - profile.home_at_zero
    return most, f"{card.parameter} {kib:g}", kib <= 0.0


def longer_plan_fix(count: int, mission_type: MissionType, profile: Profile) -> str:
    """Return advice for the user if a plan has more items than the vehicle can store.

    >>> from mission.autopilots import ARDUPILOT
    >>> longer_plan_fix(700, MissionType.MISSION, ARDUPILOT)
    'set BRD_SD_MISSION to 11 and restart the vehicle, or fly the mission in parts'
    """
    if mission_type is not MissionType.MISSION:
        return "send a shorter plan"
    card, parts = profile.card, "fly the mission in parts"
    kib = None if card is None else card.kib_for(count + profile.home_at_zero)
    if card is None or kib is None:
        return parts
    return f"set {card.parameter} to {kib} and restart the vehicle, or {parts}"


def frame_name(frame: int) -> str:
    """Return the number and the name of a MAV_FRAME as text.

    >>> frame_name(10)
    '10 (GLOBAL_TERRAIN_ALT)'
    """
    name = enum_name("MAV_FRAME", frame, "").removeprefix("MAV_FRAME_")
    return f"{frame} ({name})" if name else str(frame)


def count_warning(profile: Profile, mission_type: MissionType, number: int) -> str | None:
    """Return a warning if common boards of the autopilot store fewer than ``number`` items, else None.

    >>> from mission.autopilots import PX4
    >>> count_warning(PX4, MissionType.MISSION, 501)
    '501 mission items: many PX4 boards hold only 500'
    """
    limit = profile.usual_limits[mission_type]
    if limit is None or number <= limit:
        return None
    card = " without an SD card" if mission_type in profile.cards else ""
    return f"{number} {mission_type.name.lower()} items: many {profile.name} boards hold only {limit}{card}"
