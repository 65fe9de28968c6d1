"""How often a run is scored, what it needs, and that scoring on the way looks only at what changed."""

import threading

import numpy as np
import pytest
from stand_in import LONG_S

import geo.system
from geo.farms import get_farm
from geo.system import AvailableMemory, NotEnoughMemoryError
from sensors.errors import EstimatorError
from sensors.estimation import Evidence, RunEstimate
from sensors.estimators import make_estimator
from sensors.fields import PAPER_FIELDS
from sensors.observations import Observations
from sensors.scoring.score import RunningScore
from wbf_mission.cli.app import main
from wbf_mission.run.estimation import require_run_memory, score_points


@pytest.mark.parametrize(
    ("farm", "estimator", "points"),
    [
        ("miniberry-30", "adaptive-disk", 25),
        ("miniberry-100", "gp-sklearn", 25),
        ("waterberry", "adaptive-disk", 100),
        ("waterberry", "gp-sklearn", 10),
    ],
)
def test_a_large_farm_is_scored_often_where_that_is_cheap(farm, estimator, points):
    assert score_points(get_farm(farm), make_estimator(estimator)) == points


def test_scores_on_the_way_are_those_of_the_whole_farm():
    grid = get_farm("miniberry-100").grid()
    rng = np.random.default_rng(2)
    truth = rng.choice([0.0, 0.5, 1.0], (3, *grid.shape)).astype(np.float32)
    x, y = rng.integers(0, 100, (2, 90))
    seen = Observations(x, y, np.arange(90.0), np.full(90, 6), truth[:, x, y].T)
    run = RunEstimate(
        make_estimator("adaptive-disk").fit(grid), RunningScore(truth, PAPER_FIELDS.masks(grid)), every=20
    )
    for start in range(0, 90, 7):
        run.add([seen[start : start + 7]])
    run.end_flight(100.0)
    run.close()
    assert run.history.observations == [20, 40, 60, 80, 90]
    for n, entry in zip(run.history.observations, run.history.entries, strict=True):
        model = make_estimator("adaptive-disk").fit(grid, seen[:n]).predict()
        assert entry == RunningScore(truth, PAPER_FIELDS.masks(grid)).evaluate(model.value)


def test_an_error_of_the_estimator_ends_the_run_and_names_it():
    class Broken(type(make_estimator("point"))):
        def _learn(self, observations):
            raise ZeroDivisionError("halves of nothing")

    grid = get_farm("miniberry-10").grid()
    run = RunEstimate(
        Broken().fit(grid), RunningScore(np.ones((3, 10, 10)), PAPER_FIELDS.masks(grid)), every=1
    )
    run.add([Observations([1], [1], [0.0], [6], [[1, 1, 0.5]])])
    with pytest.raises(EstimatorError, match=r"estimator Broken failed: ZeroDivisionError: halves"):
        run.end_flight(1.0)
    run.close()


def test_a_snapshot_is_what_was_known_when_it_was_asked_for():
    grid, seen = get_farm("miniberry-10").grid(), Observations([1], [1], [0.0], [6], [[0.0, 0.0, 0.5]])
    estimator, may_learn = make_estimator("point").fit(grid), threading.Event()
    score = RunningScore(np.ones((3, *grid.shape), np.float32), PAPER_FIELDS.masks(grid))
    run = RunEstimate(estimator, score, every=1, ready=lambda: may_learn.wait(LONG_S))
    evidence = Evidence(get_farm("miniberry-10"), PAPER_FIELDS, run)
    evidence.add(seen, offset_s=0.0)
    model = evidence.snapshot()
    evidence.add(Observations([2], [2], [1.0], [6], [[0.0, 0.0, 0.5]]), offset_s=0.0)
    may_learn.set()
    run.end_flight(2.0)
    assert model().value[0, 1:3, 1:3].diagonal().tolist() == [0.0, 1.0]
    assert run.model.value[0, 1:3, 1:3].diagonal().tolist() == [0.0, 0.0]
    run.close()


def test_nobody_asks_the_estimator_while_a_snapshot_is_made(monkeypatch):
    grid = get_farm("miniberry-10").grid()
    estimator = make_estimator("point").fit(grid)
    predict, may_end, busy = estimator.predict, threading.Event(), threading.Lock()

    def slowly():
        assert busy.acquire(blocking=False), "two threads at once"
        may_end.wait(0.2)
        busy.release()
        return predict()

    monkeypatch.setattr(estimator, "predict", slowly)
    run = RunEstimate(estimator, RunningScore(np.ones((3, 10, 10), np.float32), PAPER_FIELDS.masks(grid)))
    run.add([Observations([1], [1], [0.0], [6], [[1, 1, 0.5]])])
    taken = run.snapshot()
    run.end_flight(1.0)
    assert taken.done()
    run.close()


def little(monkeypatch, size):
    found = AvailableMemory(size, "control group limit 1.0 GB")
    monkeypatch.setattr(geo.system, "available_memory", lambda: found)


def test_a_run_that_would_not_fit_is_refused_before_it_starts(monkeypatch, capsys, tmp_path):
    little(monkeypatch, 900_000_000)
    short = ["--vehicle", "ideal", "--planner", "random-waypoint", "--budget", "200steps"]
    large = ["--farm", "waterberry", "--estimator", "adaptive-disk"]
    code = main(["fly", *large, *short, "--out", str(tmp_path), "-q"])
    assert code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert (
        "flying waterberry (6000 x 5000 cells) with AdaptiveDiskEstimator needs 1.8 GB of memory" in lines[0]
    )
    assert "but 900 MB are free (control group limit 1.0 GB)" in lines[0]
    assert not list(tmp_path.iterdir())


def test_an_estimator_says_what_it_needs(monkeypatch):
    class Greedy:
        def memory_bytes(self, shape, n_observations):
            return 1000 * n_observations + shape[0]

    little(monkeypatch, 900_000_000)
    require_run_memory(get_farm("miniberry-10"), Greedy(), 10)
    with pytest.raises(NotEnoughMemoryError, match=r"Greedy needs 1\.3 GB of memory \(estimate 1\.0 GB"):
        require_run_memory(get_farm("miniberry-10"), Greedy(), 10**6)
