"""What is wrong in a user's planner, policy or estimator is told as that, in one line, with file and line."""

import json

import pytest
from sweeps import slow

from wbf_mission import BenchSpec, benchmark
from wbf_mission.addons.base.standings import standings
from wbf_mission.cli.app import main
from wbf_mission.cli.command import provided
from wbf_mission.own_code import own_choice

TEN = ["WBF/Miniberry-10-v1"]
FLY = ["fly", "--farm", "miniberry-10", "--vehicle", "ideal", "--no-files", "--budget", "80steps"]
POLICY = """
import time
import numpy as np
from mission.planners import make_planner
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.policy import Triggers

class Mine:
    triggers = Triggers(period_s=2.0)

    def start(self):
        self.count = 0

    def decide(self, observation):
        if observation.event.value == "start":
            return Decision({1: make_planner("spiral")(observation.vehicles[0].request).points_m})
        self.count += 1
        ANSWER
"""
ESTIMATOR = """
import numpy as np
from sensors.estimators.point import PointEstimator
from sensors.scoring.information import InformationModel

class Mine(PointEstimator):
    def predict(self):
        model = super().predict().copy()
        ANSWER
"""


def policy_file(folder, answer):
    (folder / "mine.py").write_text(POLICY.replace("ANSWER", answer))
    return f"{folder / 'mine.py'}:Mine"


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        ("return 1 / 0", "crashed"),
        ("raise SystemExit", "crashed"),
        ("return Decision({1: [[np.nan, 1.0]]})", "not finite"),
        ("return Decision({1: [[-0.1, observation.vehicles[0].position_m[1]]]})", "outside the area"),
        ("return Decision({1: np.tile([[0.5, 0.5], [2.0, 2.0]], (40, 1))})", "over the budget"),
        ("return 3", "no Decision"),
        slow("time.sleep(1.1); return NO_CHANGE", "too late"),
    ],
)
def test_bad_answers_are_counted_and_too_many_are_a_failure(tmp_path, answer, kind):
    policy = own_choice(policy_file(tmp_path, answer), "policy")
    spec = BenchSpec.of(TEN, planners=[policy], estimators=["point"], seeds=1)
    (row,) = benchmark(spec, out=tmp_path / "rows")
    bad = row.decisions - 1
    (most, count), *_ = row.bad_answers.items()
    assert (most, sum(row.bad_answers.values())) == (kind, bad)
    assert count > 0.5 * bad
    assert row.outcome == "completed"
    assert f"policy Mine: {bad} of {row.decisions} answers were bad: {count} {kind}" in row.error
    assert kind == "too late" or "first: policy Mine" in row.error
    (standing,) = standings([row])
    assert (standing.failed, standing.environments, standing.bad_answers) == (1, 1, row.bad_answers)
    page = provided("bench.report")([row], tmp_path / "report", title="t")
    tables = [table.title for section in page.sections for table in section.tables]
    assert "Answers that were not flown, or came too late" in tables


