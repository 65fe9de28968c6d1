"""What a benchmark is to run."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensors.estimators.point import PointEstimator
from wbf_mission.bench.spec import BenchSpec, seeds_of, seeds_text
from wbf_mission.scenario import ScenarioError
from wbf_mission.version import BEHAVIOUR

TEN = ["WBF/Miniberry-10-v1"]


def test_the_default_is_the_papers_experiment():
    spec = BenchSpec.of()
    assert len(spec) == 80
    runs = list(spec.runs())
    assert {one.scenario_id for one in runs} == {"WBF/Miniberry-30-v1"}
    assert {one.scenario.mission.budget for one in runs} == {"500steps"}
    assert {one.seed for one in runs} == set(range(10))
    assert len({one.key for one in runs}) == 80


def test_keys_are_of_the_run_alone():
    def keys(**given):
        return {(r.planner, r.estimator, r.seed): r.key for r in BenchSpec.of(**given).runs()}

    small = keys(scenarios=TEN, planners=["spiral"], estimators=["gp"], seeds=[3])
    large = keys(scenarios=TEN, planners=["greedy", "spiral"], estimators=["point", "gp"], seeds=5)
    assert large["spiral", "gp", 3] == small["spiral", "gp", 3]
    other = keys(scenarios=TEN, planners=["spiral:max_spacing_m=2"], estimators=["gp"], seeds=[3])
    assert not set(other.values()) & set(small.values())


class UCB(PointEstimator):
    """Of a test's own."""

    def __init__(self, weight=1.0):
        self.weight = weight


def keys_of(**given):
    return {one.key for one in BenchSpec.of(**{"scenarios": TEN, "seeds": 1, **given}).runs()}


def test_objects_count_with_their_parameters():
    def keys(made):
        return keys_of(planners=["spiral"], estimators=[made])

    assert keys(UCB(1.0)) == keys(UCB(1.0))
    assert not keys(UCB(1.0)) & keys(UCB(9.0))
    table = UCB(1.0)
    table.table = np.arange(3.0)
    other = UCB(1.0)
    other.table = np.arange(3.0) + 1.0
    assert len(keys(table) | keys(other) | keys(UCB(1.0))) == 3
    assert len(keys_of(planners=["spiral"], estimators=[UCB(1.0), UCB(9.0), table])) == 3
    with pytest.raises(ScenarioError, match="estimators: UCB is given twice; give it once"):
        BenchSpec.of(TEN, estimators=[UCB(1.0), UCB(9.0), UCB(1.0)])


def test_classes_of_a_notebook_count_by_their_code():
    source = """
from sensors.estimators.point import PointEstimator
SHARE = 0.5
def helper(x): return x * 2
class Mine(PointEstimator):
    kinds = {"a", "b", "c"}
    def _learn(self, seen):
        return helper(SHARE)
"""

    def keys(text):
        notebook = {"__name__": "__main__"}
        exec(text, notebook)
        return keys_of(planners=["spiral"], estimators=[notebook["Mine"]()])

    assert keys(source) == keys(source + "\n# another cell\n")
    changes = [("0.5", "0.6"), ("x * 2", "x * 3"), ("helper(SHARE)", "helper(1)"), ('"c"', '"d"')]
    assert len(set().union(*(keys(source.replace(*one)) for one in [("", ""), *changes]))) == 5


def test_a_notebooks_digest_is_that_of_another_process():
    text = (
        "from wbf_mission.bench.digests import own_digest\n"
        "class Mine:\n    def decide(self, s):\n        return s in {'a', 'b', 'c', 'd'}, lambda: s\n"
        "print(own_digest(Mine()))\n"
    )
    found = {
        subprocess.run(
            [sys.executable, "-c", text],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": os.pathsep.join(sys.path)},
        ).stdout
        for seed in ("1", "2")
    }
    assert len(found) == 1


@pytest.mark.parametrize("room", BEHAVIOUR)
def test_the_behaviour_of_each_room_counts(monkeypatch, room):
    before = keys_of(planners=["spiral"], estimators=["point"])
    monkeypatch.setitem(BEHAVIOUR, room, 99)
    assert not before & keys_of(planners=["spiral"], estimators=["point"])


def test_runs_of_one_environment_follow_one_another():
    seeds = [one.seed for one in BenchSpec.of(scenarios=TEN, seeds=[5, 2]).runs()]
    assert seeds == [5] * 8 + [2] * 8


