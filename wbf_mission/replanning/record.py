"""Records of the decisions in a run, and their tables for files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mission.policies.decision import Alternative

PLANNED_PATH = "planned"
"""Outcome of a vehicle's first path."""
SKIPPED = "skipped: not worth a flight"
"""Outcome of an empty first path: the vehicle does not fly."""

FLOWN_ALREADY = "not sent: it is flown already"
"""Outcome of a new path that equals the current path, for a vehicle that would slow down for the change."""


@dataclass(slots=True)
class PathChange:
    """A new path of one vehicle.

    Parameters
    ----------
    system_id : int
        System id of the vehicle.
    position_m : tuple of float
        Position at the decision, in metres of the farm frame.
    path_m : float64[n, 2]
        Points of the new path.
    cost : float
        Cost of the new path, in the unit of the budget.
    outcome : str
        `PLANNED_PATH` or `SKIPPED` for a first path. For a later path: "sent" during the transfer, then
        "flown", or the reason why the vehicle keeps its old path.
    sent_s, effect_s : float or None
        Times of sending and of the vehicle's switch to the new path, in seconds since the mission began.
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
    """Record of one decision.

    Parameters
    ----------
    day, flight : int
        Day of the campaign, and number of the flight on this day, from 1.
    time_s : float
        Seconds since the mission began.
    event : str
        Reason for asking the policy, a value of `Event`.
    observations : int
        Number of observations known at the decision.
    reason : str
        Reason of the decision, as given by the policy.
    compute_s : float
        Computing time of the decision (s), without the time spent waiting for a core.
    changes : list of PathChange
        New paths; empty if all vehicles keep their paths.
    alternatives : tuple of Alternative
        Candidate paths that the policy compared.
    refused : str
        Reason why the decision was not flown; empty if the decision was flown.
    fault : str
        Fault of the decision in a word or two; empty if there is none. A decision in flight that exceeds its
        time limit is "too late", but still flown, so that equal seeds give equal flights.
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
        """Return the record as plain values for JSON, without the points of paths."""
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
                    "vehicle": change.system_id,
                    "points": len(change.path_m),
                    "cost": change.cost,
                    "outcome": change.outcome,
                    "sent_s": change.sent_s,
                    "effect_s": change.effect_s,
                }
                for change in self.changes
            ],
            "alternatives": [
                {"vehicle": path.system_id, "value": path.value, "cost": path.cost}
                for path in self.alternatives
            ],
        }


def decision_table(records: Sequence[DecisionRecord]) -> Any:
    """Return decisions as a pyarrow table with a row for each alternative and each change of a path.

    ``kind`` is "change", "alternative" or "go on" (a decision without either). ``x_m`` and ``y_m`` are the
    lists of coordinates in metres of the farm frame.
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
        details: list[dict[str, Any]] = []
        for change in record.changes:
            times = {"sent_s": change.sent_s, "effect_s": change.effect_s}
            details.append({"kind": "change", "outcome": change.outcome, **times, **_path(change)})
        details += [
            {"kind": "alternative", "value": path.value, **_path(path)} for path in record.alternatives
        ]
        rows += [{**base, **detail} for detail in (details or [{"kind": "go on"}])]
    points = pa.list_(pa.float64())
    schema = pa.schema(
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
    return pa.Table.from_pylist(rows, schema=schema)


def _path(path: PathChange | Alternative) -> dict[str, Any]:
    x_m, y_m = (path.path_m if isinstance(path, PathChange) else path.points_m).T.tolist()
    return {"vehicle": path.system_id, "cost": path.cost, "x_m": x_m, "y_m": y_m}
