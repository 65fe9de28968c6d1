import numpy as np
import pytest
import shapely

from geo import get_farm
from geo.named import ParameterError
from mission.errors import PlanningError
from mission.planners import LengthBudget, PlanningRequest, StepBudget
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.observation import Event, GeometricTravelCost, PolicyObservation, Status, VehicleReport
from mission.policies.policy import NEVER_AGAIN, FixedPlan, KeepPath, Policy, make_policy
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from sensors.scoring.score import PAPER_WEIGHTS


class _Free:
    def rest(self, paths_m):
        return [0.0] * len(paths_m)

    def legs(self, from_m, to_m):
        return np.zeros((len(from_m), len(to_m)))

    def change(self, points_m):
        return 0.0


def _observation(event=Event.START, status=Status.READY, spent=0.0):
    farm = get_farm("miniberry-10")
    request = PlanningRequest(farm.owner_area, (0.0, 0.0), StepBudget(60.0), seed=3)
    vehicle = VehicleReport(1, request, status, (0.0, 0.0), (0.0, 0.0), 0.1, spent, np.empty((0, 2)), _Free())
    model = InformationModel.uniform(farm.grid().shape, value=(1, 1, 0.4), uncertainty=1)
    seen = Observations.concatenate([], PAPER_FIELDS.names)
    return PolicyObservation(event, 0.0, 6, farm, PAPER_FIELDS, PAPER_WEIGHTS, model, seen, (vehicle,), 0.5)


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


def test_what_is_left_and_who_can_be_steered():
    observation = _observation(status=Status.FLYING, spent=45.0)
    assert observation.vehicle(1).left == 15.0 and observation.steerable == observation.vehicles
    assert _observation(status=Status.FLYING, spent=90.0).vehicle(1).left == 0.0
    for status in (Status.RETURNING, Status.ENDED, Status.LOST):
        assert not _observation(status=status).steerable
    with pytest.raises(PlanningError, match="no vehicle has the system id 4; known system ids: 1"):
        observation.vehicle(4)


def test_policies_are_made_by_name_or_taken_as_they_are():
    policy = FixedPlan("spiral")
    assert make_policy(policy) is policy
    with pytest.raises(PlanningError, match="unknown policy 'nosuch'"):
        make_policy("nosuch")
    with pytest.raises(PlanningError, match="FixedPlan is a class; give an instance of it"):
        make_policy(FixedPlan)
    with pytest.raises(PlanningError, match="policy object is no policy"):
        make_policy(object())
    with pytest.raises(ParameterError, match="already has its parameters"):
        make_policy(policy, planner="lawnmower")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("greedy:longest=x", "policy greedy:longest=x: longest must be a number"),
        ("greedy:acquisition=none", "policy greedy:acquisition=none: acquisition must be a text"),
        ("greedy:every=2.5", "every must be a whole number"),
        ("greedy:every=true", "every must be a whole number"),
        ("orienteering:coordination=3", "coordination must be a text"),
        ("greedy:longest=100000", "Greedy: longest=100000: give a number from 1 to 1000"),
        ("rolling-horizon:beam=0", "RollingHorizon: beam=0: give a number from 1 to 1000"),
        ("orienteering:share=1.5", "share=1.5: give a number from 0 to 1"),
    ],
)
def test_a_parameter_of_another_type_or_out_of_range_is_named(text, told):
    with pytest.raises(ParameterError, match=told):
        make_policy(text)


def test_whole_numbers_are_numbers():
    assert make_policy("greedy:longest=12").longest == 12


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
    farm = get_farm("miniberry-10")
    request = PlanningRequest(farm.owner_area, (0.0, 0.0), LengthBudget(1000.0), seed=1)
    model = InformationModel.uniform(farm.grid().shape, value=(1, 1, 0.4), uncertainty=1)
    seen = Observations.concatenate([], PAPER_FIELDS.names)
    # To and fro over what has been seen.
    rest = np.array([[1.1, 1.0], [1.0, 1.0]] * 10)
    changed = []
    for price in (0.0, 0.01, 1000.0):
        one = VehicleReport(
            1, request, Status.FLYING, (1.0, 1.0), (1.0, 0.0), 0.1, 0.0, rest, _Dear((1.0, 1.0), price)
        )
        for event in (Event.OBSERVATIONS, Event.ENDING):
            observation = PolicyObservation(
                event, 0.0, 6, farm, PAPER_FIELDS, PAPER_WEIGHTS, model, seen, (one,), 0.5
            )
            asked = make_policy(policy)
            asked.start()
            changed.append(1 in asked.decide(observation).paths)
    assert changed == [True, True, True, True, False, True]


def test_a_policy_without_triggers_is_refused():
    class Blind:
        def start(self):
            pass

        def decide(self, observation):
            return NO_CHANGE

    with pytest.raises(PlanningError, match=r"a policy has triggers, start\(\) and decide"):
        make_policy(Blind())
