"""Confidence intervals of means and of ratios of means over environments.

The method is the bootstrap-t of Fieller's statistic. If r is the ratio of the means of `values` and `others`,
the differences ``values - r * others`` have mean 0. The interval contains each r for which a t-test does not
reject mean 0 (E. C. Fieller, "Some problems in interval estimation", J. R. Stat. Soc. B 16, 1954). The
distribution of t is taken from resamples (J. T. G. Hwang, "Fieller's problems and resampling techniques",
Statistica Sinica 5, 1995), but its limits are never narrower than the limits of Student's distribution. A
mean is computed as a ratio whose `others` are all 1.

A resample weights each environment by a draw from Beta(1/2, 3/2). To second order, weights are as accurate as
drawing whole environments, but the intervals are shorter, and the intervals of means are always finite (A. B.
Owen, "Better bootstrap t confidence intervals for the mean", arXiv:2508.10083, 2025).
`benchmarks/interval_coverage.py` compares this method with other methods.

Sums run over the environments in order, and weights need only basic arithmetic, so equal rows give bit-equal
intervals on every processor.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Pair = tuple[NDArray[np.float64], NDArray[np.float64]]

_DRAWS = 1999  # one less than a multiple of 40, so that the 2.5 % and 97.5 % limits are draws
_SEED = 0
MISSED = 0.05
"""Fraction of cases in which an interval does not contain the true value."""
_FEWEST_TO_RESAMPLE = 5
FEWEST_FOR_A_RATIO = 8
_NONE = 1e-12  # below this relative spread, values differ only by rounding
_SMALL = 1e-3
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean or ratio with its 95 % interval; `low` and `high` are nan if there is no interval."""

    mean: float
    low: float
    high: float


def mean_intervals(several: Iterable[NDArray[np.float64]], *, together: bool = False) -> list[Interval]:
    """Return means over environments with their 95 % intervals.

    Each array has one value per environment; a missing value is nan. Below five values, Student's t is used.

    With `together`, the intervals are simultaneous: all of them hold in 95 of 100 cases. All intervals are
    widened to the same quantile, chosen so that 5 % of the resamples lie outside at least one interval (R.
    Beran, "Balanced simultaneous confidence sets", J. Am. Stat. Assoc. 83, 1988). All arrays must have the
    environments in the same order.
    """
    known = [values[np.isfinite(values)] for values in several]
    return _intervals([(values, np.ones(len(values))) for values in known], fewest=2, together=together)


def ratio_intervals(pairs: Sequence[Pair], *, together: bool = False) -> list[Interval]:
    """Return a ratio of means with its 95 % interval for each pair of arrays.

    The ratio is the mean of the first array divided by the mean of the second. Both arrays have one value per
    environment, in the same order. Below eight environments there is no interval. If the second mean is not
    positive, there is no ratio; if it may be 0, `high` is infinite. `together` is as for `mean_intervals`.
    """
    return _intervals(pairs, fewest=FEWEST_FOR_A_RATIO, together=together)


def _intervals(pairs: Sequence[Pair], *, fewest: int, together: bool) -> list[Interval]:
    found = [_ratio(values, others) for values, others in pairs]
    spread = [k for k, ratio in enumerate(found) if len(pairs[k][0]) >= fewest and math.isfinite(ratio)]
    residuals = {k: pairs[k][0] - found[k] * pairs[k][1] for k in spread}
    sizes = {k: np.abs(pairs[k][0]).max() for k in spread}
    equal = [k for k in spread if np.abs(residuals[k]).max() <= _NONE * sizes[k]]
    spread = [k for k in spread if k not in set(equal)]
    intervals = [Interval(ratio, math.nan, math.nan) for ratio in found]
    for k in equal:
        intervals[k] = Interval(found[k], found[k], found[k])
    for k, (least, most) in zip(spread, _limits([residuals[k] for k in spread], together), strict=True):
        intervals[k] = Interval(found[k], *_fieller(*pairs[k], float(least), float(most)))
    return intervals


def _ratio(values: NDArray[np.float64], others: NDArray[np.float64]) -> float:
    below = math.fsum(others)
    return math.fsum(values) / below if len(values) and below > 0.0 else math.nan


