"""Sums of a farm's cells by pixels, so that reports and pictures of millions of cells take no time."""

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
    """Sum values in 0..1, float32[W, H], of the cells of a mask over the pixels of a farm.

    To float64[pixels along x, y, 4] are added: number of cells, sum of 1 - value, sum of value (1 - value),
    cells below `SICK_BELOW`; `least` is lowered to the least value of each pixel.
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
    """Add squares of float32[W, H] over the cells of a mask to float64[pixels along x, pixels along y]."""
    width, height = mask.shape
    for x in range(width):
        for j in range(sums.shape[1]):
            total = 0.0
            for y in range(j * pixel, min((j + 1) * pixel, height)):
                if mask[x, y]:
                    d = np.float64(deviation[x, y])
                    total += d * d
            sums[x // pixel, j] += total
