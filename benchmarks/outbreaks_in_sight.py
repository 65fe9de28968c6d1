"""How many steps it takes until every outbreak of a farm was met, and what is left to be paid for until then.

Outbreaks of both diseases are drawn by the environment's own model (day 6). The robot flies rows a number of
cells apart over the land of each crop, with a random first row; an outbreak is met when a row leads over one
of its plants. For each distance of the rows the first table tells the steps that they take, how often every
outbreak of the disease is met, what the score charges in the end for those that are not (as if they were
believed healthy; a part of the loss of both diseases), and how often that alone is more than what no run may
end with.

The second table adds, for pairs of distances, the cells of the outbreaks that were met, and beside them, that
are still to be seen, and how often there are steps enough for rows and cells, turns and the ways between them
left out. It is a yardstick for policies that sweep first and then look closer; one that looks closer at once
may leave out rows when it knows of as many outbreaks as there can be.

Example::

    python benchmarks/outbreaks_in_sight.py
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import ndimage

from geo.farms import get_farm
from geo.seeds import stream
from sensors.dynamics.epidemic import EpidemicParameters, simulate_outbreak, value_table
from sensors.fields import PAPER_FIELDS, Field

DAY = 6
STEPS_PER_CELL = 0.4
WORST_END = 0.03
SPACINGS = (2, 3, 4, 5, 6)
AROUND = np.ones((3, 3), np.bool_)


@dataclass(frozen=True, slots=True)
class Sweep:
    """What rows at one distance reach over the land of one crop; arrays are over the farms that were drawn.

    Parameters
    ----------
    steps : float
        Steps of the rows, and of the way from each to the next.
    missed : float64[farms]
        Loss of the outbreaks that were not met, a part of the loss of both diseases.
    all_met : float
        How often there are none.
    finishing : float64[farms]
        Cells of the outbreaks that were met, and beside them, that are not on a row.
    """

    steps: float
    missed: NDArray[np.float64]
    all_met: float
    finishing: NDArray[np.float64]


def sweep(field: Field, farms: int, spacing: int, rng: Generator) -> Sweep:
    """Draw farms and fly rows over them."""
    grid = get_farm("miniberry-30").grid()
    assert isinstance(field.dynamics, EpidemicParameters)
    land = field.mask(grid)
    diseases = PAPER_FIELDS.diseases
    weighed = sum(other.weight * np.count_nonzero(other.mask(grid)) for other in diseases)
    values = np.asarray(value_table(field.dynamics, DAY), np.float64)
    lines = np.flatnonzero(land.any(axis=0))
    missed, finishing, all_met, steps = np.zeros(farms), np.zeros(farms), 0, 0.0
    for number in range(farms):
        onset = simulate_outbreak(land, field.dynamics, DAY, rng)
        value = values[onset.view(np.uint8)]
        rows = lines[int(rng.integers(spacing)) :: spacing]
        seen = np.zeros(land.shape, np.bool_)
        seen[:, rows] = land[:, rows]
        steps += np.count_nonzero(seen) + (rows[-1] - rows[0] - len(rows) + 1)
        outbreaks, count = ndimage.label(value < 1.0, structure=AROUND)
        met = np.isin(outbreaks, np.unique(outbreaks[seen & (outbreaks > 0)])) & (outbreaks > 0)
        lost = (outbreaks > 0) & ~met
        missed[number] = field.weight * field.cost_above * np.sum((1.0 - value[lost]) ** 2) / weighed
        all_met += count == 0 or not lost.any()
        finishing[number] = np.count_nonzero(ndimage.binary_dilation(met, AROUND) & land & ~seen)
    return Sweep(steps / farms, missed, all_met / farms, finishing)


def main() -> int:
    """Print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--farms", type=int, default=2000, help="farms that are drawn for each distance")
    options = parser.parse_args()
    budget = STEPS_PER_CELL * get_farm("miniberry-30").owner_cells
    found = {
        (field.name, spacing): sweep(
            field, options.farms, spacing, stream(0, "outbreaks in sight", f"{field.name} {spacing}")
        )
        for field in PAPER_FIELDS.diseases
        for spacing in SPACINGS
    }
    print(f"Miniberry-30, day {DAY}, {options.farms} farms for each row")
    print(f"{'':<8}{'rows apart':>12}{'steps':>8}{'all met':>10}{'missed loss':>13}{f'> {WORST_END:g}':>9}")
    for (name, spacing), one in found.items():
        tail = np.mean(one.missed > WORST_END)
        print(
            f"{name:<8}{spacing:>12}{one.steps:>8.0f}{one.all_met:>10.3f}{one.missed.mean():>13.5f}{tail:>9.4f}"
        )
    print(f"\n{'tylcv':>6}{'ccr':>6}{'rows':>7}{'finishing':>11}{'fits':>7}{'missed loss':>13}{'> 0.03':>9}")
    for one, other in itertools.product(SPACINGS, SPACINGS):
        first, second = found["tylcv", one], found["ccr", other]
        rows = first.steps + second.steps
        work = first.finishing + second.finishing
        missed = first.missed + second.missed
        fits = np.mean(rows + work <= budget)
        print(
            f"{one:>6}{other:>6}{rows:>7.0f}{work.mean():>11.0f}{fits:>7.2f}"
            f"{missed.mean():>13.5f}{np.mean(missed > WORST_END):>9.4f}"
        )
    print(f"budget: {math.floor(budget)} steps")
    return 0


if __name__ == "__main__":
    sys.exit(main())
