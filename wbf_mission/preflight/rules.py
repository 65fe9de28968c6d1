"""The table of rules: what each kind of finding says, how bad it is, and what to do about it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mission.transfer.wire import command_name
from wbf_mission.preflight.finding import Against, Concern, Finding, Hit, Measure, Severity, worst_of
from wbf_mission.preflight.subject import Subject

_ERROR, _WARNING, _NOTE = Severity.ERROR, Severity.WARNING, Severity.NOTE


def _least(name: str, unit: str = "") -> tuple[Against, str, str]:
    return Against.LEAST, name, unit


def _most(name: str, unit: str = "") -> tuple[Against, str, str]:
    return Against.MOST, name, unit


def _planned(unit: str) -> tuple[Against, str, str]:
    return Against.PLANNED, "{name}", unit


_INSIDE = _least("distance inside the fence", "m")
_LEFT = _least("left in the battery at the end", "%")


@dataclass(frozen=True, slots=True)
class Rule:
    """What a kind of finding says; the check that finds it fills in the words in braces."""

    severity: Severity
    text: str
    fix: str = ""
    # How the number that is measured compares with its limit, what it is, and its unit
    measured: tuple[Against, str, str] | None = None
    # It depends on the vehicle: where nobody said what vehicle it is, an error is a warning
    by_vehicle: bool = False


RULES: Mapping[Concern, Mapping[str, Rule]] = {
    Concern.PLAN: {
        "stops": Rule(_ERROR, "{reason}", "change the item, or fly another vehicle", by_vehicle=True),
        "no-prediction": Rule(
            _NOTE,
            "the flight is not predicted, because the vehicle cannot fly the plan: battery and time are not"
            " known, and fence and obstacles are checked along straight legs",
            "correct the errors, then check again",
        ),
        "not-predicted": Rule(
            _WARNING,
            "this command is not predicted: time, path and battery are without it",
            "check the item by hand",
        ),
        "terrain-heights": Rule(
            _WARNING,
            "heights above the terrain are predicted as heights above home",
            "check heights and battery where the ground rises",
        ),
        "unreachable": Rule(
            _WARNING,
            "is never flown: what is before it ends the mission, and nothing jumps there",
            "remove it, or put the end of the mission behind it",
        ),
        "endless": Rule(
            _WARNING, "the mission goes round until the battery is low", "give DO_JUMP a number of times"
        ),
        "mixed-frames": Rule(
            _WARNING, "its height counts {frame}, that of others {usual}", "give all heights in one frame"
        ),
        "late-takeoff": Rule(_WARNING, "comes before the take-off", "begin with NAV_TAKEOFF"),
        "climbs-by-itself": Rule(
            _WARNING, "no take-off before it: the vehicle climbs where it stands", "begin with NAV_TAKEOFF"
        ),
        "low-takeoff": Rule(
            _WARNING,
            "takes off to a height at which it is still in its own wash",
            "take off higher",
            _least("height", "m"),
        ),
        "no-landing": Rule(
            _WARNING,
            "the mission ends in the air: the vehicle stays there until the battery is low",
            "end with NAV_RETURN_TO_LAUNCH or NAV_LAND",
        ),
        "lands-elsewhere": Rule(
            _WARNING,
            "lands far from home",
            "is that meant? Otherwise end with NAV_RETURN_TO_LAUNCH",
            _most("distance from home", "m"),
        ),
        "bad-fence": Rule(_ERROR, "{error}", "draw the fence again"),
        "home-outside-fence": Rule(
            _ERROR, "home is outside the fence: the vehicle would not arm", "move the fence or home", _INSIDE
        ),
        "rally-outside-fence": Rule(_WARNING, "a rally point outside the fence", "move it inside", _INSIDE),
        "outside-fence": Rule(
            _ERROR,
            "the path to it leaves the fence, or enters what it shuts out",
            "move the waypoint or the fence",
            _INSIDE,
        ),
        "near-fence": Rule(
            _WARNING,
            "the path to it comes near the edge of the fence",
            "keep away from the edge, or give the margin that is meant",
            _INSIDE,
        ),
        "obstacle": Rule(
            _ERROR,
            "the path to it crosses an obstacle of the farm",
            "fly round it",
            _least("distance from the obstacle", "m"),
        ),
        "near-obstacle": Rule(
            _WARNING,
            "the path to it comes near an obstacle of the farm",
            "fly round it",
            _least("distance from the obstacle", "m"),
        ),
        "unseen": Rule(
            _WARNING,
            "the images show less of the farm's land than was asked for",
            "is it a part of a survey, the right --farm and --camera? Otherwise plan it again",
            _least("coverage", "%"),
        ),
        "with-permission": Rule(
            _NOTE,
            "higher above home than is allowed without a permission",
            "carry the permission; mind where the ground falls",
            _most("height above home", "m"),
        ),
        "too-high": Rule(
            _WARNING,
            "higher above home than is allowed above the ground",
            "fly lower, or with a permission give --max-altitude; mind where the ground falls",
            _most("height above home", "m"),
        ),
        "too-low": Rule(
            _WARNING,
            "so low that a slope, a plant or the error of the barometer is in the way",
            "fly higher",
            _least("height above home", "m"),
        ),
        "far-start": Rule(
            _WARNING,
            "the whole mission is far from home: this is its nearest position",
            "is home right?",
            _most("distance from home", "m"),
        ),
        "long-leg": Rule(
            _WARNING, "a very long leg", "is the position right?", _most("length of the leg", "m")
        ),
        "zero-leg": Rule(_WARNING, "the same position as before", "remove one of the two"),
        "short-leg": Rule(
            _WARNING,
            "legs in a row are shorter than the acceptance radius: they count as flown at once",
            "give a smaller radius, or leave waypoints out",
            _least("length of the leg", "m"),
        ),
        "small-radius": Rule(
            _WARNING,
            "the acceptance radius counts in space, and the height estimate is wrong by half a metre: "
            "{autopilot} may wait at the waypoint",
            "give 2 m, or 0 for the autopilot's own",
            _least("acceptance radius", "m"),
        ),
        "too-fast": Rule(
            _WARNING,
            "faster than {vehicle} flies: it will take longer than the speed tells",
            "give a speed that it reaches",
            _most("speed", "m/s"),
        ),
        "too-slow": Rule(
            _WARNING,
            "below the least airspeed of the fixed wing: the autopilot flies faster",
            "give at least that",
            _least("airspeed", "m/s"),
        ),
        "tight-turn": Rule(
            _WARNING,
            "the legs are too short for the turns of a fixed wing: much of the plan is not flown",
            "lay rows at least {room_m:.0f} m apart; where the field is too small for that, fly a multirotor",
        ),
        "steep-leg": Rule(
            _WARNING,
            "the leg climbs or sinks faster than the vehicle does: {outcome}",
            "make the leg longer, or fly slower",
            _most("climb or descent", "m/s"),
        ),
        "too-windy": Rule(
            _ERROR,
            "{vehicle} would be blown away",
            "wait for less wind",
            _most("wind", "m/s"),
            by_vehicle=True,
        ),
        "too-gusty": Rule(
            _WARNING,
            "gusts are stronger than the {limit_m_s:.3g} m/s against which {vehicle} holds its"
            " path: it is blown aside then, and no margin to obstacles or a fence covers that",
            "wait for less wind, or stay farther away",
            _most("time in such gusts", "s"),
        ),
        "battery": Rule(
            _ERROR,
            "{flight}; {reason}",
            "fly a shorter mission, or in the sorties that 'wbf-mission plan' cuts it into",
            _LEFT,
            by_vehicle=True,
        ),
        "battery-close": Rule(
            _NOTE,
            "{flight}; hardly more is left at the end than the reserve",
            "begin with a full battery",
            _LEFT,
        ),
        "flight": Rule(_NOTE, "{flight}", measured=_LEFT),
        "camera-too-fast": Rule(
            _WARNING,
            "the images follow each other faster than the camera takes them: some will be missing",
            "fly slower, or leave more distance between images",
            _least("time between images", "s"),
        ),
        "camera-left-on": Rule(
            _NOTE, "the camera is not stopped before the end: it goes on taking images on the way home"
        ),
        "no-camera": Rule(_NOTE, "the mission never starts a camera"),
    },
    Concern.PARAMETERS: {
        "landing-rule": Rule(
            _ERROR,
            "{name} is {value:g}: the vehicle refuses a mission without {missing} (a return is no landing)",
            "{mend}",
        ),
        "other-speed": Rule(
            _WARNING,
            "{name}: plans assume another speed",
            "set {name}, order the speed in the mission, or plan with --param",
            _planned("m/s"),
        ),
        "speed-limit": Rule(
            _WARNING,
            "{name} is lower than the speed of the plan: the flight takes longer than predicted",
            "fly slower, or raise {name}",
            _most("speed of the plan", "m/s"),
        ),
        "other-radius": Rule(
            _WARNING,
            "{name}: plans assume another acceptance radius",
            "set {name}, or plan with --param",
            _planned("m"),
        ),
        "high-return": Rule(
            _WARNING,
            "{name}: the return climbs higher than most rules allow",
            "lower {name}",
            _most("height above home", "m"),
        ),
        "other-return": Rule(
            _NOTE, "{name}: plans assume another height of the return", measured=_planned("m")
        ),
        "circles-at-home": Rule(
            _WARNING,
            "{name} is 0: the return circles over home and does not land",
            "end with a landing, or land by hand",
        ),
        "above-ceiling": Rule(
            _ERROR,
            "{name}: the plan leaves the fence of the vehicle",
            "change the plan, or raise {name}",
            _most("height above home", "m"),
        ),
        "beyond-fence-radius": Rule(
            _ERROR,
            "{name}: the plan leaves the fence of the vehicle",
            "change the plan, or raise {name}",
            _most("distance from home", "m"),
        ),
        "fence-off": Rule(_WARNING, "{name} is 0: the fence of the plan does nothing", "set {name}"),
        "fence-tells-only": Rule(
            _WARNING, "{name} is {value:g}: a broken fence is only told", "set {name} to return or land"
        ),
        "no-battery-failsafe": Rule(
            _WARNING, "{name} is 0: a low battery is only told", "set {name} to return or land"
        ),
        "link-lost-flies-on": Rule(_NOTE, "{name} is {value:g}: without a link the mission is flown on"),
        "link-lost-ends": Rule(_NOTE, "{name} is {value:g}: a link lost for long ends the mission"),
        "not-calibrated": Rule(_ERROR, "{name} is 0: there is no calibrated {sensor}", "{mend}"),
        "parameter-unread": Rule(_NOTE, "could not be read: {names}"),
    },
    Concern.STATE: {
        "firmware": Rule(_NOTE, "{firmware}"),
        "firmware-unknown": Rule(_NOTE, "the vehicle does not tell its firmware's version"),
        "no-release": Rule(_WARNING, "{firmware} is no release", "fly a release where it matters"),
        "armed": Rule(_WARNING, "the motors are running", "is it flying?"),
        "battery-now": Rule(
            _ERROR,
            "the battery holds {holds:.0%} now: less is left at the end than the reserve",
            "charge or change it",
            _LEFT,
            by_vehicle=True,
        ),
        "battery-unknown": Rule(_NOTE, "the vehicle does not tell what its battery holds"),
        "away-from-home": Rule(
            _ERROR,
            "the vehicle stands far from the home of the plan, and returns to where it starts",
            "carry it there, or plan from where it stands",
            _most("distance from home", "m"),
        ),
        "other-ground-height": Rule(
            _WARNING,
            "the ground here is at another height than the plan's, and heights count above the sea",
            "give heights above home, or correct the home of the plan",
            _most("difference in height", "m"),
        ),
    },
    Concern.READINESS: {
        "not-ready": Rule(
            _ERROR, "the vehicle says that it cannot arm: {reasons}", "wait, or do what it says"
        ),
        "unhealthy": Rule(_ERROR, "not healthy: {sensors}", "wait until it is, calibrate or repair it"),
        "no-fix": Rule(_ERROR, "no position from satellites", "wait under the open sky", _least("fix type")),
        "few-satellites": Rule(_WARNING, "few satellites", "wait for more", _least("satellites")),
        "poor-fix": Rule(_WARNING, "a poor dilution of precision", "wait for more satellites", _most("HDOP")),
        "estimator": Rule(_ERROR, "the estimator does not know: {parts}", "wait until it has settled"),
    },
}
"""By concern and code. What an autopilot or the executor itself says of a plan has codes of its own."""
_BY_CODE = {code: (concern, rule) for concern, rules in RULES.items() for code, rule in rules.items()}


def found(
    subject: Subject,
    code: str,
    *,
    item: int | None = None,
    count: int = 1,
    plan: str = "mission",
    measured: tuple[float, float] | None = None,
    measure: Measure | None = None,
    severity: Severity | None = None,
    **words: Any,
) -> Finding:
    """Return what a rule says; `item` counts from 0, `words` stand for the words in braces.

    What was measured and its limit is `measured`, or a whole `measure` where what is measured varies.
    """
    concern, rule = _BY_CODE[code]
    if measured is not None and rule.measured is not None:
        against, name, unit = rule.measured
        measure = Measure(name.format(**words), *measured, unit, against)
    severity = rule.severity if severity is None else severity
    return Finding(
        _WARNING if rule.by_vehicle and subject.given.assumed else severity,
        code,
        rule.text.format(**words),
        rule.fix.format(**words),
        plan=plan,
        item=None if item is None else item + 1,
        command=_command(subject, plan, item),
        measure=measure,
        count=count,
        concern=concern,
    )


def _command(subject: Subject, plan: str, item: int | None) -> str:
    if item is None:
        return ""
    return "NAV_RALLY_POINT" if plan == "rally" else command_name(subject.items[item].command)


def first(subject: Subject, code: str, items: Sequence[int], **words: Any) -> Iterator[Finding]:
    """Yield what a rule says of the first of several items, if there is one."""
    if items:
        yield found(subject, code, item=items[0], count=len(items), **words)


def worst(
    subject: Subject, code: str, hits: Iterable[Hit], limit: float = math.nan, **words: Any
) -> Iterator[Finding]:
    """Yield what a rule says of the worst of several hits, if there is one."""
    rule = _BY_CODE[code][1]
    largest = rule.measured is None or rule.measured[0] is Against.MOST
    if (one := worst_of(hits, largest=largest)) is not None:
        hit, count = one
        measured = hit.measured or (hit.value, limit)
        yield found(subject, code, item=hit.item, count=count, measured=measured, **words)
