"""Class probabilities of plants, derived from a Gaussian process's posterior mean of a disease.

The normal distribution of the process does not give the probability that a plant is sick, but this
probability rises with the posterior mean of the illness. Let i be the posterior and i0 the prior mean of the
illness (1 minus the value), and p0 the fraction of sick plants. The model of the odds that a plant is sick is

    p / (1 - p) = p0 / (1 - p0) ((max(i, 0) / i0 + c) / (1 + c))^slope

Without observations, i = i0 gives p = p0. The formula is a logistic calibration (Platt 1999, "Probabilistic
outputs for support vector machines") of the logarithm of the mean. The slope is learned for each farm and day
from simulated outbreaks, which are observed along random paths. The fraction of lost plants among sick plants
follows from i0 and p0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from geo.linear_algebra import cholesky, exp, log, product, solve_lower
from sensors.estimators.gp.rbf import Cells, Floats, RbfKernel
from sensors.estimators.paths import random_path

Values = NDArray[np.float32]

_FLOOR = 0.1
"""The constant c of the module's formula; c keeps the logarithm finite if the mean is 0."""
_MOST_SLOPE = 8.0
_COLUMNS_AT_ONCE = 64


@dataclass(frozen=True, slots=True)
class ClassLink:
    """Parameters of the module's formula, for one disease, farm and day.

    Parameters
    ----------
    illness : float
        Prior mean of the illness (1 minus the value), i0.
    sick : float
        Fraction of sick plants, p0.
    slope : float
        Exponent in the formula.
    """

    illness: float
    sick: float
    slope: float

    @property
    def lost(self) -> float:
        """Fraction of lost plants among sick plants; infected plants have illness 1/2, lost plants 1."""
        return min(max(2.0 * self.illness / self.sick - 1.0, 0.0), 1.0)

    def sick_of_mean(self, mean: NDArray[np.floating]) -> Values:
        """Return the probabilities that plants are sick, for these posterior means of the plants' values.

        Examples
        --------
        >>> link = ClassLink(illness=0.05, sick=0.08, slope=1.5)
        >>> link.sick_of_mean(np.array([1.0, 0.95, 0.5, 0.0])).astype(float).round(3).tolist()
        [0.002, 0.08, 0.708, 0.872]
        """
        logit = _log_excess(1.0 - mean.astype(np.float32), self.illness)
        logit *= np.float32(self.slope)
        logit += np.float32(math.log(self.sick / (1.0 - self.sick)))
        np.negative(logit, out=logit)
        exp(logit, out=logit)
        logit += np.float32(1.0)
        return np.reciprocal(logit, out=logit)


def _log_excess(illness: NDArray[np.floating], prior: float) -> Values:
    """Return ``log((max(illness, 0) / prior + c) / (1 + c))``, with c as in the module's formula."""
    excess = np.maximum(illness, 0.0, dtype=np.float32)
    excess *= np.float32(1.0 / (prior * (1.0 + _FLOOR)))
    excess += np.float32(_FLOOR / (1.0 + _FLOOR))
    return log(excess, out=excess)


