"""The compiled recursion of a second-order Gauss-Markov process."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled

__all__ = ["recur"]


@compiled
def recur(noise: NDArray[np.float64], first: float, second: float, drive: float) -> NDArray[np.float64]:
    """Return a second-order autoregressive recursion, from rest.

    Parameters
    ----------
    noise : float64[n]
    first, second : float
        What the last value and the one before it are multiplied by.
    drive : float
        What the noise is multiplied by.

    Returns
    -------
    float64[n]
    """
    result = np.empty_like(noise)
    last = before = 0.0
    for k in range(len(noise)):
        last, before = first * last + second * before + drive * noise[k], last
        result[k] = last
    return result
