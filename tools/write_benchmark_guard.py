"""Write the table that guards the scores: a small benchmark whose results change only on purpose.

``python tools/write_benchmark_guard.py``, and the commit says why.
"""

from __future__ import annotations

import json
from pathlib import Path

from geo.atomic import atomic_write
from wbf_mission import BenchSpec, benchmark

TABLE = Path(__file__).parents[1] / "tests" / "data" / "benchmark_guard.json"
SPEC = BenchSpec.of(
    ["WBF/Miniberry-10-v1"],
    planners=["lawnmower", "adaptive-lawnmower", "spiral", "random-waypoint", "greedy", "rolling-horizon"],
    estimators=["point", "adaptive-disk", "gp", "epidemic"],
    seeds=2,
)


def table() -> dict[str, list[float | None]]:
    """Return the score over the run and at its end of each run, by what it is of."""
    return {
        f"{row.planner}, {row.estimator}, seed {row.seed}": [row.score, row.final_score]
        for row in benchmark(SPEC)
    }


if __name__ == "__main__":
    with atomic_write(TABLE) as file:
        file.write(json.dumps(table(), indent=1) + "\n")
