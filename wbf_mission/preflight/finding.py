"""Findings of a preflight check: severity, mission item, measured number, and fix."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Any

from geo.errors import WbfMissionError
from mission.autopilots.dialect import Severity as Severity
from wbf_mission.events import EventStream, Found


class PreflightError(WbfMissionError, ValueError):
    """Raised to refuse a plan in which the check found errors (`finding`), or which could not be checked."""

    def __init__(self, message: str, finding: Finding | None = None) -> None:
        super().__init__(message)
        self.finding = finding


class Concern(Enum):
    """Subject of a finding: the plan, or the vehicle's settings or state."""

    PLAN = "plan"
    """The plan alone."""
    PARAMETERS = "parameters"
    """Settings of the vehicle."""
    STATE = "state"
    """State of the vehicle now, such as battery and position; such findings matter only before take-off."""
    READINESS = "readiness"
    """State that passes by itself: satellites, position estimate, the autopilot's pre-arm checks."""


class Against(StrEnum):
    """Comparison of a measured number with its limit."""

    LEAST = "at least"
    """The number should not be below the limit."""
    MOST = "at most"
    """The number should not be above the limit."""
    PLANNED = "planned"
    """The number should equal the limit, because the plan and its prediction assume that value."""


_DIGITS = range(3, 8)


@dataclass(frozen=True, slots=True)
class Measure:
    """A measured number and its limit; a count has no unit.

    Examples
    --------
    >>> str(Measure.at_most("height", 130.0, 120.0, "m"))
    'height 130 m (at most 120 m)'
    >>> str(Measure.at_least("left in the battery", 19.996, 20.0, "%"))
    'left in the battery 19.996 % (at least 20 %)'
    """

    name: str
    value: float
    limit: float
    unit: str
    against: Against

    @classmethod
    def at_least(cls, name: str, value: float, limit: float, unit: str = "") -> Measure:
        """Return a measure with a lower limit."""
        return cls(name, value, limit, unit, Against.LEAST)

    @classmethod
    def at_most(cls, name: str, value: float, limit: float, unit: str = "") -> Measure:
        """Return a measure with an upper limit."""
        return cls(name, value, limit, unit, Against.MOST)

    @property
    def is_broken(self) -> bool:
        """Whether the number violates its limit."""
        if self.against is Against.LEAST:
            return self.value < self.limit
        return self.value > self.limit if self.against is Against.MOST else self.value != self.limit

    def __str__(self) -> str:
        written = ((self._quantity(self.value, n), self._quantity(self.limit, n)) for n in _DIGITS)
        # The number and its limit get enough digits to show a small violation.
        value, limit = next(
            (pair for pair in written if not self.is_broken or pair[0] != pair[1]),
            (self._quantity(self.value, 17), self._quantity(self.limit, 17)),
        )
        return f"{self.name} {value} ({self.against.value} {limit})"

    def _quantity(self, value: float, digits: int) -> str:
        whole = abs(value) >= 1000.0 and digits == _DIGITS.start
        number = f"{value:.0f}" if whole else f"{value:.{digits}g}"
        return f"{number} {self.unit}".strip()

    def summary(self) -> dict[str, Any]:
        """Return the number and its limit as plain values for JSON."""
        return {
            "measured": self.name,
            "value": self.value,
            "unit": self.unit,
            "limit": self.limit,
            "against": self.against.value,
        }


