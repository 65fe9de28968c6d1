"""The record of what was decided in a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mission.policies.decision import Alternative

PLANNED_PATH = "planned"
"""The outcome of a vehicle's first path, which is flown."""
SKIPPED = "skipped: not worth a flight"
"""The outcome of an empty first path: the vehicle does not fly."""

FLOWN_ALREADY = "not sent: it is flown already"
"""The outcome of a path that is the present one, where a change costs the vehicle its speed."""


@dataclass(slots=True)
class PathChange:
    """What one vehicle was told.

    Parameters
    ----------
    position_m : tuple of float
        Where it was then, in metres of the farm frame.
    path_m : float64[n, 2]
        The new rest of its path.
    cost : float
        What that costs, in the unit of the budget.
    outcome : str
        Of a first path `PLANNED_PATH` or `SKIPPED`. Later "sent" while it is under way, then how it ended:
        "flown", or why the old path was flown on.
    sent_s, effect_s : float or None
        When it was sent, and when the vehicle told that it flies it; seconds since the mission began.
    """

    system_id: int
    position_m: tuple[float, float]
    path_m: NDArray[np.float64]
    cost: float
    outcome: str = "sent"
    sent_s: float | None = None
    effect_s: float | None = None


@dataclass(slots=True)
class DecisionRecord:
    """One question, and what came of it.

    Parameters
    ----------
    day, flight : int
        When in the campaign: the day, and the number of the flight on it, from 1.
    time_s : float
        Seconds since the mission began.
    event : str
        Why the policy was asked.
    observations : int
        How many observations were known.
    reason : str
        The policy's own words.
    compute_s : float
        Wall seconds that the answer took.
    changes : list of PathChange
        Empty when all go on.
    alternatives : tuple of Alternative
        What was thought of.
    refused : str
        Why the answer was not flown; empty if it was.
    fault : str
        What was wrong with the answer, in a word or two; empty if nothing was. One that took longer than it
        may, by the wall clock and in flight, is "too late" and flown all the same: the same seed is to give
        the same flight.
    """

    day: int
    flight: int
    time_s: float
    event: str
    observations: int
    reason: str = ""
    compute_s: float = 0.0
    changes: list[PathChange] = field(default_factory=list)
    alternatives: tuple[Alternative, ...] = ()
    refused: str = ""
    fault: str = ""

    def summary(self) -> dict[str, Any]:
        """Return plain values for JSON; of the alternatives value and cost."""
        return {
            "day": self.day,
            "flight": self.flight,
            "time_s": self.time_s,
            "event": self.event,
            "observations": self.observations,
            "reason": self.reason,
            "compute_s": self.compute_s,
            "refused": self.refused,
            "fault": self.fault,
            "changes": [
                {
                    "vehicle": one.system_id,
                    "points": len(one.path_m),
                    "cost": one.cost,
                    "outcome": one.outcome,
                    "sent_s": one.sent_s,
                    "effect_s": one.effect_s,
                }
                for one in self.changes
            ],
            "alternatives": [
                {"vehicle": one.system_id, "value": one.value, "cost": one.cost} for one in self.alternatives
            ],
        }
