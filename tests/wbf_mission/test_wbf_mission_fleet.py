"""Several vehicles in one run: where they start, how they keep apart, what they share, what fails."""

import json

import numpy as np
import pytest
from sweeps import slow

from geo import get_farm
from geo.errors import WbfMissionError
from mission.files import read_mission
from mission.outcome import Outcome
from wbf_mission import Scenario, Simulated, fly, load_result
from wbf_mission.addons.rl.task import SurveyTask
from wbf_mission.cli.app import main
from wbf_mission.planning.fleet import single_vehicles
from wbf_mission.run.plan import plan, plan_fleet
from wbf_mission.run.resolve import resolve
from wbf_mission.run.reuse import FlightMemory
from wbf_mission.scenario import ScenarioError, scenario_with
from wbf_mission.scenario.values import Separation, parse_separation

QUADS = {"farm": "miniberry-30", "vehicle": "quad", "estimator": "point", "planner": "spiral"}
ROBOTS = {"farm": "miniberry-10", "vehicle": "ideal", "estimator": "point", "planner": "lawnmower"}


def run(*arguments):
    return main(list(arguments))


def test_ways_to_keep_apart_are_read():
    assert parse_separation("distance: 5 m") == Separation("distance", 5.0)
    assert parse_separation("NONE") == Separation("none")
    for bad in ("5m", "layers", "layers:", "layers:0m", "layers:nan", "distance:1e9m", "none:2m", "rows:2"):
        with pytest.raises(ScenarioError, match=r"separation .* cannot be read"):
            Scenario(separation=bad)


def test_each_flying_vehicle_has_a_layer_and_comes_home_in_it():
    mixed = Scenario(
        vehicle="quad,ideal,quad,rover,mapping-quad", separation="layers:3m", estimate_errors=False
    )
    singles = single_vehicles(mixed)
    heights = [one.mission.altitude_m for one in singles]
    assert heights[:4] == [10.0, None, 13.0, None] and heights[4] >= 16.0
    assert [one.vehicle.parameters.get("RTL_RETURN_ALT") for one in singles] == heights
    ardupilot = single_vehicles(Scenario(vehicle="quad", vehicles=2, autopilot="ardupilot"))
    assert [one.vehicle.parameters for one in ardupilot] == [{"RTL_ALT": 1000.0}, {"RTL_ALT": 1200.0}]
    own = single_vehicles(Scenario(vehicle="quad", vehicles=2, parameters={"RTL_RETURN_ALT": 40.0}))
    assert [one.vehicle.parameters["RTL_RETURN_ALT"] for one in own] == [40.0, 40.0]
    assert single_vehicles(Scenario())[0].mission.altitude_m is None
    with pytest.raises(ScenarioError, match=r"vehicle 3 would fly at 176\.2 m, above 120 m"):
        single_vehicles(Scenario(vehicle="quad", vehicles=3, separation="layers:80m"))


def test_layers_are_farther_apart_by_what_vehicles_err_about_their_heights():
    def heights(**options):
        return [one.mission.altitude_m for one in single_vehicles(Scenario(**options))]

    assert heights(vehicle="quad", vehicles=4) == [10.0, 15.1, 20.2, 25.3]
    assert heights(vehicle="quad", vehicles=3, estimate_errors=False) == [10.0, 12.0, 14.0]
    # Three deviations of the difference: the barometers' errors, at take-off and now, of both.
    apart = np.diff(heights(vehicle="quad", vehicles=2, autopilot="ardupilot", baro_noise_m=0.5))
    assert apart == pytest.approx(2.0 + 3.0 * 2.0 * 0.5)
    rows = [
        one.task.request.start_xy_m
        for one in resolve(Scenario(**QUADS, vehicles=2, gps_noise_m=1.5)).vehicles
    ]
    assert np.hypot(*np.subtract(*rows)) == pytest.approx(4.0 + 3.0 * np.sqrt(2.0) * 1.5, abs=0.1)


def test_vehicles_stand_in_a_row_behind_home():
    farm = get_farm("miniberry-30")
    homes = [one.task.request.start_xy_m for one in resolve(Scenario(**QUADS, vehicles=4)).vehicles]
    assert homes[0] == farm.home_m
    steps = np.diff(homes, axis=0)
    assert np.hypot(*steps.T) == pytest.approx([4.0] * 3)
    centre = np.array([farm.owner_area.centroid.x, farm.owner_area.centroid.y])
    assert (np.diff([np.hypot(*(centre - home)) for home in homes]) > 3.99).all()
    robots = [one.task.request.start_xy_m for one in resolve(Scenario(**ROBOTS, vehicles=3)).vehicles]
    assert robots == [get_farm("miniberry-10").home_m] * 3