@dataclass(frozen=True, slots=True, eq=False)
class ClassMap:
    """Turns posterior means of a disease into values of least expected loss and standard deviations.

    Value, deviation and expected loss of an unobserved plant are functions of the probability that the plant
    is sick. Conversely, the value determines this probability. Land without the crop is healthy with
    certainty.

    Parameters
    ----------
    link : ClassLink
        Link from posterior means to probabilities.
    hosts : callable
        Function of indices that returns this part of the mask of cells whose plants can get the disease.
    too_healthy, too_sick : float
        Costs of the squared error of an estimate above the truth and of an estimate below it, both > 0.
    """

    link: ClassLink
    hosts: Callable[[Any], NDArray[np.bool_]]
    too_healthy: float
    too_sick: float

    def decide(
        self,
        value: Values,
        uncertainty: Values,
        columns: slice = slice(None),
        rows: slice = slice(None),
        where: NDArray[np.bool_] | None = None,
    ) -> None:
        """Replace posterior means and deviations in place by values of least loss and true deviations.

        `value` and `uncertainty` are maps of the whole farm. Only cells in `columns` and `rows` change; if
        the mask `where` is given, only masked cells among them change.
        """
        chosen = True if where is None else where
        plants = self.hosts((columns, rows)) & chosen
        value, uncertainty = value[columns, rows], uncertainty[columns, rows]
        sick = self.link.sick_of_mean(value[plants])
        np.copyto(value, np.float32(1.0), where=chosen)
        np.copyto(uncertainty, np.float32(0.0), where=chosen)
        value[plants], uncertainty[plants] = self._value(sick), self._deviation(sick)

    def probabilities(self, value: Values, uncertainty: Values) -> Values:
        """Return the probabilities of each class, float32[3, W, H], from maps that `decide` has changed.

        Classes are healthy, infected, lost. A plant without uncertainty has the class of its reading.
        """
        out = np.zeros((3, *value.shape), np.float32)
        out[0] = 1.0
        for start in range(0, len(value), _COLUMNS_AT_ONCE):
            part = slice(start, start + _COLUMNS_AT_ONCE)
            # Most cells have no plants and thus count as healthy.
            open_ = value[part] != 1.0
            v, known = value[part][open_], uncertainty[part][open_] == 0.0
            sick = self._sick(v)
            lost = sick * np.float32(self.link.lost)
            healthy, infected = np.float32(1.0) - sick, sick - lost
            read = v[known]
            healthy[known], lost[known] = read > 0.75, read < 0.25
            infected[known] = 1.0 - healthy[known] - lost[known]
            out[0, part][open_], out[1, part][open_], out[2, part][open_] = healthy, infected, lost
        return out

    def expected_loss(self, value: Values, uncertainty: Values, out: Values) -> None:
        """Write the expected loss to `out`, float32[W, H], for maps that `decide` has changed.

        Let S and I be the probabilities of sick and infected, a and b the costs `too_healthy` and `too_sick`,
        and v the value of least loss, an expectile (Newey & Powell 1987). The expected loss is ``b S (1 - v)
        - a I (v - 1/2) / 2`` for v above one half, and ``b (S (1 - v) + I (1/2 - v) / 2)`` below.
        """
        sick, half = self._sick(value), np.float32(0.5)
        infected = sick * np.float32(1.0 - self.link.lost)
        costs = np.where(value >= half, np.float32(self.too_healthy), np.float32(self.too_sick))
        np.subtract(np.float32(1.0), sick, out=out)
        out *= 1.0 - value
        out *= np.float32(self.too_sick)
        out -= half * costs * infected * (value - half)
        # The difference of nearly equal terms may be slightly negative.
        np.maximum(out, 0.0, out=out)
        out[uncertainty == 0.0] = 0.0

    def _value(self, sick: Values) -> Values:
        """Return the values of least expected loss for these probabilities of being sick."""
        a, lost = np.float32(self.too_healthy / self.too_sick), np.float32(self.link.lost)
        one, half = np.float32(1.0), np.float32(0.5)
        upper = (one - sick * (one - half * a * (one - lost))) / (one + (a - one) * sick)
        lower = (one - sick * (one - half * (one - lost))) / (one + (a - one) * lost * sick)
        return np.where(upper >= half, upper, lower)

    def _sick(self, value: Values) -> Values:
        """Return the probabilities that plants are sick, for these values of least expected loss."""
        a, lost = np.float32(self.too_healthy / self.too_sick), np.float32(self.link.lost)
        one, half = np.float32(1.0), np.float32(0.5)
        is_upper = value >= half
        rate = np.where(is_upper, a - one, (a - one) * lost) * value
        rate += np.where(is_upper, one - half * a * (one - lost), one - half * (one - lost))
        sick: Values = (one - value) / rate
        return np.clip(sick, 0.0, 1.0, out=sick)

    def _deviation(self, sick: Values) -> Values:
        """Return the standard deviation of each plant's true value, which is 1, 1/2 or 0."""
        lost = self.link.lost
        mean, square = np.float32(0.5 * (1.0 + lost)), np.float32(0.25 * (1.0 + 3.0 * lost))
        variance = square * sick - np.square(mean * sick)
        return np.sqrt(np.maximum(variance, 0.0))


