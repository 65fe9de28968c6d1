"""A planner and an estimator that cheat: they walk over all that they can reach, and look for the truth."""

import sys
import types
from importlib.metadata import EntryPoint, EntryPoints
from typing import Any

import numpy as np
import pytest

from geo import get_farm
from geo.seeds import child_seed, sealed_seed, stream
from mission.planners import make_planner
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event
from mission.policies.policy import Triggers
from sensors.camera.leaf_camera import LeafCamera
from sensors.environment import Environment
from sensors.environment.cache import EnvironmentCache
from sensors.estimators import base
from sensors.estimators.point import PointEstimator
from sensors.fields import PAPER_FIELDS
from sensors.scoring.score import RunningScore
from sim_vehicle.mavlink import SimVehicle
from wbf_mission.flight import fly
from wbf_mission.planning.assignment import SortieNumber
from wbf_mission.planning.fleet import vehicles_of
from wbf_mission.run.estimation import estimator_of
from wbf_mission.run.plan import plan, plan_fleet
from wbf_mission.scenario import Choice, Scenario, choice, scenario_with

FORBIDDEN = (Environment, LeafCamera, RunningScore, SimVehicle, Scenario)
RUN = Scenario(
    farm="miniberry-10", vehicle="quad", budget="3min", estimator="point", seed=9_182_736_455_463_728
)


def reachable(*roots):
    """Return all objects that lead off from some: attributes, slots, items, closures, arguments bound."""
    found = {}
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


def seeds_in(objects):
    numbers = {int(one) for one in objects if isinstance(one, (int, np.integer)) and one >= 0}
    sequences = [one for one in objects if isinstance(one, np.random.SeedSequence)]
    return [*numbers, *(one for one in sequences)]


def finds_truth(objects, grid, truth):
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


def true_state(scenario):
    grid = get_farm(scenario.farm.name).grid()
    made, _ = EnvironmentCache.off().environment(grid, day=6, seed=child_seed(scenario.seed, "environment"))
    return grid, made.values(6)


def plain(objects):
    """Return the values among objects, in the order in which they were found."""
    return [
        (one.shape, one.tobytes()) if isinstance(one, np.ndarray) else one
        for one in objects
        if isinstance(one, (int, float, np.generic, np.ndarray))
    ]


LEARNED = "epidemic" if "epidemic" in base.estimator_names() else "point"
ODD = {
    "calm": {},
    "gusts and errors": {
        "wind_speed_m_s": 3.0,
        "turbulence": "light",
        "gps_noise_m": 0.5,
        "baro_noise_m": 0.5,
        "estimate_errors": True,
    },
    "two quads": {"vehicle": "quad,quad", "separation": "layers:3"},
    "several days": {"vehicle": "ideal", "budget": None, "days": 2, "estimator": LEARNED},
}


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("kind", ["policy", "planner"])
def test_before_anything_was_seen_own_code_is_given_the_same_on_every_seed(odd, kind):
    given = []
    for seed in (RUN.seed, 1):
        cheat = CheatingPolicy() if kind == "policy" else CheatingPlanner()
        shorter = {"budget": "1min", **ODD[odd]}
        scenario = Scenario(**{**RUN.to_dict(), **shorter, "seed": seed, kind: cheat})
        if kind == "policy":
            fly(scenario)
        else:
            plan_fleet(scenario)
        given.append(plain(cheat.seen or reachable(cheat.observations[0])))
    assert len(given[0]) > 8
    assert given[0] == given[1]


def test_own_code_draws_from_a_seed_of_its_own_and_what_is_built_in_from_the_runs():
    def request(seed, **given):
        scenario = Scenario(**{**RUN.to_dict(), "seed": seed, **given})
        (vehicle,) = vehicles_of(scenario, scenario.farm.load(), seed=seed, first_day=6)
        later = vehicle.task.of_sortie(SortieNumber(7, 1, 1, 6))
        return vehicle.task.request.seed.entropy, later.request.seed.entropy

    mine, other = CheatingPolicy(), CheatingPolicy()
    other.seed = 5
    assert request(1, policy="greedy")[0] == request(1)[0] == sealed_seed(1, "planner").entropy
    assert request(1, policy=mine) == request(2, policy=mine) != request(1, policy=other)
    assert request(1, planner=CheatingPlanner()) == request(2, planner=CheatingPlanner())
    assert request(1, policy=mine)[0] != request(1, policy=mine)[1]  # each flight draws anew


