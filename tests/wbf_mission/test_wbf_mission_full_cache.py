"""A cache that is full or cannot be written costs time; it is said once, and the job goes on."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from geo import get_farm
from geo.system import CacheWarning, user_cache_folder
from sensors.estimators.gp import prior
from sensors.fields import PAPER_FIELDS


def full(*_: object, **__: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def blocked(folder: Path) -> Path:
    (folder / "file").write_text("in the way")
    return folder / "file" / "cache"


@pytest.mark.parametrize("is_full", [True, False])
def test_learned_priors_are_used_where_they_cannot_be_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_full: bool
) -> None:
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


def test_a_flight_without_a_cache_says_so_in_one_line(tmp_path: Path) -> None:
    environment = os.environ | {
        "XDG_CACHE_HOME": str(blocked(tmp_path)),
        "NUMBA_CACHE_DIR": numba.config.CACHE_DIR or str(user_cache_folder("compiled")),
    }
    fly = "fly --farm miniberry-10 --vehicle ideal --planner lawnmower --estimator gp:learn_from=model"
    code = (
        "import sys; from sensors.estimators.gp import prior; from wbf_mission.cli.app import main;"
        "prior._MOST_SIMULATIONS, prior._SOIL_SIMULATIONS = 20, 16; sys.exit(main(sys.argv[1:]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *fly.split(), "--no-files", "-q"],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
    )
    assert done.stderr.startswith("warning: ")
    assert "cannot write this cache" in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    assert "completed" in done.stdout
