"""Soil humidity as a smooth random field: a Gaussian process with the moments of simulated showers.

A shower is a sum of normal densities (humps) at random positions. Such a field has a squared exponential
covariance with a lengthscale of sqrt(2) standard deviations of a hump. The mean at each position, and the
variances of level and shape on a day, are computed from simulated weather. Humps outside the farm lie only
beyond two of its sides, so the land near the other sides is drier.

The process is approximated by a few sine functions of x and of y (Solin & Särkkä 2020, "Hilbert space methods
for reduced-rank Gaussian process regression"). Observations then add to the sums of a linear regression, and
a prediction is a product of narrow matrices for any size of the farm.

The humidity is clipped at 1, and the edge of a clipped region is not smooth. The prior therefore has a rough
part: 2 % of the variance with about a third of the lengthscale. A small variance (the misfit) represents the
remaining difference between the humidity and the functions. The misfit is similar in neighbouring cells, so
that readings within half a wavelength of the finest function do not average it out. The noise variance of a
reading therefore grows with the square root of the number of cells within that length, a compromise between
equal and independent errors. Otherwise, exact readings along a path would determine all derivatives of the
field, and thus its values far away. The rough part and the misfit were tuned on simulated fields, so that the
standard deviations of the posterior are correct.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from geo.linear_algebra import cholesky, exp, inverse_of_factor, product, sin, solve_positive
from geo.seeds import stream
from sensors.dynamics.soil import SoilParameters
from sensors.estimators.days import Crowding, continuous_transition, pass_day

Floats = NDArray[np.float64]
Cells = NDArray[np.integer]

_FUNCTIONS = 16
_MORE_FUNCTIONS = 24
_SMALL_FARM_CELLS = 64 * 64
_BATCH = 8192
_REACH = 1.5
_ROUGH_PART = 0.02
_ROUGH_LENGTH = 0.35
_SIMULATED_FIELDS = 256
_SIMULATED_CELLS = 32
_SIMULATED_DAYS = 8
_NODES = 21
_FIRST_NOISE = 1e-4
_LEAST_NOISE = 1e-7
_NOISE_ROUNDS = 3
_LEAST_FOR_NOISE = 30
_NOISE_GROWTH = 1.2
_MOST_AT_ONCE = 256
_KEPT_DAYS = 3
_SMALLEST_VARIANCE = 1e-4
_MISFIT = 5e-5
_MEAN_NOISE = 1e-4


@lru_cache(maxsize=64)
def _simulated_moments(
    parameters: SoilParameters, shape: tuple[int, int], block: int, seed: int
) -> tuple[tuple[Floats, float, float], ...]:
    """Return the moments of the humidity on each day of a block; all days use the same simulated weathers.

    The moments are the mean at each position, float64[w, h] on a coarse grid with the farm's proportions; the
    variance of the farm's mean humidity (level); and the mean variance within the farm (shape).
    """
    names = (str(number) for number in range(_SIMULATED_FIELDS))
    rngs = [stream(seed, "epidemic-estimator", "soil", name) for name in names]
    days = range(_SIMULATED_DAYS * block, _SIMULATED_DAYS * (block + 1))
    moments = []
    for fields in parameters.simulate_coarse(shape, days, _SIMULATED_CELLS, rngs):
        mean = fields.mean(axis=0)
        around = fields - mean
        level = float(around.mean(axis=(1, 2)).var())
        moments.append((mean, level, float(around.var(axis=(1, 2)).mean())))
    return tuple(moments)


@dataclass(frozen=True, slots=True, eq=False)
class _WeightsPrior:
    """Prior means and variances of the weights of the constant and of the sine functions."""

    mean: Floats
    variance: Floats


class SoilField:
    """Posterior distribution of the soil humidity of one farm.

    Observations of earlier days have less weight, and their errors are correlated
    (`sensors.estimators.days`). After the first day, crowded readings also have less weight (`Crowding`): a
    day's change in humidity is small compared with the prior's spread, so the model error matters more.
    """

    def __init__(self, shape: tuple[int, int], parameters: SoilParameters, seed: int) -> None:
        self._shape = shape
        self._parameters = parameters
        self._seed = seed
        # On small farms, more functions would gain no accuracy, and updates would cost four times as much.
        small = shape[0] * shape[1] <= _SMALL_FARM_CELLS
        self._functions_an_axis = _FUNCTIONS if small else _MORE_FUNCTIONS
        lengths = [np.sqrt(2.0) * parameters.spread * side for side in parameters.hump_sides(shape)]
        self._lengths = float(lengths[0]), float(lengths[1])
        self.correlation_length = float(np.sqrt(lengths[0] * lengths[1]))
        axes = [
            _Axis(cells, length, self._functions_an_axis)
            for cells, length in zip(shape, lengths, strict=True)
        ]
        self._x, self._y = axes
        smooth, rough = (np.outer(axes[0].spectrum[i], axes[1].spectrum[i]).ravel() for i in range(2))
        self._spectrum = (1.0 - _ROUGH_PART) * smooth + _ROUGH_PART * rough
        self._sums: dict[int, _Sums] = {}
        self._crowding: dict[int, Crowding] = {}
        self._waiting: dict[int, list[tuple[Cells, Cells, Floats]]] = {}
        # Readings of the earliest day are kept: their weights change if readings of an earlier day arrive.
        self._first: list[tuple[Cells, Cells, Floats]] = []
        self._posterior: _Posterior | None = None
        self._known_before: dict[object, tuple[Floats, Floats]] = {}
        self._noises: dict[object, float] = {}
        self._priors: dict[int, _WeightsPrior] = {}
        self._cells_alike = max(1.0, float(np.sqrt(self._x.shortest * self._y.shortest)))
        self._at_nodes = _on_grid(*(axis.functions[axis.nodes] for axis in axes))

    def learn(
        self, x: NDArray[np.integer], y: NDArray[np.integer], days: NDArray[np.integer], values: Floats
    ) -> None:
        """Queue readings of cells, all finite, for the next `fill`."""
        for day in np.unique(days).tolist():
            now = days == day
            self._waiting.setdefault(day, []).append((x[now], y[now], values[now]))

    def _take_in(self) -> None:
        """Add all queued readings to the sums and the posterior, for little more than the cost of one."""
        learned = []
        self._give_way()
        for day, parts in sorted(self._waiting.items()):
            x, y, values = (np.concatenate(column) for column in zip(*parts, strict=True))
            if self._is_first(day):
                self._first.append((x, y, values))
                weights = np.ones(len(x))
            else:
                crowding = self._crowding.setdefault(day, Crowding(self._shape, self._lengths))
                weights = crowding.weights(x, y)
            count = 1 + self._functions_an_axis**2
            sums = self._sums.setdefault(day, _Sums(np.zeros((count, count)), np.zeros(count)))
            start = 0
            while start < len(x):
                part = slice(start, start + min(_BATCH, sums.until_due))
                functions = _products(self._x.functions[x[part]], self._y.functions[y[part]])
                readings = values[part] - product(functions, self._prior(day).mean)
                sums.add(functions, readings, weights[part])
                learned.append((day, functions, readings, weights[part]))
                start = part.stop
        self._waiting.clear()
        posterior = self._posterior
        if posterior is None or not learned:
            return
        if all(
            len(readings) <= _MOST_AT_ONCE and not posterior.is_outdated(day, self._noise_from(day))
            for day, _, readings, _ in learned
        ):
            for _, functions, readings, counted in learned:
                posterior.learn(functions, readings, counted)
        else:
            self._posterior = None

    def _give_way(self) -> None:
        """Queue the readings of the first day again if readings of an earlier day have arrived."""
        first, earliest = min(self._sums, default=None), min(self._waiting, default=None)
        if first is None or earliest is None or earliest >= first:
            return
        self._waiting[first] = self._first + self._waiting.get(first, [])
        self._first = []
        del self._sums[first]
        self._posterior = None

    def _is_first(self, day: int) -> bool:
        """Return whether no day before `day` has readings."""
        return day <= min(self._sums, default=day)

    def fill(self, day: int, value: NDArray[np.float32], uncertainty: NDArray[np.float32]) -> float:
        """Write the posterior mean of a day, clipped to 0..1, and the standard deviation into arrays [W, H].

        Return the standard deviation of the readings' noise.
        """
        self._take_in()
        prior = self._prior(day)
        posterior = self._posterior
        if posterior is None or posterior.is_outdated(day, self._noise_from(day)):
            posterior = self._posterior = self._solve(day)
        weights = prior.mean + posterior.weights
        table = product(self._x.functions, weights[1:].reshape(2 * (self._functions_an_axis,))).astype(
            np.float32
        )
        product(table, self._y.functions.T.astype(np.float32), out=value)
        value += np.float32(weights[0])
        np.clip(value, 0.0, 1.0, out=value)
        shape = len(self._x.nodes), len(self._y.nodes)
        spread = max(posterior.shown, _MISFIT)
        deviation = np.sqrt(np.maximum(posterior.variance, 0.0) + spread).reshape(shape)
        between = product(self._x.between, deviation).astype(np.float32)
        product(between, self._y.between.T.astype(np.float32), out=uncertainty)
        return float(np.sqrt(posterior.shown))

    def _prior(self, day: int) -> _WeightsPrior:
        """Return the prior of a day for the functions' weights."""
        if day in self._priors:
            return self._priors[day]
        block, number = divmod(day, _SIMULATED_DAYS)
        mean_field, level, shape = _simulated_moments(self._parameters, self._shape, block, self._seed)[
            number
        ]
        places = (
            (np.arange(few) + 0.5) * cells / few - 0.5
            for few, cells in zip(mean_field.shape, self._shape, strict=True)
        )
        functions = _on_grid(
            *(axis.at(where) for axis, where in zip((self._x, self._y), places, strict=True))
        )
        # The functions contribute to the variance of the farm's mean humidity; the constant gets the rest of
        # this variance.
        own = float(product(self._spectrum, functions[:, 1:].mean(axis=0) ** 2))
        everywhere = float(np.mean(product(functions[:, 1:] ** 2, self._spectrum)))
        shape = shape / (everywhere - own) + _SMALLEST_VARIANCE
        level = max(level - shape * own, _SMALLEST_VARIANCE)
        variance = np.concatenate([[level], shape * self._spectrum])
        # A regression of the mean field with little noise gives the prior means of the weights.
        mean = np.zeros(len(variance))
        mean[0] = mean_field.mean()
        precision = np.diag(1.0 / variance) + product(functions.T, functions) / _MEAN_NOISE
        response = product(mean_field.ravel() - mean[0], functions) / _MEAN_NOISE
        mean += solve_positive(precision, response)
        self._priors[day] = _WeightsPrior(mean, variance)
        return self._priors[day]

    def _noise_from(self, day: int) -> int:
        """Return the number of readings of a day in its noise estimate; 0 if there are too few readings."""
        return self._sums[day].noise_from if day in self._sums else 0

    def _solve(self, day: int) -> _Posterior:
        """Return the posterior of the weights on a day, with the estimated noise."""
        shown = self._noise(day)
        noise = max(shown, self._least_noise(day))
        precision, response = self._precision(day, noise, self._sums.get(day))
        covariance = inverse_of_factor(cholesky(precision))
        return _Posterior(
            day,
            noise,
            shown,
            self._noise_from(day),
            covariance,
            product(response, covariance),
            self._at_nodes,
        )

    def _least_noise(self, day: int) -> float:
        """Return the lower bound of the noise variance for a day's readings, which the misfit sets."""
        # After the first day, `Crowding` already reduces the weight of nearby readings.
        return _MISFIT * float(np.sqrt(self._cells_alike)) if self._is_first(day) else _MISFIT

    def _noise(self, day: int) -> float:
        """Return the noise variance, estimated from the first `_noise_from(day)` readings of a day."""
        noise = _FIRST_NOISE
        today = self._sums[day].due if day in self._sums else None
        if today is None:
            return noise
        key = day, today.count, self._counts_before(day)
        if key in self._noises:
            return self._noises[key]
        for _ in range(_NOISE_ROUNDS - 1):
            precision, response = self._precision(day, noise, today)
            covariance = inverse_of_factor(cholesky(precision))
            weights = product(response, covariance)
            fitted = float((covariance * today.squares).sum()) / noise
            if today.weight - fitted < 0.1 * today.weight:
                break
            left = today.power - product(weights, 2.0 * today.response - product(weights, today.squares))
            # MacKay's update: residual sum of squares divided by the remaining degrees of freedom.
            noise = max(_LEAST_NOISE, float(left / (today.weight - fitted)))
        self._noises[key] = noise
        return noise

    def _precision(self, day: int, noise: float, today: _Sums | None) -> tuple[Floats, Floats]:
        """Return precision, and precision times mean, of a day's weights, given all readings until then."""
        precision, response = (part.copy() for part in self._before(day))
        if today is not None:
            precision += today.squares / noise
            response += today.response / noise
        return precision, response

    def _before(self, day: int) -> tuple[Floats, Floats]:
        """Return precision, and precision times mean, of a day's weights, given only earlier days."""
        variances = self._prior(day).variance
        last = max((seen for seen in self._sums if seen < day), default=None)
        if last is None:
            return np.diag(1.0 / variances), np.zeros(len(variances))
        key = day, self._counts_before(day)
        if key not in self._known_before:
            noise = max(self._noise(last), self._least_noise(last))
            precision, response = self._precision(last, noise, self._sums[last])
            # `pass_day` needs weights in units of their prior standard deviations.
            unit, later = np.sqrt(self._prior(last).variance), np.sqrt(variances)
            step = continuous_transition(self._parameters, self._shape, last, day, self._seed)
            precision, response = pass_day(
                precision * np.outer(unit, unit), response * unit, step.correlation
            )
            if len(self._known_before) >= _KEPT_DAYS:
                self._known_before.clear()
            self._known_before[key] = precision / np.outer(later, later), response / later
        return self._known_before[key]

    def _counts_before(self, day: int) -> tuple[tuple[int, int], ...]:
        """Return pairs of day and number of readings for the days before `day`."""
        return tuple((seen, sums.count) for seen, sums in sorted(self._sums.items()) if seen < day)


