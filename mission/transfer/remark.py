"""What is said of a plan before it is sent: what an autopilot would refuse, change or ignore."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mission.autopilots.dialect import Severity
from mission.model import MissionType
from mission.transfer.wire import command_name

__all__ = ["Remark", "Severity"]


@dataclass(frozen=True, slots=True)
class Remark:
    """One thing about a plan that an autopilot does not take as it is.

    Parameters
    ----------
    item : int or None
        The item of the plan that was made, from 0 (a user counts from 1); None for the plan as a whole. Where
        several items share a remark, the first.
    text : str
        What is wrong, or what is done about it.
    fix : str
        What would be accepted; empty where nothing has to be done.
    command : int or None
        MAV_CMD of the item.
    others : tuple of int
        Further items that share the remark.
    parameter : str
        The vehicle's parameter that decides it; empty if none does.

    Examples
    --------
    >>> print(Remark(MissionType.MISSION, 4, Severity.ERROR, "PX4 does not know it", "leave it out", 18))
    mission item 5 (NAV_LOITER_TURNS): PX4 does not know it; leave it out
    """

    plan: MissionType
    item: int | None
    severity: Severity
    text: str
    fix: str = ""
    command: int | None = None
    others: tuple[int, ...] = ()
    parameter: str = ""

    @property
    def count(self) -> int:
        """How many items it is about."""
        return 1 + len(self.others)

    def summary(self) -> dict[str, Any]:
        """Return plain values for JSON; items count from 1."""
        return {
            "plan": self.plan.name.lower(),
            "item": None if self.item is None else self.item + 1,
            "command": None if self.command is None else command_name(self.command),
            "count": self.count,
            "parameter": self.parameter or None,
            "severity": self.severity.value,
            "text": self.text,
            "fix": self.fix,
        }

    def __str__(self) -> str:
        where = self.plan.name.lower()
        if self.item is not None:
            where += f" item {self.item + 1}"
        if self.command is not None:
            where += f" ({command_name(self.command)})"
        if self.count > 1:
            where += f" and {self.count - 1} more"
        return f"{where}: {self.text}" + (f"; {self.fix}" if self.fix else "")
