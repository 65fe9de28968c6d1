"""What observations of earlier days are worth to each estimator: carried forward, forgotten, or taken as new.

Days 3 to 10 of Miniberry-30, 100 observations a day, along rows that move by three cells a day and along
random legs; environments that nothing was tuned on. The loss is the paper's weighted one of all three fields,
and that of both diseases, mean over five scored times a day from the second day on. Printed are the losses of
the estimator that carries the earlier days forward by those of the same estimator that forgets them, and that
takes them all as seen today, with 95 % intervals over the environments.

    python benchmarks/days.py [--estimators gp adaptive-disk point] [--environments 8]

The exit code tells whether carrying costs nowhere more than forgetting, nor than taking old for new.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from geo.farms import get_farm
from geo.seeds import child_seed, stream
from sensors.environment import Environment, generate_environment
from sensors.estimators import advance_estimator, make_estimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.score import PAPER_WEIGHTS, RunningScore
from wbf_mission.bench.intervals import ratio_interval

FARM = "miniberry-30"
DAYS = range(3, 11)
A_DAY = 100
SCORED = 5
FIRST_SEED = 810_000
ESTIMATORS = ("gp", "adaptive-disk", "point")
PATHS = ("rows", "random")
WAYS = ("carried", "forgotten", "as new")
Losses = NDArray[np.float64]


def rows(day: int, side: int) -> NDArray[np.intp]:
    """Return cells along rows that move by three cells a day, intp[A_DAY, 2]."""
    columns = (np.arange(4) * 8 + 3 * (day - DAYS[0])) % side
    cells = [(x, y if k % 2 == 0 else side - 1 - y) for k, x in enumerate(columns) for y in range(side)]
    return np.array(cells[:A_DAY], np.intp)


def random_legs(day: int, side: int, seed: int) -> NDArray[np.intp]:
    """Return cells along straight legs between random cells, intp[A_DAY, 2]."""
    rng = stream(seed, "path", f"day-{day}")
    here, cells = rng.integers(0, side, 2).astype(float), []
    while len(cells) < A_DAY:
        there = rng.integers(0, side, 2).astype(float)
        steps = int(np.ceil(np.abs(there - here).max()))
        cells += [here + (there - here) * k / max(steps, 1) for k in range(1, steps + 1)]
        here = there
    return np.round(cells[:A_DAY]).astype(np.intp)


def observe(environment: Environment, day: int, cells: NDArray[np.intp]) -> Observations:
    """Return what is seen there, a cell a second."""
    x, y = cells.T
    time_s = np.arange(len(cells), dtype=np.float64)
    return Observations(x, y, time_s, np.full(len(cells), day), environment.sample(day, x, y))


def losses(name: str, kind: str, seed: int) -> Losses:
    """Return the loss of each way on one environment: all fields, and both diseases; float64[ways, 2]."""
    grid = get_farm(FARM).grid()
    days = list(DAYS)
    environment = generate_environment(
        grid, days=days[-1], seed=child_seed(seed, "environment"), keep_days=days
    )
    masks = PAPER_FIELDS.masks(grid)
    weights = np.array(PAPER_WEIGHTS.field) * masks.reshape(len(masks), -1).sum(axis=1)
    side = grid.shape[0]
    seen = [
        observe(environment, day, rows(day, side) if kind == "rows" else random_legs(day, side, seed))
        for day in days
    ]
    total = np.zeros((len(WAYS), 2))
    for way, sums in zip(WAYS, total, strict=True):
        estimator = make_estimator(name, random_state=child_seed(seed, "estimator")).fit(grid)
        for k, day in enumerate(days):
            if way == "forgotten":
                estimator.fit(grid)
            elif way == "as new" and k:
                before = Observations.concatenate(seen[:k])
                estimator.fit(grid, replace(before, day=np.full(len(before), day, np.int32)))
            advance_estimator(estimator, day)
            running = RunningScore(environment.values(day), masks)
            part = A_DAY // SCORED
            for begin in range(0, A_DAY, part):
                estimator.partial_fit(seen[k][begin : begin + part])
                found = np.asarray(running.evaluate(estimator.predict()).field_loss)
                if k:
                    sums += np.average(found, weights=weights), np.average(found[:2], weights=weights[:2])
    return total / (SCORED * (len(days) - 1))


def told(ours: Losses, theirs: Losses) -> tuple[float, str]:
    """Return the ratio of the means over environments, and it with its interval in words."""
    found = ratio_interval(ours, theirs)
    return found.mean, f"{found.mean:.2f} ({found.low:.2f}-{found.high:.2f})"


def main() -> int:
    """Run the benchmark."""
    parser: Any = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--estimators", nargs="*", default=list(ESTIMATORS))
    parser.add_argument("--environments", type=int, default=8)
    options = parser.parse_args()
    good = True
    print(f"{'estimator':<16}{'path':<8}{'what':<10}{'by forgotten':<20}{'by taken as new':<20}loss carried")
    with threadpool_limits(1):
        for name in options.estimators:
            for kind in PATHS:
                seeds = range(FIRST_SEED, FIRST_SEED + options.environments)
                found = np.stack([losses(name, kind, seed) for seed in seeds])
                for number, what in enumerate(("all", "diseases")):
                    carried, forgotten, new = found[:, :, number].T
                    (by_none, first), (by_new, second) = told(carried, forgotten), told(carried, new)
                    print(f"{name:<16}{kind:<8}{what:<10}{first:<20}{second:<20}{carried.mean():.4f}")
                    good &= by_none <= 1.0 and by_new <= 1.0
    print("held" if good else "missed")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
