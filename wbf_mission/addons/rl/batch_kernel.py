"""The compiled step of many runs with adaptive disks.

The same as the parts of a flight to the last bit: `sensors.estimators.adaptive_disk` paints the newest
disk that covers a cell, `sensors.scoring.score_sums` adds the errors. Here only the cells of a new disk are
painted while the radius stays, and the sums of a tile go on from its first column that has changed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from sensors.scoring.information import TILE_CELLS
from sensors.scoring.score_sums import resume_errors

SCORES_A_STEP = 2
"""The first move of a flight brings two images."""


class Rules(NamedTuple):
    """What holds for all runs, of k fields on W x H cells and at most N readings a run."""

    moves: NDArray[np.int64]  # int64[actions, 2]
    allowed: NDArray[np.bool_]  # bool[W, H]
    every: int  # The estimate is scored after so many readings, and after the last
    radii: NDArray[np.int64]  # int64[N + 1]: the radius of the disks by the number of readings
    # int64[radii, radii]: half the width of a disk's row, by radius and its distance from the middle.
    half_widths: NDArray[np.int64]
    sensed: NDArray[np.bool_]  # bool[k]: whether each field is sensed
    diseases: NDArray[np.bool_]  # bool[k]: whether it is a disease
    rates: NDArray[np.float32]  # float32[2]: of false positive and false negative readings of diseases
    defaults: NDArray[np.float32]  # float32[k]
    masks: NDArray[np.bool_]  # bool[k, W, H]: the scored cells


class Runs(NamedTuple):
    """The state of B runs."""

    # float32[B, N, diseases], or of length 0 where none is needed: uniform draws for false readings.
    luck: NDArray[np.float32]
    noise: NDArray[np.float32]  # float32[B, N, k], or of length 0: what is added to readings
    truth: NDArray[np.float32]  # float32[B, k, W, H]
    cells: NDArray[np.int64]  # int64[B, 2]: where the robots are
    counts: NDArray[np.int64]  # int64[B]: readings so far
    seen: NDArray[np.int64]  # int64[B, N, 2]: the cells of the readings
    readings: NDArray[np.float32]  # float32[B, N, k]
    value: NDArray[np.float32]  # float32[B, k, W, H]
    uncertainty: NDArray[np.float32]  # float32[B, k, W, H]
    visited: NDArray[np.float32]  # float32[B, W, H]: 1 where something was seen
    # int64[B, tiles along x, tiles along y]: the first column of the tile that is not summed.
    dirty: NDArray[np.int64]
    # float64[B, k, tiles along x, tiles along y, TILE_CELLS + 1, 2]: sums of the squared errors before each
    # column, of all cells and of those estimated too high.
    partial: NDArray[np.float64]
    # float64[B, SCORES_A_STEP, k, 2]: the same sums of all cells at each scored time.
    sums: NDArray[np.float64]
    scored: NDArray[np.int64]  # int64[B]: how many those are


@compiled(nogil=True)
def advance(going: NDArray[np.int64], actions: NDArray[np.int64], rules: Rules, runs: Runs) -> None:
    """Move in the runs that go on, learn what is seen, and sum the errors where the estimate is scored."""
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
                resume_errors(
                    rules.masks,
                    runs.truth[run],
                    runs.value[run],
                    runs.dirty[run],
                    runs.partial[run],
                    runs.sums[run, runs.scored[run]],
                )
                runs.scored[run] += 1


@compiled(nogil=True, allocates=False)
def _clear(rules: Rules, runs: Runs, run: int) -> None:
    """Forget all disks of a run."""
    for k in range(len(rules.sensed)):
        if rules.sensed[k]:
            runs.value[run, k] = rules.defaults[k]
            runs.uncertainty[run, k] = np.float32(1.0)
    runs.dirty[run] = 0


@compiled(nogil=True, allocates=False)
def _paint(rules: Rules, runs: Runs, run: int, number: int, radius: int) -> None:
    """Paint the disk of one reading of a run over what is there."""
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
