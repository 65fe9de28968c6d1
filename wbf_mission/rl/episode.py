"""One run of the paper's robots, move by move, with the very parts that a flight has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from geo.seeds import stream
from sensors.camera.leaf_camera import LeafCamera, footprint_offsets
from sensors.estimators import advance_estimator
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import RunningScore, ScoreWeights
from wbf_mission.planning.assignment import SortieNumber
from wbf_mission.progress import silent
from wbf_mission.rl.returns import Returns
from wbf_mission.rl.task import MOVES, SurveyTask
from wbf_mission.run.estimation import RunEstimate, attribute_errors_to, prepare_days

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["Episode"]


class Episode:
    """A run of a task on the environment of a seed.

    As in a flight, an image arrives when the robot has moved on: the one at home with the one after the first
    move, those of one robot after those of the one before it.

    Parameters
    ----------
    seed : int
        As that of a scenario: equal seeds give the same environment and the same errors of the camera.

    Attributes
    ----------
    cells : int64[robots, 2]
        Where the robots are.
    moved : int
        Moves of each robot in this flight.
    seen : float32[W, H]
        1 where something was seen in the run.
    """

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
        score = RunningScore(self._environment.values(of.day), masks, weights, task.fields)
        self._estimate = RunEstimate(self._learner, score, task.every, of.day)
        self.returns = Returns(task.points, score.evaluate(self.model()).loss)
        self._scored = 0
        self.seen = np.zeros(task.grid.shape, np.float32)
        self._flight = 0
        self._begin_flight()

    def model(self) -> InformationModel:
        """Return what is believed now, in the estimator's own arrays."""
        return self._estimate.current()

    def close(self) -> None:
        """Give up the run."""
        self._estimate.close()

    @property
    def day(self) -> int:
        """The day that is flown."""
        return self.task.flights[min(self._flight, len(self.task.flights) - 1)][0]

    @property
    def ended(self) -> bool:
        """Whether the run is over."""
        return self._flight == len(self.task.flights)

    @property
    def left(self) -> tuple[float, float]:
        """Which part of the moves is left, of this flight and of the run."""
        if self.ended:
            return 0.0, 0.0
        a_flight = self.task.steps - 1
        done = self._flight * a_flight + self.moved
        return 1.0 - self.moved / a_flight, 1.0 - done / self.task.moves

    @property
    def score(self) -> float:
        """The score of the run so far; 0 is perfect."""
        score = self._estimate.history.score
        return float("nan") if score is None else score

    @property
    def final_score(self) -> float:
        """The score at the last scored time."""
        scores = self._estimate.history.scores
        return scores[-1] if scores else float("nan")

    def move(self, actions: Sequence[int]) -> float:
        """Move every robot, learn what is seen, and return the reward.

        A robot whose move leads to where it must not fly stays; that costs the step, too. After the last
        move of a flight the robots are at home again, for the next one.
        """
        task, (width, height) = self.task, self.task.grid.shape
        before = self.cells.copy()
        for robot, action in enumerate(actions):
            x, y = (self.cells[robot] + MOVES[action]).tolist()
            if 0 <= x < width and 0 <= y < height and task.allowed[x, y]:
                self.cells[robot] = x, y
        for robot in range(task.robots):
            if self.moved == 0:
                self._look(robot, before[robot])
            self._look(robot, self.cells[robot])
        self.moved += 1
        if self.moved == task.steps - 1:
            self._end_flight()
        # Who waits for the estimate has the scores, too.
        self.model()
        entries = self._estimate.history.entries
        reward = self.returns.add([one.loss for one in entries[self._scored :]])
        self._scored = len(entries)
        return reward + self.returns.rest(self.score) if self.ended else reward

    def _begin_flight(self) -> None:
        task = self.task
        day, flight = task.flights[self._flight]
        self.cells = np.tile(np.array(task.home), (task.robots, 1))
        self.moved = 0
        self._cameras = []
        for robot in range(task.robots):
            number = SortieNumber(day, flight, robot + 1, task.scenario.farm.day)
            rng = stream(self.seed, *number.stream_names("camera"))
            self._cameras.append(LeafCamera(self._environment, task.grid.shape, day, task.camera, rng))

    def _end_flight(self) -> None:
        day = self.day
        self._estimate.end_flight(0.0)
        self._flight += 1
        if self.ended:
            return
        if self.day != day:
            self._estimate.begin_day(self.day, self._environment.values(self.day), 0.0)
        self._begin_flight()

    def _look(self, robot: int, cell: NDArray[np.integer]) -> None:
        """Learn from an image of a robot; cells beyond the farm's border give nothing."""
        x, y = (int(along) for along in cell)
        values = self._cameras[robot].capture([x], [y])[0]
        dx, dy = footprint_offsets(self.task.camera.footprint_cells)
        kept = ~np.isnan(values).all(axis=1)
        count = int(np.count_nonzero(kept))
        self.seen[x + dx[kept], y + dy[kept]] = 1.0
        time_s, day = np.full(count, float(self.moved)), np.full(count, self.day)
        names = self.task.fields.names
        self._estimate.add([Observations(x + dx[kept], y + dy[kept], time_s, day, values[kept], names)])
