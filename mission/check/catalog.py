"""All checks, in the order in which they run."""

from __future__ import annotations

from mission.check import addressing, commands, flight, identity, missions, parameters, transfers
from mission.check.errors import CheckError
from mission.check.registry import Check

__all__ = ["all_checks", "chosen_checks"]

_MODULES = (identity, commands, parameters, missions, transfers, addressing, flight)
_GROUPS = ("identity", "command", "telemetry", "param", "mission", "transfer", "fly")


def all_checks() -> tuple[Check, ...]:
    """Every check in its order.

    Examples
    --------
    >>> all_checks()[0].id
    'identity.heartbeat'
    """
    checks = (one for module in _MODULES for one in module.check)
    return tuple(sorted(checks, key=lambda one: _GROUPS.index(one.group)))


def chosen_checks(only: tuple[str, ...], *, fly: bool) -> tuple[Check, ...]:
    """The checks whose id or group is among ``only`` (empty: all).

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
