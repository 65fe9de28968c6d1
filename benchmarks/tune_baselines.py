"""Tune the fixed planners on environments not used in tables, and write a specification of the best ones.

Policies that decide in flight are compared with fixed paths. The comparison is fair only if the fixed
planners have their best parameters. `choices` lists the candidates: row direction, least spacing of rows and
rings, and the share of the budget that ``adaptive-lawnmower`` spends on the tomatoes. ``max_spacing_m`` is
not tuned: a path already has the closest rows within the budget, so the parameter can only reject paths.
Candidates with the same path in a scenario are flown once.

In each scenario and with each estimator, all candidates fly the first seeds. The defaults and the best
``--keep`` of each planner and measure then fly the remaining seeds. The best mean over all seeds is chosen
for each planner and measure: ``run`` is the score over the flight, ``end`` the score at the end. Tuning seeds
begin at 910000. Scores are taken at 36 times, even if a scenario scores every step, which would take ten
times as long.

    python benchmarks/tune_baselines.py [--scenarios WBF/Miniberry-30-v1] [--estimators epidemic,gp]
        [--seeds 20] [--first 4] [--keep 2] [--out DIR] [--write missions/bench/tuned.toml]
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from common import options_of

from geo.atomic import atomic_write
from mission.errors import PlanningError
from wbf_mission.addons.base.intervals import Interval, mean_intervals
from wbf_mission.bench.benchmark import benchmark
from wbf_mission.bench.rows import BenchRow
from wbf_mission.bench.spec import BenchSpec
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario, load_scenario, scenario_with
from wbf_mission.scenario.choice import choose

FIRST_SEED = 910_000
SCENARIOS = "WBF/Miniberry-30-Sweep-v1,WBF/Miniberry-30-v1,WBF/Miniberry-100-v1"
ESTIMATORS = "epidemic,gp"
MEASURES = ("run", "end")
DEFAULTS = ("lawnmower", "spiral", "adaptive-lawnmower")
SHARES = (0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9)
# A tiny angle between rows and border costs a row, so the direction of y has all digits.
DIRECTIONS = ("x", repr(math.pi / 2), "longest-side", "fewest-turns")
CELLS_APART = (2, 3, 4, 5)
SCORE_POINTS = 36


@dataclass(frozen=True, slots=True)
class Chosen:
    """Best parameters of a planner for a measure, and the paired improvement over the defaults."""

    scenario: str
    estimator: str
    measure: str
    planner: str
    score: Interval
    gain: Interval


def choices(cell_m: float) -> list[str]:
    """Return the candidates, planners with parameters; the defaults come first."""
    spacings = ["", *(f"min_spacing_m={cells * cell_m:.4g}" for cells in CELLS_APART)]
    directions = ["", *(f"direction={one}" for one in DIRECTIONS)]
    shares = ["", *(f"tomato_share={one}" for one in SHARES)]
    grids = {
        "lawnmower": (directions, spacings),
        "spiral": (spacings,),
        "adaptive-lawnmower": (shares, directions, spacings),
    }
    found = []
    for name, grid in grids.items():
        for given in itertools.product(*grid):
            text = ",".join(filter(None, given))
            found.append(f"{name}:{text}" if text else name)
    return sorted(found, key=lambda one: one not in DEFAULTS)


def distinct(scenario: Scenario, names: Sequence[str]) -> list[str]:
    """Return the candidates with distinct paths within the budget."""
    found: dict[bytes, str] = {}
    for name in names:
        try:
            path = plan(scenario_with(scenario, {"planner": choose(name, "planner")})).path_m
        except PlanningError:
            continue
        found.setdefault(np.round(path, 6).tobytes(), name)
    return list(found.values())


def values(rows: Sequence[BenchRow], planner: str, measure: str) -> dict[int, float]:
    """Return the scores of a planner by seed."""
    name = "score" if measure == "run" else "final_score"
    found = {row.seed: getattr(row, name) for row in rows if row.planner == planner}
    return {seed: value for seed, value in found.items() if value is not None}


def best(rows: Sequence[BenchRow], measure: str, count: int, family: str = "") -> list[str]:
    """Return the best candidates by mean score, best first, among those with the most seeds.

    `family`: name of a planner, to which the result is limited.
    """
    names = dict.fromkeys(row.planner for row in rows if family in ("", row.planner.partition(":")[0]))
    flown = {name: values(rows, name, measure) for name in names}
    most = max((len(one) for one in flown.values()), default=0)
    means = {name: float(np.mean(list(one.values()))) for name, one in flown.items() if len(one) == most}
    return sorted(means, key=lambda name: -means[name])[:count]


def chosen(rows: Sequence[BenchRow]) -> list[Chosen]:
    """Return the best parameters of each planner and measure, from the rows of a scenario and estimator."""
    found = []
    for measure, family in itertools.product(MEASURES, DEFAULTS):
        for winner in best(rows, measure, 1, family):
            mine, theirs = values(rows, winner, measure), values(rows, family, measure)
            gained = np.array([mine[seed] - theirs[seed] for seed in mine if seed in theirs])
            gain, score = mean_intervals([gained, np.array(list(mine.values()))])
            found.append(Chosen(rows[0].scenario, rows[0].estimator, measure, winner, score, gain))
    return found


def specification(found: Sequence[Chosen], seeds: range) -> str:
    """Return the text of a specification with the chosen planners and their measures."""
    lines = [
        "# The fixed planners with the parameters that did best on tuning environments",
        f"# (benchmarks/tune_baselines.py, seeds {seeds[0]} to {seeds[-1]}), to compare policies with.",
        "# wbf-mission bench run missions/bench/tuned.toml --out results",
        f"scenarios = {json.dumps(list(dict.fromkeys(one.scenario for one in found)))}",
        "planners = [",
    ]
    for name in dict.fromkeys(one.planner for one in found):
        lines += [
            f"    # {one.measure} in {one.scenario} with {one.estimator}"
            for one in found
            if one.planner == name
        ]
        lines.append(f"    {json.dumps(name)},")
    estimators = json.dumps(list(dict.fromkeys(one.estimator for one in found)))
    return "\n".join([*lines, "]", f"estimators = {estimators}", "seeds = 40", ""])


def fly(name: str, names: Sequence[str], estimator: str, seeds: range, out: Path | None) -> list[BenchRow]:
    """Fly planners in a scenario; return the rows."""
    scenario = scenario_with(load_scenario(name), {"score_points": SCORE_POINTS})
    planners = tuple(choose(one, "planner") for one in names)
    spec = BenchSpec(((name, scenario),), planners, (choose(estimator, "estimator"),), tuple(seeds))
    return benchmark(spec, out=out)


def tune(
    name: str, estimator: str, names: Sequence[str], seeds: range, given: argparse.Namespace
) -> list[BenchRow]:
    """Fly all candidates on the first seeds, then the best ones and the defaults on the others."""
    early = fly(name, names, estimator, seeds[: given.first], given.out)
    kept = [one for one in names if one in DEFAULTS]
    for measure, family in itertools.product(MEASURES, DEFAULTS):
        kept += best(early, measure, given.keep, family)
    late = fly(name, list(dict.fromkeys(kept)), estimator, seeds[given.first :], given.out)
    return [*early, *late]


def show(rows: Sequence[BenchRow]) -> None:
    """Print the candidates with all seeds, best first."""
    print(f"\n{rows[0].scenario}, {rows[0].estimator}")
    for name in best(rows, "run", len(rows)):
        cells = []
        for measure in MEASURES:
            (one,) = mean_intervals([np.array(list(values(rows, name, measure).values()))])
            cells.append(f"{measure} {one.mean:.4f} ({one.low:.4f} to {one.high:.4f})")
        print(f"  {name:<64} " + "  ".join(cells), flush=True)


def main() -> None:
    """Tune the planners, print the scores, and write the specification."""
    parser = options_of(__doc__)
    parser.add_argument("--scenarios", default=SCENARIOS)
    parser.add_argument("--estimators", default=ESTIMATORS)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=4, help="seeds that all choices fly")
    parser.add_argument("--keep", type=int, default=2, help="how many fly the rest")
    parser.add_argument("--out", type=Path, help="a folder that keeps what was flown")
    parser.add_argument("--write", type=Path, help="the specification to write")
    given = parser.parse_args()
    seeds = range(FIRST_SEED, FIRST_SEED + given.seeds)
    found = []
    for name in given.scenarios.split(","):
        scenario = load_scenario(name)
        names = distinct(scenario, choices(scenario.farm.load().cell_size_m))
        print(f"{name}: {len(names)} different paths", flush=True)
        for estimator in given.estimators.split(","):
            rows = tune(name, estimator, names, seeds, given)
            show(rows)
            found += chosen(rows)
    for one in found:
        score, gain = one.score, one.gain
        print(
            f"{one.scenario} {one.estimator} {one.measure}: {one.planner} {score.mean:.4f}"
            f" ({score.low:.4f} to {score.high:.4f}), {gain.mean:+.4f} ({gain.low:+.4f} to {gain.high:+.4f})"
            " against its defaults"
        )
    if given.write:
        with atomic_write(given.write) as file:
            file.write(specification(found, seeds))


if __name__ == "__main__":
    main()
