import numpy as np
import pytest
import shapely
from policy_observations import observation, report

from geo import get_farm
from geo.named import ParameterError
from mission.errors import PlanningError
from mission.planners import LengthBudget
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event, GeometricTravelCost, Status
from mission.policies.policy import NEVER_AGAIN, FixedPlan, KeepPath, Policy, make_policy

FARM = "miniberry-10"


def _observation(event=Event.START, status=Status.READY):
    return observation(report(farm=FARM, steps=60.0, status=status), farm=FARM, event=event)


def test_a_planner_is_a_policy_that_never_changes_its_mind():
    policy = FixedPlan("spiral")
    assert isinstance(policy, Policy) and policy.triggers == NEVER_AGAIN
    policy.start()
    first = policy.decide(_observation())
    area = get_farm("miniberry-10").owner_area
    assert len(first.paths[1]) > 3 and area.buffer(1e-6).covers(shapely.LineString(first.paths[1]))
    for event in set(Event) - {Event.START}:
        assert policy.decide(_observation(event, Status.FLYING)) is NO_CHANGE


def test_paths_of_a_decision_are_checked_copied_and_read_only():
    mine = np.array([[0.0, 1.0], [2.0, 3.0]])
    decision = Decision({7: mine, 8: []})
    mine[0] = 9.0
    assert decision.paths[7][0].tolist() == [0.0, 1.0] and decision.paths[8].shape == (0, 2)
    with pytest.raises(ValueError, match="read-only"):
        decision.paths[7][0] = 5.0
    for bad in ([[0.0, np.nan]], [1.0, 2.0], [[1.0, 2.0, 3.0]]):
        with pytest.raises(PlanningError, match="vehicle 3: a path must be finite"):
            Decision({3: bad})


def test_policies_are_made_by_name_or_taken_as_they_are():
    policy = FixedPlan("spiral")
    assert make_policy(policy) is policy
    with pytest.raises(PlanningError, match="unknown policy 'nosuch'"):
        make_policy("nosuch")
    with pytest.raises(PlanningError, match="FixedPlan is a class; give an instance of it"):
        make_policy(FixedPlan)
    with pytest.raises(PlanningError, match="policy object is not a policy"):
        make_policy(object())
    with pytest.raises(ParameterError, match="already has its parameters"):
        make_policy(policy, planner="lawnmower")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("greedy:longest=x", "policy greedy:longest=x: longest must be a number"),
        ("greedy:every=2.5", "every must be a whole number"),
        ("orienteering:coordination=3", "coordination must be a text"),
        ("greedy:longest=100000", "Greedy: longest=100000: give a number from 1 to 1000"),
    ],
)
def test_a_parameter_of_another_type_or_out_of_range_is_named(text, told):
    with pytest.raises(ParameterError, match=told):
        make_policy(text)


def test_a_path_from_elsewhere_is_kept():
    policy = KeepPath()
    assert isinstance(policy, Policy) and policy.triggers == NEVER_AGAIN
    assert all(policy.decide(_observation(event)) is NO_CHANGE for event in Event)


class _Dear:
    """The travel cost of a vehicle that loses time when its path is changed."""

    def __init__(self, position_m, price):
        travel_cost = GeometricTravelCost(LengthBudget(1000.0), position_m)
        self.rest, self.legs, self._price = travel_cost.rest, travel_cost.legs, price

    def change(self, points_m):
        return self._price


@pytest.mark.parametrize("policy", ["greedy", "rolling-horizon"])
def test_a_path_is_left_only_for_one_that_gains_more_than_the_change_costs(policy):
    flying = {"farm": FARM, "budget": LengthBudget(1000.0), "status": Status.FLYING, "here": (1.0, 1.0)}
    # To and fro over what has been seen.
    rest = np.array([[1.1, 1.0], [1.0, 1.0]] * 10)
    changed = []
    for price in (0.0, 0.01, 1000.0):
        vehicle = report(**flying, rest=rest, travel_cost=_Dear((1.0, 1.0), price))
        for event in (Event.OBSERVATIONS, Event.ENDING):
            asked = make_policy(policy)
            asked.start()
            changed.append(1 in asked.decide(observation(vehicle, farm=FARM, event=event)).paths)
    assert changed == [True, True, True, True, False, True]


def test_a_policy_without_triggers_is_refused():
    class Blind:
        def start(self):
            pass

        def decide(self, observation):
            return NO_CHANGE

    with pytest.raises(PlanningError, match=r"a policy has triggers, start\(\) and decide"):
        make_policy(Blind())