@given(st.lists(st.integers(0, 2**64 - 1) | st.integers(0, 9), min_size=1, max_size=12, unique=True))
def test_seeds_are_the_same_as_a_text(seeds):
    assert list(seeds_of(seeds_text(seeds))) == seeds


def test_a_file_may_name_scenarios_beside_it(tmp_path):
    (tmp_path / "mine.toml").write_text('farm = "miniberry-10"\nvehicle = "ideal"\nbudget = "20steps"\n')
    (tmp_path / "spec.toml").write_text(
        'scenarios = ["mine.toml"]\nplanners = [{name = "spiral", max_spacing_m = 3}]\n'
        'estimators = ["point"]\nseeds = 2\n'
    )
    runs = list(BenchSpec.read(tmp_path / "spec.toml").runs())
    assert [(one.scenario_id, one.planner, one.seed) for one in runs] == [
        ("mine.toml", "spiral:max_spacing_m=3", 0),
        ("mine.toml", "spiral:max_spacing_m=3", 1),
    ]
    assert len(BenchSpec.read(tmp_path / "spec.toml", {"seeds": 7, "planners": None})) == 7


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("seeds = 0", "seeds 0 are neither a number of seeds"),
        ("seeds = [1, 1]", "seeds: a seed is given twice"),
        ("seeds = true", "neither a number of seeds"),
        ("seeds = 20_000_000", "neither a number of seeds"),
        ('seeds = "9..5"', "'9..5' is neither a seed nor a range"),
        ('seeds = "5,"', "'' is neither a seed nor a range"),
        ('seeds = "0..99999999999"', "too many seeds"),
        ('seeds = "3..5,4"', "a seed is given twice"),
        ("planners = []", "planners [] is not a list with entries"),
        ('planners = "spiral"', "planners 'spiral' is not a list"),
        ('planners = ["spirall"]', "unknown planner or policy 'spirall' (is 'spiral' meant?)"),
        ('planners = ["spiral", "spiral"]', "planners: spiral is given twice"),
        ('planners = ["greedy:nix=3"]', "nix"),
        ("estimators = [3]", "estimator 3"),
        ("scenarios = [3]", "3 is neither an id nor a file"),
        ('scenarios = ["nix.toml"]', "nix.toml: cannot be read"),
        ('scenarios = ["WBF/Miniberry30-v1"]', "is WBF/Miniberry-30-v1 meant"),
        ("nix = 1", "spec.toml: unknown key 'nix'"),
        ("seeds = ", "cannot be read as a scenario"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, words):
    (tmp_path / "spec.toml").write_text(text + "\n")
    with pytest.raises(Exception, match=r".") as caught:
        BenchSpec.read(tmp_path / "spec.toml")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ('budget = "40"', "budget '40' is not understood"),
        ("parameters = { NOPE = 1.0 }", "px4 has no parameter NOPE"),
        ('terrain = ["no.tif"]\nheight_above_ground_m = 5.0', "no.tif"),
        ('mission = "no.plan"', "no such file"),
        ('camera_fields = ["no"]', "unknown field 'no'"),
        ('camera_model = "no"', "a run flies with the leaf camera"),
    ],
)
def test_a_scenario_that_cannot_be_flown_is_refused_before_any_flight(tmp_path, line, says):
    file = tmp_path / "broken.toml"
    file.write_text(f'farm = "miniberry-10"\n{line}\n')
    with pytest.raises(ScenarioError, match=re.escape(says)) as caught:
        BenchSpec.of(scenarios=[file])
    assert str(caught.value).startswith(f"{file}: ")


def test_a_field_without_a_scored_cell_is_warned_of_once(tmp_path):
    field = 'name = "ph"\nkind = "smooth"\ncrops = ["tomatoe"]\ndefault = 0.5'
    (tmp_path / "ph.toml").write_text(f"[[field]]\n{field}\n")
    (tmp_path / "run.toml").write_text('farm = "miniberry-10"\nfields = ["tylcv", "ccr", "ph.toml"]\n')
    with pytest.warns(UserWarning, match=r"run.toml: farm miniberry-10.*field ph is of tomatoe") as warned:
        BenchSpec.of(scenarios=[tmp_path / "run.toml"])
    assert len(warned) == 1
