from __future__ import annotations

import json
import multiprocessing
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from geo.farms import get_farm
from geo.grid import FarmGrid
from geo.seeds import child_seed
from sensors.environment import Environment, generate_environment
from sensors.errors import EnvironmentDataError
from wbf_mission.addons.ensembles import ensemble as ensemble_module
from wbf_mission.addons.ensembles.ensemble import Ensemble, generate_ensemble, member_folder


@pytest.fixture(scope="module")
def grid() -> FarmGrid:
    return get_farm("miniberry-10").grid()


def content(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


def assert_same(a: Environment, b: Environment) -> None:
    for disease in ("tylcv", "ccr"):
        np.testing.assert_array_equal(a.onset(disease), b.onset(disease))
    for day in a.days:
        np.testing.assert_array_equal(a.values(day), b.values(day))


class Stop:
    """Progress that stops once so many members are done."""

    def __init__(self, at: float) -> None:
        self.at = at

    def __call__(self, done: float, total: float) -> None:
        if done >= self.at:
            raise KeyboardInterrupt


def test_members_have_their_own_seeds(grid: FarmGrid, tmp_path: Path) -> None:
    made = generate_ensemble(grid, tmp_path / "e", members=3, seed=7, days=4, farm_name="m")
    assert (made.made, made.found, len(made)) == ((0, 1, 2), (), 3)
    for member in range(3):
        alone = generate_environment(grid, days=4, seed=child_seed(7, "ensemble", str(member)))
        assert_same(made[member], alone)
        assert made[member].provenance.farm == "m"
    again = Ensemble.load(tmp_path / "e")
    assert_same(again[2], made[2])
    assert again.header == made.header
    for member in (-1, 3):
        with pytest.raises(IndexError, match="no member"):
            again[member]


def test_the_number_of_processes_changes_nothing(grid: FarmGrid, tmp_path: Path) -> None:
    progress: list[float] = []
    generate_ensemble(grid, tmp_path / "alone", members=3, seed=7, days=3)
    together = generate_ensemble(
        grid,
        tmp_path / "together",
        members=3,
        seed=7,
        days=3,
        jobs=2,
        progress=lambda done, _total: progress.append(done),
    )
    assert content(tmp_path / "alone") == content(tmp_path / "together")
    assert together.made == (0, 1, 2)
    assert progress[-1] == 3
    assert not multiprocessing.active_children()


def test_an_ensemble_can_grow_and_finished_members_are_kept(grid: FarmGrid, tmp_path: Path) -> None:
    generate_ensemble(grid, tmp_path, members=2, seed=7, days=3)
    before = content(tmp_path)
    grown = generate_ensemble(grid, tmp_path, members=3, seed=7, days=3)
    assert (grown.made, grown.found) == ((2,), (0, 1))
    after = content(tmp_path)
    assert all(after[name] == data for name, data in before.items() if name != "ensemble.json")
    fewer = generate_ensemble(grid, tmp_path, members=1, seed=7, days=3)
    assert (fewer.made, fewer.found, len(fewer)) == ((), (0,), 3)


def test_processes_stop_with_their_parent(grid: FarmGrid, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        generate_ensemble(grid, tmp_path / "e", members=60, seed=7, days=3, jobs=2, progress=Stop(1))
    assert not multiprocessing.active_children()
    finished = [int(path.name[-5:]) for path in (tmp_path / "e").glob("member-*")]
    assert 1 <= len(finished) < 60
    again = generate_ensemble(grid, tmp_path / "e", members=8, seed=7, days=3)
    assert set(again.found) == set(finished) & set(range(8))


def test_a_damaged_member_is_made_again(grid: FarmGrid, tmp_path: Path) -> None:
    generate_ensemble(grid, tmp_path, members=3, seed=7, days=3)
    good = content(tmp_path)
    shard = member_folder(tmp_path, 1) / "soil" / "c" / "2" / "0" / "0"
    shard.write_bytes(shard.read_bytes()[:50])
    shutil.rmtree(member_folder(tmp_path, 2) / "ccr")
    again = generate_ensemble(grid, tmp_path, members=3, seed=7, days=3)
    assert (again.made, again.found) == ((1, 2), (0,))
    assert content(tmp_path) == good


@pytest.mark.parametrize("changes", [{"seed": 8}, {"days": 4}, {"keep_days": [3]}, {"farm_name": "other"}])
def test_another_ensemble_is_not_touched(grid: FarmGrid, tmp_path: Path, changes: dict[str, Any]) -> None:
    generate_ensemble(grid, tmp_path, members=1, seed=7, days=3)
    before = content(tmp_path)
    with pytest.raises(EnvironmentDataError, match="has another ensemble"):
        generate_ensemble(grid, tmp_path, **{"members": 2, "seed": 7, "days": 3, **changes})
    assert content(tmp_path) == before


def test_a_folder_with_something_else_is_not_touched(grid: FarmGrid, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(EnvironmentDataError, match=r"ensemble\.json: cannot be read"):
        generate_ensemble(grid, tmp_path, members=1, seed=7)
    with pytest.raises(EnvironmentDataError, match="cannot be read"):
        generate_ensemble(grid, tmp_path / "thesis.txt", members=1, seed=7)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize(
    "text", ["", "[", "[" * 10_000, "{}", '{"format": "wbf-mission ensemble", "version": 2}', "\ud800"]
)
def test_hostile_headers_are_refused_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "ensemble.json").write_bytes(text.encode(errors="surrogatepass"))
    with pytest.raises(EnvironmentDataError) as caught:
        Ensemble.load(tmp_path)
    assert "\n" not in str(caught.value)
    assert str(tmp_path / "ensemble.json") in str(caught.value)


def test_versions_and_numbers_of_members_are_checked(grid: FarmGrid, tmp_path: Path) -> None:
    generate_ensemble(grid, tmp_path, members=1, seed=7, days=1)
    header = json.loads((tmp_path / "ensemble.json").read_text())
    for change in ({"version": 1}, {"format": "x"}, {"members": 0}, {"members": 10**9}, {"more": 1}):
        (tmp_path / "ensemble.json").write_text(json.dumps({**header, **change}))
        with pytest.raises(EnvironmentDataError, match="ensemble"):
            Ensemble.load(tmp_path)


@pytest.mark.parametrize("numbers", [{"members": 0}, {"members": 10**6}, {"members": 2, "jobs": 0}])
def test_bad_numbers_are_refused(grid: FarmGrid, tmp_path: Path, numbers: dict[str, int]) -> None:
    with pytest.raises(EnvironmentDataError, match="ensemble: "):
        generate_ensemble(grid, tmp_path / "e", seed=7, **numbers)
    assert not (tmp_path / "e").exists()


def test_a_full_disk_is_foreseen(grid: FarmGrid, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ensemble_module.shutil, "disk_usage", lambda _path: SimpleNamespace(free=1000))
    with pytest.raises(EnvironmentDataError, match=r"9 members of 4 days need about 8 kB of disk, but 1 kB"):
        generate_ensemble(grid, tmp_path / "e", members=9, seed=7, days=3)
    assert not (tmp_path / "e").exists()
