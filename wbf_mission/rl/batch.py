"""Many runs of one task at a time, in arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.seeds import stream
from sensors.estimators.disk.disks import adaptive_radius, half_widths
from sensors.scoring.score import ScoreWeights
from sensors.scoring.score_sums import resume_errors
from sensors.scoring.tiles import TILE_CELLS, tile_shape
from wbf_mission.planning.assignment import SortieNumber
from wbf_mission.rl.batch_kernel import SCORES_A_STEP, advance
from wbf_mission.rl.episode import rewards_of
from wbf_mission.rl.task import MOVES, SurveyTask

__all__ = ["Batch"]


class Batch:
    """Runs of one robot, one flight and one day with adaptive disks; each is what an `Episode` is.

    Parameters
    ----------
    size : int
        How many.

    Attributes
    ----------
    cells : int64[size, 2]
        Where the robots are.
    counts : int64[size]
        Readings so far.
    maps : float32[size, 2 k + 1, W, H]
        What is believed of the k fields, its uncertainty, and 1 where something was seen.
    loss_before, last_loss : float64[size]
        Of the estimate before anything was seen, and at the last scored time.
    """

    def __init__(self, task: SurveyTask, size: int) -> None:
        self.task = task
        fields, shape, camera = task.fields, task.grid.shape, task.camera
        k, steps = len(fields), task.steps
        self._radii = np.zeros(steps + 1, np.int64)
        self._radii[1:] = [adaptive_radius(number, shape) for number in range(1, steps + 1)]
        longest = int(self._radii.max()) + 1
        self._half = np.zeros((longest, longest), np.int64)
        for radius in range(longest):
            self._half[radius, : radius + 1] = half_widths(radius, np.arange(radius + 1))
        names = fields.names
        self._sensed = np.array([name in (camera.sensed or names) for name in names])
        self._diseases = np.array([field.kind == "disease" for field in fields])
        self._rates = np.array([camera.false_positive_rate, camera.false_negative_rate], np.float32)
        self._noise_std = np.array(camera.noise_std, np.float32)
        flips, noisy = bool(self._rates.any()), bool(self._noise_std.any())
        self._luck = np.zeros((size, steps if flips else 0, len(fields.diseases)), np.float32)
        self._noise = np.zeros((size, steps if noisy else 0, k), np.float32)
        self._defaults = np.array(fields.defaults, np.float32)
        self._masks = fields.masks(task.grid)
        self._field_cells = self._masks.sum(axis=(1, 2))
        weights = ScoreWeights.of(fields)
        self._low, self._high = np.array(weights.too_sick), np.array(weights.too_healthy)
        self._weight = np.array(weights.field) * self._field_cells
        self._truth = np.zeros((size, k, *shape), np.float32)
        self._seen = np.zeros((size, steps, 2), np.int64)
        self._readings = np.zeros((size, steps, k), np.float32)
        self._dirty = np.zeros((size, *tile_shape(shape)), np.int64)
        self._partial = np.zeros((size, k, *tile_shape(shape), TILE_CELLS + 1, 2))
        self._sums = np.zeros((size, SCORES_A_STEP, k, 2))
        self._scored = np.zeros(size, np.int64)
        self._times = np.zeros(size, np.int64)
        self.cells = np.zeros((size, 2), np.int64)
        self.counts = np.zeros(size, np.int64)
        self.maps = np.zeros((size, 2 * k + 1, *shape), np.float32)
        self._value, self._uncertainty = self.maps[:, :k], self.maps[:, k : 2 * k]
        self._visited = self.maps[:, 2 * k]
        self.loss_before = np.zeros(size)
        self.last_loss = np.zeros(size)
        self.losses = np.zeros((size, task.points))

    def begin(self, run: int, seed: int) -> None:
        """Begin a run anew, on the environment of a seed."""
        task = self.task
        day = task.scenario.farm.day
        self._truth[run] = task.environment(seed).values(day)
        if self._luck.size or self._noise.size:
            # As `sensors.camera.leaf_camera.LeafCamera` draws, image by image.
            names = SortieNumber.first(day, 1).stream_names("camera")
            noise_rng, flip_rng = stream(seed, *names).spawn(2)
            if self._luck.size:
                self._luck[run] = flip_rng.random(self._luck.shape[1:], dtype=np.float32)
            if self._noise.size:
                drawn = noise_rng.standard_normal(self._noise.shape[1:], dtype=np.float32)
                self._noise[run] = drawn * self._noise_std
        self.cells[run] = task.home
        self.counts[run] = self._times[run] = 0
        self._value[run] = self._defaults[:, None, None]
        self._uncertainty[run] = 1.0
        self._visited[run] = 0.0
        self._dirty[run] = 0
        resume_errors(
            self._masks,
            self._truth[run],
            self._value[run],
            self._dirty[run],
            self._partial[run],
            self._sums[run, 0],
        )
        self.loss_before[run] = self.last_loss[run] = self._losses(np.array([run]), 0)[0]

    def move(self, runs: NDArray[np.int64], actions: NDArray[np.int64]) -> NDArray[np.float64]:
        """Move in some runs, and return the rewards of all, 0 in the others: float64[size]."""
        advance(
            runs,
            actions,
            MOVES,
            self.task.allowed,
            self.task.every,
            self._radii,
            self._half,
            self._sensed,
            self._diseases,
            self._rates,
            self._luck,
            self._noise,
            self._defaults,
            self._masks,
            self._truth,
            self.cells,
            self.counts,
            self._seen,
            self._readings,
            self._value,
            self._uncertainty,
            self._visited,
            self._dirty,
            self._partial,
            self._sums,
            self._scored,
        )
        rewards = np.zeros(len(self.counts))
        for number in range(SCORES_A_STEP):
            scored = runs[self._scored[runs] > number]
            if len(scored):
                losses = self._losses(scored, number)
                self.losses[scored, self._times[scored]] = losses
                self._times[scored] += 1
                rewards[scored] += rewards_of(
                    self._times[scored], self.task.points, self.last_loss[scored], losses
                )
                self.last_loss[scored] = losses
        return rewards

    def score(self, run: int) -> float:
        """Return the score of a run so far."""
        return float(np.mean((-self.losses[run, : self._times[run]]).tolist()))

    def _losses(self, runs: NDArray[np.int64], number: int) -> NDArray[np.float64]:
        """Return the loss of runs at one of the scored times of this step, as `RunningScore` has it."""
        means = self._sums[runs, number] / np.maximum(self._field_cells, 1)[:, None]
        squares, worse_squares = means[..., 0], means[..., 1]
        by_field = self._low * (squares - worse_squares) + self._high * worse_squares
        total = self._weight.sum()
        # One after the other: a product of matrices may add in another order.
        return np.array([float(np.dot(self._weight, one) / total) for one in by_field])
