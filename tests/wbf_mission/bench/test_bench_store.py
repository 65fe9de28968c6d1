"""Rows that are kept."""

from array import array
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweeps import sweep

from wbf_mission.bench.rows import TABLE, BenchRow, BenchStore, read_rows
from wbf_mission.results import storage
from wbf_mission.results.storage import ResultError

NAMES = st.text(st.characters(exclude_categories=("Cs",)), max_size=10)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
LISTS = st.lists(NUMBERS, max_size=4).map(lambda values: array("d", values))
ROWS = st.builds(
    BenchRow,
    key=st.text("0123456789abcdef", min_size=4, max_size=4),
    scenario=NAMES,
    planner=NAMES,
    estimator=NAMES,
    seed=st.integers(0, 2**64 - 1),
    outcome=st.none() | NAMES,
    error=st.none() | NAMES,
    score=st.none() | NUMBERS,
    losses=st.dictionaries(st.sampled_from(["tylcv", "ccr", "soil"]), NUMBERS),
    observations=st.none() | st.integers(0, 2**40),
    wall_time_s=NUMBERS,
    timings_s=st.dictionaries(st.sampled_from(["plan", "flight"]), NUMBERS),
    times_s=LISTS,
    scores=LISTS,
    history=st.dictionaries(st.sampled_from(["tylcv", "ccr"]), LISTS),
    versions=st.dictionaries(st.sampled_from(["python", "commit"]), NAMES),
    hardware=st.dictionaries(st.sampled_from(["processor", "cores"]), NAMES),
    objects=st.dictionaries(st.sampled_from(["planner", "estimator"]), NAMES),
    bad_answers=st.dictionaries(st.sampled_from(["crashed", "too late"]), st.integers(0, 9)),
)


def row(number=0, **given):
    given = {"final_score": given.get("score")} | given
    return BenchRow(key=f"{number:04x}", scenario="s", planner="p", estimator="e", seed=number, **given)


def by_key(rows):
    return {one.key: one for one in rows}


@sweep(few=25, many=150)
@given(rows=st.lists(ROWS, max_size=5))
def test_rows_come_back_equal_from_journal_and_table(tmp_path_factory, rows):
    folder = tmp_path_factory.mktemp("bench")
    with BenchStore(folder) as store:
        for one in rows:
            store.add(one)
        assert by_key(read_rows(folder)) == by_key(rows)
    assert by_key(read_rows(folder)) == by_key(rows)
    with BenchStore(folder) as store:
        assert store.done == {key: one.error is None for key, one in by_key(rows).items()}


def test_a_row_that_was_half_written_is_flown_again(tmp_path):
    store = BenchStore(tmp_path)
    store.add(row(1, score=-1.0))
    store.add(row(2))
    store._lock.close()  # as if the process were killed
    whole = (tmp_path / "journal.jsonl").read_bytes()
    (tmp_path / "journal.jsonl").write_bytes(whole[:-5])
    assert [one.seed for one in read_rows(tmp_path)] == [1]
    with BenchStore(tmp_path) as again:
        assert set(again.done) == {"0001"}
        again.add(row(2))
    assert [one.seed for one in read_rows(tmp_path)] == [1, 2]
    assert sorted(path.name for path in tmp_path.iterdir()) == [".lock", TABLE]


def test_only_one_process_writes(tmp_path):
    with BenchStore(tmp_path), pytest.raises(ResultError, match="another process writes this benchmark"):
        BenchStore(tmp_path)
    with BenchStore(tmp_path):
        pass


def test_a_damaged_journal_is_named(tmp_path):
    (tmp_path / "journal.jsonl").write_bytes(b'{"key": 3}\n')
    with pytest.raises(ResultError, match=r"journal.jsonl: line 1 is not a row"):
        BenchStore(tmp_path)
    (tmp_path / "journal.jsonl").unlink()
    with BenchStore(tmp_path):
        pass


def test_a_table_of_something_else_is_named_and_left(tmp_path):
    import pyarrow as pa

    pq.write_table(pa.table({"a": [1]}), tmp_path / TABLE)
    before = (tmp_path / TABLE).read_bytes()
    with pytest.raises(ResultError, match="no column key"):
        BenchStore(tmp_path)
    assert (tmp_path / TABLE).read_bytes() == before


@pytest.mark.parametrize("text", [b"no such thing", b"cells_observed"], ids=["value", "name"])
def test_a_table_with_a_text_that_is_none_is_named(tmp_path, text):
    with BenchStore(tmp_path) as store:
        store.add(row(1, error="no such thing"))
    table = tmp_path / TABLE
    pq.write_table(pq.read_table(table), table, compression="none", store_schema=False)
    whole = table.read_bytes()
    assert text in whole
    table.write_bytes(whole.replace(text, b"\xff" + text[1:]))
    with pytest.raises(ResultError, match=r"rows\.parquet: is not a Parquet file that can be read"):
        read_rows(tmp_path)


def test_a_table_of_too_many_rows_is_not_read(tmp_path, monkeypatch):
    with BenchStore(tmp_path) as store:
        store.add(row(1))
        store.add(row(2))
    monkeypatch.setattr(storage, "MAX_FILE_ROWS", 1)
    with pytest.raises(ResultError, match=r"rows\.parquet: claims 2 rows, more than the limit of 1"):
        read_rows(tmp_path)


def test_a_full_disk_is_told_by_the_name_of_the_journal(tmp_path):
    store = BenchStore(tmp_path)
    store.add(row(1))
    kept = store._journal
    full = Path("/dev/full")
    with full.open("ab", buffering=0) as store._journal, pytest.raises(OSError, match="No space") as caught:
        store.add(row(2))
    assert caught.value.filename == str(tmp_path / "journal.jsonl")
    store._journal = kept
    store.close()
    assert [one.key for one in store.rows] == ["0001"]
