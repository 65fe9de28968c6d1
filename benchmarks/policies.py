"""Policies compared with the best fixed plans, flown by the paper's robot: one, or several with shared steps.

All policies and fixed planners fly the same environments (day 6, seeds not used for tuning or training) with
the `epidemic` estimator. The robot moves one cell a step and observes the new cell. MAVLink is not used, only
the policy interface. The loss is the paper's weighted loss of both diseases; the soil is neither scored nor
sensed. ``run`` is the mean loss over 36 times of the whole budget; after an early end of the path, the last
estimate counts. ``end`` is the loss at the end of the budget. The best fixed plan is chosen for each measure.
Fixed plans of a fleet divide the farm into strips. Intervals are 95 % intervals of the ratio of means over
environments.

Examples::

    python benchmarks/policies.py                                  # the table of one vehicle, Miniberry-30
    python benchmarks/policies.py --cases miniberry-30x2 --policies greedy
    python benchmarks/policies.py --cases miniberry-100 --environments 20 --jobs 2
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from common import options_of, print_table
from joblib import Parallel, delayed
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

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
from wbf_mission.addons.base.intervals import ratio_intervals

DAY = 6
SCORED = 36
STEPS_PER_CELL = 0.4
PLANNERS = ("lawnmower", "spiral", "adaptive-lawnmower")
POLICIES = ("greedy", "rolling-horizon", "orienteering", "refining-lawnmower")
MEASURES = ("diseases", "tylcv", "ccr")
WEIGHTS = replace(PAPER_WEIGHTS, field=(*PAPER_WEIGHTS.field[:2], 0.0))
FIRST_SEED = 700_000

Losses = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Case:
    """Farm and number of vehicles that share the steps."""

    farm: str
    vehicles: int

    @classmethod
    def of(cls, name: str) -> Case:
        """Return the case of a name such as miniberry-30x2, two vehicles over Miniberry-30."""
        found = re.fullmatch(r"(.+?)(?:x(\d+))?", name)
        assert found is not None
        return cls(found[1], int(found[2] or 1))


class Robot:
    """Robot of the paper, controlled by a policy: moves one cell a step and observes the new cell."""

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
        """Whether the robot has steps and waypoints remaining."""
        return len(self.rest) > 0 and self.spent < self.request.budget.limit

    def step(self) -> bool:
        """Move one cell; return whether a waypoint was reached."""
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
        """Return the robot's report to the policy, in place of telemetry."""
        status = Status.READY if not started else Status.FLYING if self.flying else Status.ENDED
        travel_cost = GeometricTravelCost(self.request.budget, self.here)
        spent = float(self.spent)
        return VehicleReport(
            self._id, self.request, status, self.here, self._velocity, 0.0, spent, self.rest, travel_cost
        )


@dataclass(frozen=True, slots=True)
class Run:
    """Result of one flight."""

    losses: Losses  # [36, MEASURES]
    decisions: int
    seconds: float
    tracks: tuple[NDArray[np.float64], ...] = ()  # Track of each robot (m)


def request_of(farm: Farm, steps: int, seed: int, number: int = 0) -> PlanningRequest:
    """Return the planning request of a vehicle."""
    crops = tuple(
        CropArea(crop, land)
        for crop in (Crop.TOMATO, Crop.STRAWBERRY)
        if not (land := farm.crop_area(crop)).is_empty
    )
    budget = StepBudget(float(steps), step_m=farm.cell_size_m)
    sealed = sealed_seed(seed, f"planner {number}")
    return PlanningRequest(farm.owner_area, farm.home_m, budget, farm.cell_size_m, crops, sealed)


