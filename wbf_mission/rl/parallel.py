"""The PettingZoo environment: several robots with one estimate, which all move at the same time."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from pettingzoo import ParallelEnv

from sensors.estimators import Estimator
from wbf_mission.rl.env import Observation, end_info, run_seed
from wbf_mission.rl.episode import Episode
from wbf_mission.rl.errors import TrainingError
from wbf_mission.rl.observing import Shown
from wbf_mission.rl.task import SurveyTask
from wbf_mission.scenario import Scenario

__all__ = ["SurveyParallelEnv", "parallel_env"]


class SurveyParallelEnv(ParallelEnv):  # type: ignore[misc]  # PettingZoo is not typed
    """Robots survey a farm together; each is rewarded for what all have learned.

    Parameters
    ----------
    scenario, estimator, block
        As of `wbf_mission.rl.env.SurveyEnv`, of one or several of the paper's robots.

    Raises
    ------
    TrainingError, WbfMissionError
        As of `wbf_mission.rl.env.SurveyEnv`.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": [], "name": "wbf_survey_v1"}

    def __init__(
        self,
        scenario: Scenario | str | Path = "WBF/Miniberry-30-Robots-2-v1",
        estimator: Estimator | str = "adaptive-disk",
        block: int | None = None,
    ) -> None:
        self.task = SurveyTask.of(scenario, estimator)
        self.shown = Shown(self.task, block)
        self.possible_agents = [f"robot_{number + 1}" for number in range(self.task.robots)]
        self.agents: list[str] = []
        self.render_mode = None
        self.observation_spaces = {agent: self.shown.space() for agent in self.possible_agents}
        self.action_spaces = {agent: self.shown.action_space() for agent in self.possible_agents}
        self._rng: np.random.Generator | None = None
        self._episode: Episode | None = None

    def observation_space(self, agent: str) -> spaces.Dict:
        """Return the space of what a robot is shown."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Discrete[Any]:
        """Return the space of a robot's moves."""
        return self.action_spaces[agent]

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002 (PettingZoo's signature)
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin a run, as `wbf_mission.rl.env.SurveyEnv.reset`."""
        if seed is not None or self._rng is None:
            self._rng, _ = seeding.np_random(seed)
        self.close()
        episode = self._episode = Episode(self.task, run_seed(seed, self._rng))
        self.agents = list(self.possible_agents)
        return self._observations(episode), {agent: {"environment": episode.seed} for agent in self.agents}

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[
        dict[str, Observation],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Move all robots; one that is given no move stays. All end together."""
        episode, agents = self._episode, self.agents
        if episode is None or not agents:
            msg = "the episode is over, or was not begun: call reset"
            raise TrainingError(msg)
        reward = episode.move([int(actions.get(agent, 0)) for agent in agents])
        info = end_info(episode) if episode.ended else {}
        observations = self._observations(episode)
        if episode.ended:
            self.agents = []
        return (
            observations,
            dict.fromkeys(agents, reward),
            dict.fromkeys(agents, episode.ended),
            dict.fromkeys(agents, False),
            {agent: dict(info) for agent in agents},
        )

    def close(self) -> None:
        """End the run that is open, if any."""
        if self._episode is not None:
            self._episode.close()

    def _observations(self, episode: Episode) -> dict[str, Observation]:
        model, shown = episode.model(), self.shown
        positions = shown.positions(episode.cells)
        value, uncertainty = shown.maps(model.value), shown.maps(model.uncertainty)
        seen = shown.maps(episode.seen[None])[0]
        found: dict[str, Observation] = {}
        for robot, agent in enumerate(self.possible_agents):
            found[agent] = {
                "position": positions[robot],
                "left": np.array(episode.left, np.float32),
                "value": value.copy(),
                "uncertainty": uncertainty.copy(),
                "seen": seen.copy(),
            }
            if len(positions) > 1:
                found[agent]["others"] = np.delete(positions, robot, axis=0)
        return found


def parallel_env(
    scenario: Scenario | str | Path = "WBF/Miniberry-30-Robots-2-v1", **options: Any
) -> SurveyParallelEnv:
    """Return the PettingZoo environment of a scenario, as such modules do; see `SurveyParallelEnv`."""
    return SurveyParallelEnv(scenario, **options)
