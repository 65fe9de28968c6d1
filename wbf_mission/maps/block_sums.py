"""Compiled sums over the cells of each pixel, for farms of millions of cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from wbf_mission.maps.blocks import SICK_BELOW

Floats = NDArray[np.float64]


@compiled(nogil=True)
def sum_pixels(
    mask: NDArray[np.bool_], value: NDArray[np.float32], pixel: int, sums: Floats, least: Floats
) -> None:
    """Add to `sums` the sums of `value`, float32[W, H] in 0..1, over the masked cells of each pixel.

    `sums` is float64[pixels along x, pixels along y, 4]: number of cells, sum of 1 - value, sum of
    value (1 - value), number of cells below `SICK_BELOW`. `least` is lowered to the minimum of each pixel.
    """
    width, height = mask.shape
    for x in range(width):
        i = x // pixel
        for j in range(sums.shape[1]):
            count = illness = spread = sick = 0.0
            low = least[i, j]
            for y in range(j * pixel, min((j + 1) * pixel, height)):
                if mask[x, y]:
                    v = np.float64(value[x, y])
                    count += 1.0
                    illness += 1.0 - v
                    spread += v * (1.0 - v)
                    if v < SICK_BELOW:
                        sick += 1.0
                    low = min(low, v)
            sums[i, j, 0] += count
            sums[i, j, 1] += illness
            sums[i, j, 2] += spread
            sums[i, j, 3] += sick
            least[i, j] = low


@compiled(nogil=True)
def sum_squares(mask: NDArray[np.bool_], deviation: NDArray[np.float32], pixel: int, sums: Floats) -> None:
    """Add to `sums` the squares of `deviation`, float32[W, H], over the masked cells of each pixel."""
    width, height = mask.shape
    for x in range(width):
        for j in range(sums.shape[1]):
            total = 0.0
            for y in range(j * pixel, min((j + 1) * pixel, height)):
                if mask[x, y]:
                    d = np.float64(deviation[x, y])
                    total += d * d
            sums[x // pixel, j] += total
