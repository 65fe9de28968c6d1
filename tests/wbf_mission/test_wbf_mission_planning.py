"""From scenarios to missions within their budgets."""

import json
from dataclasses import replace

import numpy as np
import pytest

from geo.frame import LocalFrame
from mission.errors import PlanningError
from mission.files import write_mission
from mission.model import Command, GeoPoint
from mission.planners import PlannedPath
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import fixed_wing_procedures, with_autopilot
from sim_vehicle.prediction.onward import InFlight, OnwardPredictor
from wbf_mission.cli.app import main
from wbf_mission.planning.budget import FlightTravelCost, LegCosts
from wbf_mission.run.plan import plan
from wbf_mission.scenario import Scenario, ScenarioError, scenario_with


def test_the_default_budget_is_the_battery_less_its_reserve():
    result = plan(Scenario(farm="miniberry-100", planner="lawnmower", vehicle="quad"))
    assert result.prediction.feasible
    assert 0.0 < result.battery_used <= 1.0 - result.vehicle.battery.reserve_fraction + 1e-9


def test_a_time_budget_is_kept_and_used():
    result = plan(Scenario(farm="waterberry", planner="lawnmower", budget="12min"))
    assert 0.6 * 720.0 < result.prediction.duration_s <= 720.0


def test_the_ideal_robot_gets_the_papers_timesteps():
    result = plan(Scenario(farm="miniberry-30", planner="lawnmower", vehicle="ideal"))
    assert result.budget_text.startswith("360 steps")
    assert result.prediction.duration_s <= 360.0
    assert result.battery_used is None


def test_a_length_budget_counts_the_way_home():
    result = plan(Scenario(farm="miniberry-100", planner="spiral", budget="800m"))
    path = np.vstack((result.farm.home_m, result.path_m, result.farm.home_m))
    way_m = np.hypot(*np.diff(path, axis=0).T).sum()
    assert way_m <= 800.0
    assert result.length_m == pytest.approx(way_m, rel=0.05), "predicted, with its corners"


def test_energy_budgets_need_a_vehicle_that_uses_energy():
    with pytest.raises(ScenarioError, match="uses no energy"):
        plan(Scenario(vehicle="ideal", budget="50Wh"))


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_fixed_wing_lands_no_steeper_than_it_can(autopilot):
    result = plan(
        Scenario(
            farm="waterberry",
            planner="lawnmower",
            vehicle="fixed-wing",
            autopilot=autopilot,
            budget="9000m",
            wind_speed_m_s=4.0,
            wind_direction_deg=90.0,
        )
    )
    assert result.prediction.feasible
    items = {item.command: item for item in result.mission.items}
    takeoff, land = items[Command.NAV_TAKEOFF], items[Command.NAV_LAND]
    circle, start = items[Command.NAV_LOITER_TO_ALT], items[Command.DO_LAND_START]
    frame = result.farm.frame
    (x, y), home = frame.from_wgs84(circle.x, circle.y), np.array(result.farm.home_m)
    # The wind comes from the east: it takes off and lands eastwards, the circle south of its end.
    radius_m = circle.param2
    assert radius_m is not None
    approach_m = home[0] - x
    assert y == pytest.approx(home[1] - radius_m, abs=0.05)
    assert frame.from_wgs84(land.x, land.y) == pytest.approx(home, abs=0.05)
    assert frame.from_wgs84(takeoff.x, takeoff.y)[0] > home[0] + 50.0
    limit = fixed_wing_procedures(result.vehicle).limits(result.vehicle).landing_slope
    assert 0.8 * limit < circle.z / approach_m < limit
    assert (start.x != 0.0) == (autopilot == "ardupilot")


