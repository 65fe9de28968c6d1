"""Which items of a mission lead to which: what is never flown, and what never ends."""

from __future__ import annotations

from collections.abc import Sequence

from mission.model import Command, MissionItem

__all__ = ["LANDINGS", "LAST_NAV", "TAKEOFFS", "followers", "never_ends", "reachable"]

_ENDINGS = frozenset({int(Command.NAV_RETURN_TO_LAUNCH), int(Command.NAV_LOITER_UNLIM)})
TAKEOFFS = frozenset({int(Command.NAV_TAKEOFF), 84})
LANDINGS = frozenset({int(Command.NAV_LAND), 85})
LAST_NAV = 95
"""Commands up to it are NAV commands (MAV_CMD)."""


def followers(items: Sequence[MissionItem], seq: int) -> tuple[int, ...]:
    """Return the items that may follow item ``seq``, counted from 0; ``len(items)`` is the end.

    After a landing only a take-off goes on. Jumps to nowhere lead nowhere.
    """
    item = items[seq]
    if item.command in _ENDINGS:
        return ()
    if item.command in LANDINGS:
        later = (k for k in range(seq + 1, len(items)) if items[k].command <= LAST_NAV)
        following = next(later, None)
        goes_on = following is not None and items[following].command in TAKEOFFS
        return (seq + 1,) if goes_on else (len(items),)
    if item.command == Command.DO_JUMP:
        target, repeat = item.param1 or 0.0, item.param2 or 0.0
        inside = target == int(target) and 0.0 <= target < len(items)
        jumps = (int(target),) if inside and repeat != 0.0 else ()
        return (*jumps, seq + 1) if repeat >= 0.0 else jumps
    return (seq + 1,)


def reachable(items: Sequence[MissionItem]) -> frozenset[int]:
    """Return the items that are flown at some time, and ``len(items)`` if the mission comes to its end.

    It begins at item 0, and at every DO_LAND_START, where a return may enter.

    Examples
    --------
    >>> there = MissionItem.waypoint(28.05, -82.15, 10.0)
    >>> sorted(reachable([there, MissionItem(Command.NAV_RETURN_TO_LAUNCH), there]))
    [0, 1]
    """
    open_ = [0, *(k for k, one in enumerate(items) if one.command == Command.DO_LAND_START)] if items else []
    seen: set[int] = set()
    while open_:
        seq = open_.pop()
        if seq in seen:
            continue
        seen.add(seq)
        if seq < len(items):
            open_ += followers(items, seq)
    return frozenset(seen)


def never_ends(items: Sequence[MissionItem]) -> bool:
    """Return whether jumps go round for ever: nothing that is flown ends the mission.

    Examples
    --------
    >>> there = MissionItem.waypoint(28.05, -82.15, 10.0)
    >>> never_ends([there, MissionItem(Command.DO_JUMP, param1=0.0, param2=-1.0)])
    True
    """
    seen = reachable(items)
    ends = any(seq < len(items) and items[seq].command in _ENDINGS for seq in seen)
    return bool(items) and len(items) not in seen and not ends