def _limits(residuals: Sequence[NDArray[np.float64]], together: bool) -> NDArray[np.float64]:
    """Return the lower and upper limit of t for each array of residuals, float64[residuals, 2]."""
    counts = np.array([len(values) for values in residuals], dtype=np.int64)
    many = np.flatnonzero(counts >= _FEWEST_TO_RESAMPLE)
    missed = np.full(len(counts), MISSED / (max(len(counts), 1) if together else 1))
    limits = np.zeros((len(counts), 2))
    if len(many):
        drawn = _drawn(residuals, many, counts)
        outside = round(MISSED / 2.0 * (_DRAWS + 1))
        ordered = np.sort(drawn, axis=1)
        if together:
            ranks = drawn.argsort(axis=1, kind="stable").argsort(axis=1, kind="stable")
            farthest = np.minimum(ranks, _DRAWS - 1 - ranks).min(axis=0)
            outside = 1 + int(np.sort(farthest)[int(MISSED * _DRAWS)])
        limits[many] = ordered[:, [outside - 1, _DRAWS - outside]]
        missed[many] = 2.0 * outside / (_DRAWS + 1)
    student = stats.t.ppf(1.0 - missed / 2.0, counts - 1) * np.sqrt(counts / (counts - 1.0))
    return np.stack([np.minimum(limits[:, 0], -student), np.maximum(limits[:, 1], student)], axis=1)


def _drawn(
    residuals: Sequence[NDArray[np.float64]], many: NDArray[np.int64], counts: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return resampled t-statistics, float64[comparison, draw]; all comparisons use the same weights."""
    draw = np.random.default_rng(_SEED)
    t = np.empty((len(many), _DRAWS))
    sums, squares, weights = np.zeros_like(t), np.zeros_like(t), np.zeros(_DRAWS)
    for place in range(counts.max()):
        weight = _weights(draw)
        weights += weight
        has = np.flatnonzero(counts[many] > place)
        values = np.array([residuals[many[k]][place] for k in has])[:, None]
        sums[has] += values * weight
        squares[has] += values * values * weight
        ends = np.flatnonzero(counts[many] == place + 1)
        means = sums[ends] / weights
        errors = np.sqrt(np.maximum(squares[ends] / weights - means * means, np.finfo(float).tiny))
        t[ends] = means * math.sqrt(place + 1) / errors
    return t


def _weights(draw: np.random.Generator) -> NDArray[np.float64]:
    """Return draws from Beta(1/2, 3/2): squared x coordinates of uniform points in the unit disc."""
    x, y = 2.0 * draw.random((2, 2 * _DRAWS)) - 1.0
    return np.asarray((x * x)[x * x + y * y < 1.0][:_DRAWS])


def _fieller(
    values: NDArray[np.float64], others: NDArray[np.float64], least: float, most: float
) -> tuple[float, float]:
    """Return the lowest and highest r for which ``values - r * others`` has a t from `least` to `most`."""
    count = len(values)
    above, below = math.fsum(values) / count, math.fsum(others) / count
    up, down = values - above, others - below
    squares = math.fsum(up * up), math.fsum(up * down), math.fsum(down * down)

    def limit(t: float, side: float) -> float:
        c, b, a = (
            n * count * count - t * t * s
            for n, s in zip((above * above, above * below, below * below), squares, strict=True)
        )
        return (b + side * math.sqrt(max(b * b - a * c, 0.0))) / a if a > 0.0 else side * math.inf

    low, high = limit(most, -1.0), limit(least, 1.0)
    positive = min(values) >= 0.0 and min(others) >= 0.0
    return (max(low, 0.0) if positive else low), high


def score_text(value: float) -> str:
    """Return a score or loss as text: four decimals, two significant digits if it is small, "-" for nan.

    >>> [score_text(score) for score in (-0.12345, -0.0008, -3.83e-6, -1e-17, float("nan"))]
    ['-0.1235', '-0.00080', '-3.8e-6', '0.0000', '-']
    """
    if np.isnan(value):
        return "-"
    size = abs(value)
    if size < _ROUNDING:
        return f"{0.0:.4f}"
    return f"{value:.4f}" if size >= _SMALL else f"{value:#.2g}".replace("e-0", "e-")