@dataclass(slots=True, eq=False)
class _Posterior:
    """Mean and covariance of the functions' weights on a day, for a fixed noise variance `noise`.

    `shown` is the noise variance estimated from `noise_from` readings, without the lower bound that `noise`
    has.
    """

    day: int
    noise: float
    shown: float
    noise_from: int
    covariance: Floats
    weights: Floats
    at_nodes: Floats
    variance: Floats = field(init=False)

    def __post_init__(self) -> None:
        self.variance = (product(self.at_nodes, self.covariance) * self.at_nodes).sum(axis=1)

    def is_outdated(self, day: int, noise_from: int) -> bool:
        """Return whether this posterior is for another day or an outdated noise estimate."""
        return self.day != day or self.noise_from != noise_from

    def learn(self, functions: Floats, readings: Floats, counted: Floats) -> None:
        """Update the posterior with more readings of the day, weighted by `counted` (Woodbury identity)."""
        moved = product(self.covariance, functions.T)
        within = product(functions, moved)
        within[np.diag_indices_from(within)] += self.noise / counted
        gain = solve_positive(within, moved.T)
        self.weights = self.weights + product(readings - product(functions, self.weights), gain)
        self.variance -= (product(self.at_nodes, moved) * product(self.at_nodes, gain.T)).sum(axis=1)
        self.covariance -= product(moved, gain)


