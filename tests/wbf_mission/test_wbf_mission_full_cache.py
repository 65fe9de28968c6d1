"""A cache that is full or cannot be written costs time; it is said once, and the job goes on."""

import errno

import pytest

from geo import get_farm
from geo.system import CacheWarning
from sensors.estimators.gp import prior
from sensors.fields import PAPER_FIELDS


def full(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device")


def blocked(folder):
    (folder / "file").write_text("in the way")
    return folder / "file" / "cache"


@pytest.mark.parametrize("is_full", [True, False])
def test_learned_priors_are_used_where_they_cannot_be_kept(tmp_path, monkeypatch, is_full):
    folder = tmp_path / "kept" if is_full else blocked(tmp_path)
    if is_full:
        monkeypatch.setattr(prior, "atomic_write", full)
    monkeypatch.setattr(prior, "_MOST_SIMULATIONS", 20)
    monkeypatch.setattr(prior, "_SOIL_SIMULATIONS", 16)
    grid = get_farm("miniberry-10").grid()
    with pytest.warns(CacheWarning, match="cannot write this cache") as told:
        for seed in (9001, 9002) if is_full else (9003, 9004):
            learned = prior.learn_priors(grid, PAPER_FIELDS, 6, seed, folder)
            assert len(learned) == 3
    assert len(told) == 1
    assert not folder.is_dir() or list(folder.iterdir()) == []
