import numpy as np
import pytest

from mission.errors import PlanningError
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event
from mission.policies.policy import FixedPlan, Triggers, policy_names
from wbf_mission import check_policy

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
    """A lawnmower that can be bent."""

    triggers = Triggers(observations=20)

    def start(self):
        self.asked = 0
        self.plan = FixedPlan("lawnmower")

    def decide(self, observation):
        self.asked += 1
        return self.plan.decide(observation)


class _OverBudget(_Rows):
    def decide(self, observation):
        ends = np.array([[0.2, 0.2], [8.0, 8.0]])
        return Decision({one.system_id: np.tile(ends, (40, 1)) for one in observation.steerable})


class _Outside(_Rows):
    def decide(self, observation):
        return Decision({one.system_id: [[-1.0, 1.0]] for one in observation.steerable})


class _NoPath(_Rows):
    def decide(self, observation):
        return NO_CHANGE


class _StaysAtHome(_Rows):
    def decide(self, observation):
        return Decision({one.system_id: np.empty((0, 2)) for one in observation.steerable})


class _GoesNowhere(_Rows):
    """Has a path of no length where it does not like its seed."""

    def decide(self, observation):
        if observation.event is Event.START and observation.vehicles[0].request.seed.entropy % 2:
            return Decision({one.system_id: [one.request.start_xy_m] for one in observation.vehicles})
        return super().decide(observation)


class _LastOneStays(_Rows):
    """Of a fleet, the last vehicle has nothing to do that is worth it."""

    def decide(self, observation):
        plan = super().decide(observation)
        if observation.event is not Event.START or len(plan.paths) < 2:
            return plan
        return Decision({**plan.paths, max(plan.paths): np.empty((0, 2))})


class _Strangers(_Rows):
    def decide(self, observation):
        plan = super().decide(observation)
        return plan if observation.event is Event.START else Decision({99: [[1.0, 1.0]]})


class _Restless(_Rows):
    def __init__(self):
        self.flights = 0

    def start(self):
        super().start()
        self.flights += 1

    def decide(self, observation):
        if observation.event is Event.START or self.flights % 2:
            return super().decide(observation)
        return Decision({one.system_id: one.rest_m[:1] for one in observation.steerable if len(one.rest_m)})


class _Drawer(_Rows):
    def decide(self, observation):
        np.random.random()  # noqa: NPY002
        return super().decide(observation)


class _Writer(_Rows):
    def decide(self, observation):
        observation.model.value[0] = 0.0
        return super().decide(observation)


class _Silent(_Rows):
    """Says nothing before a later flight."""

    def decide(self, observation):
        return NO_CHANGE if len(observation.observations) else super().decide(observation)


class _NoDecision(_Rows):
    def decide(self, observation):
        return dict(super().decide(observation).paths)


class _Seer(_Rows):
    """Knows the truth by the back door: whether cells that nobody looked at are sick."""

    def decide(self, observation):
        import sys

        frame = sys._getframe()
        while "self" not in frame.f_locals or not hasattr(frame.f_locals["self"], "_truth"):
            frame = frame.f_back
        sick = float(frame.f_locals["self"]._truth.mean())
        plan = super().decide(observation)
        return Decision({key: points + 0.01 * sick for key, points in plan.paths.items()})


@pytest.mark.parametrize(
    ("policy", "text"),
    [
        (_OverBudget(), "over the budget"),
        (_Outside(), "leaves its area"),
        (_NoPath(), "vehicle 1 is not named at the start"),
        (_StaysAtHome(), "no vehicle has a path at the start of the first flight"),
        (_GoesNowhere(), "no path of the first flight has a length"),
        (_Silent(), "vehicle 1 gets neither a path nor one without points"),
        (_Strangers(), "no vehicle has the system id 99"),
        (_Restless(), "twice has different answers"),
        (_Drawer(), "global generator"),
        (_Writer(), "writes into its observation"),
        (_NoDecision(), "not a Decision"),
        (_Seer(), "cells that nobody looked at"),
    ],
)
def test_the_kit_finds_what_is_wrong(policy, text):
    with pytest.raises(AssertionError, match=text):
        check_policy(policy)


def test_of_a_fleet_one_may_stay():
    assert check_policy(_LastOneStays()).decisions > 0


def test_what_is_no_policy_is_refused():
    with pytest.raises(PlanningError, match="is no policy"):
        check_policy(object())