@dataclass(slots=True, eq=False)
class _Sums:
    """Weighted sums of the linear regression of one day: X'X, X'y, y'y, total weight, and number of readings.

    `due` has the sums at the last noise estimate. The noise is estimated after 30, 36, 43, 51, ... readings,
    so that the result does not depend on the batches in which readings arrive.
    """

    squares: Floats
    response: Floats
    power: float = 0.0
    weight: float = 0.0
    count: int = 0
    due: _Sums | None = None

    @property
    def noise_from(self) -> int:
        """Number of readings in the last noise estimate; 0 before the first estimate."""
        return 0 if self.due is None else self.due.count

    @property
    def until_due(self) -> int:
        """Number of readings that are missing for the next noise estimate."""
        return max(_LEAST_FOR_NOISE, int(_NOISE_GROWTH * self.noise_from)) - self.count

    def add(self, functions: Floats, values: Floats, weights: Floats) -> None:
        """Add weighted readings, at most `until_due` of them."""
        is_due = len(values) == self.until_due
        counted = weights[:, None] * functions
        self.squares += product(counted.T, functions)
        self.response += product(values, counted)
        self.power += float(product(weights, values**2))
        self.weight += float(weights.sum())
        self.count += len(values)
        if is_due:
            self.due = replace(self, squares=self.squares.copy(), response=self.response.copy(), due=None)


