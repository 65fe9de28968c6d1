"""Compiled recursion of a second-order Gauss-Markov process."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled

__all__ = ["recur"]


@compiled
def recur(noise: NDArray[np.float64], first: float, second: float, drive: float) -> NDArray[np.float64]:
    """Return y[k] = first y[k-1] + second y[k-2] + drive noise[k], from rest."""
    result = np.empty_like(noise)
    last = before = 0.0
    for k in range(len(noise)):
        last, before = first * last + second * before + drive * noise[k], last
        result[k] = last
    return result
