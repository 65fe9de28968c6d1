"""Soil humidity as a smooth random field: the showers of the model, seen as a Gaussian process.

A shower is a sum of normal densities at random places. Such a field has a squared exponential covariance
whose length is the square root of two times the humps' standard deviation. Its mean, its level's and its
shape's variance on a day come from simulated weather. The process is written in a few smooth functions of x
and of y (Solin & Särkkä 2020, "Hilbert space methods for reduced-rank Gaussian process regression"), so that
observations only add to the sums of a linear regression, and a farm of any size costs a product of narrow
matrices.

The humidity is cut at 1, and an edge like that is not smooth: two hundredths of the variance have about a
third of the length. This share was chosen on simulated fields, where it made the posterior's deviations true.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from geo.seeds import stream
from sensors.dynamics.soil import SoilParameters, simulate_coarse

Floats = NDArray[np.float64]

_FUNCTIONS = 16
_MORE_FUNCTIONS = 24
_SMALL_FARM_CELLS = 64 * 64
_BATCH = 8192
_REACH = 1.5
_ROUGH_PART = 0.02
_ROUGH_LENGTH = 0.35
_SIMULATED_FIELDS = 64
_SIMULATED_CELLS = 32
_NODES = 21
_FIRST_NOISE = 1e-4
_LEAST_NOISE = 1e-7
_NOISE_ROUNDS = 3
_LEAST_FOR_NOISE = 30
_SMALLEST_VARIANCE = 1e-4


@dataclass(frozen=True, slots=True)
class SoilPrior:
    """Humidity of a day before anything is seen: its mean, and variances of the field's level and shape."""

    mean: float
    level: float
    shape: float


@lru_cache(maxsize=256)
def soil_prior(parameters: SoilParameters, shape: tuple[int, int], day: int, seed: int) -> SoilPrior:
    """Simulate the weather up to a day, on a grid of few cells with the farm's proportions."""
    names = (str(number) for number in range(_SIMULATED_FIELDS))
    rngs = [stream(seed, "epidemic-estimator", "soil", name) for name in names]
    fields = simulate_coarse(parameters, shape, day, _SIMULATED_CELLS, rngs)
    levels = fields.mean(axis=(1, 2))
    shapes = float(fields.var(axis=(1, 2)).mean())
    return SoilPrior(
        float(levels.mean()), float(levels.var()) + _SMALLEST_VARIANCE, shapes + _SMALLEST_VARIANCE
    )


