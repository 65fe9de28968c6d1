"""How the cost of an estimate grows with the observations: the exponents that the paper names.

Processor seconds of one estimate of the three fields over a whole farm from n observations in random cells,
from nothing, doubling n. The exponent of a method is the slope of log seconds over log n, between the last
two numbers and by least squares over the last three. "paper's GP" is scikit-learn's process as the published
code has it, "disk by disk" lays each disk through a mask of the farm.

    OMP_NUM_THREADS=1 python benchmarks/cost_growth.py --farm miniberry-100 --numbers 112 225 450 900
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

ENOUGH_S, MOST_TIMES = 0.5, 9


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
    """Return the median processor time of some estimates."""
    seen, times = observations(grid, n), list[float]()
    while not times or (sum(times) < ENOUGH_S and len(times) < MOST_TIMES):
        begin_s = time.process_time()
        estimate(grid, seen)
        times.append(time.process_time() - begin_s)
    return float(np.median(times))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--farm", default="miniberry-100")
    parser.add_argument("--numbers", type=int, nargs="+", default=[112, 225, 450, 900])
    options = parser.parse_args()
    grid, numbers = get_farm(options.farm).grid(), options.numbers
    header = [*map(str, numbers), "last two", "last three"]
    print(f"| {options.farm}, s | {' | '.join(header)} |\n|---|{'---:|' * len(header)}")
    with threadpool_limits(1):
        for name, estimate in METHODS.items():
            estimate(grid, observations(grid, 30))  # Importing and compiling is not the method's cost
            taken = [seconds(estimate, grid, n) for n in numbers]
            slopes = [np.polyfit(np.log(numbers[-k:]), np.log(taken[-k:]), 1)[0] for k in (2, 3)]
            cells = [*(f"{one:.3g}" for one in taken), *(f"{one:.2f}" for one in slopes)]
            print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
