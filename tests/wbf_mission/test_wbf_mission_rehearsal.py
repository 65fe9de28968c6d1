"""On a large farm's first run the estimator is compiled in another process; the estimate is the same."""

import os
from functools import partial

import joblib
import pytest
from processes import compiled_by, copy_compiled

from wbf_mission import Scenario
from wbf_mission.run.rehearsal import rehearsed
from wbf_mission.run.resolve import resolve

FIRST_RUNS = """
import json
from geo.compiled import compile_notices
from wbf_mission import Scenario, fly

large = Scenario(farm="waterberry", planner="random-waypoint", vehicle="ideal", budget="600steps")
names, results = [], []
with compile_notices(names.append):
    for _ in range(2):
        results.append(fly(large))
print(json.dumps([names, [one.score for one in results], [one.final_score for one in results]]))
"""


@pytest.fixture(autouse=True)
def compiler(monkeypatch, tmp_path):
    """Two cores that compile into a folder of their own."""
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "compiled"))
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)


def run_on(farm="waterberry", **options):
    return resolve(Scenario(farm=farm, planner="spiral", vehicle="ideal", **options))


def note_call(folder, name):
    with (folder / "calls").open("a") as calls:
        calls.write(f"{name}\n")


def refuse(_name):
    raise OSError(28, "No space left on device")


def calls_of(folder):
    path = folder / "calls"
    return path.read_text().split() if path.exists() else []


def test_an_estimator_is_compiled_once_and_its_mark_stays(tmp_path):
    for _ in range(2):
        with rehearsed(run_on(), partial(note_call, tmp_path)) as ready:
            ready()
            ready()
    assert calls_of(tmp_path) == ["gp"]
    with rehearsed(run_on(estimator="adaptive-disk"), partial(note_call, tmp_path)) as ready:
        ready()
    assert calls_of(tmp_path) == ["gp", "adaptive-disk"]


def test_what_fails_beside_a_run_does_not_stop_it_and_is_tried_again(tmp_path):
    with rehearsed(run_on(), refuse) as ready:
        ready()
    with rehearsed(run_on(), partial(note_call, tmp_path)) as ready:
        ready()
    assert calls_of(tmp_path) == ["gp"]


@pytest.mark.parametrize("missing", ["compiler", "core", "cache"])
def test_without_a_second_core_a_compiler_or_a_cache_nothing_runs_beside(tmp_path, monkeypatch, missing):
    if missing == "core":
        monkeypatch.setattr(joblib, "cpu_count", lambda: 1)
    elif missing == "compiler":
        monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    else:
        (tmp_path / "file").write_text("no folder")
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "compiled"))
    with rehearsed(run_on(), partial(note_call, tmp_path)) as ready:
        ready()
    assert calls_of(tmp_path) == []


@pytest.mark.slow
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one core compiles by itself")
def test_a_first_run_finds_the_estimator_compiled_and_scores_as_a_later_one(tmp_path):
    first = tmp_path / "first"
    # What else there is takes long to compile, and nobody asks for it.
    copy_compiled(first, "*.*", but=("sensors.estimators.gp.*", "wbf_mission.maps*"))
    names, scores, last = compiled_by(FIRST_RUNS, first)
    assert scores[0] == scores[1]
    assert last[0] == last[1]
    assert any(name.startswith("wbf_mission.maps.") for name in names)  # what the run itself compiled
    assert not [name for name in names if name.startswith("sensors.estimators.gp.tile.")]
