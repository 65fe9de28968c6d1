"""Vehicles at one height: later starts, and paths that are not flown because another vehicle is near."""

import numpy as np
import pytest
import shapely
from sweeps import slow

from mission.outcome import Outcome
from mission.planners import LengthBudget, PlanningRequest
from mission.policies.observation import GeometricTravelCost, Status, VehicleReport
from wbf_mission import Scenario, fly
from wbf_mission.replanning.spacing import KeptDistance, least_apart_m
from wbf_mission.run.flight import departure_delays
from wbf_mission.run.plan import plan_fleet
from wbf_mission.scenario import ScenarioError

QUADS = {"farm": "miniberry-30", "vehicle": "quad", "estimator": "point", "separation": "distance:3m"}
SHORT = {**QUADS, "budget": "100m"}


def test_those_who_never_fly_at_the_same_time_are_never_near():
    first = np.array([[0.0, 0.0], [1.0, 0.0]])
    assert least_apart_m(first, first, 30.0) == np.inf
    assert least_apart_m(first, first, 3.0) == 0.0
    assert least_apart_m(first, first + np.array([0.0, 4.0])) == 4.0


@pytest.mark.parametrize(("vehicles", "planner", "seed"), [(2, "lawnmower", 1), slow(3, "spiral", 2)])
def test_a_fleet_at_one_height_keeps_its_distance(vehicles, planner, seed):
    scenario = Scenario(**SHORT, vehicles=vehicles, planner=planner)
    delays = departure_delays(plan_fleet(scenario), 3.0)
    assert delays[0] == 0 and max(delays) > 0
    windy = {"wind_speed_m_s": 3.0, "wind_gust_m_s": 1.0}
    result = fly(Scenario(**SHORT, vehicles=vehicles, planner=planner, seed=seed, **windy))
    assert result.outcome is Outcome.COMPLETED
    assert {one.plan.mission.items[0].z for one in result.flights} == {10.0}
    assert result.least_distance_m is None or result.least_distance_m >= 3.0


def test_who_would_wait_too_long_is_told(monkeypatch):
    plans = plan_fleet(Scenario(**QUADS, vehicles=2))
    monkeypatch.setattr("wbf_mission.run.flight._LATEST_S", 3)
    with pytest.raises(ScenarioError, match="vehicle 2 would wait for more than two hours to keep 50 m"):
        departure_delays(plans, 50.0)


def aloft(number, position, rest, status=Status.FLYING):
    request = PlanningRequest(shapely.box(0, 0, 100, 100), (0.0, 10.0 * number), LengthBudget(1e4))
    travel_cost = GeometricTravelCost(request.budget, position)
    return VehicleReport(number, request, status, position, (0.0, 0.0), 0.0, 0.0, np.array(rest), travel_cost)


def test_a_path_towards_another_vehicle_is_refused():
    kept = KeptDistance(5.0, {1: 5.0, 2: 5.0})
    first = aloft(1, (50.0, 10.0), [(90.0, 10.0)])
    second = aloft(2, (50.0, 90.0), [(90.0, 90.0)])
    across = {2: np.array([(50.0, 12.0), (90.0, 12.0)])}
    meeting = {2: np.array([(90.0, 60.0), (86.0, 10.0)])}
    assert kept.refusals([first, second], {2: np.array([(90.0, 50.0)])}) == {}
    refused = kept.refusals([first, second], {1: first.rest_m, **meeting})
    assert set(refused) <= {2}
    assert set(kept.refusals([first, aloft(2, (50.0, 16.0), [(50.0, 90.0)])], across)) == {2}
    # Who has landed, or keeps no distance, is in nobody's way.
    landed = aloft(1, (50.0, 10.0), [], Status.ENDED)
    near = aloft(2, (50.0, 16.0), [(50.0, 90.0)])
    assert kept.refusals([landed, near], across) == {}
    assert KeptDistance(5.0, {2: 5.0}).refusals([first, near], across) == {}


def test_a_way_out_of_a_narrow_place_is_allowed():
    kept = KeptDistance(5.0, {1: 5.0, 2: 5.0})
    first, second = aloft(1, (50.0, 10.0), [(90.0, 10.0)]), aloft(2, (50.0, 12.0), [(90.0, 11.0)])
    assert kept.refusals([first, second], {2: np.array([(50.0, 90.0)])}) == {}
