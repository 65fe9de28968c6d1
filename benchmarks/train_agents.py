"""Train DQN and PPO of stable-baselines3 in the training environments, and fly them beside planners.

Agents are trained on environments that no benchmark has (seeds from 2^32 on), on one core, and fly as
policies (``trained_agent.py``) on the benchmark's seeds. It needs a virtual environment of its own, since
torch is large::

    python -m venv train
    train/bin/pip install '.[rl]' torch==2.13.0 stable-baselines3==2.9.2
    train/bin/python benchmarks/train_agents.py train --folder agents [--seed 0]
    train/bin/python benchmarks/train_agents.py fly --folder agents [--seeds 20] [--estimators gp]

``fly`` needs neither torch nor stable-baselines3. Equal seeds train equal agents on equal machines.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from peers import show

from wbf_mission.bench.benchmark import benchmark
from wbf_mission.bench.spec import BenchSpec
from wbf_mission.own_code import own_choice
from wbf_mission.scenario import Choice
from wbf_mission.scenario.choice import choose

HERE = Path(__file__).resolve().parent
OURS = ("lawnmower", "adaptive-lawnmower", "spiral", "random-waypoint", "greedy")
HIDDEN = (64, 64)
RUNS = 64
FIRST_SEED = 2**32
_PPO = {
    "n_steps": 32,
    "batch_size": 512,
    "n_epochs": 3,
    "gamma": 0.99,
    "gae_lambda": 0.95,
    "learning_rate": 5e-4,
    "ent_coef": 0.005,
}
_DQN = {
    "buffer_size": 100_000,
    "learning_starts": 20_000,
    "batch_size": 256,
    "train_freq": 1,
    "gradient_steps": 2,
    "gamma": 0.98,
    "learning_rate": 3e-4,
    "target_update_interval": 10_000,
    "exploration_fraction": 0.3,
    "exploration_final_eps": 0.05,
}
OPTIONS: dict[str, dict[str, Any]] = {"DQN": _DQN, "PPO": _PPO}


@dataclass(frozen=True, slots=True)
class Training:
    """One agent that is trained: by what, where, for how many steps of all runs together."""

    agent: str
    scenario: str
    steps: int
    reward_scale: float

    @property
    def file(self) -> str:
        """The file of its network."""
        return f"{self.agent}_{self.scenario.split('/')[1]}.npz"


TRAININGS = (
    Training("PPO", "WBF/Miniberry-10-v1", 400_000, 10.0),
    Training("DQN", "WBF/Miniberry-10-v1", 200_000, 10.0),
    Training("PPO", "WBF/Miniberry-30-v1", 1_600_000, 50.0),
    Training("DQN", "WBF/Miniberry-30-v1", 300_000, 50.0),
)


def vector_env(one: Training, seed: int) -> Any:
    """Return the runs as stable-baselines3 wants them, seen through the agent's view, without stays."""
    from stable_baselines3.common.vec_env import VecEnv
    from trained_agent import MOVES, View

    from wbf_mission.addons.rl import SurveyVectorEnv

    class Runs(VecEnv):
        def __init__(self) -> None:
            same_step = AutoresetMode.SAME_STEP
            self.envs = SurveyVectorEnv(RUNS, one.scenario, autoreset_mode=same_step, copy=False)
            task = self.envs.task
            self._view = View(task.farm, task.fields, task.allowed)
            self._shape = np.array(task.grid.shape)
            self.scores: list[float] = []
            told = spaces.Box(-np.inf, np.inf, (View.size,), np.float32)
            super().__init__(RUNS, told, spaces.Discrete(len(MOVES)))

        def _told(self, shown: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
            cells = np.floor(shown["position"] * self._shape).astype(np.int64)
            maps = shown["value"], shown["uncertainty"], shown["seen"]
            return self._view(*maps, cells, shown["left"][:, 1])

        def reset(self) -> NDArray[np.float32]:
            shown, _ = self.envs.reset(seed=FIRST_SEED + seed * 10**6)
            return self._told(shown)

        def step_async(self, actions: NDArray[np.int64]) -> None:
            self._actions = actions

        def step_wait(self) -> Any:
            shown, rewards, ended, _, info = self.envs.step(self._actions + 1)
            if ended.any():
                self.scores += info["final_info"]["score"][ended].tolist()
            return self._told(shown), rewards * one.reward_scale, ended, [{} for _ in ended]

        def close(self) -> None:
            self.envs.close()

        def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:  # noqa: ARG002
            return [False] * RUNS

        def env_method(self, method_name: str, *_: Any, **__: Any) -> list[Any]:
            raise NotImplementedError(method_name)

        def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:  # noqa: ARG002
            return [None] * RUNS

        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
            raise NotImplementedError(attr_name)

    return Runs()


def train(one: Training, folder: Path, seed: int) -> None:
    """Train an agent; write its network, and beside it what that took."""
    import stable_baselines3
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    runs = vector_env(one, seed)
    algorithm = {"DQN": stable_baselines3.DQN, "PPO": stable_baselines3.PPO}[one.agent]
    network = {"net_arch": list(HIDDEN), "activation_fn": torch.nn.ReLU}
    options = OPTIONS[one.agent]
    model = algorithm("MlpPolicy", runs, policy_kwargs=network, seed=seed, device="cpu", **options)
    cpu, wall = time.process_time(), time.perf_counter()
    model.learn(one.steps)
    cost = {
        "steps": model.num_timesteps,
        "runs": len(runs.scores),
        "cpu_s": round(time.process_time() - cpu, 1),
        "wall_s": round(time.perf_counter() - wall, 1),
        "score_of_last_runs": float(np.mean(runs.scores[-256:])),
        "seed": seed,
        "machine": f"{processor()}, one core, torch {torch.__version__}",
    }
    policy = model.policy
    stack = (
        policy.q_net.q_net if one.agent == "DQN" else [*policy.mlp_extractor.policy_net, policy.action_net]
    )
    layers = [layer for layer in stack if isinstance(layer, torch.nn.Linear)]
    arrays = {}
    for number, layer in enumerate(layers):
        arrays[f"weight_{number}"] = layer.weight.detach().numpy()
        arrays[f"bias_{number}"] = layer.bias.detach().numpy()
    np.savez(folder / one.file, **arrays)
    text = json.dumps(asdict(one) | {"options": options, "cost": cost}, indent=1)
    (folder / one.file).with_suffix(".json").write_text(text + "\n", encoding="utf-8")
    print(f"{one.file}: {cost}", flush=True)


def processor() -> str:
    """Return what the processor is called."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def pilot(one: Training, folder: Path) -> Choice:
    """Return an agent as a policy; PPO's draws its moves, as it does in training."""
    draw = "true" if one.agent == "PPO" else "false"
    choice = own_choice(
        f"{HERE / 'trained_agent.py'}:TrainedAgent:file={folder / one.file},draw={draw}", "policy"
    )
    assert choice is not None
    return choice


def fly(
    scenarios: Sequence[str],
    folder: Path,
    estimators: Sequence[str],
    seeds: int,
    *,
    strangers: bool = False,
    out: Path | None = None,
) -> None:
    """Fly the agents that are there beside ours, and print the standings and their differences."""
    for scenario in scenarios:
        wanted = [one for one in TRAININGS if strangers or one.scenario == scenario]
        agents = [pilot(one, folder) for one in wanted if (folder / one.file).exists()]
        ours = [choose(name, "planner") for name in OURS]
        learners = [choose(name, "estimator") for name in estimators]
        spec = BenchSpec.of([scenario], [*ours, *agents], learners, seeds)
        rows = benchmark(spec, out=None if out is None else out / scenario.split("/")[1])
        show(rows, [str(one) for one in agents])


def main() -> None:
    """Train, or fly."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["train", "fly"])
    parser.add_argument("--folder", type=Path, required=True, help="where the agents are or go")
    parser.add_argument("--seed", type=int, default=0, help="of the training")
    parser.add_argument("--scenarios", default=",".join(sorted({one.scenario for one in TRAININGS})))
    parser.add_argument("--strangers", action="store_true", help="agents fly everywhere")
    parser.add_argument("--estimators", default="adaptive-disk", help="with which they fly")
    parser.add_argument("--seeds", type=int, default=20, help="of the benchmark, from 0 on")
    parser.add_argument("--out", type=Path, help="a folder that keeps what was flown")
    given = parser.parse_args()
    if given.what == "fly":
        scenarios, estimators = given.scenarios.split(","), given.estimators.split(",")
        fly(scenarios, given.folder, estimators, given.seeds, strangers=given.strangers, out=given.out)
        return
    given.folder.mkdir(parents=True, exist_ok=True)
    for one in TRAININGS:
        train(one, given.folder, given.seed)


if __name__ == "__main__":
    main()
