"""A benchmark of many runs takes no more memory than one of few."""

from pathlib import Path

import pytest

from wbf_mission.bench.benchmark import benchmark
from wbf_mission.bench.spec import BenchSpec

PAGE_BYTES = 4096


def resident_mb():
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * PAGE_BYTES / 1e6


@pytest.mark.slow
def test_memory_is_flat_over_a_sweep(tmp_path):
    spec = BenchSpec.of(
        ["WBF/Miniberry-10-v1"], planners=["spiral", "random-waypoint"], estimators=["gp"], seeds=60
    )
    resident = []
    rows = benchmark(spec, out=tmp_path, progress=lambda *_: resident.append(resident_mb()))
    assert len(resident) == len(rows) == len(spec)
    # A leak of 100 kB a run would show.
    assert resident[-1] - resident[len(resident) // 2] < 6.0
