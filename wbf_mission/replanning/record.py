"""The record of what was decided in a run, and how it is kept in files."""

from __future__ import annotations

from collections.abc import Sequence
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

    def __post_init__(self) -> None:
        self.path_m = np.reshape(self.path_m, (-1, 2))


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
        Seconds that the answer took, without those in which it waited for a core.
    changes : list of PathChange
        Empty when all go on.
    alternatives : tuple of Alternative
        What was thought of.
    refused : str
        Why the answer was not flown; empty if it was.
    fault : str
        What was wrong with the answer, in a word or two; empty if nothing was. One that took longer than it
        may in flight, by `compute_s`, is "too late" and flown all the same: the same seed is to give
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


def decision_table(records: Sequence[DecisionRecord]) -> Any:
    """Return decisions as a pyarrow table: a row for each alternative and each change of a path.

    ``kind`` is "change", "alternative" or "go on"; the points are lists of x and of y in metres of the farm
    frame.
    """
    import pyarrow as pa

    rows = []
    for number, record in enumerate(records):
        base = {
            "decision": number,
            "day": record.day,
            "flight": record.flight,
            "time_s": record.time_s,
            "event": record.event,
            "observations": record.observations,
            "reason": record.refused or record.reason,
        }
        told = [
            {
                "kind": "change",
                "vehicle": one.system_id,
                "cost": one.cost,
                "outcome": one.outcome,
                "sent_s": one.sent_s,
                "effect_s": one.effect_s,
                "x_m": one.path_m[:, 0].tolist(),
                "y_m": one.path_m[:, 1].tolist(),
            }
            for one in record.changes
        ]
        told += [
            {
                "kind": "alternative",
                "vehicle": one.system_id,
                "value": one.value,
                "cost": one.cost,
                "x_m": one.points_m[:, 0].tolist(),
                "y_m": one.points_m[:, 1].tolist(),
            }
            for one in record.alternatives
        ]
        rows += [{**base, **one} for one in (told or [{"kind": "go on"}])]
    return pa.Table.from_pylist(rows, schema=_schema())


def _schema() -> Any:
    import pyarrow as pa

    points = pa.list_(pa.float64())
    return pa.schema(
        {
            "decision": pa.int32(),
            "day": pa.int32(),
            "flight": pa.int32(),
            "time_s": pa.float64(),
            "event": pa.string(),
            "observations": pa.int64(),
            "reason": pa.string(),
            "kind": pa.string(),
            "vehicle": pa.int32(),
            "value": pa.float64(),
            "cost": pa.float64(),
            "outcome": pa.string(),
            "sent_s": pa.float64(),
            "effect_s": pa.float64(),
            "x_m": points,
            "y_m": points,
        }
    )
