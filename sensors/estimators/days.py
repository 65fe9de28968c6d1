"""Predicts the values of a day from readings of earlier days.

A reading is replaced by the conditional mean and variance of the later value, given the reading. This is the
prediction step of a Kalman filter (Kalman 1960, "A new approach to linear filtering and prediction
problems"). The transition is learned from simulated environments with separate seeds. A disease has
transitions between its classes: infected plants age, and lost plants stay lost. A continuous field's later
values are predicted from earlier values by linear regression.

A smooth field, such as soil humidity under rain, changes by a smooth increment per day. The errors of an
earlier day's readings are therefore correlated, and an average of many readings does not remove these errors.
Let the field be a sum of functions with weights w that are standard normal a priori. The weights of the later
day are ``w' = r w + sqrt(1 - r^2) e``, where e is standard normal and independent of w, and r is the
correlation of the two days (a first-order autoregressive process; Hartikainen & Särkkä 2010, "Kalman
filtering and smoothing solutions to temporal Gaussian process regression models").
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from geo.grid import FarmGrid
from geo.linear_algebra import solve_positive
from geo.seeds import stream
from sensors.dynamics.continuous import ContinuousDynamics, Measured
from sensors.dynamics.epidemic import MAX_DAYS, EpidemicParameters, simulate_outbreak, value_table
from sensors.fields import Field

_LAND_CELLS = 64
_OUTBREAKS = 100
_WEATHERS = 64
_SOIL_CELLS = 24
_DAYS_AT_ONCE = 16
_LEAST_CORRELATION = 1e-3  # Not zero, because readings are divided by the correlation
_CLASSES = (0.0, 0.5, 1.0)
_Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Transition:
    """Gives the mean and variance of a cell's value on a later day, given a reading of the cell.

    >>> half = Transition(np.array([0.0, 1.0]), np.array([0.2, 0.6]), np.array([0.1, 0.1]), 0.4)
    >>> [part.tolist() for part in half(np.array([0.5]))]
    [[0.4], [0.1]]
    """

    readings: _Floats
    """Values of a reading, ascending, float64[k]; between them, means and variances are interpolated."""
    means: _Floats
    """Mean of the later day's value for each of `readings`."""
    variances: _Floats
    """Variance of the later day's value for each of `readings`."""
    spread: float
    """Variance of the later day's value of a cell without a reading."""

    def __call__(self, values: NDArray[np.floating]) -> tuple[_Floats, _Floats]:
        """Return the means and variances of the later day's values, float64[n] each, given the readings."""
        return np.interp(values, self.readings, self.means), np.interp(values, self.readings, self.variances)

    @property
    def correlation(self) -> float:
        """Correlation (0.001..1) of earlier and later values, computed from the unexplained variance."""
        known = 1.0 - float(self.variances.mean()) / self.spread if self.spread > 0.0 else 1.0
        return float(np.sqrt(np.clip(known, _LEAST_CORRELATION**2, 1.0)))

    def doubt(self, variances: _Floats) -> _Floats:
        """Return each variance as a fraction (0..1) of `spread`, the variance without a reading."""
        return np.minimum(variances / self.spread, 1.0) if self.spread > 0.0 else np.zeros(len(variances))


def carried(
    field: Field,
    grid: FarmGrid,
    values: NDArray[np.floating],
    days: NDArray[np.integer],
    day: int,
    seed: int = 0,
) -> tuple[_Floats, _Floats]:
    """Carry readings of several days forward to `day`; return values, and each `Transition.doubt` (0..1)."""
    value, doubt = np.asarray(values, np.float64).copy(), np.zeros(len(values))
    for earlier in np.unique(days[days < day]).tolist():
        of_day = days == earlier
        step = transition(field, grid, earlier, day, seed)
        value[of_day], variance = step(value[of_day])
        doubt[of_day] = step.doubt(variance)
    return value, doubt


def transition(field: Field, grid: FarmGrid, earlier: int, later: int, seed: int = 0) -> Transition:
    """Return a field's transition from an earlier to a later day."""
    if field.kind == "disease":
        hosts = sum(grid.counts.get(name, 0) for name in field.crops_on(grid))
        return _of_classes(field.epidemic, grid.shape, hosts, earlier, later, seed, field.name)
    if isinstance(field.dynamics, Measured):
        ends = np.array([0.0, 1.0])
        return Transition(ends, ends, np.zeros(2), field.dynamics.spread**2)
    return continuous_transition(field.continuous, grid.shape, earlier, later, seed, field.name)


@lru_cache(maxsize=64)
def _onsets(
    parameters: EpidemicParameters, shape: tuple[int, int], hosts: int, days: int, seed: int, name: str
) -> _Floats:
    """Return how many plants of simulated outbreaks have each onset, float64[256].

    The index is the onset read as an unsigned byte. Onsets do not depend on the days simulated after them, so
    a long simulation serves many days. The simulated land is a window full of hosts, with as many seeds per
    host as the farm.
    """
    land = np.ones((min(shape[0], _LAND_CELLS), min(shape[1], _LAND_CELLS)), np.bool_)
    seeds = max(1, round(parameters.seed_count(shape) * land.size / max(hosts, 1)))
    local = parameters.on_window(shape, seeds)
    counts = np.zeros(256)
    for number in range(_OUTBREAKS):
        rng = stream(seed, "carrying", name, str(number))
        onset = simulate_outbreak(land, local, days, rng)
        counts += np.bincount(onset.view(np.uint8).ravel(), minlength=256)
    counts.flags.writeable = False
    return counts


