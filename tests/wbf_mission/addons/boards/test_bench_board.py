"""The leaderboard: who stands in which table, against what, and what is refused."""

import json

import numpy as np
import pytest
from bench_packs import flown, pack_of, told_of
from msgspec import structs

from wbf_mission.addons.boards import board as board_module
from wbf_mission.addons.boards import verification
from wbf_mission.addons.boards.audit import require_whole
from wbf_mission.addons.boards.board import board_of, packs_of
from wbf_mission.addons.boards.board_page import board_values
from wbf_mission.addons.boards.sealed import Secret
from wbf_mission.addons.boards.verification import fly_again
from wbf_mission.bench.rows import read_rows
from wbf_mission.cli.app import main
from wbf_mission.results.storage import ResultError

MARKUP = "[a](b) <img src=x>|"


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    return read_rows(flown(tmp_path_factory.mktemp("flown") / "results", seeds=4))


@pytest.fixture
def frozen(rows, tmp_path):
    (tmp_path / "frozen" / "0.1.0").mkdir(parents=True)
    pack_of(rows, tmp_path / "frozen" / "0.1.0" / "WBF.zip", name="Baselines")
    return tmp_path / "frozen"


def seeds(rows, *kept):
    return [row for row in rows if row.seed in kept]


def board(*paths, verify=0, **given):
    return board_of(packs_of(paths), verify=verify, **given)


def test_packs_in_folders_are_the_baselines(frozen, rows, tmp_path):
    mine = pack_of(rows, tmp_path / "mine.zip")
    assert packs_of([frozen, mine]) == [(frozen / "0.1.0" / "WBF.zip", True), (mine, False)]
    assert packs_of([mine, tmp_path]) == [(mine, True), (frozen / "0.1.0" / "WBF.zip", True)]
    (tmp_path / "empty").mkdir()
    with pytest.raises(ResultError, match="has no pack"):
        packs_of([tmp_path / "empty"])


def test_methods_on_the_same_environments_stand_in_one_table(frozen, rows, tmp_path):
    mine = pack_of(seeds(rows, 0, 1, 2, 3), tmp_path / "mine.zip", name="Mine")
    (table,) = board(frozen, mine).tables
    assert (table.seeds, table.held_out) == ((0, 1, 2, 3), False)
    assert [one.entry.submission.name for one in table.lines].count("Mine") == 2
    scores = [one.standing.score.mean for one in table.lines]
    assert scores == sorted(scores, reverse=True)
    best = next(one for one in table.lines if one.against is None)
    assert best.entry.frozen
    for one in table.lines:
        if one.against is not None:
            there = {row.seed: row.score for row in rows if row.planner == one.standing.planner}
            other = {row.seed: row.score for row in rows if row.planner == best.standing.planner}
            wanted = np.mean([there[seed] - other[seed] for seed in there])
            assert one.against.score.mean == pytest.approx(wanted)


def test_a_submission_of_few_environments_has_a_table_of_its_own(frozen, rows, tmp_path):
    few = pack_of(seeds(rows, 1, 2), tmp_path / "few.zip", name="Few")
    whole, part = board(frozen, few).tables
    assert (whole.seeds, len(whole.lines)) == ((0, 1, 2, 3), 2)
    assert {one.entry.submission.name for one in whole.lines} == {"Baselines"}
    assert (part.seeds, len(part.lines)) == ((1, 2), 4)
    assert part.environments == "2 environments that a submission chose (seeds 1..2)"
    assert whole.environments == "4 environments (seeds 0 to 3)"


