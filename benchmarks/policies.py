"""Policies against the best fixed plans, flown by the paper's robot: one, or several that share the steps.

Every policy and every fixed planner meets the same environments (day 6, seeds that nothing was tuned or
trained on) with the `epidemic` estimator. The robot moves one cell a step and observes the cell where it
arrives; there is no MAVLink, only the contract of policies. The loss is the paper's weighted one of both
diseases; the soil is neither scored nor sensed. ``run`` is the mean loss over 36 scored times of the whole
budget (the last estimate holds when a path ends early), ``end`` the one at its end, ``expected`` what the
estimator itself expects it to be there: the same on average, but without the luck of whether there is an
outbreak where nobody looked. The best fixed plan of a measure is the best of lawnmower, spiral and
adaptive-lawnmower by that measure; a fleet's fixed plans share the farm in strips. Intervals are 95 %
intervals of the ratio of means, over environments.

Examples::

    python benchmarks/policies.py                                  # the table of one vehicle, Miniberry-30
    python benchmarks/policies.py --cases miniberry-30x2 --policies greedy
    python benchmarks/policies.py --cases miniberry-100 --environments 20 --cache results

The exit code tells whether the bars are held.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from geo.atomic import atomic_write
from geo.farm import Farm
from geo.farms import get_farm
from geo.grid import Crop
from geo.seeds import child_seed, sealed_seed
from mission.errors import PlanningError
from mission.planners import CropArea, PlanningRequest, StepBudget
from mission.policies.decision import Decision
from mission.policies.observation import Event, GeometricTravelCost, PolicyObservation, Status, VehicleReport
from mission.policies.policy import FixedPlan, Policy, make_policy
from sensors.environment import generate_environment
from sensors.estimators import make_estimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.score import PAPER_WEIGHTS, RunningScore
from wbf_mission.bench.intervals import ratio_interval

DAY = 6
SCORED = 36
STEPS_PER_CELL = 0.4
PLANNERS = ("lawnmower", "spiral", "adaptive-lawnmower")
POLICIES = ("greedy", "rolling-horizon", "orienteering", "refining-lawnmower")
MEASURES = ("diseases", "tylcv", "ccr")
WEIGHTS = replace(PAPER_WEIGHTS, field=(*PAPER_WEIGHTS.field[:2], 0.0))
FIRST_SEED = 700_000
WORST_END = 0.03

Losses = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Case:
    """A row of the table: a farm, how many vehicles share the steps, and the bars."""

    farm: str
    vehicles: int
    environments: int
    run: float
    end: float

    @property
    def name(self) -> str:
        """As it is given on the command line."""
        return self.farm if self.vehicles == 1 else f"{self.farm}x{self.vehicles}"


CASES = (
    Case("miniberry-30", 1, 40, 0.80, 0.35),
    Case("miniberry-100", 1, 20, 0.55, 0.40),
    Case("miniberry-30", 2, 40, 0.85, 0.35),
    Case("miniberry-30", 3, 40, 0.90, 0.45),
    Case("miniberry-30", 5, 40, 0.95, 0.60),
)


class Robot:
    """The paper's robot under a policy: one cell a step, the place where it arrives is observed."""

    def __init__(self, system_id: int, request: PlanningRequest, cell_m: float) -> None:
        self.request = request
        self.here = request.start_xy_m
        self.spent = 0
        self.rest = np.empty((0, 2))
        self._id = system_id
        self._cell_m = cell_m
        self._velocity = (0.0, 0.0)

    @property
    def flying(self) -> bool:
        """Whether it has steps and a path left."""
        return len(self.rest) > 0 and self.spent < self.request.budget.limit

    def step(self) -> bool:
        """Move; return whether a waypoint was reached."""
        target = self.rest[0]
        dx, dy = float(target[0]) - self.here[0], float(target[1]) - self.here[1]
        distance = math.hypot(dx, dy)
        reached = distance <= self._cell_m * (1.0 + 1e-9)
        share = 1.0 if reached else self._cell_m / distance
        self._velocity = (dx * share, dy * share)
        self.here = (self.here[0] + self._velocity[0], self.here[1] + self._velocity[1])
        self.spent += 1
        if reached:
            self.rest = self.rest[1:]
        return reached

    def report(self, started: bool) -> VehicleReport:
        """What its telemetry would tell."""
        status = Status.READY if not started else Status.FLYING if self.flying else Status.ENDED
        travel_cost = GeometricTravelCost(self.request.budget, self.here)
        spent = float(self.spent)
        return VehicleReport(
            self._id, self.request, status, self.here, self._velocity, 0.0, spent, self.rest, travel_cost
        )


@dataclass(frozen=True, slots=True)
class Run:
    """What came of one flight."""

    losses: Losses  # [36, MEASURES]
    expected: float  # loss of both diseases that the estimator itself expects at the end
    decisions: int
    seconds: float
    tracks: tuple[NDArray[np.float64], ...] = ()  # of each robot, metres


