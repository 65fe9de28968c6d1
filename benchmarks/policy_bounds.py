"""What policies could reach at most: the same robot and steps, told where the estimate is wrong.

An oracle flies by the true loss of the present estimate in place of the expected one: it knows where every
outbreak lies that is not known yet, and goes to where most is to be gained. Everything else is as in
`policies.py`: environments, robot, estimator, steps, score. It is no strict bound, as its search is that of
the policy it is named after; but who has to look for outbreaks first is not expected to come near it.

The second table is for who does not know: rows over the tomatoes, then over the strawberries, where all of an
outbreak is known, for nothing, as soon as a row meets one of its plants. Nothing is flown for the plants
beside a row, nor to the rows. What is not met is charged what the estimate before take-off is charged for it,
on average; rows of healthy plants do not lower it.
A policy that decides in which order it looks may be better at the start, one that has to see plants before it
knows them is worse.

Example::

    python benchmarks/policy_bounds.py --case miniberry-100 --environments 8
"""

from __future__ import annotations

import argparse
import itertools
import sys
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from policies import CASES, DAY, FIRST_SEED, MEASURES, SCORED, STEPS_PER_CELL, WEIGHTS, fly, made, ratio
from scipy import ndimage
from threadpoolctl import threadpool_limits

from geo.farms import get_farm
from geo.seeds import child_seed
from mission.policies.acquisition import Worth
from mission.policies.greedy import Greedy
from mission.policies.situation import Situation
from sensors.environment import generate_environment
from sensors.estimators import make_estimator
from sensors.fields import PAPER_FIELDS
from sensors.scoring.score import RunningScore

