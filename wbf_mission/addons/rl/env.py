"""Environments of Gymnasium (one robot) and PettingZoo (robots that move at the same time)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from geo.texts import one_line
from sensors.estimators import Estimator
from wbf_mission.addons.rl.catalogue import TrainingError, why_not_single
from wbf_mission.addons.rl.episode import Episode
from wbf_mission.addons.rl.rendering import ARRAY, FRAMES_A_SECOND, HUMAN, Rendering
from wbf_mission.addons.rl.task import Shown, SurveyTask, checked_moves
from wbf_mission.scenario import Scenario

Observation = dict[str, Any]
_FIRST_DRAWN, _LAST_DRAWN = 2**32, 2**63
_RENDERS = {"render_modes": [HUMAN, ARRAY], "render_fps": FRAMES_A_SECOND}


class OneEpisode:
    """An environment's current episode and its frames: base of the Gymnasium and PettingZoo environments."""

    _episode: Episode | None = None

    def __init__(
        self, task: SurveyTask, block: int | None, render_mode: str | None, render_field: str | None
    ) -> None:
        self.task = task
        self.render_mode = render_mode
        self._rendering = Rendering(task, render_mode, render_field)
        self.shown = Shown(task, block)

    def render(self) -> NDArray[np.uint8] | None:
        """Return a frame, uint8[height, width, 3]; None without a render mode, or with a window."""
        return self._rendering.frame(self._begun().scene())

    def close(self) -> None:
        """End the current run and close the window."""
        self._end()
        self._rendering.close()

    def _begin(self, seed: int | None, rng: np.random.Generator) -> Episode:
        self._end()
        self._episode = Episode(self.task, run_seed(seed, rng))
        return self._episode

    def _begun(self) -> Episode:
        if self._episode is None:
            raise TrainingError("no episode was begun: call reset")
        return self._episode

    def _end(self) -> None:
        if self._episode is not None:
            self._episode.close()
            self._episode = None


class SurveyEnv(OneEpisode, gymnasium.Env[Observation, Any]):
    """A robot that surveys a farm; an episode is a run of the scenario, over all of its days.

    docs/training.md describes actions, observations and rewards.

    Parameters
    ----------
    scenario : Scenario, str or path-like
        Scenario of one of the paper's robots: an object, an id such as ``WBF/Miniberry-30-v1``, or a file.
    estimator : Estimator or str
        Estimator of the maps.
    block : int, optional
        Side of a map block, cells. By default, the smallest side that gives at most 64 blocks along each side
        of the farm.
    render_mode : {"rgb_array", "human"}, optional
        ``rgb_array``: `render` returns a frame. ``human``: a window is updated at every step.
    render_field : str, optional
        Field to draw; by default the field with the largest weight in the score.

    Raises
    ------
    TrainingError
        If the scenario is not for one of the paper's robots, or an option is invalid.
    WbfMissionError
        If the scenario or the estimator is unknown.
    """

    metadata: dict[str, Any] = _RENDERS

    def __init__(
        self,
        scenario: Scenario | str | Path = "WBF/Miniberry-30-v1",
        estimator: Estimator | str = "adaptive-disk",
        block: int | None = None,
        render_mode: str | None = None,
        render_field: str | None = None,
    ) -> None:
        task = SurveyTask(scenario, estimator)
        if several := why_not_single(task.scenario):
            raise TrainingError(several)
        super().__init__(task, block, render_mode, render_field)
        self.observation_space = self.shown.space()
        self.action_space = self.shown.action_space()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start a run; `options` are ignored.

        The environment is the same as in ``bench run`` with this seed. By default a seed from 2^32 on is
        drawn, which no benchmark uses.
        """
        super().reset(seed=seed, options=options)
        episode = self._begin(seed, self.np_random)
        if self.render_mode == HUMAN:
            self.render()
        return observations_of(self.shown, episode)[0], {"environment": episode.seed}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move the robot; the episode terminates when the budget of the last flight is used up.

        Raises TrainingError if the action is not a whole number 0 to 4, or no episode is running.
        """
        episode = self._episode
        if episode is None or episode.ended:
            raise TrainingError("the episode is over, or was not begun: call reset")
        reward = episode.move([int(checked_moves(action, (), "action"))])
        if self.render_mode == HUMAN:
            self.render()
        info: dict[str, Any] = end_info(episode) if episode.ended else {}
        return observations_of(self.shown, episode)[0], reward, episode.ended, False, info

    def action_masks(self) -> NDArray[np.bool_]:
        """Return the mask of valid actions (staying and possible moves), bool[5], for MaskablePPO."""
        return self.task.possible(self._begun().cells)[0]


def run_seed(seed: int | None, rng: np.random.Generator) -> int:
    """Return the given seed, or draw one that no benchmark uses."""
    return int(rng.integers(_FIRST_DRAWN, _LAST_DRAWN)) if seed is None else seed


def end_info(episode: Episode) -> dict[str, Any]:
    """Return the `info` of a finished run."""
    return {
        "score": episode.score,
        "final_score": episode.final_score,
        "loss_before": episode.loss_before,
    }


def observations_of(shown: Shown, episode: Episode) -> list[Observation]:
    """Return the observation of each robot."""
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


class SurveyParallelEnv(OneEpisode, ParallelEnv):  # type: ignore[misc]  # PettingZoo is not typed
    """Robots that survey a farm together, with a common reward.

    For parameters and errors, see `SurveyEnv`; there may be several robots.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "wbf_survey_v1", **_RENDERS}

    def __init__(
        self,
        scenario: Scenario | str | Path = "WBF/Miniberry-30-Robots-2-v1",
        estimator: Estimator | str = "adaptive-disk",
        block: int | None = None,
        render_mode: str | None = None,
        render_field: str | None = None,
    ) -> None:
        super().__init__(SurveyTask(scenario, estimator), block, render_mode, render_field)
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
        """Start a run, as `SurveyEnv.reset` does."""
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
            known = f"the agents are {', '.join(agents)}"
            raise TrainingError(f"actions: there is no agent {one_line(unknown[0])}; {known}")
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
