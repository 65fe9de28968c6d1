"""What a check is, and how the functions of a module become checks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

from wbf_mission.check.peer import Peer

__all__ = ["Check", "CheckResult", "Checks", "Verdict"]

Function = Callable[[Peer], str | None]


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
    required : bool
        Ground software relies on it; otherwise it is good to have.
    flies : bool
        It arms the vehicle.
    function : callable
        ``function(peer)`` returns a note or None, and raises `FailedError` or `SkippedError`.
    """

    id: str
    text: str
    required: bool
    flies: bool
    function: Function

    @property
    def group(self) -> str:
        """What stands before the dot."""
        return self.id.partition(".")[0]


@dataclass(frozen=True, slots=True)
class CheckResult:
    """What a check found.

    Parameters
    ----------
    check : Check
    verdict : Verdict
    detail : str
        Why, or what was measured.
    seconds : float
        How long it took.
    """

    check: Check
    verdict: Verdict
    detail: str
    seconds: float

    @property
    def bad(self) -> bool:
        """Whether something required does not hold."""
        return self.verdict is Verdict.FAILED and self.check.required

    def summary(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "id": self.check.id,
            "text": self.check.text,
            "required": self.check.required,
            "result": self.verdict.value,
            "detail": self.detail,
            "seconds": round(self.seconds, 3),
        }


class Checks:
    """The checks of one module, in the order in which they are written.

    Examples
    --------
    >>> checks = Checks()
    >>> @checks("identity.nothing", "it is there")
    ... def nothing(peer):
    ...     return None
    >>> [(one.id, one.required) for one in checks]
    [('identity.nothing', True)]
    """

    def __init__(self) -> None:
        self._checks: list[Check] = []

    def __call__(
        self, name: str, text: str, *, required: bool = True, flies: bool = False
    ) -> Callable[[Function], Function]:
        """Make the decorated function a check; the parameters are those of `Check`."""

        def add(function: Function) -> Function:
            self._checks.append(Check(name, text, required, flies, function))
            return function

        return add

    def __iter__(self) -> Iterator[Check]:
        return iter(self._checks)
