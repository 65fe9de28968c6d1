"""Wind over the farm: mean wind, and gusts of a Gauss-Markov process or of Dryden's spectra.

Gusts are drawn in blocks on a fixed time grid of `GRID_S`. The wind at a time and height depends on the seed,
but not on the time step of the simulation. See docs/wind-and-noise.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.airframe.power_spec import within
from sim_vehicle.errors import VehicleError
from sim_vehicle.weather.atmosphere import (
    AIR_EAST,
    AIR_NORTH,
    HAS_DRYDEN,
    HIGHEST_M,
    MEAN_EAST,
    MEAN_NORTH,
    REFERENCE_HEIGHT,
    SHEAR_LAW,
    SHEAR_NUMBER,
    WIND_ROW,
    Turbulence,
    WindShear,
    intensities_m_s,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

GRID_S = 0.1
BLOCK = 1024


@dataclass(frozen=True, slots=True)
class Wind:
    """Wind for a flight; raises VehicleError for a number out of range, and for two kinds of gusts at once.

    Examples
    --------
    >>> wind = Wind.from_direction(5.0, 270.0)      # a west wind blows to the east
    >>> round(wind.east_m_s, 6), round(abs(wind.north_m_s), 6)
    (5.0, 0.0)
    """

    # Mean wind at the reference height: velocity of the air to the east and north.
    east_m_s: float = 0.0
    north_m_s: float = 0.0
    gust_m_s: float = 0.0
    """Standard deviation of each horizontal component of Gauss-Markov gusts."""
    correlation_s: float = 5.0
    """Time constant of Gauss-Markov gusts."""
    seed: np.random.SeedSequence | int = 0
    """Seed of the gusts."""
    height_m: float = 10.0
    """Reference height of the mean wind; weather reports give the wind at 10 m."""
    shear: WindShear | None = None
    """Profile over height; None for the same mean wind at all heights."""
    turbulence: Turbulence | None = None
    """Dryden's gusts, in place of ``gust_m_s``."""
    mirrored: bool = False
    """Whether all gusts are reversed. A reversed gust is as likely as its original, and the mean over two
    flights with opposite gusts varies little (antithetic variates)."""

    def __post_init__(self) -> None:
        names = ("east_m_s", "north_m_s", "gust_m_s", "correlation_s")
        within("wind", self, *((name, -200.0, 200.0) for name in names))
        if self.gust_m_s < 0.0 or self.correlation_s <= 0.0:
            msg = f"wind: gust_m_s {self.gust_m_s} is negative or correlation_s {self.correlation_s} is <= 0"
            raise VehicleError(msg)
        if not 1.0 <= self.height_m <= HIGHEST_M:
            raise VehicleError(f"wind: the height {self.height_m} m of the mean wind is outside 1..304")
        if self.gust_m_s > 0.0 and self.turbulence is not None:
            raise VehicleError(f"wind: a gust of {self.gust_m_s:g} m/s and turbulence: give one of them")

    @classmethod
    def from_direction(
        cls,
        speed_m_s: float,
        from_deg: float,
        *,
        gust_m_s: float = 0.0,
        correlation_s: float = 5.0,
        seed: np.random.SeedSequence | int = 0,
        height_m: float = 10.0,
        shear: WindShear | None = None,
        turbulence: Turbulence | None = None,
    ) -> Wind:
        """Return the wind of a weather report: its speed, and the compass direction from which it blows."""
        angle = math.radians(from_deg)
        east, north = -speed_m_s * math.sin(angle), -speed_m_s * math.cos(angle)
        return cls(east, north, gust_m_s, correlation_s, seed, height_m, shear, turbulence)

    @property
    def is_gusty(self) -> bool:
        """Whether the wind changes with time."""
        return self.gust_m_s > 0.0 or (self.turbulence is not None and self.turbulence.w20_m_s > 0.0)

    def mean_at(self, height_m: float) -> tuple[float, float]:
        """Return the mean wind (east, north) at a height.

        Examples
        --------
        >>> Wind(5.0, shear=WindShear("power", exponent=0.0)).mean_at(50.0)
        (5.0, 0.0)
        """
        factor = 1.0 if self.shear is None else self.shear.factor(height_m, self.height_m)
        return self.east_m_s * factor, self.north_m_s * factor

    def share_above(self, speed_m_s: float, height_m: float) -> float:
        """Return the fraction of time in which the horizontal wind at a height exceeds a speed.

        Both components are normally distributed about their means, with equal variances. Hence the squared
        wind speed, divided by the variance, has a noncentral chi-squared distribution with two degrees of
        freedom.

        Examples
        --------
        >>> round(Wind.from_direction(5.0, 270.0, gust_m_s=2.0).share_above(9.8, 10.0), 4)
        0.012
        >>> Wind.from_direction(5.0, 270.0).share_above(9.8, 10.0)
        0.0
        """
        mean_m_s, deviation_m_s = math.hypot(*self.mean_at(height_m)), self.gust_m_s
        if self.turbulence is not None:
            deviation_m_s = intensities_m_s(height_m, self.turbulence.w20_m_s)[0]
        if deviation_m_s == 0.0:
            return float(mean_m_s > speed_m_s)
        # The import is here because only forecasts of gusts need scipy.
        from scipy.special import chndtr

        below = chndtr((speed_m_s / deviation_m_s) ** 2, 2.0, (mean_m_s / deviation_m_s) ** 2)
        return 1.0 - float(below)

    def series(self) -> WindSeries:
        """Return the wind over time, from time 0."""
        return WindSeries(self)


