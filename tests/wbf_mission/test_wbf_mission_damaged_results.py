"""Results that were damaged, cut short, half deleted or made by somebody hostile: refused in one line."""

import json
import shutil
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given
from hypothesis import strategies as st
from sweeps import sweep

from wbf_mission.flight import fly
from wbf_mission.results.files import MAX_JSON_BYTES
from wbf_mission.results.result import load_result
from wbf_mission.results.storage import ResultError
from wbf_mission.scenario import Scenario

NEEDED = {
    "plan.json",
    "observations.parquet",
    "track.parquet",
    "true_track.parquet",
    "scores.parquet",
    "maps.npz",
    "truth.zarr.zip",
    "value.zarr.zip",
    "uncertainty.zarr.zip",
    "probabilities_tylcv.zarr.zip",
    "probabilities_ccr.zarr.zip",
}


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A result with every kind of file."""
    folder = tmp_path_factory.mktemp("results")
    scenario = Scenario(farm="miniberry-10", planner="spiral", budget="60s", gps_noise_m=0.5, estimator="gp")
    fly(scenario).save(folder / "run", plots=False)
    assert {path.name for path in (folder / "run").iterdir()} >= NEEDED
    return folder / "run"


def read_or_refuse(folder):
    try:
        load_result(folder).summary()
    except ResultError as error:
        assert "\n" not in str(error)


def refusal(folder):
    with pytest.raises(ResultError) as caught:
        load_result(folder).summary()
    text = str(caught.value)
    assert "\n" not in text
    assert str(folder) in text
    return text


@pytest.mark.parametrize("name", sorted(NEEDED))
def test_a_file_that_is_gone_empty_or_cut_short_is_named(saved, tmp_path, name):
    shutil.copytree(saved, tmp_path / "run")
    file = tmp_path / "run" / name
    whole = file.read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"\x00" * len(whole)):
        file.write_bytes(damaged)
        assert name in refusal(file.parent)
    file.unlink()
    assert f"{name}: is missing" in refusal(file.parent)
    file.write_bytes(whole)
    load_result(file.parent)


@pytest.mark.parametrize(
    ("part", "key", "value"),
    [
        ("prediction", "unknown", 1),
        ("prediction", "track_m", [["1", "2", "3"]]),
        ("prediction", "items", [1.5]),
        ("plan", "path_m", [1.0, 2.0]),
        ("plan", "path_m", [[1.0, 2.0], [3.0]]),
        ("decision", "unknown", 1),
        ("change", "path_m", [1.0, 2.0]),
        ("alternative", "points_m", [{}]),
    ],
)
def test_a_record_with_other_fields_or_values_is_refused(saved, tmp_path, part, key, value):
    shutil.copytree(saved, tmp_path / "run")
    file = tmp_path / "run" / "result.json"
    record = json.loads(file.read_text())
    change = {"system_id": 1, "position_m": [0.0, 0.0], "path_m": [[1.0, 2.0]], "cost": 1.0}
    alternative = {"system_id": 1, "points_m": [[1.0, 2.0]], "value": 1.0, "cost": 1.0}
    decision = {"day": 6, "flight": 1, "time_s": 0.0, "event": "start", "observations": 0}
    decision |= {"changes": [change], "alternatives": [alternative]}
    record["decisions"] = [decision]
    file.write_text(json.dumps(record))
    (loaded,) = load_result(file.parent).decisions
    assert loaded.changes[0].path_m.tolist() == loaded.alternatives[0].points_m.tolist() == [[1.0, 2.0]]
    flight = record["flights"][0]
    parts = {"decision": decision, "change": change, "alternative": alternative}
    (parts | {name: flight[name] for name in ("plan", "prediction")})[part][key] = value
    file.write_text(json.dumps(record))
    assert key in refusal(file.parent)


def test_what_only_people_and_other_programs_read_may_go(saved, tmp_path):
    shutil.copytree(saved, tmp_path / "run")
    for name in ("summary.json", "plan.plan"):
        (tmp_path / "run" / name).unlink()
    assert load_result(tmp_path / "run").score == load_result(saved).score


def paths_in(value, path=()):
    """The ways to all values of a JSON document; of long lists the first three."""
    below = (
        value.items() if isinstance(value, dict) else enumerate(value[:3]) if isinstance(value, list) else ()
    )
    return [path, *(way for key, one in below for way in paths_in(one, (*path, key)))]


HOSTILE = st.sampled_from(
    [None, True, -1, 2**63, 1e308, "", "x" * 300, "../..", "\x00", [], [[]], {}, {"a": 1}]
)


@sweep(few=25, many=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_value_of_the_record_may_be_another(saved, tmp_path, data):
    folder = tmp_path / "run"
    if not folder.exists():
        shutil.copytree(saved, folder)
    record = json.loads((saved / "result.json").read_bytes())
    way = data.draw(st.sampled_from(paths_in(record)[1:]))
    inner = record
    for key in way[:-1]:
        inner = inner[key]
    if isinstance(inner, dict) and data.draw(st.booleans()):
        del inner[way[-1]]
    else:
        inner[way[-1]] = data.draw(HOSTILE)
    (folder / "result.json").write_text(json.dumps(record))
    read_or_refuse(folder)


def test_a_number_of_more_than_64_bits_is_refused(saved, tmp_path):
    shutil.copytree(saved, tmp_path / "run")
    record = json.loads((saved / "result.json").read_bytes())
    record["flights"][0]["prediction"]["items"] = [2**63]
    (tmp_path / "run" / "result.json").write_text(json.dumps(record))
    assert "the result is damaged" in refusal(tmp_path / "run")


@pytest.mark.filterwarnings("ignore:overflow")
@sweep(few=20, many=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    name=st.sampled_from(sorted(NEEDED)),
    where=st.floats(0, 1),
    bits=st.integers(1, 255),
    count=st.integers(1, 8),
)
@example(name="scores.parquet", where=0.23258640859146867, bits=1, count=1)
def test_flipped_bits_are_refused_or_harmless(saved, tmp_path, name, where, bits, count):
    folder = tmp_path / "run"
    if not folder.exists():
        shutil.copytree(saved, folder)
    whole = (saved / name).read_bytes()
    begin = int(where * (len(whole) - count))
    changed = bytes(byte ^ bits for byte in whole[begin : begin + count])
    (folder / name).write_bytes(whole[:begin] + changed + whole[begin + count :])
    try:
        read_or_refuse(folder)
    finally:
        (folder / name).write_bytes(whole)


def change_maps(folder, changes):
    with np.load(folder / "maps.npz") as archive:
        arrays = {**archive, **changes}
    np.savez_compressed(folder / "maps.npz", **{key: one for key, one in arrays.items() if one is not None})


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"estimate.tylcv.total": np.zeros((3, 3))}, r"estimate.tylcv.total is float64\[3, 3\]"),
        ({"estimate.tylcv.cells": None}, "estimate.tylcv.cells is nothing"),
        ({"estimate.tylcv.seen": np.zeros((10, 10), np.int8)}, "estimate.tylcv.seen is int8"),
        ({"estimate.ccr.finds": np.zeros((4, 3), np.int32)}, "estimate.ccr.finds"),
        ({"truth.soil.together": np.zeros(2)}, "truth.soil.together"),
        ({"truth.nitrogen.cells": np.zeros((10, 10))}, "nitrogen"),
        ({"estimate.tylcv.total": np.array([{}], dtype=object)}, "pickle"),
    ],
)
def test_maps_of_another_shape_are_refused(saved, tmp_path, changes, text):
    shutil.copytree(saved, tmp_path / "run")
    change_maps(tmp_path / "run", changes)
    with pytest.raises(ResultError, match=text):
        load_result(tmp_path / "run")


def test_an_archive_that_would_fill_the_memory_is_not_unpacked(saved, tmp_path):
    shutil.copytree(saved, tmp_path / "run")
    with (
        zipfile.ZipFile(tmp_path / "run" / "maps.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("estimate.tylcv.cells.npy", "w") as stream,
    ):
        for _ in range(65):
            stream.write(bytes(2**20))
    assert (tmp_path / "run" / "maps.npz").stat().st_size < 2**20
    assert "larger than 64 MiB" in refusal(tmp_path / "run")


def test_a_record_of_any_length_is_not_read(saved, tmp_path):
    shutil.copytree(saved, tmp_path / "run")
    with (tmp_path / "run" / "result.json").open("r+b") as file:
        file.truncate(MAX_JSON_BYTES + 1)
    assert "larger than 64 MiB" in refusal(tmp_path / "run")


def test_a_table_without_a_column_names_it(saved, tmp_path):
    import pyarrow.parquet as pq

    shutil.copytree(saved, tmp_path / "run")
    table = pq.read_table(saved / "track.parquet")
    pq.write_table(table.drop_columns(["x_m"]), tmp_path / "run" / "track.parquet")
    assert "track.parquet: no column x_m" in refusal(tmp_path / "run")