def test_a_few_bad_answers_are_a_warning(tmp_path, capsys):
    name = policy_file(tmp_path, "return 1 / 0 if self.count == 3 else NO_CHANGE")
    arguments = ["--scenarios", TEN[0], "--planners", name, "--estimators", "point", "--seeds", "1"]
    assert main(["bench", "run", *arguments, "--out", str(tmp_path / "b")]) == 0
    assert "warning: Mine: in 1 runs answers were not flown or came too late" in capsys.readouterr().err
    assert main([*FLY, "--policy", name, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["bad_answers"], summary["policy_failed"]) == ({"crashed": 1}, False)
    (told,) = summary["warnings"]
    cause = "ZeroDivisionError: division by zero (mine.py, line 18)"
    assert f"1 crashed; first: policy Mine failed: {cause}" in told


@pytest.mark.parametrize("command", ["check-policy", "check-planner", "check-estimator"])
def test_a_check_blames_the_users_line(tmp_path, capsys, command):
    if command == "check-policy":
        name = policy_file(tmp_path, "return observation.nix")
        words = "AttributeError: 'PolicyObservation' object has no attribute 'nix' (mine.py, line 18)"
    elif command == "check-planner":
        (tmp_path / "mine.py").write_text("def Mine(request):\n    return {}['nix']\n")
        name, words = f"{tmp_path / 'mine.py'}:Mine", "KeyError: 'nix' (mine.py, line 2)"
    else:
        (tmp_path / "mine.py").write_text(ESTIMATOR.replace("ANSWER", "return model.value / 'a'"))
        name, words = f"{tmp_path / 'mine.py'}:Mine", "(mine.py, line 9)"
    assert main([command, name]) == 1
    told = capsys.readouterr()
    assert words in " ".join(told.out.split())
    assert not told.err


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ("return None", "predict returned None, not an InformationModel"),
        ("return InformationModel(model.value + np.float32(0.5), model.uncertainty)", "values are 0 to 1"),
        (
            "return InformationModel(model.value, model.uncertainty - np.float32(2))",
            "is negative in some cell",
        ),
        ("return InformationModel(model.value * np.float32('nan'), model.uncertainty)", "not finite"),
        (
            "return InformationModel(model.value, model.uncertainty, fields=('ccr', 'tylcv', 'soil'))",
            "predict returned the fields ccr, tylcv, soil; the fields of the run are tylcv, ccr",
        ),
        (
            "return InformationModel(model.value[:, :3], model.uncertainty[:, :3])",
            "predict returned maps of shape (3, ",
        ),
        ("return InformationModel(model.value * 1.0, 1.0 * np.float64(model.uncertainty))", "float32"),
        ("return 1 / 0", "ZeroDivisionError: division by zero (mine.py, line 9)"),
    ],
)
def test_estimates_that_are_none_are_told_in_one_line(tmp_path, capsys, answer, words):
    (tmp_path / "mine.py").write_text(ESTIMATOR.replace("ANSWER", answer))
    name = f"{tmp_path / 'mine.py'}:Mine"
    assert main(["check-estimator", name, "--json"]) == 1
    assert words in json.loads(capsys.readouterr().out)["broken"]
    assert main([*FLY, "--estimator", name]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert "mistake in wbf-mission" not in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("good", "bad", "words"),
    [
        (
            "self.count = 0",
            "1 / 0",
            "policy Mine failed: ZeroDivisionError: division by zero (mine.py, line 12)",
        ),
        (
            "start(self)",
            "start(self, seed)",
            "policy Mine failed: TypeError: Mine.start() missing 1 required",
        ),
        ("self.count = 0", "raise SystemExit", "policy Mine failed: SystemExit (mine.py, line 12)"),
        ("Triggers(period_s=2.0)", "3", "triggers is 3, not a Triggers"),
    ],
)
def test_an_error_beside_the_decisions_is_the_users_too(tmp_path, capsys, good, bad, words):
    name = policy_file(tmp_path, "return NO_CHANGE")
    (tmp_path / "mine.py").write_text((tmp_path / "mine.py").read_text().replace(good, bad))
    assert main([*FLY, "--policy", name]) == 2
    err = capsys.readouterr().err
    assert "mistake in wbf-mission" not in err
    assert words in err


@pytest.mark.parametrize(
    ("command", "code", "words"),
    [
        ("planner", "def Mine(request):\n    raise SystemExit(7)", "SystemExit: 7 (mine.py, line 2)"),
        (
            "planner",
            "def Mine():\n    pass",
            "TypeError: Mine() takes 0 positional arguments but 1 was given",
        ),
        (
            "policy",
            POLICY.replace("observation):", "observation, extra):"),
            "TypeError: Mine.decide() missing 1",
        ),
        (
            "estimator",
            ESTIMATOR.replace("predict(self)", "predict(self, x)"),
            "TypeError: Mine.predict() missing",
        ),
    ],
)
def test_a_check_fails_when_own_code_ends_the_program_or_takes_other_arguments(
    tmp_path, capsys, command, code, words
):
    (tmp_path / "mine.py").write_text(code)
    assert main([f"check-{command}", f"{tmp_path / 'mine.py'}:Mine", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["broken"].startswith(words)


@pytest.mark.parametrize("how", [["check-planner"], FLY, ["bench", "run", "--seeds", "1", "--jobs", "2"]])
def test_what_own_code_prints_is_not_part_of_the_result(tmp_path, capfd, how):
    code = "from wbf_mission import make_planner\nprint('one')\ndef Mine(request):\n    print('two')\n"
    (tmp_path / "mine.py").write_text(f"{code}    return make_planner('spiral')(request)")
    bench = ["--out", str(tmp_path / "b"), "--scenarios", *TEN, "--estimators", "point", "--planners"]
    given = {"fly": ["--planner"], "bench": bench}.get(how[0], [])
    assert main([*how, *given, f"{tmp_path / 'mine.py'}:Mine", "--json"]) == 0
    told = capfd.readouterr()
    assert json.loads(told.out)
    assert {"one", "two"} <= set(told.err.split())


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (
            "[[1.0, 1.0], [float('nan'), 2.0]]",
            "planner Mine: a path must be finite (x, y) points, but the point at",
        ),
        ("[1.0, 2.0]", "planner Mine: a path must be finite (x, y) points; its shape is (2,)"),
        (
            "[['a', 'b']]",
            "planner Mine failed: ValueError: could not convert string to float: 'a' (mine.py, line 3)",
        ),
    ],
)
def test_a_path_that_is_none_names_the_planner_and_the_point(tmp_path, capsys, points, words):
    code = "from wbf_mission import PlannedPath\ndef Mine(request):\n    return PlannedPath"
    (tmp_path / "mine.py").write_text(f"{code}({points}, 1.0, 'rows')")
    assert main([*FLY, "--planner", f"{tmp_path / 'mine.py'}:Mine"]) == 2
    assert f"error: {words}" in capsys.readouterr().err
