"""Checks of the mission items: items that the vehicle cannot fly or never flies, or the autopilot refuses."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

from mission.model import Command, Frame
from mission.transfer.remarks import Remark
from mission.transfer.rendering import render
from mission.transfer.wire import command_name
from sim_vehicle.execution.items import DO_COMMANDS, NAV_COMMANDS, OUTPUT_COMMANDS
from wbf_mission.preflight.finding import Concern, Finding, Severity
from wbf_mission.preflight.rules import ERROR, NOTE, WARNING, Checks, Rule, at_least, at_most, first, found
from wbf_mission.preflight.subject import (
    LANDINGS,
    LAST_NAV,
    PLACED,
    TAKEOFFS,
    Subject,
    followers,
    never_ends,
    reachable,
)

CHECKS = Checks[[Subject]]()

_REMARKS = {
    Severity.ERROR: "autopilot-refuses",
    Severity.WARNING: "autopilot-changes",
    Severity.NOTE: "autopilot-ignores",
}

_FIXES = {
    "empty": "give a mission with items",
    "no-position": "add a waypoint",
    "no-takeoff": "begin with NAV_TAKEOFF",
    "altitude": "give a height within the limits",
    "far-from-home": "plan from a home nearby",
    "frame": "use frame 0 or 3",
    "jump-loop": "jump to an item with a position, or to an item before it",
}


@CHECKS.finds(Rule("stops", ERROR, "{reason}", "change the item, or fly another vehicle", by_vehicle=True))
def check_problems(subject: Subject) -> Iterator[Finding]:
    """Find items that the vehicle's checks before arming would refuse."""
    # `check_dialect` reports wrong jump targets for every autopilot.
    problems = [problem for problem in subject.problems if problem.code != "jump-target"]
    for code in dict.fromkeys(problem.code for problem in problems):
        same = [problem for problem in problems if problem.code == code]
        one = same[0]
        yield Finding(
            Severity.ERROR,
            code,
            one.reason,
            _FIXES.get(code, "correct the item"),
            item=None if one.item is None else one.item + 1,
            command="" if one.item is None else command_name(one.command),
            count=len(same),
        )
    if subject.stopped is not None:
        item, reason = subject.stopped
        yield found(subject, "stops", item=item, reason=reason)


@CHECKS.finds(
    Rule(
        "no-prediction",
        NOTE,
        "the flight is not predicted, because the vehicle cannot fly the plan: battery and time are not"
        " known, and fence and obstacles are checked along straight legs",
        "correct the errors, then check again",
    )
)
def check_predicted(subject: Subject) -> Iterator[Finding]:
    """Find a plan whose flight is not predicted; without a prediction, several checks are weaker."""
    if subject.prediction is None:
        yield found(subject, "no-prediction")


@CHECKS.finds()
def check_dialect(subject: Subject) -> Iterator[Finding]:
    """Find items that the autopilot would refuse, change or ignore (`mission.transfer.rendering`)."""
    for remark in remarks_of(subject):
        yield Finding(
            remark.severity,
            "landing-rule" if remark.parameter else _REMARKS[remark.severity],
            remark.text,
            remark.fix,
            plan=remark.plan.name.lower(),
            item=None if remark.item is None else remark.item + 1,
            command="" if remark.command is None else command_name(remark.command),
            count=remark.count,
            concern=Concern.PARAMETERS if remark.parameter else Concern.PLAN,
        )


def remarks_of(subject: Subject) -> tuple[Remark, ...]:
    """Return the remarks on uploading the plan to the autopilot."""
    mission, profile = subject.mission, subject.profile
    told, planned = subject.parameters, dict(subject.vehicle.parameters)
    return render(mission, profile, subject.vehicle_type, parameters=told, planned=planned).remarks


@CHECKS.finds(
    Rule(
        "not-predicted",
        WARNING,
        "the prediction ignores this command: predicted time, path and battery are without it",
        "check the item by hand",
    ),
    Rule(
        "terrain-heights",
        WARNING,
        "the prediction takes heights above the terrain for heights above home",
        "check heights and battery where the ground rises",
    ),
)
def check_unknown(subject: Subject) -> Iterator[Finding]:
    """Find commands and heights that the prediction ignores."""
    items = list(enumerate(subject.items))
    predicted = (NAV_COMMANDS | DO_COMMANDS) - OUTPUT_COMMANDS
    unknown = [k for k, one in items if one.command not in predicted]
    terrain = [k for k, one in items if one.frame == Frame.GLOBAL_TERRAIN_ALT]
    yield from first(subject, "not-predicted", unknown)
    yield from first(subject, "terrain-heights", terrain)


