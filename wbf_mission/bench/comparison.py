"""One planner or policy against another, on the same environments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbf_mission.bench.row import BenchRow
from wbf_mission.bench.standings import Interval, mean_interval

__all__ = ["Comparison", "compare", "verdict"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """By how much the scores of one are above those of another; positive is better.

    Parameters
    ----------
    environments : int
        On which both have a score.
    score, final_score : Interval
        Mean difference over the run and at its end.
    better : float
        The part of the environments on which the score over the run is better.
    """

    scenario: str
    estimator: str
    mine: str
    against: str
    environments: int
    score: Interval
    final_score: Interval
    better: float


def compare(rows: Sequence[BenchRow], mine: str, against: Sequence[str]) -> list[Comparison]:
    """Compare one with others, by scenario and estimator, in pairs of runs on the same environment."""
    at = {(row.scenario, row.estimator, row.planner, row.seed): row for row in rows if row.error is None}
    found = []
    seeds = sorted({row.seed for row in rows})
    for scenario, estimator in sorted({(row.scenario, row.estimator) for row in rows}):
        for other in against:
            pairs = [
                (at[scenario, estimator, mine, seed], at[scenario, estimator, other, seed])
                for seed in seeds
                if (scenario, estimator, mine, seed) in at and (scenario, estimator, other, seed) in at
            ]
            scores = _differences([(one.score, two.score) for one, two in pairs])
            ends = _differences([(one.final_score, two.final_score) for one, two in pairs])
            found.append(
                Comparison(
                    scenario,
                    estimator,
                    mine,
                    other,
                    len(scores),
                    mean_interval(scores),
                    mean_interval(ends),
                    float((scores > 0.0).mean()) if len(scores) else np.nan,
                )
            )
    return found


def verdict(difference: Interval) -> str:
    """Return in words what an interval of differences tells.

    >>> verdict(Interval(0.2, 0.1, 0.3)), verdict(Interval(0.2, -0.1, 0.5))
    ('better', 'cannot be told')
    """
    if difference.low > 0.0:
        return "better"
    if difference.high < 0.0:
        return "worse"
    return "equal" if difference.low == difference.high == 0.0 else "cannot be told"


def _differences(pairs: Sequence[tuple[float | None, float | None]]) -> NDArray[np.float64]:
    return np.array([one - two for one, two in pairs if one is not None and two is not None], np.float64)
