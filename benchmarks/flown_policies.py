"""Policies flown by real motion against the paper's ideal robot: losses over paths of the same length.

    python benchmarks/flown_policies.py --environments 6

Every run is a whole one: planned, uploaded, flown, its path changed over MAVLink, estimated, scored. The
budget is metres over ground, the same for all; the quad also flies home, which is not looked at. The ideal
robot sees another cell at every step. A path that crosses the cells aslant does so when it looks every half a
cell; with a look every cell it sees a tenth fewer of them.

``expected`` is the loss that the estimator itself expects at the end, which is less a matter of luck than the
loss that comes of it, ``cells`` how many different ones were seen. The second row is the ideal robot asked as
seldom as the quad, after 13 cells: what deciding late alone costs. ``--speed`` flies the quad slower,
``--no-estimate-errors`` lets PX4 know exactly where and how fast it is.
"""

from __future__ import annotations

import argparse

import numpy as np

from geo.farms import get_farm
from geo.units import FOOT_M
from sensors.fields import PAPER_FIELDS
from wbf_mission import Scenario, fly

FARM = "miniberry-30"
STEPS = 360
HOME_M = 14.0
WEIGHTS = np.array([1.0, 0.2]) / 1.2
LATE_CELLS = 13
"""A quad flies so many cells in the least time between two decisions."""
VEHICLES = (
    ("ideal", "px4", False),
    ("ideal", "px4", True),
    ("quad", "px4", False),
    ("quad", "ardupilot", False),
)
FIRST_SEED = 810_000


def measured(
    policy: str,
    vehicle: str,
    autopilot: str,
    seed: int,
    speed_m_s: float | None,
    estimate_errors: bool = True,
) -> list[float]:
    """Fly; return the loss over the run and at the end, the one expected there, and the number of cells seen.

    Losses are those of both diseases, weighted as the score weighs them.
    """
    ideal = vehicle == "ideal"
    scenario = Scenario(
        farm=FARM,
        vehicle=vehicle,
        autopilot=autopilot,
        policy=policy,
        budget=f"{STEPS * FOOT_M + (0.0 if ideal else HOME_M):.1f}m",
        estimator="epidemic",
        seed=seed,
        score_points=36,
        estimate_errors=estimate_errors,
        **({} if ideal else {"camera_spacing_m": 0.5 * FOOT_M, "cruise_speed_m_s": speed_m_s}),
    )
    result = fly(scenario)
    weighted = np.array(result.history.field_losses)[:, :2] @ WEIGHTS
    doubts = result.model.expected_loss
    assert doubts is not None
    grid = get_farm(FARM).grid()
    diseases = PAPER_FIELDS.diseases
    means = [float(doubts[k].sum()) / np.count_nonzero(one.mask(grid)) for k, one in enumerate(diseases)]
    seen = result.observations
    cells = len(np.unique(np.stack((seen.x, seen.y)), axis=1).T)
    return [float(weighted.mean()), float(weighted[-1]), float(np.dot(means, WEIGHTS)), float(cells)]


def main() -> None:
    """Print a row for each vehicle."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--environments", type=int, default=6)
    parser.add_argument("--policy", default="rolling-horizon")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--speed", type=float, help="m/s, of the quad; by default its own")
    parser.add_argument("--estimate-errors", action=argparse.BooleanOptionalAction, default=True)
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.environments)
    reference = None
    print(f"{given.policy}, Miniberry-30, {STEPS} steps, {given.environments} environments")
    heads = f"{'vehicle':20}{'run':>9}{'end':>9}{'expected':>10}{'cells':>7}"
    print(f"{heads}{'by ideal: run':>15}{'end':>7}{'expected':>10}")
    for vehicle, autopilot, late in VEHICLES:
        policy = given.policy
        if late:
            policy += ("," if ":" in policy else ":") + f"every={LATE_CELLS}"
        flown = (policy, vehicle, autopilot)
        found = np.array([measured(*flown, seed, given.speed, given.estimate_errors) for seed in seeds])
        run, end, doubt, cells = found.mean(axis=0)
        reference = (run, end, doubt) if reference is None else reference
        name = (
            f"{vehicle}, {'decides late' if late else autopilot}" if late or vehicle != "ideal" else vehicle
        )
        ratios = np.array([run, end, doubt]) / reference
        print(
            f"{name:20}{run:9.4f}{end:9.4f}{doubt:10.4f}{cells:7.0f}"
            f"{ratios[0]:15.2f}{ratios[1]:7.2f}{ratios[2]:10.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