def fly(case: Case, policy: Policy, seed: int) -> Run:
    """Fly one environment; `seed` determines the environment and all random draws."""
    farm = get_farm(case.farm)
    grid = farm.grid()
    environment = generate_environment(grid, days=DAY, seed=child_seed(seed, "environment"), keep_days=[DAY])
    running = RunningScore(environment.values(DAY), PAPER_FIELDS.masks(grid))
    cells = np.array([np.count_nonzero(field.mask(grid)) for field in PAPER_FIELDS.diseases])
    weights = np.array(WEIGHTS.field[:2]) * cells
    estimator = make_estimator("epidemic", random_state=child_seed(seed, "estimator")).fit(grid)
    steps = round(STEPS_PER_CELL * farm.owner_cells) // case.vehicles
    robots = [Robot(k + 1, request_of(farm, steps, seed, k), farm.cell_size_m) for k in range(case.vehicles)]
    scored = np.unique(np.round(np.arange(1, SCORED + 1) * steps / SCORED).astype(int))
    seen = Observations.empty()
    model = estimator.predict()
    period = policy.triggers.observations
    policy.start()
    spent_s, decisions, fresh, learned = 0.0, 0, 0, len(seen)
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
            values = np.array(environment.sample(DAY, x, y), np.float32)
            values[:, PAPER_FIELDS.index("soil")] = np.nan  # The camera does not sense the soil
            parts.append(Observations(x, y, np.full(n, float(step)), np.full(n, DAY), values))
        fresh += len(flying)
        due = period is not None and fresh >= period
        waypoint = policy.triggers.waypoints and any(reached)
        if step in scored or ((due or waypoint) and step < steps):
            seen = Observations.concatenate([seen, *parts])
            parts = []
            if len(seen) > learned:
                model = estimator.partial_fit(seen[learned:]).predict()
                learned = len(seen)
        if step in scored:
            found = running.evaluate(model).field_loss[:2]
            losses.append([float(np.average(found, weights=weights)), *found])
        if (due or waypoint) and step < steps:
            fresh = 0
            ask(Event.OBSERVATIONS if due else Event.WAYPOINT, step)
    return Run(np.array(losses), decisions, spent_s, tuple(np.array(track) for track in tracks))


def made(name: str) -> Policy:
    """Return a fixed plan or a policy by name."""
    return FixedPlan(name) if is_fixed(name) else make_policy(name)


def is_fixed(name: str) -> bool:
    """Return whether a name, with or without parameters, is that of a fixed planner."""
    return name.split(":")[0] in PLANNERS


def fly_by_name(case: Case, name: str, seed: int) -> Run | None:
    """Fly one environment; None if a fixed planner's sparsest path exceeds a vehicle's steps."""
    with threadpool_limits(1):
        try:
            return fly(case, made(name), seed)
        except PlanningError:
            if not is_fixed(name):
                raise
            return None


def ratio(ours: Losses, theirs: Losses) -> str:
    """Return the ratio of our mean to the best of their means, with 95 % interval, as text.

    Parameters
    ----------
    ours : float64[environments]
    theirs : float64[plans, environments]
    """
    (found,) = ratio_intervals([(ours, theirs[theirs.mean(axis=-1).argmin()])])
    return f"{found.mean:.3f} ({found.low:.3f}-{found.high:.3f})"


def show(name: str, runs: dict[str, list[Run]]) -> None:
    """Print the tables of a case."""
    curves = {who: np.stack([run.losses for run in flown]) for who, flown in runs.items()}
    rows = []
    for who, curve in curves.items():
        row = {"": who}
        for k, measure in enumerate(MEASURES):
            row[f"{measure}: run, end"] = f"{curve[:, :, k].mean():.4f}, {curve[:, -1, k].mean():.4f}"
        decided_ms = 1e3 * sum(run.seconds for run in runs[who]) / sum(run.decisions for run in runs[who])
        rows.append(row | {"worst end": f"{curve[:, -1, 0].max():.4f}", "ms a decision": f"{decided_ms:.1f}"})
    print_table(rows, f"{name}, mean losses")
    if not any(map(is_fixed, curves)):
        return
    fixed = np.stack([curve for who, curve in curves.items() if is_fixed(who)])
    rows = []
    for who in (who for who in curves if not is_fixed(who)):
        row = {"": who}
        for k, measure in enumerate(MEASURES):
            for when, at in (("run", slice(None)), ("end", slice(-1, None))):
                ours, theirs = curves[who][:, at, k].mean(axis=1), fixed[:, :, at, k].mean(axis=2)
                row[f"{measure}, {when}"] = ratio(ours, theirs)
        rows.append(row)
    print_table(rows, f"{name}, by the best fixed plan")


def main() -> None:
    """Fly all cases and print the tables."""
    parser = options_of(__doc__)
    parser.add_argument("--cases", default="miniberry-30", help="farms, with xN for N vehicles; by commas")
    parser.add_argument("--policies", nargs="*", default=list(POLICIES))
    parser.add_argument("--planners", nargs="*", default=list(PLANNERS))
    parser.add_argument("--environments", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.environments)
    names: Sequence[str] = [*options.planners, *options.policies]
    for case_name in options.cases.split(","):
        case = Case.of(case_name)
        found = Parallel(n_jobs=options.jobs)(
            delayed(fly_by_name)(case, name, seed) for seed in seeds for name in names
        )
        runs = {}
        for k, name in enumerate(names):
            flown = [run for run in found[k :: len(names)] if run is not None]
            if len(flown) == len(seeds):
                runs[name] = flown
            else:
                print(f"{case_name}: no plan of {name} fits the steps of a vehicle")
        show(case_name, runs)


if __name__ == "__main__":
    main()
