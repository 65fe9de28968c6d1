"""The compiled step of many runs with adaptive disks.

The same as the parts of a flight to the last bit: `sensors.estimators.disk.adaptive_disk` paints the newest
disk that covers a cell, `sensors.scoring.score_sums` adds the errors. Here only the cells of a new disk are
painted while the radius stays, and the sums of a tile go on from its first column that has changed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sensors.scoring.score_sums import resume_errors
from sensors.scoring.tiles import TILE_CELLS

__all__ = ["SCORES_A_STEP", "advance"]

SCORES_A_STEP = 2
"""The first move of a flight brings two images."""


@compiled(nogil=True)
def advance(
    runs: NDArray[np.int64],
    actions: NDArray[np.int64],
    moves: NDArray[np.int64],
    allowed: NDArray[np.bool_],
    every: int,
    radii: NDArray[np.int64],
    half_widths: NDArray[np.int64],
    sensed: NDArray[np.bool_],
    diseases: NDArray[np.bool_],
    rates: NDArray[np.float32],
    luck: NDArray[np.float32],
    noise: NDArray[np.float32],
    defaults: NDArray[np.float32],
    masks: NDArray[np.bool_],
    truth: NDArray[np.float32],
    cells: NDArray[np.int64],
    counts: NDArray[np.int64],
    seen: NDArray[np.int64],
    readings: NDArray[np.float32],
    value: NDArray[np.float32],
    uncertainty: NDArray[np.float32],
    visited: NDArray[np.float32],
    dirty: NDArray[np.int64],
    partial: NDArray[np.float64],
    sums: NDArray[np.float64],
    scored: NDArray[np.int64],
) -> None:
    """Move in some runs, learn what is seen, and sum the errors where the estimate is scored.

    Parameters
    ----------
    runs : int64[n]
        Which runs go on, of B.
    actions : int64[B]
    moves : int64[actions, 2]
    allowed : bool[W, H]
    every : int
        The estimate is scored after so many readings, and after the last.
    radii : int64[N + 1]
        The radius of the disks by the number of readings.
    half_widths : int64[radii, radii]
        Half the width of a disk's row, by its radius and the row's distance from the middle.
    sensed, diseases : bool[k]
        Of each field whether it is sensed, and whether it is a disease.
    rates : float32[2]
        Of false positive and false negative readings of diseases.
    luck : float32[B, N, diseases], or of length 0 where none is needed
        Uniform draws for these.
    noise : float32[B, N, k], or of length 0
        What is added to readings.
    defaults : float32[k]
    masks : bool[k, W, H]
        The scored cells.
    truth : float32[B, k, W, H]
    cells : int64[B, 2]
        Where the robots are; changed.
    counts : int64[B]
        Readings so far; changed.
    seen : int64[B, N, 2]
        Where; written.
    readings : float32[B, N, k]
        Written.
    value, uncertainty : float32[B, k, W, H]
        Changed.
    visited : float32[B, W, H]
        Set to 1 where something is seen.
    dirty : int64[B, tiles along x, tiles along y]
        The first column of the tile that is not summed; changed.
    partial : float64[B, k, tiles along x, tiles along y, TILE_CELLS + 1, 2]
        Sums of the squared errors before each column, of all cells and of those estimated too high; changed.
    sums : float64[B, SCORES_A_STEP, k, 2]
        Written: the same sums of all cells at each scored time.
    scored : int64[B]
        Written: how many those are.
    """
    width, height = allowed.shape
    most = seen.shape[1]
    for run in runs:
        scored[run] = 0
        before_x, before_y = cells[run, 0], cells[run, 1]
        x = before_x + moves[actions[run], 0]
        y = before_y + moves[actions[run], 1]
        if 0 <= x < width and 0 <= y < height and allowed[x, y]:
            cells[run, 0], cells[run, 1] = x, y
        for look in range(2):
            if look == 0:
                if counts[run] > 0:
                    continue
                x, y = before_x, before_y
            else:
                x, y = cells[run, 0], cells[run, 1]
            number = counts[run]
            seen[run, number, 0], seen[run, number, 1] = x, y
            visited[run, x, y] = np.float32(1.0)
            disease = 0
            for k in range(len(sensed)):
                reading = truth[run, k, x, y]
                if diseases[k]:
                    if luck.shape[1] > 0:
                        if reading >= np.float32(1.0):
                            if luck[run, number, disease] < rates[0]:
                                reading = np.float32(0.5)
                        elif luck[run, number, disease] < rates[1]:
                            reading = np.float32(1.0)
                    disease += 1
                if noise.shape[1] > 0:
                    reading = reading + noise[run, number, k]
                readings[run, number, k] = min(max(reading, np.float32(0.0)), np.float32(1.0))
            counts[run] = number + 1
            radius = radii[number + 1]
            first = number
            if radius != radii[number]:
                first = 0
                _clear(sensed, defaults, value[run], uncertainty[run], dirty[run])
            for one in range(first, number + 1):
                _paint(
                    seen[run, one, 0],
                    seen[run, one, 1],
                    radius,
                    half_widths,
                    sensed,
                    readings[run, one],
                    value[run],
                    uncertainty[run],
                    dirty[run],
                )
            if (number + 1) % every == 0 or number + 1 == most:
                resume_errors(masks, truth[run], value[run], dirty[run], partial[run], sums[run, scored[run]])
                scored[run] += 1


@compiled(nogil=True, allocates=False)
def _clear(
    sensed: NDArray[np.bool_],
    defaults: NDArray[np.float32],
    value: NDArray[np.float32],
    uncertainty: NDArray[np.float32],
    dirty: NDArray[np.int64],
) -> None:
    """Forget all disks."""
    for k in range(len(sensed)):
        if sensed[k]:
            value[k] = defaults[k]
            uncertainty[k] = np.float32(1.0)
    dirty[:] = 0


@compiled(nogil=True, allocates=False)
def _paint(
    x: int,
    y: int,
    radius: int,
    half_widths: NDArray[np.int64],
    sensed: NDArray[np.bool_],
    reading: NDArray[np.float32],
    value: NDArray[np.float32],
    uncertainty: NDArray[np.float32],
    dirty: NDArray[np.int64],
) -> None:
    """Paint one disk over what is there."""
    width, height = value.shape[1], value.shape[2]
    for column in range(max(x - radius, 0), min(x + radius + 1, width)):
        half = half_widths[radius, abs(column - x)]
        low, high = max(y - half, 0), min(y + half + 1, height)
        tile, within = column // TILE_CELLS, column % TILE_CELLS
        for k in range(len(sensed)):
            if not sensed[k]:
                continue
            for row in range(low, high):
                uncertainty[k, column, row] = np.float32(0.0)
                if value[k, column, row] != reading[k]:
                    value[k, column, row] = reading[k]
                    if within < dirty[tile, row // TILE_CELLS]:
                        dirty[tile, row // TILE_CELLS] = within
