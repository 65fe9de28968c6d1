"""A benchmark of many runs takes no more memory than one of few."""

import tracemalloc
from array import array
from pathlib import Path

import numpy as np
import pytest

from wbf_mission.bench.benchmark import benchmark
from wbf_mission.bench.rows import BenchRow, BenchStore, read_rows
from wbf_mission.bench.spec import BenchSpec

PAGE_BYTES = 4096


def resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * PAGE_BYTES / 1e6


FIELDS = ("tylcv", "ccr", "soil")


def row(seed, draw):
    return BenchRow(
        key=f"{seed:024x}",
        scenario="WBF/Miniberry-30-Sweep-v1",
        planner="rolling-horizon:horizon=4",
        estimator="epidemic",
        seed=seed,
        outcome="mission complete",
        score=draw.random(),
        final_score=draw.random(),
        losses={name: draw.random() for name in FIELDS},
        timings_s={name: draw.random() for name in ("plan", "environment", "flight", "estimate and score")},
        times_s=array("d", np.arange(36.0)),
        scores=array("d", draw.random(36)),
        history={name: array("d", draw.random(36)) for name in FIELDS},
        versions={"wbf-mission": "0.1.0", "python": "3.11.9", "numpy": "2.3.1"},
    )


def test_a_row_of_36_scored_times_takes_less_than_four_kilobytes(tmp_path):
    draw = np.random.default_rng(2)
    with BenchStore(tmp_path) as store:
        for seed in range(600):
            store.add(row(seed, draw))
    assert len(read_rows(tmp_path)) == 600  # all that is imported, is
    tracemalloc.start()
    try:
        rows = read_rows(tmp_path)
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(rows) == 600
    assert held / len(rows) < 4000


@pytest.mark.slow
def test_memory_is_flat_over_a_sweep(tmp_path):
    spec = BenchSpec.of(
        ["WBF/Miniberry-10-v1"], planners=["spiral", "random-waypoint"], estimators=["gp"], seeds=100
    )
    resident: list[float] = []
    rows = benchmark(spec, out=tmp_path, progress=lambda *_: resident.append(resident_mb()))
    assert len(resident) == len(rows) == len(spec)
    # A leak of 100 kB a run would show.
    assert resident[-1] - resident[len(resident) // 2] < 10.0
