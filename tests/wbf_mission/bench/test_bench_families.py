"""Families of scenarios: each id in one of them at most, and a command flies a whole one."""

import json

import pytest

from geo.farms import get_farm
from wbf_mission.bench.spec import BenchSpec
from wbf_mission.cli.app import main
from wbf_mission.scenario import families, family_of, load_scenario, scenario_ids


def test_every_scenario_of_a_family_exists_and_is_in_no_other():
    named = [one for family in families() for one in family.scenarios]
    assert len(set(named)) == len(named) and set(named) <= set(scenario_ids())
    assert all(family_of(one) == family for family in families() for one in family.scenarios)


@pytest.mark.parametrize("family", families(), ids=lambda one: one.name)
def test_a_family_can_be_flown_by_its_planners_and_estimators(family):
    spec = BenchSpec.of(family.scenarios, family.planners, family.estimators, 1)
    assert len(spec) == len(family.scenarios) * len(family.planners) * len(family.estimators)
    assert all(load_scenario(one).score.points == 36 for one in family.scenarios)


def test_the_farms_are_what_the_tool_writes(tmp_path):
    import write_field_farms

    known = {one["name"]: one for one in json.loads(write_field_farms.SOURCE.read_text())["fields"]}
    for name, wanted in write_field_farms.FARMS.items():
        kept = get_farm(write_field_farms.OUT / f"{name}.geojson")
        made = write_field_farms.make_farm(name, wanted, known)
        assert (kept.grid().crop == made.grid().crop).all() and len(kept.obstacles) == len(made.obstacles)


def test_bench_list_shows_families(capsys):
    assert main(["bench", "list", "--families", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in listed] == [one.name for one in families()]
    assert main(["bench", "list", "--json"]) == 0
    by_id = {one["scenario"]: one["family"] for one in json.loads(capsys.readouterr().out)}
    assert by_id["WBF/Miniberry-30-Drift-v1"] == "places" and by_id["WBF/Waterberry-v1"] is None


def test_bench_run_flies_a_family(capsys, tmp_path):
    few = ["--planners", "spiral", "--estimators", "point", "--seeds", "1", "--out", str(tmp_path / "r")]
    assert main(["bench", "run", "--family", "smooth", *few, "--json"]) == 0
    assert capsys.readouterr().out.count("WBF/Miniberry-30-Smooth") >= 3
    assert main(["bench", "run", "--family", "smoth", *few]) == 2
    assert (
        "unknown family 'smoth' (is 'smooth' meant?): choose own, worlds, smooth" in capsys.readouterr().err
    )
    assert main(["bench", "run", str(tmp_path / "a.toml"), "--family", "smooth", *few]) == 2
    assert "give only one of the two" in capsys.readouterr().err
