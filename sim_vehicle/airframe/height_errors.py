"""Errors of the height that PX4 estimates: jumps while it settles, and a slow drift.

In all recorded flights of PX4 (v1.17, SIH) the estimated height jumps by
1 m and a little more, to and fro, in the first two minutes after arming; the velocity and the horizontal
position do not. Later it only drifts. Measured on eight flights of quadrotors, a rover and an aeroplane:

============================  ===================================================================
jumps                         to the other side: 0.9 of them; size 1.0 m (tenth percentile 1.05 m,
                              median 1.24 m, ninetieth 1.76 m); the last after 117 to 121 s
time between jumps            median 0.2 to 0.4 s, mean 0.8 to 1.1 s, ninetieth percentile 2.2 s
drift                         deviation 0.29 m; correlation 0.96 over 1 s, 0.63 over 5 s, 0.3 over 10 s
============================  ===================================================================
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geo.seeds import stream

__all__ = ["GRID_S", "SETTLED_S", "HeightErrors"]

GRID_S = 0.1
SETTLED_S = 119.0
"""How long after the first take-off the estimate jumps."""
LEAST_LEVEL_M = 0.5
"""Least distance of both sides of a jump from their middle."""
LEVEL_SCALE_M = 0.15
"""Mean of what is added to that, exponentially distributed."""
MEDIAN_DWELL_S, DWELL_SIGMA = 0.35, 1.44
"""Time between jumps, log-normally distributed."""
DRIFT_M, DRIFT_S = 0.29, 3.8
"""Standard deviation and time constant of the drift, a second-order Gauss-Markov process that begins at 0."""


@dataclass(frozen=True, slots=True)
class HeightErrors:
    """The errors of one vehicle's estimated height.

    Parameters
    ----------
    seed : numpy.random.SeedSequence or int

    Examples
    --------
    >>> errors = HeightErrors(1)
    >>> bool((errors.first(50) == errors.first(3000)[:50]).all())
    True
    """

    seed: np.random.SeedSequence | int = 0

    def first(self, count: int) -> NDArray[np.float64]:
        """Return the first errors (estimate less truth, m) from the first take-off on, every `GRID_S`.

        Parameters
        ----------
        count : int

        Returns
        -------
        float64[count]
        """
        from scipy.signal import lfilter

        decay = math.exp(-GRID_S / DRIFT_S)
        noise = stream(self.seed, "height-drift").standard_normal(count)
        # The stationary variance of two equal filters one after the other.
        variance = (1.0 + decay * decay) / (1.0 - decay * decay) ** 3
        drive = DRIFT_M / math.sqrt(variance)
        errors: NDArray[np.float64] = lfilter([drive], [1.0, -2.0 * decay, decay * decay], noise)
        jumps = self._jumps()[:count]
        errors[: len(jumps)] += jumps
        return errors

    def _jumps(self) -> NDArray[np.float64]:
        random = stream(self.seed, "height-jumps")
        jumps = np.zeros(round(SETTLED_S / GRID_S))
        side, time_s = 1.0 if random.random() < 0.5 else -1.0, 0.0
        while True:
            time_s += max(GRID_S, MEDIAN_DWELL_S * math.exp(DWELL_SIGMA * random.standard_normal()))
            first = round(time_s / GRID_S)
            if first >= len(jumps):
                return jumps
            side = -side
            jumps[first:] = side * (LEAST_LEVEL_M + LEVEL_SCALE_M * random.standard_exponential())
