import contextlib
import json
import os
import pickle

import numpy as np
import pytest
import zarr
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from sweeps import sweep

from geo.farms import get_farm
from sensors.environment import EpidemicParameters, generate_environment, load_environment, save_environment
from sensors.environment import store as store_module
from sensors.environment.storage import unfinished_store
from sensors.environment.store import ChunkCache, ChunkedLayer, Header
from sensors.errors import EnvironmentDataError
from sensors.fields import PAPER_FIELDS


@pytest.fixture(scope="module")
def grid():
    return get_farm("miniberry-10").grid()


@pytest.fixture(scope="module")
def environment(grid):
    model = PAPER_FIELDS.with_dynamics(
        ccr=EpidemicParameters(0.2, 7, kernel_shape="gaussian", rule="kernel", kernel_size=5)
    )
    return generate_environment(
        grid, days=9, seed=2**100 + 7, keep_days=[0, 6, 9], fields=model, farm_name="Miniberry-10"
    )


@pytest.fixture
def folder(environment, tmp_path):
    save_environment(environment, tmp_path / "e")
    return tmp_path / "e"


@contextlib.contextmanager
def small_chunks():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(store_module, "CHUNK_CELLS", 7)
        yield


def assert_same(a, b):
    assert (a.days, a.shape, a.fields, a.provenance) == (b.days, b.shape, b.fields, b.provenance)
    for disease in ("tylcv", "ccr"):
        np.testing.assert_array_equal(a.onset(disease), b.onset(disease))
    for day in a.days:
        np.testing.assert_array_equal(a.values(day), b.values(day))


@pytest.mark.parametrize("lazy", [True, False])
def test_what_is_saved_is_loaded(environment, folder, lazy):
    loaded = load_environment(folder, lazy=lazy)
    assert_same(loaded, environment)
    np.testing.assert_array_equal(loaded.sample(6, [1, 9], [2, 9]), environment.sample(6, [1, 9], [2, 9]))
    for day in environment.days:
        for disease in ("tylcv", "ccr"):
            np.testing.assert_array_equal(loaded.status(disease, day), environment.status(disease, day))
    with pytest.raises(ValueError, match="read-only"):
        loaded.level("soil", 6)[0, 0] = 1


def test_any_zarr_reader_can_read_it(environment, folder):
    group = zarr.open_group(folder, mode="r")
    assert group.attrs["format"] == "wbf-mission environment"
    assert group.attrs["version"] == 3
    assert group.attrs["provenance"]["farm"] == "Miniberry-10"
    assert group.attrs["provenance"]["entropy"] == [str(2**100 + 7)]
    assert group.attrs["fields"][1]["dynamics"]["kernel_shape"] == "gaussian"
    assert group["day"][:].tolist() == [0, 6, 9]
    assert group["soil"].metadata.dimension_names == ("day", "x", "y")
    np.testing.assert_array_equal(group["soil"][1], environment.level("soil", 6))
    np.testing.assert_array_equal(group["tylcv"][:], environment.onset("tylcv"))


# Chunks


@sweep(few=10, many=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.tuples(st.integers(0, 29), st.integers(0, 29)), max_size=60),
    st.tuples(st.integers(0, 29), st.integers(0, 29), st.integers(1, 30), st.integers(1, 30)),
)
def test_cells_and_windows_of_chunks_are_those_of_the_whole(chunked, cells, window):
    memory, stored = chunked
    ix = np.array([x for x, _ in cells], np.int32)
    iy = np.array([y for _, y in cells], np.int32)
    np.testing.assert_array_equal(stored.sample(6, ix, iy), memory.sample(6, ix, iy))
    alone = [stored.sample(6, ix[k : k + 1], iy[k : k + 1]) for k in range(len(ix))]
    np.testing.assert_array_equal(np.vstack([np.empty((0, 3)), *alone]), memory.sample(6, ix, iy))
    x, y, width, height = window
    part = slice(x, min(x + width, 30)), slice(y, min(y + height, 30))
    np.testing.assert_array_equal(stored.window(6, *part), memory.window(6, *part))


@pytest.fixture(scope="module")
def chunked(tmp_path_factory):
    """30 x 30 cells in chunks of 7 x 7, which do not divide it."""
    memory = generate_environment(get_farm("miniberry-30").grid(), days=6, seed=3)
    path = tmp_path_factory.mktemp("chunks") / "e"
    with small_chunks():
        save_environment(memory, path)
        yield memory, load_environment(path)


