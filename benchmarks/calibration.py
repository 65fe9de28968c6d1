"""How far what estimators state can be trusted: see `sensors.scoring.calibration` for the measures.

The paper's ideal robot flies the missions of fixed planners on day 6 over environments of Miniberries; the
last estimate, and that at a part of the flight, are judged on relevant cells that were not observed. Of
Waterberry, rows of 25,000 readings are judged. All estimators get the same readings. Numbers are means over
environments; in brackets is their interval of 95 %.

Examples::

    python benchmarks/calibration.py --farms miniberry-30 --environments 20
    python benchmarks/calibration.py --farms waterberry --estimators gp-mean,gp --environments 1
"""

from __future__ import annotations

import argparse
import math
import sys

import numpy as np
from epidemic_estimator import flown_cells
from gp_scale import BATTERY, DAY, look, rows_over_waterberry, truth_of, unseen
from numpy.typing import NDArray

from sensors.estimators import Estimator, make_estimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.calibration import SICK_BELOW, calibration
from sensors.scoring.score import RunningScore
from wbf_mission.bench.intervals import mean_interval

PLANNERS = ("lawnmower", "spiral", "random-waypoint")
ESTIMATORS = ("gp-mean", "gp", "epidemic")
OF_DISEASES = ("brier", "log_loss", "ece", "sick_held", "healthy_held")
OF_OTHERS = ("held", "error")
_NORMAL_90 = 1.6449


def make(name: str) -> Estimator:
    """Make an estimator by the benchmark's name for it: `gp-mean` states no classes."""
    return make_estimator("gp", states="mean") if name == "gp-mean" else make_estimator(name)


def flights(farm: str, seed: int, parts: list[float]) -> list[NDArray[np.int64]]:
    """Return the cells that are observed on some flights, and on parts of them."""
    if farm == "waterberry":
        return [rows_over_waterberry(BATTERY)[:BATTERY]]
    paths = [flown_cells(farm, planner, seed) for planner in PLANNERS]
    return [path[: round(part * len(path))] for path in paths for part in parts]


def judge(name: str, seen: Observations, farm: str, seed: int) -> dict[str, float]:
    """Return the calibration and the losses of one estimate."""
    grid, environment = truth_of(farm, seed)
    truth, cells = np.asarray(environment.values(DAY)), unseen(grid, seen)
    model = make(name).fit(grid, seen).predict()
    told = calibration(model, truth, cells, PAPER_FIELDS)
    losses = RunningScore(truth, PAPER_FIELDS.masks(grid)).evaluate(model).field_loss
    for k, field in enumerate(PAPER_FIELDS):
        told[f"{field.name}_loss"] = losses[k]
        sick = cells[k] & (truth[k] < SICK_BELOW)
        if field.kind == "disease" and sick.any():
            reach = _NORMAL_90 * model.uncertainty[k][sick]
            told[f"{field.name}_interval"] = float(np.mean(np.abs(model.value[k] - truth[k])[sick] <= reach))
    return told


def interval(values: list[float]) -> str:
    """Return mean and interval of 95 % in words."""
    found = mean_interval(np.array(values))
    return f"{found.mean:.4f}" + (
        f" ({found.low:.4f} to {found.high:.4f})" if math.isfinite(found.low) else ""
    )


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--farms", default="miniberry-30,miniberry-100")
    parser.add_argument("--estimators", default=",".join(ESTIMATORS))
    parser.add_argument("--environments", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=2000)
    parser.add_argument("--parts", default="0.3,1", help="of the flights")
    options = parser.parse_args()
    parts, names = [float(part) for part in options.parts.split(",")], options.estimators.split(",")
    for farm in options.farms.split(","):
        found: dict[str, list[dict[str, float]]] = {name: [] for name in names}
        for seed in range(options.first_seed, options.first_seed + options.environments):
            _, environment = truth_of(farm, seed)
            readings = [look(environment, cells) for cells in flights(farm, seed, parts)]
            for name in names:
                each = [judge(name, seen, farm, seed) for seen in readings]
                keys = dict.fromkeys(key for one in each for key in one)
                means = {key: float(np.nanmean([one.get(key, math.nan) for one in each])) for key in keys}
                found[name].append(means)
        for field in PAPER_FIELDS:
            columns = ("loss", *(("interval", *OF_DISEASES) if field.kind == "disease" else OF_OTHERS))
            print(f"\n{farm}, {field.name}\n{'':<10}" + "".join(f"{column:>28}" for column in columns))
            for name, means in found.items():
                values = (
                    [one.get(f"{field.name}_{column}", math.nan) for one in means] for column in columns
                )
                print(f"{name:<10}" + "".join(f"{interval(one):>28}" for one in values), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
