"""``wbf-mission farm generate``, and the cache of ``fly``."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from processes import environment
from sweeps import slow

from geo.system import AvailableMemory
from sensors.environment import cache, load_environment
from wbf_mission.addons.ensembles.ensemble import Ensemble
from wbf_mission.cli.app import main

GENERATE = ["farm", "generate", "--farm", "miniberry-10", "--days", "3"]
FLY = ["fly", "--farm", "miniberry-10", "--vehicle", "ideal", "--planner", "lawnmower"]
FLY += ["--estimator", "adaptive-disk", "--no-files", "--json"]


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(list(arguments))
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_an_ensemble_is_generated_once(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    command = [*GENERATE, "--count", "3", "--out", str(tmp_path / "e"), "--json"]
    code, out, err = run(capsys, *command)
    first = json.loads(out)
    assert (code, err) == (0, "")
    assert (first["members"], first["generated"], first["found"]) == (3, 3, 0)
    assert first["days"] == [0, 1, 2, 3]
    code, out, _ = run(capsys, *command)
    second = json.loads(out)
    assert (code, second["generated"], second["found"]) == (0, 0, 3)
    assert second["bytes"] == first["bytes"]
    assert Ensemble.load(tmp_path / "e")[2].days == (0, 1, 2, 3)


def test_a_table_says_what_was_done(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, out, err = run(capsys, *GENERATE, "--keep", "1,3", "--out", str(tmp_path / "e"), "-q")
    assert (code, err) == (0, "")
    assert "1: 1 generated now, 0 existed already" in out
    assert Ensemble.load(tmp_path / "e")[0].days == (1, 3)


def test_the_folder_is_named_after_the_farm(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, _ = run(capsys, *GENERATE)
    assert code == 0
    assert (tmp_path / "environments" / "miniberry-10" / "member-00000").is_dir()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--count", "0"], "--count"),
        (["--days", "127"], "--days"),
        (["--jobs", "0"], "--jobs"),
        (["--keep", "x"], "--keep"),
        (["--keep", "6-2"], "--keep"),
        (["--keep", "127"], "--keep"),
        (["--keep", ""], "--keep"),
        (["--farm", "atlantis"], "atlantis"),
        (["--seed", "-1"], "seed"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: list[str], says: str
) -> None:
    code, out, err = run(capsys, *GENERATE, "--out", str(tmp_path / "e"), *arguments)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert says in err
    assert not (tmp_path / "e").exists()


def test_too_little_memory_is_one_line_and_exit_code_2(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("geo.system.available_memory", lambda: AvailableMemory(300_000_000, "the test"))
    out = str(tmp_path / "e")
    code, _, err = run(
        capsys, "farm", "generate", "--farm", "waterberry", "--jobs", "2", "--count", "2", "--out", out
    )
    assert code == 2
    assert err.startswith("error: ensemble: generating 2 environments of 6000 x 5000 cells at once needs ")
    assert err.rstrip().endswith("but 300 MB are free (the test); take fewer jobs")
    assert err.count("\n") == 1


@pytest.mark.parametrize("jobs", [slow("1"), "2"])
def test_ctrl_c_keeps_what_is_finished(capsys: pytest.CaptureFixture[str], tmp_path: Path, jobs: str) -> None:
    command = ["farm", "generate", "--farm", "miniberry-30", "--count", "400", "--out", str(tmp_path / "e")]
    process = subprocess.Popen(
        [sys.executable, "-m", "wbf_mission", *command, "--jobs", jobs],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=environment(),
    )
    # With two jobs a later member may be finished before an earlier one.
    while process.poll() is None and len(list((tmp_path / "e").glob("member-*"))) < 2:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert "repeat the command for the others" in err
    assert "Traceback" not in err
    found = len(list((tmp_path / "e").glob("member-*")))
    assert 2 <= found < 400
    times = {path: path.stat().st_mtime_ns for path in (tmp_path / "e").glob("member-*/**/zarr.json")}
    command[5] = str(found + 2)
    code, text, _ = run(capsys, *command, "--json")
    values = json.loads(text)
    assert (code, values["generated"] + values["found"]) == (0, found + 2)
    assert values["found"] >= found - 2
    assert all(path.stat().st_mtime_ns == time_ns for path, time_ns in times.items())


def test_fly_takes_the_environment_from_the_cache(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv(cache.LIMIT_VARIABLE, "10")
    monkeypatch.setattr(cache, "CACHED_FROM_CELLS", 0)
    folder = tmp_path / "wbf-mission" / "environments"
    code, out, _ = run(capsys, *FLY, "--no-cache")
    assert (code, folder.exists()) == (0, False)
    without = json.loads(out)
    results = [json.loads(run(capsys, *FLY)[1]) for _ in range(2)]
    assert [result["environment_cached"] for result in results] == [False, True]
    (entry,) = folder.iterdir()
    assert load_environment(entry).days == (6,)
    for result in results:
        assert result["score"] == without["score"]
        assert result["losses"] == without["losses"]
    monkeypatch.setenv(cache.LIMIT_VARIABLE, "much")
    code, _, err = run(capsys, *FLY)
    assert code == 2
    assert cache.LIMIT_VARIABLE in err


def test_small_farms_stay_out_of_the_cache(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv(cache.LIMIT_VARIABLE, "10")
    code, out, _ = run(capsys, *FLY)
    assert (code, json.loads(out)["environment_cached"]) == (0, False)
    assert not (tmp_path / "wbf-mission").exists()
    assert np.isfinite(json.loads(out)["score"])
