"""The list of items itself: what cannot be flown, is never flown, or does not fit into the autopilot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from mission.model import Frame
from mission.transfer.remark import Remark
from mission.transfer.rendering import render
from mission.transfer.wire import command_name
from sim_vehicle.execution.feasibility import ItemProblem
from sim_vehicle.execution.items import DO_COMMANDS, NAV_COMMANDS
from wbf_mission.preflight.checks.legs import PLACED
from wbf_mission.preflight.finding import Concern, Finding, Severity
from wbf_mission.preflight.flow import never_ends, reachable
from wbf_mission.preflight.subject import Subject

__all__ = [
    "check_dialect",
    "check_ends",
    "check_flown",
    "check_frames",
    "check_predicted",
    "check_problems",
    "check_unknown",
    "remarks_of",
]

_FRAMES = {
    int(Frame.GLOBAL): "above the sea",
    int(Frame.GLOBAL_RELATIVE_ALT): "above home",
    int(Frame.GLOBAL_TERRAIN_ALT): "above the terrain",
}
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
    "jump-loop": "jump to a position, or before one",
}


def check_problems(subject: Subject) -> Iterator[Finding]:
    """What the vehicle cannot fly, as its own checks before arming find it."""
    # Where a jump leads is told of every autopilot.
    problems = [one for one in subject.problems if one.code != "jump-target"]
    for code in dict.fromkeys(one.code for one in problems):
        yield _problem_finding([one for one in problems if one.code == code])
    if subject.stopped is not None:
        item, reason = subject.stopped
        fix = "change the item, or fly another vehicle"
        yield subject.finding(
            Severity.WARNING if subject.assumed else Severity.ERROR,
            "stops",
            reason,
            fix,
            item=item,
        )


def check_predicted(subject: Subject) -> Iterator[Finding]:
    """A plan whose flight could not be predicted: several checks know less then."""
    if subject.prediction is None:
        yield Finding(
            Severity.NOTE,
            "no-prediction",
            "the flight is not predicted, because the vehicle cannot fly the plan: battery and time are not"
            " known, and fence and obstacles are checked along straight legs",
            "correct the errors, then check again",
        )


def _problem_finding(problems: list[ItemProblem]) -> Finding:
    first = problems[0]
    return Finding(
        Severity.ERROR,
        first.code,
        first.reason,
        _FIXES.get(first.code, "correct the item"),
        item=None if first.item is None else first.item + 1,
        command="" if first.item is None else command_name(first.command),
        count=len(problems),
    )


def check_unknown(subject: Subject) -> Iterator[Finding]:
    """Commands and heights that the prediction leaves out."""
    unknown = [
        k
        for k, item in enumerate(subject.items)
        if item.command not in NAV_COMMANDS and item.command not in DO_COMMANDS
    ]
    if unknown:
        first = unknown[0]
        yield subject.finding(
            Severity.WARNING,
            "not-predicted",
            "this command is not predicted: time, path and battery are without it",
            "check the item by hand",
            item=first,
            count=len(unknown),
        )
    terrain = [k for k, item in enumerate(subject.items) if item.frame == Frame.GLOBAL_TERRAIN_ALT]
    if terrain:
        yield subject.finding(
            Severity.WARNING,
            "terrain-heights",
            "heights above the terrain are predicted as heights above home",
            "check heights and battery where the ground rises",
            item=terrain[0],
            count=len(terrain),
        )


def check_flown(subject: Subject) -> Iterator[Finding]:
    """Items behind the end of the mission."""
    seen = reachable(subject.items)
    never = [k for k in range(len(subject.items)) if k not in seen]
    if never:
        yield subject.finding(
            Severity.WARNING,
            "unreachable",
            "is never flown: what is before it ends the mission, and nothing jumps there",
            "remove it, or put the end of the mission behind it",
            item=never[0],
            count=len(never),
        )


def check_ends(subject: Subject) -> Iterator[Finding]:
    """Jumps that go round for ever."""
    if never_ends(subject.items):
        jump = max((k for k in reachable(subject.items) if k < len(subject.items)), default=0)
        yield subject.finding(
            Severity.WARNING,
            "endless",
            "the mission goes round until the battery is low",
            "give DO_JUMP a number of times",
            item=jump,
        )


def check_frames(subject: Subject) -> Iterator[Finding]:
    """Heights that count from different levels."""
    frames = [
        (k, item.frame)
        for k, item in enumerate(subject.items)
        if item.command in PLACED and item.frame in _FRAMES and item.has_position
    ]
    usual = Counter(frame for _, frame in frames).most_common()
    if len(usual) > 1:
        others = [(k, frame) for k, frame in frames if frame != usual[0][0]]
        item, frame = others[0]
        yield subject.finding(
            Severity.WARNING,
            "mixed-frames",
            f"its height counts {_FRAMES[frame]}, that of others {_FRAMES[usual[0][0]]}",
            "give all heights in one frame",
            item=item,
            count=len(others),
        )


def check_dialect(subject: Subject) -> Iterator[Finding]:
    """What the autopilot would refuse, change or ignore, as `mission.transfer.rendering` tells."""
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
    """Return what is to be said of the plan before it is sent to such an autopilot."""
    mission, profile = subject.mission, subject.profile
    told, planned = subject.parameters, dict(subject.vehicle.parameters)
    return render(mission, profile, subject.vehicle_type, parameters=told, planned=planned).remarks
