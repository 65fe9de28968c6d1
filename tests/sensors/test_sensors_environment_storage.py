from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from geo.errors import WbfMissionError
from geo.farms import get_farm
from geo.grid import FarmGrid
from sensors.environment import (
    DISEASES,
    Environment,
    EnvironmentModel,
    EpidemicParameters,
    generate_environment,
)
from sensors.environment.storage import SoilFiles
from sensors.errors import EnvironmentDataError


@pytest.fixture(scope="module")
def grid() -> FarmGrid:
    return get_farm("miniberry-10").grid()


@pytest.fixture(scope="module")
def environment(grid: FarmGrid) -> Environment:
    model = EnvironmentModel(
        ccr=EpidemicParameters(0.2, 7, kernel_shape="gaussian", rule="kernel", kernel_size=5)
    )
    return generate_environment(
        grid, days=9, seed=2**100 + 7, keep_days=[0, 6, 9], model=model, farm_name="Miniberry-10"
    )


@pytest.fixture
def folder(environment: Environment, tmp_path: Path) -> Path:
    environment.save(tmp_path / "e")
    return tmp_path / "e"


def assert_same(a: Environment, b: Environment) -> None:
    assert (a.days, a.shape, a.model, a.provenance) == (b.days, b.shape, b.model, b.provenance)
    for disease in DISEASES:
        np.testing.assert_array_equal(a.onset(disease), b.onset(disease))
    for day in a.days:
        np.testing.assert_array_equal(a.values(day), b.values(day))


@pytest.mark.parametrize("mmap", [True, False])
def test_what_is_saved_is_loaded(environment: Environment, folder: Path, mmap: bool) -> None:
    loaded = Environment.load(folder, mmap=mmap)
    assert_same(loaded, environment)
    np.testing.assert_array_equal(loaded.sample(6, [1, 9], [2, 9]), environment.sample(6, [1, 9], [2, 9]))
    with pytest.raises(ValueError, match="read-only"):
        loaded.soil(6)[0, 0] = 1


def test_the_default_is_memory_mapped(folder: Path) -> None:
    base: object = Environment.load(folder).soil(6)
    while isinstance(base, np.ndarray) and not isinstance(base, np.memmap):
        base = base.base
    assert isinstance(base, np.memmap)


def test_the_files_are_the_documented_ones(folder: Path) -> None:
    names = ["ccr.npy", "environment.json", "soil-000.npy", "soil-006.npy", "soil-009.npy", "tylcv.npy"]
    assert sorted(path.name for path in folder.iterdir()) == names
    header = json.loads((folder / "environment.json").read_text())
    assert header["format"] == "wbf-mission environment"
    assert header["version"] == 1
    assert header["shape"] == [10, 10]
    assert header["days"] == [0, 6, 9]
    assert header["provenance"]["farm"] == "Miniberry-10"
    assert header["provenance"]["entropy"] == [str(2**100 + 7)]
    assert header["model"]["ccr"]["kernel_shape"] == "gaussian"
    assert np.load(folder / "soil-006.npy", allow_pickle=False).dtype == np.dtype("<f4")


def test_generating_into_a_folder_gives_the_same(grid: FarmGrid, tmp_path: Path) -> None:
    in_memory = generate_environment(grid, days=6, seed=3)
    on_disk = generate_environment(grid, days=6, seed=3, directory=tmp_path / "new" / "e")
    assert_same(on_disk, in_memory)
    in_memory.save(tmp_path / "f")
    for path in (tmp_path / "f").iterdir():
        assert path.read_bytes() == (tmp_path / "new" / "e" / path.name).read_bytes()


def test_an_interrupted_generation_leaves_nothing(grid: FarmGrid, tmp_path: Path) -> None:
    def stop(done: int, total: int) -> None:
        if done == total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate_environment(grid, days=3, seed=3, directory=tmp_path / "e", progress=stop)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_generation_keeps_the_older_environment(
    grid: FarmGrid, environment: Environment, folder: Path
) -> None:
    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate_environment(grid, days=3, seed=3, directory=folder, progress=stop)
    assert_same(Environment.load(folder), environment)


def test_an_older_environment_is_replaced(grid: FarmGrid, folder: Path) -> None:
    newer = generate_environment(grid, days=2, seed=8)
    newer.save(folder)
    assert_same(Environment.load(folder), newer)
    assert not (folder / "soil-009.npy").exists()


def test_a_loaded_environment_can_be_saved_onto_itself(environment: Environment, folder: Path) -> None:
    Environment.load(folder).save(folder)
    assert_same(Environment.load(folder), environment)


