"""What rows of a benchmark tell: standings, differences, and losses divided by those of fixed planners."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from wbf_mission.bench.environments import Scored, scored
from wbf_mission.bench.intervals import Interval, mean_intervals, ratio_intervals
from wbf_mission.bench.rows import BenchRow
from wbf_mission.bench.versions import apart


@dataclass(frozen=True, slots=True)
class Standing:
    """How a planner with an estimator did on the environments of a scenario that count (`scored`)."""

    scenario: str
    planner: str
    estimator: str
    environments: int
    failed: int
    """Runs on these that failed, and count as the worst, and those where everybody's failed."""
    score: Interval
    """Over the run, as at the end; 0 is perfect."""
    final_score: Interval
    behind: Interval
    """By how much the score is below that of the scenario's best, in pairs of runs on the same environment;
    the intervals of a scenario hold together. 0 and no interval for the best itself."""
    losses: dict[str, float]
    """Mean loss a cell at the end, by field."""
    losses_over_run: dict[str, float]
    """The same in the mean over the scored times."""
    rank: float
    """Mean over the seeds of its place among all of the scenario, by score; 1 is the best."""
    wins: float
    """Seeds on which it has the best score; shared ones in parts."""
    wall_time_s: float
    """Of a run that went well, in the mean."""
    cpu_time_s: float
    decisions: int
    """Answers of the policy in all runs."""
    bad_answers: dict[str, int]
    """How many of these were not flown or came too late, by what was wrong, also in runs that failed."""

    @property
    def bad_share(self) -> float:
        """The share of the answers that were bad; nan of a planner, which answers once a run."""
        if self.decisions <= self.environments and not self.bad_answers:
            return np.nan
        return sum(self.bad_answers.values()) / max(self.decisions, 1)


def standings(rows: Sequence[BenchRow]) -> list[Standing]:
    """Return the standing of each planner with each estimator, by scenario, the best score first.

    Rows of different code do not stand in one table, see `apart`.
    """
    return [one for group in scored(apart(rows)) for one in standings_of(group)]


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
    return sorted(found, key=lambda one: (np.isnan(one.score.mean), -one.score.mean))


def _means(losses: dict[str, NDArray[np.float64]], k: int) -> dict[str, float]:
    """Return the mean loss of one pair, of each field that it has."""
    return {name: _mean(one[k]) for name, one in losses.items() if np.isfinite(one[k]).any()}


def _mean(values: Iterable[float]) -> float:
    known = np.array([one for one in values if np.isfinite(one)])
    return float(known.mean()) if len(known) else np.nan


def _places(scores: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean rank and the wins of each row of float64[rows, seeds]; nan without any seed."""
    if not scores.shape[1]:
        return np.full(len(scores), np.nan), np.zeros(len(scores))
    ranks = stats.rankdata(-scores, axis=0, method="average")
    best = scores == scores.max(axis=0)
    return ranks.mean(axis=1), (best / best.sum(axis=0)).sum(axis=1)


@dataclass(frozen=True, slots=True)
class Comparison:
    """By how much the scores of one are above those of another; positive is better."""

    scenario: str
    estimator: str
    mine: str
    against: str
    environments: int
    """On which both have a score."""
    score: Interval
    """Mean difference over the run, as at its end."""
    final_score: Interval
    better: float
    """The part of the environments on which the score over the run is better."""


def compare(rows: Sequence[BenchRow], mine: str | Sequence[str], against: Sequence[str]) -> list[Comparison]:
    """Compare one, or each of several, with others, by scenario and estimator, on the same environments.

    Environments and failed runs count as in the `standings`; rows of different code are not compared with
    each other, but by code (`apart`). The intervals of a scenario hold together.
    """
    found: list[Comparison] = []
    several = [mine] if isinstance(mine, str) else mine
    for group in scored(apart(rows)):
        place = {pair: k for k, pair in enumerate(group.pairs)}
        estimators = sorted({estimator for _, estimator in group.pairs})
        named = list(itertools.product(estimators, several, against))
        differences = []
        for estimator, each, other in named:
            both = (each, estimator), (other, estimator)
            known = all(pair in place for pair in both)
            one, two = (place[pair] for pair in both) if known else (0, 0)
            count = len(group.seeds) if known else 0
            differences.append((group.scores[one] - group.scores[two])[:count])
            differences.append((group.final_scores[one] - group.final_scores[two])[:count])
        intervals = mean_intervals(differences, together=True)
        found += [
            Comparison(
                group.scenario,
                estimator,
                each,
                other,
                len(scores),
                over_run,
                at_end,
                float((scores > 0.0).mean()) if len(scores) else np.nan,
            )
            for (estimator, each, other), scores, over_run, at_end in zip(
                named, differences[::2], intervals[::2], intervals[1::2], strict=True
            )
        ]
    return found


WHOLE = "whole"
"""Names the score among the fields."""


@dataclass(frozen=True, slots=True)
class Ratio:
    """The losses of a planner or policy divided by those of the best fixed planner with the same estimator.

    Parameters
    ----------
    fixed : bool
        Whether it is a fixed planner itself: one that decides once, before the flight.
    ratios : dict of str to Interval
        Of the `WHOLE` and of each field; below 1 is better. The intervals with an estimator hold together.
    best : dict of str to str
        The fixed planner by whose loss each is divided: the best in this alone.
    """

    planner: str
    estimator: str
    fixed: bool
    ratios: dict[str, Interval]
    best: dict[str, str]


def by_fixed(group: Scored, *, over_run: bool) -> list[Ratio]:
    """Return the losses of all divided by those of the best fixed planner, the smallest first.

    Each field has a best fixed planner of its own. With an estimator without fixed planners there are none.
    """
    scores, losses = (group.scores, group.losses) if over_run else (group.final_scores, group.final_losses)
    tables = {WHOLE: -scores, **losses}
    found = []
    for estimator in sorted({estimator for _, estimator in group.pairs}):
        places = [k for k, pair in enumerate(group.pairs) if pair[1] == estimator]
        fixed = [k for k in places if _is_fixed(group.rows[k])]
        if not fixed:
            continue
        best = {name: fixed[_least([one[k].mean() for k in fixed])] for name, one in tables.items()}
        pairs = [(one[k], one[best[name]]) for k in places for name, one in tables.items()]
        ratios = iter(ratio_intervals(pairs, together=True))
        found += [
            Ratio(
                planner=group.pairs[k][0],
                estimator=estimator,
                fixed=k in fixed,
                ratios={name: next(ratios) for name in tables},
                best={name: group.pairs[which][0] for name, which in best.items()},
            )
            for k in places
        ]
    return sorted(found, key=lambda one: (one.estimator, one.ratios[WHOLE].mean))


def _least(values: Sequence[float]) -> int:
    return int(np.argmin(np.nan_to_num(values, nan=np.inf)))


def _is_fixed(rows: Sequence[BenchRow]) -> bool:
    good = [row.decisions for row in rows if row.error is None]
    return bool(good) and set(good) == {1}
