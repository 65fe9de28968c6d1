"""From scenarios to missions within their budgets."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from sweeps import slow

from geo import get_farm, save_farm
from geo.farm import Farm, Patch
from geo.frame import LocalFrame
from geo.grid import Crop
from mission.errors import PlanningError
from mission.files import write_mission
from mission.model import Command, GeoPoint
from mission.planners import PlannedPath, PlanningRequest
from sim_vehicle.airframe.catalog import get_vehicle
from sim_vehicle.autopilot import fixed_wing_procedures, with_autopilot
from sim_vehicle.prediction.onward import InFlight, OnwardPredictor
from sim_vehicle.prediction.predict import PREDICTION_PAIRS, expected_flights
from wbf_mission.cli import output
from wbf_mission.cli.app import main
from wbf_mission.planning.budget import FlightTravelCost, LegCosts
from wbf_mission.planning.coverage import predicted_coverage
from wbf_mission.run import resolve as resolving
from wbf_mission.run.plan import plan
from wbf_mission.run.resolve import resolve
from wbf_mission.scenario import Scenario, ScenarioError, scenario_with


@pytest.mark.parametrize(
    "planner",
    ["lawnmower", "adaptive-lawnmower", "spiral", slow("random-waypoint")],
)
def test_the_default_budget_is_the_battery_less_its_reserve(planner: str) -> None:
    result = plan(Scenario(farm="miniberry-100", planner=planner, vehicle="quad"))
    assert result.vehicle.battery is not None
    assert result.prediction.feasible
    assert result.battery_used is not None
    assert 0.0 < result.battery_used <= 1.0 - result.vehicle.battery.reserve_fraction + 1e-9


@pytest.mark.parametrize("planner", ["lawnmower", slow("spiral")])
def test_a_time_budget_is_kept_and_used(planner: str) -> None:
    result = plan(Scenario(farm="waterberry", planner=planner, budget="12min"))
    assert result.prediction.duration_s <= 720.0
    assert result.prediction.duration_s > 0.6 * 720.0


def test_the_ideal_robot_gets_the_papers_timesteps() -> None:
    result = plan(Scenario(farm="miniberry-30", planner="lawnmower", vehicle="ideal"))
    assert result.budget_text.startswith("360 steps")
    assert result.prediction.duration_s <= 360.0
    assert result.battery_used is None


def test_a_length_budget_counts_the_way_home() -> None:
    result = plan(Scenario(farm="waterberry", planner="spiral", budget="8000m"))
    home = np.array(result.farm.home_m)
    path = np.vstack((home, result.path_m, home))
    way_m = np.hypot(*np.diff(path, axis=0).T).sum()
    assert way_m <= 8000.0
    assert result.length_m == pytest.approx(way_m, rel=0.01), "predicted, with its corners"


def test_energy_budgets_need_a_vehicle_that_uses_energy() -> None:
    with pytest.raises(ScenarioError, match="uses no energy"):
        plan(Scenario(vehicle="ideal", budget="50Wh"))


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_fixed_wing_lands_no_steeper_than_it_can(autopilot: str) -> None:
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


def test_the_wind_is_part_of_the_prediction() -> None:
    scenario = Scenario(farm="miniberry-100", planner="lawnmower", budget="900m", vehicle="mapping-quad")
    calm, storm = plan(scenario), plan(replace(scenario, wind_speed_m_s=12.0))
    assert storm.prediction.energy_wh != pytest.approx(calm.prediction.energy_wh, rel=0.01)


def test_a_mission_file_without_a_position_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "home.waypoints"
    row = "\t".join(map(str, (0, 1, 3, 20, *[0] * 7, 1)))
    file.write_text(f"QGC WPL 110\n{row}\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="no item of the mission has a position; give"):
        plan(Scenario(farm="miniberry-10", mission=str(file)))


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_every_command_tells_one_length_and_coverage_of_a_plan(tmp_path, capsys, autopilot) -> None:
    """From the planner, from each kind of file, from the check before a flight and from its result."""

    def told(*words: str) -> dict[str, object]:
        assert main([*words, "--autopilot", autopilot, "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    farm, estimator = ("--farm", "miniberry-10"), ("--estimator", "point", "--no-files")
    chosen = (*farm, "--planner", "lawnmower", "--budget", "300m")
    for suffix in (".plan", ".waypoints", ".json"):
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
    flown = told("fly", *chosen, *estimator)
    assert (flown["planned_length_m"], flown["predicted_coverage"]) == (made["length_m"], made["coverage"])


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_coverage_of_a_short_plan_does_not_depend_on_the_step_of_its_track(autopilot) -> None:
    scenario = Scenario(farm="miniberry-10", planner="lawnmower", budget="300m", autopilot=autopilot)
    made = plan(scenario)
    (fine,) = expected_flights(
        [made.mission], made.vehicle, track_step_s=0.05, estimate_errors=True, pairs=PREDICTION_PAIRS
    )
    exact = predicted_coverage(made.farm, made.mission, fine, scenario.camera.footprint)
    assert made.coverage == pytest.approx(exact, abs=0.02)


def test_a_mission_file_without_a_home_begins_at_the_farms(tmp_path: Path) -> None:
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


def test_the_length_of_a_mission_file_counts_from_its_own_home(tmp_path: Path) -> None:
    scenario = Scenario(farm="miniberry-100", planner="spiral", budget="500m", autopilot="ardupilot")
    made = plan(scenario)
    assert made.mission.home is not None
    path = tmp_path / "mine.plan"
    away = tuple(replace(item, x=item.x + 0.005) if item.x else item for item in made.mission.items)
    home = replace(made.mission.home, latitude_deg=made.mission.home.latitude_deg + 0.005)
    write_mission(replace(made.mission, items=away, home=home), path)
    assert plan(scenario_with(scenario, {"mission": str(path)})).length_m == pytest.approx(
        made.length_m, abs=1.0
    )


def test_the_plan_depends_on_the_seed_only() -> None:
    scenario = Scenario(farm="miniberry-100", planner="random-waypoint", budget="400m", seed=5)
    first, second = plan(scenario), plan(scenario)
    assert np.array_equal(first.path_m, second.path_m)
    assert not np.array_equal(first.path_m[:3], plan(replace(scenario, seed=6)).path_m[:3])


def test_a_planner_is_held_to_its_budget() -> None:
    def generous(request: PlanningRequest) -> PlannedPath:
        return PlannedPath(np.array([[0.0, 0.0], [1e4, 0.0]]), None, "generous")

    def broken(request: PlanningRequest) -> PlannedPath:
        msg = "left"
        raise KeyError(msg)

    with pytest.raises(PlanningError, match="over the budget of 200 m"):
        plan(Scenario(budget="200m", planner=generous))
    with pytest.raises(PlanningError, match="planner broken failed: KeyError"):
        plan(Scenario(budget="200m", planner=broken))


@pytest.fixture
def thousand_patches(tmp_path: Path) -> str:
    """A farm file of 1000 patches that do not touch, 7 x 7 cells each."""
    like = get_farm("miniberry-10")
    cell_m = like.cell_size_m
    patches = tuple(
        Patch(
            f"p{number}",
            Crop.TOMATO if number % 2 else Crop.STRAWBERRY,
            like.owner,
            shapely.box(
                (10 * (number % 32) + 1) * cell_m,
                (10 * (number // 32) + 1) * cell_m,
                (10 * (number % 32) + 8) * cell_m,
                (10 * (number // 32) + 8) * cell_m,
            ),
        )
        for number in range(1000)
    )
    file = tmp_path / "many.geojson"
    save_farm(Farm("many", like.frame, 320, 320, patches, like.owner, (0.0, 0.0), cell_m), file)
    return str(file)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("planner", "vehicle", "budget"),
    [
        ("lawnmower", "ideal", "60000steps"),
        ("adaptive-lawnmower", "ideal", "60000steps"),
        ("spiral", "ideal", "60000steps"),
        ("random-waypoint", "quad", None),
    ],
)
def test_a_farm_of_a_thousand_patches_is_planned(
    thousand_patches: str, planner: str, vehicle: str, budget: str | None
) -> None:
    told: list[tuple[str, float, float]] = []
    scenario = Scenario(farm=thousand_patches, planner=planner, vehicle=vehicle, budget=budget)
    result = plan(scenario, progress=lambda *given: told.append(given))
    assert {what for what, _, _ in told} == {"planning"}
    assert len(told) > 1
    assert all(0 <= done <= total > 0 for _, done, total in told)
    assert result.prediction.feasible
    if planner == "random-waypoint":
        return
    path = shapely.LineString(result.path_m)
    assert all(path.intersects(patch.polygon) for patch in result.farm.patches)


@pytest.mark.slow
@pytest.mark.parametrize("planner", ["lawnmower", "adaptive-lawnmower", "spiral"])
def test_a_battery_that_is_too_small_for_a_thousand_patches_is_told_as_that(
    thousand_patches: str, planner: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(output._TELL_AFTER_S, "planning", 0.0)
    command = ["plan", "--farm", thousand_patches, "--planner", planner]
    assert main(command) == 2
    progress, error = capsys.readouterr().err.splitlines()
    assert progress == "planning ..."
    # The battery holds 89.2 Wh: it is empty before the flight is over.
    told = re.fullmatch(
        rf"error: budget of 71\.36 Wh is too small: {planner} with .* needs at least (\S+) Wh .*", error
    )
    assert told is not None and float(told[1]) > 89.2, error
    # A budget beyond the battery is flown in sorties.
    assert main([*command, "--budget", "400Wh"]) == 0
    said = capsys.readouterr()
    assert "sortie" in said.out.lower()


def test_a_file_for_ardupilot_holds_no_nan(tmp_path: Path) -> None:
    for autopilot, has_nan in (("px4", True), ("ardupilot", False)):
        path = tmp_path / f"{autopilot}.waypoints"
        words = [
            "--farm",
            "miniberry-10",
            "--planner",
            "spiral",
            "--autopilot",
            autopilot,
            "--budget",
            "2min",
        ]
        assert main(["plan", *words, "--out", str(path), "-q"]) == 0
        assert ("NaN" in path.read_text()) is has_nan


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


def test_a_survey_beyond_a_battery_is_planned_with_an_unlimited_budget() -> None:
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


def test_a_policy_plans_the_path_with_which_it_begins() -> None:
    asked = {"farm": "miniberry-30", "budget": "5min"}
    first = plan(Scenario(policy="orienteering", **asked))
    assert first.planner == "orienteering"
    assert first.prediction.duration_s <= 300.0
    assert not np.array_equal(first.path_m, plan(Scenario(**asked)).path_m)
    assert np.array_equal(first.path_m, plan(Scenario(policy="orienteering", **asked)).path_m)


def test_a_plan_makes_no_estimator_and_a_run_makes_it_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    def counted(*choice: object) -> object:
        made.append(choice)
        return object()

    monkeypatch.setattr(resolving, "estimator_of", counted)
    scenario = Scenario(farm="miniberry-10", planner="lawnmower", budget="60m")
    plan(scenario)
    planned = resolve(scenario, to_fly=False)
    assert not made
    assert planned.estimator is planned.estimator and len(made) == 1
    resolve(scenario)
    assert len(made) == 2, "before a flight a wrong estimator is found at once"


def test_a_mission_file_is_planned_without_a_task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = plan(Scenario(farm="miniberry-10", planner="lawnmower", budget="60m")).mission
    write_mission(rows, tmp_path / "rows.plan")

    def refuse(*_parts: object, **_options: object) -> None:
        raise PlanningError("a task has a budget, and land to fly over")

    monkeypatch.setattr(resolving, "vehicles_of", refuse)
    scenario = Scenario(farm="miniberry-10", mission=str(tmp_path / "rows.plan"))
    assert plan(scenario).mission.items == rows.items
    with pytest.raises(PlanningError, match="a task has a budget"):
        resolve(scenario)