def request_of(farm: Farm, steps: int, seed: int, number: int = 0) -> PlanningRequest:
    """Return a vehicle's task."""
    crops = tuple(
        CropArea(crop, land)
        for crop in (Crop.TOMATO, Crop.STRAWBERRY)
        if not (land := farm.crop_area(crop)).is_empty
    )
    budget = StepBudget(float(steps), step_m=farm.cell_size_m)
    sealed = sealed_seed(seed, f"planner {number}")
    return PlanningRequest(farm.owner_area, farm.home_m, budget, farm.cell_size_m, crops, sealed)


def diseases_alone(values: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return readings of a camera that does not sense the soil, float32[n, 3]."""
    seen = np.array(values, np.float32)
    seen[:, PAPER_FIELDS.index("soil")] = np.nan
    return seen


def fly(
    case: Case,
    policy: Policy,
    seed: int,
    every: int | None = None,
    make_robot: Callable[[int, PlanningRequest, float], Robot] = Robot,
) -> Run:
    """Fly one environment.

    Parameters
    ----------
    case : Case
    policy : Policy
    seed : int
        Of the environment and of everything drawn.
    every : int, optional
        Ask after so many observations, whatever the policy wants.
    make_robot : callable
        Makes a robot of its system id, its request and the size of a cell in metres.
    """
    farm = get_farm(case.farm)
    grid = farm.grid()
    environment = generate_environment(grid, days=DAY, seed=child_seed(seed, "environment"), keep_days=[DAY])
    running = RunningScore(environment.values(DAY), PAPER_FIELDS.masks(grid))
    cells = np.array([np.count_nonzero(field.mask(grid)) for field in PAPER_FIELDS.diseases])
    weights = np.array(WEIGHTS.field[:2]) * cells
    estimator = make_estimator("epidemic", random_state=child_seed(seed, "estimator")).fit(grid)
    steps = round(STEPS_PER_CELL * farm.owner_cells) // case.vehicles
    robots = [
        make_robot(k + 1, request_of(farm, steps, seed, k), farm.cell_size_m) for k in range(case.vehicles)
    ]
    scored = np.unique(np.round(np.arange(1, SCORED + 1) * steps / SCORED).astype(int))
    seen = Observations.empty()
    model = estimator.predict()
    period = every or policy.triggers.observations
    policy.start()
    spent_s, decisions, fresh, told = 0.0, 0, 0, len(seen)
    parts: list[Observations] = []
    losses = []
    tracks = [[robot.here] for robot in robots]

    def ask(event: Event, step: int) -> None:
        nonlocal spent_s, decisions
        reports = tuple(robot.report(step > 0) for robot in robots)
        observation = PolicyObservation(
            event, float(step), DAY, farm, PAPER_FIELDS, WEIGHTS, model, seen, reports, 1.0
        )
        begin = time.perf_counter()
        answer = policy.decide(observation)
        spent_s += time.perf_counter() - begin
        decisions += 1
        take(answer, reports)

    def take(answer: Decision, reports: tuple[VehicleReport, ...]) -> None:
        for report, robot in zip(reports, robots, strict=True):
            path = answer.paths.get(report.system_id)
            if path is not None:
                cost = report.travel_cost.rest([path])[0]
                assert cost <= report.left + 1e-9, f"{policy}: a path of {cost}, {report.left} are left"
                robot.rest = path

    ask(Event.START, 0)
    for step in range(1, steps + 1):
        flying = [robot for robot in robots if robot.flying]
        reached = [robot.step() for robot in flying]
        for track, robot in zip(tracks, robots, strict=True):
            track.append(robot.here)
        if flying:
            x, y = farm.cell_of(*np.array([robot.here for robot in flying]).T)
            n = len(flying)
            values = diseases_alone(environment.sample(DAY, x, y))
            parts.append(Observations(x, y, np.full(n, float(step)), np.full(n, DAY), values))
        fresh += len(flying)
        due = period is not None and fresh >= period
        waypoint = policy.triggers.waypoints and any(reached)
        if step in scored or ((due or waypoint) and step < steps):
            seen = Observations.concatenate([seen, *parts])
            parts = []
            if len(seen) > told:
                model = estimator.partial_fit(seen[told:]).predict()
                told = len(seen)
        if step in scored:
            found = running.evaluate(model).field_loss[:2]
            losses.append([float(np.average(found, weights=weights)), *found])
        if (due or waypoint) and step < steps:
            fresh = 0
            ask(Event.OBSERVATIONS if due else Event.WAYPOINT, step)
    assert model.expected_loss is not None
    doubts = [float(model.expected_loss[k].sum(dtype=np.float64)) for k in range(len(weights))]
    expected = float(np.dot(WEIGHTS.field[:2], doubts) / weights.sum())
    return Run(np.array(losses), expected, decisions, spent_s, tuple(np.array(track) for track in tracks))


def made(name: str) -> Policy:
    """Make a fixed plan or a policy by its name."""
    return FixedPlan(name) if is_fixed(name) else make_policy(name)


def is_fixed(name: str) -> bool:
    """Return whether a name, maybe with parameters, is a fixed planner's."""
    return name.split(":")[0] in PLANNERS


def run_cached(case: Case, name: str, seed: int, cache: Path | None) -> Run:
    """Fly, or take what was flown before from the folder."""
    key = hashlib.sha256(f"{case.name} {name}".encode()).hexdigest()[:12]
    file = None if cache is None else cache / f"{case.name}-{name.split(':')[0]}-{key}-{seed}.json"
    if file is not None and file.exists():
        kept = json.loads(file.read_text(encoding="utf-8"))
        return Run(np.array(kept["losses"]), kept["expected"], kept["decisions"], kept["seconds"])
    with threadpool_limits(1):
        try:
            done = fly(case, made(name), seed)
        except PlanningError:
            if not is_fixed(name):
                raise
            # The steps of a vehicle are too few for this planner's sparsest path.
            done = Run(np.empty((0, len(MEASURES))), math.nan, 0, 0.0)
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        kept = {
            "losses": done.losses.tolist(),
            "expected": done.expected,
            "decisions": done.decisions,
            "seconds": done.seconds,
        }
        with atomic_write(file) as out:
            out.write(json.dumps(kept))
    return done


def ratio(ours: Losses, theirs: Losses) -> tuple[float, str]:
    """Return our mean by the best of their means, and it with its interval of 95 % in words.

    Parameters
    ----------
    ours : float64[environments]
    theirs : float64[plans, environments]
    """
    found = ratio_interval(ours, theirs[theirs.mean(axis=-1).argmin()])
    return found.mean, f"{found.mean:.3f} ({found.low:.3f}-{found.high:.3f})"


def show(case: Case, runs: dict[str, list[Run]]) -> bool:
    """Print the table of a case; return whether its bars are held by some policy."""
    curves = {name: np.stack([run.losses for run in found]) for name, found in runs.items()}
    print(f"\n{case.name}: {len(next(iter(curves.values())))} environments, losses run | end")
    print(
        f"{'':<34}"
        + "".join(f"{measure:>18}" for measure in MEASURES)
        + f"{'worst end':>12}{'expected':>10}{'ms':>7}"
    )
    for name, curve in curves.items():
        means = [f"{curve[:, :, k].mean():.4f}|{curve[:, -1, k].mean():.4f}" for k in range(len(MEASURES))]
        worst = f"{curve[:, -1, 0].max():.4f}"
        cost = 1e3 * sum(run.seconds for run in runs[name]) / sum(run.decisions for run in runs[name])
        doubt = f"{np.mean([run.expected for run in runs[name]]):.4f}"
        print(
            f"{name:<34.34}"
            + "".join(f"{text:>18}" for text in means)
            + f"{worst:>12}{doubt:>10}{cost:>7.1f}"
        )
    fixed = [name for name in curves if is_fixed(name)]
    held = False
    for name in [name for name in curves if name not in fixed]:
        texts, kept = [], curves[name][:, -1, 0].max() <= WORST_END or case.farm != "miniberry-30"
        for k, measure in enumerate(MEASURES):
            for what, at, bar in (("run", slice(None), case.run), ("end", slice(-1, None), case.end)):
                ours = curves[name][:, at, k].mean(axis=1)
                theirs = np.stack([curves[other][:, at, k].mean(axis=1) for other in fixed])
                value, text = ratio(ours, theirs)
                if measure == "diseases":
                    kept &= value <= bar
                elif measure == "ccr" and case.farm == "miniberry-100" and what == "end":
                    kept &= value <= 1.0
                texts.append(f"{measure} {what} {text}")
        held |= bool(kept)
        print(f"{name:<34.34}{'held' if kept else 'missed':<7}" + "  ".join(texts))
    print(f"bars: run <= {case.run:g}, end <= {case.end:g}")
    return held


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", default="miniberry-30", help="of " + ", ".join(one.name for one in CASES))
    parser.add_argument("--policies", nargs="*", default=list(POLICIES))
    parser.add_argument("--planners", nargs="*", default=list(PLANNERS))
    parser.add_argument("--environments", type=int, help="by default as many as the bar asks for")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument(
        "--cache", type=Path, help="folder of what was flown; what is there is not flown again"
    )
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    known = {case.name: case for case in CASES}
    held = True
    for name in options.cases.split(","):
        case = known[name]
        if options.environments:
            case = replace(case, environments=options.environments)
        seeds = range(options.first_seed, options.first_seed + case.environments)
        names: Sequence[str] = [*options.planners, *options.policies]
        found = Parallel(n_jobs=options.jobs)(
            delayed(run_cached)(case, one, seed, options.cache) for seed in seeds for one in names
        )
        runs = {one: list(found[k :: len(names)]) for k, one in enumerate(names)}
        for one in [one for one, flown in runs.items() if not all(len(run.losses) for run in flown)]:
            print(f"{case.name}: no plan of {one} fits the steps of a vehicle")
            del runs[one]
        held &= show(case, runs)
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