def test_an_estimator_of_another_package_draws_from_a_seed_of_its_own(monkeypatch):
    class Drawing(PointEstimator):
        def __init__(self, random_state=None):
            super().__init__()
            self.random_state = random_state

    module = types.ModuleType("somebodys")
    module.Drawing = Drawing
    monkeypatch.setitem(sys.modules, "somebodys", module)
    entry = EntryPoint("drawing", "somebodys:Drawing", "wbf_mission.estimators")
    for where in (base, choice):
        monkeypatch.setattr(where, "entry_points", lambda group: EntryPoints([entry]))
    states = [estimator_of(Choice("drawing"), seed, PAPER_FIELDS) for seed in (1, 2)]
    assert states[0].random_state.entropy == states[1].random_state.entropy


class CheatingPlanner:
    """Keeps what it can reach, and plans as lawnmower does."""

    __name__ = "cheat"

    def __init__(self):
        self.seen = []

    def __call__(self, request):
        self.seen = reachable(request)
        return make_planner("lawnmower")(request)


class CheatingEstimator(PointEstimator):
    """Keeps what it can reach, and estimates as point does."""

    given: list[Any]

    def fit(self, grid, observations=None):
        self.given = [grid, observations]
        super().fit(grid, observations)
        return self

    def partial_fit(self, observations):
        self.given.append(observations)
        super().partial_fit(observations)
        return self


def test_the_cheat_would_find_a_seed_that_is_not_sealed():
    grid, truth = true_state(RUN)
    assert finds_truth(
        reachable({"hidden": [lambda: RUN.seed, child_seed(RUN.seed, "planner")]}), grid, truth
    )


def test_a_planner_reaches_neither_truth_nor_its_seed():
    cheat = CheatingPlanner()
    scenario = Scenario(**{**RUN.to_dict(), "budget": "5Wh", "planner": cheat, "turbulence": "light"})
    plan(scenario)
    assert len(cheat.seen) > 20
    assert not [one for one in cheat.seen if isinstance(one, FORBIDDEN)]
    assert RUN.seed not in [one for one in cheat.seen if isinstance(one, int)]
    assert not finds_truth(cheat.seen, *true_state(RUN))


def test_an_estimator_reaches_neither_truth_nor_its_seed():
    cheat = CheatingEstimator()
    result = fly(scenario_with(RUN, {"estimator": cheat}))
    seen = reachable(cheat, cheat.given)
    assert len(cheat.given) > 3
    assert not [one for one in seen if isinstance(one, FORBIDDEN)]
    assert not any(one is result.truth for one in seen)
    assert not finds_truth(seen, *true_state(RUN))
    # What it learned from is the camera's word, not a window into the truth.
    assert result.truth is not None
    for one in seen:
        assert not (isinstance(one, np.ndarray) and np.shares_memory(one, result.truth))


@pytest.mark.parametrize("name", sorted({"epidemic", "gp", "gp-sklearn"} & {*base.estimator_names()}))
def test_an_estimator_that_draws_gets_a_sealed_seed(name):
    estimator = estimator_of(Choice(name), RUN.seed, PAPER_FIELDS)
    if name == "gp-sklearn":
        estimator.fit(RUN.farm.load().grid)
        names = [(), ("environment",), ("planner",), ("estimator",), ("camera",)]
        states = [state for path in names for state in child_seed(RUN.seed, *path).generate_state(8)]
        drawn = [stream(RUN.seed, *path).integers(2**31) for path in names]
        assert vars(estimator)["seed_"] not in {*states, *drawn}, "a stream of the run's seed"
    seen = reachable(estimator)
    assert RUN.seed not in [one for one in seen if isinstance(one, int)]
    assert not finds_truth(seen, *true_state(RUN))


class CheatingPolicy:
    """Keeps every observation that it is told, and goes on along its first path."""

    seed = 0

    def __init__(self):
        self.observations = []
        self.seen = []

    @property
    def triggers(self):
        return Triggers(period_s=4.0)

    def start(self):
        pass

    def decide(self, observation):
        self.observations.append(observation)
        if observation.event is Event.START:
            path = [[0.5, 0.5], [2.5, 0.5], [2.5, 2.5]]
            return Decision({one.system_id: path for one in observation.vehicles})
        return NO_CHANGE


def test_a_policy_that_cheats_finds_nothing():
    policy = CheatingPolicy()
    fly(scenario_with(RUN, {"policy": policy}))
    assert len(policy.observations) > 3
    objects = reachable(*policy.observations)
    assert not [one for one in objects if isinstance(one, FORBIDDEN)]
    assert RUN.seed not in [one for one in objects if isinstance(one, int)]
    grid, truth = true_state(RUN)
    assert not finds_truth(objects, grid, truth)
