"""Definition of a check, and a decorator that registers functions as checks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

from mission.autopilots import ARDUPILOT, PX4
from mission.autopilots.profile import Profile
from wbf_mission.addons.check.peer import Peer

Function = Callable[[Peer], str | None]
Requirement = Callable[[Profile], bool]
_KNOWN = (PX4, ARDUPILOT)


class Verdict(Enum):
    """Outcome of a check."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class Check:
    """One check of the conformance kit."""

    id: str  # ``group.name``
    text: str  # The requirement in one line
    # Returns whether an autopilot with a given profile must pass, because ground software relies on the
    # behaviour and real autopilots show it. A check that is not required gives only advice.
    requirement: Requirement
    flies: bool  # Whether the check arms the vehicle
    suffers: str  # Software that has trouble with a failing vehicle; empty if all autopilots must pass.
    function: Function  # Returns a note or None, and raises `FailedError` or `SkippedError`.

    @property
    def required_of(self) -> str:
        """Autopilots that must pass: ``all``, or their names; an empty text for none."""
        names = [profile.name for profile in _KNOWN if self.requirement(profile)]
        return "all" if len(names) == len(_KNOWN) else ", ".join(names)

    @property
    def group(self) -> str:
        """The part of the id that precedes the dot."""
        return self.id.partition(".")[0]


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Result of a check. `required` is whether the vehicle must pass, `detail` describes the observation."""

    check: Check
    required: bool
    verdict: Verdict
    detail: str
    seconds: float

    @property
    def bad(self) -> bool:
        """Whether a required check failed."""
        return self.verdict is Verdict.FAILED and self.required

    @property
    def told(self) -> str:
        """The observation; if a check that gives only advice failed, also the affected software."""
        if self.verdict is Verdict.FAILED and not self.required and self.check.suffers:
            return f"{self.detail} (trouble for {self.check.suffers})"
        return self.detail

    def summary(self) -> dict[str, Any]:
        """Return the result as JSON values."""
        return {
            "id": self.check.id,
            "text": self.check.text,
            "required": self.required,
            "result": self.verdict.value,
            "detail": self.detail,
            "suffers": self.check.suffers,
            "seconds": round(self.seconds, 3),
        }


def _first_line(function: Function) -> str:
    """Return the first docstring line as a clause: "It is there." becomes "it is there"."""
    text = (function.__doc__ or "").partition("\n")[0].removesuffix(".")
    return text if text[1:2].isupper() or text[1:2] == "_" else text[:1].lower() + text[1:]


class Checks(list[Check]):
    """Checks of one module, in order of definition.

    >>> checks = Checks()
    >>> @checks("identity.nothing", "it is there")
    ... def nothing(peer):
    ...     return None
    >>> [(one.id, one.required_of) for one in checks]
    [('identity.nothing', 'all')]
    """

    def __call__(
        self,
        name: str,
        text: str = "",
        *,
        required: bool | Requirement = True,
        flies: bool = False,
        suffers: str = "",
    ) -> Callable[[Function], Function]:
        """Register the decorated function as a check.

        Parameters as of `Check`. `required` is a requirement, or a bool that holds for all autopilots. `text`
        defaults to the first line of the function's docstring.
        """
        requirement = required if callable(required) else lambda _profile: required

        def add(function: Function) -> Function:
            self.append(Check(name, text or _first_line(function), requirement, flies, suffers, function))
            return function

        return add
