"""PettingZoo environment of robots that move at the same time."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from geo.texts import one_line
from sensors.estimators import Estimator
from wbf_mission.addons.rl.env import Observation, OneEpisode, end_info, observations_of
from wbf_mission.addons.rl.episode import Episode
from wbf_mission.addons.rl.errors import TrainingError
from wbf_mission.addons.rl.observing import Shown
from wbf_mission.addons.rl.rendering import ARRAY, FRAMES_A_SECOND, HUMAN, Rendering
from wbf_mission.addons.rl.task import SurveyTask, checked_moves
from wbf_mission.scenario import Scenario


class SurveyParallelEnv(OneEpisode, ParallelEnv):  # type: ignore[misc]  # PettingZoo is not typed
    """Robots that survey a farm together, with a common reward.

    For parameters and errors, see `wbf_mission.addons.rl.env.SurveyEnv`; there may be several robots.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "wbf_survey_v1",
        "render_modes": [HUMAN, ARRAY],
        "render_fps": FRAMES_A_SECOND,
    }

    def __init__(
        self,
        scenario: Scenario | str | Path = "WBF/Miniberry-30-Robots-2-v1",
        estimator: Estimator | str = "adaptive-disk",
        block: int | None = None,
        render_mode: str | None = None,
        render_field: str | None = None,
    ) -> None:
        self.task = SurveyTask(scenario, estimator)
        self.render_mode = render_mode
        self._rendering = Rendering(self.task, render_mode, render_field)
        self.shown = Shown(self.task, block)
        self.possible_agents = [f"robot_{number + 1}" for number in range(self.task.robots)]
        self.agents: list[str] = []
        self.observation_spaces = {agent: self.shown.space() for agent in self.possible_agents}
        self.action_spaces = {agent: self.shown.action_space() for agent in self.possible_agents}
        self._rng: np.random.Generator | None = None

    def observation_space(self, agent: str) -> spaces.Dict:
        """Return the observation space of a robot."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Discrete[Any]:
        """Return the action space of a robot."""
        return self.action_spaces[agent]

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002 (PettingZoo's signature)
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Start a run, as `wbf_mission.addons.rl.env.SurveyEnv.reset` does."""
        if seed is not None or self._rng is None:
            self._rng, _ = seeding.np_random(seed)
        episode = self._begin(seed, self._rng)
        self.agents = list(self.possible_agents)
        if self.render_mode == HUMAN:
            self.render()
        return self._by_agent(episode), {agent: {"environment": episode.seed} for agent in self.agents}

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[
        dict[str, Observation],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Move all robots; a robot without an action stays. All robots end together.

        Raises TrainingError, without moving a robot, if a robot is unknown, an action is not a whole number 0
        to 4, or no episode is running.
        """
        episode, agents = self._episode, self.agents
        if episode is None or not agents:
            raise TrainingError("the episode is over, or was not begun: call reset")
        unknown = sorted(map(str, set(actions) - set(agents)))
        if unknown:
            raise TrainingError(f"actions: there is no {one_line(unknown[0])}; there are {', '.join(agents)}")
        moves = [int(checked_moves(actions.get(agent, 0), (), f"action of {agent}")) for agent in agents]
        reward = episode.move(moves)
        if self.render_mode == HUMAN:
            self.render()
        info = end_info(episode) if episode.ended else {}
        observations = self._by_agent(episode)
        if episode.ended:
            self.agents = []
        return (
            observations,
            dict.fromkeys(agents, reward),
            dict.fromkeys(agents, episode.ended),
            dict.fromkeys(agents, False),
            {agent: dict(info) for agent in agents},
        )

    def action_masks(self) -> dict[str, NDArray[np.bool_]]:
        """Return each robot's mask of valid actions (staying and possible moves), bool[5]."""
        return dict(zip(self.possible_agents, self.task.possible(self._begun().cells), strict=True))

    def close(self) -> None:
        """End the current run and close the window."""
        super().close()
        self.agents = []

    def _by_agent(self, episode: Episode) -> dict[str, Observation]:
        return dict(zip(self.possible_agents, observations_of(self.shown, episode), strict=True))


def parallel_env(
    scenario: Scenario | str | Path = "WBF/Miniberry-30-Robots-2-v1", **options: Any
) -> SurveyParallelEnv:
    """Return the PettingZoo environment of a scenario; see `SurveyParallelEnv`."""
    return SurveyParallelEnv(scenario, **options)
