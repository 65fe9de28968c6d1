"""A command of an operator to a vehicle, checked before a link is opened, and its errors."""

from __future__ import annotations

from dataclasses import dataclass

from geo.errors import WbfMissionError
from geo.texts import one_line, parse_number, parse_whole

__all__ = [
    "HIGHEST_TAKEOFF_M",
    "LOWEST_TAKEOFF_M",
    "ORDERS",
    "MotorsStandError",
    "OperatorCommand",
    "OrderError",
    "VehicleRefusedError",
    "VehicleSilentError",
]

ORDERS = ("arm", "disarm", "takeoff", "mission", "hold", "resume", "return", "land", "set-item", "mode")
"""The orders; takeoff takes a height in metres, set-item the number of an item, mode its name."""
LOWEST_TAKEOFF_M, HIGHEST_TAKEOFF_M = 1.0, 1000.0
"""Heights above home to which a takeoff is ordered."""
_MOST_ITEMS = 65_534
_TAKES = {
    "takeoff": f"a height above home of {LOWEST_TAKEOFF_M:g} to {HIGHEST_TAKEOFF_M:g} metres",
    "set-item": "the number of an item, counted from 1",
    "mode": "the name of a flight mode",
}


class OrderError(WbfMissionError, ValueError):
    """The order is unknown, or its value is missing or wrong."""


class VehicleRefusedError(WbfMissionError, RuntimeError):
    """The vehicle refused an order."""


class MotorsStandError(WbfMissionError, ValueError):
    """The order would start stopped motors without permission."""


class VehicleSilentError(WbfMissionError, RuntimeError):
    """The vehicle was heard before, but does not answer."""


@dataclass(frozen=True, slots=True)
class OperatorCommand:
    """A command of an operator; OrderError if there is no such order, or its value is missing or wrong.

    Examples
    --------
    >>> OperatorCommand("takeoff", "100000")
    Traceback (most recent call last):
    ...
    mission.ground.command.OrderError: takeoff 100000: give a height above home of 1 to 1000 metres
    """

    order: str
    value: str = ""
    arms: bool = False  # Permission to start stopped motors by an order other than arm

    def __post_init__(self) -> None:
        if self.order not in ORDERS:
            msg = f"order {one_line(self.order, 40)!r} is unknown; there are {', '.join(ORDERS)}"
            raise OrderError(msg)
        takes = _TAKES.get(self.order)
        if takes is None and self.value:
            msg = f"{self}: {self.order} takes nothing more; leave {one_line(self.value, 40)!r} out"
            raise OrderError(msg)
        if takes is not None and not self._is_sound():
            msg = f"{self}: give {takes}"
            raise OrderError(msg)

    def __str__(self) -> str:
        return f"{self.order} {one_line(self.value, 40)}".strip()

    @property
    def height_m(self) -> float:
        """The height of a takeoff."""
        return parse_number(self.value)

    @property
    def item(self) -> int:
        """The item of set-item, counted from 0 as `Mission.items` is."""
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
