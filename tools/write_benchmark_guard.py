"""Write the table that guards the scores: a small benchmark whose results change only on purpose.

``python tools/write_benchmark_guard.py``, and the commit says why. ``--out FILE`` writes it elsewhere.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from geo.atomic import atomic_write
from geo.compiled import compiled_folder

TABLE = Path(__file__).parents[1] / "tests" / "data" / "benchmark_guard.json"
_APART = "WRITE_BENCHMARK_GUARD_APART"


def table() -> dict[str, list[float | None]]:
    """Return the score over the run and at its end of each run, by what it is of."""
    from wbf_mission import BenchSpec, benchmark

    spec = BenchSpec.of(
        ["WBF/Miniberry-10-v1"],
        planners=[
            "lawnmower",
            "adaptive-lawnmower",
            "spiral",
            "random-waypoint",
            "greedy",
            "rolling-horizon",
        ],
        estimators=["point", "adaptive-disk", "gp", "epidemic"],
        seeds=2,
    )
    return {
        f"{row.planner}, {row.estimator}, seed {row.seed}": [row.score, row.final_score]
        for row in benchmark(spec)
    }


def main() -> None:
    """Write the table, in a process that finds nothing trained."""
    if _APART not in os.environ:
        with tempfile.TemporaryDirectory() as folder:
            caches = {_APART: "1", "XDG_CACHE_HOME": folder, "NUMBA_CACHE_DIR": str(compiled_folder())}
            sys.exit(subprocess.call([sys.executable, *sys.argv], env={**os.environ, **caches}))
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--out", type=Path, default=TABLE)
    with atomic_write(options.parse_args().out) as file:
        file.write(json.dumps(table(), indent=1) + "\n")


if __name__ == "__main__":
    main()