def _of_classes(
    parameters: EpidemicParameters,
    shape: tuple[int, int],
    hosts: int,
    earlier: int,
    later: int,
    seed: int,
    name: str,
) -> Transition:
    days = min(MAX_DAYS, -(-later // _DAYS_AT_ONCE) * _DAYS_AT_ONCE)
    weights = _onsets(parameters, shape, hosts, days, seed, name)
    before = np.asarray(value_table(parameters, earlier), np.float64)
    after = np.asarray(value_table(parameters, later), np.float64)
    means, variances = np.array(_CLASSES), np.zeros(len(_CLASSES))
    for k, value in enumerate(_CLASSES):
        part = np.where(before == value, weights, 0.0)
        if part.sum() > 0.0:
            means[k], variances[k] = _moments(part, after)
    return Transition(np.array(_CLASSES), means, variances, _moments(weights, after)[1])


def _moments(weights: _Floats, values: _Floats) -> tuple[float, float]:
    mean = float(np.average(values, weights=weights))
    return mean, float(np.average((values - mean) ** 2, weights=weights))


@lru_cache(maxsize=256)
def _simulated(
    parameters: ContinuousDynamics, shape: tuple[int, int], day: int, seed: int, name: str
) -> _Floats:
    """Return simulated values on a day. Equal seeds simulate the same weather for every day."""
    rngs = [stream(seed, "carrying", name, str(number)) for number in range(_WEATHERS)]
    fields = parameters.simulate_coarse(shape, (day,), _SOIL_CELLS, rngs).ravel()
    fields.flags.writeable = False
    return fields


def continuous_transition(
    parameters: ContinuousDynamics,
    shape: tuple[int, int],
    earlier: int,
    later: int,
    seed: int,
    name: str = "soil",
) -> Transition:
    """Return the transition of a continuous field; see `transition`."""
    before, after = (_simulated(parameters, shape, day, seed, name) for day in (earlier, later))
    spread = float(after.var())
    if before.var() < 1e-12:
        return Transition(np.array([0.0, 1.0]), np.full(2, after.mean()), np.full(2, spread), spread)
    slope = float(np.mean((before - before.mean()) * (after - after.mean())) / before.var())
    ends = np.array([0.0, 1.0])
    means = np.clip(after.mean() + slope * (ends - before.mean()), 0.0, 1.0)
    residual = float(np.var(after - after.mean() - slope * (before - before.mean())))
    return Transition(ends, means, np.full(2, residual), spread)


_LEAST_CHANGE = 1e-6
_ALIKE_LENGTHS = 0.25


def pass_day(precision: _Floats, response: _Floats, correlation: float | _Floats) -> tuple[_Floats, _Floats]:
    """Return the `precision` and `response` that the weights have on a later day.

    `precision` is the posterior precision of the weights; without observations it is the identity. `response`
    is the precision times the posterior mean. `correlation` (0..1) is the correlation of each weight between
    the two days.
    """
    kept = np.broadcast_to(np.asarray(correlation, np.float64), len(precision))
    change = np.maximum(1.0 - kept**2, _LEAST_CHANGE)
    # The joint precision has a block for the weights of each day. `together` is the earlier day's block; the
    # earlier weights are integrated out.
    together = precision.copy()
    together[np.diag_indices_from(together)] += kept**2 / change
    ratio = kept / change
    solved = solve_positive(together, np.column_stack([np.diag(ratio), response.reshape(len(kept), -1)]))
    later = -ratio[:, None] * solved[:, : len(kept)]
    later[np.diag_indices_from(later)] += 1.0 / change
    return 0.5 * (later + later.T), (ratio[:, None] * solved[:, len(kept) :]).reshape(response.shape)


class Crowding:
    """Reduces the weights of readings that are close together.

    The k-th reading of a day in a box has the weight 1 / k; a box is a quarter of a lengthscale wide.
    Readings close together are not independent: they share the error of the smooth model, for example where
    soaked soil takes no more rain.
    """

    def __init__(self, shape: tuple[int, int], lengths: tuple[float, float]) -> None:
        self._box = tuple(max(1.0, _ALIKE_LENGTHS * length) for length in lengths)
        self._rows = int(shape[1] / self._box[1]) + 1
        # A dictionary is smaller than an array: a leg along x would touch a memory page of it per reading
        self._counts: dict[int, int] = {}

    def weights(self, x: NDArray[np.integer], y: NDArray[np.integer]) -> _Floats:
        """Return the weights of further readings, float64[n], in the order of the readings."""
        boxes = (x / self._box[0]).astype(np.int64) * self._rows + (y / self._box[1]).astype(np.int64)
        found = np.empty(len(boxes))
        for k, box in enumerate(boxes.tolist()):
            self._counts[box] = count = self._counts.get(box, 0) + 1
            found[k] = 1.0 / count
        return found
