"""Differences between the scores of planners, in pairs of runs on the same environment, with intervals."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wbf_mission.addons.base.intervals import FEWEST_FOR_A_RATIO, MISSED, Interval, mean_intervals
from wbf_mission.addons.base.standings import apart, scored
from wbf_mission.bench.rows import BenchRow

# Minimum number of environments, and true coverage (%) of the 95 % interval if 10 % have a rare outbreak.
_HELD_WITH_RARE = ((40, None), (20, 75), (0, 50))


@dataclass(frozen=True, slots=True)
class Comparison:
    """Difference between the scores of the planners `mine` and `against`; positive if `mine` is better."""

    scenario: str
    estimator: str
    mine: str
    against: str
    environments: int
    """Number of environments on which both planners have a score."""
    score: Interval
    """Mean difference of the scores over the run."""
    final_score: Interval
    """Mean difference of the scores at the end."""
    better: float
    """Fraction of the environments on which `mine` has the better score over the run."""


def compare(rows: Sequence[BenchRow], mine: str | Sequence[str], against: Sequence[str]) -> list[Comparison]:
    """Compare each planner of `mine` with each of `against`, in pairs of runs on the same environment.

    The module `wbf_mission.addons.base.standings` says which environments count, and how a failed run
    scores. Rows are compared only with rows of the same code
    (`apart`). The intervals of a scenario hold jointly in 95 of 100 cases.
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
    """Return two table cells: the difference of scores, and its interval."""
    return [
        "-" if math.isnan(scores.mean) else f"{scores.mean:+.4f}",
        "-" if math.isnan(scores.low) else f"{scores.low:+.3f} to {scores.high:+.3f}",
    ]


def doubt_in_words(count: int) -> str:
    """Return a warning, in words, about rare environments that `count` environments may lack.

    >>> doubt_in_words(40)
    'Events in fewer than 7 % of environments may be missing from these 40, and no interval covers them.'
    """
    if count < 2:
        return "With one environment, there is no interval." if count else ""
    rare = 100.0 * (1.0 - MISSED ** (1.0 / count))
    unseen = f"Events in fewer than {rare:.0f} % of environments may be missing from these {count}"
    texts = [f"{unseen}, and no interval covers them."]
    held = next((held for fewest, held in _HELD_WITH_RARE if count >= fewest), None)
    if held is not None:
        texts.append(f"If rare events decide a mean, its 95 % interval may hold in only {held} of 100 cases.")
    if count < FEWEST_FOR_A_RATIO:
        texts.append(f"Ratios over fewer than {FEWEST_FOR_A_RATIO} environments have no interval.")
    return " ".join(texts)


def verdict(difference: Interval) -> str:
    """Return the verdict of an interval of differences, in words.

    >>> verdict(Interval(0.2, 0.1, 0.3)), verdict(Interval(0.2, -0.1, 0.5))
    ('better', 'undecided')
    """
    if difference.low > 0.0:
        return "better"
    if difference.high < 0.0:
        return "worse"
    return "equal" if difference.low == difference.high == 0.0 else "undecided"
