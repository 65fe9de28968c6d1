"""Worlds and smooth fields in runs: only the environment knows how the fields really develop."""

import numpy as np
import pytest

from sensors.environment.world import World
from sensors.errors import EnvironmentDataError
from sensors.fields import PAPER_FIELDS
from wbf_mission import Scenario, fly
from wbf_mission.addons.base.simulator import make_components
from wbf_mission.addons.rl.task import SurveyTask
from wbf_mission.bench.digests import meaning_of
from wbf_mission.cli.app import main
from wbf_mission.results.result import load_result
from wbf_mission.run.resolve import make_environment, resolve
from wbf_mission.scenario import load_scenario, scenario_ids, scenario_with

SMALL = Scenario(farm="miniberry-10", vehicle="ideal", planner="spiral", budget="40steps", estimator="gp")
WRONG = scenario_with(SMALL, {"world": "wrong-rates", "seed": 5})
TRUE = World.load("wrong-rates").fields(PAPER_FIELDS, 5)


def test_only_the_environment_of_a_run_is_of_the_world():
    run = resolve(WRONG)
    assert run.fields == run.camera.fields == run.estimator.fields == PAPER_FIELDS
    environment = run.environment(None, use_cache=False)[0]
    assert environment.fields == TRUE != PAPER_FIELDS
    result = fly(WRONG)
    assert result.fields == PAPER_FIELDS
    np.testing.assert_array_equal(result.truth, environment.values(6))
    seen = result.observations
    np.testing.assert_array_equal(seen.values, environment.sample(6, seen.x, seen.y))
    assert not np.array_equal(result.truth, fly(scenario_with(SMALL, {"seed": 5})).truth)


def test_training_environments_and_the_simulator_are_of_the_world():
    truth = make_environment(WRONG, WRONG.farm.load()).values(6)
    task = SurveyTask(WRONG)
    assert task.fields == PAPER_FIELDS
    np.testing.assert_array_equal(task.environment(5).values(6), truth)
    simulated = make_components(scenario_with(WRONG, {"vehicle": "quad"}))
    np.testing.assert_array_equal(simulated.environment.values(6), truth)


def test_a_saved_result_tells_its_world(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[tylcv]\nseeds = 0\n")
    result = fly(scenario_with(SMALL, {"world": str(file)}))
    assert result.truth[0].min() == 1.0
    result.save(tmp_path / "result", plots=False)
    file.unlink()
    loaded = load_result(tmp_path / "result")
    assert loaded.scenario.farm.load_world().laws == {"tylcv": {"seeds": 0}}
    assert load_result(result_of_name(tmp_path)).scenario.farm.world == "wrong-rates"


def result_of_name(folder):
    fly(WRONG).save(folder / "named", plots=False)
    return folder / "named"


def test_a_world_counts_by_what_is_in_it(tmp_path):
    meanings = {None: meaning_of(SMALL)}
    for name, text in (("one", "seeds = 0"), ("two", "seeds = 0"), ("three", "seeds = 1")):
        (tmp_path / f"{name}.toml").write_text(f"[tylcv]\n{text}\n")
        meanings[name] = meaning_of(scenario_with(SMALL, {"world": str(tmp_path / f"{name}.toml")}))
    assert meanings["one"] == meanings["two"] and len(set(meanings.values())) == 3


def test_a_world_that_cannot_be_is_told_before_anything_is_flown(capsys, tmp_path):
    with pytest.raises(EnvironmentDataError, match="world wrong-soil: no table for tylcv"):
        resolve(scenario_with(SMALL, {"world": "wrong-soil", "fields": ("tylcv",)}))
    assert main(["fly", "--farm", "miniberry-10", "--world", "nowhere", "--out", str(tmp_path / "r")]) == 2
    assert "unknown world 'nowhere': choose wrong-kernel" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()


def test_files_beside_a_catalogued_scenario_are_found():
    smooth = load_scenario("WBF/Miniberry-30-Smooth-v1")
    assert resolve(smooth).fields.names == ("short", "middle", "long")
    assert "WBF/fields/smooth" not in scenario_ids()
