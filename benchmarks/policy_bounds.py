"""What policies could reach at most: the same robot and steps, told where the estimate is wrong.

An oracle flies by the true loss of the present estimate in place of the expected one: it knows where every
outbreak lies that is not known yet, and goes to where most is to be gained. Everything else is as in
`policies.py`: environments, robot, estimator, steps, score. It is no strict bound, as its search is that of
the policy it is named after; but who has to look for outbreaks first is not expected to come near it.

The second table is for who does not know: rows over the tomatoes, then over the strawberries. When a row
meets an outbreak, a part of its plants and of those beside them is flown over, then all of it is known;
nothing is flown to the rows. What is not met is charged what the estimate before take-off is charged for it,
on average; rows of healthy plants do not lower it. With the part 0 no rows of that distance can do better;
who decides in which order it looks may.

Example::

    python benchmarks/policy_bounds.py --case miniberry-100 --environments 8
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from policies import CASES, DAY, FIRST_SEED, MEASURES, SCORED, STEPS_PER_CELL, WEIGHTS, fly, made, ratio
from scipy import ndimage
from threadpoolctl import threadpool_limits

from geo.farms import get_farm
from geo.seeds import child_seed
from mission.policies.acquisition import ValueMap
from mission.policies.map_policies import Greedy
from mission.policies.observation import PolicyObservation
from sensors.environment import generate_environment
from sensors.estimators import make_estimator
from sensors.fields import PAPER_FIELDS
from sensors.scoring.score import RunningScore

FIXED = ("lawnmower", "adaptive-lawnmower")
AROUND = np.ones((3, 3), np.bool_)
PARTS = (0.0, 1.0 / 3.0, 0.5, 1.0)


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

    def __call__(self, observation: PolicyObservation, /) -> ValueMap:
        """Return the acquisition value of each cell."""
        values = np.zeros(observation.model.shape, np.float32)
        for k, weight in enumerate(observation.weights.field):
            error = observation.model.value[k] - self.truth[k]
            cost = np.where(error > 0.0, WEIGHTS.too_healthy[k], WEIGHTS.too_sick[k])
            values += weight * self.masks[k] * cost * error**2
        return values


def truth_of(farm_name: str, seed: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the true values of an environment, and where they are scored."""
    grid = get_farm(farm_name).grid()
    environment = generate_environment(grid, days=DAY, seed=child_seed(seed, "environment"), keep_days=[DAY])
    return environment.values(DAY), np.stack([field.mask(grid) for field in PAPER_FIELDS])


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows over the tomatoes, then over the strawberries.

    Parameters
    ----------
    tomatoes, strawberries : int
        Cells from row to row.
    between : bool
        The tomatoes are flown twice, the second time in the middle between the rows of the first.
    """

    tomatoes: int
    strawberries: int
    between: bool = False

    def passes(self) -> list[tuple[int, int, int]]:
        """Return each pass: the disease, the first line and the distance to the next."""
        first = [(0, self.tomatoes // 2, self.tomatoes)]
        second = [(0, self.tomatoes - 1, self.tomatoes)] if self.between else []
        return [*first, *second, (1, self.strawberries // 2, self.strawberries)]

    def __str__(self) -> str:
        again = ", then between" if self.between else ""
        return f"{self.tomatoes}{again}; {self.strawberries}"


def rows(
    truth: NDArray[np.float32], masks: NDArray[np.bool_], steps: int, flown: Rows, part: float
) -> NDArray[np.float64]:
    """Return the loss of both diseases at the scored times of rows that know an outbreak when they met it.

    Parameters
    ----------
    truth, masks
        See `TrueLoss`.
    steps : int
    flown : Rows
    part : float
        Of the plants of an outbreak that a row meets, and of those beside them, as far as they have not been
        flown over: the part that is flown over, a step each, before all of the outbreak is known. What is
        known grows evenly meanwhile.

    Returns
    -------
    float64[SCORED]
    """
    cost = [
        WEIGHTS.field[k] * WEIGHTS.too_healthy[k] * masks[k] * (1.0 - truth[k].astype(np.float64)) ** 2
        for k in range(2)
    ]
    outbreaks = [ndimage.label(masks[k] & (truth[k] < 1.0), structure=AROUND)[0] for k in range(2)]
    seen = np.zeros_like(masks[:2])
    met: set[tuple[int, int]] = set()
    clock, left = 0.0, float(sum(one.sum() for one in cost))
    times, losses = [clock], [left]
    for k, first, spacing in flown.passes():
        lines = np.flatnonzero(masks[k].any(axis=0))[first::spacing]
        for number, line in enumerate(lines):
            for cell in np.flatnonzero(masks[k][:, line])[:: 1 if number % 2 == 0 else -1]:
                clock += 1.0
                seen[k, cell, line] = True
                outbreak = int(outbreaks[k][cell, line])
                if outbreak and (k, outbreak) not in met:
                    met.add((k, outbreak))
                    plants = outbreaks[k] == outbreak
                    around = ndimage.binary_dilation(plants, structure=AROUND) & masks[k] & ~seen[k]
                    times.append(clock)
                    losses.append(left)
                    clock += part * np.count_nonzero(around)
                    left -= float(cost[k][plants].sum())
                    times.append(clock)
                    losses.append(left)
                    if part > 0.0:
                        seen[k] |= around
            clock += spacing - 1
    weighed = sum(WEIGHTS.field[k] * np.count_nonzero(masks[k]) for k in range(2))
    scored = np.round(np.arange(1, SCORED + 1) * steps / SCORED)
    return np.asarray(np.interp(scored, times, losses)) / weighed


PLANS = {
    "miniberry-30": (
        Rows(2, 3),
        Rows(3, 2),
        Rows(3, 3),
        Rows(3, 4),
        Rows(4, 2),
        Rows(4, 3),
        Rows(4, 4),
        Rows(5, 3),
    ),
    "miniberry-100": (Rows(4, 4), Rows(5, 4), Rows(6, 4), Rows(8, 4), Rows(10, 4, True), Rows(12, 4, True)),
}
"""Of each farm; denser and wider rows than these are worse."""


def all_healthy(truth: NDArray[np.float32], masks: NDArray[np.bool_]) -> float:
    """Return the loss of both diseases if every plant is believed healthy."""
    weighed = sum(WEIGHTS.field[k] * np.count_nonzero(masks[k]) for k in range(2))
    errors = [masks[k] * (1.0 - truth[k].astype(np.float64)) ** 2 for k in range(2)]
    return float(sum(WEIGHTS.field[k] * WEIGHTS.too_healthy[k] * errors[k].sum() for k in range(2)) / weighed)


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
            oracle.append(fly(case, Greedy(acquisition=TrueLoss(*truth_of(case.farm, seed))), seed).losses)
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
    charged = np.mean([before_take_off(case.farm, seed) for seed in seeds])
    healthy = np.mean([all_healthy(*one) for one in farms])
    print(
        f"before take-off {charged:.4f}, or {healthy:.4f} if all is believed healthy; by the best fixed plan"
    )
    print(f"{'rows':<24}" + "".join(f"{f'{part:.0%} flown':>18}" for part in PARTS))
    for flown in PLANS[case.farm]:
        texts = []
        for part in PARTS:
            losses = charged / healthy * np.array([rows(*one, steps, flown, part) for one in farms])
            texts.append(f"{losses.mean() / best[0]:8.3f} |{losses[:, -1].mean() / best[1]:8.3f}")
        print(f"{flown!s:<24}" + "".join(texts), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