def test_a_folder_with_something_else_is_not_replaced(environment: Environment, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(EnvironmentDataError, match="something else"):
        environment.save(tmp_path)
    assert (tmp_path / "thesis.txt").read_text() == "mine"


def test_a_file_in_the_way_is_named(environment: Environment, tmp_path: Path) -> None:
    (tmp_path / "e").write_text("a file")
    with pytest.raises(EnvironmentDataError, match="e: cannot be written"):
        environment.save(tmp_path / "e")


def edit(name: str, change: Callable[[dict[str, object]], object]) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        header = json.loads((folder / name).read_text())
        change(header)
        (folder / name).write_text(json.dumps(header))

    return apply


def truncate(name: str, size: int) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        (folder / name).write_bytes((folder / name).read_bytes()[:size])

    return apply


def store(name: str, array: object) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        with (folder / name).open("wb") as file:
            np.save(file, array, allow_pickle=True)  # type: ignore[arg-type]

    return apply


def archive(folder: Path) -> None:
    with (folder / "ccr.npy").open("wb") as file:
        np.savez(file, a=np.zeros(3))


HEADER = "environment.json"
HOSTILE: list[tuple[str, Callable[[Path], object]]] = [
    (HEADER, lambda folder: (folder / HEADER).unlink()),
    (HEADER, lambda folder: (folder / HEADER).write_text("")),
    (HEADER, lambda folder: (folder / HEADER).write_bytes(b"\xff\xfe\x00")),
    (HEADER, lambda folder: (folder / HEADER).write_text("[" * 10_000)),
    (HEADER, lambda folder: (folder / HEADER).write_text("[1, 2]")),
    (HEADER, edit(HEADER, lambda header: header.pop("days"))),
    (HEADER, edit(HEADER, lambda header: header.update(colour="red"))),
    (HEADER, edit(HEADER, lambda header: header.update(format="zarr"))),
    (HEADER, edit(HEADER, lambda header: header.update(version=2))),
    (HEADER, edit(HEADER, lambda header: header.update(version="1"))),
    (HEADER, edit(HEADER, lambda header: header.update(shape=[10]))),
    (HEADER, edit(HEADER, lambda header: header.update(shape=[0, 10]))),
    (HEADER, edit(HEADER, lambda header: header.update(days=[]))),
    (HEADER, edit(HEADER, lambda header: header.update(days=[6, 0]))),
    (HEADER, edit(HEADER, lambda header: header.update(days=[-1, 6]))),
    (HEADER, edit(HEADER, lambda header: header.update(fields=["soil"]))),
    (HEADER, edit(HEADER, lambda header: header["model"]["ccr"].update(likelihood=7))),  # type: ignore[index]
    (HEADER, edit(HEADER, lambda header: header["model"]["soil"].update(spread="wide"))),  # type: ignore[index]
    ("tylcv.npy", edit(HEADER, lambda header: header.update(shape=[10, 11]))),
    ("soil-007.npy", edit(HEADER, lambda header: header.update(days=[0, 6, 7, 9]))),
    ("ccr.npy", lambda folder: (folder / "ccr.npy").unlink()),
    ("ccr.npy", truncate("ccr.npy", 0)),
    ("ccr.npy", truncate("ccr.npy", 60)),
    ("ccr.npy", truncate("ccr.npy", 150)),
    ("ccr.npy", archive),
    ("ccr.npy", lambda folder: (folder / "ccr.npy").write_bytes(pickle.dumps({"a": 1}))),
    ("ccr.npy", store("ccr.npy", np.array([[None] * 10] * 10, object))),
    ("ccr.npy", store("ccr.npy", np.zeros((10, 10), np.int16))),
    ("ccr.npy", store("ccr.npy", np.full((10, 10), -3, np.int8))),
    ("ccr.npy", store("ccr.npy", np.asfortranarray(np.zeros((10, 10), np.int8)))),
    ("soil-006.npy", truncate("soil-006.npy", 400)),
    ("soil-006.npy", store("soil-006.npy", np.zeros((10, 10)))),
    ("soil-006.npy", store("soil-006.npy", np.zeros((10, 9), np.float32))),
    ("soil-006.npy", store("soil-006.npy", np.zeros((10, 10), ">f4"))),
]


@pytest.mark.parametrize("mmap", [True, False])
@pytest.mark.parametrize(("name", "harm"), HOSTILE)
def test_files_that_are_not_what_they_claim_are_named(
    folder: Path, name: str, harm: Callable[[Path], object], mmap: bool
) -> None:
    harm(folder)
    with pytest.raises(EnvironmentDataError) as caught:
        Environment.load(folder, mmap=mmap)
    assert str(caught.value).startswith(str(folder / name) + ": ")
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, WbfMissionError)


@pytest.mark.parametrize("name", ["nowhere", "file"])
def test_a_path_that_is_no_folder_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(EnvironmentDataError, match=f"{name}: no such folder"):
        Environment.load(tmp_path / name)


def test_soil_blocks_have_to_come_in_order(tmp_path: Path) -> None:
    with SoilFiles(tmp_path, (4, 3), [1]) as files:
        files(1, 0, np.zeros((2, 3), np.float32))
        with pytest.raises(EnvironmentDataError, match="soil of day 1"):
            files(1, 3, np.zeros((1, 3), np.float32))
