"""Compiled code of training environments: the step of many runs with adaptive disks, and means of blocks.

The results of a step equal the results of a flight to the last bit. `sensors.estimators.adaptive_disk` paints
each cell by the newest disk that covers it, and `sensors.scoring.score_sums` adds the errors. Here, a step
paints only the new disk unless the radius changes. A tile's sums resume at the first changed column.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sensors.scoring.information import SQUARES, TILE_CELLS, WORSE_SQUARES
from sensors.scoring.score_sums import add_column

SCORES_A_STEP = 2
"""Maximum scored times per step: the first move of a flight brings two images."""


class Rules(NamedTuple):
    """Constants of all runs, with k fields on W x H cells and at most N readings per run."""

    moves: NDArray[np.int64]  # int64[actions, 2]
    allowed: NDArray[np.bool_]  # bool[W, H]
    every: int  # Number of readings between scored times; the last reading is also scored
    radii: NDArray[np.int64]  # int64[N + 1]: disk radius after each number of readings
    # int64[radii, radii]: half-width of a disk's row, by radius and distance from the centre.
    half_widths: NDArray[np.int64]
    sensed: NDArray[np.bool_]  # bool[k]: whether each field is sensed
    diseases: NDArray[np.bool_]  # bool[k]: whether each field is a disease
    rates: NDArray[np.float32]  # float32[2]: rates of false positive and false negative disease readings
    defaults: NDArray[np.float32]  # float32[k]
    masks: NDArray[np.bool_]  # bool[k, W, H]: scored cells


class Runs(NamedTuple):
    """State of B runs."""

    # float32[B, N, diseases], or length 0 if unused: uniform draws for false readings.
    luck: NDArray[np.float32]
    noise: NDArray[np.float32]  # float32[B, N, k], or length 0: noise of the readings
    truth: NDArray[np.float32]  # float32[B, k, W, H]
    cells: NDArray[np.int64]  # int64[B, 2]: cells of the robots
    counts: NDArray[np.int64]  # int64[B]: number of readings
    seen: NDArray[np.int64]  # int64[B, N, 2]: cells of the readings
    readings: NDArray[np.float32]  # float32[B, N, k]
    value: NDArray[np.float32]  # float32[B, k, W, H]
    uncertainty: NDArray[np.float32]  # float32[B, k, W, H]
    visited: NDArray[np.float32]  # float32[B, W, H]: 1 in observed cells
    # int64[B, tiles along x, tiles along y]: the tile's first column with outdated sums.
    dirty: NDArray[np.int64]
    # float64[B, k, tiles along x, tiles along y, TILE_CELLS + 1, 2]: sums of squared errors up to each
    # column, over all cells and over the cells estimated too high.
    partial: NDArray[np.float64]
    # float64[B, SCORES_A_STEP, k, 2]: the same sums over the farm at each scored time.
    sums: NDArray[np.float64]
    scored: NDArray[np.int64]  # int64[B]: number of scored times in this step


@compiled(nogil=True, allocates=False)
def resume_errors(rules: Rules, runs: Runs, run: int, time: int) -> None:
    """Write a run's sums of squared errors to ``sums[run, time]``; each tile resumes at column `dirty`."""
    masks, truth, estimate = rules.masks, runs.truth[run], runs.value[run]
    dirty, partial, sums = runs.dirty[run], runs.partial[run], runs.sums[run, time]
    width, height = masks.shape[1], masks.shape[2]
    tiles_x, tiles_y = dirty.shape
    for tile in range(tiles_x):
        x0 = tile * TILE_CELLS
        columns = min(TILE_CELLS, width - x0)
        for strip in range(tiles_y):
            y0, y1 = strip * TILE_CELLS, min((strip + 1) * TILE_CELLS, height)
            start = dirty[tile, strip]
            if start >= columns:
                continue
            dirty[tile, strip] = TILE_CELLS
            for k in range(len(masks)):
                kept = partial[k, tile, strip]
                added = (kept[start, SQUARES], kept[start, WORSE_SQUARES], 0.0, 0.0)
                for column in range(start, columns):
                    added = add_column(masks[k], truth[k], estimate[k], x0 + column, y0, y1, added)
                    kept[column + 1, SQUARES] = added[SQUARES]
                    kept[column + 1, WORSE_SQUARES] = added[WORSE_SQUARES]
    sums[:] = 0.0
    for k in range(len(masks)):
        for tile in range(tiles_x):
            columns = min(TILE_CELLS, width - tile * TILE_CELLS)
            for strip in range(tiles_y):
                sums[k, SQUARES] += partial[k, tile, strip, columns, SQUARES]
                sums[k, WORSE_SQUARES] += partial[k, tile, strip, columns, WORSE_SQUARES]


