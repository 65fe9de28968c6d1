"""The Gymnasium environment: one robot, one run an episode."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from sensors.estimators import Estimator
from wbf_mission.rl.episode import Episode
from wbf_mission.rl.errors import TrainingError
from wbf_mission.rl.observing import Shown
from wbf_mission.rl.task import SurveyTask
from wbf_mission.scenario import Scenario

__all__ = ["SurveyEnv", "drawn_seed", "end_info", "run_seed"]

Observation = dict[str, Any]
_FIRST_DRAWN, _LAST_DRAWN = 2**32, 2**63


class SurveyEnv(gymnasium.Env[Observation, Any]):
    """A robot surveys a farm; an episode is a run of the scenario, over all of its days.

    Actions, observations, rewards and their formulas are on the page docs/training.md.

    Parameters
    ----------
    scenario : Scenario, str or path-like
        Of one of the paper's robots; an id such as ``WBF/Miniberry-30-v1``, or a file.
    estimator : Estimator or str
        Who makes the map.
    block : int, optional
        Cells along a side of a block of the maps that are shown; by default 1, and on farms of more than 64
        cells along a side as many as make 64 blocks.

    Raises
    ------
    TrainingError
        If the scenario is none of one of the paper's robots.
    WbfMissionError
        If the scenario or the estimator is unknown.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 (Gymnasium's own)

    def __init__(
        self,
        scenario: Scenario | str | Path = "WBF/Miniberry-30-v1",
        estimator: Estimator | str = "adaptive-disk",
        block: int | None = None,
    ) -> None:
        self.task = SurveyTask.of(scenario, estimator)
        require_robots(self.task, most=1)
        self.shown = Shown(self.task, block)
        self.observation_space = self.shown.space()
        self.action_space = self.shown.action_space()
        self._episode: Episode | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a run.

        Parameters
        ----------
        seed : int, optional
            The environment is that of ``bench run`` with this seed. Without, one is drawn, from 2^32 on: none
            that a benchmark has.
        options : dict, optional
            Not used.
        """
        super().reset(seed=seed, options=options)
        self.close()
        episode = self._episode = Episode(self.task, run_seed(seed, self.np_random))
        return self._observation(episode), {"environment": episode.seed}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move; the episode is terminated when the budget of the last flight is spent."""
        episode = self._episode
        if episode is None or episode.ended:
            msg = "the episode is over, or was not begun: call reset"
            raise TrainingError(msg)
        reward = episode.move([int(action)])
        info: dict[str, Any] = end_info(episode) if episode.ended else {}
        return self._observation(episode), reward, episode.ended, False, info

    def close(self) -> None:
        """End the run that is open, if any."""
        if self._episode is not None:
            self._episode.close()

    def _observation(self, episode: Episode) -> Observation:
        model, shown = episode.model(), self.shown
        return {
            "position": shown.positions(episode.cells[0]),
            "left": np.array(episode.left, np.float32),
            "value": shown.maps(model.value),
            "uncertainty": shown.maps(model.uncertainty),
            "seen": shown.maps(episode.seen[None])[0],
        }


def require_robots(task: SurveyTask, *, most: int) -> None:
    """Raise TrainingError if a task has more robots than one environment has agents."""
    if task.robots > most:
        msg = (
            f"{task.scenario.vehicle.vehicles} robots fly; Gymnasium's environments have one:"
            " take wbf_mission.rl.parallel_env"
        )
        raise TrainingError(msg)


def run_seed(seed: int | None, rng: np.random.Generator) -> int:
    """Return the seed of a run: the one that is given, or one that is drawn and no benchmark has."""
    return drawn_seed(rng) if seed is None else seed


def drawn_seed(rng: np.random.Generator) -> int:
    """Draw the seed of a run."""
    return int(rng.integers(_FIRST_DRAWN, _LAST_DRAWN))


def end_info(episode: Episode) -> dict[str, Any]:
    """Return what is told when a run is over."""
    return {
        "score": episode.score,
        "final_score": episode.final_score,
        "loss_before": episode.returns.loss_before,
    }
