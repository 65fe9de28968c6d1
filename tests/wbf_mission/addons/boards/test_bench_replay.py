"""Runs of a benchmark flown again from their rows: which row, what is compared, and what is said."""

from __future__ import annotations

import json
import math
from array import array

import msgspec
import numpy as np
import pytest
from bench_rows import made_row

from wbf_mission.addons.boards.replay import causes, differences, row_named
from wbf_mission.bench.rows import read_rows
from wbf_mission.cli.app import main
from wbf_mission.results.storage import ResultError

OWN = """
import numpy as np
from mission.policies.decision import NO_CHANGE, Decision
from mission.policies.policy import Triggers


class Across:
    triggers = Triggers()

    def __init__(self, part=0.5):
        self.part = part

    def start(self):
        pass

    def decide(self, observation):
        if observation.event.value != "start":
            return NO_CHANGE
        return Decision({1: [[self.part, self.part], [2.0, 2.0]]}, reason="across")
"""


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    file = tmp_path_factory.mktemp("own") / "across.py"
    file.write_text(OWN)
    return file


@pytest.fixture(scope="module")
def folder(tmp_path_factory, own):
    """Return the results of a policy, a planner and a user's own policy in one environment."""
    out = tmp_path_factory.mktemp("bench") / "results"
    planners = f"greedy,spiral,{own}:Across:part=0.6"
    wanted = ["--scenarios", "WBF/Miniberry-10-v1", "--planners", planners, "--estimators", "adaptive-disk"]
    assert main(["bench", "run", *wanted, "--seeds", "1", "--out", str(out), "--quiet"]) == 0
    return out


@pytest.fixture(scope="module")
def rows(folder):
    return {row.planner: row for row in read_rows(folder)}


def replayed(capsys, folder, *options):
    """Return the exit code of the command, what it told as JSON, and its last line of errors."""
    code = main(["bench", "replay", str(folder), *options, "--json"])
    told = capsys.readouterr()
    return code, json.loads(told.out) if told.out else None, told.err


def test_a_row_is_named_by_the_beginning_of_its_key(tmp_path):
    rows = [made_row("a", seed, [-1.0], key=f"{seed}{'ab' * 11}") for seed in (10, 11, 20)]
    assert row_named(rows, "20AB", tmp_path).seed == 20
    with pytest.raises(ResultError, match="no row has a key that begins with 'ff'; 'bench replay"):
        row_named(rows, "ff", tmp_path)
    with pytest.raises(ResultError, match=r"2 rows have keys that begin with '1': 10ababab .*seed 10; 11"):
        row_named(rows, "1", tmp_path)


def test_every_value_is_compared_to_the_bit():
    row = made_row("a", 0, [-0.5, -0.25], history={"tylcv": array("d", [0.5, 0.25])})
    assert list(differences(row, row)) == []
    nan = msgspec.structs.replace(row, history={"tylcv": array("d", [math.nan, 0.25])})
    assert list(differences(nan, nan)) == []
    next_score = array("d", [-0.5, float(np.nextafter(-0.25, 0.0))])
    assert list(differences(row, msgspec.structs.replace(row, scores=next_score))) == [
        "scores (1 of 2 values from the 2. on, by at most 2.78e-17)"
    ]
    assert list(differences(row, msgspec.structs.replace(row, score=-0.3))) == [
        "score (-0.375 then, -0.3 now)"
    ]
    assert list(differences(row, msgspec.structs.replace(row, times_s=array("d", [10.0])))) != []
    assert list(differences(row, msgspec.structs.replace(row, history={}))) == ["history of tylcv"]
    # What a run costs, and how it ends by the clock of the wall, decide nothing.
    assert (
        list(differences(row, msgspec.structs.replace(row, wall_time_s=9.0, bad_answers={"too late": 1})))
        == []
    )


def test_what_can_be_why_is_said():
    row = made_row(
        "a", 0, [-1.0], codes={"code": "1", "scenario": "2"}, versions={"numpy": "1", "python": "3"}
    )
    assert list(causes(row, row)) == []
    other = {"codes": {"code": "9", "scenario": "8"}, "versions": {"numpy": "2", "python": "3"}}
    assert list(causes(row, msgspec.structs.replace(row, **other))) == [
        "a change of the program's behaviour, the scenario's settings",
        "another numpy (1 then, 2 now)",
    ]
    here, there = (
        msgspec.structs.replace(row, hardware={"kernels": name}) for name in ("Haswell", "SkylakeX")
    )
    assert list(causes(here, there)) == ["other linear algebra kernels (Haswell then, SkylakeX now)"]
    old = msgspec.structs.replace(row, codes={})
    assert list(causes(old, row)) == ["no record of behaviour numbers in the row"]


def test_without_a_row_the_keys_are_listed_the_worst_first(folder, rows, capsys):
    code, told, _ = replayed(capsys, folder)
    assert code == 0
    assert [one["key"] for one in told] == [
        row.key for row in sorted(rows.values(), key=lambda row: row.score)
    ]
    assert main(["bench", "replay", str(folder)]) == 0
    shown = capsys.readouterr().out
    assert all(row.key[:8] in shown and row.key not in shown for row in rows.values())


@pytest.mark.parametrize("planner", ["greedy", "spiral"])
def test_a_run_is_flown_again_to_the_bit(folder, rows, planner, tmp_path, capsys):
    row = rows[planner]
    options = [row.key[:8], "--out", str(tmp_path), "--format", "png,pdf"]
    code, told, errors = replayed(capsys, folder, *options)
    assert (code, told["equal"], told["differences"], told["causes"]) == (0, True, [], [])
    assert told["decisions"] == row.decisions
    assert told["acquisition_maps"] == (row.decisions if planner == "greedy" else 0)
    assert ("spiral uses no acquisition map" in errors) == (planner == "spiral")
    pictures = [tmp_path / f"{row.key[:8]}.{kind}" for kind in ("png", "pdf")]
    assert told["pictures"] == [str(one) for one in pictures]
    assert pictures[0].read_bytes().startswith(b"\x89PNG") and pictures[1].read_bytes().startswith(b"%PDF")
    assert sorted(tmp_path.iterdir()) == sorted(pictures)


def test_a_users_policy_is_flown_again_from_its_file(folder, rows, own, tmp_path, capsys):
    row = rows["Across:part=0.6"]
    options = [row.key, "--out", str(tmp_path), "--format", "png"]
    code, told, _ = replayed(capsys, folder, *options, "--planner", f"{own}:Across:part=0.6")
    assert (code, told["equal"], told["causes"]) == (0, True, [])
    code, _, errors = replayed(capsys, folder, *options, "--planner", f"{own}:Across:part=0.7")
    assert code == 2 and "is not the planner of the row, Across:part=0.6" in errors
    code, _, errors = replayed(capsys, folder, *options)
    assert code == 2 and "was an object" in errors
    code, _, errors = replayed(capsys, folder, *options, "--planner", "greedy")
    assert code == 2 and "give FILE.py:NAME" in errors


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["ffff"], "no row has a key that begins with 'ffff'"),
        (["", "--format", "svg"], "unknown format 'svg': choose html, png, pdf"),
        (["", "--format", ","], "no format is named"),
        ([""], "3 rows have keys that begin with ''"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(folder, options, says, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, errors = replayed(capsys, folder, *options)
    assert code == 2
    assert says in errors and "Traceback" not in errors
    assert list(tmp_path.iterdir()) == []


def test_a_folder_without_results_is_said(tmp_path, capsys):
    code, _, errors = replayed(capsys, tmp_path)
    assert code == 2 and "holds no results of a benchmark" in errors
