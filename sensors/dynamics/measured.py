"""Fields that are only measured: nothing is assumed of how they develop, so they cannot be simulated."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from sensors.dynamics.continuous import ContinuousDynamics
from sensors.errors import EnvironmentDataError


@dataclass(frozen=True, slots=True)
class Measured(ContinuousDynamics):
    """What estimators may assume of a field that nobody has a model of.

    Values are spread normally about the mean of those that were measured; readings of earlier days count as
    those of the day.

    Parameters
    ----------
    correlation_length_m : float
        Length scale of the squared exponential kernel, metres: values so far apart are correlated by
        ``exp(-1/2)``, 0.61.
    spread : float
        Standard deviation of the smooth part, as a part of the field's range.
    noise : float
        Standard deviation of what a cell differs from its neighbourhood by, as a part of the range.

    Raises
    ------
    EnvironmentDataError
        If a value is out of its range.
    """

    kind: ClassVar[str] = "measured"

    correlation_length_m: float = 25.0
    spread: float = 0.25
    noise: float = 0.05

    def __post_init__(self) -> None:
        if not 0.0 < self.correlation_length_m < math.inf:
            msg = f"measured: correlation_length_m {self.correlation_length_m} is not above 0"
            raise EnvironmentDataError(msg)
        for name in ("spread", "noise"):
            if not 0.001 <= getattr(self, name) <= 1.0:
                raise EnvironmentDataError(f"measured: {name} {getattr(self, name)} is not in 0.001..1")

    def days(self, shape: tuple[int, int], rng: Generator) -> Iterator[NDArray[np.floating]]:  # noqa: ARG002
        """Raise EnvironmentDataError."""
        raise EnvironmentDataError(
            'a field that is only measured cannot be simulated; give it a kind that can, such as "continuous"'
        )