_NOTHING_MEASURED = dict.fromkeys(("measured", "value", "unit", "limit", "against"))


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding of a check."""

    severity: Severity
    code: str  # Code of the rule; scripts may use it, so it does not change.
    text: str  # Description of the fault.
    fix: str = ""  # Remedy; empty for a note.
    plan: str = "mission"  # Plan with the item: ``mission``, ``fence`` or ``rally``.
    # Item number from 1, without a home item; None for the whole plan. If several items share the finding,
    # this is the worst item.
    item: int | None = None
    command: str = ""  # Name of the item's command
    measure: Measure | None = None
    count: int = 1  # Number of items that share the finding
    concern: Concern = Concern.PLAN

    @property
    def where(self) -> str:
        """The item in words, as transfer remarks name it; empty for a finding on the whole mission.

        >>> Finding(Severity.NOTE, "zero-leg", "", item=3, command="NAV_WAYPOINT", count=2).where
        'mission item 3 (NAV_WAYPOINT) and 1 more'
        """
        if self.item is None:
            return "" if self.plan == "mission" else self.plan
        command = f" ({self.command})" if self.command else ""
        more = f" and {self.count - 1} more" if self.count > 1 else ""
        return f"{self.plan} item {self.item}{command}{more}"

    def __str__(self) -> str:
        start = f"{self.where}: " if self.where else ""
        measured = f"; {self.measure}" if self.measure is not None else ""
        return f"{start}{self.text}{measured}" + (f"; {self.fix}" if self.fix else "")

    def summary(self) -> dict[str, Any]:
        """Return the finding as plain values for JSON."""
        measured = _NOTHING_MEASURED if self.measure is None else self.measure.summary()
        return {
            "severity": self.severity.value,
            "code": self.code,
            "concern": self.concern.value,
            "plan": self.plan,
            "item": self.item,
            "command": self.command or None,
            "count": self.count,
            "text": self.text,
            **measured,
            "fix": self.fix or None,
        }


_ORDER = {severity: rank for rank, severity in enumerate(Severity)}


@dataclass(frozen=True, slots=True)
class Report:
    """All findings of a check, ordered by severity, then by check."""

    findings: tuple[Finding, ...]

    def __post_init__(self) -> None:
        ordered = sorted(self.findings, key=lambda one: _ORDER[one.severity])
        object.__setattr__(self, "findings", tuple(ordered))

    def of(self, severity: Severity) -> tuple[Finding, ...]:
        """Return the findings of one severity."""
        return tuple(finding for finding in self.findings if finding.severity is severity)

    def about(self, *concerns: Concern) -> Report:
        """Return a report of only the findings with these concerns."""
        return Report(tuple(finding for finding in self.findings if finding.concern in concerns))

    @property
    def has_errors(self) -> bool:
        """Whether the plan has errors, so that it must not be uploaded."""
        return bool(self.of(Severity.ERROR))

    @property
    def counts(self) -> dict[str, int]:
        """Number of findings of each severity."""
        return {f"{severity.value}s": len(self.of(severity)) for severity in Severity}

    def refusal(self, consequence: str) -> PreflightError | None:
        """Return the error that refuses the plan, or None; ``consequence`` names the action not taken."""
        errors = self.of(Severity.ERROR)
        if not errors:
            return None
        others = len(errors) - 1
        more = f" (and {others} more error{'s' if others > 1 else ''})" if others else ""
        msg = f"{errors[0]}{more}; preflight check: {consequence}, --force does it nevertheless"
        return PreflightError(msg, errors[0])

    def tell(self, events: EventStream, refused: PreflightError | None, vehicle: str = "") -> None:
        """Emit each finding; `refused` is the error that follows, and `vehicle` the prefix of each line."""
        for finding in self.findings:
            refuses = refused is not None and finding is refused.finding
            events.tell(Found(finding.severity.value, finding.code, str(finding), vehicle, refuses))

    def require_no_errors(self, consequence: str, events: EventStream, *, force: bool = False) -> None:
        """Emit the findings. Without `force`, raise the `refusal` if there are errors."""
        refused = None if force else self.refusal(consequence)
        self.tell(events, refused)
        if refused is not None:
            raise refused


@dataclass(frozen=True, slots=True)
class Hit:
    """Value that a check measured at an item; items count from 0."""

    item: int
    value: float
    measured: tuple[float, float] | None = None  # Measured number and limit, if `value` is their ratio


def worst_of(hits: Iterable[Hit], *, largest: bool) -> tuple[Hit, int] | None:
    """Return the worst hit and the number of items with hits, or None without hits.

    Examples
    --------
    >>> worst_of([Hit(1, 2.0), Hit(4, 3.0), Hit(4, 1.0)], largest=True)
    (Hit(item=4, value=3.0, measured=None), 2)
    """
    found: Sequence[Hit] = [hit for hit in hits if not math.isnan(hit.value)]
    if not found:
        return None
    worst = (max if largest else min)(found, key=lambda one: one.value)
    return worst, len({hit.item for hit in found})