@CHECKS.finds(
    Rule(
        "unreachable",
        WARNING,
        "the item is never flown: an earlier item ends the mission, and no item jumps to this item",
        "remove the item, or move the item that ends the mission behind it",
    )
)
def check_flown(subject: Subject) -> Iterator[Finding]:
    """Find items after the end of the mission."""
    seen = reachable(subject.items)
    yield from first(subject, "unreachable", [k for k in range(len(subject.items)) if k not in seen])


@CHECKS.finds(
    Rule(
        "endless",
        WARNING,
        "the mission repeats until the battery is low",
        "give DO_JUMP a number of repeats",
    )
)
def check_ends(subject: Subject) -> Iterator[Finding]:
    """Find endless jumps."""
    if never_ends(subject.items):
        jump = max((k for k in reachable(subject.items) if k < len(subject.items)), default=0)
        yield found(subject, "endless", item=jump)


_FRAMES = {
    int(Frame.GLOBAL): "above the sea",
    int(Frame.GLOBAL_RELATIVE_ALT): "above home",
    int(Frame.GLOBAL_TERRAIN_ALT): "above the terrain",
}


@CHECKS.finds(
    Rule(
        "mixed-frames",
        WARNING,
        "the height is {frame}, but heights of other items are {usual}",
        "give all heights in one frame",
    )
)
def check_frames(subject: Subject) -> Iterator[Finding]:
    """Find heights with different reference levels."""
    frames = [
        (k, item.frame)
        for k, item in enumerate(subject.items)
        if item.command in PLACED and item.frame in _FRAMES and item.has_position
    ]
    usual = Counter(frame for _, frame in frames).most_common(1)
    others = [(k, frame) for k, frame in frames if frame != usual[0][0]]
    if others:
        own, level = _FRAMES[others[0][1]], _FRAMES[usual[0][0]]
        yield from first(subject, "mixed-frames", [k for k, _ in others], frame=own, usual=level)


_LOWEST_TAKEOFF_M = 1.5


@CHECKS.finds(
    Rule("late-takeoff", WARNING, "the item comes before the take-off", "begin with NAV_TAKEOFF"),
    Rule(
        "climbs-by-itself",
        WARNING,
        "no take-off comes before the item, so the vehicle first climbs where it stands",
        "begin with NAV_TAKEOFF",
    ),
    Rule(
        "low-takeoff",
        WARNING,
        "the take-off ends so low that the vehicle is still in its own rotor wash",
        "take off higher",
        at_least("height", "m"),
    ),
)
def check_takeoff(subject: Subject) -> Iterator[Finding]:
    """Find a missing, late or low take-off."""
    if subject.vehicle.drives or subject.vehicle.is_ideal:
        return
    nav = [k for k, item in enumerate(subject.items) if item.command <= LAST_NAV]
    takeoffs = [k for k in nav if subject.items[k].command in TAKEOFFS]
    known = any(problem.code == "no-takeoff" for problem in subject.problems)
    if nav and not known and (not takeoffs or takeoffs[0] != nav[0]):
        yield found(subject, "late-takeoff" if takeoffs else "climbs-by-itself", item=nav[0])
    for k in takeoffs[:1]:
        height_m = subject.positions[k][2]
        if 0.0 < height_m < _LOWEST_TAKEOFF_M:
            yield found(subject, "low-takeoff", item=k, measured=(height_m, _LOWEST_TAKEOFF_M))


_FARTHEST_LANDING_M = 50.0


@CHECKS.finds(
    Rule(
        "no-landing",
        WARNING,
        "the mission ends in the air: the vehicle stays there until the battery is low",
        "end with NAV_RETURN_TO_LAUNCH or NAV_LAND",
    ),
    Rule(
        "lands-elsewhere",
        WARNING,
        "the vehicle lands far from home",
        "check the landing place, or end with NAV_RETURN_TO_LAUNCH",
        at_most("distance from home", "m"),
    ),
)
def check_end(subject: Subject) -> Iterator[Finding]:
    """Find a mission that ends in the air, or that lands far from home."""
    if not subject.items or subject.vehicle.is_ideal:
        return
    endless = never_ends(subject.items)
    flown = (k for k in sorted(reachable(subject.items)) if k < len(subject.items))
    lasts = [] if endless else [k for k in flown if _is_last(subject, k)]
    for last in lasts[:1]:
        command = subject.items[last].command
        if command not in LANDINGS and command != Command.NAV_RETURN_TO_LAUNCH:
            yield found(subject, "no-landing", item=last)
    for k, item in enumerate(subject.items):
        away_m = math.hypot(*subject.positions[k][:2])
        if item.command in LANDINGS and away_m > _FARTHEST_LANDING_M:
            yield found(subject, "lands-elsewhere", item=k, measured=(away_m, _FARTHEST_LANDING_M))


def _is_last(subject: Subject, item: int) -> bool:
    """Return whether an item is a last NAV item, which no other NAV item follows."""
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
