"""What a check is, and how the functions of a module become checks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

from mission.autopilots import ARDUPILOT, PX4
from mission.autopilots.profile import Profile
from wbf_mission.addons.check.peer import Peer

__all__ = ["Check", "CheckResult", "Checks", "Verdict"]

Function = Callable[[Peer], str | None]
Requirement = Callable[[Profile], bool]
_KNOWN = (PX4, ARDUPILOT)


class Verdict(Enum):
    """How a check ended."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class Check:
    """One point.

    Parameters
    ----------
    id : str
        ``group.name``.
    text : str
        What must hold, in one line.
    requirement : callable
        ``requirement(profile)`` tells whether autopilots that behave so have to do it: ground software
        relies on it, and the real ones do it. Otherwise it is advice.
    flies : bool
        It arms the vehicle.
    suffers : str
        Who has trouble with a vehicle that does not do so; empty where it is required of everybody.
    function : callable
        ``function(peer)`` returns a note or None, and raises `FailedError` or `SkippedError`.
    """

    id: str
    text: str
    requirement: Requirement
    flies: bool
    suffers: str
    function: Function

    @property
    def required_of(self) -> str:
        """Of whom it is required, in a word: ``all``, the names of autopilots, or nothing."""
        names = [profile.name for profile in _KNOWN if self.requirement(profile)]
        return "all" if len(names) == len(_KNOWN) else ", ".join(names)

    @property
    def group(self) -> str:
        """What stands before the dot."""
        return self.id.partition(".")[0]


@dataclass(frozen=True, slots=True)
class CheckResult:
    """What a check found: whether it is required here, why or what was measured, how many seconds it took."""

    check: Check
    required: bool
    verdict: Verdict
    detail: str
    seconds: float

    @property
    def bad(self) -> bool:
        """Whether something required does not hold."""
        return self.verdict is Verdict.FAILED and self.required

    @property
    def told(self) -> str:
        """What was seen, and for advice that does not hold, who has trouble with it."""
        if self.verdict is Verdict.FAILED and not self.required and self.check.suffers:
            return f"{self.detail} (trouble for {self.check.suffers})"
        return self.detail

    def summary(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "id": self.check.id,
            "text": self.check.text,
            "required": self.required,
            "result": self.verdict.value,
            "detail": self.detail,
            "suffers": self.check.suffers,
            "seconds": round(self.seconds, 3),
        }


def _everybody(_profile: Profile) -> bool:
    return True


def _nobody(_profile: Profile) -> bool:
    return False


def _first_line(function: Function) -> str:
    """Return the first line of a docstring as a part of a sentence: not "It is there." but "it is there"."""
    text = (function.__doc__ or "").partition("\n")[0].removesuffix(".")
    return text if text[1:2].isupper() or text[1:2] == "_" else text[:1].lower() + text[1:]


class Checks:
    """The checks of one module, in the order in which they are written.

    Examples
    --------
    >>> checks = Checks()
    >>> @checks("identity.nothing", "it is there")
    ... def nothing(peer):
    ...     return None
    >>> [(one.id, one.required_of) for one in checks]
    [('identity.nothing', 'all')]
    """

    def __init__(self) -> None:
        self._checks: list[Check] = []

    def __call__(
        self,
        name: str,
        text: str = "",
        *,
        required: bool | Requirement = True,
        flies: bool = False,
        suffers: str = "",
    ) -> Callable[[Function], Function]:
        """Make the decorated function a check.

        The parameters are those of `Check`; ``required`` is a requirement, or True or False for everybody.
        Without a text it is what the docstring of the function begins with.
        """
        requirement = required if callable(required) else _everybody if required else _nobody

        def add(function: Function) -> Function:
            self._checks.append(
                Check(name, text or _first_line(function), requirement, flies, suffers, function)
            )
            return function

        return add

    def __iter__(self) -> Iterator[Check]:
        return iter(self._checks)
