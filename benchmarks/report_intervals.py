"""How often the 90 % intervals of the farmer's report hold the truth, on farms of many cells.

The farms are square, half tomatoes and half strawberries. One short flight over each environment sees some
rows; the share of sick plants and mean soil, and their intervals, are compared with the truth.

Examples::

    python benchmarks/report_intervals.py --sides 500,1000 --environments 20
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
import shapely
from numpy.typing import NDArray

from geo.farm import Farm, Patch
from geo.farms import get_farm
from geo.grid import Crop
from geo.seeds import child_seed
from sensors.environment import generate_environment
from sensors.estimators import make_estimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from wbf_mission.maps.report import farm_report

DAY = 6


def square_farm(side: int) -> Farm:
    """Return a farm of side x side cells, tomatoes in the west and strawberries in the east."""
    like = get_farm("miniberry-10")
    size_m = side * like.cell_size_m
    halves = (Crop.TOMATO, 0.0, 0.5 * size_m), (Crop.STRAWBERRY, 0.5 * size_m, size_m)
    patches = tuple(
        Patch(crop, crop, like.owner, shapely.box(west, 0.0, east, size_m)) for crop, west, east in halves
    )
    return Farm(f"square-{side}", like.frame, side, side, patches, like.owner, (0.0, 0.0), like.cell_size_m)


def rows(side: int, number: int) -> NDArray[np.int64]:
    """Return the cells of evenly spread rows across both crops, int64[n, 2]."""
    y = ((np.arange(number) + 0.5) * side / number).astype(np.int64)
    return np.stack([np.tile(np.arange(side), number), np.repeat(y, side)], axis=1)


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sides", default="500,1000", help="of the farms, cells")
    parser.add_argument("--rows", type=int, default=6)
    parser.add_argument("--environments", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=3000)
    parser.add_argument("--estimator", default="gp")
    options = parser.parse_args()
    print(
        f"{'side':<6}{'seed':>6}  "
        + "".join(f"{name + ': true':>14}{'told':>22}" for name in PAPER_FIELDS.names)
    )
    for side in map(int, options.sides.split(",")):
        farm = square_farm(side)
        grid = farm.grid()
        masks = PAPER_FIELDS.masks(grid)
        x, y = rows(side, options.rows).T
        n = len(x)
        held = np.zeros(len(PAPER_FIELDS))
        for seed in range(options.first_seed, options.first_seed + options.environments):
            environment = generate_environment(
                grid, days=DAY, seed=child_seed(seed, "environment"), keep_days=[DAY]
            )
            seen = Observations(x, y, np.arange(n), np.full(n, DAY), environment.sample(DAY, x, y))
            model = make_estimator(options.estimator).fit(grid, seen).predict()
            truth = np.asarray(environment.values(DAY))
            line = f"{side:<6}{seed:>6}  "
            for k, told in enumerate(farm_report(farm, model, seen).fields):
                values = truth[k][masks[k]]
                right = float((values < 1.0).mean() if told.kind == "disease" else values.mean())
                assert told.low is not None
                assert told.high is not None
                held[k] += told.low <= right <= told.high
                line += f"{right:>14.5f}{f'{told.expected:.5f} {told.low:.5f}-{told.high:.5f}':>22}"
            print(line, flush=True)
        shares = ", ".join(
            f"{name} {int(number)} of {options.environments}"
            for name, number in zip(PAPER_FIELDS.names, held, strict=True)
        )
        print(f"held on {side} x {side} cells: {shares}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
