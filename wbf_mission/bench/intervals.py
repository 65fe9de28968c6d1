"""Intervals of means and of ratios of means over environments."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

_DRAWS = 2000
_SEED = 0
_PART_VALUES = 200_000
_LEAST_ERROR = 1e-9
_FEWEST_TO_RESAMPLE = 7
_SMALL = 1e-3
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean and its interval of 95 %; of one value there is none (`low` and `high` are nan)."""

    mean: float
    low: float
    high: float


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


def ratio_interval(values: NDArray[np.float64], others: NDArray[np.float64]) -> Interval:
    """Return the ratio of the means of two over the same environments and its interval of 95 %.

    The interval is from the 2.5th to the 97.5th percentile of the ratio in resamples of the environments,
    which are drawn for both alike (the paired bootstrap; Efron & Tibshirani, 1993, chapters 10.3 and 13.3);
    of fewer than seven environments there is none. Without a positive mean below there is no ratio.
    """
    count = len(values)
    if count == 0 or not others.mean() > 0.0:
        return Interval(np.nan, np.nan, np.nan)
    ratio = float(values.mean() / others.mean())
    if count < _FEWEST_TO_RESAMPLE:
        return Interval(ratio, np.nan, np.nan)
    ratios = np.full(_DRAWS, np.inf)
    for begin, part in _resamples(count):
        above, below = values[part].mean(axis=1), others[part].mean(axis=1)
        np.divide(above, below, out=ratios[begin : begin + len(part)], where=below > 0.0)
    low, high = np.quantile(ratios, [0.025, 0.975], method="nearest")
    return Interval(ratio, float(low), float(high))


def score_text(value: float) -> str:
    """Return a score or a loss in four decimals, and a small one in two digits that count; "-" of nan.

    >>> [score_text(one) for one in (-0.12345, -0.0008, -3.83e-6, -1e-17, float("nan"))]
    ['-0.1235', '-0.00080', '-3.8e-6', '0.0000', '-']
    """
    if np.isnan(value):
        return "-"
    size = abs(value)
    if size < _ROUNDING:
        return f"{0.0:.4f}"
    return f"{value:.4f}" if size >= _SMALL else f"{value:#.2g}".replace("e-0", "e-")


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
