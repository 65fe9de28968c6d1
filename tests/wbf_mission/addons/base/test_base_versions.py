"""Rows of different versions are told apart."""

import pytest
from bench_rows import made_row

from wbf_mission.addons.base.standings import apart, builds_in_words, standings

OLD, NEW = "4622a3d6f0aa", "5d01c2b3e4bb"


def flown(name="a", seed=0, version="0.1.0", commit=OLD, code="c0de" * 6, objects=None, **codes):
    return made_row(
        name,
        seed,
        [-1.0],
        versions={"wbf-mission": version, "commit": commit},
        codes={"code": code, "scenario": "5c", **codes},
        objects=objects or {},
    )


def names(rows, what="scenario"):
    return [getattr(row, what) for row in apart(rows)]


@pytest.mark.parametrize(
    ("others", "labels"),
    [
        ({"commit": NEW, "code": "d1" * 12}, ["0.1.0, 4622a3d6", "0.1.0, 5d01c2b3"]),
        ({"version": "0.2.0", "code": "d1" * 12}, ["0.1.0, 4622a3d6", "0.2.0, 4622a3d6"]),
        ({"code": "d1" * 12}, ["0.1.0, 4622a3d6, c0dec0de", "0.1.0, 4622a3d6, d1d1d1d1"]),
    ],
)
def test_rows_of_other_code_are_named_by_version_and_commit(others, labels):
    rows = [flown(), flown(seed=1, **others)]
    assert names(rows) == [f"WBF/Some-v1 [{one}]" for one in labels]
    assert [one.environments for one in standings(rows)] == [1, 1]


def test_the_same_code_of_two_commits_counts_together_and_is_told():
    rows = [flown(), flown(seed=1, commit=NEW)]
    assert apart(rows) is rows
    told = "rows of 2 versions (0.1.0, 4622a3d6: 1 rows; 0.1.0, 5d01c2b3: 1 rows), of the same behaviour"
    assert builds_in_words(rows) == told


def test_objects_are_told_apart_by_their_parameters():
    rows = [
        flown(
            "UCB", planner_code, objects={"planner": f"UCB(beta={planner_code}.0)"}, planner=str(planner_code)
        )
        for planner_code in (1, 9)
    ]
    assert names(rows, "planner") == ["UCB(beta=1.0)", "UCB(beta=9.0)"]
    changed = [flown("UCB", k, objects={"planner": "UCB(beta=1.0)"}, planner=f"{k}" * 24) for k in (1, 2)]
    assert names(changed, "planner") == ["UCB [UCB(beta=1.0), 11111111]", "UCB [UCB(beta=1.0), 22222222]"]
