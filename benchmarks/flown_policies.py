"""Policies flown by real motion against the paper's ideal robot: losses over paths of the same length.

    python benchmarks/flown_policies.py --environments 6

Every run is a whole one: planned, uploaded, flown, its path changed over MAVLink, estimated, scored. The
budget is metres over ground, the same for all; the quad also flies home, which is not looked at. The ideal
robot sees another cell at every step. A path that crosses the cells aslant does so when it looks every half a
cell; with a look every cell it sees a tenth fewer of them.
"""

from __future__ import annotations

import argparse

import numpy as np

from geo.units import FOOT_M
from wbf_mission import Scenario, fly

STEPS = 360
VEHICLES = (("ideal", "px4"), ("quad", "px4"), ("quad", "ardupilot"))
FIRST_SEED = 810_000


def losses(policy: str, vehicle: str, autopilot: str, seed: int) -> tuple[float, float]:
    """Return the loss over the run and at the end, of both diseases, weighted as the score weighs them."""
    home_m = 0.0 if vehicle == "ideal" else 14.0
    scenario = Scenario(
        farm="miniberry-30",
        vehicle=vehicle,
        autopilot=autopilot,
        policy=policy,
        budget=f"{STEPS * FOOT_M + home_m:.1f}m",
        estimator="epidemic",
        seed=seed,
        score_points=36,
        **({} if vehicle == "ideal" else {"camera_spacing_m": 0.5 * FOOT_M}),
    )
    result = fly(scenario)
    weighted = np.array(result.history.field_losses)[:, :2] @ (1.0, 0.2) / 1.2
    return float(weighted.mean()), float(weighted[-1])


def main() -> None:
    """Print a row for each vehicle."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--environments", type=int, default=6)
    parser.add_argument("--policy", default="rolling-horizon")
    given = parser.parse_args()
    seeds = [FIRST_SEED + k for k in range(given.environments)]
    reference = None
    print(f"{given.policy}, Miniberry-30, {STEPS} steps, {given.environments} environments")
    print(f"{'vehicle':20}{'run':>10}{'end':>10}{'run / ideal':>14}{'end / ideal':>14}")
    for vehicle, autopilot in VEHICLES:
        found = np.array([losses(given.policy, vehicle, autopilot, seed) for seed in seeds]).mean(axis=0)
        reference = found if reference is None else reference
        name = vehicle if vehicle == "ideal" else f"{vehicle}, {autopilot}"
        ratios = found / reference
        print(f"{name:20}{found[0]:10.4f}{found[1]:10.4f}{ratios[0]:14.2f}{ratios[1]:14.2f}")


if __name__ == "__main__":
    main()
