"""Smooth static fields: Gaussian random fields that do not change from day to day.

Those of classic informative path planning, on which a Gaussian process with a squared exponential kernel is
the exact model. White noise that a Gaussian of the standard deviation l / sqrt(2) smooths has the correlation
exp(-d^2 / (2 l^2)) (process convolution: D. Higdon, *Space and Space-Time Modeling using Process
Convolutions*, 2002).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from geo.linear_algebra import exp
from sensors.dynamics.continuous import ContinuousDynamics
from sensors.errors import EnvironmentDataError

_TRUNCATED_AT = 4.0  # Standard deviations of the smoothing Gaussian: less than 1e-4 of its weight lies beyond


@dataclass(frozen=True, slots=True)
class SmoothParameters(ContinuousDynamics):
    """Parameters of a smooth field.

    Parameters
    ----------
    correlation_length : float
        Length scale of the squared exponential covariance, as a part of each side of the farm: cells so far
        apart are correlated by exp(-1/2), 0.61.
    mean, spread : float
        Mean and standard deviation of the values, which are cut to 0..1.

    Raises
    ------
    EnvironmentDataError
        If a value is out of its range.

    Examples
    --------
    >>> smooth = SmoothParameters(correlation_length=0.2)
    >>> field = next(smooth.days((60, 60), np.random.default_rng(0)))
    >>> bool(abs(field[:-12] - field[12:]).mean() > 4.0 * abs(field[:-1] - field[1:]).mean())
    True
    """

    kind: ClassVar[str] = "smooth"

    correlation_length: float = 0.15
    mean: float = 0.5
    spread: float = 0.15

    def __post_init__(self) -> None:
        if not 0.001 <= self.correlation_length <= 2.0:
            length = self.correlation_length
            raise EnvironmentDataError(f"smooth: correlation_length {length} is not in 0.001..2")
        if not 0.0 <= self.mean <= 1.0:
            raise EnvironmentDataError(f"smooth: mean {self.mean} is not in 0..1")
        if not 0.0 < self.spread <= 1.0:
            raise EnvironmentDataError(f"smooth: spread {self.spread} is not above 0 and at most 1")

    def days(self, shape: tuple[int, int], rng: Generator) -> Iterator[NDArray[np.floating]]:
        """Yield the same field on every day; see `ContinuousDynamics.days`."""
        from scipy.ndimage import correlate1d

        widths = [cells * self.correlation_length / math.sqrt(2.0) for cells in shape]
        margins = [math.ceil(_TRUNCATED_AT * width) for width in widths]
        noise = rng.standard_normal([n + 2 * margin for n, margin in zip(shape, margins, strict=True)])
        smoothed = noise
        for axis, width in enumerate(widths):
            smoothed = correlate1d(smoothed, _weights(width), axis, mode="constant")
        inner = smoothed[tuple(slice(m, m + n) for m, n in zip(margins, shape, strict=True))]
        # What the smoothing leaves of a variance of 1.
        left = math.prod(float(np.square(_weights(width)).sum()) for width in widths)
        field = np.clip(self.mean + self.spread / math.sqrt(left) * inner, 0.0, 1.0)
        while True:
            yield field


def _weights(width: float) -> NDArray[np.float64]:
    """Return the weights of the smoothing along an axis."""
    reach = int(_TRUNCATED_AT * width + 0.5)
    weights: NDArray[np.float64] = exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    weights /= weights.sum()
    return weights
