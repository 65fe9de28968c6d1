"""Submissions: what is packed comes back, and a pack of somebody's is read without trust."""

import hashlib
import json
import os
import re
import sys
import warnings

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from bench_packs import (
    ABOUT,
    SCENARIO,
    changed,
    flown,
    members_of,
    pack_of,
    told_of,
    told_otherwise,
    written,
)
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from msgspec import structs
from sweeps import sweep

from wbf_mission.addons.boards import submission, verification
from wbf_mission.addons.boards.audit import require_whole
from wbf_mission.addons.boards.submission import code_files, read_pack
from wbf_mission.bench.rows import TABLE, read_rows
from wbf_mission.cli.app import main
from wbf_mission.results import storage
from wbf_mission.results.storage import ResultError

OWN = """
from mission.planners import make_planner


def zigzag(request):
    return make_planner("lawnmower")(request)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return flown(tmp_path_factory.mktemp("flown") / "results")


@pytest.fixture(scope="module")
def rows(folder):
    return read_rows(folder)


@pytest.fixture(scope="module")
def pack(rows, tmp_path_factory):
    return pack_of(rows, tmp_path_factory.mktemp("pack") / "some.zip", code={"code/a.py": b"x = 1\n"})


def submit(folder, out, *more, capsys):
    code = main(["bench", "submit", str(folder), "--name", "Mine", "--by", "Me", "--out", str(out), *more])
    return code, capsys.readouterr()


def test_what_is_packed_comes_back(rows, pack):
    read = read_pack(pack)
    assert read.rows == rows
    told = read.submission
    assert (told.name, told.by, told.code) == ("Some", "Somebody", rows[0].codes["code"])
    (one,) = told.flown
    assert (one.scenario, one.seeds) == (SCENARIO, "3")
    assert one.methods == [("lawnmower", "point"), ("spiral", "point")]
    assert one.meaning == rows[0].codes["scenario"]
    assert told.hardware == [rows[0].hardware]
    assert set(told.files) == {TABLE, "code/a.py"}
    assert told.files["code/a.py"] == hashlib.sha256(b"x = 1\n").hexdigest()


def test_equal_content_gives_equal_bytes(folder, tmp_path, capsys):
    for name in ("one.zip", "two.zip"):
        assert submit(folder, tmp_path / name, "--verify", "0", capsys=capsys)[0] == 0
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "two.zip").read_bytes()


def test_rows_are_flown_again_to_the_bit(folder, tmp_path, capsys):
    code, told = submit(folder, tmp_path / "mine.zip", "--verify", "2", "--json", capsys=capsys)
    assert code == 0
    assert json.loads(told.out)["flown_again"] == "4 equal"
    assert len(read_pack(tmp_path / "mine.zip").rows) == 6


def other(**values):
    return lambda number, row: structs.replace(row, **values) if number == 1 else row


def floats(values):
    from array import array

    return array("d", values)


WRONG = {
    "a missing run": (lambda number, row: None if number == 1 else row, "no rows for 1 requested runs"),
    "two codes": (
        lambda n, row: structs.replace(row, codes=row.codes | {"code": str(n)}),
        "rows of 6 program behaviours",
    ),
    "no code": (other(codes={}), "do not name the code that flew them"),
    "another scenario": (other(scenario="mine.toml"), "mine.toml is not in the catalogue"),
    "another meaning": (
        lambda number, row: structs.replace(row, codes=row.codes | {"scenario": "1" * 24}),
        "have changed since the flights",
    ),
    "two own planners": (
        lambda n, row: structs.replace(row, codes=row.codes | {"planner": str(n)}),
        "has 3 code digests",
    ),
    "a better score": (other(score=-0.01), "its score -0.01 is not the mean of the scores in its history"),
    "a better end": (other(final_score=-0.01), "is not the last score in its history"),
    "better losses": (other(losses=dict.fromkeys(("tylcv", "ccr", "soil"), 0.0)), "its loss of tylcv is not"),
    "other fields": (other(losses={"rust": 0.0}), "its losses are for other fields than tylcv, ccr, soil"),
    "no score": (other(score=None, final_score=None), "it has a history, but no score"),
    "a short list": (other(times_s=floats([1.0])), "different lengths"),
    "better scores throughout": (
        lambda n, row: structs.replace(
            row,
            scores=floats(np.array(row.scores) / 2),
            score=float(np.mean(np.array(row.scores) / 2)),
            final_score=row.scores[-1] / 2,
        ),
        "its scores do not follow from its losses",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_told_in_a_line(what, folder, tmp_path, capsys):
    change, why = WRONG[what]
    there = changed(folder, tmp_path / "changed", change)
    (there / "asked.json").write_bytes((folder / "asked.json").read_bytes())
    if what != "a missing run":
        (there / "asked.json").unlink()
    code, told = submit(there, tmp_path / "mine.zip", capsys=capsys)
    assert code == 2
    assert why in told.err
    assert told.err.count("\n") == 1
    assert not (tmp_path / "mine.zip").exists()


def scaled(row, factor, keep=slice(None), **values):
    """Return a row whose losses are others, consistent in itself."""
    history = {name: floats(np.array(one)[keep] * factor) for name, one in row.history.items()}
    scores = floats(np.array(row.scores)[keep] * factor)
    return structs.replace(
        row,
        scores=scores,
        history=history,
        times_s=floats(np.array(row.times_s)[keep]),
        score=float(np.mean(scores)),
        final_score=scores[-1],
        losses={name: one[-1] for name, one in history.items()},
        **values,
    )


MADE_UP = {
    "the end alone": (lambda row: scaled(row, 1.0, slice(-1, None)), "1 scored times, but its readings give"),
    "more than all": (
        lambda row: scaled(row, 1.0, np.sort(np.tile(np.arange(33), 4))),
        "scored times, but its readings give",
    ),
    "no loss": (lambda row: scaled(row, 0.0), "an estimate is perfect, but only"),
    "losses beyond all": (lambda row: scaled(row, 1e5), "a loss of tylcv is not between 0 and 250"),
    "times before the flight": (
        lambda row: structs.replace(row, times_s=floats(np.array(row.times_s) - 9)),
        "its scored times do not rise",
    ),
    "no time": (lambda row: structs.replace(row, cpu_time_s=-5.0), "its cpu_time_s is -5"),
    "a part of no time": (lambda row: structs.replace(row, timings_s={"plan": -1.0}), "negative or not"),
    "no length": (lambda row: structs.replace(row, path_length_m=-1.0), "its path_length_m is -1"),
    "many readings": (lambda row: structs.replace(row, observations=10**9), "readings are more than"),
    "many cells": (lambda row: structs.replace(row, cells_observed=200), "200 cells observed are not"),
    "no readings": (lambda row: structs.replace(row, observations=None), "no value for observations"),
    "another budget": (lambda row: structs.replace(row, budget="9999 steps"), "its budget is 9999 steps"),
    "a long flight": (lambda row: structs.replace(row, flight_time_s=1e9), "it flew for 1e+09 s"),
    "a fast flight": (lambda row: structs.replace(row, path_length_m=13.0), "its vehicles cannot fly 13 m"),
    "bad answers": (lambda row: structs.replace(row, bad_answers={"crashed": 2}), "2 bad answers among"),
    "bad answers for nothing": (
        lambda row: structs.replace(row, decisions=20, bad_answers={"crashed": 9}),
        "9 of 20 answers were bad, but it is not marked as failed",
    ),
    "a built-in name": (
        lambda row: told_of(row, codes=row.codes | {"planner": "b" * 24}),
        "your own code with the name of a built-in method",
    ),
}


@pytest.mark.parametrize("what", MADE_UP)
def test_what_no_run_of_the_scenario_gives_is_refused(what, rows):
    change, why = MADE_UP[what]
    (spiral,) = (row for row in rows if (row.planner, row.seed) == ("spiral", 0))
    require_whole([spiral])
    with pytest.raises(ResultError, match=re.escape(why)):
        require_whole([change(spiral)])


def test_environments_that_were_chosen_are_refused(rows):
    with pytest.raises(ResultError, match="seeds 0,2 have gaps between 0 and 2"):
        require_whole([row for row in rows if row.seed != 1])
    require_whole([row for row in rows if row.seed != 1], sealed=True)
    require_whole([row for row in rows if row.seed])


def test_a_seed_that_others_have_is_missed_without_a_specification(folder, tmp_path, capsys):
    there = changed(folder, tmp_path / "changed", lambda number, row: None if number == 1 else row)
    code, told = submit(there, tmp_path / "mine.zip", capsys=capsys)
    assert code == 2
    assert "lawnmower, point: no rows for seeds 1, which other methods have; fly these seeds, too" in told.err


def test_rows_that_are_not_what_is_flown_are_found_out(at_once, folder, tmp_path, capsys):
    there = changed(folder, tmp_path / "changed", lambda _, row: scaled(row, 0.5))
    code, told = submit(there, tmp_path / "mine.zip", "--verify", "2", capsys=capsys)
    assert code == 2
    assert "4 of 4 rows differ from a second flight" in told.err
    assert submit(there, tmp_path / "mine.zip", "--verify", "0", capsys=capsys)[0] == 0


def test_failed_runs_are_packed_and_told(folder, tmp_path, capsys):
    failed = other(error="it fell", outcome=None, score=None, final_score=None, scores=floats([]), history={})
    there = changed(folder, tmp_path / "changed", failed)
    code, told = submit(there, tmp_path / "mine.zip", "--verify", "0", "--json", capsys=capsys)
    assert code == 0
    assert json.loads(told.out)["failed"] == 1
    assert "failed: it fell" in told.err


def test_a_pack_has_its_suffix(folder, tmp_path, capsys):
    code, told = submit(folder, tmp_path / "mine.txt", capsys=capsys)
    assert code == 2
    assert told.err.endswith("mine.txt: a pack is a .zip file; give a name with this suffix\n")
    assert told.err.count("\n") == 1 and not (tmp_path / "mine.txt").exists()


def test_own_code_is_packed_and_flown_again_by_its_author(own, tmp_path, capsys):
    given = ["--code", str(own / "src" / "mine.py"), "--json"]
    code, told = submit(own / "r", tmp_path / "a.zip", *given, capsys=capsys)
    assert code == 0
    assert json.loads(told.out)["flown_again"] == "1 equal"
    (packed,) = read_pack(tmp_path / "a.zip").submission.own
    assert (packed.kind, packed.name) == ("planner", "zigzag")
    assert members_of(tmp_path / "a.zip")["code/mine.py"] == OWN.encode()
    code, told = submit(own / "r", tmp_path / "b.zip", "--json", capsys=capsys)
    assert json.loads(told.out)["flown_again"] == "not flown again: own code is not run"
    assert told.err == "warning: not flown again: own code is not run\n"


def test_a_planner_of_ones_own_with_two_sets_of_parameters_is_flown_again_with_both(tmp_path, capsys):
    file = tmp_path / "mine.py"
    file.write_text(OWN.replace("(request):", "(request, *, direction=0.0):"))
    run = ["--scenarios", SCENARIO, "--planners", f"{file}:zigzag,{file}:zigzag:direction=1", "--seeds", "1"]
    assert main(["bench", "run", *run, "--estimators", "point", "--out", str(tmp_path / "r"), "--quiet"]) == 0
    capsys.readouterr()
    code, told = submit(tmp_path / "r", tmp_path / "a.zip", "--code", str(file), "--json", capsys=capsys)
    assert (code, json.loads(told.out)["flown_again"], told.err) == (0, "2 equal", "")


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """Rows of own code in a folder `src`."""
    there = tmp_path_factory.mktemp("own")
    (there / "src").mkdir()
    file = there / "src" / "mine.py"
    file.write_text(OWN)
    run = ["--scenarios", SCENARIO, "--planners", f"{file}:zigzag", "--estimators", "point", "--seeds", "2"]
    assert main(["bench", "run", *run, "--out", str(there / "r"), "--quiet"]) == 0
    return there


@pytest.mark.parametrize(
    ("source", "why"),
    [
        (
            OWN.replace("lawnmower", "spiral"),
            "mine.py defines a zigzag that differs from the one that flew the rows",
        ),
        (OWN.replace("zigzag", "other"), "no file of the code defines it"),
        ("def (", "cannot be run: SyntaxError"),
    ],
)
def test_code_that_is_not_what_flew_is_not_packed(own, source, why, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(verification, "fly_again", lambda *_, **__: pytest.fail("it was flown again"))
    (tmp_path / "mine.py").write_text(source)
    for there in (tmp_path / "mine.py", tmp_path):
        code, told = submit(own / "r", tmp_path / "a.zip", "--code", str(there), capsys=capsys)
        assert code == 2
        assert told.err.startswith(f"error: --code {there}: planner zigzag: ") and why in told.err
        assert told.err.count("\n") == 1 and told.err.endswith("give the code of the rows, or fly again\n")
        assert not (tmp_path / "a.zip").exists()


def test_code_beside_rows_of_what_is_built_in_is_not_packed(folder, own, tmp_path, capsys):
    code, told = submit(folder, tmp_path / "a.zip", "--code", str(own / "src" / "mine.py"), capsys=capsys)
    assert code == 2
    assert "mine.py: the rows use only built-in methods; leave --code out" in told.err


def test_a_folder_of_code_is_packed_without_what_is_hidden(tmp_path):
    (tmp_path / "src" / "__pycache__").mkdir(parents=True)
    (tmp_path / "src" / "a.py").write_text("1")
    (tmp_path / "src" / ".secret").write_text("2")
    (tmp_path / "src" / "__pycache__" / "a.pyc").write_text("3")
    (tmp_path / "src" / "link.py").symlink_to("/etc/passwd")
    assert code_files([tmp_path / "src"]) == {"code/src/a.py": b"1"}
    (tmp_path / "src" / "b c.py").write_text("1")
    with pytest.raises(ResultError, match=r"cannot be packed as code/src/b c\.py"):
        code_files([tmp_path / "src"])
    with pytest.raises(ResultError, match="no such file"):
        code_files([tmp_path / "nothing.py"])
    (tmp_path / "a.py").write_text("2")
    with pytest.raises(ResultError, match=r"cannot be packed as code/a\.py"):
        code_files([tmp_path / "src" / "a.py", tmp_path / "a.py"])
    assert code_files([tmp_path / "a.py", tmp_path / "a.py"]) == {
        "code/a.py": b"2"
    }  # as of one that imports it


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"format": 2}, "has format 2, but this version reads 1"),
        ({"surprise": 1}, "surprise is unknown"),
        ({"name": ""}, "name '' is not a line of 1 to 80"),
        ({"about": "x" * 3000}, "is not a line of 0 to 2000"),
        ({"flown": []}, "and the rows differ in flown"),
        ({"hardware": [{"processor": "better"}]}, "and the rows differ in hardware"),
        ({"files": {}}, "does not match submission.json"),
        ({"own": [{"kind": "planner", "name": "a", "words": "", "digest": ""}]}, "rows differ in own"),
    ],
)
def test_a_description_that_tells_something_else_is_refused(values, why, pack, tmp_path):
    with pytest.raises(ResultError, match=r"other\.zip: ") as caught:
        read_pack(told_otherwise(pack, tmp_path / "other.zip", **values))
    assert why in str(caught.value)


@pytest.mark.parametrize(
    "name", ["../evil.py", "/etc/passwd", "code/../../evil", "code\\evil", "code/.git", "b"]
)
def test_a_name_that_has_no_place_is_refused(name, pack, tmp_path):
    with pytest.raises(ResultError, match="does not belong in a submission"):
        read_pack(written(tmp_path / "other.zip", {**members_of(pack), name: b""}))


def test_members_that_are_there_twice_or_missing_are_refused(pack, tmp_path):
    members = members_of(pack)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        twice = written(tmp_path / "twice.zip", [*members.items(), (TABLE, members[TABLE])])
    with pytest.raises(ResultError, match="does not belong"):
        read_pack(twice)
    with pytest.raises(ResultError, match=r"has no rows\.parquet"):
        read_pack(written(tmp_path / "none.zip", {ABOUT: members[ABOUT]}))


def test_an_archive_that_unpacks_to_more_than_it_may_is_refused(pack, tmp_path, monkeypatch):
    import zipfile

    monkeypatch.setattr(submission, "_MAX_UNPACKED_BYTES", 2**20)
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members_of(pack).items():
            archive.writestr(name, content)
        archive.writestr("code/zeros", bytes(2**22))
    assert (tmp_path / "bomb.zip").stat().st_size < 2**17
    with pytest.raises(ResultError, match="unpacks to more than 1 MiB"):
        read_pack(tmp_path / "bomb.zip")


def with_table(pack, path, table):
    stream = pa.BufferOutputStream()
    pq.write_table(table, stream)
    return with_content(pack, path, stream.getvalue().to_pybytes())


def with_content(pack, path, content):
    members = members_of(pack) | {TABLE: content}
    about = json.loads(members[ABOUT])
    about["files"][TABLE] = hashlib.sha256(members[TABLE]).hexdigest()
    return written(path, members | {ABOUT: json.dumps(about)})


def test_a_list_of_many_equal_numbers_is_not_unpacked(pack, rows, tmp_path, monkeypatch):
    monkeypatch.setattr(storage, "_MOST_VALUES", 500_000)
    table = submission.rows_table(rows[:1])
    many = pa.ListArray.from_arrays(pa.array([0, 600_000], pa.int32()), pa.array(np.zeros(600_000)))
    table = table.set_column(table.column_names.index("scores"), "scores", many)
    bomb = with_table(pack, tmp_path / "bomb.zip", table)
    assert bomb.stat().st_size < 2**20
    with pytest.raises(ResultError, match="more than the limit of 500000"):
        read_pack(bomb)


def test_a_table_that_lies_about_its_size_is_not_unpacked(pack, rows, tmp_path, monkeypatch):
    """Its footer says that a list of 3 million numbers has a thousand."""
    table = submission.rows_table(rows[:1])
    many = pa.ListArray.from_arrays(pa.array([0, 3_000_000], pa.int32()), pa.array(np.zeros(3_000_000)))
    table = table.set_column(table.column_names.index("scores"), "scores", many)
    bomb = with_table(pack, tmp_path / "bomb.zip", table)
    content = members_of(bomb)[TABLE]
    footer = -8 - int.from_bytes(content[-8:-4], "little")
    told, less = zigzag(3_000_000), zigzag(1000, 4)
    assert told in content[footer:]
    lies = content[:footer] + content[footer:].replace(told, less)
    path = with_content(pack, tmp_path / "lies.zip", lies)
    monkeypatch.setattr(submission, "_MAX_MEMORY_BYTES", 2**24)
    with pytest.raises(ResultError, match=r"lies\.zip"):
        read_pack(path)


def zigzag(number, size=1):
    """Return a whole number as Thrift's compact protocol writes it, in at least so many bytes."""
    number, found = 2 * number, []
    while number or len(found) < size:
        found.append(number & 127 | 128)
        number >>= 7
    return bytes([*found[:-1], found[-1] & 127])


