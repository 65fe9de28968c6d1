"""One field of the Gaussian process estimator: its observations, mean, kernel and posterior."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from enum import Enum
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sensors.estimators.days import Crowding
from sensors.estimators.gp.cell_posterior import CellPosterior, ExactPosterior, WindowedPosterior
from sensors.estimators.gp.rbf import Cells, Floats, RbfKernel
from sensors.observations import GrowingArray
from sensors.scoring.information import TILE_CELLS, tile_shape

if TYPE_CHECKING:
    from sensors.estimators.gp.classes import ClassMap
    from sensors.estimators.gp.local import LocalPosterior, WholePosterior

MOST_FUNCTIONS = 1024
"""Greatest number of functions over the whole farm; if more are needed, tiles are used instead."""
MOST_OBSERVATIONS = 1_000_000
"""Number of observations up to which the functions over the whole farm are accurate."""
_FIRST_FIT = 16
_FIT_POINTS = 512
_FIT_RUNS = 8
_LARGE_CELLS = 128
_EXACT = 1e-3
"""A reading that is closer than this to the value of a class shows the class with certainty."""

KernelFit = Callable[[Cells, Cells, Floats], RbfKernel]
Carry = Callable[[int, Floats], tuple[Floats, Floats]]
"""Function that returns mean and variance today, given an earlier day and readings of that day."""
Correlate = Callable[[int, int], float]
"""Function that returns a smooth field's correlation between two days."""


class _Method(Enum):
    EXACT = "all cells for each observation"
    WINDOWED = "windows of cells for each observation"
    TILED = "tiles, or functions over the whole farm"


