"""What a preflight check finds: how bad, where, how much, and what to do."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from geo.errors import WbfMissionError
from mission.transfer.remark import Severity

__all__ = [
    "Concern",
    "Finding",
    "Hit",
    "Measure",
    "PreflightError",
    "Report",
    "Severity",
    "worst_of",
]


class PreflightError(WbfMissionError, ValueError):
    """A plan that must not go up, because the preflight check found errors, or that cannot be checked."""


class Concern(Enum):
    """What a finding is about, which decides when it counts."""

    PLAN = "plan"
    """The plan alone."""
    PARAMETERS = "parameters"
    """What is set on the vehicle."""
    STATE = "state"
    """The vehicle as it stands there: battery, position. It counts before a start."""
    READINESS = "readiness"
    """What passes by waiting: satellites, estimator, the vehicle's own checks."""


@dataclass(frozen=True, slots=True)
class Measure:
    """A number that was measured, and what it is compared with.

    Parameters
    ----------
    value : float
    unit : str
        Empty for a number of things.
    limit : float or None
        In the same unit.

    Examples
    --------
    >>> str(Measure(3.25, "m", 5.0))
    '3.25 m, limit 5 m'
    """

    value: float
    unit: str = ""
    limit: float | None = None

    def __str__(self) -> str:
        text = self._quantity(self.value)
        return text if self.limit is None else f"{text}, limit {self._quantity(self.limit)}"

    def _quantity(self, value: float) -> str:
        number = f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"
        return f"{number} {self.unit}".strip() if self.unit != "%" else f"{number} %"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a check found.

    Parameters
    ----------
    severity : Severity
    code : str
        What was found, in words joined by hyphens; it never changes, so that scripts can rely on it.
    text : str
        What is wrong.
    fix : str
        What to do; empty for a note.
    plan : str
        ``mission``, ``fence`` or ``rally``.
    item : int or None
        Counted from 1, without a home item; None for the plan as a whole. Where several items share a
        finding, the worst.
    command : str
        Name of the item's command.
    measure : Measure or None
    count : int
        How many items share the finding.
    concern : Concern
    """

    severity: Severity
    code: str
    text: str
    fix: str = ""
    plan: str = "mission"
    item: int | None = None
    command: str = ""
    measure: Measure | None = None
    count: int = 1
    concern: Concern = Concern.PLAN

    @property
    def where(self) -> str:
        """The item in words, as a remark of a transfer names it; empty for the mission as a whole.

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
        measured = f" ({self.measure})" if self.measure is not None else ""
        return f"{start}{self.text}{measured}" + (f"; {self.fix}" if self.fix else "")

    def summary(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        measure = self.measure
        return {
            "severity": self.severity.value,
            "code": self.code,
            "concern": self.concern.value,
            "plan": self.plan,
            "item": self.item,
            "command": self.command or None,
            "count": self.count,
            "text": self.text,
            "value": None if measure is None else measure.value,
            "unit": None if measure is None else measure.unit,
            "limit": None if measure is None else measure.limit,
            "fix": self.fix or None,
        }


_ORDER = {severity: rank for rank, severity in enumerate(Severity)}


@dataclass(frozen=True, slots=True)
class Report:
    """All findings of a check, the worst first, else as the checks came to them.

    Parameters
    ----------
    findings : tuple of Finding
    """

    findings: tuple[Finding, ...]

    def __post_init__(self) -> None:
        ordered = sorted(self.findings, key=lambda one: _ORDER[one.severity])
        object.__setattr__(self, "findings", tuple(ordered))

    def of(self, severity: Severity) -> tuple[Finding, ...]:
        """Return the findings of one severity."""
        return tuple(one for one in self.findings if one.severity is severity)

    def about(self, *concerns: Concern) -> Report:
        """Return the report without what is about anything else."""
        return Report(tuple(one for one in self.findings if one.concern in concerns))

    @property
    def has_errors(self) -> bool:
        """Whether the plan must not go up."""
        return bool(self.of(Severity.ERROR))

    @property
    def counts(self) -> dict[str, int]:
        """How many findings there are of each severity."""
        return {f"{severity.value}s": len(self.of(severity)) for severity in Severity}

    def require_no_errors(self, consequence: str) -> None:
        """Raise PreflightError if there are errors; ``consequence`` tells what was not done."""
        errors = self.of(Severity.ERROR)
        if errors:
            more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
            msg = f"{errors[0]}{more}; preflight check: {consequence}, --force does it nevertheless"
            raise PreflightError(msg)


@dataclass(frozen=True, slots=True)
class Hit:
    """An item at which a check struck.

    Parameters
    ----------
    item : int
        Counted from 0.
    value : float
        What was measured there.
    """

    item: int
    value: float


def worst_of(hits: Iterable[Hit], *, largest: bool) -> tuple[Hit, int] | None:
    """Return the worst hit and at how many items there was one; None without any.

    Examples
    --------
    >>> worst_of([Hit(1, 2.0), Hit(4, 3.0), Hit(4, 1.0)], largest=True)
    (Hit(item=4, value=3.0), 2)
    """
    found: Sequence[Hit] = [one for one in hits if not math.isnan(one.value)]
    if not found:
        return None
    worst = (max if largest else min)(found, key=lambda one: one.value)
    return worst, len({one.item for one in found})
