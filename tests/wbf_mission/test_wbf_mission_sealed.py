"""A planner and an estimator that cheat: they walk over all that they can reach, and look for the truth."""

import types
from typing import Any

import numpy as np
import pytest

from geo import FarmGrid, get_farm
from geo.seeds import child_seed
from mission.planners import PlannedPath, PlanningRequest, make_planner
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event, PolicyObservation
from mission.policies.policy import Triggers
from sensors.camera.leaf_camera import LeafCamera
from sensors.environment import Environment
from sensors.environment.cache import EnvironmentCache
from sensors.estimators.point import PointEstimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.score import RunningScore
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.flight import fly
from wbf_mission.planning import plan
from wbf_mission.run.estimation import estimator_of
from wbf_mission.scenario import Choice, Scenario

FORBIDDEN = (Environment, LeafCamera, RunningScore, SimVehicle, Scenario)
RUN = Scenario(
    farm="miniberry-10", vehicle="quad", budget="3min", estimator="point", seed=9_182_736_455_463_728
)


def reachable(*roots: Any) -> list[Any]:
    """Return all objects that lead off from some: attributes, slots, items, closures, arguments bound."""
    found: dict[int, Any] = {}
    queue = list(roots)
    while queue:
        one = queue.pop()
        if id(one) in found or isinstance(one, (type, types.ModuleType, str, bytes)):
            continue
        found[id(one)] = one
        if isinstance(one, dict):
            queue += [*one.keys(), *one.values()]
        elif isinstance(one, (list, tuple, set, frozenset)):
            queue += one
        elif isinstance(one, np.ndarray):
            queue.append(one.base)
        for cell in getattr(one, "__closure__", None) or ():
            queue.append(cell.cell_contents)
        for name in ("__defaults__", "__kwdefaults__", "__self__", "__wrapped__", "func", "args", "keywords"):
            value = getattr(one, name, None)
            if not isinstance(value, types.BuiltinFunctionType):
                queue.append(value)
        queue += list(getattr(one, "__dict__", {}).values())
        for kind in type(one).__mro__:
            slots = kind.__dict__.get("__slots__", ())
            for name in (slots,) if isinstance(slots, str) else slots:
                queue.append(getattr(one, name, None))
        if isinstance(one, np.random.SeedSequence):
            queue += [one.entropy, one.spawn_key, one.state]
        if isinstance(one, np.random.Generator):
            queue += [one.bit_generator.seed_seq, one.bit_generator.state]
    return list(found.values())


def seeds_in(objects: list[Any]) -> list[Any]:
    numbers = {int(one) for one in objects if isinstance(one, (int, np.integer)) and one >= 0}
    sequences = [one for one in objects if isinstance(one, np.random.SeedSequence)]
    return [*numbers, *(one for one in sequences)]


def finds_truth(objects: list[Any], grid: FarmGrid, truth: np.ndarray) -> bool:
    """Whether one of the objects is, or gives, the seed of the environment."""
    candidates = seeds_in(objects)
    for seed in candidates:
        roots = [seed] if isinstance(seed, int) else [seed, np.random.SeedSequence(seed.entropy)]
        for root in roots:
            for guess in (root, child_seed(root, "environment")):
                made, _ = EnvironmentCache.off().environment(grid, day=6, seed=guess)
                if np.array_equal(made.values(6), truth):
                    return True
    return False


def true_state(scenario: Scenario) -> tuple[FarmGrid, np.ndarray]:
    grid = get_farm(scenario.farm.name).grid()
    made, _ = EnvironmentCache.off().environment(grid, day=6, seed=child_seed(scenario.seed, "environment"))
    return grid, made.values(6)


class CheatingPlanner:
    """Keeps what it can reach, and plans as lawnmower does."""

    __name__ = "cheat"

    def __init__(self) -> None:
        self.seen: list[Any] = []

    def __call__(self, request: PlanningRequest) -> PlannedPath:
        self.seen = reachable(request)
        return make_planner("lawnmower")(request)


class CheatingEstimator(PointEstimator):
    """Keeps what it can reach, and estimates as point does."""

    given: list[Any]

    def fit(self, grid: FarmGrid, observations: Observations | None = None) -> "CheatingEstimator":
        self.given = [grid, observations]
        super().fit(grid, observations)
        return self

    def partial_fit(self, observations: Observations) -> "CheatingEstimator":
        self.given.append(observations)
        super().partial_fit(observations)
        return self


def test_the_cheat_would_find_a_seed_that_is_not_sealed() -> None:
    grid, truth = true_state(RUN)
    assert finds_truth(
        reachable({"hidden": [lambda: RUN.seed, child_seed(RUN.seed, "planner")]}), grid, truth
    )


@pytest.mark.parametrize("budget", ["3min", "5Wh", "60m"])
def test_a_planner_reaches_neither_truth_nor_its_seed(budget: str) -> None:
    cheat = CheatingPlanner()
    scenario = Scenario(**{**RUN.to_dict(), "budget": budget, "planner": cheat, "turbulence": "light"})
    plan(scenario)
    assert len(cheat.seen) > 20
    assert not [one for one in cheat.seen if isinstance(one, FORBIDDEN)]
    assert RUN.seed not in [one for one in cheat.seen if isinstance(one, int)]
    assert not finds_truth(cheat.seen, *true_state(RUN))


def test_an_estimator_reaches_neither_truth_nor_its_seed() -> None:
    cheat = CheatingEstimator()
    result = fly(RUN, estimator=cheat)
    seen = reachable(cheat, cheat.given)
    assert len(cheat.given) > 3
    assert not [one for one in seen if isinstance(one, FORBIDDEN)]
    assert not any(one is result.truth for one in seen)
    assert not finds_truth(seen, *true_state(RUN))
    # What it learned from is the camera's word, not a window into the truth.
    assert result.truth is not None
    for one in seen:
        assert not (isinstance(one, np.ndarray) and np.shares_memory(one, result.truth))


@pytest.mark.parametrize("name", ["epidemic", "gp"])
def test_an_estimator_that_draws_gets_a_sealed_seed(name: str) -> None:
    seen = reachable(estimator_of(Choice(name), RUN.seed, PAPER_FIELDS))
    assert RUN.seed not in [one for one in seen if isinstance(one, int)]
    assert not finds_truth(seen, *true_state(RUN))


class CheatingPolicy:
    """Keeps every observation that it is told, and goes on along its first path."""

    def __init__(self) -> None:
        self.observations: list[PolicyObservation] = []

    @property
    def triggers(self) -> Triggers:
        return Triggers(period_s=4.0)

    def start(self) -> None:
        pass

    def decide(self, observation: PolicyObservation) -> Decision:
        self.observations.append(observation)
        if observation.event is Event.START:
            return Decision({1: [[0.5, 0.5], [2.5, 0.5], [2.5, 2.5]]})
        return NO_CHANGE


def test_a_policy_that_cheats_finds_nothing() -> None:
    policy = CheatingPolicy()
    fly(RUN, policy=policy)
    assert len(policy.observations) > 3
    objects = reachable(*policy.observations)
    assert not [one for one in objects if isinstance(one, FORBIDDEN)]
    assert RUN.seed not in [one for one in objects if isinstance(one, int)]
    grid, truth = true_state(RUN)
    assert not finds_truth(objects, grid, truth)
