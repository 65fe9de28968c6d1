"""Which estimator a farm should have by default: loss, time and memory of each, on the same observations.

Every estimator runs in a process of its own, once with an empty cache (what it has to learn first is learned
then) and with what is left of that cache for the other runs. On the Miniberries the paper's ideal robot flies
the missions of the four planners for 0.4 timesteps a cell; on other farms a quadrotor flies a spiral of one
battery. The loss is the paper's, at the end and averaged over the scored times.

Seconds are of the processor (all threads), which other work on the machine does not change.

Examples::

    python benchmarks/default_estimator.py --farms miniberry-10,miniberry-30 --environments 5
    python benchmarks/default_estimator.py --farms waterberry --environments 1
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from typing import Any

import numpy as np
from epidemic_estimator import DAY, PLANNERS, flown_cells
from numpy.typing import NDArray
from scratch import scratch_folder

from geo.farms import get_farm
from geo.seeds import child_seed
from sensors.environment.cache import EnvironmentCache
from sensors.estimators import make_estimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.score import RunningScore
from wbf_mission.planning import plan
from wbf_mission.scenario import Scenario

ESTIMATORS: dict[str, tuple[str, dict[str, Any]]] = {
    "adaptive-disk": ("adaptive-disk", {}),
    "gp, observations": ("gp", {"learn_from": "observations"}),
    "gp, model": ("gp", {"learn_from": "model"}),
    "epidemic": ("epidemic", {}),
}
POINTS = 25
LARGE_POINTS = 10
SMALL_CELLS = 128 * 128


def cells_of(farm: str, planner: str, seed: int) -> NDArray[np.int64]:
    """Return the cells that a flight observes, int64[n, 2]."""
    land = get_farm(farm)
    if land.width_cells * land.height_cells <= SMALL_CELLS:
        return flown_cells(farm, planner, seed)
    path = plan(Scenario(farm=farm, planner=planner, seed=seed)).path_m / land.cell_size_m
    steps = np.hypot(*np.diff(path, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.arange(0.0, along[-1])
    x, y = (np.interp(at, along, path[:, axis]) for axis in (0, 1))
    cells = np.floor(np.stack([x, y], axis=1)).astype(np.int64)
    return np.asarray(np.clip(cells, 0, np.array(land.grid().shape) - 1))


def measure(farm: str, name: str, seeds: list[int], planners: list[str]) -> dict[str, Any]:
    """Run one estimator over all environments; for a process of its own."""
    grid = get_farm(farm).grid()
    small = grid.shape[0] * grid.shape[1] <= SMALL_CELLS
    masks = PAPER_FIELDS.masks(grid)
    estimator_name, params = ESTIMATORS[name]
    found: dict[str, Any] = {"final": [], "run": [], "fields": [], "first_s": 0.0, "later_s": [], "mb": 0.0}
    cache = EnvironmentCache.of_user()
    for seed in seeds:
        environment, _ = cache.environment(grid, day=DAY, seed=child_seed(seed, "environment"))
        score = RunningScore(environment.values(DAY), masks)
        for planner in planners:
            x, y = cells_of(farm, planner, seed).T
            n = len(x)
            seen = Observations(x, y, np.arange(n), np.full(n, DAY), environment.sample(DAY, x, y))
            stops = np.linspace(0, n, (POINTS if small else LARGE_POINTS) + 1).round().astype(int)
            spent, entries = 0.0, []
            begin = time.process_time()
            estimator = make_estimator(estimator_name, random_state=child_seed(seed, "estimator"), **params)
            estimator.fit(grid)
            spent += time.process_time() - begin
            for k in range(len(stops) - 1):
                begin = time.process_time()
                model = estimator.partial_fit(seen[int(stops[k]) : int(stops[k + 1])]).predict()
                spent += time.process_time() - begin
                entries.append(score.add(model))
            if found["first_s"] == 0.0:
                found["first_s"] = spent
            else:
                found["later_s"].append(spent)
            found["final"].append(entries[-1].loss)
            found["fields"].append(list(entries[-1].field_loss))
            found["run"].append(float(np.mean([entry.loss for entry in entries])))
    found["mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return found


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--farms", default="miniberry-10,miniberry-30,miniberry-100")
    parser.add_argument("--environments", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--planners", default=None, help="all four; spiral on large farms")
    parser.add_argument("--estimators", default=";".join(ESTIMATORS), help="separated by semicolons")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args()
    seeds = list(range(options.first_seed, options.first_seed + options.environments))
    if options.one:
        planners = options.planners.split(",")
        print(json.dumps(measure(options.farms, options.one, seeds, planners)))
        return 0
    header = f"{'farm':<16}{'estimator':<20}{'loss, end':>11}{'loss, run':>11}"
    header += "".join(f"{field:>10}" for field in PAPER_FIELDS.names)
    print(header + f"{'first, s':>10}{'next, s':>10}{'MB':>8}")
    for farm in options.farms.split(","):
        land = get_farm(farm)
        small = land.width_cells * land.height_cells <= SMALL_CELLS
        planners = options.planners or ",".join(PLANNERS if small else ("spiral",))
        for name in options.estimators.split(";"):
            with scratch_folder() as folder:
                command = [sys.executable, __file__, "--farms", farm, "--one", name, "--planners", planners]
                command += ["--environments", str(len(seeds)), "--first-seed", str(seeds[0])]
                done = subprocess.run(
                    command,
                    env={**os.environ, "XDG_CACHE_HOME": folder},
                    check=True,
                    stdout=subprocess.PIPE,
                    text=True,
                )
            found = json.loads(done.stdout)
            later = f"{np.mean(found['later_s']):.2f}" if found["later_s"] else "-"
            means = "".join(f"{mean:>10.5f}" for mean in np.mean(found["fields"], axis=0))
            print(
                f"{farm:<16}{name:<20}{np.mean(found['final']):>11.5f}{np.mean(found['run']):>11.5f}"
                f"{means}{found['first_s']:>10.1f}{later:>10}{found['mb']:>8.0f}",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
