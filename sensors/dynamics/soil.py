"""The Waterberry Farms benchmark's model of soil humidity, with daily evaporation and random showers.

A hump is a two-dimensional normal density, cut to a rectangle of cells around its centre; the rectangle
overlaps the farm at a random position. The initial field is a sum of humps. Each day the field is multiplied
by ``1 - evaporation``. On a rainy day, a sum P of humps is scaled to a mean rain q over the farm, ``q * W * H
* P / sum(P)``, and added; then the humidity is clipped at 1. Ten days of warm-up precede day 0.

A hump is the product of a profile along x and a profile along y. A sum of k humps is thus the product of a
(W, k) and a (k, H) matrix; the product's sum over the farm follows from the sums of columns and rows.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from geo.linear_algebra import exp, product
from sensors.dynamics.continuous import ContinuousDynamics
from sensors.errors import EnvironmentDataError

# A block of this many cells and its rain fit into a core's second-level cache.
_BLOCK_CELLS = 1 << 17


@dataclass(frozen=True, slots=True)
class SoilParameters(ContinuousDynamics):
    """Parameters of the soil humidity model.

    Parameters
    ----------
    evaporation : float
        Fraction of the humidity lost per day, 0..1.
    rain_probability : float
        Probability of rain on a day.
    mean_rain : float
        Expected humidity that a rainy day adds, averaged over the farm. A given day's average is drawn
        uniformly from 0..2 * mean_rain.
    start_humps, shower_humps : int
        Number of humps in the initial field, and number of humps in a shower.
    warm_up_days : int
        Days before day 0.
    spread : float
        Standard deviation of a hump along an axis, as a fraction of the hump's side.
    square_humps : bool
        If False, a hump has the sides of the farm, thus the covariance diag((W/8)^2, (H/8)^2), as in the
        paper. If True, a hump is a square with the farm's shorter side, as in the authors' code. On a square
        farm there is no difference.

    Raises
    ------
    EnvironmentDataError
        If a value is out of its range.
    """

    kind: ClassVar[str] = "continuous"

    evaporation: float = 0.04
    rain_probability: float = 0.8
    mean_rain: float = 0.06
    start_humps: int = 30
    shower_humps: int = 10
    warm_up_days: int = 10
    spread: float = 0.125
    square_humps: bool = False

    def __post_init__(self) -> None:
        for name in ("evaporation", "rain_probability"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise EnvironmentDataError(f"soil: {name} {getattr(self, name)} is not in 0..1")
        for name in ("mean_rain", "start_humps", "warm_up_days"):
            if not 0 <= getattr(self, name) < math.inf:
                raise EnvironmentDataError(f"soil: {name} {getattr(self, name)} is negative or not finite")
        if self.shower_humps < 1:
            raise EnvironmentDataError(f"soil: shower_humps {self.shower_humps} is less than 1")
        if not 0.0 < self.spread < math.inf:
            raise EnvironmentDataError(f"soil: spread {self.spread} is not a positive number")

    def hump_sides(self, shape: tuple[int, int]) -> tuple[int, int]:
        """Return the side lengths of a hump on a farm of this shape (cells)."""
        return (min(shape), min(shape)) if self.square_humps else shape

    def course(self, shape: tuple[int, int], last_day: int, rng: Generator) -> SoilCourse:
        """Draw the weather up to `last_day`; return the field's course (see `ContinuousDynamics.course`)."""
        return SoilCourse(shape, draw_weather(shape, last_day, self, rng), self, last_day)


@dataclass(frozen=True, slots=True, eq=False)
class Shower:
    """The shower of a rainy day."""

    mean_rain: float
    """Mean humidity over the farm that the shower adds, before clipping at 1."""
    corners: NDArray[np.int64]
    """Lower corners of the humps, int64[k, 2], in cells; a corner may be negative."""


@dataclass(frozen=True, slots=True, eq=False)
class Weather:
    """Random part of the soil model: the positions of the initial humps, and the showers."""

    start_corners: NDArray[np.int64]
    """Lower corners of the humps of the initial field, int64[k, 2], in cells."""
    showers: tuple[Shower | None, ...]
    """The shower of each day from the first warm-up day on, or None for a dry day."""


def _draw_corners(
    shape: tuple[int, int], sides: tuple[int, int], count: int, rng: Generator
) -> NDArray[np.int64]:
    corners = np.empty((count, 2), np.int64)
    for corner in corners:
        for axis in (0, 1):
            half = sides[axis] // 2
            corner[axis] = rng.integers(-half, shape[axis] + half)
    return corners


