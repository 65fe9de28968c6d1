"""Reports of the pilot: notices to the operator, progress of the mission, refusals."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from sim_vehicle.errors import VehicleError

__all__ = ["MissionState", "Notice", "NoticeLog", "RefusedError", "Severity"]


class Severity(IntEnum):
    """As MAV_SEVERITY numbers them."""

    CRITICAL = 2
    WARNING = 4
    NOTICE = 5
    INFO = 6


class MissionState(IntEnum):
    """As MISSION_STATE numbers them."""

    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that the operator is told."""

    severity: Severity
    text: str


class NoticeLog:
    """Collects notices until they are sent."""

    def __init__(self) -> None:
        self._notices: list[Notice] = []

    def add(self, severity: Severity, text: str) -> None:
        """Tell the operator."""
        self._notices.append(Notice(severity, text))

    def take(self) -> list[Notice]:
        """Take all notices since the last call."""
        taken, self._notices = self._notices, []
        return taken


class RefusedError(VehicleError):
    """An order that the vehicle does not take.

    Parameters
    ----------
    reason : str
        For the operator.
    denied : bool
        The order can never be taken as it is; False when it may be taken later.
    told : str
        What the autopilot says besides its answer; empty for nothing, as most refusals are.
    """

    def __init__(self, reason: str, *, denied: bool = False, told: str = "") -> None:
        super().__init__(reason)
        self.denied = denied
        self.told = told
