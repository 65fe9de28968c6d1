"""The packs of frozen baselines in ``results``: each holds what it says, and all make the published board."""

import json
import random
from pathlib import Path

import pytest
from bench_packs import pack_of
from write_frozen_sums import table

from wbf_mission.addons.boards.audit import require_whole
from wbf_mission.addons.boards.board import FROZEN, board_of, frozen_sums, packs_of
from wbf_mission.addons.boards.submission import read_pack
from wbf_mission.addons.boards.verification import fly_again
from wbf_mission.cli.app import main
from wbf_mission.version import behaviour

RESULTS = Path(__file__).parents[4] / "results"
PACKS = [path for path, _ in packs_of([RESULTS])]
FLOWN = 1


@pytest.fixture(scope="module", params=PACKS, ids=[path.relative_to(RESULTS).as_posix() for path in PACKS])
def pack(request):
    return read_pack(request.param), request.param


def test_a_pack_holds_what_it_says(pack):
    read, path = pack
    require_whole(read.rows)
    assert read.submission.version == path.parent.name
    assert read.submission.code == behaviour()
    assert not read.submission.own


@pytest.mark.slow
def test_rows_that_the_present_code_flew_come_out_equal(at_once, pack):
    read, _ = pack
    # What epidemic learns on a farm takes minutes where nobody has learned it before.
    good = [row for row in read.rows if row.error is None and row.estimator != "epidemic"]
    quickest = sorted(good, key=lambda row: row.cpu_time_s)[: max(FLOWN, len(good) // 10)]
    drawn = random.Random(read.digest).sample(quickest, FLOWN)
    found = fly_again(drawn, FLOWN)
    assert not found.differing
    assert len(found.rows) == FLOWN


def test_the_package_has_their_sums():
    # python tools/write_frozen_sums.py writes them.
    assert FROZEN.read_bytes() == table()
    assert set(frozen_sums()) == {path.relative_to(RESULTS).as_posix() for path in PACKS}


def test_a_pack_that_only_has_the_name_of_a_frozen_one_is_left_out(at_once, tmp_path):
    (folder := tmp_path / "0.1.0").mkdir()
    read = read_pack(RESULTS / "0.1.0/WBF-Miniberry-10-v1.zip")
    rows = [row for row in read.rows if (row.planner, row.estimator) == ("lawnmower", "adaptive-disk")]
    pack_of(rows, folder / "WBF-Miniberry-10-v1.zip")
    (why,) = board_of(packs_of([tmp_path]), verify=0).refused.values()
    assert "differs from the frozen baseline 0.1.0/WBF-Miniberry-10-v1.zip (SHA-256)" in why
    # Under another name it is a baseline that nobody knows, whose rows are flown again.
    (folder / "WBF-Miniberry-10-v1.zip").rename(folder / "mine.zip")
    (entry,) = board_of(packs_of([tmp_path])).entries
    assert entry.frozen
    assert str(entry.verification) == "1 equal"


def test_they_are_small():
    assert sum(path.stat().st_size for path in PACKS) < 20e6


def test_every_pack_is_told_of(pack):
    assert f"`{pack[1].relative_to(RESULTS).as_posix()}`" in (RESULTS / "README.md").read_text()


def test_they_make_the_board_that_a_newcomer_makes(capsys):
    assert main(["bench", "board", str(RESULTS), "--json", "--quiet"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["submissions"]) == len(PACKS)
    assert all(one["frozen"] for one in told["submissions"])
    assert not told["refused"]
