"""The compiled recursion of a second-order Gauss-Markov process."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled

__all__ = ["follow_twice"]


@compiled
def follow_twice(noise: NDArray[np.float64], decay: float, drive: float) -> NDArray[np.float64]:
    """Return two equal first-order recursions one after the other, from rest.

    Parameters
    ----------
    noise : float64[n]
    decay : float
        Of each recursion, over a step.
    drive : float
        What the noise is multiplied by.

    Returns
    -------
    float64[n]
    """
    result = np.empty_like(noise)
    inner = outer = 0.0
    for k in range(len(noise)):
        inner = decay * inner + drive * noise[k]
        outer = decay * outer + inner
        result[k] = outer
    return result
