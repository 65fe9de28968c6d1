"""One field of the Gaussian process estimator: its observations, mean, kernel and posterior."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sensors.estimators.append_buffer import GrowingArray
from sensors.estimators.gp.posterior_exact import ExactPosterior
from sensors.estimators.gp.rbf import Cells, Floats, RbfKernel

if TYPE_CHECKING:
    from sensors.estimators.gp.local import LocalPosterior, WholePosterior

MOST_FUNCTIONS = 1024
"""With more functions over the whole farm than this, the posterior is computed tile by tile."""
MOST_OBSERVATIONS = 1_000_000
"""For how many observations the functions over the whole farm are chosen."""
_FIRST_FIT = 16
_FIT_POINTS = 512
_FIT_RUNS = 8

KernelFit = Callable[[Cells, Cells, Floats], RbfKernel]


class FieldProcess:
    """The observations of one field, its mean, its kernel and its posterior.

    Parameters
    ----------
    shape : tuple of int
        Width and height in cells.
    mean : float or None
        The prior mean; None is the mean of the observations so far.
    mean_before : float
        The mean without observations, if `mean` is None.
    kernel : RbfKernel
        The kernel.
    """

    def __init__(
        self, shape: tuple[int, int], mean: float | None, mean_before: float, kernel: RbfKernel
    ) -> None:
        self.kernel = kernel
        self.mean = mean
        self._first_kernel = kernel
        self._mean_before = mean_before
        self._shape = shape
        self._cells = GrowingArray((2,), np.int32)
        self._values = GrowingArray((), np.float64)
        self._fitted = 0
        self._conditioned = 0
        self._posterior: ExactPosterior | LocalPosterior | WholePosterior | None = None
        self._made_for: tuple[RbfKernel, bool] | None = None
        self._written: tuple[object, float] | None = None

    def __len__(self) -> int:
        return len(self._values)

    def append(self, x: Cells, y: Cells, values: NDArray[np.floating]) -> None:
        """Keep further observations."""
        self._cells.append(np.stack([x, y], axis=1))
        self._values.append(values)

    def fit(self, fit_kernel: KernelFit) -> None:
        """Fit the kernel to the observations if that is due."""
        count = due_fit(len(self))
        if count <= self._fitted:
            return
        self._fitted = count
        chosen = _fit_subset(count)
        x, y = self._cells.array[chosen].T
        residuals: Floats = self._values.array[chosen] - self.prior_mean(count)
        self.kernel = self._first_kernel if np.ptp(residuals) == 0 else fit_kernel(x, y, residuals)

    def prior_mean(self, count: int) -> float:
        """Return the prior mean after so many observations."""
        if self.mean is not None:
            return self.mean
        return float(self._values.array[:count].mean()) if count else self._mean_before

    def update(self, *, exact: bool) -> None:
        """Bring the posterior up to date with observations and kernel.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the covariance of the observations is singular.
        """
        posterior = self._posterior
        state = self.kernel, exact
        if posterior is None or self._made_for != state:
            self._posterior = posterior = self._new_posterior(exact)
            self._made_for = state
            self._conditioned = 0
        if self._conditioned < len(self):
            x, y = self._cells.array[self._conditioned :].T
            posterior.condition(x, y, self._values.array[self._conditioned :])
            self._conditioned = len(self)
        if not isinstance(posterior, ExactPosterior):
            posterior.solve()

    @property
    def used_kernel(self) -> RbfKernel:
        """The kernel of the posterior: tiles bound its noise from below."""
        return self.kernel if self._posterior is None else self._posterior.kernel

    def write_all(self, value: NDArray[np.float32], uncertainty: NDArray[np.float32], *, clip: bool) -> None:
        """Write the exact posterior's mean, and the deviation of an observation, into arrays [W, H]."""
        posterior = self._posterior
        assert isinstance(posterior, ExactPosterior)
        mean = self.prior_mean(len(self))
        response, constant = posterior.response.reshape(2, *self._shape)
        value[:] = mean + response - mean * constant
        if clip:
            np.clip(value, 0.0, 1.0, out=value)
        variance = posterior.variance.reshape(self._shape)
        uncertainty[:] = np.sqrt(np.maximum(variance, 0.0) + self.kernel.noise)

    def write_changes(
        self, value: NDArray[np.float32], uncertainty: NDArray[np.float32], *, clip: bool
    ) -> NDArray[np.bool_]:
        """Bring arrays [W, H] up to date, the same ones at each call, with a posterior that is not exact.

        Returns
        -------
        bool[tiles along x, tiles along y]
            The tiles that were written to.
        """
        posterior = self._posterior
        assert posterior is not None
        assert not isinstance(posterior, ExactPosterior)
        state = (posterior, self.prior_mean(len(self)))
        whole = self._written != state
        self._written = state
        return posterior.lattice.write(state[1], clip=clip, whole=whole, value=value, uncertainty=uncertainty)

    def _new_posterior(self, exact: bool) -> ExactPosterior | LocalPosterior | WholePosterior:
        if exact:
            return ExactPosterior(self._shape, self.kernel)
        # Compiled code is loaded only if it is used.
        from sensors.estimators.gp.local import LEAST_NOISE, LocalPosterior, WholePosterior

        spectrum = WholePosterior.spectrum_of_farm(
            self._shape, self.kernel, MOST_OBSERVATIONS, MOST_FUNCTIONS
        )
        if spectrum is not None:
            return WholePosterior(self._shape, self.kernel, spectrum)
        noise = max(self.kernel.noise, LEAST_NOISE * self.kernel.amplitude)
        return LocalPosterior(self._shape, replace(self.kernel, noise=noise))


def due_fit(n: int) -> int:
    """Return the number of observations at which the kernel was last due: 16, 32, ..., 512, 2048, ..., or 0.

    >>> [due_fit(n) for n in (15, 16, 31, 32, 1000, 2047, 2048, 10_000)]
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