def test_a_mission_file_without_a_position_is_refused(tmp_path):
    file = tmp_path / "home.waypoints"
    row = "\t".join(map(str, (0, 1, 3, 20, *[0] * 7, 1)))
    file.write_text(f"QGC WPL 110\n{row}\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="no item of the mission has a position; give"):
        plan(Scenario(farm="miniberry-10", mission=str(file)))


@pytest.mark.parametrize(("autopilot", "suffix"), [("px4", ".plan"), ("ardupilot", ".waypoints")])
def test_every_command_tells_one_length_and_coverage_of_a_plan(tmp_path, capsys, autopilot, suffix):
    """From the planner, from a file, from the check before a flight and from its result."""

    def told(*words):
        assert main([*words, "--autopilot", autopilot, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    farm, estimator = ("--farm", "miniberry-10"), ("--estimator", "point", "--no-files")
    chosen = (*farm, "--planner", "lawnmower", "--budget", "300m")
    file = str(tmp_path / f"rows{suffix}")
    made = told("plan", *chosen, "--out", file)
    length = pytest.approx(made["length_m"], rel=2e-3)
    coverage = pytest.approx(made["coverage"], abs=0.011)  # a cell of a hundred
    checked = told("preflight", file, *farm)
    assert (checked["length_m"], checked["coverage"]) == (length, coverage)
    flown = told("fly", *farm, "--mission", file, *estimator)
    assert (flown["planned_length_m"], flown["predicted_coverage"]) == (length, coverage)
    assert flown["coverage"] == pytest.approx(made["coverage"], abs=0.08)
    assert flown["path_length_m"] == pytest.approx(made["length_m"], rel=0.05)
    # Waypoints of a PX4 hold NaN for what it keeps, those of an ArduPilot do not.
    assert main(["plan", *chosen, "--autopilot", autopilot, "--out", str(tmp_path / "a.waypoints")]) == 0
    assert ("NaN" in (tmp_path / "a.waypoints").read_text()) is (autopilot == "px4")


def test_a_mission_file_without_a_home_begins_at_the_farms(tmp_path):
    scenario = Scenario(farm="miniberry-100", planner="spiral", budget="500m")
    made = plan(scenario)
    path = tmp_path / "mine.json"
    away = tuple(replace(item, x=item.x + 0.005) if item.x else item for item in made.mission.items)
    write_mission(replace(made.mission, items=away, home=None), path)
    homeless = plan(scenario_with(scenario, {"mission": str(path)}))
    home = homeless.farm.frame.to_wgs84(*homeless.farm.home_m)
    write_mission(replace(made.mission, items=away, home=GeoPoint(*home)), path)
    at_home = plan(scenario_with(scenario, {"mission": str(path)}))
    assert homeless.mission.home is None
    assert homeless.prediction.duration_s == pytest.approx(at_home.prediction.duration_s, rel=1e-3)
    assert homeless.prediction.duration_s > made.prediction.duration_s + 100.0
    assert homeless.length_m == pytest.approx(at_home.length_m, abs=0.1)
    assert homeless.length_m > made.length_m + 1000.0


def test_a_planner_is_held_to_its_budget():
    def generous(request):
        return PlannedPath(np.array([[0.0, 0.0], [1e4, 0.0]]), None, "generous")

    def broken(request):
        msg = "left"
        raise KeyError(msg)

    with pytest.raises(PlanningError, match="over the budget of 200 m"):
        plan(Scenario(budget="200m", planner=generous))
    with pytest.raises(PlanningError, match="planner broken failed: KeyError"):
        plan(Scenario(budget="200m", planner=broken))


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_leaving_the_path_that_is_flown_has_its_price_where_the_autopilot_loses_speed(autopilot):
    spec = with_autopilot(get_vehicle("quad"), autopilot)
    predictor = OnwardPredictor(spec, LocalFrame(28.05, -82.15), (0.0, 0.0), altitude_m=10.0, speed_m_s=5.0)
    present = np.array([[80.0, 0.0], [80.0, 40.0]])
    rough = LegCosts(5.0, spec.acceleration_m_s2, (0.0, 0.0), 1.0)
    state = InFlight((40.0, 0.0), 10.0, (5.0, 0.0))
    travel_cost = FlightTravelCost(state, predictor, rough, "s", float, present, autopilot == "ardupilot")
    ahead, aside = np.array([[81.0, 0.0]]), np.array([[40.0, 40.0]])
    prices = [travel_cost.change(path) for path in (present, present + 0.01, ahead, aside)]
    if autopilot == "px4":
        assert prices == [0.0] * 4
        return
    assert prices[:2] == [0.0, 0.0]
    assert 0.5 < prices[2] < prices[3] < 8.0
    # A path that is changed to, and would be gone on with otherwise, is held to the same.
    on = FlightTravelCost(state, predictor, rough, "s", float, ahead, True)
    assert travel_cost.rest([ahead])[0] - on.rest([ahead])[0] > 0.5


def test_a_survey_beyond_a_battery_is_planned_with_an_unlimited_budget():
    survey = {"farm": "waterberry", "planner": "survey:spacing_m=200,angle=0"}
    whole = plan(Scenario(budget="unlimited", **survey))
    assert whole.batteries is not None
    assert whole.batteries >= 1
    assert whole.spacing_m == 200.0
    small = {"farm": "waterberry", "planner": "survey:spacing_m=40,angle=0"}
    with pytest.raises(PlanningError, match="the survey is planned for several flights"):
        plan(Scenario(**small))
    with pytest.raises(ScenarioError, match="planner spiral uses up any budget"):
        Scenario(planner="spiral", budget="unlimited")
    with pytest.raises(ScenarioError, match="policy greedy uses up any budget"):
        Scenario(policy="greedy", budget="Unlimited")


def test_a_policy_plans_the_path_with_which_it_begins():
    asked = {"farm": "miniberry-30", "budget": "5min"}
    first = plan(Scenario(policy="orienteering", **asked))
    assert first.planner == "orienteering"
    assert first.prediction.duration_s <= 300.0
    assert not np.array_equal(first.path_m, plan(Scenario(**asked)).path_m)
    assert np.array_equal(first.path_m, plan(Scenario(policy="orienteering", **asked)).path_m)
