"""Environments for one robot (Gymnasium) and for several that move at the same time (PettingZoo)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from pettingzoo import ParallelEnv

from sensors.estimators import Estimator
from wbf_mission.rl.episode import Episode
from wbf_mission.rl.errors import TrainingError
from wbf_mission.rl.observing import Shown
from wbf_mission.rl.task import SurveyTask
from wbf_mission.scenario import Scenario

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
        if self.task.robots > 1:
            raise TrainingError(
                f"{self.task.robots} robots fly; Gymnasium's environments have one:"
                " take wbf_mission.rl.parallel_env"
            )
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
        return _observations(self.shown, episode)[0], {"environment": episode.seed}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move; the episode is terminated when the budget of the last flight is spent."""
        episode = self._episode
        if episode is None or episode.ended:
            raise TrainingError("the episode is over, or was not begun: call reset")
        reward = episode.move([int(action)])
        info: dict[str, Any] = end_info(episode) if episode.ended else {}
        return _observations(self.shown, episode)[0], reward, episode.ended, False, info

    def close(self) -> None:
        """End the run that is open, if any."""
        if self._episode is not None:
            self._episode.close()


def run_seed(seed: int | None, rng: np.random.Generator) -> int:
    """Return the seed of a run: the one that is given, or one that is drawn and no benchmark has."""
    return int(rng.integers(_FIRST_DRAWN, _LAST_DRAWN)) if seed is None else seed


def end_info(episode: Episode) -> dict[str, Any]:
    """Return what is told when a run is over."""
    return {
        "score": episode.score,
        "final_score": episode.final_score,
        "loss_before": episode.returns.loss_before,
    }


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
        """Move all robots; one that is given no move stays. All end together."""
        episode, agents = self._episode, self.agents
        if episode is None or not agents:
            raise TrainingError("the episode is over, or was not begun: call reset")
        reward = episode.move([int(actions.get(agent, 0)) for agent in agents])
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

    def close(self) -> None:
        """End the run that is open, if any."""
        if self._episode is not None:
            self._episode.close()

    def _by_agent(self, episode: Episode) -> dict[str, Observation]:
        return dict(zip(self.possible_agents, _observations(self.shown, episode), strict=True))


def _observations(shown: Shown, episode: Episode) -> list[Observation]:
    """Return what each robot is shown."""
    model = episode.model()
    positions = shown.positions(episode.cells)
    maps = {
        "value": shown.maps(model.value),
        "uncertainty": shown.maps(model.uncertainty),
        "seen": shown.maps(episode.seen[None])[0],
    }
    found: list[Observation] = []
    for robot, position in enumerate(positions):
        own = {name: array.copy() for name, array in maps.items()}
        found.append({"position": position, "left": np.array(episode.left, np.float32), **own})
        if len(positions) > 1:
            found[robot]["others"] = np.delete(positions, robot, axis=0)
    return found


def parallel_env(
    scenario: Scenario | str | Path = "WBF/Miniberry-30-Robots-2-v1", **options: Any
) -> SurveyParallelEnv:
    """Return the PettingZoo environment of a scenario, as such modules do; see `SurveyParallelEnv`."""
    return SurveyParallelEnv(scenario, **options)