def test_only_the_chunks_of_a_window_are_decoded(chunked, tmp_path):
    with small_chunks():
        save_environment(chunked[0], tmp_path / "e")
        shard = tmp_path / "e" / "soil" / "c" / "6" / "0" / "0"
        content = bytearray(shard.read_bytes())
        # The index of the shard is at its end: offset and length of each of the 5 x 5 chunks, a checksum.
        index = np.frombuffer(bytes(content[-4 - 25 * 16 : -4]), "<u8").reshape(5, 5, 2)
        spoilt = int(index[4, 4, 0]) + 20
        content[spoilt] ^= 0xFF
        shard.write_bytes(content)
        stored = load_environment(tmp_path / "e")
        with pytest.raises(EnvironmentDataError, match="damaged"):
            stored.window(6, slice(28, 30), slice(27, 30))
        with pytest.raises(EnvironmentDataError, match="damaged"):
            stored.sample(6, 29, 29)
        part = slice(0, 28), slice(0, 30)
        np.testing.assert_array_equal(stored.window(6, *part), chunked[0].window(6, *part))
        assert stored.sample(6, 27, 29).shape == (1, 3)
        with pytest.raises(EnvironmentDataError, match="damaged"):
            load_environment(tmp_path / "e", lazy=False)


def test_a_chunk_is_decoded_once_while_it_is_used():
    array = np.arange(100 * 60, dtype=np.float32).reshape(100, 60)
    asked = []

    def read(x, y):
        asked.append((x, y))
        return array[x, y].copy()

    layer = ChunkedLayer("a", (100, 60), (32, 32), read, ChunkCache(3 * 32 * 32 * 4))
    for x in range(100):
        assert layer.cells(np.array([x]), np.array([5])) == array[x, 5]
    assert [(part.start, part.stop) for part, _ in asked] == [(0, 32), (32, 64), (64, 96), (96, 100)]
    layer.cells(np.array([40, 99]), np.array([5, 5]))
    assert len(asked) == 4
    found = layer.cells(np.array([3, 40]), np.array([5, 59]))
    assert found.tolist() == [array[3, 5], array[40, 59]] and len(asked) == 6


def test_the_cache_of_chunks_is_bounded():
    cache = ChunkCache(100)
    made = []

    def chunk(number):
        def decode():
            made.append(number)
            return np.zeros(40, np.int8)

        return cache.get(("a", number, 0), decode)

    for number in (1, 2, 1, 3, 1, 2):
        chunk(number)
    assert made == [1, 2, 3, 2]
    assert cache.get(("b", 0, 0), lambda: np.zeros(1000, np.int8)).size == 1000


# Generating into a folder


class Stop:
    """Progress that stops at some piece of work, and counts the pieces that were done."""

    def __init__(self, at):
        self.at = at
        self.calls = []

    def __call__(self, done, total):
        self.calls.append(done)
        if done >= self.at:
            raise KeyboardInterrupt


def written_days(partial):
    return sorted(int(path.parts[-3]) for path in (partial / "soil").glob("c/*/0/0"))


def test_an_interrupted_generation_goes_on_with_its_finished_days(grid, tmp_path):
    target, partial = tmp_path / "e", tmp_path / ".e.partial"
    with pytest.raises(KeyboardInterrupt):
        generate_environment(grid, days=9, seed=3, directory=target, progress=Stop(2 * 9 + 5))
    assert not target.exists()
    assert written_days(partial) == [0, 1, 2, 3]
    times = {path: path.stat().st_mtime_ns for path in partial.rglob("*") if path.is_file()}
    made = []
    again = generate_environment(
        grid, days=9, seed=3, directory=target, progress=lambda done, _total: made.append(done)
    )
    assert_same(again, generate_environment(grid, days=9, seed=3))
    for path, time_ns in times.items():
        assert (target / path.relative_to(partial)).stat().st_mtime_ns == time_ns
    assert made[-1] == 2 * 9 + 10
    assert [path.name for path in tmp_path.iterdir()] == ["e"]


