import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from geo.farms import get_farm
from geo.grid import FarmGrid
from geo.system import CacheWarning
from sensors.environment import SoilParameters, cache, generate_environment
from sensors.environment.cache import LIMIT_VARIABLE, EnvironmentCache
from sensors.errors import EnvironmentDataError
from sensors.fields import PAPER_FIELDS


@pytest.fixture(scope="module")
def grid():
    return get_farm("miniberry-30").grid()


@pytest.fixture(autouse=True)
def every_farm_is_large(monkeypatch):
    monkeypatch.setattr(cache, "CACHED_FROM_CELLS", 0)


@pytest.fixture
def kept(tmp_path):
    return EnvironmentCache(tmp_path / "cache", 10**9)


def entries(kept):
    return sorted(kept.folder.iterdir())


def never(*_):
    pytest.fail("generated again")


def test_the_second_time_nothing_is_generated(kept, grid):
    first, cached = kept.environment(grid, day=6, seed=7, farm_name="m")
    assert not cached
    second, cached = kept.environment(grid, day=6, seed=7, farm_name="m", progress=never)
    assert cached
    assert second.days == (6,)
    assert second.provenance == first.provenance
    np.testing.assert_array_equal(second.values(6), first.values(6))
    np.testing.assert_array_equal(second.values(6), generate_environment(grid, days=6, seed=7).values(6))
    shutil.rmtree(kept.folder)
    assert second.sample(6, 3, 4).shape == (1, 3)


def test_everything_that_decides_an_environment_is_in_its_name(kept, grid, monkeypatch):
    crop = np.array(grid.crop)
    crop[3, 3] = 0
    wet = PAPER_FIELDS.with_dynamics(soil=SoilParameters(mean_rain=0.07))
    base = {"grid": grid, "day": 6, "seed": 7}
    for changes in (
        {},
        {"day": 7},
        {"seed": 8},
        {"seed": np.random.SeedSequence(7, spawn_key=(1,))},
        {"fields": wet},
        {"grid": FarmGrid(grid.shape, grid.cell_size_m, crop, np.array(grid.owned))},
    ):
        assert not kept.environment(**{**base, **changes})[1]
    assert len(entries(kept)) == 6
    monkeypatch.setattr("sensors.environment.store.VERSION", 4)
    assert not kept.environment(**base)[1]
    assert len(entries(kept)) == 7


def spoil(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x10
    path.write_bytes(content)


HARM = [
    lambda entry: (entry / "zarr.json").write_text("{}"),
    lambda entry: spoil(entry / "soil" / "c" / "0" / "0" / "0"),
    lambda entry: (entry / "ccr" / "c" / "0" / "0").write_bytes(b""),
    lambda entry: [shutil.rmtree(entry), entry.mkdir()],
]


@pytest.mark.parametrize("harm", HARM)
def test_a_damaged_entry_is_generated_again(kept, grid, harm):
    good = kept.environment(grid, day=6, seed=7)[0].values(6)
    harm(entries(kept)[0])
    again, cached = kept.environment(grid, day=6, seed=7)
    assert not cached
    np.testing.assert_array_equal(again.values(6), good)
    assert kept.environment(grid, day=6, seed=7, progress=never)[1]


def test_the_entries_used_least_recently_go_first(grid, tmp_path):
    kept = EnvironmentCache(tmp_path, 10**9)
    names = {}
    for seed in range(4):
        before = set(entries(kept))
        kept.environment(grid, day=6, seed=seed)
        (names[seed],) = set(entries(kept)) - before
        os.utime(names[seed], (1000 + seed, 1000 + seed))
    (tmp_path / "notes.txt").write_text("mine")
    assert kept.environment(grid, day=6, seed=0)[1]
    sizes = sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file()) // 4
    small = EnvironmentCache(tmp_path, int(3.5 * sizes))
    small.environment(grid, day=6, seed=9)
    left = [seed for seed, path in names.items() if path.exists()]
    assert left == [0, 3]
    assert (tmp_path / "notes.txt").exists()


def test_what_killed_processes_left_is_removed_after_a_while(grid, kept):
    old, new = (kept.folder / f".{letter * 32}.partial" for letter in "ab")
    other = kept.folder / ".git"
    for path in (old, new, other):
        path.mkdir(parents=True)
    os.utime(old, (1000, 1000))
    os.utime(other, (1000, 1000))
    kept.environment(grid, day=6, seed=7)
    assert not old.exists()
    assert new.exists()
    assert other.exists()


def test_a_cache_that_is_off_or_a_small_farm_writes_nothing(grid, tmp_path, monkeypatch):
    assert not EnvironmentCache(tmp_path / "a", 0).environment(grid, day=6, seed=7)[1]
    monkeypatch.setattr(cache, "CACHED_FROM_CELLS", 1000)
    assert not EnvironmentCache(tmp_path / "b", 10**9).environment(grid, day=6, seed=7)[1]
    assert list(tmp_path.iterdir()) == []
    assert EnvironmentCache.off().limit_bytes == 0


def test_a_folder_that_cannot_be_written_costs_only_time(grid, tmp_path):
    (tmp_path / "file").write_text("in the way")
    blocked = EnvironmentCache(tmp_path / "file" / "cache", 10**9)
    with pytest.warns(CacheWarning, match="cannot write this cache") as told:
        for seed in (7, 8):
            assert blocked.environment(grid, day=6, seed=seed)[0].days == (6,)
    assert len(told) == 1


def test_several_at_once_give_the_same(grid, kept):
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda _: kept.environment(grid, day=6, seed=7)[0].values(6), range(8)))
    for values in results:
        np.testing.assert_array_equal(values, results[0])
    assert kept.environment(grid, day=6, seed=7, progress=never)[1]
    assert len(entries(kept)) == 1


def test_the_users_cache_follows_the_environment_variables(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv(LIMIT_VARIABLE, "5")
    assert EnvironmentCache.of_user() == EnvironmentCache(
        tmp_path / "wbf-mission" / "environments", 5_000_000
    )
    monkeypatch.delenv(LIMIT_VARIABLE)
    assert EnvironmentCache.of_user().limit_bytes == 2_000_000_000
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert EnvironmentCache.of_user().folder == Path.home() / ".cache" / "wbf-mission" / "environments"
    for bad in ("-1", "1e3", "many", "9" * 20, "٣"):
        monkeypatch.setenv(LIMIT_VARIABLE, bad)
        with pytest.raises(EnvironmentDataError, match="is not a number of megabytes"):
            EnvironmentCache.of_user()
