"""Standings of benchmark rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from wbf_mission.bench.environments import Scored, scored
from wbf_mission.bench.intervals import Interval, mean_intervals
from wbf_mission.bench.rows import BenchRow
from wbf_mission.bench.versions import apart


@dataclass(frozen=True, slots=True)
class Standing:
    """Result of a planner with an estimator, over the counted environments of a scenario (`scored`)."""

    scenario: str
    planner: str
    estimator: str
    environments: int
    failed: int
    """Number of failed runs, which count as the worst; includes environments where all runs failed."""
    score: Interval
    """Mean score over the scored times of a run; 0 is perfect."""
    final_score: Interval
    """Score at the end of a run; 0 is perfect."""
    behind: Interval
    """Difference between the score of the scenario's best and this score, paired by environment.

    The intervals of a scenario are simultaneous. The best has 0 and no interval."""
    losses: dict[str, float]
    """Mean loss per cell at the end, by field."""
    losses_over_run: dict[str, float]
    """Mean loss per cell over the scored times, by field."""
    rank: float
    """Mean rank by score over the seeds, among all of the scenario; 1 is the best."""
    wins: float
    """Number of seeds with the best score; k pairs that share a win get 1/k each."""
    wall_time_s: float
    """Mean wall time of the successful runs (s)."""
    cpu_time_s: float
    """Mean CPU time of the successful runs (s)."""
    decisions: int
    """Number of answers of the policy in all runs."""
    bad_answers: dict[str, int]
    """Number of answers not flown or too late, by fault; failed runs included."""

    @property
    def named(self) -> str:
        """Planner and estimator."""
        return f"{self.planner}, {self.estimator}"

    @property
    def bad_share(self) -> float:
        """Share of bad answers; nan for a planner, which answers once per run."""
        if self.decisions <= self.environments and not self.bad_answers:
            return np.nan
        return sum(self.bad_answers.values()) / max(self.decisions, 1)


def standings(rows: Sequence[BenchRow]) -> list[Standing]:
    """Return the standing of each planner with each estimator, by scenario, the best score first.

    Rows of different code get different names (`apart`).
    """
    return [standing for group in scored(apart(rows)) for standing in standings_of(group)]


def standings_of(group: Scored) -> list[Standing]:
    """Return the standings in one scenario, the best score first."""
    ranks, wins = _places(group.scores)
    means, ends = mean_intervals(group.scores), mean_intervals(group.final_scores)
    best = max(range(len(means)), key=lambda k: (np.isfinite(means[k].mean), means[k].mean))
    behind = mean_intervals([group.scores[best] - own for own in group.scores], together=True)
    all_failed = sum(not lacking for lacking in group.left_out.values())
    found = []
    for k, (planner, estimator) in enumerate(group.pairs):
        own = group.rows[k]
        good = [row for row in own if row.error is None]
        found.append(
            Standing(
                scenario=group.scenario,
                planner=planner,
                estimator=estimator,
                environments=len(own),
                failed=len(own) - len(good) + all_failed,
                score=means[k],
                final_score=ends[k],
                behind=Interval(0.0, np.nan, np.nan) if k == best else behind[k],
                losses=_means(group.final_losses, k),
                losses_over_run=_means(group.losses, k),
                rank=float(ranks[k]),
                wins=float(wins[k]),
                wall_time_s=_mean(row.wall_time_s for row in good),
                cpu_time_s=_mean(row.cpu_time_s for row in good),
                decisions=sum(row.decisions or 0 for row in own),
                bad_answers=dict(sum((Counter(row.bad_answers) for row in own), Counter[str]())),
            )
        )
    return sorted(found, key=lambda standing: (np.isnan(standing.score.mean), -standing.score.mean))


def _means(losses: dict[str, NDArray[np.float64]], k: int) -> dict[str, float]:
    """Return the mean loss of pair `k`, by field; fields without a finite loss are left out."""
    return {name: _mean(table[k]) for name, table in losses.items() if np.isfinite(table[k]).any()}


def _mean(values: Iterable[float]) -> float:
    known = np.array([value for value in values if np.isfinite(value)])
    return float(known.mean()) if len(known) else np.nan


def _places(scores: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean rank and the wins of each row of float64[rows, seeds]; ranks are nan without seeds."""
    if not scores.shape[1]:
        return np.full(len(scores), np.nan), np.zeros(len(scores))
    ranks = stats.rankdata(-scores, axis=0, method="average")
    best = scores == scores.max(axis=0)
    return ranks.mean(axis=1), (best / best.sum(axis=0)).sum(axis=1)
