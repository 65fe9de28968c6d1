"""Days 3 to 10 with 100 steps a day: a policy against rows that rotate, belief carried against forgotten.

The paper's robot flies once a day on Miniberry-30; the environment goes on between the days, the `epidemic`
estimator carries forward what it believes. The rows of a day lie between those of the days before: the first
one moves by the golden section of their distance. The loss is the paper's weighted one of both
diseases: ``run`` is its mean over 10 scored times of each day, ``end`` the mean over the ends of the days.
There are rows of the whole farm, and rows of the tomatoes with those of the strawberries every third day; of
each measure the better ones count. Intervals are 95 % intervals of the ratio of means, over
environments.

    python benchmarks/policies_over_days.py --environments 20
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from policies import WEIGHTS, Losses, Robot, diseases_alone, ratio, request_of
from threadpoolctl import threadpool_limits

from geo.farm import Farm
from geo.farms import get_farm
from geo.grid import Crop
from geo.seeds import child_seed
from mission.policies.observation import Event, PolicyObservation
from mission.policies.policy import Policy, make_policy
from sensors.environment import generate_environment
from sensors.estimators import make_estimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.score import RunningScore

FARM = "miniberry-30"
DAYS = range(3, 11)
STEPS = 100
SCORED = 10
FIRST_SEED = 720_000
GOLDEN = 0.618033988749895
BARS = {"carried": (0.80, 0.80), "rows": (0.95, 0.90)}


def rows(farm: Farm, crops: tuple[Crop, ...], turn: int) -> NDArray[np.float64]:
    """Return rows over the land of some crops that take at most the steps of a day, float64[n, 2] metres."""
    bounds = np.array([farm.crop_area(crop).bounds for crop in crops]) / farm.cell_size_m
    x_0, y_0 = bounds[:, :2].min(axis=0) + 0.5
    x_1, y_1 = bounds[:, 2:].max(axis=0) - 0.5
    number = max(1, int((STEPS - (y_1 - y_0)) // (x_1 - x_0)))
    gap = (y_1 - y_0 + 1.0) / number
    heights = y_0 + np.floor(gap * ((turn * GOLDEN) % 1.0 + np.arange(number)))
    path = np.empty((2 * number, 2))
    path[:, 1] = np.repeat(heights, 2)
    path[:, 0] = np.resize([x_0, x_1, x_1, x_0], 2 * number)
    return path * farm.cell_size_m


def all_rows(farm: Farm, turn: int) -> NDArray[np.float64]:
    """Rows over the whole farm."""
    return rows(farm, (Crop.TOMATO, Crop.STRAWBERRY), turn)


def tomato_rows(farm: Farm, turn: int) -> NDArray[np.float64]:
    """Rows over the tomatoes, and over the strawberries on every third day."""
    if turn % 3 == 2:
        return rows(farm, (Crop.STRAWBERRY,), turn // 3)
    return rows(farm, (Crop.TOMATO,), turn - turn // 3)


@dataclass(frozen=True, slots=True)
class Way:
    """How the days are flown: by rows or by a policy; with or without what was believed the days before."""

    rows: Callable[[Farm, int], NDArray[np.float64]] | None
    carried: bool


def fly(way: Way, name: str, seed: int) -> Losses:
    """Fly the days of one environment; return its losses, float64[days, SCORED]."""
    farm = get_farm(FARM)
    grid = farm.grid()
    days = list(DAYS)
    environment = generate_environment(
        grid, days=days[-1], seed=child_seed(seed, "environment"), keep_days=days
    )
    cells = np.array([np.count_nonzero(field.mask(grid)) for field in PAPER_FIELDS.diseases])
    weights = np.array(WEIGHTS.field[:2]) * cells
    policy: Policy | None = make_policy(name) if way.rows is None else None
    if policy is not None:
        policy.start()
    new_estimator = make_estimator("epidemic", random_state=child_seed(seed, "estimator"))
    seen = Observations.empty()
    out = np.empty((len(days), SCORED))
    estimator = new_estimator.fit(grid)
    for turn, day in enumerate(days):
        running = RunningScore(environment.values(day), PAPER_FIELDS.masks(grid))
        if not way.carried:
            estimator, seen = new_estimator.fit(grid), Observations.empty()
        model = estimator.advance(day).predict()
        robot = Robot(1, request_of(farm, STEPS, child_seed(seed, f"day {day}")), farm.cell_size_m)
        if way.rows is not None:
            robot.rest = way.rows(farm, turn)
        parts: list[Observations] = []
        for step in range(STEPS + 1):
            if step and robot.flying:
                robot.step()
                x, y = farm.cell_of(*np.array([robot.here]).T)
                values = diseases_alone(environment.sample(day, x, y))
                parts.append(Observations(x, y, np.array([float(step)]), np.array([day]), values))
            asks = policy is not None and step < STEPS and step % (policy.triggers.observations or STEPS) == 0
            scored = step > 0 and step % (STEPS // SCORED) == 0
            if (asks or scored) and parts:
                new = Observations.concatenate(parts)
                seen, parts = Observations.concatenate([seen, new]), []
                model = estimator.partial_fit(new).predict()
            if scored:
                found = running.evaluate(model).field_loss[:2]
                out[turn, step * SCORED // STEPS - 1] = np.average(found, weights=weights)
            if asks and policy is not None:
                event = Event.OBSERVATIONS if step else Event.START
                report = robot.report(step > 0)
                observation = PolicyObservation(
                    event, float(step), day, farm, PAPER_FIELDS, WEIGHTS, model, seen, (report,), 1.0
                )
                robot.rest = policy.decide(observation).paths.get(1, robot.rest)
    return out


def main() -> int:
    """Fly all ways over the same environments and compare them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--environments", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--policy", default="rolling-horizon")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    ways = {
        "rows": Way(all_rows, True),
        "rows, tomatoes first": Way(tomato_rows, True),
        "rows, forgotten": Way(all_rows, False),
        options.policy: Way(None, True),
        f"{options.policy}, forgotten": Way(None, False),
    }
    seeds = range(options.first_seed, options.first_seed + options.environments)

    def one(way: Way, seed: int) -> Losses:
        with threadpool_limits(1):
            return fly(way, options.policy, seed)

    found = Parallel(n_jobs=options.jobs)(delayed(one)(way, seed) for way in ways.values() for seed in seeds)
    losses = np.stack(found).reshape(len(ways), len(seeds), len(DAYS), SCORED)
    measures = {"run": losses.mean(axis=(2, 3)), "end": losses[..., -1].mean(axis=2)}
    print(f"{FARM}, days {DAYS[0]} to {DAYS[-1]}, {STEPS} steps a day, {len(seeds)} environments")
    for k, name in enumerate(ways):
        print(f"{name:<34}run {measures['run'][k].mean():.4f}  end {measures['end'][k].mean():.4f}")
    held = True
    pairs = (
        (f"{options.policy} by rows", 3, [0, 1], BARS["rows"]),
        (f"{options.policy}, carried by forgotten", 3, [4], BARS["carried"]),
        ("rows, carried by forgotten", 0, [2], BARS["carried"]),
    )
    for text, ours, theirs, bars in pairs:
        for (measure, means), bar in zip(measures.items(), bars, strict=True):
            value, told = ratio(means[ours], means[theirs])
            held &= value <= bar
            print(f"{text}: {measure} {told}, bar {bar:g}")
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
