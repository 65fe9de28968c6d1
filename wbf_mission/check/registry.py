"""The checks by name: each is a small function with an id and one line that says what must hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

from geo.errors import WbfMissionError

if TYPE_CHECKING:
    from wbf_mission.check.peer import Peer

Function = Callable[["Peer"], str | None]


class CheckError(WbfMissionError, ValueError):
    """A check that does not exist."""


class FailedError(WbfMissionError):
    """What a check raises when its point does not hold; the text says what was seen."""


class SkippedError(WbfMissionError):
    """What a check raises when its point cannot be tried on this vehicle; the text says why."""


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


_CHECKS: dict[str, Check] = {}


def check(
    name: str, text: str, *, required: bool = True, flies: bool = False
) -> Callable[[Function], Function]:
    """Register a check; the order of registration is the order of running."""

    def add(function: Function) -> Function:
        _CHECKS[name] = Check(name, text, required, flies, function)
        return function

    return add


def all_checks() -> tuple[Check, ...]:
    """Return every check in its order.

    Examples
    --------
    >>> all_checks()[0].id
    'identity.heartbeat'
    """
    from wbf_mission.check import commands, flight, identity, missions, parameters, transfers  # noqa: F401

    order = ("identity", "command", "telemetry", "param", "mission", "transfer", "fly")
    return tuple(sorted(_CHECKS.values(), key=lambda one: order.index(one.group)))


def chosen_checks(only: tuple[str, ...], *, fly: bool) -> tuple[Check, ...]:
    """Return the checks whose id or group is among ``only`` (empty: all).

    Raises
    ------
    CheckError
        If one of ``only`` is neither an id nor a group.
    """
    checks = all_checks()
    known = {check.id for check in checks} | {check.group for check in checks}
    for name in only:
        if name not in known:
            groups = ", ".join(dict.fromkeys(check.group for check in checks))
            msg = f"unknown check {name!r}: give an id of 'wbf-mission check --list' or a group ({groups})"
            raise CheckError(msg)
    return tuple(
        one for one in checks if (fly or not one.flies) and (not only or one.id in only or one.group in only)
    )
