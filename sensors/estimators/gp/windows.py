"""The compiled part of the windowed Gaussian process: a further observation, within its window."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled

Floats = NDArray[np.float64]


@compiled(nogil=True)
def take_observations(
    rows: Floats,
    centres: NDArray[np.int32],
    used: int,
    x: NDArray[np.int32],
    y: NDArray[np.int32],
    values: Floats,
    noise: Floats,
    along_x: Floats,
    along_y: Floats,
    response: Floats,
    variance: Floats,
) -> bool:
    """Take observations one after the other; return whether their covariance was positive.

    Parameters
    ----------
    rows : float64[n, 2 rx + 1, 2 ry + 1]
        Of each observation so far its row of V (`sensors.estimators.gp.posterior_exact`) in a window around
        it, with room for the new ones. Changed.
    centres : int32[n, 2]
        Their cells. Changed.
    used : int
        How many there are so far.
    x, y, values, noise
        The new ones, and the variances of their noise.
    along_x, along_y : float64[rx + 1], float64[ry + 1]
        The kernel's factors at distances of 0, 1, ... cells; the amplitude is in the first.
    response, variance : float64[2, W, H], float64[W, H]
        The posterior. Changed.
    """
    reach_x, reach_y = len(along_x) - 1, len(along_y) - 1
    side_x, side_y = 2 * reach_x + 1, 2 * reach_y + 1
    width, height = variance.shape
    for k in range(len(x)):
        at_x, at_y = x[k], y[k]
        row = rows[used]
        for i in range(side_x):
            for j in range(side_y):
                row[i, j] = along_x[abs(i - reach_x)] * along_y[abs(j - reach_y)]
        for n in range(used):
            dx, dy = at_x - centres[n, 0], at_y - centres[n, 1]
            if abs(dx) > reach_x or abs(dy) > reach_y:
                continue
            other = rows[n]
            part = other[reach_x + dx, reach_y + dy]
            low, high = max(0, -dy), min(side_y, side_y - dy)
            for i in range(max(0, -dx), min(side_x, side_x - dx)):
                mine, theirs = row[i, low:high], other[i + dx, low + dy : high + dy]
                for j in range(len(mine)):
                    mine[j] -= part * theirs[j]
        pivot = row[reach_x, reach_y] + noise[k]
        if not pivot > 0.0:
            return False
        scale = 1.0 / math.sqrt(pivot)
        by_value = scale * (values[k] - response[0, at_x, at_y])
        by_constant = scale * (1.0 - response[1, at_x, at_y])
        first_x, first_y = at_x - reach_x, at_y - reach_y
        for i in range(side_x):
            for j in range(side_y):
                row[i, j] *= scale
                cell_x, cell_y = first_x + i, first_y + j
                if 0 <= cell_x < width and 0 <= cell_y < height:
                    response[0, cell_x, cell_y] += by_value * row[i, j]
                    response[1, cell_x, cell_y] += by_constant * row[i, j]
                    variance[cell_x, cell_y] -= row[i, j] ** 2
        centres[used, 0], centres[used, 1] = at_x, at_y
        used += 1
    return True
