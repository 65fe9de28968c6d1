"""The squared exponential kernel with white noise on a grid of cells, and its maximum likelihood fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.linear_algebra import cholesky, exp, inverse_of_factor, log, product
from sensors.errors import EstimatorError

Floats = NDArray[np.float64]
Cells = NDArray[np.int32]

SINGULAR_COST = 1e25  # The cost is finite, so that the optimiser can turn back
_CONVERGED: Any = {"ftol": 1e-10, "xtol": 1e-8, "gtol": 1e-7, "maxfun": 2000}


@dataclass(frozen=True, slots=True)
class RbfKernel:
    """The kernel ``amplitude exp(-dx^2 / 2 length_x^2 - dy^2 / 2 length_y^2)`` plus white noise.

    The defaults are the initial values of the paper's Gaussian process.

    Parameters
    ----------
    length_x, length_y : float
        Lengthscales, in cells.
    noise : float
        Variance of the white noise.
    amplitude : float
        Variance of the latent function (the field without noise).

    Raises
    ------
    EstimatorError
        If a parameter is not positive and finite.
    """

    length_x: float = 2.0
    length_y: float = 2.0
    noise: float = 0.5
    amplitude: float = 1.0

    def __post_init__(self) -> None:
        for name in ("length_x", "length_y", "noise", "amplitude"):
            value = getattr(self, name)
            if not 0 < value < float("inf"):
                raise EstimatorError(f"kernel: {name} is {value}, expected a positive number")

    def along_x(self, a: NDArray[Any], b: NDArray[Any]) -> Floats:
        """Return the kernel's factor along x between columns a[n] and b[m], float64[n, m]."""
        return _factor(a, b, self.length_x)

    def along_y(self, a: NDArray[Any], b: NDArray[Any]) -> Floats:
        """Return the kernel's factor along y between rows a[n] and b[m], float64[n, m]."""
        return _factor(a, b, self.length_y)

    def between(self, x: Cells, y: Cells) -> Floats:
        """Return the covariance of the latent function between all pairs of cells, float64[n, n]."""
        return self.amplitude * self.along_x(x, x) * self.along_y(y, y)


def _factor(a: NDArray[Any], b: NDArray[Any], length: float) -> Floats:
    # Since distances on a grid are small whole numbers, a table saves most exponentials.
    distance = np.abs(np.subtract.outer(a.astype(np.intp), b.astype(np.intp)))
    table: Floats = exp(-0.5 * (np.arange(int(distance.max(initial=0)) + 1) / length) ** 2)
    return table[distance]


def fit_kernel(
    x: Cells,
    y: Cells,
    residuals: Floats,
    *,
    starts: tuple[RbfKernel, ...],
    length_bounds: tuple[float, float],
    noise_bounds: tuple[float, float],
    amplitude_bounds: tuple[float, float],
) -> RbfKernel:
    """Fit the kernel by maximum marginal likelihood (truncated Newton method with gradients).

    Return the best optimum that is found from the starts, or the first start if there is none. A parameter
    with two equal bounds is fixed.
    """
    dx2 = np.subtract.outer(x, x).astype(np.float64) ** 2
    dy2 = np.subtract.outer(y, y).astype(np.float64) ** 2
    limits = log([length_bounds, length_bounds, noise_bounds, amplitude_bounds])
    bounds: list[tuple[float, float]] = [(low, high) for low, high in limits.tolist()]
    best, best_cost = starts[0], np.inf
    for start in starts:
        first = np.clip(
            log([start.length_x, start.length_y, start.noise, start.amplitude]), limits[:, 0], limits[:, 1]
        )
        found = least_in_box(_cost, first, (dx2, dy2, residuals), bounds)
        if found.fun < best_cost:
            best, best_cost = RbfKernel(*exp(found.x).tolist()), float(found.fun)
    return best


def least_in_box(
    cost: Callable[..., Any],
    first: Floats,
    arguments: tuple[Floats, ...],
    bounds: list[tuple[float, float]],
) -> Any:
    """Minimise within bounds the function `cost`, which returns value and gradient."""
    from scipy.optimize import minimize

    # TNC computes its sums itself. L-BFGS-B calls BLAS, whose results depend on the processor.
    return minimize(cost, first, arguments, method="TNC", jac=True, bounds=bounds, options=_CONVERGED)


def _cost(theta: Floats, dx2: Floats, dy2: Floats, residuals: Floats) -> tuple[float, Floats]:
    """Return the negative log marginal likelihood and its gradient (Rasmussen & Williams, eq. 5.8, 5.9)."""
    smooth, factor = factor_covariance(theta, dx2, dy2)
    if factor is None:
        return SINGULAR_COST, np.zeros(len(theta))
    inverse = inverse_of_factor(factor)
    weights = product(residuals, inverse)
    cost = 0.5 * product(residuals, weights) + log(factor.diagonal()).sum()
    # The derivative of the cost with respect to K is -(w w' - K^-1) / 2.
    inner = np.outer(weights, weights) - inverse
    return float(cost), -0.5 * kernel_gradient(theta, smooth, inner, dx2, dy2)


def factor_covariance(theta: Floats, dx2: Floats, dy2: Floats) -> tuple[Floats, Floats | None]:
    """Return the covariance without noise, and the Cholesky factor with noise (None: it does not exist)."""
    length_x, length_y, noise, amplitude = exp(theta)
    smooth = amplitude * exp(-0.5 * (dx2 / length_x**2 + dy2 / length_y**2))
    covariance = smooth.copy()
    covariance.flat[:: len(covariance) + 1] += noise
    try:
        return smooth, cholesky(covariance)
    except np.linalg.LinAlgError:
        return smooth, None


def kernel_gradient(theta: Floats, smooth: Floats, inner: Floats, dx2: Floats, dy2: Floats) -> Floats:
    """Return ``trace(inner dK/dtheta)`` by log parameter; `smooth` is the covariance without noise."""
    length_x, length_y, noise, _ = exp(theta)
    by_smooth = inner * smooth
    by_x, by_y = (by_smooth * dx2).sum() / length_x**2, (by_smooth * dy2).sum() / length_y**2
    return np.array([by_x, by_y, noise * np.trace(inner), by_smooth.sum()])
