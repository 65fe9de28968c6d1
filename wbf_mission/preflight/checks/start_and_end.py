"""How a mission begins and ends: take-off, landing or return, and where."""

from __future__ import annotations

import math
from collections.abc import Iterator

from mission.model import Command
from wbf_mission.preflight.finding import Finding, Measure, Severity
from wbf_mission.preflight.flow import LANDINGS, LAST_NAV, TAKEOFFS, followers, never_ends, reachable
from wbf_mission.preflight.subject import Subject

__all__ = ["check_end", "check_takeoff"]

_LOWEST_TAKEOFF_M = 1.5
_FARTHEST_LANDING_M = 50.0


def check_takeoff(subject: Subject) -> Iterator[Finding]:
    """A take-off that is missing, late or low."""
    if subject.vehicle.kind == "rover" or subject.vehicle.is_ideal:
        return
    nav = [k for k, item in enumerate(subject.items) if item.command <= LAST_NAV]
    takeoffs = [k for k in nav if subject.items[k].command in TAKEOFFS]
    known = any(one.code == "no-takeoff" for one in subject.problems)
    if nav and not known and (not takeoffs or takeoffs[0] != nav[0]):
        first = nav[0]
        yield subject.finding(
            Severity.WARNING,
            "late-takeoff" if takeoffs else "climbs-by-itself",
            "comes before the take-off"
            if takeoffs
            else "no take-off before it: the vehicle climbs where it stands",
            "begin with NAV_TAKEOFF",
            item=first,
        )
    for k in takeoffs[:1]:
        height_m = subject.positions[k][2]
        if 0.0 < height_m < _LOWEST_TAKEOFF_M:
            yield subject.finding(
                Severity.WARNING,
                "low-takeoff",
                "takes off to a height at which it is still in its own wash",
                "take off higher",
                item=k,
                measure=Measure.at_least("height", height_m, _LOWEST_TAKEOFF_M, "m"),
            )


def check_end(subject: Subject) -> Iterator[Finding]:
    """An end in the air, or far from home."""
    if not subject.items or subject.vehicle.is_ideal:
        return
    endless = never_ends(subject.items)
    flown = (k for k in sorted(reachable(subject.items)) if k < len(subject.items))
    lasts = [] if endless else [k for k in flown if _is_last(subject, k)]
    for last in lasts[:1]:
        command = subject.items[last].command
        if command not in LANDINGS and command != Command.NAV_RETURN_TO_LAUNCH:
            yield subject.finding(
                Severity.WARNING,
                "no-landing",
                "the mission ends in the air: the vehicle stays there until the battery is low",
                "end with NAV_RETURN_TO_LAUNCH or NAV_LAND",
                item=last,
            )
    for k, item in enumerate(subject.items):
        x, y, _ = subject.positions[k]
        if item.command in LANDINGS and math.hypot(x, y) > _FARTHEST_LANDING_M:
            yield subject.finding(
                Severity.WARNING,
                "lands-elsewhere",
                "lands far from home",
                "is that meant? Otherwise end with NAV_RETURN_TO_LAUNCH",
                item=k,
                measure=Measure.at_most("distance from home", math.hypot(x, y), _FARTHEST_LANDING_M, "m"),
            )


def _is_last(subject: Subject, item: int) -> bool:
    """Return whether the mission ends with a NAV item: nothing but DO items may follow it."""
    items = subject.items
    if items[item].command > LAST_NAV:
        return False
    open_, seen = list(followers(items, item)), set()
    while open_:
        seq = open_.pop()
        if seq in seen or seq == len(items):
            continue
        seen.add(seq)
        if items[seq].command <= LAST_NAV:
            return False
        open_ += followers(items, seq)
    return True