def draw_weather(shape: tuple[int, int], days: int, parameters: SoilParameters, rng: Generator) -> Weather:
    """Draw the weather of the warm-up and of `days` days.

    The order of draws is as in the authors' code. First come x and y of each initial hump. Each day
    begins with a draw of whether it rains; on a rainy day, the mean rain and x and y of each hump follow.
    """
    sides = parameters.hump_sides(shape)
    start = _draw_corners(shape, sides, parameters.start_humps, rng)
    showers: list[Shower | None] = []
    for _ in range(parameters.warm_up_days + days):
        shower = None
        if rng.random() < parameters.rain_probability:
            mean_rain = rng.uniform(0.0, 2.0 * parameters.mean_rain)
            shower = Shower(mean_rain, _draw_corners(shape, sides, parameters.shower_humps, rng))
        showers.append(shower)
    return Weather(start, tuple(showers))


def _profiles(corners: NDArray[np.int64], cells: int, side: int, spread: float) -> NDArray[np.float64]:
    """Return each hump's normal density along an axis, cut to the farm, as float64[cells, k]."""
    deviation = side * spread
    offset = np.linspace(0.0, side, side) - side / 2.0
    density = exp(-0.5 * (offset / deviation) ** 2) / (math.sqrt(2.0 * math.pi) * deviation)
    profiles = np.zeros((cells, corners.size))
    for column, corner in enumerate(corners.tolist()):
        first, stop = max(corner, 0), min(corner + side, cells)
        if first < stop:
            profiles[first:stop, column] = density[first - corner : stop - corner]
    return profiles


def hump_factors(
    corners: NDArray[np.int64], shape: tuple[int, int], parameters: SoilParameters
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two matrices, float64[W, k] and float64[k, H], whose product is the sum of all humps."""
    sides = parameters.hump_sides(shape)
    along_x = _profiles(corners[:, 0], shape[0], sides[0], parameters.spread)
    along_y = _profiles(corners[:, 1], shape[1], sides[1], parameters.spread)
    return along_x, np.ascontiguousarray(along_y.T)


def rain_factors(
    shower: Shower, shape: tuple[int, int], parameters: SoilParameters
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return two matrices whose product is a shower's rain, scaled to the shower's mean.

    Return None if all humps are off the farm, so that no rain falls.
    """
    along_x, along_y = hump_factors(shower.corners, shape, parameters)
    # `sum` is not used, because since Python 3.12 it compensates rounding errors and gives other results.
    terms = map(operator.mul, along_x.sum(axis=0).tolist(), along_y.sum(axis=1).tolist())
    fallen = reduce(operator.add, terms, 0.0)
    if fallen <= 0.0:
        return None
    return along_x * (shower.mean_rain * shape[0] * shape[1] / fallen), along_y


class SoilCourse:
    """Computes the soil humidity of a farm day by day, in blocks of rows.

    A cell's humidity does not depend on neighbouring cells, so a block can be advanced by many days while it
    is in the processor's cache. Any order of blocks and any split of the days give the same result to the
    last bit.
    """

    def __init__(
        self, shape: tuple[int, int], weather: Weather, parameters: SoilParameters, last_day: int
    ) -> None:
        self.shape = shape
        self.first_day = -parameters.warm_up_days
        rows = max(1, _BLOCK_CELLS // max(shape[1], 1))
        self.blocks = tuple(slice(first, min(first + rows, shape[0])) for first in range(0, shape[0], rows))
        self._start = _single(hump_factors(weather.start_corners, shape, parameters))
        self._remaining = np.float32(1.0 - parameters.evaporation)
        self._rains = [
            None if shower is None else _single(rain_factors(shower, shape, parameters))
            for shower in weather.showers[: parameters.warm_up_days + last_day]
        ]

    @property
    def pieces(self) -> int:
        """Number of blocks of rows."""
        return len(self.blocks)

    def begin(self, rows: slice, out: NDArray[np.float32]) -> None:
        """Compute the humidity of a block of rows on `first_day`, before the warm-up."""
        assert self._start is not None
        product(self._start[0][rows], self._start[1], out=out)

    def advance(
        self, rows: slice, block: NDArray[np.float32], day: int, until: int, out: NDArray[np.float32]
    ) -> None:
        """Advance a block from `day` to `until`, and write it to `out`, which may be `block` itself."""
        if until == day:
            out[...] = block
            return
        rain = np.empty_like(out)
        for factors in self._rains[day - self.first_day : until - self.first_day]:
            block = np.multiply(block, self._remaining, out=out)
            if factors is not None:
                product(factors[0][rows], factors[1], out=rain)
                out += rain
                np.minimum(out, np.float32(1.0), out=out)

    def compute(
        self,
        day: int,
        out: NDArray[np.float32],
        earlier: tuple[int, NDArray[np.float32]] | None = None,
        on_piece: Callable[[], None] = lambda: None,
    ) -> None:
        """Compute the humidity of a day, block by block; see `Course.compute`."""
        for rows in self.blocks:
            if earlier is None:
                self.begin(rows, out[rows])
                self.advance(rows, out[rows], self.first_day, day, out[rows])
            else:
                self.advance(rows, earlier[1][rows], earlier[0], day, out[rows])
            on_piece()


def _single(
    factors: tuple[NDArray[np.float64], NDArray[np.float64]] | None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    return None if factors is None else (factors[0].astype(np.float32), factors[1].astype(np.float32))
