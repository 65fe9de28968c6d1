"""Losses of a mission that is written to a file and read back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

from mission.model import GeoPoint, Mission, MissionItem

_PLANS = {"items": "mission item", "fence": "fence item", "rally": "rally point"}
_FIELDS = {
    **{name: name for name in ("command", "frame", "param1", "param2", "param3", "param4", "autocontinue")},
    "x": "latitude or parameter 5",
    "y": "longitude or parameter 6",
    "z": "altitude or parameter 7",
}
_MOST_SHOWN = 5
_SAME_PLACE_DEG = 1e-7  # The resolution of MAVLink


@dataclass(frozen=True, slots=True)
class Loss:
    """Description of a part of a mission that a file does not keep."""

    text: str
    changes_flight: bool = False


def differences(mission: Mission, kept: Mission) -> list[Loss]:
    """Return the differences between a mission and `kept`, the mission read back from its file."""
    found = [loss for name in _PLANS for loss in _of_plan(name, getattr(mission, name), getattr(kept, name))]
    if not _are_near(mission.home, kept.home):
        found.append(Loss(f"home, which is {_shown(mission.home)}, is written as {_shown(kept.home)}"))
    names = ("cruise_speed_m_s", "hover_speed_m_s")
    if any(getattr(mission, name) != getattr(kept, name) for name in names):
        found.append(Loss("the speeds for estimates of time are not kept"))
    return found


def dropped(what: str, count: int, of: int) -> list[Loss]:
    """Return the loss of `count` out of `of` items; an empty list if `count` is 0.

    >>> dropped("fence item", 4, 4)[0].text
    'fence items are not kept (4 of 4)'
    """
    return [Loss(f"{what}s are not kept ({count} of {of})", True)] if count else []


def _of_plan(name: str, before: Sequence[MissionItem], after: Sequence[MissionItem]) -> list[Loss]:
    what = _PLANS[name]
    if len(before) != len(after):
        return dropped(what, len(before) - len(after), len(before))
    changed: dict[Loss, list[int]] = {}
    for number, (old, new) in enumerate(zip(before, after, strict=True), 1):
        for field in _FIELDS if old != new else ():
            if getattr(old, field) != getattr(new, field) and (name == "items" or field != "autocontinue"):
                changed.setdefault(_change(field, old, new), []).append(number)
    return [Loss(f"{loss.text} ({numbered(what, at)})", loss.changes_flight) for loss, at in changed.items()]


def _change(field: str, old: MissionItem, new: MissionItem) -> Loss:
    was, is_now = getattr(old, field), getattr(new, field)
    if field == "frame" and not old.has_position:
        return Loss("commands without a position are written in frame 2, which changes nothing")
    if was is None:
        return Loss(f"an unset {field} is written as {is_now:g}")
    return Loss(f"{_FIELDS[field]} is not kept", True)


def numbered(what: str, numbers: Sequence[int]) -> str:
    """Return a text with the numbers of up to five items.

    >>> numbered("mission item", [1, 2, 5, 6, 7, 9, 10]), numbered("rally point", [2])
    ('mission items 1, 2, 5, 6, 7 and 2 more', 'rally point 2')
    """
    shown = ", ".join(str(number) for number in islice(numbers, _MOST_SHOWN))
    more = len(numbers) - _MOST_SHOWN
    return f"{what}{'s' if len(numbers) > 1 else ''} {shown}" + (f" and {more} more" if more > 0 else "")


def _are_near(home: GeoPoint | None, kept: GeoPoint | None) -> bool:
    if home is None or kept is None:
        return home is kept
    return (
        abs(home.latitude_deg - kept.latitude_deg) <= _SAME_PLACE_DEG
        and abs(home.longitude_deg - kept.longitude_deg) <= _SAME_PLACE_DEG
        and home.altitude_m == kept.altitude_m
    )


def _shown(home: GeoPoint | None) -> Any:
    return (
        "unknown"
        if home is None
        else f"{home.latitude_deg:.7f}, {home.longitude_deg:.7f}, {home.altitude_m:g} m"
    )
