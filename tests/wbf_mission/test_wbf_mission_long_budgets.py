"""Budgets beyond a battery: one rule for all units, and what is not used of them is said."""

from dataclasses import replace

import pytest

from wbf_mission import Scenario
from wbf_mission.cli.app import main
from wbf_mission.cli.plan import SortieOptions
from wbf_mission.planning.builder import budget_left
from wbf_mission.planning.fleet import single_vehicles
from wbf_mission.preflight.finding import PreflightError
from wbf_mission.run.plan import plan, plan_fleet

SMALL = 'base = "quad"\nkind = "multirotor"\n[battery]\ncapacity_wh = 9.0\n'


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    file = tmp_path_factory.mktemp("vehicles") / "small.toml"
    file.write_text(SMALL)
    return str(file)


def planned(small, budget, **more):
    given = {"farm": "miniberry-100", "planner": "spiral", "autopilot": "px4", **more}
    return Scenario(vehicle=small, budget=budget, **given)


def cut_of(scenario):
    whole = plan(scenario)
    (one,) = single_vehicles(scenario)
    cut = SortieOptions().cut(whole, one)
    return [whole] if cut is None else list(cut.plans)


def test_budgets_of_all_units_are_flown_in_sorties_alike(small):
    """Each unit's budget is what the sorties of the same mission take."""
    metres = cut_of(planned(small, "400m"))
    seconds = sum(one.prediction.duration_s for one in metres)
    watt_hours = sum(one.prediction.energy_wh for one in metres)
    assert len(metres) > 1
    for budget in (f"{seconds:.0f}s", f"{watt_hours:.1f}Wh"):
        plans = cut_of(planned(small, budget))
        assert len(plans) >= len(metres), budget
        assert all(one.prediction.feasible for one in plans)
        assert sum(one.length_m for one in plans) > 0.95 * sum(one.length_m for one in metres), budget
        taken = {"s": sum(one.prediction.duration_s for one in plans)}
        taken["Wh"] = sum(one.prediction.energy_wh for one in plans)
        unit = budget.lstrip("0123456789.")
        is_over = taken[unit] > 1.05 * float(budget.removesuffix(unit))
        assert ("for the path before it is cut" in budget_left(plans)) is is_over


@pytest.mark.parametrize("budget", ["40s", "10min", "100Wh", "3000m", "3 batteries"])
def test_what_is_not_used_of_a_budget_is_said(small, budget, capsys):
    arguments = ["--farm", "miniberry-10", "--planner", "lawnmower", "--vehicle", small]
    assert main(["plan", *arguments, "--budget", budget]) == 0
    said = [line for line in capsys.readouterr().err.splitlines() if "of its budget of" in line]
    assert len(said) == (budget != "40s"), said


@pytest.fixture(scope="module")
def spiral():
    return replace(plan(planned("quad", "400m")), budget_text="1000 m")


def test_a_fleet_is_not_cut_to_a_battery_without_a_word(small):
    fleet = planned(small, "4min", vehicles=2)
    assert all(not one.prediction.feasible for one in plan_fleet(fleet))
    from wbf_mission.flight import fly

    with pytest.raises(PreflightError, match="battery"):
        fly(fleet)


def test_a_policy_that_goes_home_on_one_battery_says_so(small):
    (one,) = plan_fleet(Scenario(vehicle=small, farm="miniberry-30", policy="greedy", budget="10min"))
    assert "600 s (a battery less its reserve lasts for about" in one.budget_text
    assert one.prediction.feasible
    (short,) = plan_fleet(Scenario(vehicle=small, farm="miniberry-30", policy="greedy", budget="1min"))
    assert short.budget_text == "60 s"


@pytest.mark.parametrize(("length_m", "is_over"), [(1049.0, False), (1051.0, True)])
def test_sorties_say_that_they_take_a_twentieth_more_than_the_budget(spiral, length_m, is_over):
    made = replace(spiral, length_m=0.5 * length_m)
    assert ("the 2 sorties take" in budget_left([made, made])) is is_over
    assert budget_left([replace(made, length_m=length_m)]) == ""


def test_a_flight_says_it_too(capsys):
    arguments = ["--farm", "miniberry-10", "--planner", "lawnmower", "--estimator", "point", "--no-files"]
    assert main(["fly", *arguments, "--budget", "100m"]) == 0
    assert capsys.readouterr().err.count("of its budget of") == 1