def _products(along_x: Floats, along_y: Floats) -> Floats:
    """Return the constant and the products of x and y functions, float64[n, 1 + functions^2]."""
    products = along_x[:, :, None] * along_y[:, None, :]
    return np.concatenate([np.ones((len(along_x), 1)), products.reshape(len(along_x), -1)], axis=1)


def _on_grid(along_x: Floats, along_y: Floats) -> Floats:
    """Return `_products` for all pairs of a place along x and a place along y, sorted by x, then by y."""
    return _products(np.repeat(along_x, len(along_y), axis=0), np.tile(along_y, (len(along_x), 1)))


class _Axis:
    """Sine functions along one axis of the farm, their prior variances, and interpolation nodes.

    `shortest` is half the wavelength of the last function, in cells. `spectrum` holds the variances of the
    smooth and of the rough part, float64[2, functions].
    """

    def __init__(self, cells: int, length: float, functions: int) -> None:
        self._half = 0.5 * cells
        self._reach = max(_REACH * self._half, 3.2 * length)
        self._frequency = np.pi * np.arange(1, functions + 1) / (2.0 * self._reach)
        self.functions = self.at(np.arange(cells))
        self.shortest = float(np.pi / self._frequency[-1])
        # Spectral densities of the squared exponential covariances of the smooth and the rough part.
        scales = length * np.array([[1.0], [_ROUGH_LENGTH]])
        self.spectrum: Floats = np.sqrt(2.0 * np.pi) * scales * exp(-0.5 * (scales * self._frequency) ** 2)
        self.nodes = np.unique(np.linspace(0, cells - 1, min(cells, _NODES)).round().astype(np.intp))
        self.between: Floats = np.stack(
            [np.interp(np.arange(cells), self.nodes, unit) for unit in np.eye(len(self.nodes))], axis=1
        )

    def at(self, places: NDArray[np.integer] | Floats) -> Floats:
        """Return the sine functions at cell indices (integers are centres), float64[n, functions]."""
        position = places + 0.5 - self._half
        return sin(self._frequency * (position[:, None] + self._reach)) / np.sqrt(self._reach)