class WindSeries:
    """Wind on a time grid, in blocks.

    ``block`` is float64[BLOCK, 9] with the columns of `sim_vehicle.weather.atmosphere`. The first row belongs
    to the grid index ``first``. `sim_vehicle.weather.gust_kernel.wind_at` evaluates a row. Without gusts, the
    block has a single row, which is valid at all times.
    """

    __slots__ = ("_gusts", "_rows", "_sign", "block", "first")

    def __init__(self, wind: Wind) -> None:
        seed = wind.seed
        if isinstance(seed, np.random.SeedSequence):
            # A SeedSequence changes when it spawns; with a copy, all series of one wind are equal.
            seed = np.random.SeedSequence(seed.entropy, spawn_key=seed.spawn_key, pool_size=seed.pool_size)
        self._gusts: _GaussMarkov | _Dryden | None = None
        if wind.is_gusty:
            random = np.random.Generator(np.random.PCG64(seed))
            self._gusts = _GaussMarkov(wind, random) if wind.gust_m_s > 0.0 else _Dryden(wind, random)
        self._rows = np.zeros((BLOCK if wind.is_gusty else 1, WIND_ROW))
        self._rows[:, AIR_EAST] = self._rows[:, MEAN_EAST] = wind.east_m_s
        self._rows[:, AIR_NORTH] = self._rows[:, MEAN_NORTH] = wind.north_m_s
        if wind.shear is not None:
            self._rows[:, SHEAR_LAW], self._rows[:, SHEAR_NUMBER] = wind.shear.columns
        self._rows[:, REFERENCE_HEIGHT] = wind.height_m
        self._rows[:, HAS_DRYDEN] = isinstance(self._gusts, _Dryden)
        self._sign = -1.0 if wind.mirrored else 1.0
        self.first = 0
        self.block: NDArray[np.float64] = self._draw()

    def forward(self) -> None:
        """Advance to the next block."""
        if self._gusts is not None:
            self.first += BLOCK
            self.block = self._draw()

    def at(self, index: int, height_m: float) -> tuple[float, float, float]:
        """Return the wind (east, north, up; m/s) at a grid index of at least ``first`` and at a height."""
        # The import is here because blocks of a steady wind need no compiler.
        from sim_vehicle.weather.gust_kernel import wind_at

        if self._gusts is None:
            index = self.first
        while index - self.first >= BLOCK:
            self.forward()
        east, north, up = wind_at(self.block[index - self.first], height_m)
        return east, north, up

    def _draw(self) -> NDArray[np.float64]:
        block = self._rows.copy()
        if self._gusts is not None:
            gust = self._gusts.draw()
            block[:, : gust.shape[1]] += self._sign * gust
        return block


class _GaussMarkov:
    """Gusts to the east and north; both components are first-order Gauss-Markov processes."""

    def __init__(self, wind: Wind, random: np.random.Generator) -> None:
        self._random = random
        self._decay = math.exp(-GRID_S / wind.correlation_s)
        self._noise = wind.gust_m_s * math.sqrt(1.0 - self._decay**2)
        self._last = wind.gust_m_s * random.standard_normal(2)

    def draw(self) -> NDArray[np.float64]:
        """Return the next block of Gauss-Markov gusts."""
        # The import is here because a steady wind needs no compiler.
        from sim_vehicle.weather.gust_kernel import gauss_markov

        noise = self._noise * self._random.standard_normal((BLOCK, 2))
        gust: NDArray[np.float64] = gauss_markov(noise, self._decay, self._last)
        self._last = gust[-1].copy()
        return gust


class _Dryden:
    """Dryden's gusts to the east, north and up, with the intensities at the reference height."""

    def __init__(self, wind: Wind, random: np.random.Generator) -> None:
        turbulence = wind.turbulence
        assert turbulence is not None
        self._random = random
        self._filters = turbulence.filters(GRID_S)
        self._state = turbulence.beginning(random.standard_normal(5))
        along, across, up = intensities_m_s(wind.height_m, turbulence.w20_m_s)
        speed = math.hypot(wind.east_m_s, wind.north_m_s)
        east, north = (wind.east_m_s / speed, wind.north_m_s / speed) if speed > 0.0 else (1.0, 0.0)
        self._axes = np.array(
            [[along * east, along * north, 0.0], [-across * north, across * east, 0.0], [0, 0, up]]
        )

    def draw(self) -> NDArray[np.float64]:
        """Return the next block of Dryden's gusts."""
        from sim_vehicle.weather.gust_kernel import forming_filters

        noise = self._random.standard_normal((BLOCK, 5))
        along, across, up = forming_filters(noise, self._filters, self._state).T
        # A matrix product would depend on the BLAS of the machine.
        gust = np.empty((BLOCK, 3))
        for k in range(3):
            gust[:, k] = along * self._axes[0, k] + across * self._axes[1, k] + up * self._axes[2, k]
        return gust
