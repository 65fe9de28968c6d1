"""Surveys of odd fields, and what is said where a plan shows less than was asked."""

from dataclasses import replace

import pytest
import shapely

from geo import Crop, Farm, LocalFrame, Patch, load_farm, save_farm
from mission.model import Command, MissionItem
from wbf_mission.cli.app import main
from wbf_mission.planning.builder import coverage_together
from wbf_mission.planning.coverage import too_little_seen
from wbf_mission.planning.fleet import single_vehicles, vehicles_of
from wbf_mission.preflight.run import check_mission, check_plan
from wbf_mission.preflight.subject import Circumstances
from wbf_mission.run.plan import plan, plan_fleet
from wbf_mission.scenario import Scenario, ScenarioError, scenario_with

SURVEY = {"planner": "survey", "camera_model": "dji-p1-35", "budget": "unlimited"}


def farm_file(folder, *lands):
    bounds = shapely.total_bounds([land for _, land in lands])
    patches = tuple(Patch(crop, crop, "me", land) for crop, land in lands)
    size = (int(bounds[2] / 0.5) + 1, int(bounds[3] / 0.5) + 1)
    save_farm(
        Farm("odd", LocalFrame(28.03, -82.11), *size, patches, "me", (0.0, 0.0), 0.5), folder / "f.geojson"
    )
    return str(folder / "f.geojson")


def asked(file, **options):
    return scenario_with(Scenario(), {"farm": file, **SURVEY, "altitude_m": 50.0, **options})


def test_a_patch_smaller_than_an_image_has_an_image(tmp_path):
    made = plan(asked(farm_file(tmp_path, (Crop.TOMATO, shapely.box(0, 0, 10, 10)))))
    assert made.camera is not None
    assert (made.camera["images"], made.coverage) == (1, 1.0)


def test_what_shows_less_than_was_asked_is_told(tmp_path):
    file = farm_file(tmp_path, (Crop.TOMATO, shapely.box(0, 0, 100, 80)))
    made = plan(asked(file))
    assert made.coverage > 0.99
    blind = tuple(item for item in made.mission.items if item.command != Command.DO_SET_CAM_TRIGG_DIST)
    half = list(made.mission.items)
    half.insert(5, MissionItem(Command.DO_SET_CAM_TRIGG_DIST))

    def codes(items, *, mapping=True):
        given = Circumstances(farm=made.farm, imaging=made.imaging if mapping else None)
        found = check_mission(replace(made.mission, items=items), given).report.findings
        return {one.code for one in found}

    assert "unseen" not in codes(made.mission.items)
    assert "unseen" in codes(blind) and "unseen" in codes(blind, mapping=False)
    assert "unseen" in codes(tuple(half)) and "unseen" not in codes(tuple(half), mapping=False)


def test_a_survey_asks_for_the_whole_and_other_plans_for_something():
    assert too_little_seen(0.0, whole=False) and too_little_seen(0.9, whole=True)
    assert not too_little_seen(0.01, whole=False) and not too_little_seen(0.96, whole=True)


def test_reasons_that_are_true(tmp_path):
    file = farm_file(tmp_path, (Crop.TOMATO, shapely.box(0, 0, 100, 80)))
    none = {"altitude_m": None}
    base = scenario_with(Scenario(), {"farm": file, **SURVEY})
    for changes, reason in (
        ({"gsd_cm": 1.0, "vehicles": 2}, "only one height has this gsd"),
        ({"altitude_m": 50.0, "vehicle": "rover"}, "takes images from the air"),
        ({"gsd_cm": 1.0, "vehicle": "quad,rover"}, "vehicle rover drives"),
        ({"gsd_cm": 1.0, "vehicle": "quad,rover,quad"}, "vehicle rover drives"),
        ({"gsd_cm": 0.01}, "give 0.025 to 1.51 cm"),
    ):
        with pytest.raises(ScenarioError, match=reason):
            plan_fleet(scenario_with(base, {**none, **changes}))
    apart = {"gsd_cm": 1.0, "vehicles": 2, "separation": "distance:5m"}
    assert len(plan_fleet(scenario_with(base, apart))) == 2


def test_a_survey_of_days_is_refused_at_once(tmp_path):
    file = farm_file(tmp_path, (Crop.TOMATO, shapely.box(0, 0, 800, 600)))
    with pytest.raises(ScenarioError, match="hours in the air"):
        plan(scenario_with(Scenario(), {"farm": file, **SURVEY, "gsd_cm": 0.05}))
    narrow = {"planner": "survey:spacing_m=0.01", "gsd_cm": 1.0}
    with pytest.raises(ScenarioError, match=r"rows 0.01 m apart .* take a larger spacing_m"):
        plan(scenario_with(Scenario(), {"farm": file, **SURVEY, **narrow}))


