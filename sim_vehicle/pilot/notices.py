"""What a pilot says: notices to the operator, progress of the mission, refusals."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from sim_vehicle.errors import VehicleError

__all__ = ["MissionState", "Notice", "RefusedError", "Severity"]


class Severity(IntEnum):
    """As MAV_SEVERITY numbers them."""

    CRITICAL = 2
    WARNING = 4
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


class RefusedError(VehicleError):
    """An order that the vehicle does not take.

    Parameters
    ----------
    reason : str
        For the operator.
    denied : bool
        The order can never be taken as it is; False when it may be taken later.
    """

    def __init__(self, reason: str, *, denied: bool = False) -> None:
        super().__init__(reason)
        self.denied = denied
