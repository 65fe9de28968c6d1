"""Train the network of the policy ``learned`` by proximal policy optimization.

PPO: Schulman, Wolski, Dhariwal, Radford & Klimov 2017, "Proximal policy optimization algorithms".
It needs stable-baselines3 and torch, which want a virtual environment of their own::

    python -m venv train && train/bin/pip install '.[train,rl]'
    train/bin/python tools/train_policy.py --minutes 15 --out mission/policies/learned.npz
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from mission.policies.network import NetworkView
from sensors.scoring.score import ScoreWeights
from wbf_mission.rl import SurveyVectorEnv

HIDDEN = (128, 64)
REWARD_SCALE = 100.0
FIRST_SEED = 10**9
"""Far from the seeds of benchmarks, which count from 0."""


class Runs(VecEnv):
    """The vector environment as stable-baselines3 wants it, seen through the policy's view."""

    def __init__(self, scenario: str, number: int, seed: int) -> None:
        self.envs = SurveyVectorEnv(number, scenario, autoreset_mode="SameStep", copy=False)
        task = self.envs.task
        self._view = NetworkView(task.farm, task.fields, ScoreWeights.of(task.fields))
        self._shape = np.array(task.grid.shape)
        self._seed = seed
        self.scores: list[float] = []
        seen = spaces.Box(-np.inf, np.inf, (NetworkView.size,), np.float32)
        super().__init__(number, seen, spaces.Discrete(4))

    def _look(self, shown: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        cells = np.floor(shown["position"] * self._shape).astype(int)
        return self._view(shown["value"], shown["seen"], cells, shown["left"][:, 1])

    def reset(self) -> NDArray[np.float32]:
        """Begin all runs."""
        shown, _ = self.envs.reset(seed=FIRST_SEED + self._seed * 10**6)
        return self._look(shown)

    def step_async(self, actions: NDArray[np.int64]) -> None:
        """Take the moves."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Move."""
        # The first move of the environment is to stay, which the policy never does.
        shown, rewards, ended, _, info = self.envs.step(self._actions + 1)
        if ended.any():
            self.scores += info["final_info"]["score"][ended].tolist()
        return self._look(shown), rewards * REWARD_SCALE, ended, [{} for _ in ended]

    def close(self) -> None:
        """End the runs."""
        self.envs.close()

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:  # noqa: ARG002
        """Say that there are no wrappers."""
        return [False] * self.num_envs

    def env_method(self, method_name: str, *_arguments: Any, **_options: Any) -> list[Any]:
        """Refuse: the runs are no objects of their own."""
        raise NotImplementedError(method_name)

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:  # noqa: ARG002
        """Return an attribute for each run."""
        return [getattr(self, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: the runs are no objects of their own."""
        raise NotImplementedError(attr_name)


class Stop(BaseCallback):
    """Ends after some CPU time, and tells how it goes."""

    def __init__(self, minutes: float, out: Path) -> None:
        super().__init__()
        self._until = time.process_time() + 60.0 * minutes
        self._minutes, self._out = minutes, out

    def _on_step(self) -> bool:
        return time.process_time() < self._until

    def _on_rollout_end(self) -> None:
        left = max(0.0, (self._until - time.process_time()) / 60.0 / self._minutes)
        scores = self.training_env.scores[-128:]
        if scores:
            print(
                f"{self.num_timesteps:9d} steps, {1 - left:4.0%}, mean score {np.mean(scores):.4f}",
                flush=True,
            )
        save(self.model, self._out)


def save(model: PPO, out: Path) -> None:
    """Write the network of the actor; half precision is enough."""
    arrays = {}
    layers = [one for one in model.policy.mlp_extractor.policy_net if isinstance(one, torch.nn.Linear)]
    for number, layer in enumerate([*layers, model.policy.action_net]):
        arrays[f"weight_{number}"] = layer.weight.detach().numpy().astype(np.float16)
        arrays[f"bias_{number}"] = layer.bias.detach().numpy().astype(np.float16)
    partial = out.with_suffix(".partial.npz")
    np.savez_compressed(partial, **arrays)
    partial.rename(out)


def main() -> None:
    """Train and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="WBF/Miniberry-30-v1")
    parser.add_argument("--minutes", type=float, default=15.0, help="CPU minutes")
    parser.add_argument("--envs", type=int, default=64)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    torch.set_num_threads(1)
    runs = Runs(given.scenario, given.envs, given.seed)
    model = PPO(
        "MlpPolicy",
        runs,
        n_steps=96,
        batch_size=1024,
        n_epochs=3,
        gamma=0.99,
        gae_lambda=0.95,
        learning_rate=5e-4,
        ent_coef=0.005,
        policy_kwargs={"net_arch": {"pi": list(HIDDEN), "vf": list(HIDDEN)}, "activation_fn": torch.nn.ReLU},
        seed=given.seed,
        device="cpu",
    )
    model.learn(10**9, callback=Stop(given.minutes, given.out))
    save(model, given.out)


if __name__ == "__main__":
    main()
