"""``wbf-mission farm generate``, and the cache of ``fly``."""

import json
import os
import signal
import sys
import time

import pytest
from command_line import run
from processes import started

from geo.system import AvailableMemory
from sensors.environment import cache, load_environment
from wbf_mission.addons.ensembles.ensemble import Ensemble

GENERATE = ["farm", "generate", "--farm", "miniberry-10", "--days", "3"]
FLY = ["fly", "--farm", "miniberry-10", "--vehicle", "ideal", "--planner", "lawnmower"]
FLY += ["--estimator", "adaptive-disk", "--no-files", "--json"]


def test_an_ensemble_is_generated_once(capsys, tmp_path):
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
    assert run(capsys, *GENERATE, "--keep", "0,2-3", "--out", str(tmp_path / "kept"), "-q")[0] == 0
    assert Ensemble.load(tmp_path / "kept")[0].days == (0, 2, 3)


@pytest.mark.parametrize(
    "words", ["--count 0", "--days 127", "--jobs 0", "--keep x", "--keep 6-2", "--keep 20", "--farm atlantis"]
)
def test_bad_input_is_one_line_and_exit_code_2(capsys, tmp_path, words):
    code, out, err = run(capsys, *GENERATE, "--out", str(tmp_path / "e"), *words.split())
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert words.split()[0] in err or "atlantis" in err
    assert not (tmp_path / "e").exists()


def test_too_little_memory_is_one_line_and_exit_code_2(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("geo.system.available_memory", lambda: AvailableMemory(300_000_000, "the test"))
    out = str(tmp_path / "e")
    code, _, err = run(
        capsys, "farm", "generate", "--farm", "waterberry", "--jobs", "2", "--count", "2", "--out", out
    )
    assert code == 2
    assert err.startswith("error: ensemble: generating 2 environments of 6000 x 5000 cells at once needs ")
    assert err.rstrip().endswith("but 300 MB are free (the test); take fewer jobs")
    assert err.count("\n") == 1


def test_ctrl_c_keeps_what_is_finished(capsys, tmp_path):
    command = ["farm", "generate", "--farm", "miniberry-30", "--count", "400", "--out", str(tmp_path / "e")]
    process = started([sys.executable, "-m", "wbf_mission", *command, "--jobs", "2"])
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


def test_fly_takes_the_environment_from_the_cache(capsys, tmp_path, monkeypatch):
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
