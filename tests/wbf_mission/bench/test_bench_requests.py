"""What a folder of rows was asked for, and the cards of its scenarios."""

import json

import pytest

from sensors.estimators.point import PointEstimator
from wbf_mission import BenchSpec
from wbf_mission.bench.digests import meaning_of
from wbf_mission.bench.requests import ASKED, card_of, keep_asked, read_asked, specification_text
from wbf_mission.cli.app import main
from wbf_mission.results.storage import ResultError
from wbf_mission.scenario import load_scenario

TEN = "WBF/Miniberry-10-v1"


def spec_of(**given):
    return BenchSpec.of(**{"scenarios": [TEN], "planners": ["spiral"], "estimators": ["point"], **given})


def test_a_specification_comes_back_from_its_text(tmp_path):
    spec = spec_of(planners=["lawnmower:direction=0.3", "greedy"], seeds=[5, *range(100, 104)])
    (tmp_path / "again.toml").write_text(specification_text(spec))
    assert BenchSpec.read(tmp_path / "again.toml") == spec


def test_objects_stand_in_a_comment():
    text = specification_text(spec_of(estimators=[PointEstimator(), "gp"], seeds=3))
    assert 'estimators = ["gp"]' in text
    assert '# a file cannot hold estimators of your own; give them all on the command line: ["Point' in text
    assert text.endswith("\nseeds = 3")


def test_what_is_asked_again_stands_there_once(tmp_path):
    for command in ("one", "two", "one"):
        keep_asked(tmp_path, spec_of(seeds=2), command)
    keep_asked(tmp_path, spec_of(seeds=3), "two")
    found = read_asked(tmp_path)
    assert [one.command for one in found.asked] == ["one", "two", "two"]
    assert [one.specification.splitlines()[-1] for one in found.asked] == ["seeds = 2"] * 2 + ["seeds = 3"]
    assert [one.scenario for one in found.cards] == [TEN]
    assert found.asked[0].when.endswith("+00:00")


@pytest.mark.parametrize("content", ["{", '{"asked": 3}', '{"asked": [], "cards": [], "more": 1}', "\xff"])
def test_a_damaged_file_is_told_and_not_replaced(tmp_path, content):
    (tmp_path / ASKED).write_bytes(content.encode("latin-1"))
    with pytest.raises(ResultError, match=r"asked.json: is not a list of requests.*; remove the file"):
        keep_asked(tmp_path, spec_of(seeds=2), "")
    assert (tmp_path / ASKED).read_bytes() == content.encode("latin-1")


def test_a_card_tells_what_is_not_at_its_default_and_what_is_scored(tmp_path):
    card = card_of(TEN, load_scenario(TEN))
    assert card.farm == (
        "miniberry-10: 10 x 10 cells of 0.3048 m; cells of the owner: strawberry 50, tomato 50"
    )
    assert card.scored == "tylcv (1), ccr (0.2), soil (0.1), by these weights, at 40 times of a flight"
    assert (card.options["budget"], card.options["vehicle"]) == ("40steps", "ideal")
    assert not {"planner", "estimator", "seed", "wind_speed_m_s"} & set(card.options)
    assert card.meaning == meaning_of(load_scenario(TEN))
    (tmp_path / "own.toml").write_text('farm = "miniberry-10"\nfields = ["tylcv"]\nparameters = {A = 1}\n')
    own = card_of("own.toml", load_scenario(tmp_path / "own.toml"))
    assert (own.about, own.options) == (
        "",
        {"farm": "miniberry-10", "fields": "tylcv", "parameters": "A=1.0"},
    )


def test_a_card_is_shown(capsys):
    assert main(["bench", "show", TEN, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["options"]["budget"] == "40steps"
    assert main(["bench", "show", TEN]) == 0
    told = capsys.readouterr().out
    assert ("miniberry-10: 10 x 10 cells" in told, "40steps" in told) == (True, True)
    assert main(["bench", "show", "WBF/None-v1"]) == 2


def test_a_folder_keeps_the_command_that_made_it(tmp_path, capsys):
    out = str(tmp_path / "a folder")
    run = ["--scenarios", TEN, "--planners", "spiral", "--estimators", "point"]
    assert main(["bench", "run", *run, "--seeds", "7..8", "--out", out, "-q"]) == 0
    (asked,) = read_asked(tmp_path / "a folder").asked
    assert asked.command == f"wbf-mission bench run {' '.join(run)} --seeds 7..8 --out '{out}' -q"
    assert asked.specification.endswith('seeds = "7..8"')
    assert main(["bench", "run", *run, "--seeds", "8..7", "--out", out]) == 2
    assert "'8..7' is neither a seed nor a range of seeds" in capsys.readouterr().err