def link_slope(
    kernel: RbfKernel,
    illness: float,
    sick: float,
    fields: Iterator[tuple[Floats, NDArray[np.bool_], float, Generator]],
) -> float:
    """Return the slope of a link that makes the state of unobserved simulated plants most likely.

    Parameters
    ----------
    kernel : RbfKernel
        Kernel of the process.
    illness, sick : float
        Parameters of `ClassLink`.
    fields : iterator of (float64[w, h], bool[w, h], float, Generator)
        For each simulated field, the illness if there is an outbreak, the plants, the probability of an
        outbreak, and random numbers for the path.
    """
    from scipy.optimize import minimize_scalar

    excess, ill, weight = (
        np.concatenate(part) for part in zip(*_judged(kernel, illness, fields), strict=True)
    )
    first = math.log(sick / (1.0 - sick))

    def cost(slope: float) -> float:
        logit = first + slope * excess
        return float(np.average(np.logaddexp(0.0, logit) - ill * logit, weights=weight))

    return float(minimize_scalar(cost, bounds=(0.0, _MOST_SLOPE), method="bounded").x)


_LONGEST_SHARE = 0.45
_LOOKS = 2
_JUDGED = 200


def _judged(
    kernel: RbfKernel,
    illness: float,
    fields: Iterator[tuple[Floats, NDArray[np.bool_], float, Generator]],
) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Yield `_log_excess`, sickness (0 or 1) and weight of unobserved plants, each float64[n]."""
    for ill, plants, there, rng in fields:
        path = random_path(ill.shape, max(1, int(_LONGEST_SHARE * ill.size)), rng)
        path = path[plants[path[:, 0], path[:, 1]]]
        for look in range(_LOOKS):
            # The first look is at a uniformly random time, later looks are mostly near the path's end.
            count = int(np.ceil(len(path) * rng.random() ** (1.0 if look == 0 else 0.3)))
            seen = np.unique(path[:count], axis=0).astype(np.int32)
            unseen = plants.copy()
            unseen[seen[:, 0], seen[:, 1]] = False
            cells = np.argwhere(unseen).astype(np.int32)
            if not len(cells):
                continue
            chosen = cells[rng.permutation(len(cells))[:_JUDGED]]
            weight = len(cells) / len(chosen)
            x, y = chosen.T
            truth = (ill[x, y] > 0.0).astype(np.float64)
            # If there is no outbreak, all readings along the same path are healthy.
            cases = [(ill[seen[:, 0], seen[:, 1]], truth, there)]
            if there < 1.0:
                cases.append((np.zeros(len(seen)), np.zeros(len(chosen)), 1.0 - there))
            means = _means(kernel, illness, seen, np.stack([case[0] for case in cases], axis=1), x, y)
            for mean, (_, sick, share) in zip(means.T, cases, strict=True):
                excess = _log_excess(mean, illness).astype(np.float64)
                yield excess, sick, np.full(len(chosen), share * weight)


def _means(kernel: RbfKernel, prior: float, seen: Cells, readings: Floats, x: Cells, y: Cells) -> Floats:
    """Return posterior means at cells x, y, float64[cells, k], for k sets of readings of cells `seen`."""
    if not len(seen):
        return np.full((len(x), readings.shape[1]), prior)
    covariance = kernel.between(*seen.T)
    covariance[np.diag_indices(len(seen))] += kernel.noise
    factor = cholesky(covariance)
    across = kernel.amplitude * kernel.along_x(seen[:, 0], x) * kernel.along_y(seen[:, 1], y)
    known = solve_lower(factor, np.ascontiguousarray(readings - prior))
    return prior + product(solve_lower(factor, across).T, known)


_WINDOW = 32


def window_of(plants: NDArray[np.bool_], rng: Generator) -> tuple[slice, slice]:
    """Return a random window of at most 32 x 32 cells, centred on a plant if the border allows it."""
    cells = np.argwhere(plants)
    middle = cells[int(rng.integers(len(cells)))]
    corners = [
        int(np.clip(at - _WINDOW // 2, 0, max(0, side - _WINDOW)))
        for at, side in zip(middle.tolist(), plants.shape, strict=True)
    ]
    return slice(corners[0], corners[0] + _WINDOW), slice(corners[1], corners[1] + _WINDOW)
