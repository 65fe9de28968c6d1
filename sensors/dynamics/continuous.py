"""Dynamics of continuous fields: base class, fields that are only measured, and smooth static fields."""

from __future__ import annotations

import math
from abc import ABC
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from geo.linear_algebra import exp
from sensors.errors import EnvironmentDataError

_Level = NDArray[np.float32]
_LEAST_COARSE_CELLS = 8


class Course(Protocol):
    """Computes a continuous field on a farm day by day."""

    @property
    def pieces(self) -> int:
        """Number of pieces in which the field of a day is computed."""

    def compute(
        self,
        day: int,
        out: _Level,
        earlier: tuple[int, _Level] | None = None,
        on_piece: Callable[[], None] = lambda: None,
    ) -> None:
        """Compute the field of a day; day 0 is the initial state, before any daily step.

        Parameters
        ----------
        out : float32[W, H]
            Array that receives the field.
        earlier : (int, float32[W, H]), optional
            An earlier day and the field of that day, from which the computation starts.
        on_piece : callable
            Called after each piece.
        """


class ContinuousDynamics(ABC):
    """Base class of the dynamics of continuous fields. A subclass is a frozen dataclass of parameters.

    A subclass defines `kind` and `days`. The subclass is registered as an entry point named by `kind` in the
    group ``wbf_mission.dynamics`` (``docs/fields.md`` has an example).
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]
    kind: ClassVar[str]
    """Name of the dynamics in field files."""

    def days(self, shape: tuple[int, int], rng: Generator) -> Iterator[NDArray[np.floating]]:
        """Yield the field of day 0, 1, 2, ... without end, as float[W, H] with values in 0..1.

        A parameter that is a length has to be a fraction of the farm's sides, because estimators also
        simulate the field on a coarse grid with the farm's proportions.

        Parameters
        ----------
        shape : tuple of int
            Width and height of the farm, cells.
        rng : numpy.random.Generator
            The random generator; equal generators give equal fields.
        """
        raise NotImplementedError

    def course(self, shape: tuple[int, int], last_day: int, rng: Generator) -> Course:  # noqa: ARG002
        """Return the field's course up to `last_day`; a subclass that computes in pieces overrides this."""
        return _DailyCourse(self.kind, shape, self.days(shape, rng))

    def simulate_coarse(
        self, shape: tuple[int, int], days: Sequence[int], side: int, rngs: Sequence[Generator]
    ) -> NDArray[np.float64]:
        """Simulate the field on a coarse grid with the proportions of a farm.

        The longer side has `side` cells, the shorter side at least 8 cells. `days` are ascending. The result
        is float64[days, n, w, h], with one simulation for each of the n generators. The field of a day does
        not depend on the other days given.
        """
        scale = side / max(shape)
        width, height = (max(_LEAST_COARSE_CELLS, round(cells * scale)) for cells in shape)
        fields = np.empty((len(days), len(rngs), width, height))
        for number, rng in enumerate(rngs):
            course = self.course((width, height), max(days), rng)
            earlier: tuple[int, _Level] | None = None
            for k, day in enumerate(days):
                level = np.empty((width, height), np.float32)
                course.compute(day, level, earlier)
                fields[k, number] = level
                earlier = day, level
        return fields


@dataclass(slots=True)
class _DailyCourse:
    """Course that iterates over `ContinuousDynamics.days` and checks each day's field."""

    kind: str
    shape: tuple[int, int]
    left: Iterator[NDArray[np.floating]]
    pieces: int = 1
    day: int = -1

    def compute(
        self,
        day: int,
        out: _Level,
        earlier: tuple[int, _Level] | None = None,  # noqa: ARG002 (days are generated in order)
        on_piece: Callable[[], None] = lambda: None,
    ) -> None:
        level = None
        while self.day < day:
            level = next(self.left, None)
            self.day += 1
        fits = isinstance(level, np.ndarray) and level.shape == self.shape and level.dtype.kind == "f"
        if not fits or not (level.min() >= 0.0 and level.max() <= 1.0):  # type: ignore[union-attr]
            raise EnvironmentDataError(
                f"{self.kind}: days() did not yield a float array of {self.shape[0]} x {self.shape[1]} values"
                f" in 0..1 for day {day}"
            )
        out[...] = level
        on_piece()


@dataclass(frozen=True, slots=True)
class Measured(ContinuousDynamics):
    """Prior of a field that is only measured, because no model to simulate the field is known.

    Values are normally distributed about the mean of the readings. Readings of all days count equally.

    Parameters
    ----------
    correlation_length_m : float
        Lengthscale of the squared exponential kernel, metres. The correlation at this distance is 0.61.
    spread : float
        Standard deviation of the latent function (field without noise), as a fraction of the range.
    noise : float
        Standard deviation of a cell's value from the latent function, as a fraction of the field's range.

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
        """Raise EnvironmentDataError, because the field cannot be simulated."""
        raise EnvironmentDataError(
            'a field that is only measured cannot be simulated; give it a kind such as "continuous"'
        )


# The smoothing Gaussian is cut at this many standard deviations; the cut tails weigh less than 1e-4.
_TRUNCATED_AT = 4.0


@dataclass(frozen=True, slots=True)
class SmoothParameters(ContinuousDynamics):
    """Smooth static fields: Gaussian random fields that do not change from day to day.

    Smooth fields are the usual test case of informative path planning. The exact model of smooth fields is a
    Gaussian process with a squared exponential kernel. White noise smoothed by a Gaussian of standard
    deviation l / sqrt(2) has the correlation exp(-d^2 / (2 l^2)) (process convolution: D. Higdon, *Space and
    Space-Time Modeling using Process Convolutions*, 2002).

    Parameters
    ----------
    correlation_length : float
        Lengthscale of the squared exponential covariance, as a fraction of each side of the farm. At this
        distance the correlation is 0.61, exp(-1/2).
    mean, spread : float
        Mean and standard deviation of the values, before values are clipped to 0..1.

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
        # `left` is the variance of the smoothed noise; the white noise has variance 1.
        left = math.prod(float(np.square(_weights(width)).sum()) for width in widths)
        field = np.clip(self.mean + self.spread / math.sqrt(left) * inner, 0.0, 1.0)
        while True:
            yield field


def _weights(width: float) -> NDArray[np.float64]:
    """Return a smoothing Gaussian along an axis; `width` is its standard deviation in cells."""
    reach = int(_TRUNCATED_AT * width + 0.5)
    weights: NDArray[np.float64] = exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    weights /= weights.sum()
    return weights
