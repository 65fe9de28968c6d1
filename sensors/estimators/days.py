"""Readings of earlier days, carried forward to a later one.

A reading becomes the conditional mean of the later value, with the conditional variance: the prediction of a
Kalman filter (Kalman 1960, "A new approach to linear filtering and prediction problems") whose transition is
learned from simulated environments with seeds of their own. A disease's transition is that of its classes, so
infected plants grow old and lost ones stay lost. A continuous field's is the regression of later on earlier
values.

A smooth field changes by whole stretches of land, as by rain: the change of a day is a smooth field, and the
errors of an earlier day's readings are correlated, however many there are. In functions whose weights w are
standard normal a priori, the weights of the later day are ``w' = r w + sqrt(1 - r^2) e``, with e standard
normal and independent of w, and r the correlation of the days (a first-order autoregressive process;
Hartikainen & Särkkä 2010, "Kalman filtering and smoothing solutions to temporal Gaussian process regression
models").
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
_LEAST_CORRELATION = 1e-3  # readings are divided by it
_CLASSES = (0.0, 0.5, 1.0)
_Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Transition:
    """Mean and variance of a field's value on a later day, given a reading.

    >>> half = Transition(np.array([0.0, 1.0]), np.array([0.2, 0.6]), np.array([0.1, 0.1]), 0.4)
    >>> [part.tolist() for part in half(np.array([0.5]))]
    [[0.4], [0.1]]
    """

    readings: _Floats
    """float64[k]: rising values of a reading; means and variances are linear between them."""
    means: _Floats
    """The mean of the later value after each reading."""
    variances: _Floats
    spread: float
    """Variance of the later value without any reading."""

    def __call__(self, values: NDArray[np.floating]) -> tuple[_Floats, _Floats]:
        """Return mean and variance of the later values after readings, float64[n] each."""
        return np.interp(values, self.readings, self.means), np.interp(values, self.readings, self.variances)

    @property
    def correlation(self) -> float:
        """Correlation of the earlier and the later value, by the open variance: 0.001..1."""
        known = 1.0 - float(self.variances.mean()) / self.spread if self.spread > 0.0 else 1.0
        return float(np.sqrt(np.clip(known, _LEAST_CORRELATION**2, 1.0)))

    def doubt(self, variances: _Floats) -> _Floats:
        """Return variances as parts of the variance without a reading: 0..1."""
        return np.minimum(variances / self.spread, 1.0) if self.spread > 0.0 else np.zeros(len(variances))


def carried(
    field: Field,
    grid: FarmGrid,
    values: NDArray[np.floating],
    days: NDArray[np.integer],
    day: int,
    seed: int = 0,
) -> tuple[_Floats, _Floats]:
    """Return readings of several days carried forward to a day, and their `Transition.doubt`."""
    value, doubt = np.asarray(values, np.float64).copy(), np.zeros(len(values))
    for earlier in np.unique(days[days < day]).tolist():
        of_day = days == earlier
        step = transition(field, grid, earlier, day, seed)
        value[of_day], variance = step(value[of_day])
        doubt[of_day] = step.doubt(variance)
    return value, doubt


def transition(field: Field, grid: FarmGrid, earlier: int, later: int, seed: int = 0) -> Transition:
    """Return the transition of a field from an earlier day to a later one."""
    if field.kind == "disease":
        hosts = int(np.count_nonzero(field.hosts(grid)))
        return _of_classes(field.epidemic, grid.shape, hosts, earlier, later, seed, field.name)
    if isinstance(field.dynamics, Measured):
        ends = np.array([0.0, 1.0])
        return Transition(ends, ends, np.zeros(2), field.dynamics.spread**2)
    return continuous_transition(field.continuous, grid.shape, earlier, later, seed, field.name)


@lru_cache(maxsize=64)
def _onsets(
    parameters: EpidemicParameters, shape: tuple[int, int], hosts: int, days: int, seed: int, name: str
) -> _Floats:
    """Return the number of plants of simulated outbreaks by their onset, read as unsigned byte: float64[256].

    Onsets up to a day do not depend on the length of a simulation, so one serves many days. Windows full of
    hosts stand for the farm, with its number of seeds a host.
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
    """Return simulated values of a day; the weather of equal seeds is the same up to every day."""
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
    """Return the precision of the weights on a later day, and it times their mean.

    The response is the precision times the mean of the weights; the precision is the identity before anything
    was seen. The correlation is that of each weight on the earlier day with that on the later one, 0..1.
    """
    kept = np.broadcast_to(np.asarray(correlation, np.float64), len(precision))
    change = np.maximum(1.0 - kept**2, _LEAST_CHANGE)
    # Both days' weights together have this precision on the earlier one's; these are integrated out.
    together = precision.copy()
    together[np.diag_indices_from(together)] += kept**2 / change
    ratio = kept / change
    solved = solve_positive(together, np.column_stack([np.diag(ratio), response.reshape(len(kept), -1)]))
    later = -ratio[:, None] * solved[:, : len(kept)]
    later[np.diag_indices_from(later)] += 1.0 / change
    return 0.5 * (later + later.T), (ratio[:, None] * solved[:, len(kept) :]).reshape(response.shape)


class Crowding:
    """The weights of crowded readings: the k-th of a day in a box, a quarter of a length wide, counts 1 / k.

    Readings near each other share the error of a process with one length, as that soaked soil takes no more
    rain.
    """

    def __init__(self, shape: tuple[int, int], lengths: tuple[float, float]) -> None:
        self._box = tuple(max(1.0, _ALIKE_LENGTHS * length) for length in lengths)
        self._rows = int(shape[1] / self._box[1]) + 1
        self._counts = np.zeros((int(shape[0] / self._box[0]) + 1) * self._rows, np.int64)

    def weights(self, x: NDArray[np.integer], y: NDArray[np.integer]) -> _Floats:
        """Return the weights of further readings, in their order, float64[n]."""
        box = (x / self._box[0]).astype(np.int64) * self._rows + (y / self._box[1]).astype(np.int64)
        order = np.argsort(box, kind="stable")
        first = np.searchsorted(box[order], box[order], side="left")
        rank = np.empty(len(box), np.int64)
        rank[order] = np.arange(len(box)) - first
        found: _Floats = 1.0 / (1 + rank + self._counts[box])
        self._counts += np.bincount(box, minlength=len(self._counts))
        return found
