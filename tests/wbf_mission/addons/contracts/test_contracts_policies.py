import itertools
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from mission.errors import PlanningError
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event
from mission.policies.policy import FixedPlan, Triggers, policy_names
from wbf_mission import check_policy
from wbf_mission.addons.contracts import policies as kit

OURS = (
    "confidence-guided",
    "greedy",
    "grid-limited-randomness",
    "market",
    "orienteering",
    "refining-lawnmower",
    "rolling-horizon",
)


def test_ours_are_registered():
    assert set(OURS) <= set(policy_names())


@pytest.mark.parametrize("name", OURS)
@pytest.mark.slow
def test_ours_conform(name):
    assert check_policy(name).decisions > 20


def test_planners_conform():
    check_policy(FixedPlan("lawnmower"))


class _Rows:
    """A lawnmower whose answers `change` bends: called with the policy, the observation and the answer."""

    triggers = Triggers(observations=20)

    def __init__(self, change):
        self.change, self.flights = change, 0

    def start(self):
        self.flights += 1
        self.plan = FixedPlan("lawnmower")

    def decide(self, observation):
        return self.change(self, observation, self.plan.decide(observation))


def to_all(points):
    """Answer with the same points for every vehicle."""
    return lambda _, observation, __: Decision({one.system_id: points for one in observation.steerable})


def goes_nowhere(_, observation, plan):
    """A path of no length, if the seed is odd."""
    if observation.event is Event.START and observation.vehicles[0].request.seed.entropy % 2:
        return Decision({one.system_id: [one.request.start_xy_m] for one in observation.vehicles})
    return plan


def strangers(_, observation, plan):
    return plan if observation.event is Event.START else Decision({99: [[1.0, 1.0]]})


def restless(policy, observation, plan):
    if observation.event is Event.START or policy.flights % 2:
        return plan
    return Decision({one.system_id: one.rest_m[:1] for one in observation.steerable if len(one.rest_m)})


def drawer(_, observation, plan):
    np.random.random()  # noqa: NPY002
    return plan


def writer(_, observation, plan):
    observation.model.value[0] = 0.0
    return plan


def seer(policy, observation, plan):
    """Knows the truth by the back door: whether cells that no vehicle observed are sick."""
    import sys

    frame = sys._getframe()
    while "self" not in frame.f_locals or not hasattr(frame.f_locals["self"], "_truth"):
        frame = frame.f_back
    sick = float(frame.f_locals["self"]._truth.mean())
    return Decision({key: points + 0.01 * sick for key, points in plan.paths.items()})


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (to_all(np.tile([[0.2, 0.2], [8.0, 8.0]], (40, 1))), "over the budget"),
        (to_all([[-1.0, 1.0]]), "leaves its area"),
        (lambda *_: NO_CHANGE, "does not name vehicle 1"),
        (to_all(np.empty((0, 2))), "no vehicle has a path at the start of the first flight"),
        (goes_nowhere, "have length 0: no score"),
        (
            lambda _, observation, plan: NO_CHANGE if len(observation.observations) else plan,
            "vehicle 1 gets no path, not even one without points",
        ),
        (strangers, "no vehicle has the system id 99"),
        (restless, "two equal flights have different answers"),
        (drawer, "global generator"),
        (writer, "writes into its observation"),
        (lambda _, __, plan: dict(plan.paths), "not a Decision"),
        (seer, "cells that no vehicle observed"),
    ],
)
def test_the_kit_finds_what_is_wrong(change, text):
    with pytest.raises(AssertionError, match=text):
        check_policy(_Rows(change))


def test_what_is_no_policy_is_refused():
    with pytest.raises(PlanningError, match="is not a policy"):
        check_policy(object())


def test_a_policy_that_is_slower_than_a_flight_allows_is_told_after_one_flight(monkeypatch):
    clock = SimpleNamespace(process_time=partial(next, itertools.count(0.0, 1.25)))
    monkeypatch.setattr(kit, "time", clock)
    with pytest.raises(AssertionError, match=r"computing time: an answer takes 1\.2 of the allowed time"):
        check_policy("greedy")
    assert clock.process_time() < 1000.0
