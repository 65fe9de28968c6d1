"""Commands of an operator to a vehicle, validated before a link is opened, and their errors."""

from __future__ import annotations

from dataclasses import dataclass

from geo.errors import WbfMissionError
from geo.texts import one_line, parse_number, parse_whole, unknown

ORDERS = ("arm", "disarm", "takeoff", "mission", "hold", "resume", "return", "land", "set-item", "mode")
"""Names of the orders. takeoff needs a height (m), set-item an item number, mode the name of a mode."""
LOWEST_TAKEOFF_M, HIGHEST_TAKEOFF_M = 1.0, 1000.0
"""Limits of the take-off height above home (m)."""
_MOST_ITEMS = 65_534
_TAKES = {
    "takeoff": f"a height above home of {LOWEST_TAKEOFF_M:g} to {HIGHEST_TAKEOFF_M:g} metres",
    "set-item": "the number of an item, counted from 1",
    "mode": "the name of a flight mode",
}


class OrderError(WbfMissionError, ValueError):
    """The order is unknown, or its value is missing or invalid."""


class VehicleRefusedError(WbfMissionError, RuntimeError):
    """The vehicle refused an order."""


class MotorsStandError(WbfMissionError, ValueError):
    """The order would start stopped motors, and the operator has not permitted that."""


class VehicleSilentError(WbfMissionError, RuntimeError):
    """The vehicle sent heartbeats but does not answer."""


@dataclass(frozen=True, slots=True)
class OperatorCommand:
    """Operator's command; raises OrderError if the order is unknown or its value is missing or invalid.

    >>> OperatorCommand("takeoff", "100000")
    Traceback (most recent call last):
    ...
    mission.ground.command.OrderError: takeoff 100000: give a height above home of 1 to 1000 metres
    """

    order: str
    value: str = ""
    arms: bool = False  # permission to start stopped motors with an order other than arm

    def __post_init__(self) -> None:
        if self.order not in ORDERS:
            raise OrderError(unknown("order", self.order, ORDERS))
        takes = _TAKES.get(self.order)
        if takes is None and self.value:
            msg = f"{self}: {self.order} takes nothing more; leave {one_line(self.value, 40)!r} out"
            raise OrderError(msg)
        if takes is not None and not self._is_sound():
            raise OrderError(f"{self}: give {takes}")

    def __str__(self) -> str:
        return f"{self.order} {one_line(self.value, 40)}".strip()

    @property
    def height_m(self) -> float:
        """Take-off height above home (m)."""
        return parse_number(self.value)

    @property
    def item(self) -> int:
        """Item number of set-item, counted from 0 like `Mission.items`."""
        return parse_whole(self.value) - 1

    def _is_sound(self) -> bool:
        if self.order == "mode":
            return bool(self.value.strip())
        try:
            if self.order == "set-item":
                return 0 <= self.item < _MOST_ITEMS
            return LOWEST_TAKEOFF_M <= self.height_m <= HIGHEST_TAKEOFF_M
        except ValueError:
            return False
