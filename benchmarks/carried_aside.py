"""What it costs a policy that its vehicle does not see the cells that it is sent to: a robot carried aside.

The paper's robot flies its path to the point and sees the cell that it is over. Here it is carried aside
from its path by swings as PX4's own estimate makes them: second-order processes along both axes (period and
damping as in `sim_vehicle.airframe.estimate_errors`), at 1 m/s. It knows where it is, sees what is there, and
decides by that; all else is as in `policies.py`. No way of replanning over MAVLink is expected to do better
with a vehicle that swings so.

    python benchmarks/carried_aside.py --environments 60
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray
from policies import CASES, Robot, fly, made
from threadpoolctl import threadpool_limits

from geo.farms import get_farm
from mission.planners import PlanningRequest

CASE = CASES[0]
FIRST_SEED = 810_000
SPEED_M_S = 1.0
NATURAL_S, DAMPING = 2.25, 0.73
PARTS = 8
"""The process is followed in so many parts of a step of the robot."""


def swings(deviation_m: float, steps: int, step_s: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return how far the robot is carried aside at each step, float64[steps, 2] metres."""
    part_s, natural = step_s / PARTS, 1.0 / NATURAL_S
    settling = int(10.0 * NATURAL_S / step_s)
    place, speed = np.zeros(2), np.zeros(2)
    found = np.empty((settling + steps, 2))
    for number in range(len(found)):
        for push in rng.normal(size=(PARTS, 2)):
            pull = -2.0 * DAMPING * natural * speed - natural**2 * place
            speed += part_s * pull + np.sqrt(part_s) * push
            place += part_s * speed
        found[number] = place
    # Deviation of the process under white noise of unit density.
    unscaled = float(np.sqrt(1.0 / (4.0 * DAMPING * natural**3)))
    return np.asarray(found[settling:] * (deviation_m / unscaled))


class CarriedRobot(Robot):
    """The paper's robot, carried aside from where it steers."""

    def __init__(
        self, system_id: int, request: PlanningRequest, cell_m: float, aside_m: NDArray[np.float64]
    ) -> None:
        super().__init__(system_id, request, cell_m)
        self._aside_m = aside_m
        self._steered = self.here
        x_0, y_0, x_1, y_1 = request.area.bounds
        self._low, self._high = np.array([x_0, y_0]) + 1e-3, np.array([x_1, y_1]) - 1e-3

    def step(self) -> bool:
        """Move; return whether a waypoint was reached, as far as it knows where it steers."""
        self.here = self._steered
        reached = super().step()
        self._steered = self.here
        x, y = np.clip(np.asarray(self.here) + self._aside_m[self.spent - 1], self._low, self._high)
        self.here = float(x), float(y)
        return reached


def losses(policy: str, deviation_m: float, seed: int) -> tuple[float, float, float]:
    """Fly; return the loss over the run, at the end, and the one that is expected there."""
    farm = get_farm(CASE.farm)
    steps = farm.owner_cells
    rng = np.random.default_rng(seed)

    def robot(system_id: int, request: PlanningRequest, cell_m: float) -> Robot:
        return CarriedRobot(system_id, request, cell_m, swings(deviation_m, steps, cell_m / SPEED_M_S, rng))

    done = fly(CASE, made(policy), seed, make_robot=robot if deviation_m > 0.0 else Robot)
    return float(done.losses[:, 0].mean()), float(done.losses[-1, 0]), done.expected


def main() -> None:
    """Print a row for each deviation."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--environments", type=int, default=60)
    parser.add_argument("--policy", default="rolling-horizon")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument(
        "--aside", type=float, nargs="*", default=[0.15, 0.25, 0.35], help="m, along each axis"
    )
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.environments)
    print(f"{given.policy}, {CASE.name}, {given.environments} environments")
    heads = f"{'carried aside':16}{'run':>9}{'end':>9}{'expected':>10}"
    print(f"{heads}{'by none: run':>15}{'end':>7}{'expected':>10}")
    none = None
    with threadpool_limits(1):
        for deviation_m in [0.0, *given.aside]:
            found = np.array([losses(given.policy, deviation_m, seed) for seed in seeds]).mean(axis=0)
            none = found if none is None else none
            run, end, doubt = found
            ratios = found / none
            print(
                f"{deviation_m:13.2f} m {run:9.4f}{end:9.4f}{doubt:10.4f}"
                f"{ratios[0]:15.2f}{ratios[1]:7.2f}{ratios[2]:10.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
