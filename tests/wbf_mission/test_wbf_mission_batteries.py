"""A budget of batteries: the longest mission that they carry, cut into so many sorties."""

import json

import pytest
from sweeps import slow

from wbf_mission import Scenario
from wbf_mission.cli.app import main
from wbf_mission.planning.sorties import sorties_of
from wbf_mission.run.plan import plan, plan_for_batteries
from wbf_mission.scenario import ScenarioError
from wbf_mission.scenario.values import batteries_in

FARM = "miniberry-100"


def scenario(small, **more):
    return Scenario(**{"farm": FARM, "planner": "spiral", "vehicle": small, **more})


@pytest.mark.parametrize(
    ("count", "more"),
    [(3, {"autopilot": "ardupilot"}), slow(2, {"wind_speed_m_s": 4.0, "turbulence": "light"})],
)
def test_so_many_batteries_carry_it_and_hardly_more(small, count, more):
    one, steps = scenario(small, **more), []
    whole, cut = plan_for_batteries(
        one, count, lambda made: sorties_of(made, one), progress=lambda _what, done, total: steps.append(done)
    )
    battery = whole.vehicle.battery
    usable = battery.capacity_wh * (1.0 - battery.reserve_fraction)
    assert len(cut.sorties) <= count
    assert all(part.prediction.feasible and part.prediction.most_wh <= usable for part in cut.plans)
    assert sum(part.prediction.most_wh for part in cut.plans) > 0.85 * count * usable
    assert whole.budget_text == f"{count} batteries" and steps == sorted(steps) and len(steps) < 11
    # An eighth more takes more.
    longer = plan(scenario(small, **more, budget=f"{1.125 * whole.length_m:.0f}m"))
    assert len(sorties_of(longer, one).sorties) > count


@pytest.mark.slow
def test_a_survey_takes_what_it_takes(small):
    one = scenario(small, planner="survey")
    whole, cut = plan_for_batteries(one, 20, lambda made: sorties_of(made, one))
    assert whole.mission == plan(scenario(small, planner="survey", budget="unlimited")).mission
    needed = len(cut.sorties)
    assert 1 < needed < 20
    with pytest.raises(ScenarioError, match=f"batteries: the survey needs {needed} batteries"):
        plan_for_batteries(one, needed - 1, lambda _: cut)


def test_one_battery_is_what_a_plan_without_a_budget_takes(small):
    one = scenario(small)
    whole, cut = plan_for_batteries(one, 1, lambda made: sorties_of(made, one))
    assert cut is None and whole.mission == plan(one).mission and whole.budget_text == "1 battery"


@pytest.mark.parametrize(
    ("text", "count"),
    [("3 batteries", 3), (" 3 BATTERIES ", 3), ("3battery", 3)]
    + [(text, None) for text in ("3", "30min", "3.5batteries", "-3batteries", None, "batteries")],
)
def test_how_a_number_of_batteries_is_written(text, count):
    assert batteries_in(text) == count


COMMAND = ("plan", "--farm", FARM, "--planner", "spiral", "--budget", "2 batteries")


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (("--vehicles", "2"), "for 2 vehicles, give metres, minutes or steps"),
        (("--whole",), "leave out one of them"),
        (("--vehicle", "ideal"), "vehicle ideal has no battery"),
        (("--budget", "0batteries"), "give 1 to 100 batteries"),
        (("--mission", "rows.plan"), "has no effect with --mission"),
    ],
)
def test_what_makes_no_sense_is_told_in_a_line(tmp_path, capsys, more, text):
    code = main([*COMMAND, *more, "--out", str(tmp_path / "rows.plan")])
    said = capsys.readouterr().err
    assert code == 2 and text in said and said.count("\n") == 1 and not list(tmp_path.iterdir())


def test_a_scenario_file_gives_a_number_of_batteries(tmp_path, capsys):
    (tmp_path / "run.toml").write_text(f'farm = "{FARM}"\nplanner = "spiral"\nbudget = "1 battery"\n')
    assert main(["plan", "--scenario", str(tmp_path / "run.toml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["budget"] == "1 battery"
