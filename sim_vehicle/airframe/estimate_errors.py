"""Errors of PX4's state estimate: jumps and drift of the height, errors of the velocity.

In all recorded flights of PX4 (v1.17, SIH) the estimated height jumps up and down by a little more than 1 m
during the first two minutes after arming. Later the height only drifts. The estimated velocity has an error
throughout the flight: the accelerometers and gyroscopes of SIH are noisy, and the estimator follows the
receiver slowly, like a Kalman filter of positions (damping 0.7). The vehicle holds a wrong velocity until the
position controller corrects the resulting position error. A part of the velocity error, the push, also
accelerates the vehicle: tilt errors move the vehicle and not the estimate, and corrections move the estimate
and not the vehicle.

The numbers are measured on eight flights of quadrotors, a rover and an aeroplane. The velocity error is the
difference between the estimated velocity and the rate of change of the estimated position; it is measured on
the six flights of quadrotors. The push is measured on the two of them that recorded attitudes:

============================  ===================================================================
jumps of the height           90 % to the other side; size 1.0 m (tenth percentile 1.05 m,
                              median 1.24 m, ninetieth 1.76 m); the last after 117 to 121 s
time between jumps            median 0.2 to 0.4 s, mean 0.8 to 1.1 s, ninetieth percentile 2.2 s
drift of the height           deviation 0.29 m; correlation 0.96 over 1 s, 0.63 over 5 s, 0.3 over 10 s
horizontal velocity           deviation per axis 0.214 m/s (0.14 to 0.28 in parts of flights), normally
                              distributed; correlation 0.70 over 2 s, 0.51 over 3 s, 0.2 over 5 s, 0 over
                              8 s; equal along and across the nose, at any speed, turn and acceleration
push                          acceleration of the estimate that neither thrust nor drag explains: -0.5 (and
                              -0.53) 1/s times the error, and 0.62 to 0.78 of the change of the error
vertical velocity             deviation 0.11 m/s; correlation 0.77 over 1 s, 0.57 over 3 s, 0.38 over 5 s
============================  ===================================================================
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from geo.seeds import stream

__all__ = ["COLUMNS", "GRID_S", "HEIGHT_M", "SETTLED_S", "EstimateErrors", "carried_aside_m"]

GRID_S = 0.1
COLUMNS = 6
"""Number of errors: height (m), velocity east, north, up (m/s), push east, north (m/s^2)."""
SETTLED_S = 119.0
"""Time after the first take-off during which the estimated height jumps (s)."""
LEAST_LEVEL_M = 0.5
"""Minimum of the absolute height error between two jumps."""
LEVEL_SCALE_M = 0.15
"""Mean of the exponentially distributed excess of the absolute height error over `LEAST_LEVEL_M`."""
MEDIAN_DWELL_S, DWELL_SIGMA = 0.35, 1.44
"""Median (s) and log-standard deviation of the time between jumps, which is log-normally distributed."""
DRIFT_M, DRIFT_S = 0.29, 3.8
"""Standard deviation and time constant of the height drift, a second-order Gauss-Markov process."""
HEIGHT_M = math.sqrt((LEAST_LEVEL_M + LEVEL_SCALE_M) ** 2 + LEVEL_SCALE_M**2 + DRIFT_M**2)
"""Standard deviation of the height error in the phase of jumps, 0.73 m."""
VELOCITY_M_S, VELOCITY_S, VELOCITY_DAMPING = 0.214, 2.25, 0.73
"""Standard deviation, time constant and damping of the horizontal velocity error, per axis."""
PUSH_1_S, UNSEEN = 0.5, 0.3
"""Gains of the push: on the velocity error (1/s), and on the rate of change of the velocity error."""
CLIMB_M_S, CLIMB_S = 0.1, 2.3
"""Standard deviation and time constant of the vertical velocity error beyond the height drift's rate."""


def carried_aside_m(gain_1_s: float) -> float:
    """Return the lateral drift caused by the velocity error: standard deviation per horizontal axis (m).

    The vehicle holds a velocity with the error e until the position controller corrects the position x:
    dx/dt = e - P x, with the controller's gain P and the second-order process e of `EstimateErrors`. In the
    steady state all derivatives of covariances are 0 (Lyapunov's equation), which gives the variance of x.
    The formula neglects the push and turns. In 240 flights of random paths, the distance from home at the
    start of the return varied by 0.23 m (one standard deviation).

    Examples
    --------
    >>> round(carried_aside_m(0.95), 2), carried_aside_m(0.0)
    (0.21, inf)
    """
    if not gain_1_s > 0.0:
        return math.inf
    damping, stiffness = 2.0 * VELOCITY_DAMPING / VELOCITY_S, VELOCITY_S**-2
    lag = gain_1_s + damping
    return VELOCITY_M_S * math.sqrt(lag / (gain_1_s * (gain_1_s * lag + stiffness)))


@dataclass(frozen=True, slots=True)
class EstimateErrors:
    """Errors of one vehicle's state estimate.

    Examples
    --------
    >>> errors = EstimateErrors(1)
    >>> bool((errors.first(50) == errors.first(3000)[:50]).all())
    True
    """

    seed: np.random.SeedSequence | int = 0

    def first(self, count: int) -> NDArray[np.float64]:
        """Return the first `count` errors (estimate minus truth), one every `GRID_S` from the first take-off.

        All error processes start at 0.

        Returns
        -------
        float64[count, COLUMNS]
        """
        errors = np.empty((count, COLUMNS))
        errors[:, 0] = self._drift("height-drift", count, DRIFT_M, DRIFT_S, 1.0)
        jumps = self._jumps()[:count]
        errors[: len(jumps), 0] += jumps
        errors[:, 1] = self._drift("velocity-east", count, VELOCITY_M_S, VELOCITY_S, VELOCITY_DAMPING)
        errors[:, 2] = self._drift("velocity-north", count, VELOCITY_M_S, VELOCITY_S, VELOCITY_DAMPING)
        errors[:, 3] = self._drift("velocity-up", count, CLIMB_M_S, CLIMB_S, 1.0)
        change = np.diff(errors[:, 1:3], axis=0, prepend=0.0) / GRID_S
        errors[:, 4:6] = -PUSH_1_S * errors[:, 1:3] - UNSEEN * change
        return errors

    def _drift(
        self, name: str, count: int, deviation: float, time_s: float, damping: float
    ) -> NDArray[np.float64]:
        # `first` and `second` follow from the poles of the sampled process; `variance` is the variance of the
        # process with drive 1.
        decay = math.exp(-damping * GRID_S / time_s)
        first = 2.0 * decay * math.cos(math.sqrt(1.0 - damping * damping) * GRID_S / time_s)
        second = -decay * decay
        variance = (1.0 - second) / ((1.0 + second) * ((1.0 - second) ** 2 - first * first))
        noise = stream(self.seed, name).standard_normal(count)
        return _compiled_recursion()(noise, first, second, deviation / math.sqrt(variance))

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


def recur(noise: NDArray[np.float64], first: float, second: float, drive: float) -> NDArray[np.float64]:
    """Return y[k] = first y[k-1] + second y[k-2] + drive noise[k], from rest."""
    result = np.empty_like(noise)
    last = before = 0.0
    for k in range(len(noise)):
        last, before = first * last + second * before + drive * noise[k], last
        result[k] = last
    return result


@cache
def _compiled_recursion() -> Callable[..., NDArray[np.float64]]:
    """Return `recur`, compiled at the first use, because flights without errors need no compiler."""
    return compiled(recur)