FIXED = ("lawnmower", "adaptive-lawnmower")
SPACINGS = (3, 4, 5, 6, 8)
AROUND = np.ones((3, 3), np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class TrueLoss:
    """What seeing a cell is worth to who knows the truth: the loss that the present estimate is charged.

    Parameters
    ----------
    truth : float32[fields, W, H]
    masks : bool[fields, W, H]
        Where each field is scored.
    """

    truth: NDArray[np.float32]
    masks: NDArray[np.bool_]

    def __call__(self, situation: Situation, /) -> Worth:
        """Return the worth of each cell."""
        worth = np.zeros(situation.model.shape, np.float32)
        for k, weight in enumerate(situation.weights.field):
            error = situation.model.value[k] - self.truth[k]
            cost = np.where(error > 0.0, WEIGHTS.too_healthy[k], WEIGHTS.too_sick[k])
            worth += weight * self.masks[k] * cost * error**2
        return worth


def truth_of(farm_name: str, seed: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the true values of an environment, and where they are scored."""
    grid = get_farm(farm_name).grid()
    environment = generate_environment(grid, days=DAY, seed=child_seed(seed, "environment"), keep_days=[DAY])
    return environment.values(DAY), np.stack([field.mask(grid) for field in PAPER_FIELDS])


def rows(
    truth: NDArray[np.float32], masks: NDArray[np.bool_], steps: int, spacings: tuple[int, int]
) -> NDArray[np.float64]:
    """Return the loss of both diseases at the scored times of rows that know an outbreak when they meet it.

    Parameters
    ----------
    truth, masks
        See `TrueLoss`.
    steps : int
    spacings : tuple of int
        Cells from row to row over the tomatoes, and over the strawberries; 0 for no rows.

    Returns
    -------
    float64[SCORED]
    """
    known = np.full(truth.shape[1:], np.inf)
    clock = 0.0
    losses = np.zeros(SCORED)
    times = np.round(np.arange(1, SCORED + 1) * steps / SCORED)
    weighed = sum(WEIGHTS.field[k] * np.count_nonzero(masks[k]) for k in range(2))
    for k, spacing in enumerate(spacings):
        land, sick = masks[k], masks[k] & (truth[k] < 1.0)
        known[:] = np.inf
        lines = np.flatnonzero(land.any(axis=0))
        flown = lines[spacing // 2 :: spacing] if spacing else lines[:0]
        for number, line in enumerate(flown):
            cells = np.flatnonzero(land[:, line])[:: 1 if number % 2 == 0 else -1]
            known[cells, line] = clock + np.arange(1, len(cells) + 1)
            clock += len(cells) + spacing - 1
        outbreaks, count = ndimage.label(sick, structure=AROUND)
        if not count:
            continue
        met = np.asarray(ndimage.minimum(known, outbreaks, np.arange(1, count + 1)))
        cost = WEIGHTS.field[k] * WEIGHTS.too_healthy[k] * (1.0 - truth[k].astype(np.float64)) ** 2
        charged = np.asarray(ndimage.sum(cost, outbreaks, np.arange(1, count + 1)))
        losses += np.array([charged[met > time].sum() for time in times]) / weighed
    return losses


def before_take_off(farm_name: str, seed: int) -> float:
    """Return the loss of both diseases of the estimate that has seen nothing."""
    grid = get_farm(farm_name).grid()
    truth, masks = truth_of(farm_name, seed)
    model = make_estimator("epidemic", random_state=child_seed(seed, "estimator")).fit(grid).predict()
    found = RunningScore(truth, PAPER_FIELDS.masks(grid)).evaluate(model).field_loss[:2]
    cells = np.array([np.count_nonzero(mask) for mask in masks[:2]])
    return float(np.average(found, weights=np.array(WEIGHTS.field[:2]) * cells))


def main() -> int:
    """Print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--case", default="miniberry-100", help="of " + ", ".join(one.name for one in CASES))
    parser.add_argument("--environments", type=int, default=8)
    parser.add_argument("--farms", type=int, default=100, help="environments of the second table")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    options = parser.parse_args()
    case = next(one for one in CASES if one.name == options.case)
    case = replace(case, environments=options.environments)
    seeds = range(options.first_seed, options.first_seed + options.environments)
    fixed, oracle = [], []
    with threadpool_limits(1):
        for seed in seeds:
            fixed.append([fly(case, made(name), seed).losses for name in FIXED])
            oracle.append(fly(case, Greedy(TrueLoss(*truth_of(case.farm, seed))), seed).losses)
    theirs, ours = np.array(fixed), np.array(oracle)
    print(f"{case.name}: {options.environments} environments; the oracle by the best of {', '.join(FIXED)}")
    best = []
    for k, measure in enumerate(MEASURES):
        texts = []
        for what, at in (("run", slice(None)), ("end", slice(-1, None))):
            plans = theirs[:, :, at, k].mean(axis=2).T
            value, low, high = ratio(ours[:, at, k].mean(axis=1), plans)
            texts.append(f"{what} {ours[:, at, k].mean():.4f}, {value:.3f} ({low:.3f}-{high:.3f})")
            if measure == "diseases":
                best.append(float(plans.mean(axis=1).min()))
        print(f"{measure:<10}" + "   ".join(texts), flush=True)
    steps = round(STEPS_PER_CELL * get_farm(case.farm).owner_cells) // case.vehicles
    print(f"\nrows that know all of an outbreak when they meet it, {options.farms} environments: run | end")
    farms = [truth_of(case.farm, options.first_seed + number) for number in range(options.farms)]
    healthy = np.mean([rows(*one, steps, (0, 0)) for one in farms])
    charged = np.mean([before_take_off(case.farm, seed) for seed in seeds])
    print(f"before take-off {charged:.4f}, or {healthy:.4f} if all is believed healthy")
    print(f"{'tomatoes':>9}{'strawberries':>14}{'run':>9}{'end':>9}{'by fixed':>16}")
    for pair in itertools.product(SPACINGS, SPACINGS):
        losses = np.array([rows(*one, steps, pair) for one in farms])
        run, end = (charged / healthy * part.mean() for part in (losses, losses[:, -1]))
        by_fixed = f"{run / best[0]:.3f} | {end / best[1]:.3f}"
        print(f"{pair[0]:>9}{pair[1]:>14}{run:>9.4f}{end:>9.4f}{by_fixed:>16}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