@pytest.mark.parametrize(("autopilot", "seed", "errs"), [("ardupilot", 2, True), slow("px4", 3, True)])
def test_layers_keep_vehicles_apart_from_take_off_to_landing(autopilot, seed, errs):
    scenario = Scenario(
        **QUADS,
        budget="80m",
        vehicles=4,
        autopilot=autopilot,
        seed=seed,
        wind_speed_m_s=3.0,
        wind_gust_m_s=1.0,
        estimate_errors=errs,
    )
    result = fly(scenario)
    assert result.outcome is Outcome.COMPLETED
    assert len(result.flights) == 4 and result.least_distance_m > 1.7
    assert result.summary()["least_distance_m"] == result.least_distance_m


def test_a_vehicle_that_fails_gives_its_part_to_the_others():
    scenario = Scenario(**{**QUADS, "planner": "lawnmower"}, vehicles=3)
    whole = fly(scenario)
    broken = fly(scenario, by=Simulated(faults=["motor-failure,vehicle=2,at=airborne,from=30"]))
    assert [one.outcome for one in broken.flights] == [Outcome.COMPLETED, Outcome.CRASHED, Outcome.COMPLETED]
    lost = broken.decisions[-1]
    assert lost.event == "lost" and {one.system_id for one in lost.changes} == {1, 3}
    assert all(one.outcome == "flown" for one in lost.changes)

    def cells(result):
        seen = result.observations
        return len(np.unique(seen.x.astype(int) * 100 + seen.y))

    assert cells(broken) > 0.9 * cells(whole)
    images = [one.camera.images for one in broken.flights]
    assert images[1] < 0.5 * min(images[0], images[2])


def test_a_fleet_is_loaded_as_it_was_saved(tmp_path):
    result = fly(Scenario(**{**QUADS, "farm": "miniberry-10"}, vehicles=2))
    loaded = load_result(result.save(tmp_path / "fleet", plots=False))
    assert [one.plan.vehicle for one in loaded.flights] == [one.plan.vehicle for one in result.flights]
    assert loaded.least_distance_m == result.least_distance_m
    saved = json.loads((tmp_path / "fleet" / "summary.json").read_text())
    assert saved["vehicles"] == 2 and saved["scenario"]["separation"] == "layers:2m"


def test_plans_of_a_fleet_are_those_that_it_flies(tmp_path, capsys):
    short = {**QUADS, "budget": "80m"}
    scenario = Scenario(**short, vehicles=2)
    plans = plan_fleet(scenario)
    assert [one.mission for one in plans] == [one.plan.mission for one in fly(scenario).flights]
    assert plan_fleet(Scenario(**short))[0].mission == plan(Scenario(**short)).mission
    with pytest.raises(ScenarioError, match="2 vehicles: a mission is for one vehicle"):
        plan(scenario)
    with pytest.raises(ScenarioError, match=r"mission x\.plan is for one vehicle, but 2 fly"):
        plan_fleet(Scenario(vehicles=2, mission="x.plan"))
    out = tmp_path / "part.json"
    arguments = ["plan", "--farm", "miniberry-30", "--budget", "80m", "--vehicles", "2", "--json", "--out"]
    assert run(*arguments, str(out)) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["vehicles"] == 2 and [one["vehicle"] for one in told["plans"]] == ["quad", "quad"]
    for one, plan_of_one in zip(told["plans"], plans, strict=True):
        assert read_mission(one["file"]) == plan_of_one.mission
    assert sorted(path.name for path in tmp_path.iterdir()) == ["part-1.json", "part-2.json"]
    assert run(*arguments) == 2  # the files are there already
    assert run(*arguments[:5], "--partition", "voronoi") == 2
    assert "--partition has an effect only with several vehicles" in capsys.readouterr().err


def test_vehicles_of_a_fleet_may_see_different_fields():
    base = Scenario(farm="miniberry-10", vehicle="ideal", vehicles=2, planner="lawnmower", budget="40steps")
    mixed = scenario_with(base, {"camera_fields": ("tylcv", "ccr;soil"), "estimator": "gp"})
    result = fly(mixed)
    seen = ~np.isnan(result.observations.values)
    assert {tuple(row) for row in seen} == {(True, True, False), (False, False, True)}
    fast = fly(mixed, memory=FlightMemory())
    np.testing.assert_array_equal(fast.observations.values, result.observations.values)
    assert [one.sensed for one in SurveyTask(mixed).cameras] == [("tylcv", "ccr"), ("soil",)]
    for fields, text in (
        (("tylcv;ccr;soil",), "vehicles 2, but camera fields are given for 3"),
        (("tylcv;",), "camera fields are empty"),
        (("tylcv;rust",), "unknown field 'rust'"),
    ):
        with pytest.raises(WbfMissionError, match=text):
            resolve(scenario_with(base, {"camera_fields": fields}))
