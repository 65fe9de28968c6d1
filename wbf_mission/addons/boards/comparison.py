"""Differences between the scores of planners, in pairs of runs on the same environment."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wbf_mission.bench.environments import scored
from wbf_mission.bench.intervals import Interval, mean_intervals
from wbf_mission.bench.rows import BenchRow
from wbf_mission.bench.versions import apart


@dataclass(frozen=True, slots=True)
class Comparison:
    """Difference between the scores of `mine` and `against`; positive is better for `mine`."""

    scenario: str
    estimator: str
    mine: str
    against: str
    environments: int
    """Number of environments on which both have a score."""
    score: Interval
    """Mean difference of the scores over the run."""
    final_score: Interval
    """Mean difference of the scores at the end."""
    better: float
    """Share of the environments on which `mine` has the better score over the run."""


def compare(rows: Sequence[BenchRow], mine: str | Sequence[str], against: Sequence[str]) -> list[Comparison]:
    """Compare each planner of `mine` with each of `against`, in pairs of runs on the same environment.

    Environments and failed runs count as in `standings`. Rows are compared only with rows of the same code
    (`apart`). The intervals of a scenario are simultaneous.
    """
    found: list[Comparison] = []
    planners = [mine] if isinstance(mine, str) else mine
    for group in scored(apart(rows)):
        place = {pair: k for k, pair in enumerate(group.pairs)}
        estimators = sorted({estimator for _, estimator in group.pairs})
        named = list(itertools.product(estimators, planners, against))
        differences = []
        for estimator, planner, other in named:
            both = (planner, estimator), (other, estimator)
            known = all(pair in place for pair in both)
            first, second = (place[pair] for pair in both) if known else (0, 0)
            count = len(group.seeds) if known else 0
            differences.append((group.scores[first] - group.scores[second])[:count])
            differences.append((group.final_scores[first] - group.final_scores[second])[:count])
        intervals = mean_intervals(differences, together=True)
        found += [
            Comparison(
                group.scenario,
                estimator,
                planner,
                other,
                len(scores),
                over_run,
                at_end,
                float((scores > 0.0).mean()) if len(scores) else np.nan,
            )
            for (estimator, planner, other), scores, over_run, at_end in zip(
                named, differences[::2], intervals[::2], intervals[1::2], strict=True
            )
        ]
    return found


def difference(scores: Interval) -> list[str]:
    """Return the table cells of a difference of scores and its interval."""
    return [
        "-" if math.isnan(scores.mean) else f"{scores.mean:+.4f}",
        "-" if math.isnan(scores.low) else f"{scores.low:+.3f} to {scores.high:+.3f}",
    ]
