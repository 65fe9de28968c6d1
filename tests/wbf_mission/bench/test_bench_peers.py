"""Planners of other libraries in the benchmark, with stand-ins for the libraries' programs."""

import shutil
import sys
from functools import cache
from pathlib import Path

import numpy as np
import peers
import pytest

from wbf_mission import BenchSpec, Scenario, benchmark, fly
from wbf_mission.scenario.choice import Choice

WORKERS = Path(peers.__file__).parent / "peer_workers"
STAND_INS = {
    "sgptools": """
from lines import serve
def answer(asked):
    print("a library that prints")
    if asked["method"] == "CMA":
        raise ValueError("no such\\nluck")
    (x0, y0), (x1, y1) = asked["low"], asked["high"]
    metres, points, y = asked["length_m"], [], y0
    while metres > 2 * (x1 - x0):
        points += [[x0, y], [x1, y]]
        y, metres = y + 0.3, metres - (x1 - x0) - 0.3
    return {"points_m": points}
serve(answer)
""",
    "pypolo": """
from lines import serve
seen = []
def answer(asked):
    if asked["ask"] == "start":
        seen.clear()
        return {"pilot": [asked["start"], [2.0, 0.2]]}
    seen.extend(asked["seen"])
    assert all(0.0 <= sick <= 1.0 for _, _, sick in seen)
    assert len(seen) <= 42, "each reading comes once"
    x, y = asked["position"]
    return {"goal": [1.0 + 1.5 * (x < 1.5), 0.4 + 0.02 * len(seen)]}
serve(answer)
""",
}


@pytest.fixture
def libraries(tmp_path, monkeypatch):
    """Virtual environments of which only the programs are not the real ones."""
    workers = tmp_path / "workers"
    workers.mkdir()
    shutil.copy(WORKERS / "lines.py", workers)
    for name, text in STAND_INS.items():
        (tmp_path / name / "bin").mkdir(parents=True)
        (tmp_path / name / "bin" / "python").symlink_to(sys.executable)
        (workers / f"{name}_worker.py").write_text(text)
    monkeypatch.setenv(peers.FOLDER, str(tmp_path))
    begun = []
    monkeypatch.setattr(peers, "worker", cache(lambda name: begun.append(peers.Worker(name)) or begun[-1]))
    peers.tour.cache_clear()
    yield
    for worker in begun:
        worker.close()


@pytest.mark.usefixtures("libraries")
def test_a_tour_of_a_library_is_flown_and_a_failure_is_told():
    spec = BenchSpec.of(
        ["WBF/Miniberry-10-v1"],
        [Choice(f"tour:{m}", {"method": m}, peers.sgptools) for m in ("ContinuousSGP", "CMA")],
        ["point"],
        2,
    )
    good, also_good, bad, _ = sorted(benchmark(spec), key=lambda row: row.error or "")
    assert also_good.error is None
    assert peers.tour.cache_info().currsize == 1, "a plan that depends on the farm alone is asked once"
    assert good.error is None
    assert good.cells_observed > 15
    assert bad.score is None
    assert "ValueError: no such luck" in bad.error


@pytest.mark.usefixtures("libraries")
def test_goals_of_a_library_are_flown_one_after_the_other():
    run = Scenario(
        farm="miniberry-10", vehicle="ideal", budget="40steps", policy=peers.PyPolo(), estimator="point"
    )
    first, again = (fly(run) for _ in range(2))
    assert first.outcome.is_good
    assert len(first.decisions) > 5
    assert first.observations.y.max() > first.observations.y.min() + 2, "what it sees moves its goals"
    assert 30 < len(first.observations) <= 42
    assert again.score == first.score


def test_a_path_is_cut_into_steps_of_the_robot():
    path = peers.steps_along([[1.0, 0.0], [1.0, 0.4]], (0.0, 0.0), 0.3)
    assert path == pytest.approx(np.array([[0.3, 0], [0.6, 0], [0.9, 0], [1.0, 0.2], [1.0, 0.4]]))
    assert len(peers.steps_along([[0.9, 0.0]], (0.0, 0.0), 0.3)) == 3