def test_a_survey_of_days_by_the_leaf_camera_is_refused_at_once(tmp_path):
    file = farm_file(tmp_path, (Crop.TOMATO, shapely.box(0, 0, 700, 700)))
    leaf = {"farm": file, "planner": "survey", "budget": "unlimited"}
    base, farm = scenario_with(Scenario(), leaf), load_farm(file)
    with pytest.raises(ScenarioError, match=r"sees 0.5 m: rows 0.5 m apart .* 980 km long, .* hours in"):
        plan(base)
    for changes in (
        {"planner": "survey:spacing_m=20"},
        {"vehicle": "ideal", "budget": "9999steps"},
        {"vehicle": "quad", "vehicles": 9},
    ):
        assert vehicles_of(scenario_with(base, changes), farm, seed=0, first_day=6)
    with pytest.raises(ScenarioError, match="long for each of 2 vehicles"):
        vehicles_of(scenario_with(base, {"vehicles": 2, "cruise_speed_m_s": 2.0}), farm, seed=0, first_day=6)


def test_higher_than_120_m_takes_a_permission(tmp_path):
    file = farm_file(tmp_path, (Crop.TOMATO, shapely.box(0, 0, 100, 80)))
    with pytest.raises(ScenarioError, match="150 m is above 120 m"):
        asked(file, altitude_m=150.0)
    made = plan(asked(file, altitude_m=150.0, max_altitude_m=150.0))
    assert max(item.z for item in made.mission.items) == 150.0
    with pytest.raises(ScenarioError, match="160 m is above 150 m"):
        asked(file, altitude_m=160.0, max_altitude_m=150.0)


def test_a_crop_that_no_field_is_of_is_named(tmp_path):
    left, right = shapely.box(0, 0, 30, 30), shapely.box(30, 0, 60, 30)
    file = farm_file(tmp_path, (Crop.TOMATO, left), ("wheat", right))
    changes = {"farm": file, "planner": "lawnmower", "budget": "5min"}
    notes = plan(scenario_with(Scenario(), changes)).farm.notes
    assert [note for note in notes if note.startswith("wheat: not scouted")]
    (tmp_path / "one").mkdir()
    alone = farm_file(tmp_path / "one", ("wheat", right))
    assert not plan(scenario_with(Scenario(), {**changes, "farm": alone})).farm.notes


def codes_of(*plans, scenario):
    coverage = coverage_together(plans, scenario.camera.footprint)
    vehicles = single_vehicles(scenario)
    return [
        {one.code for one in check_plan(plan, vehicle, coverage).findings}
        for plan, vehicle in zip(plans, vehicles, strict=True)
    ]


@pytest.mark.parametrize(
    ("options", "whole"),
    [
        ({}, True),
        ({"camera_model": None, "altitude_m": None, "planner": "lawnmower", "budget": "300m"}, False),
    ],
)
def test_command_line_and_preflight_ask_for_the_whole_of_the_same_plans(tmp_path, options, whole):
    """A survey, and any plan with a mapping camera; here its images show half of the land."""
    file = farm_file(tmp_path, (Crop.TOMATO, shapely.box(0, 0, 40, 30)))
    scenario = asked(file, **{"budget": "unlimited", **options})
    made = plan(scenario)
    assert made.asks_whole is whole
    assert ("unseen" in codes_of(replace(made, coverage=0.5), scenario=scenario)[0]) is whole


def test_a_plan_that_shows_less_than_was_asked_warns(tmp_path, capsys):
    file = farm_file(tmp_path, (Crop.TOMATO, shapely.box(0, 0, 100, 80)))
    few = ["plan", "--farm", file, "--planner", "lawnmower", "--budget", "400m"]
    assert main([*few, "--camera", "dji-p1-35", "--altitude", "20"]) == 0
    assert "but should show all of it" in capsys.readouterr().err
    assert main(few) == 0
    assert "whole" not in capsys.readouterr().err


def test_what_several_vehicles_show_counts_once(tmp_path):
    file = farm_file(tmp_path, (Crop.TOMATO, shapely.box(0, 0, 100, 80)))
    scenario = asked(file, vehicles=2, separation="distance:5m", altitude_m=30.0)
    first, second = plan_fleet(scenario)
    assert max(first.coverage, second.coverage) < 0.9
    together = coverage_together((first, second), scenario.camera.footprint)
    assert 0.98 < together <= 1.0 < first.coverage + second.coverage
    assert all("unseen" not in codes for codes in codes_of(first, second, scenario=scenario))
    assert coverage_together((first, first), scenario.camera.footprint) == pytest.approx(
        first.coverage, abs=1e-3
    )
