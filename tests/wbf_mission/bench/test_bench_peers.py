"""Planners of other libraries in the benchmark, with stand-ins for the libraries' programs."""

import os
import shutil
import sys
from pathlib import Path

import peer_planners
import pytest

from wbf_mission import BenchSpec, Scenario, benchmark, fly
from wbf_mission.scenario.choice import Choice

WORKERS = Path(peer_planners.__file__).parent / "peer_workers"
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
        return {}
    seen.extend(asked["seen"])
    assert all(0.0 <= sick <= 1.0 for _, _, sick in seen)
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
    monkeypatch.setenv(peer_planners.FOLDER, str(tmp_path))
    monkeypatch.setenv(f"{peer_planners.FOLDER}_WORKERS", str(workers))
    monkeypatch.setattr(peer_planners, "_workers", {})
    monkeypatch.setattr(peer_planners, "_tours", {})
    yield
    for one in peer_planners._workers.values():
        one.close()


@pytest.mark.usefixtures("libraries")
def test_a_tour_of_a_library_is_flown_and_a_failure_is_told():
    spec = BenchSpec.of(
        ["WBF/Miniberry-10-v1"],
        [Choice(f"tour:{m}", {"method": m}, peer_planners.sgptools) for m in ("ContinuousSGP", "CMA")],
        ["point"],
        1,
    )
    good, bad = benchmark(spec)
    assert good.error is None
    assert good.cells_observed > 15
    assert bad.score is None
    assert "ValueError: no such luck" in bad.error
    assert len(peer_planners._tours) == 1


@pytest.mark.usefixtures("libraries")
def test_goals_of_a_library_are_flown_one_after_the_other():
    run = Scenario(
        farm="miniberry-10",
        vehicle="ideal",
        budget="60steps",
        policy=peer_planners.PyPolo(),
        estimator="point",
    )
    first, again = (fly(run) for _ in range(2))
    assert first.outcome.is_good
    assert len(first.decisions) > 5
    assert first.observations.y.max() > first.observations.y.min() + 2, "what it sees moves its goals"
    assert 50 < len(first.observations) <= 62
    assert again.score == first.score


@pytest.mark.usefixtures("libraries")
def test_a_program_that_ends_is_told():
    worker = peer_planners.worker("pypolo")
    worker.close()
    with pytest.raises(RuntimeError, match="its program has ended"):
        worker.ask({"ask": "start"})


def test_the_environment_is_left_as_it_was():
    assert peer_planners.FOLDER not in os.environ
