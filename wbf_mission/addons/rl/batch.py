"""Many runs of one task, stepped together in arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.linear_algebra import product
from geo.seeds import stream
from sensors.estimators.disks import adaptive_radius, half_widths
from sensors.scoring.information import TILE_CELLS, tile_shape
from sensors.scoring.score import ScoreWeights
from wbf_mission.addons.rl.episode import rewards_of
from wbf_mission.addons.rl.kernels import SCORES_A_STEP, Rules, Runs, advance, resume_errors
from wbf_mission.addons.rl.rendering import Scene
from wbf_mission.addons.rl.task import MOVES, SurveyTask
from wbf_mission.planning.assignment import SortieNumber


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
        # Copying gives these arrays memory of their own: make them views of the copy's `maps` again.
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
        return product(by_field, self._weight) / self._weight.sum()