class SoilField:
    """The posterior of the humidity of one farm.

    Observations of earlier days count less: what falls and evaporates in between is taken as noise with the
    variance of a day's rain.

    Parameters
    ----------
    shape : tuple of int
        Width and height in cells.
    parameters : SoilParameters
        The model.
    seed : int
        Of the simulated weather.
    """

    def __init__(self, shape: tuple[int, int], parameters: SoilParameters, seed: int) -> None:
        self._shape = shape
        self._parameters = parameters
        self._seed = seed
        # On small farms further functions do not tell more, and every update is four times as expensive.
        small = shape[0] * shape[1] <= _SMALL_FARM_CELLS
        self._functions_an_axis = _FUNCTIONS if small else _MORE_FUNCTIONS
        lengths = [np.sqrt(2.0) * parameters.spread * side for side in parameters.hump_sides(shape)]
        axes = [
            _Axis(cells, length, self._functions_an_axis)
            for cells, length in zip(shape, lengths, strict=True)
        ]
        self._x, self._y = axes
        smooth, rough = (np.outer(axes[0].spectrum[i], axes[1].spectrum[i]).ravel() for i in range(2))
        self._spectrum = (1.0 - _ROUGH_PART) * smooth + _ROUGH_PART * rough
        self._sums: dict[int, _Sums] = {}

    def learn(
        self, x: NDArray[np.integer], y: NDArray[np.integer], days: NDArray[np.integer], values: Floats
    ) -> None:
        """Take readings (finite) of cells."""
        for day in np.unique(days).tolist():
            now = np.flatnonzero(days == day)
            sums = self._sums.setdefault(day, _Sums(1 + self._functions_an_axis**2))
            for start in range(0, len(now), _BATCH):
                part = now[start : start + _BATCH]
                sums.add(self._functions(x[part], y[part]), values[part] - self._prior(day).mean)

    def fill(self, day: int, value: NDArray[np.float32], uncertainty: NDArray[np.float32]) -> float:
        """Write the posterior mean, within 0 .. 1, and standard deviation of a day into arrays [W, H].

        Returns
        -------
        float
            The standard deviation of the noise: what a reading differs from the smooth field by.
        """
        prior = self._prior(day)
        weights, covariance, noise = self._solve(day, prior)
        table = (self._x.functions @ weights[1:].reshape(2 * (self._functions_an_axis,))).astype(np.float32)
        np.matmul(table, self._y.functions.T.astype(np.float32), out=value)
        value += np.float32(prior.mean + weights[0])
        np.clip(value, 0.0, 1.0, out=value)
        nodes_x, nodes_y = self._x.nodes, self._y.nodes
        columns, rows = (part.ravel() for part in np.meshgrid(nodes_x, nodes_y, indexing="ij"))
        at_nodes = self._functions(columns, rows)
        variance = np.einsum("ij,ij->i", at_nodes @ covariance, at_nodes).reshape(len(nodes_x), len(nodes_y))
        deviation = np.sqrt(np.maximum(variance, 0.0) + noise)
        between = (self._x.between @ deviation).astype(np.float32)
        np.matmul(between, self._y.between.T.astype(np.float32), out=uncertainty)
        return float(np.sqrt(noise))

    def _prior(self, day: int) -> SoilPrior:
        return soil_prior(self._parameters, self._shape, day, self._seed)

    def _functions(self, x: NDArray[np.integer], y: NDArray[np.integer]) -> Floats:
        """Return the constant and the functions' products at cells, float64[n, 1 + functions^2]."""
        products = self._x.functions[x][:, :, None] * self._y.functions[y][:, None, :]
        return np.concatenate([np.ones((len(x), 1)), products.reshape(len(x), -1)], axis=1)

    def _solve(self, day: int, prior: SoilPrior) -> tuple[Floats, Floats, float]:
        """Return mean and covariance of the functions' weights, and the variance of the noise of this day."""
        before = np.concatenate([[prior.level], prior.shape * self._spectrum])
        noise = _FIRST_NOISE
        rain = (self._parameters.mean_rain**2) * self._parameters.rain_probability
        for _ in range(_NOISE_ROUNDS):
            precision, response = np.diag(1.0 / before), np.zeros(len(before))
            for seen, sums in sorted(self._sums.items()):
                share = 1.0 / (noise + rain * abs(day - seen))
                precision += share * sums.squares
                response += share * sums.response
            covariance = _inverse(precision)
            weights = covariance @ response
            today = self._sums.get(day)
            if today is None or today.count < _LEAST_FOR_NOISE:
                break
            fitted = np.sum(covariance * today.squares) / noise
            if today.count - fitted < 0.1 * today.count:
                break
            left = today.power - 2.0 * weights @ today.response + weights @ today.squares @ weights
            # MacKay's rule: the data that the functions did not use up tell the noise.
            noise = max(_LEAST_NOISE, float(left) / (today.count - fitted))
        return weights, covariance, noise


def _inverse(positive: Floats) -> Floats:
    """Invert a symmetric positive definite matrix by its Cholesky factor."""
    from scipy.linalg import lapack

    factor, failed = lapack.dpotrf(positive, lower=1)
    if failed:
        general: Floats = np.linalg.inv(positive).astype(np.float64)
        return general
    half, _ = lapack.dpotri(factor, lower=1, overwrite_c=1)
    lower = np.tril(half)
    inverse: Floats = lower + np.tril(half, -1).T
    return inverse


class _Sums:
    """The sums of a linear regression."""

    def __init__(self, functions: int) -> None:
        self.squares = np.zeros((functions, functions))
        self.response = np.zeros(functions)
        self.power = 0.0
        self.count = 0

    def add(self, functions: Floats, values: Floats) -> None:
        self.squares += functions.T @ functions
        self.response += functions.T @ values
        self.power += float(values @ values)
        self.count += len(values)


class _Axis:
    """Sine functions along one axis of the farm, their prior variances, and nodes to interpolate between."""

    def __init__(self, cells: int, length: float, functions: int) -> None:
        half = 0.5 * cells
        reach = max(_REACH * half, 3.2 * length)
        order = np.arange(1, functions + 1)
        place = np.arange(cells) + 0.5 - half
        frequency = np.pi * order / (2.0 * reach)
        self.functions: Floats = np.sin(frequency * (place[:, None] + reach)) / np.sqrt(reach)
        # Spectral density of the squared exponential covariance, for the smooth and the rough part.
        scales = length * np.array([[1.0], [_ROUGH_LENGTH]])
        self.spectrum: Floats = np.sqrt(2.0 * np.pi) * scales * np.exp(-0.5 * (scales * frequency) ** 2)
        self.nodes = np.unique(np.linspace(0, cells - 1, min(cells, _NODES)).round().astype(np.intp))
        self.between: Floats = np.stack(
            [np.interp(np.arange(cells), self.nodes, unit) for unit in np.eye(len(self.nodes))], axis=1
        )
