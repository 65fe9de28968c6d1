"""Observations: the struct of arrays, its checks and its files."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from sweeps import sweep

from sensors.errors import ObservationError
from sensors.observations import Observations

FILES = ("seen.csv", "seen.parquet")
HEADER = "x,y,time_s,day,tylcv,ccr,soil"


def equal(a, b):
    return all(
        np.array_equal(getattr(a, name), getattr(b, name), equal_nan=name == "values")
        for name in ("x", "y", "time_s", "day", "values")
    )


def some(n=4):
    values = np.linspace(0, 1, 3 * n, dtype=np.float32).reshape(n, 3)
    values[1, 2] = np.nan
    return Observations(np.arange(n), np.arange(n)[::-1], np.arange(n) / 3, np.full(n, 6), values)


whole = st.integers(-(2**31), 2**31 - 1)
rows = st.lists(
    st.tuples(
        whole,
        whole,
        st.floats(allow_nan=False, allow_infinity=False),
        whole,
        *[st.floats(width=32, allow_infinity=False)] * 3,
    ),
    max_size=8,
)


@pytest.mark.parametrize("name", FILES)
@sweep(few=15, many=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rows=rows)
def test_round_trip_is_exact(tmp_path, name, rows):
    table = np.array(rows, dtype=object).reshape(-1, 7)
    seen = Observations(
        table[:, 0].astype(np.int32),
        table[:, 1].astype(np.int32),
        table[:, 2].astype(float),
        table[:, 3].astype(np.int32),
        table[:, 4:].astype(np.float32),
    )
    seen.save(tmp_path / name)
    assert equal(Observations.load(tmp_path / name), seen)


def test_dtypes_and_read_only():
    x = np.array([1, 2])
    seen = Observations(x, x, [0, 1], [6.0, 6.0], [[1, 1, 0]] * 2)
    assert [getattr(seen, n).dtype for n in ("x", "y", "time_s", "day", "values")] == [
        np.int32,
        np.int32,
        np.float64,
        np.int32,
        np.float32,
    ]
    with pytest.raises(ValueError, match="read-only"):
        seen.values[0, 0] = 5
    own = np.array([1, 2], np.int32)
    Observations(own, own, [0, 1], own, [[1, 1, 0]] * 2)
    own[0] = 3


def test_slices_masks_and_joining():
    seen = some()
    assert len(seen[1:3]) == 2
    assert equal(Observations.concatenate([seen[:1], Observations.empty(), seen[1:]]), seen)
    assert equal(seen[seen.sensed[:, 2]], seen[np.array([0, 2, 3])])
    assert len(Observations.concatenate([])) == len(Observations.empty()) == 0
    with pytest.raises(ObservationError, match="indexed by int"):
        seen[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"y": [0]}, r"y has shape \(1,\), expected \(2,\)"),
        ({"values": [[1, 1]] * 2}, "values has shape"),
        ({"values": [[1, 1, 1], [1, np.inf, 1]]}, "value of observation 1 is infinite"),
        ({"values": [[1, 1, 1], [1]]}, "values is not a regular array"),
        ({"time_s": [0, np.nan]}, "time_s of observation 1 is not finite"),
        ({"x": [0, 1.5]}, "x of observation 1 is 1.5"),
        ({"x": [0, 2**31]}, "x of observation 1 is 2147483648"),
        ({"day": [np.nan, 1]}, "day of observation 0 is nan"),
        ({"day": ["6", "6"]}, "day holds something that is not a number"),
    ],
)
def test_bad_arrays_are_named(change, message):
    columns = {"x": [0, 1], "y": [0, 1], "time_s": [0, 1], "day": [6, 6], "values": [[1, 1, 1]] * 2, **change}
    with pytest.raises(ObservationError, match=message):
        Observations(**columns)


def test_cells_outside_the_farm_are_named():
    seen = some()
    seen.check_inside((4, 4))
    with pytest.raises(
        ObservationError, match=r"observation 3: cell \(3, 0\) lies outside the farm of 3 x 4"
    ):
        seen.check_inside((3, 4))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no column x, y, time_s"),
        ("x,y\n1,2\n", "no column time_s, day"),
        (HEADER + "\n1,2,0,6,1,1\n", "line 2: soil is missing"),
        (HEADER + "\n1,2,0,6,1,1,wet\n", "line 2: soil is 'wet'"),
        (HEADER + "\n1,2,0,6,1,1,1\n,2,0,6,1,1,1\n", "line 3: x is ''"),
        (HEADER + "\n1.5,2,0,6,1,1,1\n", "x of observation 0 is 1.5"),
        (HEADER + "\n1,2,0,6,1,1,1e99\n", "observation 0 is infinite"),
        (HEADER + '\n"1,2,0,6,1,1,1\n', "is not a CSV file"),
        (HEADER + "\n" + "1" * 200_000 + ",2,0,6,1,1,1\n", "is not a CSV file"),
    ],
)
def test_hostile_csv_is_one_line(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ObservationError, match=message) as caught:
        Observations.load(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400 + len(str(path))


@pytest.mark.parametrize(
    "data", [b"", b"PAR1", b"PAR1" * 100, b"\x80\x04\x95pickle", np.random.default_rng(1).bytes(2000)]
)
@pytest.mark.parametrize("name", FILES)
def test_files_that_are_not_what_they_claim(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(ObservationError) as caught:
        Observations.load(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_damaged_parquet(tmp_path):
    path = tmp_path / "seen.parquet"
    some(50).save(path)
    good = path.read_bytes()
    rng = np.random.default_rng(3)
    for _ in range(60):
        data = bytearray(good)
        for place in rng.integers(0, len(data), 5):
            data[place] ^= int(rng.integers(1, 256))
        path.write_bytes(data)
        try:
            Observations.load(path)
        except ObservationError as error:
            assert "\n" not in str(error)


def test_parquet_of_other_types(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = HEADER.split(",")
    path = tmp_path / "other.parquet"
    for column, message in (
        (pa.array(["a"]), "column x is string"),
        (pa.array([None], pa.int32()), "1 empty entries"),
    ):
        rest = {name: pa.array([1.0]) for name in names[1:]}
        pq.write_table(pa.table({"x": column, **rest}), path)
        with pytest.raises(ObservationError, match=message):
            Observations.load(path)
    pq.write_table(pa.table({name: pa.array([1]) for name in [*names, "note"]}), path)
    assert len(Observations.load(path)) == 1


def test_not_sensed_is_empty_and_null(tmp_path):
    import pyarrow.parquet as pq

    some().save(tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text().splitlines()[2].endswith(",")
    some().save(tmp_path / "a.parquet")
    assert pq.read_table(tmp_path / "a.parquet")["soil"].null_count == 1


@pytest.mark.parametrize("path", ["a.pkl", "a", "a.npz"])
def test_unknown_formats(tmp_path, path):
    with pytest.raises(ObservationError, match=r"\.parquet or \.csv"):
        some().save(tmp_path / path)
    with pytest.raises(ObservationError, match=r"\.parquet or \.csv"):
        Observations.load(tmp_path / path)


@pytest.mark.parametrize("name", FILES)
def test_missing_files_and_folders(tmp_path, name):
    with pytest.raises(ObservationError, match="no such observation file"):
        Observations.load(tmp_path / name)
    with pytest.raises(ObservationError, match="cannot be written"):
        some().save(tmp_path / "nowhere" / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", FILES)
def test_a_failed_write_keeps_the_old_file(tmp_path, name, monkeypatch):
    path = tmp_path / name
    some().save(path)

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.replace", fail)
    with pytest.raises(ObservationError, match="cannot be written"):
        some(9).save(path)
    monkeypatch.undo()
    assert equal(Observations.load(path), some())
    assert [entry.name for entry in tmp_path.iterdir()] == [name]
