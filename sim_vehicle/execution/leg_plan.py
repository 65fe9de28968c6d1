"""A plan of legs that is flown without asking again, and what follows it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim_vehicle.motion.legs import Leg


class AfterLastLeg(Enum):
    """Continuation after the last leg of a plan."""

    NEXT = "the next item"
    WAIT = "a pause"
    FOREVER = "nothing, it stays"
    TOUCHDOWN = "the ground"


@dataclass(slots=True)
class LegPlan:
    """Legs and what they complete.

    Parameters
    ----------
    legs : list of Leg
    seqs : list of int
        The item that each leg belongs to, -1 outside a mission.
    done : list of bool
        Whether the leg completes its item.
    speeds : list of float or None
        The ground speed that was set for the leg; a curve may be flown more slowly.
    after_last : AfterLastLeg
    wait_s : float
        Of a WAIT; NaN until the time of day that the item names.
    open : bool
        Whether it was cut short, so it has to be planned again before its end.
    unsure : bool
        Whether something between its items waits for a condition, which may change it.
    """

    legs: list[Leg] = field(default_factory=list)
    seqs: list[int] = field(default_factory=list)
    done: list[bool] = field(default_factory=list)
    speeds: list[float | None] = field(default_factory=list)
    after_last: AfterLastLeg = AfterLastLeg.NEXT
    wait_s: float = 0.0
    open: bool = False
    unsure: bool = False

    def add(self, leg: Leg, seq: int = -1, *, done: bool = False, speed: float | None = None) -> None:
        """Append a leg."""
        self.speeds.append(leg.speed_m_s if speed is None else speed)
        self.legs.append(leg)
        self.seqs.append(seq)
        self.done.append(done)

    def prepend(self, leg: Leg, seq: int) -> None:
        """Put a leg before all others; it completes nothing."""
        self.legs.insert(0, leg)
        self.speeds.insert(0, leg.speed_m_s)
        self.seqs.insert(0, seq)
        self.done.insert(0, False)