@compiled(nogil=True)
def advance(going: NDArray[np.int64], actions: NDArray[np.int64], rules: Rules, runs: Runs) -> None:
    """Step the runs `going`: move the robots, paint their readings, and sum the errors at scored times."""
    width, height = rules.allowed.shape
    most = runs.seen.shape[1]
    for run in going:
        runs.scored[run] = 0
        before_x, before_y = runs.cells[run, 0], runs.cells[run, 1]
        x = before_x + rules.moves[actions[run], 0]
        y = before_y + rules.moves[actions[run], 1]
        if 0 <= x < width and 0 <= y < height and rules.allowed[x, y]:
            runs.cells[run, 0], runs.cells[run, 1] = x, y
        for look in range(2):
            if look == 0:
                if runs.counts[run] > 0:
                    continue
                x, y = before_x, before_y
            else:
                x, y = runs.cells[run, 0], runs.cells[run, 1]
            number = runs.counts[run]
            runs.seen[run, number, 0], runs.seen[run, number, 1] = x, y
            runs.visited[run, x, y] = np.float32(1.0)
            disease = 0
            for k in range(len(rules.sensed)):
                reading = runs.truth[run, k, x, y]
                if rules.diseases[k]:
                    if runs.luck.shape[1] > 0:
                        if reading >= np.float32(1.0):
                            if runs.luck[run, number, disease] < rules.rates[0]:
                                reading = np.float32(0.5)
                        elif runs.luck[run, number, disease] < rules.rates[1]:
                            reading = np.float32(1.0)
                    disease += 1
                if runs.noise.shape[1] > 0:
                    reading = reading + runs.noise[run, number, k]
                runs.readings[run, number, k] = min(max(reading, np.float32(0.0)), np.float32(1.0))
            runs.counts[run] = number + 1
            radius = rules.radii[number + 1]
            first = number
            if radius != rules.radii[number]:
                first = 0
                _clear(rules, runs, run)
            for one in range(first, number + 1):
                _paint(rules, runs, run, one, radius)
            if (number + 1) % rules.every == 0 or number + 1 == most:
                resume_errors(rules, runs, run, runs.scored[run])
                runs.scored[run] += 1


@compiled(nogil=True, allocates=False)
def _clear(rules: Rules, runs: Runs, run: int) -> None:
    """Remove all disks of a run."""
    for k in range(len(rules.sensed)):
        if rules.sensed[k]:
            runs.value[run, k] = rules.defaults[k]
            runs.uncertainty[run, k] = np.float32(1.0)
    runs.dirty[run] = 0


@compiled(nogil=True, allocates=False)
def _paint(rules: Rules, runs: Runs, run: int, number: int, radius: int) -> None:
    """Paint the disk of one reading of a run over older disks."""
    value, uncertainty, dirty = runs.value[run], runs.uncertainty[run], runs.dirty[run]
    x, y = runs.seen[run, number, 0], runs.seen[run, number, 1]
    reading = runs.readings[run, number]
    width, height = value.shape[1], value.shape[2]
    for column in range(max(x - radius, 0), min(x + radius + 1, width)):
        half = rules.half_widths[radius, abs(column - x)]
        low, high = max(y - half, 0), min(y + half + 1, height)
        tile, within = column // TILE_CELLS, column % TILE_CELLS
        for k in range(len(rules.sensed)):
            if not rules.sensed[k]:
                continue
            for row in range(low, high):
                uncertainty[k, column, row] = np.float32(0.0)
                if value[k, column, row] != reading[k]:
                    value[k, column, row] = reading[k]
                    if within < dirty[tile, row // TILE_CELLS]:
                        dirty[tile, row // TILE_CELLS] = within


@compiled(nogil=True, allocates=False)
def block_means(array: NDArray[np.float32], block: int, out: NDArray[np.float32]) -> None:
    """Write the means of square blocks of maps to `out`, limited to 0..1.

    `array` is float32[n, W, H], and `out` float32[n, ceil(W / block), ceil(H / block)]; blocks at the far
    borders are smaller.
    """
    number, width, height = array.shape
    for k in range(number):
        for column in range(out.shape[1]):
            x0, x1 = column * block, min((column + 1) * block, width)
            for row in range(out.shape[2]):
                y0, y1 = row * block, min((row + 1) * block, height)
                total = 0.0
                for x in range(x0, x1):
                    for y in range(y0, y1):
                        total += array[k, x, y]
                mean = total / ((x1 - x0) * (y1 - y0))
                out[k, column, row] = np.float32(min(max(mean, 0.0), 1.0))
