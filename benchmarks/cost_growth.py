"""How the cost of an estimate grows with the observations: the exponents that the paper names.

Processor seconds of one estimate of the three fields over a whole farm from n observations in random cells,
from nothing, doubling n. The exponent of a method is the slope of log seconds over log n, between the last
two numbers and by least squares over the last three. "paper's GP" is scikit-learn's process as the published
code has it, "disk by disk" lays each disk through a mask of the farm. The methods take turns, so a busy
machine slows all of them: seconds are medians over the rounds; in brackets are medians of the ratio to the
paper's GP of the same round.

    OMP_NUM_THREADS=1 python benchmarks/cost_growth.py --farm miniberry-100 --numbers 112 225 450 --rounds 5
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from cost_figure import observations, reference_process, whole_farm_disks
from threadpoolctl import threadpool_limits

from geo.farms import get_farm
from geo.grid import FarmGrid
from sensors.estimators import make_estimator
from sensors.observations import Observations
from sensors.scoring.information import InformationModel


def ours(name: str) -> Callable[[FarmGrid, Observations], InformationModel]:
    """Return how one of our estimators estimates from nothing."""
    return lambda grid, seen: make_estimator(name, random_state=1).fit(grid, seen).predict()


METHODS: dict[str, Callable[[FarmGrid, Observations], InformationModel]] = {
    "paper's GP": reference_process,
    "gp": ours("gp"),
    "disk by disk": whole_farm_disks,
    "adaptive-disk": ours("adaptive-disk"),
}


def seconds(estimate: Callable[[FarmGrid, Observations], InformationModel], grid: FarmGrid, n: int) -> float:
    """Return the processor time of one estimate."""
    seen = observations(grid, n)
    begin_s = time.process_time()
    estimate(grid, seen)
    return time.process_time() - begin_s


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--farm", default="miniberry-100")
    parser.add_argument("--numbers", type=int, nargs="+", default=[112, 225, 450, 900])
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    grid, numbers = get_farm(options.farm).grid(), options.numbers
    header = [*map(str, numbers), "last two", "last three"]
    print(f"| {options.farm}, s | {' | '.join(header)} |\n|---|{'---:|' * len(header)}")
    with threadpool_limits(1):
        for estimate in METHODS.values():
            estimate(grid, observations(grid, 30))  # Importing and compiling is not the method's cost
        rounds = [
            [[seconds(estimate, grid, n) for estimate in METHODS.values()] for n in numbers]
            for _ in range(options.rounds)
        ]
    taken_s = np.array(rounds)  # [rounds, numbers, methods]; the paper's GP is the first
    ratios = np.median(taken_s / taken_s[:, :, :1], axis=0).T
    for name, own_s, by_reference in zip(METHODS, np.median(taken_s, axis=0).T, ratios, strict=True):
        slopes = [np.polyfit(np.log(numbers[-k:]), np.log(own_s[-k:]), 1)[0] for k in (2, 3)]
        cells = [f"{s:.3g} ({ratio:.2g})" for s, ratio in zip(own_s, by_reference, strict=True)]
        print(f"| {name} | {' | '.join([*cells, *(f'{slope:.2f}' for slope in slopes)])} |")


if __name__ == "__main__":
    main()
