"""Cost of the Gaussian process: growth with the number of observations, and the Waterberry farm.

- *growth*: processor time of a new estimate of three fields from n observations in random cells; n doubles.
  The exponent of a method is the slope of log time over log n between the last two values. "paper's GP" is
  scikit-learn's process as in the published code. "disk by disk" writes each disk through a mask of the farm.
  The methods alternate, so that a busy machine slows all of them. Times are medians over the rounds; brackets
  hold the median ratio to the paper's GP of the same round.
- *waterberry*: time and memory for one battery (25,000 observations), a day of ten flights (250,000), and
  updates of 100 observations.

Examples::

    python benchmarks/gp_scale.py --only waterberry
    OMP_NUM_THREADS=1 python benchmarks/gp_scale.py --only growth --farm miniberry-100 --numbers 112 225 450

The exit code is 1 if a limit is exceeded: 10 s, 60 s, 0.3 s, 4 GB.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from multiprocessing import get_context
from typing import Any

import numpy as np
from common import options_of, peak_mb, print_table, seconds_of
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from geo.farms import get_farm
from geo.grid import FarmGrid
from geo.seeds import child_seed
from sensors.environment import generate_environment
from sensors.estimators import make_estimator
from sensors.estimators.disks import adaptive_radius
from sensors.estimators.gp.estimator import GaussianProcessEstimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.information import InformationModel

DAY = 6
BATTERY, FLIGHTS, UPDATE, UPDATES = 25_000, 10, 100, 10
BARS_S = {BATTERY: 10.0, BATTERY * FLIGHTS: 60.0}
UPDATE_BAR_S = 0.3
MEMORY_BAR_GB = 4.0
WALL = time.perf_counter

Cells = NDArray[np.int64]
Estimate = Callable[[FarmGrid, Observations], InformationModel]


# How the cost grows.


def in_random_cells(grid: FarmGrid, n: int) -> Observations:
    """Return n observations in random cells, with invented values."""
    random = np.random.default_rng(0)
    x, y = random.integers(0, grid.shape[0], n), random.integers(0, grid.shape[1], n)
    sick = np.where(np.sin(x / 4) * np.cos(y / 5) > 0.6, 0.5, 1.0)
    rare = random.choice([0.5, 1.0], n, p=[0.05, 0.95])
    values = np.stack([sick, rare, 0.5 + 0.3 * np.sin(x / 30)], axis=1)
    return Observations(x, y, np.arange(n, dtype=np.float64), np.full(n, DAY), values)


def disk_by_disk(grid: FarmGrid, seen: Observations) -> InformationModel:
    """Return an adaptive-disk estimate, made with a mask of the whole farm for each observation and field."""
    model = InformationModel.uniform(grid.shape, value=PAPER_FIELDS.defaults, uncertainty=1.0)
    width, height = grid.shape
    r = adaptive_radius(len(seen), grid.shape)
    steps = np.arange(-r, r + 1)
    disk = steps[:, None] ** 2 + steps**2 <= r * r
    for k in range(len(PAPER_FIELDS)):
        for x, y, value in zip(seen.x.tolist(), seen.y.tolist(), seen.values[:, k].tolist(), strict=True):
            x0, x1, y0, y1 = max(0, x - r), min(width, x + r + 1), max(0, y - r), min(height, y + r + 1)
            mask = np.zeros(grid.shape, np.bool_)
            mask[x0:x1, y0:y1] = disk[x0 - x + r : x1 - x + r, y0 - y + r : y1 - y + r]
            model.value[k][mask] = value
            model.uncertainty[k][mask] = 0.0
    return model


def by(name: str, **parameters: Any) -> Estimate:
    """Return a function that fits a new estimator to observations."""
    return lambda grid, seen: make_estimator(name, random_state=1, **parameters).fit(grid, seen).predict()


METHODS: dict[str, Estimate] = {
    "paper's GP": by("gp-sklearn", max_points=10**9, max_entries=10**18),
    "gp": by("gp"),
    "disk by disk": disk_by_disk,
    "adaptive-disk": by("adaptive-disk"),
}


def growth(farm: str, numbers: list[int], rounds: int) -> None:
    """Print the cost of one estimate against the number of observations, and the exponents."""
    grid = get_farm(farm).grid()
    with threadpool_limits(1):
        for estimate in METHODS.values():
            estimate(grid, in_random_cells(grid, 30))  # Excludes imports and compilation from the time
        taken_s = np.array(
            [
                [
                    [seconds_of(lambda e=e, seen=seen: e(grid, seen)) for e in METHODS.values()]
                    for seen in (in_random_cells(grid, n) for n in numbers)
                ]
                for _ in range(rounds)
            ]
        )  # [rounds, numbers, methods], with the paper's GP as first method
    ratios = np.median(taken_s / taken_s[:, :, :1], axis=0).T
    rows = []
    for name, own_s, by_paper in zip(METHODS, np.median(taken_s, axis=0).T, ratios, strict=True):
        cells = {
            str(n): f"{s:.3g} ({ratio:.2g})" for n, s, ratio in zip(numbers, own_s, by_paper, strict=True)
        }
        slope = np.diff(np.log(own_s[-2:]))[0] / np.diff(np.log(numbers[-2:]))[0]
        rows.append({f"{farm}, s": name, **cells, "exponent": f"{slope:.2f}"})
    print_table(rows)


# The whole farm.


def rows_over_waterberry(steps: int) -> Cells:
    """Return the cells of a lawnmower path of at least `steps` cells over the owner's land of Waterberry."""
    rows = max(2, steps // 4000)
    gap = 3000 // rows
    parts = []
    for i in range(rows):
        x = np.arange(1000, 5000)[:: 1 if i % 2 == 0 else -1]
        between = np.arange(1000 + i * gap, 1000 + (i + 1) * gap)
        parts.append(np.stack([x, np.full(len(x), 1000 + i * gap)], axis=1))
        parts.append(np.stack([np.full(gap, x[-1]), between], axis=1))
    return np.concatenate(parts)


def whole_farm(seen: Observations) -> bool:
    """Estimate from observations, then update; return whether all limits are met.

    Runs in a separate process, so that the measured memory is that of the estimate.
    """
    n = len(seen) - UPDATE * UPDATES
    estimator = GaussianProcessEstimator().fit(get_farm("waterberry").grid())
    before_s = seconds_of(estimator.predict, WALL)
    first_s = seconds_of(lambda: estimator.partial_fit(seen[:n]).predict(), WALL)
    begins = range(n, len(seen), UPDATE)
    updates_s = [
        seconds_of(lambda i=i: estimator.partial_fit(seen[i : i + UPDATE]).predict(), WALL) for i in begins
    ]
    middle_s = float(np.median(updates_s))
    memory_gb = peak_mb() * 1024**2 / 1e9
    print(
        f"waterberry, {n} observations: prior {before_s:.2f} s, value and deviation {first_s:.2f} s"
        f" (bar {BARS_S[n]:g} s), updates of {UPDATE}: median {middle_s:.3f} s, slowest"
        f" {max(updates_s):.3f} s (bar {UPDATE_BAR_S:g} s), {memory_gb:.2f} GB (bar {MEMORY_BAR_GB:g} GB)",
        flush=True,
    )
    return first_s < BARS_S[n] and middle_s < UPDATE_BAR_S and memory_gb < MEMORY_BAR_GB


def waterberry() -> bool:
    """Run `whole_farm` for each number of observations; return whether all limits are met."""
    grid = get_farm("waterberry").grid()
    environment = generate_environment(grid, days=DAY, seed=child_seed(1, "environment"), keep_days=[DAY])
    held = True
    for n in BARS_S:
        x, y = rows_over_waterberry(n + 4000)[: n + UPDATE * UPDATES].T
        seen = Observations(x, y, np.arange(len(x)), np.full(len(x), DAY), environment.sample(DAY, x, y))
        with get_context("spawn").Pool(1) as pool:
            held &= pool.apply(whole_farm, (seen,))
    return held


def main() -> int:
    """Run the selected parts."""
    parser = options_of(__doc__)
    parser.add_argument("--only", choices=("growth", "waterberry"))
    parser.add_argument("--farm", default="miniberry-100", help="of the growth")
    parser.add_argument("--numbers", type=int, nargs="+", default=[112, 225, 450, 900])
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    if options.only != "waterberry":
        growth(options.farm, options.numbers, options.rounds)
    held = options.only == "growth" or waterberry()
    print(f"bars: {'held' if held else 'MISSED'}")
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