def test_what_is_refused_is_told_and_the_others_go_on(at_once, frozen, rows, tmp_path, capsys):
    (tmp_path / "bad.zip").write_bytes(b"PK\x03\x04 no archive")
    better = [structs.replace(row, score=-0.001) for row in rows]
    lies = pack_of(better, tmp_path / "lies.zip")
    copy = tmp_path / "copy.zip"
    copy.write_bytes((frozen / "0.1.0" / "WBF.zip").read_bytes())
    given = [str(one) for one in (frozen, tmp_path / "bad.zip", lies, copy, tmp_path / "none.zip")]
    assert main(["bench", "board", *given, "--json"]) == 1
    told = capsys.readouterr()
    values = json.loads(told.out)
    assert len(values["tables"]) == 1
    assert [len(one["methods"]) for one in values["tables"]] == [2]
    assert set(values["refused"]) == set(given[1:])
    assert "is not the mean of the scores in its history" in values["refused"][str(lies)]
    assert "is the same file as" in values["refused"][str(copy)]
    assert told.err.count("left out: ") == 4
    assert main(["bench", "board", str(tmp_path / "bad.zip")]) == 2


def test_rows_are_flown_again_and_own_code_is_not(at_once, frozen, rows, tmp_path, capsys):
    codes = rows[0].codes | {"planner": "f" * 24}
    own = [told_of(row, planner="mine", codes=codes) for row in rows if row.planner == "spiral"]
    mine = pack_of([*own, *(row for row in rows if row.planner != "spiral")], tmp_path / "mine.zip")
    found = board(frozen, mine, verify=2)
    again = {entry.submission.name: str(entry.verification) for entry in found.entries}
    assert again["Baselines"] == "4 equal", "two of each method"
    assert again["Some"] == "2 equal; not flown again (1 of 2 methods): own code is not run"
    (counted,) = (one for one in board_values(found)["tables"][0]["methods"] if one["own_code"])
    assert (counted["name"], counted["flown_again"]) == ("Some", "not flown again: own code is not run")
    assert main(["bench", "board", str(mine)]) == 0
    told = capsys.readouterr()
    assert f"{mine}: 1 equal; not flown again (1 of 2 methods): own code is not run" in told.err
    assert "flown again" in told.out


def test_a_run_without_end_does_not_hold_up_the_board(frozen, rows, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(verification, "_MOST_S", 0.01)
    monkeypatch.setattr(board_module, "is_frozen", lambda *_: True)
    mine = pack_of(rows, tmp_path / "mine.zip", name="Mine")
    assert main(["bench", "board", str(frozen), str(mine)]) == 1
    assert capsys.readouterr().err.count("the second flight did not end in 0.01 s") == 2
    told = {one.submission.name: str(one.verification) for one in board(frozen, mine, verify=None).entries}
    assert told == {"Baselines": "not requested", "Mine": "2 not ended"}


@pytest.mark.parametrize("label", ["gp:cache=/tmp/elsewhere", "gp:cache=here"])
def test_no_row_names_files_of_the_one_who_checks(label, rows):
    given = [told_of(row, estimator=label) for row in rows]
    one = fly_again(given, 1)
    assert not one.rows
    assert [why for _, why in one.left_out] == ["its parameters name local files"] * 2
    with pytest.raises(ResultError, match=r"estimator gp:cache.*: its parameters name local files"):
        require_whole(given)


NAMELESS = "begins without a name"
NO_VALUES = "its history has a number that is not finite, or an impossible loss"


def history(row, change):
    """Return the values of a row whose history is another one, and agrees with itself."""
    scores = change(np.array(row.scores))
    losses = {name: change(np.array(one)) for name, one in row.history.items()}
    floats = type(row.scores)
    return {
        "scores": floats("d", scores),
        "history": {name: floats("d", one) for name, one in losses.items()},
        "score": float(np.mean(scores)),
        "final_score": scores[-1],
        "losses": {name: one[-1] for name, one in losses.items()},
    }


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"planner": "super-greedy"}, "unknown planner or policy 'super-greedy'"),
        ({"planner": "greedy:nothing=1"}, "policy greedy: unknown parameter 'nothing'"),
        ({"planner": ""}, NAMELESS),
        ({"codes": {"planner": "gp" * 12}}, "its code digest is malformed"),
        (lambda row: history(row, lambda values: values * 1e300), NO_VALUES),
        (lambda row: {"key": "0" * len(row.key)}, "its key does not belong to this run"),
    ],
)
def test_what_no_run_can_have_told_is_refused(values, why, rows):
    def changed(row):
        given = dict(values(row) if callable(values) else values)
        for name in ("codes", "versions"):
            given[name] = getattr(row, name) | given.get(name, {})
        return structs.replace(row, **given) if "key" in given else told_of(row, **given)

    with pytest.raises(ResultError, match=why):
        require_whole([changed(row) for row in rows])


