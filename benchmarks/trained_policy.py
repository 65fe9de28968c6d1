"""The trained policy beside others on the same environments: flown in ``bench run``, and agents move by move.

The agents are those of docs/examples and the network itself, asked for each cell, as in training. The flown
ones are asked as policies are, after some observations. Both have the scores of the same scenario.

    python benchmarks/trained_policy.py [--seeds 20] [--scenario ID]
"""

from __future__ import annotations

import argparse
import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mission.policies.learned import SHIPPED
from mission.policies.network import Network, NetworkView
from sensors.scoring.score import ScoreWeights
from wbf_mission import BenchSpec, benchmark
from wbf_mission.bench.standings import mean_interval
from wbf_mission.rl import SurveyVectorEnv

EXAMPLES = Path(__file__).resolve().parents[1] / "docs" / "examples"
FLOWN = ("learned", "greedy", "spiral", "lawnmower", "random-waypoint")
Act = Callable[[dict[str, Any]], np.ndarray]


def random_agent(_envs: SurveyVectorEnv) -> Act:
    """Return an agent that moves anywhere."""
    rng = np.random.default_rng(0)
    return lambda shown: rng.integers(0, 5, len(shown["left"]))


def greedy_agent(_envs: SurveyVectorEnv) -> Act:
    """Return the agent of the example."""
    spec = importlib.util.spec_from_file_location("greedy_agent", EXAMPLES / "greedy_agent.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    def act(shown: dict[str, Any]) -> np.ndarray:
        rows = [{key: array[run] for key, array in shown.items()} for run in range(len(shown["left"]))]
        return np.array([module.act(row) for row in rows])

    return act


def trained_agent(envs: SurveyVectorEnv) -> Act:
    """Return an agent that moves as the network draws."""
    task, rng = envs.task, np.random.default_rng(0)
    network = Network.load(SHIPPED, NetworkView.size, 4)
    view = NetworkView(task.farm, task.fields, ScoreWeights.of(task.fields))

    def act(shown: dict[str, Any]) -> np.ndarray:
        cells = np.floor(shown["position"] * np.array(task.grid.shape)).astype(int)
        wishes = network(view(shown["value"], shown["seen"], cells, shown["left"][:, 1]))
        return 1 + np.argmax(wishes + rng.gumbel(size=wishes.shape), axis=1)

    return act


def play(scenario: str, seeds: int, make: Callable[[SurveyVectorEnv], Act]) -> np.ndarray:
    """Return the scores of an agent on the environments of the seeds from 0 on."""
    envs = SurveyVectorEnv(seeds, scenario, autoreset_mode="Disabled")
    act = make(envs)
    shown, _ = envs.reset(seed=0)
    while True:
        shown, _, ended, _, info = envs.step(act(shown))
        if ended.all():
            return info["score"]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="WBF/Miniberry-30-v1")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--out", type=Path, help="keep the flown runs there")
    given = parser.parse_args()
    scores = {}
    for name, make in (("random", random_agent), ("greedy", greedy_agent), ("trained", trained_agent)):
        scores[f"agent: {name}"] = play(given.scenario, given.seeds, make)
    spec = BenchSpec.of(
        [given.scenario], planners=list(FLOWN), estimators=["adaptive-disk"], seeds=given.seeds
    )
    rows = benchmark(spec, out=given.out)
    for name in FLOWN:
        scores[f"flown: {name}"] = np.array([row.score for row in rows if row.planner == name])
    trained = scores["flown: learned"]
    print(f"{given.scenario}, adaptive disks, {given.seeds} environments: score (0 is perfect), 95 %")
    for name, found in sorted(scores.items(), key=lambda one: -one[1].mean()):
        mean, less = mean_interval(found), mean_interval(trained - found)
        text = f"{name:24s} {mean.mean:8.4f} ({mean.low:.4f} to {mean.high:.4f})"
        print(text if found is trained else f"{text}   learned less it {less.low:+.4f} to {less.high:+.4f}")


if __name__ == "__main__":
    main()
