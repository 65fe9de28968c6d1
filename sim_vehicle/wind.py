"""Wind over the farm: a steady wind and a gust that is a first-order Gauss-Markov process.

The gust is drawn on a fixed grid of `GRID_S` in blocks, so the wind at a time depends on the seed only, not
on how the flight was stepped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from numpy.typing import NDArray

GRID_S = 0.1
BLOCK = 1024


@dataclass(frozen=True, slots=True)
class Wind:
    """Wind for a flight.

    Parameters
    ----------
    east_m_s, north_m_s : float
        Steady wind, the direction that the air moves to.
    gust_m_s : float
        Standard deviation of each horizontal component of the gust.
    correlation_s : float
        Time constant of the gust.
    seed : numpy.random.SeedSequence or int
        Seed of the gust.

    Raises
    ------
    VehicleError
        If a number is not finite, or the gust or its time constant is negative.

    Examples
    --------
    >>> wind = Wind.from_direction(5.0, 270.0)      # a west wind blows to the east
    >>> round(wind.east_m_s, 6), round(abs(wind.north_m_s), 6)
    (5.0, 0.0)
    """

    east_m_s: float = 0.0
    north_m_s: float = 0.0
    gust_m_s: float = 0.0
    correlation_s: float = 5.0
    seed: np.random.SeedSequence | int = 0

    def __post_init__(self) -> None:
        for name in ("east_m_s", "north_m_s", "gust_m_s", "correlation_s"):
            value = getattr(self, name)
            if not math.isfinite(value) or abs(value) > 200.0:
                msg = f"wind: {name} {value} is outside -200..200"
                raise VehicleError(msg)
        if self.gust_m_s < 0.0 or self.correlation_s <= 0.0:
            msg = (
                f"wind: gust_m_s {self.gust_m_s} and correlation_s {self.correlation_s} must not be negative"
            )
            raise VehicleError(msg)

    @classmethod
    def from_direction(
        cls,
        speed_m_s: float,
        from_deg: float,
        *,
        gust_m_s: float = 0.0,
        correlation_s: float = 5.0,
        seed: np.random.SeedSequence | int = 0,
    ) -> Wind:
        """Return the wind of a weather report: speed, and the compass direction that it comes from."""
        angle = math.radians(from_deg)
        east, north = -speed_m_s * math.sin(angle), -speed_m_s * math.cos(angle)
        return cls(east, north, gust_m_s, correlation_s, seed)

    def series(self) -> WindSeries:
        """Return the wind over time, from its beginning."""
        return WindSeries(self)


class WindSeries:
    """The wind on its time grid, block after block."""

    __slots__ = ("_decay", "_gust", "_noise", "_random", "_steady", "block", "first")

    def __init__(self, wind: Wind) -> None:
        seed = wind.seed
        if isinstance(seed, np.random.SeedSequence):
            # A SeedSequence counts its children: a copy makes every series of one wind the same.
            seed = np.random.SeedSequence(seed.entropy, spawn_key=seed.spawn_key, pool_size=seed.pool_size)
        self._steady = np.array([wind.east_m_s, wind.north_m_s])
        self._decay = math.exp(-GRID_S / wind.correlation_s)
        self._noise = wind.gust_m_s * math.sqrt(1.0 - self._decay**2)
        self._random = np.random.Generator(np.random.PCG64(seed)) if wind.gust_m_s > 0.0 else None
        self._gust = np.zeros(2)
        if self._random is not None:
            self._gust = wind.gust_m_s * self._random.standard_normal(2)
        self.first = 0
        self.block: NDArray[np.float64] = self._draw()

    def forward(self) -> None:
        """Go on to the next block.

        ``block``, float64[BLOCK, 2] (east, north; m/s), begins at grid index ``first``. A steady wind has a
        single block of one row that always holds.
        """
        if self._random is not None:
            self.first += BLOCK
            self.block = self._draw()

    def _draw(self) -> NDArray[np.float64]:
        if self._random is None:
            return self._steady[None, :].copy()
        # Imported here: a still or steady wind needs no compiler.
        from sim_vehicle.motion.kernel import gauss_markov

        gust = gauss_markov(self._noise * self._random.standard_normal((BLOCK, 2)), self._decay, self._gust)
        self._gust = gust[-1].copy()
        return np.asarray(self._steady + gust, dtype=np.float64)
