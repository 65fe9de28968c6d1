"""What the rows of a benchmark tell on the same environments: means with intervals, ranks, differences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from msgspec import structs
from numpy.typing import NDArray
from scipy import stats

from wbf_mission.bench.rows import BenchRow

_DRAWS = 2000
_SEED = 0
_PART_VALUES = 200_000
_LEAST_ERROR = 1e-9
_FEWEST_TO_RESAMPLE = 7


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean and its interval of 95 %; of one value there is none (`low` and `high` are nan)."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Standing:
    """How a planner with an estimator did in a scenario."""

    scenario: str
    planner: str
    estimator: str
    runs: int
    """Good ones, with a score."""
    failed: int
    score: Interval
    """Over the seeds, as at the end; 0 is perfect."""
    final_score: Interval
    behind: Interval
    """By how much the score is below that of the scenario's best, in pairs of runs on the same environment;
    0 and no interval for the best itself."""
    losses: dict[str, float]
    """Mean loss a cell at the end, by field."""
    rank: float
    """Mean over the seeds of its place among all of the scenario, by score; 1 is the best."""
    wins: float
    """Seeds on which it has the best score; shared ones in parts."""
    wall_time_s: float
    """Of a run, in the mean."""
    cpu_time_s: float
    decisions: int
    """Answers of the policy in all runs."""
    bad_answers: dict[str, int]
    """How many of these were not flown or came too late, by what was wrong, also in runs that failed."""


def _resamples(count: int) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield which of `count` environments each resample draws, int64[some, count], the same at every call.

    They come some at a time, with the number of the first: all of a thousand environments would take 16 MB.
    Rows that are resampled alike stay paired.
    """
    draw = np.random.default_rng(_SEED)
    size = max(1, min(_DRAWS, _PART_VALUES // count))
    for begin in range(0, _DRAWS, size):
        yield begin, draw.integers(0, count, (min(size, _DRAWS - begin), count))


def mean_interval(values: NDArray[np.float64]) -> Interval:
    """Return the mean over environments and its interval of 95 %, by the bootstrap-t.

    The interval is that of Student's t with the distribution of t taken from resamples, so that it is right
    for few and for skewed values, too (B. Efron & R. Tibshirani, "An Introduction to the Bootstrap", 1993,
    chapter 12.5); of fewer than seven values, which have too few resamples, it is Student's: with one of five
    far off the other would be many times too wide. There is one value an environment, nan if it has none.
    """
    values = values[np.isfinite(values)]
    count = len(values)
    if count == 0:
        return Interval(np.nan, np.nan, np.nan)
    mean = float(values.mean())
    if count == 1:
        return Interval(mean, np.nan, np.nan)
    if count < _FEWEST_TO_RESAMPLE:
        reach = float(students_reach(values))
        return Interval(mean, mean - reach, mean + reach)
    error = values.std(ddof=1) / np.sqrt(count)
    means, errors = np.empty(_DRAWS), np.empty(_DRAWS)
    for begin, part in _resamples(count):
        drawn = values[part]
        means[begin : begin + len(part)] = drawn.mean(axis=1)
        errors[begin : begin + len(part)] = drawn.std(axis=1, ddof=1) / np.sqrt(count)
    # A resample of one value only has no error.
    usable = errors > _LEAST_ERROR * error
    if not usable.any():
        return Interval(mean, mean, mean)
    low, high = np.quantile((means[usable] - mean) / errors[usable], [0.025, 0.975])
    return Interval(mean, float(mean - high * error), float(mean - low * error))


def students_reach(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far Student's interval of 95 % reaches to both sides of the mean along the first axis.

    Along it is one value an environment, two at least.
    """
    count = len(values)
    return np.asarray(values.std(axis=0, ddof=1) / np.sqrt(count) * stats.t.ppf(0.975, count - 1))


_NAMED = (
    ("scenario", "code"),
    ("scenario", "scenario"),
    ("planner", "planner"),
    ("estimator", "estimator"),
)


def apart(rows: Sequence[BenchRow]) -> Sequence[BenchRow]:
    """Return rows in which what has the same name is the same.

    Where a name stands for several things, because the program, a file or a user's code changed between runs
    or an object has other parameters, the beginning of the digest is added to it. Rows that need nothing of
    this are given back as they are.
    """
    for name, key in _NAMED:
        digests: dict[str, set[str]] = {}
        for row in rows:
            digests.setdefault(getattr(row, name), set()).add(_code(row, key))
        several = {label for label, codes in digests.items() if len(codes) > 1}
        if several:
            rows = [
                structs.replace(row, **{name: f"{getattr(row, name)} [{_code(row, key)[:8]}]"})
                if getattr(row, name) in several
                else row
                for row in rows
            ]
    return rows


def _code(row: BenchRow, key: str) -> str:
    return row.codes.get(key, "built in" if row.codes else "unknown")


def standings(rows: Sequence[BenchRow]) -> list[Standing]:
    """Return the standing of each planner with each estimator, by scenario, the best score first.

    Rows of different code do not stand in one table, see `apart`.
    """
    rows = apart(rows)
    found = []
    for scenario in sorted({row.scenario for row in rows}):
        here = [row for row in rows if row.scenario == scenario]
        pairs = sorted({(row.planner, row.estimator) for row in here})
        seeds = sorted({row.seed for row in here})
        at = {(row.planner, row.estimator, row.seed): row for row in here if row.error is None}
        scores = np.array(
            [[_value(at.get((*pair, seed)), "score") for seed in seeds] for pair in pairs], dtype=np.float64
        )
        ranks, wins = _places(scores)
        means = [mean_interval(one) for one in scores]
        best = max(range(len(pairs)), key=lambda k: (np.isfinite(means[k].mean), means[k].mean))
        group = []
        for k, (planner, estimator) in enumerate(pairs):
            all_of = [row for row in here if (row.planner, row.estimator) == (planner, estimator)]
            good = [row for row in all_of if row.error is None]
            ends = np.array([_value(row, "final_score") for row in good])
            names = dict.fromkeys(name for row in good for name in row.losses)
            group.append(
                Standing(
                    scenario=scenario,
                    planner=planner,
                    estimator=estimator,
                    runs=int(np.isfinite(scores[k]).sum()),
                    failed=len(all_of) - len(good),
                    score=means[k],
                    final_score=mean_interval(ends),
                    behind=Interval(0.0, np.nan, np.nan)
                    if k == best
                    else mean_interval(scores[best] - scores[k]),
                    losses={name: float(np.mean([row.losses[name] for row in good])) for name in names},
                    rank=float(ranks[k]),
                    wins=float(wins[k]),
                    wall_time_s=float(np.mean([row.wall_time_s for row in good])) if good else np.nan,
                    cpu_time_s=float(np.mean([row.cpu_time_s for row in good])) if good else np.nan,
                    decisions=sum(row.decisions or 0 for row in all_of),
                    bad_answers=dict(sum((Counter(row.bad_answers) for row in all_of), Counter[str]())),
                )
            )
        found += sorted(group, key=lambda one: (np.isnan(one.score.mean), -one.score.mean))
    return found


def _value(row: BenchRow | None, name: str) -> float:
    value = None if row is None else getattr(row, name)
    return np.nan if value is None else float(value)


def _places(scores: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean rank and the wins of each row of float64[rows, seeds], which is nan without a score."""
    ranks = stats.rankdata(-scores, axis=0, method="average", nan_policy="omit")
    best = scores == np.nanmax(np.where(np.isnan(scores), -np.inf, scores), axis=0)
    shares = best / np.maximum(best.sum(axis=0), 1)
    counted = np.isfinite(ranks)
    count = np.where(counted.any(axis=1), counted.sum(axis=1), np.nan)
    return np.where(counted, ranks, 0.0).sum(axis=1) / count, shares.sum(axis=1)


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