class FieldProcess:
    """Observations, prior mean, kernel and posterior of one field.

    `mean` is the prior mean. If `mean` is None, the mean of the observations is used, or `mean_before` before
    the first observation. `is_patchy` says that readings close together share an error of the model, for
    example where soaked soil takes no more rain; on large farms their weights are reduced (`Crowding`).

    `classes` turns a disease's means into values and uncertainties. As long as every reading is the exact
    value of a class, a plant that was read today has the class of its reading.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        mean: float | None,
        mean_before: float,
        kernel: RbfKernel,
        *,
        is_patchy: bool = False,
    ) -> None:
        self.kernel = kernel
        self.mean = mean
        self.classes: ClassMap | None = None
        self._exact = True
        self._first_kernel = kernel
        self._mean_before = mean_before
        self._shape = shape
        self._crowds = is_patchy and max(shape) > _LARGE_CELLS
        self._cells = GrowingArray((2,), np.int32)
        self._values = GrowingArray((), np.float64)
        self._days = GrowingArray((), np.int32)
        self._day: int | None = None
        self._carry: Carry | None = None
        self._correlate: Correlate | None = None
        self._superseded = np.zeros(0, np.bool_)
        self._changed, self._days_of_change = 0.0, 0
        self._fitted = 0
        self._conditioned = 0
        self._posterior: CellPosterior | LocalPosterior | WholePosterior | None = None
        self._made_for: tuple[RbfKernel, _Method | None, int | None, float | None] | None = None
        self._crowding = self._no_crowd()
        self._written: tuple[object, ...] | None = None
        self._shown = 0

    def __len__(self) -> int:
        return len(self._values)

    def append(self, x: Cells, y: Cells, values: NDArray[np.floating], days: NDArray[np.integer]) -> None:
        """Store further observations, which the next `update` uses."""
        self._cells.append(np.stack([x, y], axis=1))
        self._values.append(values)
        self._days.append(days)
        self._exact = self._exact and bool((np.abs(values - _nearest_class(values)) <= _EXACT).all())

    def carry_to(self, day: int, carry: Carry | None, correlate: Correlate | None = None) -> None:
        """Set the day to estimate; `carry` carries readings of earlier days forward to `day` in `update`.

        If `correlate` is given, errors of readings carried from one day are correlated
        (`sensors.estimators.days`); otherwise they are independent.
        """
        self._day, self._carry, self._correlate = day, carry, correlate

    def fit(self, fit_kernel: KernelFit) -> None:
        """Fit the kernel to the observations if a new fit is due (see `due_fit`)."""
        count = due_fit(len(self))
        if count <= self._fitted:
            return
        self._fitted = count
        chosen = _fit_subset(count)
        x, y = self._cells.array[chosen].T
        residuals: Floats = self._values.array[chosen] - self.prior_mean(count)
        self.kernel = self._first_kernel if np.ptp(residuals) == 0 else fit_kernel(x, y, residuals)

    def prior_mean(self, count: int) -> float:
        """Return the prior mean, which may depend on the first `count` observations."""
        if self.mean is not None:
            return self.mean
        return float(self._values.array[:count].mean()) if count else self._mean_before

    def update(self, *, exact: bool, window_bytes: float = 0.0) -> None:
        """Bring the posterior up to date with the stored observations and the present kernel.

        With `exact`, all cells are stored for each observation. Otherwise windows are stored if these need at
        most `window_bytes`, or else tiles or functions are used.
        """
        if self._update_smooth():
            return
        posterior = self._posterior
        method = self._method(exact, window_bytes)
        state = self.kernel, method, self._day, None
        gone = self._newly_superseded()
        # An exact posterior cannot remove observations, so a superseded reading requires a new posterior.
        if posterior is None or self._made_for != state or (exact and (gone < self._conditioned).any()):
            self._posterior = posterior = self._new_posterior(method)
            self._crowding = self._no_crowd()
            self._made_for = state
            self._conditioned = 0
        if self._conditioned < len(self):
            further = np.arange(self._conditioned, len(self))
            self._take(posterior, further[~self._superseded[further]], 1.0)
            self._take(posterior, gone[gone < self._conditioned], -1.0)
            self._conditioned = len(self)
        if not isinstance(posterior, CellPosterior):
            posterior.solve()

    def _method(self, exact: bool, window_bytes: float) -> _Method:
        """Return the method by which to compute the posterior."""
        if exact:
            return _Method.EXACT
        days = self._days.array
        # Readings of a later day supersede earlier readings, which windows cannot remove.
        one_day = not len(days) or bool((days == days[0]).all())
        if one_day and WindowedPosterior.fits(len(self), self._shape, self.kernel, window_bytes):
            return _Method.WINDOWED
        return _Method.TILED

    def _update_smooth(self) -> bool:
        """Update the posterior of a smooth field that has readings of earlier days.

        If there are no such readings or the lengthscale is too short, update nothing and return False.
        """
        days = self._days.array
        if self._correlate is None or self._day is None or not (days < self._day).any():
            return False
        # The posterior depends on the mean, because earlier readings are scaled relative to the mean.
        state = (self.kernel, None, self._day, self.prior_mean(len(self)))
        posterior = self._posterior
        if self._made_for != state or (days[self._conditioned :] < self._day).any():
            posterior = whole = self._whole_posterior()
            if whole is None:
                return False
            self._posterior, self._made_for, self._conditioned = posterior, state, 0
            earlier, carry = np.unique(days[days < self._day]).tolist(), self._carry
            assert carry is not None
            for day, following in pairwise([*earlier, self._day]):
                x, y = self._cells.array[days == day].T
                # Readings of an earlier day, converted to today's mean and scale.
                mean, (expected, _) = self.prior_mean(len(self)), carry(day, self._values.array[days == day])
                values = mean + (expected - mean) / self._correlate(day, self._day)
                # On small farms the first day's readings count fully: model errors matter only later.
                exactly = day == earlier[0] and not self._crowds
                counted = None if exactly else self._no_crowd().weights(x, y)
                whole.condition(x, y, values, counted)
                whole.pass_day(self._correlate(day, following))
            self._crowding = self._no_crowd()
        assert not isinstance(posterior, CellPosterior | None)
        further = np.arange(self._conditioned, len(self))
        further = further[days[further] == self._day]
        x, y = self._cells.array[further].T
        posterior.condition(x, y, self._values.array[further], self._crowding.weights(x, y))
        self._conditioned = len(self)
        posterior.solve()
        return True

    def _counted(self, posterior: object, x: Cells, y: Cells) -> Floats | None:
        """Return the reduced weights of further readings of today, or None if all readings count fully."""
        if not self._crowds or isinstance(posterior, CellPosterior):
            return None
        from sensors.estimators.gp.local import WholePosterior

        return self._crowding.weights(x, y) if isinstance(posterior, WholePosterior) else None

    def _no_crowd(self) -> Crowding:
        return Crowding(self._shape, (self.kernel.length_x, self.kernel.length_y))

    def _newly_superseded(self) -> NDArray[np.intp]:
        """Return the indices of readings that a later day's reading of the same cell now supersedes."""
        known, count = self._superseded, len(self)
        if len(known) == count:
            return np.empty(0, np.intp)
        self._superseded = np.concatenate([known, np.zeros(count - len(known), np.bool_)])
        days = self._days.array
        if not count or (days == days[0]).all():
            return np.empty(0, np.intp)
        cells = self._cells.array
        _, cell = np.unique(cells[:, 0].astype(np.int64) * self._shape[1] + cells[:, 1], return_inverse=True)
        latest = np.full(int(cell.max()) + 1, -1, np.int32)
        np.maximum.at(latest, cell, days)
        gone = np.flatnonzero((days < latest[cell]) & ~self._superseded)
        self._superseded[gone] = True
        newest = np.zeros(len(latest))
        last = days == latest[cell]
        newest[cell[last]] = self._values.array[last]
        self._changed += float(np.sum((newest[cell[gone]] - self._values.array[gone]) ** 2))
        self._days_of_change += int(np.sum(latest[cell[gone]] - days[gone]))
        return gone

    @property
    def change_a_day(self) -> float:
        """Mean squared change of a reading per day, from cells read on two days; 0 without such cells."""
        return self._changed / self._days_of_change if self._days_of_change else 0.0

    def _take(
        self,
        posterior: CellPosterior | LocalPosterior | WholePosterior,
        which: NDArray[np.intp],
        sign: float,
    ) -> None:
        """Add the readings with indices `which` to a posterior; if `sign` is -1, remove the readings."""
        if not len(which):
            return
        x, y = self._cells.array[which].T
        values, days = self._values.array[which], self._days.array[which]
        if self._day is None or self._carry is None or (days == self._day).all():
            posterior.condition(x, y, values, self._counted(posterior, x, y))
            return
        carried, weights = values.copy(), np.ones(len(values))
        today = days == self._day
        counted = self._counted(posterior, x[today], y[today])
        if counted is not None:
            weights[today] = counted
        for day in np.unique(days[days < self._day]).tolist():
            of_day = days == day
            carried[of_day], variance = self._carry(day, values[of_day])
            weights[of_day] = posterior.kernel.noise / (posterior.kernel.noise + variance)
        posterior.condition(x, y, carried, sign * weights)

    @property
    def used_kernel(self) -> RbfKernel:
        """The kernel that the posterior uses. With tiles, the noise has a lower bound."""
        return self.kernel if self._posterior is None else self._posterior.kernel

    def write_all(self, value: NDArray[np.float32], uncertainty: NDArray[np.float32], *, clip: bool) -> None:
        """Write the value and uncertainty of all cells into arrays [W, H]."""
        posterior = self._posterior
        if not isinstance(posterior, CellPosterior):
            self._written = None
            self.write_changes(value, uncertainty, clip=clip)
            # The next `write_changes` may be called with other arrays, so it must write all cells.
            self._written = None
            return
        mean = self.prior_mean(len(self))
        response, constant = posterior.response.reshape(2, *self._shape)
        value[:] = mean + response - mean * constant
        if clip:
            np.clip(value, 0.0, 1.0, out=value)
        variance = posterior.variance.reshape(self._shape)
        uncertainty[:] = np.sqrt(np.maximum(variance, 0.0) + self.kernel.noise)
        if self.classes is not None:
            self.classes.decide(value, uncertainty)
            self._show_readings(value, uncertainty)

    def write_changes(
        self, value: NDArray[np.float32], uncertainty: NDArray[np.float32], *, clip: bool
    ) -> NDArray[np.bool_]:
        """Write the changed cells to two arrays and return the written tiles.

        The arrays must be the same at each call, and the posterior must not be exact.
        """
        posterior = self._posterior
        assert posterior is not None
        assert not isinstance(posterior, ExactPosterior)
        if isinstance(posterior, CellPosterior):
            self._written = None
            self.write_all(value, uncertainty, clip=clip)
            return np.ones(tile_shape(self._shape), np.bool_)
        classes = self.classes
        state = posterior, self.prior_mean(len(self)), classes, self._exact
        whole = self._written != state
        self._written = state
        then = None if classes is None else partial(classes.decide, value, uncertainty)
        changed = posterior.lattice.write(
            state[1], clip=clip, whole=whole, value=value, uncertainty=uncertainty, then=then
        )
        if classes is not None:
            x, y = self._cells.array[self._shown :].T
            changed[x // TILE_CELLS, y // TILE_CELLS] = True
            self._shown = len(self)
            self._show_readings(value, uncertainty)
        return changed

    def _show_readings(self, value: NDArray[np.float32], uncertainty: NDArray[np.float32]) -> None:
        """Write today's readings as certain values if all readings are exact class values."""
        assert self.classes is not None
        if not self._exact or self._day is None:
            return
        read = np.flatnonzero(self._days.array == self._day)
        x, y = self._cells.array[read].T
        hosts = self.classes.hosts((x, y))
        x, y, read = x[hosts], y[hosts], read[hosts]
        value[x, y] = _nearest_class(self._values.array[read])
        uncertainty[x, y] = 0.0

    def _new_posterior(self, method: _Method) -> CellPosterior | LocalPosterior | WholePosterior:
        if method is _Method.EXACT:
            return ExactPosterior(self._shape, self.kernel)
        whole = self._whole_posterior()
        if whole is not None:
            return whole
        if method is _Method.WINDOWED:
            return WindowedPosterior(self._shape, self.kernel)
        from sensors.estimators.gp.local import LEAST_NOISE, LocalPosterior

        noise = max(self.kernel.noise, LEAST_NOISE * self.kernel.amplitude)
        # Land without the crop is healthy with certainty, whatever the posterior there.
        hosts = None if self.classes is None else self.classes.hosts
        return LocalPosterior(self._shape, replace(self.kernel, noise=noise), hosts)

    def _whole_posterior(self) -> WholePosterior | None:
        """Return a posterior in sine functions over the whole farm; None if it needs too many functions."""
        # The import is here because loading compiled code is slow.
        from sensors.estimators.gp.local import WholePosterior

        spectrum = WholePosterior.spectrum_of_farm(
            self._shape, self.kernel, MOST_OBSERVATIONS, MOST_FUNCTIONS
        )
        return None if spectrum is None else WholePosterior(self._shape, self.kernel, spectrum)


def _nearest_class(values: NDArray[np.floating]) -> Floats:
    """Return the class value (0, 1/2 or 1) nearest to each reading."""
    return np.clip(np.round(2.0 * values.astype(np.float64)) / 2.0, 0.0, 1.0)


def due_fit(n: int) -> int:
    """Return the number of observations, at most `n`, at which the last kernel fit was due.

    >>> [due_fit(n) for n in (15, 16, 31, 32, 1000, 2047, 2048, 10_000)]
    [0, 16, 16, 32, 512, 512, 2048, 8192]
    """
    if n < _FIRST_FIT:
        return 0
    due = 1 << (n.bit_length() - 1)
    # A fit restarts the posterior. A fit uses at most `_FIT_POINTS`, so fits become rarer beyond this number.
    late = due > _FIT_POINTS and (due // _FIT_POINTS).bit_length() % 2 == 0
    return due // 2 if late else due


def _fit_subset(n: int) -> NDArray[np.intp]:
    """Return the indices of those of the first `n` observations that a kernel fit uses."""
    if n <= _FIT_POINTS:
        return np.arange(n)
    run = _FIT_POINTS // _FIT_RUNS
    starts = np.linspace(0, n - run, _FIT_RUNS).astype(np.intp)
    return (starts[:, None] + np.arange(run)).ravel()
