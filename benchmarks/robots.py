"""The paper's multi-robot setting: the score with 1 to 10 ideal robots, for a fixed planner and a policy.

Whole runs through the front door (`wbf_mission.fly`), over MAVLink, on environments that nothing was tuned
on. Each robot has the budget; with ``--shared`` all of them share it. Printed are the score (mean over the
run) and the score at its end, mean over the environments; 0 is perfect, nan where the steps of a robot are
too few for the planner's sparsest path.

    python benchmarks/robots.py [--shared] [--environments 3] [--planner lawnmower] [--policy greedy]
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from mission.errors import PlanningError
from wbf_mission import Scenario, fly

FIRST_SEED = 720_000
MOST = 10


def scores(vehicles: int, steps: int, seeds: range, **options: str) -> tuple[float, float]:
    """Return score and final score of so many robots with so many steps each, mean over the seeds."""
    try:
        results = [
            fly(Scenario(vehicle="ideal", vehicles=vehicles, budget=f"{steps}steps", seed=seed, **options))
            for seed in seeds
        ]
    except PlanningError:
        return np.nan, np.nan
    return (
        float(np.mean([one.score for one in results])),
        float(np.mean([one.final_score for one in results])),
    )


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--farm", default="miniberry-30")
    parser.add_argument("--steps", type=int, default=360)
    parser.add_argument("--shared", action="store_true", help="the robots share the steps")
    parser.add_argument("--environments", type=int, default=3)
    parser.add_argument("--estimator", default="epidemic")
    parser.add_argument("--planner", default="lawnmower")
    parser.add_argument("--policy", default="greedy")
    parser.add_argument("--robots", type=int, nargs="*", default=list(range(1, MOST + 1)), help="how many")
    options = parser.parse_args()
    seeds = range(FIRST_SEED, FIRST_SEED + options.environments)
    who = {"planner": options.planner, "policy": options.policy}
    print(f"{'robots':>6} {'steps each':>10}" + "".join(f"{name:>26}" for name in who.values()))
    for count in options.robots:
        steps = options.steps // count if options.shared else options.steps
        begin = time.perf_counter()
        found = [
            scores(count, steps, seeds, farm=options.farm, estimator=options.estimator, **{kind: name})
            for kind, name in who.items()
        ]
        told = "".join(f"{run:>15.4f} | {end:<8.4f}" for run, end in found)
        print(f"{count:>6} {steps:>10}{told}  {time.perf_counter() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main()
