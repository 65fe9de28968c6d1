"""What a policy that follows its observations finds on the full Waterberry farm, against fixed plans.

An estimate of its 30 million plants takes seconds, so none is made: a sick plant counts as known if something
was observed within two cells of it, where a row of healthy plants leaves about a seventh of the doubt. That
is more than any plan knows, and favours the fixed ones, which see single rows of an outbreak. The loss is
what the plants that are not known cost if they are believed healthy, of both diseases by the paper's weights:
``run`` is its mean over 36 times of the whole budget, ``end`` that at its end, both by the loss before
take-off. The last line is a bound: the policy's rows for the whole budget, if all of an outbreak were known,
for nothing, as soon as a row meets it. The paper's robot flies; a battery of the quad is taken as 25 000
steps.

    python benchmarks/waterberry_policies.py --batteries 1 5 --environments 1
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
import shapely
from numpy.typing import NDArray
from policies import DAY, PLANNERS, WEIGHTS, Robot, made
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from geo.farm import Farm
from geo.farms import get_farm
from geo.grid import Crop
from geo.seeds import child_seed, sealed_seed
from mission.planners import CropArea, PlanningRequest, StepBudget
from mission.policies.observation import Event, PolicyObservation
from mission.policies.policy import Policy
from sensors.environment import Environment, generate_environment
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.information import InformationModel

FARM = "waterberry"
STEPS_OF_A_BATTERY = 25_000
TIMES = 36
NEAR = 2
LINK = 5.0
FIRST_SEED = 730_000
POLICY = "refining-lawnmower:coarse=1,every=8"
ROWS = "refining-lawnmower:coarse=1,every=1000000"
"""Asked so seldom that it flies its rows alone."""
BOUND = "its rows, outbreaks known at once"
BARS = {1: (1.0, 1.0), 5: (0.85, 0.80)}


def request_of(farm: Farm, steps: int, seed: int) -> PlanningRequest:
    """Return the task of one vehicle."""
    crops = tuple(
        CropArea(crop, shapely.intersection(farm.crop_area(crop), farm.owner_area))
        for crop in (Crop.TOMATO, Crop.STRAWBERRY)
    )
    budget = StepBudget(float(steps), step_m=farm.cell_size_m)
    return PlanningRequest(
        farm.owner_area, farm.home_m, budget, farm.cell_size_m, crops, sealed_seed(seed, "planner")
    )


def fly(
    farm: Farm, environment: Environment, policy: Policy, model: InformationModel, steps: int, seed: int
) -> NDArray[np.intp]:
    """Fly a policy that does not look at estimates; return the cells that were observed, intp[n, 2]."""
    robot = Robot(1, request_of(farm, steps, seed), farm.cell_size_m)
    cells = np.empty((steps, 2), np.intp)
    values = np.empty((steps, len(PAPER_FIELDS)), np.float32)
    told = 0
    policy.start()

    def ask(event: Event) -> None:
        count = robot.spent
        seen = Observations(
            *cells[:count].T, np.arange(1.0, count + 1.0), np.full(count, DAY), values[:count]
        )
        report = robot.report(count > 0)
        observation = PolicyObservation(
            event, float(count), DAY, farm, PAPER_FIELDS, WEIGHTS, model, seen, (report,), 1.0
        )
        robot.rest = policy.decide(observation).paths.get(1, robot.rest)

    ask(Event.START)
    period = policy.triggers.observations
    while robot.flying:
        robot.step()
        cells[robot.spent - 1] = np.stack(farm.cell_of(*np.array([robot.here]).T), axis=1)[0]
        if period is not None and robot.spent - told >= period:
            x, y = cells[told : robot.spent].T
            values[told : robot.spent] = environment.sample(DAY, x, y)
            told = robot.spent
            if robot.flying:
                ask(Event.OBSERVATIONS)
    return cells[: robot.spent]


def losses(
    cells: NDArray[np.intp], costs: NDArray[np.float64], steps: int, *, whole: bool = False
) -> NDArray[np.float64]:
    """Return what is not known costs at each time, by what it costs before take-off, float64[TIMES].

    With `whole`, all of an outbreak (plants at most `LINK` cells apart) is known as soon as a part of it is.
    """
    first = np.full(costs.shape, steps + 1, np.int32)
    x, y = cells.T
    np.minimum.at(first, (x, y), np.arange(1, len(cells) + 1, dtype=np.int32))
    sick = np.argwhere(costs > 0.0)
    axis = np.arange(-NEAR, NEAR + 1)
    known = np.full(len(sick), steps + 1, np.int32)
    for i in axis:
        for j in axis:
            if i * i + j * j <= NEAR * NEAR:
                near = np.clip(sick + np.array([i, j]), 0, np.array(costs.shape) - 1)
                known = np.minimum(known, first[near[:, 0], near[:, 1]])
    if whole:
        pairs = cKDTree(sick).query_pairs(LINK, output_type="ndarray")
        links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(sick), len(sick)))
        count, outbreak = connected_components(links, directed=False)
        earliest = np.full(count, steps + 1, np.int32)
        np.minimum.at(earliest, outbreak, known)
        known = earliest[outbreak]
    cost = costs[sick[:, 0], sick[:, 1]]
    times = np.round(np.arange(1, TIMES + 1) * steps / TIMES)
    return np.array([cost[known > time].sum() for time in times]) / cost.sum()


def costs_of(farm: Farm, environment: Environment) -> NDArray[np.float64]:
    """Return what each plant costs that is believed healthy, float64[W, H]."""
    grid = farm.grid()
    costs = np.zeros(grid.shape)
    values = environment.values(DAY)
    for k, field in enumerate(PAPER_FIELDS.diseases):
        costs += WEIGHTS.field[k] * WEIGHTS.too_healthy[k] * field.mask(grid) * (1.0 - values[k]) ** 2
    return costs


def main() -> int:
    """Fly all, print the table, and tell whether the bars are held."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--batteries", type=int, nargs="*", default=list(BARS))
    parser.add_argument("--environments", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--policy", default=POLICY)
    options = parser.parse_args()
    farm = get_farm(FARM)
    grid = farm.grid()
    model = InformationModel.uniform(grid.shape, value=(1.0, 1.0, 0.4), uncertainty=1.0)
    names = [*PLANNERS, options.policy, ROWS]
    found = np.empty((len(options.batteries), len(names), options.environments, TIMES))
    for number in range(options.environments):
        seed = options.first_seed + number
        environment = generate_environment(
            grid, days=DAY, seed=child_seed(seed, "environment"), keep_days=[DAY]
        )
        costs = costs_of(farm, environment)
        for row, batteries in enumerate(options.batteries):
            steps = batteries * STEPS_OF_A_BATTERY
            for k, name in enumerate(names):
                cells = fly(farm, environment, made(name), model, steps, seed)
                found[row, k, number] = losses(cells, costs, steps, whole=name == ROWS)
                print(f"{batteries} batteries, seed {seed}, {name}: {len(cells)} steps", flush=True)
    held = True
    for row, batteries in enumerate(options.batteries):
        print(f"\n{FARM}, {batteries} batteries, {options.environments} environments: run | end")
        means = [found[row].mean(axis=(1, 2)), found[row, :, :, -1].mean(axis=1)]
        for k, name in enumerate(names):
            print(f"{BOUND if name == ROWS else name:<38}{means[0][k]:.4f} | {means[1][k]:.4f}")
        bars = BARS.get(batteries, (1.0, 1.0))
        for what, mean, bar in zip(("run", "end"), means, bars, strict=True):
            ours, bound = (float(mean[k] / mean[:-2].min()) for k in (-2, -1))
            held &= ours <= bar
            print(f"by the best fixed: {what} {ours:.3f}, bar {bar:g}, bound {bound:.3f}")
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
