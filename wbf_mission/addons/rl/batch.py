"""Many runs of one task with adaptive disks, stepped together in arrays by a compiled kernel.

The results equal the results of a flight to the last bit. `sensors.estimators.adaptive_disk` paints each cell
by the newest disk that covers it, and `sensors.scoring.score_sums` adds the errors. Here, while the radius is
unchanged, only the new disk is painted. A tile's sums resume at the first changed column.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled
from geo.linear_algebra import product
from geo.seeds import stream
from sensors.estimators.disks import adaptive_radius, half_widths
from sensors.scoring.information import SQUARES, TILE_CELLS, WORSE_SQUARES, tile_shape
from sensors.scoring.score import ScoreWeights
from sensors.scoring.score_sums import add_column
from wbf_mission.addons.rl.episode import rewards_of
from wbf_mission.addons.rl.rendering import Scene
from wbf_mission.addons.rl.task import MOVES, SurveyTask
from wbf_mission.planning.assignment import SortieNumber

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


class Batch:
    """Runs of one robot on one flight, estimated by adaptive disks; the results equal those of `Episode`.

    Attributes
    ----------
    cells : int64[size, 2]
        Cells of the robots.
    counts : int64[size]
        Number of readings.
    maps : float32[size, 2 k + 1, W, H]
        The estimate of the k fields, its uncertainty, and 1 in observed cells.
    loss_before, last_loss : float64[size]
        Loss of the estimate before any observation, and at the last scored time.
    """

    def __init__(self, task: SurveyTask, size: int) -> None:
        self.task = task
        fields, shape, camera = task.fields, task.grid.shape, task.camera
        k, steps = len(fields), task.steps
        radii = np.zeros(steps + 1, np.int64)
        radii[1:] = [adaptive_radius(number, shape) for number in range(1, steps + 1)]
        longest = int(radii.max()) + 1
        half = np.zeros((longest, longest), np.int64)
        for radius in range(longest):
            half[radius, : radius + 1] = half_widths(radius, np.arange(radius + 1))
        names, masks = fields.names, fields.masks(task.grid)
        rates = np.array([camera.false_positive_rate, camera.false_negative_rate], np.float32)
        self._noise_std = np.array(camera.noise_std, np.float32)
        flips, noisy = bool(rates.any()), bool(self._noise_std.any())
        self._field_cells = masks.sum(axis=(1, 2))
        weights = ScoreWeights.of(fields)
        self._low, self._high = np.array(weights.too_sick), np.array(weights.too_healthy)
        self._weight = np.array(weights.field) * self._field_cells
        self.maps = np.zeros((size, 2 * k + 1, *shape), np.float32)
        self._rules = Rules(
            moves=MOVES,
            allowed=task.allowed,
            every=task.every,
            radii=radii,
            half_widths=half,
            sensed=np.array([name in (camera.sensed or names) for name in names]),
            diseases=np.array([field.kind == "disease" for field in fields]),
            rates=rates,
            defaults=np.array(fields.defaults, np.float32),
            masks=masks,
        )
        self._runs = Runs(
            luck=np.zeros((size, steps if flips else 0, len(fields.diseases)), np.float32),
            noise=np.zeros((size, steps if noisy else 0, k), np.float32),
            truth=np.zeros((size, k, *shape), np.float32),
            cells=np.zeros((size, 2), np.int64),
            counts=np.zeros(size, np.int64),
            seen=np.zeros((size, steps, 2), np.int64),
            readings=np.zeros((size, steps, k), np.float32),
            value=self.maps[:, :k],
            uncertainty=self.maps[:, k : 2 * k],
            visited=self.maps[:, 2 * k],
            dirty=np.zeros((size, *tile_shape(shape)), np.int64),
            partial=np.zeros((size, k, *tile_shape(shape), TILE_CELLS + 1, 2)),
            sums=np.zeros((size, SCORES_A_STEP, k, 2)),
            scored=np.zeros(size, np.int64),
        )
        self.cells, self.counts = self._runs.cells, self._runs.counts
        self._times = np.zeros(size, np.int64)
        self.loss_before = np.zeros(size)
        self.last_loss = np.zeros(size)
        self.losses = np.zeros((size, task.points))

    def begin(self, run: int, seed: int) -> None:
        """Restart a run on the environment of `seed`."""
        task, rules, of = self.task, self._rules, self._runs
        day = task.scenario.farm.day
        of.truth[run] = task.environment(seed).values(day)
        if of.luck.size or of.noise.size:
            # `sensors.camera.leaf_camera.LeafCamera` makes the same random draws, image by image.
            names = SortieNumber.first(day, 1).stream_names("camera")
            noise_rng, flip_rng = stream(seed, *names).spawn(2)
            if of.luck.size:
                of.luck[run] = flip_rng.random(of.luck.shape[1:], dtype=np.float32)
            if of.noise.size:
                drawn = noise_rng.standard_normal(of.noise.shape[1:], dtype=np.float32)
                of.noise[run] = drawn * self._noise_std
        of.cells[run] = task.home
        of.counts[run] = self._times[run] = 0
        of.value[run] = rules.defaults[:, None, None]
        of.uncertainty[run] = 1.0
        of.visited[run] = 0.0
        of.dirty[run] = 0
        resume_errors(rules, of, run, 0)
        self.loss_before[run] = self.last_loss[run] = self._losses(np.array([run]), 0)[0]

    def move(self, runs: NDArray[np.int64], actions: NDArray[np.int64]) -> NDArray[np.float64]:
        """Step the given runs; return the rewards of all runs, float64[size], with 0 for runs not stepped."""
        advance(runs, actions, self._rules, self._runs)
        rewards = np.zeros(len(self.counts))
        for number in range(SCORES_A_STEP):
            scored = runs[self._runs.scored[runs] > number]
            if len(scored):
                losses = self._losses(scored, number)
                self.losses[scored, self._times[scored]] = losses
                self._times[scored] += 1
                rewards[scored] += rewards_of(
                    self._times[scored], self.task.points, self.last_loss[scored], losses
                )
                self.last_loss[scored] = losses
        return rewards

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        # In a copy, these arrays are not yet views of the copy's `maps`.
        k = len(self.task.fields)
        self._runs = self._runs._replace(
            value=self.maps[:, :k], uncertainty=self.maps[:, k : 2 * k], visited=self.maps[:, 2 * k]
        )

    def scene(self, run: int) -> Scene:
        """Return the contents of a run's frame."""
        of, count = self._runs, int(self.counts[run])
        left = 1.0 - max(count - 1, 0) / self.task.moves
        return Scene(
            truth=of.truth[run],
            value=of.value[run],
            uncertainty=of.uncertainty[run],
            paths=[of.seen[run, :count] if count else of.cells[run : run + 1]],
            flight=self.task.flights[0],
            left=(left, left),
            score=self.score(run) if self._times[run] else float("nan"),
        )

    def score(self, run: int) -> float:
        """Return the score of a run up to its last scored time."""
        return float(np.mean((-self.losses[run, : self._times[run]]).tolist()))

    def _losses(self, runs: NDArray[np.int64], number: int) -> NDArray[np.float64]:
        """Return the loss of runs at scored time `number` of this step, as `RunningScore` computes it."""
        means = self._runs.sums[runs, number] / np.maximum(self._field_cells, 1)[:, None]
        squares, worse_squares = means[..., 0], means[..., 1]
        by_field = self._low * (squares - worse_squares) + self._high * worse_squares
        losses: NDArray[np.float64] = product(by_field, self._weight) / self._weight.sum()
        return losses