def test_a_column_that_no_row_has_is_refused(pack, rows, tmp_path):
    table = submission.rows_table(rows).append_column("surprise", pa.array([1] * len(rows)))
    with pytest.raises(ResultError, match="surprise is unknown"):
        read_pack(with_table(pack, tmp_path / "other.zip", table))


def test_a_name_with_a_line_end_is_refused(pack, rows, tmp_path):
    table = submission.rows_table([structs.replace(row, planner="spiral\n# Title") for row in rows])
    with pytest.raises(ResultError, match="is not a printable line of at most 400 characters"):
        read_pack(with_table(pack, tmp_path / "other.zip", table))


def test_a_table_with_too_many_columns_is_not_read(pack, rows, tmp_path, monkeypatch):
    monkeypatch.setattr(storage, "_MOST_PARTS", 5)
    with pytest.raises(ResultError, match="too many to be read"):
        read_pack(pack)


@sweep(few=40, many=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_damaged_pack_is_a_result_error_or_what_it_was(data, pack, tmp_path):
    whole = bytearray(pack.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.none() | st.integers(0, len(whole)))
    (tmp_path / "damaged.zip").write_bytes(whole[:cut])
    try:
        read = read_pack(tmp_path / "damaged.zip")
    except ResultError as error:
        assert str(error).startswith(f"{tmp_path / 'damaged.zip'}")
        assert "\n" not in str(error)
    else:
        assert read.rows == read_pack(pack).rows


@sweep(few=20, many=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=300), about=st.binary(max_size=300))
def test_any_bytes_are_refused_in_a_line(content, about, pack, tmp_path):
    for data in (
        content,
        written(tmp_path / "x.zip", {**members_of(pack), ABOUT: about}).read_bytes(),
        written(tmp_path / "x.zip", {**members_of(pack), TABLE: content}).read_bytes(),
    ):
        (tmp_path / "any.zip").write_bytes(data)
        with pytest.raises(ResultError):
            read_pack(tmp_path / "any.zip")


def test_a_pipe_or_a_folder_is_no_pack(tmp_path):
    os.mkfifo(tmp_path / "pipe.zip")
    for path in (tmp_path, tmp_path / "pipe.zip", tmp_path / "none.zip"):
        with pytest.raises(ResultError):
            read_pack(path)


def test_reading_a_pack_runs_nothing_of_it(rows, tmp_path):
    mark = tmp_path / "ran"
    code = f"open({str(mark)!r}, 'w')\n".encode()
    path = pack_of(rows, tmp_path / "some.zip", code={"code/sitecustomize.py": code})
    before = set(sys.modules)
    read_pack(path)
    assert not mark.exists()
    assert not [name for name in set(sys.modules) - before if "sitecustomize" in name]
