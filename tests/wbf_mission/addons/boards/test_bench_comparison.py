"""Planners are compared in pairs of runs."""

import json
import math

import numpy as np
import pytest
from bench_rows import made_row, rows

from wbf_mission.addons.boards.comparison import compare, doubt_in_words, verdict
from wbf_mission.bench.rows import read_rows
from wbf_mission.cli.app import main


def test_a_comparison_is_made_in_pairs():
    # The environments differ much more than the two do.
    hard = np.array([-9.0, -1.0, -5.0, -3.0, -7.0, -2.0, -8.0, -4.0])
    gain = np.array([0.1, 0.2, 0.15, 0.05, 0.1, 0.2, 0.1, 0.15])
    told = [*rows("mine", hard + gain), *rows("theirs", hard), *rows("frail", hard - 1.0, error=range(1, 8))]
    theirs, frail = compare(told, "mine", ["theirs", "frail"])
    assert (theirs.environments, theirs.better, verdict(theirs.score)) == (8, 1.0, "better")
    assert theirs.score.mean == pytest.approx(gain.mean())
    assert theirs.score.low > 0.05
    assert theirs.final_score.mean == pytest.approx(gain.mean() / 2)
    # A failed run counts as the worst, that of "theirs"; one that is far off makes the interval long.
    assert (frail.environments, frail.score.mean) == (8, pytest.approx(gain.mean() + 1.0 / 8.0))
    assert verdict(frail.score) == "undecided"
    (back,) = compare(told, "theirs", ["mine"])
    assert verdict(back.score) == "worse"
    (same,) = compare([*rows("a", [-1.0] * 6), *rows("b", [-1.0] * 6)], "a", ["b"])
    assert verdict(same.score) == "equal"
    (none,) = compare(told, "mine", ["nobody"])
    assert none.environments == 0
    assert math.isnan(none.better)


def test_only_environments_that_both_have_are_compared():
    (compared,) = compare([*rows("both", [-2.0] * 6), *rows("half", [-3.0, -1.0])], "both", ["half"])
    assert compared.environments == 2


def test_versions_are_not_compared_with_each_other():
    builds = [("4622a3d6f0aa", "c0de" * 6), ("5d01c2b3e4bb", "d1" * 12)]
    told = [
        made_row(name, 0, [-1.0], versions={"wbf-mission": "0.1.0", "commit": commit}, codes={"code": code})
        for commit, code in builds
        for name in "ab"
    ]
    assert [(one.scenario, one.environments) for one in compare(told, "a", ["b"])] == [
        ("WBF/Some-v1 [0.1.0, 4622a3d6]", 1),
        ("WBF/Some-v1 [0.1.0, 5d01c2b3]", 1),
    ]


def test_compare_gives_a_verdict_and_keeps_what_it_flew(tmp_path, capsys):
    arguments = ["bench", "compare", "spiral", "--against", "lawnmower", "--scenarios", "WBF/Miniberry-10-v1"]
    arguments += ["--estimators", "point", "--out", str(tmp_path / "b")]
    assert main([*arguments, "--seeds", "2", "--json"]) == 0
    (one,) = json.loads(capsys.readouterr().out)
    assert (one["mine"], one["against"], one["environments"]) == ("spiral", "lawnmower", 2)
    assert one["verdict"] in {"better", "worse", "undecided"}
    assert len(read_rows(tmp_path / "b")) == 4
    assert main([*arguments, "--seeds", "2"]) == 0
    assert "difference of scores" in capsys.readouterr().out
    assert main(["bench", "compare", "spiral", "--against", "spiral"]) == 2


def test_few_environments_are_said_to_be_few():
    assert "31 %" in doubt_in_words(8) and "may hold in only 50 of 100" in doubt_in_words(8)
    assert "may hold" not in doubt_in_words(40)
    assert "Ratios" in doubt_in_words(7) and "Ratios" not in doubt_in_words(8)
