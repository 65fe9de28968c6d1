"""Rules of the preflight check: each check declares severity, text and fix of its findings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, ParamSpec

from mission.transfer.wire import command_name
from wbf_mission.preflight.finding import Against, Concern, Finding, Hit, Measure, Severity, worst_of
from wbf_mission.preflight.subject import Subject

P = ParamSpec("P")
ERROR, WARNING, NOTE = Severity.ERROR, Severity.WARNING, Severity.NOTE


def at_least(name: str, unit: str = "") -> tuple[Against, str, str]:
    """Return comparison, name and unit of a measured number that has a lower limit."""
    return Against.LEAST, name, unit


def at_most(name: str, unit: str = "") -> tuple[Against, str, str]:
    """Return comparison, name and unit of a measured number that has an upper limit."""
    return Against.MOST, name, unit


def planned(unit: str) -> tuple[Against, str, str]:
    """Return comparison, name and unit of a parameter for which the plan assumes a value."""
    return Against.PLANNED, "{name}", unit


INSIDE = at_least("distance inside the fence", "m")
LEFT = at_least("left in the battery at the end", "%")


@dataclass(frozen=True, slots=True)
class Rule:
    """One kind of finding; the check fills in the words that stand in braces in `text` and `fix`."""

    code: str
    severity: Severity
    text: str
    fix: str = ""
    # Comparison, name and unit of the measured number
    measured: tuple[Against, str, str] | None = None
    # Whether an error becomes a warning if the vehicle is only assumed, and not known
    by_vehicle: bool = False
    concern: Concern = Concern.PLAN


RULES: dict[str, Rule] = {}
"""All rules that checks declare, by their codes.

Findings of an autopilot's dialect or of the executor have other codes, which are not listed here.
"""


class Checks(Generic[P]):
    """Checks of a module, in order of execution."""

    def __init__(self) -> None:
        self.all: list[Callable[P, Iterable[Finding]]] = []

    def finds(
        self, *rules: Rule
    ) -> Callable[[Callable[P, Iterator[Finding]]], Callable[P, Iterator[Finding]]]:
        """Add the decorated check, and the rules of its findings."""
        for rule in rules:
            assert rule.code not in RULES, rule.code
            RULES[rule.code] = rule

        def add(check: Callable[P, Iterator[Finding]]) -> Callable[P, Iterator[Finding]]:
            self.all.append(check)
            return check

        return add


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
    """Return the finding of a rule; `item` counts from 0, and `words` replace the words in braces.

    `measured` is the measured number and its limit; `measure` replaces the comparison that the rule declares.
    """
    rule = RULES[code]
    if measured is not None and rule.measured is not None:
        against, name, unit = rule.measured
        measure = Measure(name.format(**words), *measured, unit, against)
    severity = rule.severity if severity is None else severity
    return Finding(
        WARNING if rule.by_vehicle and subject.given.assumed else severity,
        code,
        rule.text.format(**words),
        rule.fix.format(**words),
        plan=plan,
        item=None if item is None else item + 1,
        command=_command(subject, plan, item),
        measure=measure,
        count=count,
        concern=rule.concern,
    )


def _command(subject: Subject, plan: str, item: int | None) -> str:
    if item is None:
        return ""
    return "NAV_RALLY_POINT" if plan == "rally" else command_name(subject.items[item].command)


def first(subject: Subject, code: str, items: Sequence[int], **words: Any) -> Iterator[Finding]:
    """Yield a rule's finding at the first of `items`; yield nothing if there are none."""
    if items:
        yield found(subject, code, item=items[0], count=len(items), **words)


def worst(
    subject: Subject, code: str, hits: Iterable[Hit], limit: float = math.nan, **words: Any
) -> Iterator[Finding]:
    """Yield a rule's finding at the worst of `hits`; yield nothing if there are none."""
    rule = RULES[code]
    largest = rule.measured is None or rule.measured[0] is Against.MOST
    if (worst_hit := worst_of(hits, largest=largest)) is not None:
        hit, count = worst_hit
        measured = hit.measured or (hit.value, limit)
        yield found(subject, code, item=hit.item, count=count, measured=measured, **words)
