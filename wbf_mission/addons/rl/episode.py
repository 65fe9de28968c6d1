"""A run of the paper's robots, stepped by the code that real flights use, and its rewards.

Let L_0 be the loss of the estimate before any observation, and L_1, ... L_c the losses at the c scored times.
The reward at the k-th scored time is::

    r_k = (c - k + 1) / c * (L_{k-1} - L_k)

This is the improvement of the estimate, times the fraction of scored times that benefit from it. The sum of
all rewards is ``L_0 - mean(L_1 ... L_c)``: the score of the run (`sensors.scoring.score`) plus the constant
L_0, which no action changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.seeds import stream
from sensors.camera.leaf_camera import LeafCamera, footprint_offsets
from sensors.estimation import RunEstimate, attribute_errors_to, prepare_days
from sensors.estimators import advance_estimator
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import RunningScore, ScoreWeights
from wbf_mission.addons.rl.rendering import Scene
from wbf_mission.addons.rl.task import MOVES, SurveyTask
from wbf_mission.planning.assignment import SortieNumber
from wbf_mission.progress import silent


class Episode:
    """A run of a task on the environment of a seed.

    As in a flight, an image arrives after the robot has moved on: the image at home arrives together with the
    image after the first move. The images of a robot come after the images of the previous robot. Equal seeds
    give the same environment and the same camera errors. `seen`, float32[W, H], is 1 in observed cells.
    """

    cells: NDArray[np.int64]
    """Cells of the robots, int64[robots, 2]."""
    moved: int
    """Number of moves of each robot in this flight."""
    path: list[NDArray[np.int64]]
    """Cells of the robots before the first move and after each move."""

    def __init__(self, task: SurveyTask, seed: int) -> None:
        self.task, self.seed = task, seed
        self._environment = task.environment(seed)
        self._learner = task.estimator(seed)
        of = task.scenario.farm
        prepare_days(self._learner, of.day, of.days, silent)
        with attribute_errors_to(self._learner):
            advance_estimator(self._learner, of.day)
        masks = task.fields.masks(task.grid)
        weights = ScoreWeights.of(task.fields)
        self.truth = self._environment.values(of.day)
        score = RunningScore(self.truth, masks, weights, task.fields)
        self._estimate = RunEstimate(self._learner, score, task.every, of.day)
        # Loss of the estimate before any observation, and at the last scored time.
        self.loss_before = self._last_loss = score.evaluate(self.model()).loss
        self._scored, self._rewards = 0, 0.0  # Number of scored times, and the sum of their rewards
        self.seen = np.zeros(task.grid.shape, np.float32)
        self._flight = 0
        self._actions: list[list[int]] = []
        self._begin_flight()

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy by replaying the actions: the state of an estimator's thread cannot be copied."""
        return _again, (self.task, self.seed, self._actions)

    def model(self) -> InformationModel:
        """Return the current estimate, without copying the estimator's arrays."""
        return self._estimate.current()

    def close(self) -> None:
        """Abandon the run, and stop its estimate."""
        self._estimate.close()

    @property
    def flight(self) -> tuple[int, int]:
        """Day of the current flight, and its number on this day; after the run, those of the last flight."""
        return self.task.flights[min(self._flight, len(self.task.flights) - 1)]

    @property
    def day(self) -> int:
        """Day of the current flight."""
        return self.flight[0]

    @property
    def ended(self) -> bool:
        """Whether the run is over."""
        return self._flight == len(self.task.flights)

    @property
    def left(self) -> tuple[float, float]:
        """Remaining fractions of the moves of this flight and of the run."""
        if self.ended:
            return 0.0, 0.0
        a_flight = self.task.steps - 1
        done = self._flight * a_flight + self.moved
        return 1.0 - self.moved / a_flight, 1.0 - done / self.task.moves

    @property
    def score(self) -> float:
        """Score of the run up to now; 0 is perfect."""
        score = self._estimate.history.score
        return float("nan") if score is None else score

    @property
    def final_score(self) -> float:
        """Score at the last scored time."""
        scores = self._estimate.history.scores
        return scores[-1] if scores else float("nan")

    def move(self, actions: Sequence[int]) -> float:
        """Move every robot, learn from the images, and return the reward.

        A robot whose move leads to a forbidden cell stays, and the step still counts. After the last move of
        a flight, the robots restart at home for the next flight.
        """
        self._actions.append(list(actions))
        task, before = self.task, self.cells
        moves = self._actions[-1]
        possible = task.possible(before)[np.arange(task.robots), moves]
        self.cells = before + MOVES[moves] * possible[:, None]
        for robot in range(task.robots):
            if self.moved == 0:
                self._look(robot, before[robot])
            self._look(robot, self.cells[robot])
        self.moved += 1
        self.path.append(self.cells.copy())
        if self.moved == task.steps - 1:
            self._end_flight()
        # Waiting for the estimate also waits for its scores.
        self.model()
        reward = 0.0
        for entry in self._estimate.history.entries[self._scored :]:
            self._scored += 1
            reward += float(rewards_of(self._scored, task.points, self._last_loss, entry.loss))
            self._last_loss = entry.loss
        self._rewards += reward
        if self.ended and self._scored != task.points:  # Some images were outside the farm.
            reward += self.loss_before + self.score - self._rewards
        return reward

    def scene(self) -> Scene:
        """Return the contents of the run's frame."""
        model, path = self.model(), np.array(self.path)
        return Scene(
            truth=self.truth,
            value=model.value,
            uncertainty=model.uncertainty,
            paths=list(np.swapaxes(path, 0, 1)),
            flight=self.flight,
            left=self.left,
            score=self.score,
        )

    def _begin_flight(self) -> None:
        task = self.task
        day, flight = task.flights[self._flight]
        self.cells = np.tile(np.array(task.home), (task.robots, 1))
        self.moved = 0
        self.path = [self.cells.copy()]
        self._cameras = []
        for robot in range(task.robots):
            number = SortieNumber(day, flight, robot + 1, task.scenario.farm.day)
            rng = stream(self.seed, *number.stream_names("camera"))
            self._cameras.append(
                LeafCamera(self._environment, task.grid.shape, day, task.cameras[robot], rng)
            )

    def _end_flight(self) -> None:
        day = self.day
        self._estimate.end_flight(0.0)
        self._flight += 1
        if self.ended:
            return
        if self.day != day:
            self.truth = self._environment.values(self.day)
            self._estimate.begin_day(self.day, self.truth, 0.0)
        self._begin_flight()

    def _look(self, robot: int, cell: NDArray[np.integer]) -> None:
        """Learn from an image of a robot; cells outside the farm give no readings."""
        x, y = (int(along) for along in cell)
        values = self._cameras[robot].capture([x], [y])[0]
        dx, dy = footprint_offsets(self.task.camera.footprint_cells)
        kept = ~np.isnan(values).all(axis=1)
        count = int(np.count_nonzero(kept))
        self.seen[x + dx[kept], y + dy[kept]] = 1.0
        time_s, day = np.full(count, float(self.moved)), np.full(count, self.day)
        names = self.task.fields.names
        self._estimate.add([Observations(x + dx[kept], y + dy[kept], time_s, day, values[kept], names)])


def _again(task: SurveyTask, seed: int, actions: list[list[int]]) -> Episode:
    episode = Episode(task, seed)
    for action in actions:
        episode.move(action)
    return episode


def rewards_of(number: Any, points: int, before: Any, after: Any) -> Any:
    """Return the reward at scored times, arrays or scalars; `number` counts from 1 to `points`.

    `before` and `after` are the losses at the previous scored time and at this one.

    >>> rewards_of(np.array([1, 2]), 2, np.array([3.0, 2.0]), np.array([2.0, 0.0])).tolist()
    [1.0, 1.0]
    """
    return np.maximum(points - number + 1, 0) / points * (before - after)
