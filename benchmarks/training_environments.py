"""How many steps a CPU second the training environments make, batched and one by one.

Every run begins anew on a farm of its own when it ends, and making that farm counts. The reference is
Gymnasium's ``SyncVectorEnv`` of as many single environments; the rewards and last maps of both are compared.
Frames are those of ``render_mode="rgb_array"``, of a run half of which is over.

    python benchmarks/training_environments.py [--scenario ID] [--runs 64] [--steps 1500]
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from gymnasium.vector import SyncVectorEnv, VectorEnv

from wbf_mission.addons.rl import SurveyEnv, SurveyVectorEnv


def rate(envs: VectorEnv, actions: np.ndarray) -> tuple[float, float]:
    """Return steps a CPU second, and the sum of all rewards and maps as a check."""
    envs.reset(seed=0)
    check = 0.0
    begin = time.process_time()
    for one in actions:
        shown, rewards, *_ = envs.step(one)
        check += float(rewards.sum())
    seconds = time.process_time() - begin
    return actions.size / seconds, check + float(np.ascontiguousarray(shown["value"]).sum())


def frames(name: str, times: int = 200) -> float:
    """Return frames a CPU second."""
    env = SurveyEnv(name, render_mode="rgb_array")
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(env.task.moves // 2):
        env.step(env.action_space.sample())
    env.render()
    begin = time.process_time()
    for _ in range(times):
        env.render()
    return times / (time.process_time() - begin)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="WBF/Miniberry-30-v1")
    parser.add_argument("--runs", type=int, default=64)
    parser.add_argument("--steps", type=int, default=1500, help="of each batched run")
    given = parser.parse_args()
    number, name = given.runs, given.scenario
    batched = SurveyVectorEnv(number, name)
    single = SyncVectorEnv([lambda: SurveyEnv(name)] * number)
    length = batched.task.moves + 1
    rng = np.random.default_rng(0)
    rows = rng.integers(0, 5, (max(given.steps, length), number))
    rate(batched, rows[:3])
    _, ours = rate(batched, rows[: length + 20])
    theirs_rate, theirs = rate(single, rows[: length + 20])
    print(f"{name}, {number} runs, one core; the same rewards and maps: {ours == theirs}")
    print(f"Gymnasium's SyncVectorEnv            {theirs_rate:10.0f} steps/s")
    for what, envs in (
        ("batched", batched),
        ("batched, copy=False", SurveyVectorEnv(number, name, copy=False)),
    ):
        found, _ = rate(envs, rows)
        print(f"{what:36s} {found:10.0f} steps/s, {found / theirs_rate:6.1f} times as many")
    within, _ = rate(batched, rows[: length - 1])
    print(f"{'batched, without making farms':36s} {within:10.0f} steps/s, {within / theirs_rate:6.1f} times")
    print(f"{'frames':36s} {frames(name):10.0f} frames/s")


if __name__ == "__main__":
    main()
