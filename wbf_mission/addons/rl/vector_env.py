"""Gymnasium vector environment: many runs in a batch, equal to single environments to the last bit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from sensors.estimators import Estimator
from sensors.estimators.adaptive_disk import AdaptiveDiskEstimator
from wbf_mission.addons.rl.batch import Batch
from wbf_mission.addons.rl.catalogue import TrainingError, why_not_batched, why_not_single
from wbf_mission.addons.rl.env import Observation, run_seed
from wbf_mission.addons.rl.kernels import block_means
from wbf_mission.addons.rl.rendering import ARRAY, FRAMES_A_SECOND, Rendering
from wbf_mission.addons.rl.task import Shown, SurveyTask, checked_moves
from wbf_mission.scenario import Scenario

_Bools = NDArray[np.bool_]


class SurveyVectorEnv(VectorEnv[Observation, NDArray[np.int64], NDArray[Any]]):
    """Batched runs of the environment `wbf_mission.addons.rl.env.SurveyEnv`, with adaptive disks.

    As in all vector environments of Gymnasium, `reset(seed=n)` gives run i the seed n + i, and every entry of
    `info` has a mask.

    Parameters
    ----------
    scenario : Scenario, str or path-like
        Scenario of one of the paper's robots, with one flight and images of one cell.
    estimator : str
        ``adaptive-disk``, the only batched estimator.
    block : int, optional
        See `SurveyEnv`.
    render_mode : {"rgb_array"}, optional
        `render` returns a frame of each run.
    render_field : str, optional
        See `SurveyEnv`.
    autoreset_mode : AutoresetMode or str
        Time at which a finished run restarts: at the next step (``NextStep``), in the same step
        (``SameStep``), or at `reset` with ``options={"reset_mask": ...}`` (``Disabled``).
    copy : bool
        Whether observations are copies; otherwise the next step overwrites them.

    Raises
    ------
    TrainingError
        If the scenario or the estimator cannot be batched. `gymnasium.make_vec` with
        ``vectorization_mode="sync"`` accepts them all.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: Scenario | str | Path = "WBF/Miniberry-30-v1",
        estimator: Estimator | str = "adaptive-disk",
        block: int | None = None,
        *,
        render_mode: str | None = None,
        render_field: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        copy: bool = True,
    ) -> None:
        if num_envs < 1:
            raise TrainingError(f"num_envs {num_envs}: give one or more")
        self.task = SurveyTask(scenario, estimator)
        _require_batch(self.task)
        self.num_envs = num_envs
        self.shown = Shown(self.task, block)
        self.single_observation_space = self.shown.space()
        self.single_action_space = self.shown.action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.render_mode = render_mode
        self._rendering = Rendering(self.task, render_mode, render_field, (ARRAY,))
        self.metadata = {
            "render_modes": [ARRAY],
            "render_fps": FRAMES_A_SECOND,
            "autoreset_mode": self.autoreset_mode,
        }
        self.copy = copy
        self._batch = Batch(self.task, num_envs)
        self._rngs: list[np.random.Generator | None] = [None] * num_envs
        self._ended = np.ones(num_envs, np.bool_)
        self._begun = False
        shape, maps = self.shown.map_shape, 2 * len(self.task.fields) + 1
        self._blocks = np.zeros((num_envs, maps, *shape), np.float32)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Restart all runs, or some of them with ``options={"reset_mask": bool[num_envs]}``.

        A number `seed` is the seed of the first run, and each further run gets the next number; a sequence
        has one seed per run. TrainingError if the number of seeds or mask entries is not the number of runs.
        """
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + one for one in range(self.num_envs)]
        elif isinstance(seed, Iterable):
            seeds = [int(one) if isinstance(one, np.integer) else one for one in seed]
        else:
            raise TrainingError(f"reset: seed {seed!r}: give a whole number, or one for each environment")
        mask = np.ones(self.num_envs, np.bool_)
        if options is not None and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"], np.bool_)
        if len(seeds) != self.num_envs or mask.shape != (self.num_envs,):
            msg = f"reset: {len(seeds)} seeds and a mask of {mask.shape} for {self.num_envs} environments"
            raise TrainingError(msg)
        info: dict[str, Any] = {}
        for run in np.flatnonzero(mask).tolist():
            self._begin(run, seeds[run], info)
        self._begun = True
        return self._observation(), info

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[Observation, NDArray[np.float64], _Bools, _Bools, dict[str, Any]]:
        """Step every run; see `gymnasium.vector.VectorEnv.step`.

        Raises TrainingError, without a move, unless there is a whole number 0 to 4 for each run.
        """
        ended, batch = self._ended.copy(), self._batch
        if not self._begun or (self.autoreset_mode is AutoresetMode.DISABLED and ended.any()):
            raise TrainingError("an episode is over, or was not begun: call reset")
        actions = checked_moves(actions, (self.num_envs,), "actions")
        rewards = batch.move(np.flatnonzero(~ended), actions)
        info: dict[str, Any] = {}
        for run in np.flatnonzero(ended).tolist():
            self._begin(run, None, info)
        over = (batch.counts == self.task.steps) & ~ended
        self._ended = over.copy()
        restarts = self.autoreset_mode is AutoresetMode.SAME_STEP
        last = self._observation() if restarts and over.any() else {}
        for run in np.flatnonzero(over).tolist():
            end = {
                "score": batch.score(run),
                "final_score": float(-batch.last_loss[run]),
                "loss_before": float(batch.loss_before[run]),
            }
            if restarts:
                final = {name: array[run].copy() for name, array in last.items()}
                self._add_info(info, {"final_obs": final, "final_info": end}, run)
                self._begin(run, None, info)
            else:
                self._add_info(info, end, run)
        return self._observation(), rewards, over, np.zeros(self.num_envs, np.bool_), info

    def action_masks(self) -> _Bools:
        """Return each run's mask of valid actions (staying and possible moves), bool[num_envs, 5]."""
        return self.task.possible(self._batch.cells)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a frame of each run, uint8[height, width, 3]; None without a render mode."""
        if not self._begun:
            raise TrainingError("no episode was begun: call reset")
        frames = [self._rendering.frame(self._batch.scene(run)) for run in range(self.num_envs)]
        return None if self.render_mode is None else tuple(frame for frame in frames if frame is not None)

    def _begin(self, run: int, seed: int | None, info: dict[str, Any]) -> None:
        """Restart a run, and add its seed to `info`."""
        rng = self._rngs[run]
        if seed is not None or rng is None:
            rng, _ = seeding.np_random(seed)
            self._rngs[run] = rng
        environment = run_seed(seed, rng)
        self._batch.begin(run, environment)
        self._ended[run] = False
        self._add_info(info, {"environment": environment}, run)

    def _observation(self) -> Observation:
        batch = self._batch
        left = 1.0 - np.maximum(batch.counts - 1, 0) / self.task.moves
        maps, k = batch.maps, len(self.task.fields)
        if self.shown.block > 1:
            shape = self._blocks.shape
            flat = maps.reshape(-1, *maps.shape[2:])
            block_means(flat, self.shown.block, self._blocks.reshape(-1, *shape[2:]))
            maps = self._blocks
        if self.copy:
            maps = maps.copy()
        return {
            "position": self.shown.positions(batch.cells),
            "left": np.repeat(left.astype(np.float32)[:, None], 2, axis=1),
            "value": maps[:, :k],
            "uncertainty": maps[:, k : 2 * k],
            "seen": maps[:, 2 * k],
        }


def warm_up(begin: Callable[[str], None]) -> None:
    """Compile the training environments before their use, by one step."""
    begin("training environments")
    # Step two runs: arrays of a single run are contiguous and would be compiled separately.
    envs = SurveyVectorEnv(2, "WBF/Miniberry-10-v1")
    envs.reset(seed=0)
    envs.step(np.zeros(2, np.int64))
    envs.close()


def _require_batch(task: SurveyTask) -> None:
    scenario = task.scenario
    estimator = task.estimator(0)
    if (
        type(estimator) is not AdaptiveDiskEstimator
        or estimator.default_values is not None
        or estimator.radius is not None
    ):
        raise TrainingError(
            f"estimator {scenario.estimate.estimator} is not batched, only adaptive-disk is: give"
            ' vectorization_mode="sync" to gymnasium.make_vec'
        )
    if several := why_not_single(scenario):
        raise TrainingError(several)
    if unfit := why_not_batched(scenario):
        raise TrainingError(f'{unfit}: give vectorization_mode="sync" to gymnasium.make_vec')
