"""Decisions as they are kept in a run's folder."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from mission.policies.decision import Alternative
from wbf_mission.replanning.record import SKIPPED, DecisionRecord, PathChange

_Points = list[tuple[float, float]]


_FORMER_OUTCOMES = {"stays: not worth a flight": SKIPPED}
"""As results of earlier versions have them."""


class _Change(msgspec.Struct, forbid_unknown_fields=True):
    system_id: int
    position_m: tuple[float, float]
    path_m: _Points
    cost: float
    outcome: str
    sent_s: float | None
    effect_s: float | None


class _Alternative(msgspec.Struct, forbid_unknown_fields=True):
    system_id: int
    points_m: _Points
    value: float
    cost: float


class DecisionEntry(msgspec.Struct, forbid_unknown_fields=True):
    """A `DecisionRecord` in plain values."""

    day: int
    flight: int
    time_s: float
    event: str
    observations: int
    reason: str
    compute_s: float
    refused: str
    changes: list[_Change]
    alternatives: list[_Alternative]
    fault: str = ""

    @classmethod
    def of(cls, record: DecisionRecord) -> DecisionEntry:
        """Return the plain values of a record."""
        return cls(
            record.day,
            record.flight,
            record.time_s,
            record.event,
            record.observations,
            record.reason,
            record.compute_s,
            record.refused,
            [
                _Change(
                    one.system_id,
                    one.position_m,
                    one.path_m.tolist(),
                    one.cost,
                    _FORMER_OUTCOMES.get(one.outcome, one.outcome),
                    one.sent_s,
                    one.effect_s,
                )
                for one in record.changes
            ],
            [
                _Alternative(one.system_id, np.asarray(one.points_m).tolist(), one.value, one.cost)
                for one in record.alternatives
            ],
            record.fault,
        )

    def record(self) -> DecisionRecord:
        """Return the record that has these values."""
        return DecisionRecord(
            self.day,
            self.flight,
            self.time_s,
            self.event,
            self.observations,
            self.reason,
            self.compute_s,
            [
                PathChange(
                    one.system_id,
                    one.position_m,
                    _points(one.path_m),
                    one.cost,
                    _FORMER_OUTCOMES.get(one.outcome, one.outcome),
                    one.sent_s,
                    one.effect_s,
                )
                for one in self.changes
            ],
            tuple(
                Alternative(one.system_id, _points(one.points_m), one.value, one.cost)
                for one in self.alternatives
            ),
            self.refused,
            self.fault,
        )


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
                "x_m": np.asarray(one.points_m)[:, 0].tolist(),
                "y_m": np.asarray(one.points_m)[:, 1].tolist(),
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


def _points(rows: _Points) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.asarray(rows, np.float64).reshape(-1, 2)