def test_small_differences_are_those_of_numbers_only(at_once, rows):
    def verified(**values):
        return str(fly_again([structs.replace(rows[0], **values)], 1))

    assert verified(**history(rows[0], lambda values: values * (1.0 + 1e-9))) == "1 within 1e-06"
    for values in ({"outcome": "landed on the moon"}, {"observations": 1}, {"path_length_m": 1.0}):
        assert verified(**values) == "1 differ", values
    assert verified(**history(rows[0], lambda values: values[::-1])) == "1 differ"
    assert verified(**history(rows[0], lambda values: values[1:])) == "1 differ"


def test_who_makes_a_board_draws_the_rows(at_once, rows):
    drawn = [tuple(one.seed for one in fly_again(rows, 1, salt=bytes([k])).rows) for k in (1, 1, 2, 3, 4)]
    assert drawn[0] == drawn[1]
    assert len(set(drawn)) > 1
    assert all(len(one) == 2 for one in drawn), "one of each method"


def test_a_pack_of_very_many_methods_is_refused(rows):
    many = [
        told_of(rows[0], planner=f"p{k}", codes=rows[0].codes | {"planner": "f" * 24}) for k in range(301)
    ]
    with pytest.raises(ResultError, match="has 301 methods on 1 environments; at most"):
        require_whole(many)


def test_rows_of_other_code_are_not_compared(rows):
    other = [structs.replace(row, codes=row.codes | {"code": "1.2.3"}) for row in rows]
    found = fly_again(other, 3)
    assert not found.rows
    assert str(found) == "not flown again: flown with behaviour numbers that differ from this version's"


def test_held_out_environments_are_those_of_the_seal(rows, tmp_path):
    secret = Secret(secret="ab" * 32, environments=2, scenarios=[], made="")
    number = dict(enumerate(secret.seeds()))
    sealed = [told_of(row, seed=number[row.seed]) for row in seeds(rows, 0, 1)]
    seal = secret.seal().seal
    paths = [pack_of(sealed, tmp_path / "held.zip", seal=seal), pack_of(rows, tmp_path / "open.zip")]
    first, second = board(*paths, secret=secret).tables
    assert (first.held_out, first.environments) == (True, "2 held-out environments")
    assert second.held_out is False
    assert [one.held_out for one in board(*paths).tables] == [False, False]
    elsewhere = structs.replace(secret, scenarios=["WBF/Miniberry-30-v1"])
    assert [one.held_out for one in board(*paths, secret=elsewhere).tables] == [False, False]


def test_the_page_holds_names_as_texts(at_once, rows, tmp_path):
    packs = [pack_of(rows, tmp_path / "a.zip", name=MARKUP), pack_of(rows, tmp_path / "b.zip", by=MARKUP)]
    assert main(["bench", "board", *map(str, packs), "--out", str(tmp_path / "board"), "--quiet"]) == 0
    assert sorted(one.name for one in (tmp_path / "board").iterdir()) == [
        "board-1.png",
        "board.html",
        "board.json",
        "board.md",
    ]
    text = (tmp_path / "board" / "board.md").read_text()
    assert "\\[a](b) &lt;img src=x>\\|" in text
    assert "<img" not in text
    page = (tmp_path / "board" / "board.html").read_text()
    assert "<img src=x>" not in page
    assert json.loads((tmp_path / "board" / "board.json").read_text())["tables"][0]["environments"] == 4