def test_a_half_written_day_is_made_again(grid, tmp_path):
    target, partial = tmp_path / "e", tmp_path / ".e.partial"
    with pytest.raises(KeyboardInterrupt):
        generate_environment(grid, days=9, seed=3, directory=target, progress=Stop(2 * 9 + 7))
    truncate("soil/c/2/0/0", 100)(partial)
    truncate("ccr/c/0/0", 0)(partial)
    (partial / "soil/c/4/0/0").write_bytes(os.urandom(500))
    (partial / "soil/c/5/0/0.abc.partial").write_bytes(b"left by a killed process")
    again = generate_environment(grid, days=9, seed=3, directory=target)
    assert_same(again, generate_environment(grid, days=9, seed=3))
    assert not list(target.rglob("*.partial"))


def test_another_environment_is_not_resumed(grid, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        generate_environment(grid, days=9, seed=3, directory=tmp_path / "e", progress=Stop(2 * 9 + 7))
    other = generate_environment(grid, days=9, seed=4, directory=tmp_path / "e")
    assert_same(other, generate_environment(grid, days=9, seed=4))


def test_what_is_there_already_is_not_made_again(grid, tmp_path):
    first = generate_environment(grid, days=4, seed=3, directory=tmp_path / "e")
    again = generate_environment(grid, days=4, seed=3, directory=tmp_path / "e", progress=Stop(0))
    assert_same(again, first)
    truncate("soil/c/2/0/0", 100)(tmp_path / "e")
    repaired = generate_environment(grid, days=4, seed=3, directory=tmp_path / "e")
    assert_same(repaired, generate_environment(grid, days=4, seed=3))


def test_an_interrupted_generation_keeps_the_older_environment(grid, environment, folder):
    with pytest.raises(KeyboardInterrupt):
        generate_environment(grid, days=3, seed=3, directory=folder, progress=Stop(1))
    assert_same(load_environment(folder), environment)


def test_two_processes_do_not_write_the_same_environment(environment, tmp_path):
    header = Header.of(environment.shape, environment.days, environment.fields, environment.provenance)
    with pytest.raises(ZeroDivisionError), unfinished_store(tmp_path / "e", header):
        with pytest.raises(EnvironmentDataError, match="another process is writing"):
            save_environment(environment, tmp_path / "e")
        _ = 1 / 0
    save_environment(environment, tmp_path / "e")
    assert_same(load_environment(tmp_path / "e"), environment)


def test_an_environment_of_the_second_format_says_its_version_and_is_replaced(environment, folder):
    edit_header(lambda header: header.update(version=2, fields=["tylcv", "ccr", "soil"], model={}))(folder)
    with pytest.raises(EnvironmentDataError, match="version 2 is not 3; generate the environment again"):
        load_environment(folder)
    save_environment(environment, folder)
    assert_same(load_environment(folder), environment)


def test_an_environment_of_the_first_format_is_replaced(environment, tmp_path):
    (tmp_path / "e").mkdir()
    for name in ("environment.json", "tylcv.npy", "ccr.npy", "soil-006.npy"):
        (tmp_path / "e" / name).write_bytes(b"old")
    with pytest.raises(EnvironmentDataError, match=r"zarr\.json"):
        load_environment(tmp_path / "e")
    save_environment(environment, tmp_path / "e")
    assert_same(load_environment(tmp_path / "e"), environment)


def test_a_folder_with_something_else_is_not_replaced(environment, tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(EnvironmentDataError, match="something other than an environment"):
        save_environment(environment, tmp_path)
    assert (tmp_path / "thesis.txt").read_text() == "mine"


def test_a_file_in_the_way_is_named(environment, tmp_path):
    (tmp_path / "e").write_text("a file")
    with pytest.raises(EnvironmentDataError, match="e: cannot be written"):
        save_environment(environment, tmp_path / "e")


# Hostile and damaged files


def edit(name, change):
    def apply(folder):
        document = json.loads((folder / name).read_text())
        change(document)
        (folder / name).write_text(json.dumps(document))

    return apply


def edit_header(change):
    return edit("zarr.json", lambda document: change(document["attributes"]))


def truncate(name, size):
    def apply(folder):
        (folder / name).write_bytes((folder / name).read_bytes()[:size])

    return apply


def write(name, content):
    def apply(folder):
        (folder / name).write_bytes(content)

    return apply


def store_values(name, value):
    def apply(folder):
        array = zarr.open_array(folder / name, mode="r+")
        array[...] = value

    return apply


def inner_codecs(document):
    return document["codecs"][0]["configuration"]["codecs"]


HEADER = "zarr.json"
TYLCV = "tylcv/zarr.json"
SOIL = "soil/zarr.json"
HOSTILE = [
    (HEADER, lambda folder: (folder / HEADER).unlink()),
    (HEADER, write(HEADER, b"")),
    (HEADER, write(HEADER, b"\xff\xfe\x00")),
    (HEADER, write(HEADER, b'{"attributes":' + b"[" * 100_000)),
    (HEADER, edit(HEADER, lambda document: document.pop("attributes"))),
    (HEADER, edit(HEADER, lambda document: document.update(node_type="array"))),
    (HEADER, edit_header(lambda header: header.pop("days"))),
    (HEADER, edit_header(lambda header: header.update(colour="red"))),
    (HEADER, edit_header(lambda header: header.update(format="zarr"))),
    (HEADER, edit_header(lambda header: header.update(version=4))),
    (HEADER, edit_header(lambda header: header.update(shape=[0, 10]))),
    (HEADER, edit_header(lambda header: header.update(days=[]))),
    (HEADER, edit_header(lambda header: header.update(days=[6, 0]))),
    (HEADER, edit_header(lambda header: header.update(fields=[]))),
    (HEADER, edit_header(lambda header: header["fields"].append(header["fields"][0]))),
    (HEADER, edit_header(lambda header: header["fields"][0].update(name="../tylcv"))),
    (HEADER, edit_header(lambda header: header["fields"][0].update(kind="continuous"))),
    (HEADER, edit_header(lambda header: header["fields"][1]["dynamics"].update(likelihood=7))),
    (TYLCV, edit_header(lambda header: header.update(shape=[10, 11]))),
    (TYLCV, edit_header(lambda header: header.update(shape=[10**9, 10**9]))),
    (SOIL, edit_header(lambda header: header.update(days=[0, 6, 7, 9]))),
    (TYLCV, lambda folder: (folder / TYLCV).unlink()),
    (TYLCV, write(TYLCV, pickle.dumps({"a": 1}))),
    (TYLCV, edit(TYLCV, lambda document: document.update(data_type="int16"))),
    (TYLCV, edit(TYLCV, lambda document: document.update(shape=[10, 10**12]))),
    (TYLCV, edit(TYLCV, lambda document: document.update(codecs=[{"name": "bytes"}]))),
    (TYLCV, edit(TYLCV, lambda document: inner_codecs(document).append({"name": "gzip"}))),
    (TYLCV, edit(TYLCV, lambda document: inner_codecs(document).insert(0, {"name": "numcodecs.pickle"}))),
    (TYLCV, edit(TYLCV, lambda d: d["codecs"][0]["configuration"].update(chunk_shape=[5, 5]))),
    (SOIL, edit(SOIL, lambda document: document.update(data_type="float64"))),
    ("ccr/c/0/0", lambda folder: (folder / "ccr/c/0/0").unlink()),
    ("ccr/c/0/0", truncate("ccr/c/0/0", 20)),
    ("ccr/c/0/0", write("ccr/c/0/0", pickle.dumps({"a": 1}))),
    ("ccr/c/0/0", store_values("ccr", -3)),
    ("soil/c/1/0/0", lambda folder: (folder / "soil/c/1/0/0").unlink()),
    ("soil/c/1/0/0", truncate("soil/c/1/0/0", 200)),
    ("soil/c/0/0/0", store_values("soil", float("nan"))),
    ("soil/c/0/0/0", store_values("soil", -0.5)),
]


@pytest.mark.parametrize(("name", "harm"), HOSTILE)
def test_files_that_are_not_what_they_claim_are_named(folder, name, harm):
    harm(folder)
    for lazy in (True, False):
        with pytest.raises(EnvironmentDataError) as caught:
            load_environment(folder, lazy=lazy)
        assert str(caught.value).startswith(str(folder / name) + ": ")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["nowhere", "file"])
def test_a_path_that_is_no_folder_is_named(tmp_path, name):
    (tmp_path / "file").write_text("x")
    with pytest.raises(EnvironmentDataError, match=f"{name}: no such folder"):
        load_environment(tmp_path / name)
