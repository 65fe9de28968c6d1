"""Scenarios and their files."""

import dataclasses
import pickle
import typing
from pathlib import Path

import numpy as np
import pytest
from bad_files import complaint
from hypothesis import given
from hypothesis import strategies as st

from wbf_mission.scenario import Choice, FarmOptions, Scenario, ScenarioError, load_scenario, scenario_with
from wbf_mission.scenario.choice import choose, split_choices
from wbf_mission.scenario.parts import LAST_DAY, ScenarioKeywords
from wbf_mission.scenario.scenario import PARTS, all_options

REPOSITORY = Path(__file__).parents[2]


def test_changes_leave_out_what_was_not_given():
    base = Scenario(planner="lawnmower", seed=3)
    changed = scenario_with(base, {"planner": None, "seed": 0})
    assert changed.mission.planner.name == "lawnmower"
    assert changed.seed == 0


@pytest.mark.parametrize("path", sorted((REPOSITORY / "missions").glob("*.toml")), ids=lambda path: path.stem)
def test_the_ready_scenarios_load(path):
    assert isinstance(load_scenario(path), Scenario)


def test_a_farm_beside_the_scenario_is_found(tmp_path):
    (tmp_path / "mine.geojson").write_text("{}")
    (tmp_path / "run.toml").write_text('farm = "mine.geojson"\nbudget = "10min"\n')
    assert load_scenario(tmp_path / "run.toml").farm.name == str(tmp_path / "mine.geojson")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('planer = "spiral"\n', "unknown key 'planer'"),
        ('seed = "one"\n', "seed"),
        ("seed = -4\n", "seed -4 is out of range"),
        ("= nonsense\n", "not TOML"),
        ('budget = "40"\n', "bad.toml: budget '40' is not understood"),
    ],
)
def test_bad_files_are_one_line_with_their_name(tmp_path, text, says):
    assert says in complaint(load_scenario, tmp_path, text, ScenarioError)


@pytest.mark.parametrize(
    ("option", "value", "says"),
    [
        ("farm", "", "farm is empty"),
        ("vehicle", " ", "vehicle is empty"),
        ("budget", 60, 'budget: 60 is a number; give a text, such as "60s"'),
        ("budget", "40", "budget '40' is not understood: write a positive number and a unit"),
        ("planner", ":direction=1", "planner"),
        ("planner", {"direction": 0.3}, "the table has no name"),
        ("estimator", 3, "neither a name"),
        ("estimator", dict, "not its class"),
        ("camera_fields", (), "camera fields are empty"),
        ("seed", True, "seed: it is true or false; give a whole number"),
        ("seed", 1.5, "seed: it is a number with a fraction; give a whole number"),
        ("seed", 2**64, "2^64 - 1"),
        ("day", LAST_DAY + 1, "day 127"),
        ("parameters", {"MPC_ACC_HOR": "fast"}, "parameters"),
        ("planer", "spiral", "is 'planner' meant"),
    ],
)
def test_options_that_cannot_be_are_named(option, value, says):
    with pytest.raises(ScenarioError) as caught:
        Scenario(**{option: value})
    assert says in str(caught.value)


def test_options_are_unique_and_told():
    for key, (part, name, one) in all_options().items():
        assert one.help and one.panel, key
        assert name in {field.name for field in dataclasses.fields(part)}
        for other in (one.needs, *one.not_with):
            assert not other or other in all_options(), key


def test_a_scenario_survives_its_plain_values_and_a_pickle():
    scenario = Scenario(
        farm="miniberry-10",
        planner={"name": "lawnmower", "direction": 0.3},
        parameters={"MPC_ACC_HOR": 4.0},
        camera_fields=["soil"],
        turbulence=6.5,
        wind_speed_m_s=np.float64(3.0),
        seed=np.int64(5),
    )
    assert Scenario(**scenario.to_dict()) == scenario
    assert pickle.loads(pickle.dumps(scenario)) == scenario
    assert (scenario.seed, type(scenario.seed)) == (5, int)


def test_parts_and_values_do_not_mix_where_they_share_a_name():
    scenario = Scenario(day=3, budget="5min")
    assert dataclasses.replace(scenario, seed=4, planner="lawnmower").mission.budget == "5min"
    with pytest.raises(ScenarioError, match="use scenario_with"):
        dataclasses.replace(scenario, farm="waterberry")
    changed = scenario_with(scenario, {"farm": "waterberry", "parameters": {"A": 1.0}})
    assert (changed.farm.name, changed.farm.day) == ("waterberry", 3)
    assert Scenario(farm=FarmOptions("waterberry", 3)).farm == changed.farm
    assert scenario_with(changed, {"parameters": {"B": 2.0}}).vehicle.parameters == {"A": 1.0, "B": 2.0}


def test_a_file_gives_planner_and_estimator_parameters(tmp_path):
    path = tmp_path / "run.toml"
    path.write_text('planner = "lawnmower:direction=0.3"\n[estimator]\nname = "gp"\nlearn_from = "model"\n')
    scenario = load_scenario(path)
    assert scenario.mission.planner == Choice("lawnmower", {"direction": 0.3})
    assert scenario.estimate.estimator == Choice("gp", {"learn_from": "model"})


VALUES = st.one_of(
    st.booleans(),
    st.none(),
    st.integers(-(10**12), 10**12),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text("abcxyz_-.,: =0123456789[]", min_size=0, max_size=12),
)


@given(st.dictionaries(st.from_regex(r"[a-z_]{1,8}", fullmatch=True), VALUES, max_size=3))
def test_a_choice_is_read_as_it_is_written(params):
    choice = Choice("name", params)
    assert choose(str(choice), "planner") == choice
    (one, other) = (choose(text, "planner") for text in split_choices(f"{choice},other", "planner"))
    assert (one, other) == (choice, Choice("other"))


def test_the_keywords_that_an_editor_knows_are_the_options():
    told = typing.get_type_hints(ScenarioKeywords)
    assert set(told) == set(all_options()) | set(PARTS)
    for key, (part, name, _) in all_options().items():
        kind = typing.get_type_hints(part)[name]
        if key in PARTS:
            kind |= PARTS[key]
        if typing.get_origin(kind) in (tuple, dict) or (key == "camera_fields"):
            continue  # any sequence, any mapping
        assert told[key] == kind, key


def test_an_option_is_read_under_its_key():
    scenario = Scenario(farm="miniberry-10", planner="spiral", seed=4)
    assert (scenario["farm"], scenario["planner"].name, scenario["seed"]) == ("miniberry-10", "spiral", 4)
    assert {key: scenario[key] for key in all_options()}.keys() == scenario.to_dict().keys()
    with pytest.raises(ScenarioError, match=r"unknown key 'plannr' \(is 'planner' meant"):
        scenario["plannr"]
    with pytest.raises(ScenarioError, match=r"^unknown autopilot 'foo': choose px4, ardupilot$"):
        Scenario(autopilot="px4,foo")
