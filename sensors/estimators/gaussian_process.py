"""The fast Gaussian process: exact and incremental where it fits into memory, local where it does not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sensors.errors import EstimatorError
from sensors.estimators.base import BaseEstimator
from sensors.estimators.growing import GrowingArray
from sensors.estimators.posterior_exact import ExactPosterior
from sensors.estimators.posterior_tiled import TILE_CELLS, TiledPosterior
from sensors.estimators.rbf import Floats, RbfKernel, fit_kernel
from sensors.fields import DEFAULT_VALUES, FIELDS
from sensors.information import InformationModel

if TYPE_CHECKING:
    from geo.grid import FarmGrid
    from sensors.observations import Observations

HEALTHY_MEAN = (1.0, 1.0, None)
ZERO_MEAN = (0.0, 0.0, 0.0)
METHODS = ("auto", "exact", "local")

_FIRST_FIT = 16
_FIT_POINTS = 512
_FIT_RUNS = 8


class GaussianProcessEstimator(BaseEstimator):
    """A Gaussian process per field with the paper's kernel: squared exponential plus white noise.

    The kernel is fitted rarely, by marginal likelihood, when a field has 16, 32, 64, ..., 512, 2048, 8192,
    ... observations, and from those only; beyond 512, from eight runs of 64 consecutive ones, evenly
    spread. While they are all equal (nothing but healthy plants so far) there is nothing to fit, and the
    kernel stays what it was given as. (The paper fixes the amplitude to 1: ``amplitude_bounds=(1, 1)``.)

    Between fits, another observation updates the posterior in O(observations x cells), exactly
    (`ExactPosterior`). Repeated observations of a cell are independent looks. When the exact posterior of the
    three fields would need more memory than allowed, the posterior is local (`TiledPosterior`).

    The uncertainty is the standard deviation of an observation, noise included, as in the paper: the noise is
    what a cell differs from its smooth neighbourhood by.

    Parameters
    ----------
    prior_mean : tuple of three (float or None)
        The value of each field far from all observations; None is the mean of its observations so far.
        The default is healthy, healthy, and the running mean for soil; ``(0, 0, 0)`` is the paper's.
    kernel : RbfKernel
        The kernel until the first fit.
    optimise : bool
        Whether the kernel is fitted.
    length_bounds, noise_bounds, amplitude_bounds : tuple of two floats
        Limits of the fit: length scales in cells, variances of the noise and of the smooth part.
    clip : bool
        Whether values are limited to 0 .. 1, outside of which no field lies.
    method : {"auto", "exact", "local"}
        See above.
    memory_limit_mb : float
        What the exact posterior may take, in MiB.
    max_points : int
        How many observed cells a tile of the local posterior uses at most; at least its own 1024.

    Attributes
    ----------
    kernels_ : list of RbfKernel
        The kernel of each field.

    Examples
    --------
    >>> from geo.farms import get_farm
    >>> from sensors.observations import Observations
    >>> seen = Observations([5], [5], [0.0], [6], [[0.5, 1.0, 0.25]])
    >>> model = GaussianProcessEstimator().fit(get_farm("miniberry-10").grid(), seen).predict()
    >>> [round(float(value), 3) for value in model.of("tylcv")[[5, 7, 9], 5]]
    [0.667, 0.798, 0.955]
    """

    kernels_: list[RbfKernel]

    def __init__(
        self,
        prior_mean: tuple[float | None, float | None, float | None] = HEALTHY_MEAN,
        kernel: RbfKernel = RbfKernel(),  # noqa: B008 (immutable)
        optimise: bool = True,
        length_bounds: tuple[float, float] = (1.0, 10.0),
        noise_bounds: tuple[float, float] = (1e-5, 1e5),
        amplitude_bounds: tuple[float, float] = (0.01, 1.0),
        clip: bool = True,
        method: str = "auto",
        memory_limit_mb: float = 1024.0,
        max_points: int = 1536,
    ) -> None:
        self.prior_mean = prior_mean
        self.kernel = kernel
        self.optimise = optimise
        self.length_bounds = length_bounds
        self.noise_bounds = noise_bounds
        self.amplitude_bounds = amplitude_bounds
        self.clip = clip
        self.method = method
        self.memory_limit_mb = memory_limit_mb
        self.max_points = max_points

    def _start(self, grid: FarmGrid) -> None:
        self._check_parameters()
        self._fields = [_FieldProcess(self, grid.shape, k) for k in range(len(FIELDS))]
        self.kernels_ = [self.kernel] * len(FIELDS)

    def _learn(self, observations: Observations) -> None:
        for process, sensed in zip(self._fields, observations.sensed.T, strict=True):
            process.append(observations[sensed])

    def _estimate(self) -> InformationModel:
        local = self._needs_local()
        value = np.empty((len(FIELDS), *self.grid_.shape), np.float32)
        uncertainty = np.empty_like(value)
        for k, process in enumerate(self._fields):
            try:
                process.update(local)
            except np.linalg.LinAlgError:
                name = FIELDS[k]
                msg = (
                    f"gp: the covariance of {name} is singular; use a kernel or noise_bounds with more noise"
                )
                raise EstimatorError(msg) from None
            process.fill(value[k], uncertainty[k])
        if self.clip:
            np.clip(value, 0.0, 1.0, out=value)
        self.kernels_ = [process.kernel for process in self._fields]
        return InformationModel(value, uncertainty)

    def _needs_local(self) -> bool:
        needed = sum(ExactPosterior.bytes_needed(len(p), self.grid_.shape) for p in self._fields) / 2**20
        if self.method == "exact" and needed > self.memory_limit_mb:
            msg = (
                f"gp: the exact method needs {needed:.0f} MiB for {self.n_observations_} observations on"
                f" {self.grid_.shape[0]} x {self.grid_.shape[1]} cells, memory_limit_mb is"
                f" {self.memory_limit_mb:g}; use method 'local' or 'auto', or the estimator 'adaptive-disk'"
            )
            raise EstimatorError(msg)
        return self.method == "local" or (self.method == "auto" and needed > self.memory_limit_mb)

    def _check_parameters(self) -> None:
        problems = {
            "prior_mean": len(self.prior_mean) == len(FIELDS)
            and all(mean is None or np.isfinite(mean) for mean in self.prior_mean),
            "kernel": isinstance(self.kernel, RbfKernel),
            "length_bounds": _is_interval(self.length_bounds),
            "noise_bounds": _is_interval(self.noise_bounds),
            "amplitude_bounds": _is_interval(self.amplitude_bounds),
            "method": self.method in METHODS,
            "memory_limit_mb": self.memory_limit_mb > 0,
            "max_points": self.max_points >= TILE_CELLS**2,
        }
        for name, good in problems.items():
            if not good:
                msg = f"gp: {name} cannot be {getattr(self, name)!r}"
                raise EstimatorError(msg)


def _is_interval(bounds: tuple[float, float]) -> bool:
    return len(bounds) == 2 and 0 < bounds[0] <= bounds[1] < float("inf")


class _FieldProcess:
    """The observations of one field, its kernel and its posterior."""

    def __init__(self, owner: GaussianProcessEstimator, shape: tuple[int, int], k: int) -> None:
        self.kernel = owner.kernel
        self._owner = owner
        self._shape = shape
        self._k = k
        self._cells = GrowingArray((2,), np.int32)
        self._values = GrowingArray((), np.float64)
        self._fitted = 0
        self._conditioned = 0
        self._posterior: ExactPosterior | TiledPosterior = ExactPosterior((0, 0), self.kernel)

    def __len__(self) -> int:
        return len(self._values)

    def append(self, observations: Observations) -> None:
        self._cells.append(np.stack([observations.x, observations.y], axis=1))
        self._values.append(observations.values[:, self._k])

    def update(self, local: bool) -> None:
        """Bring kernel and posterior up to date with the observations."""
        due = _due_fit(len(self)) if self._owner.optimise else 0
        if due > self._fitted:
            self._fit(due)
        wanted = TiledPosterior if local else ExactPosterior
        if (
            not isinstance(self._posterior, wanted)
            or self._posterior.kernel is not self.kernel
            or not self._conditioned
        ):
            self._posterior = (
                TiledPosterior(self._shape, self.kernel, self._owner.max_points)
                if local
                else ExactPosterior(self._shape, self.kernel)
            )
            self._conditioned = 0
        new = len(self) - self._conditioned
        if new:
            x, y = self._cells.array.T
            if isinstance(self._posterior, TiledPosterior):
                self._posterior.condition(x, y, self._values.array, new)
            else:
                old = self._conditioned
                self._posterior.condition(x[old:], y[old:], self._values.array[old:])
            self._conditioned = len(self)

    def fill(self, value: NDArray[np.float32], uncertainty: NDArray[np.float32]) -> None:
        """Write the posterior mean and standard deviation into arrays [W, H]."""
        mean = self._prior_mean(len(self))
        noise = self.kernel.noise
        if isinstance(self._posterior, ExactPosterior):
            response, constant = self._posterior.response.reshape(2, *self._shape)
            value[:] = mean + response - mean * constant
            variance = self._posterior.variance.reshape(self._shape)
            uncertainty[:] = np.sqrt(np.maximum(variance, 0.0) + noise)
            return
        value[:] = mean
        uncertainty[:] = np.sqrt(self.kernel.amplitude + noise)
        for tile, (response, constant, variance) in self._posterior.tiles.items():
            area = self._posterior.area(tile)
            value[area] = mean + response - mean * constant
            uncertainty[area] = np.sqrt(np.maximum(variance, 0.0) + noise)

    def _fit(self, count: int) -> None:
        chosen = _fit_subset(count)
        x, y = self._cells.array[chosen].T
        residuals: Floats = self._values.array[chosen] - self._prior_mean(count)
        self._fitted = count
        if np.ptp(residuals) == 0:
            self.kernel = self._owner.kernel
            return
        self.kernel = fit_kernel(
            x,
            y,
            residuals,
            starts=(self._owner.kernel,),
            length_bounds=self._owner.length_bounds,
            noise_bounds=self._owner.noise_bounds,
            amplitude_bounds=self._owner.amplitude_bounds,
        )

    def _prior_mean(self, count: int) -> float:
        given = self._owner.prior_mean[self._k]
        if given is not None:
            return given
        return float(self._values.array[:count].mean()) if count else DEFAULT_VALUES[self._k]


def _due_fit(n: int) -> int:
    """Return the number of observations at which the kernel was last due: 16, 32, ..., 512, 2048, ..., or 0.

    >>> [_due_fit(n) for n in (15, 16, 31, 32, 1000, 2047, 2048, 10_000)]
    [0, 16, 16, 32, 512, 512, 2048, 8192]
    """
    if n < _FIRST_FIT:
        return 0
    due = 1 << (n.bit_length() - 1)
    # A fit makes the posterior start anew; beyond the points that one fit uses it is worth that only rarely.
    late = due > _FIT_POINTS and (due // _FIT_POINTS).bit_length() % 2 == 0
    return due // 2 if late else due


def _fit_subset(n: int) -> NDArray[np.intp]:
    """Return the indices of the observations, of the first `n`, from which the kernel is fitted."""
    if n <= _FIT_POINTS:
        return np.arange(n)
    run = _FIT_POINTS // _FIT_RUNS
    starts = np.linspace(0, n - run, _FIT_RUNS).astype(np.intp)
    return (starts[:, None] + np.arange(run)).ravel()
