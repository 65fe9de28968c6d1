"""An agent that moves at random: python docs/examples/random_agent.py [ID]."""

import sys

import gymnasium

import wbf_mission.addons.rl

gymnasium.register_envs(wbf_mission.addons.rl)


def run(scenario: str, seed: int) -> float:
    """Return the score of one run: 0 is perfect."""
    env = gymnasium.make(scenario)
    env.action_space.seed(seed)
    env.reset(seed=seed)
    ended = False
    while not ended:
        _, _, ended, _, info = env.step(env.action_space.sample())
    return info["score"]


if __name__ == "__main__":
    name = sys.argv[1] if len(sys.argv) > 1 else "WBF/Miniberry-30-v1"
    for seed in range(3):
        print(f"{name} seed {seed}: {run(name, seed):.4f}")
