"""Compiled means over blocks of a farm's cells, which show millions of cells in few pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled


@compiled(nogil=True)
def block_means(
    value: NDArray[np.float32],
    crop: NDArray[np.int8],
    owned: NDArray[np.bool_],
    wanted: NDArray[np.bool_],
    cells: int,
    x0: int,
    y0: int,
    means: NDArray[np.float32],
) -> None:
    """Compute block means of `value`, float32[W, H], over finite, owned cells with a wanted crop.

    Pixel (i, j) of `means`, float32[pixels along x, y], is the mean of block (x0 + i, y0 + j), or NaN if the
    block has no such cell. A block has `cells` cells along a side. The numbers in `crop` index `wanted`.
    """
    width, height = value.shape
    sums, counts = np.zeros(means.shape[1], np.float64), np.zeros(means.shape[1], np.int64)
    for i in range(means.shape[0]):
        sums[:] = 0.0
        counts[:] = 0
        for x in range((x0 + i) * cells, min((x0 + i + 1) * cells, width)):
            for j in range(means.shape[1]):
                for y in range((y0 + j) * cells, min((y0 + j + 1) * cells, height)):
                    if owned[x, y] and wanted[crop[x, y]] and np.isfinite(value[x, y]):
                        sums[j] += value[x, y]
                        counts[j] += 1
        for j in range(means.shape[1]):
            means[i, j] = np.float32(sums[j] / counts[j]) if counts[j] else np.float32(np.nan)
