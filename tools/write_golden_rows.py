"""Write the golden rows: a small benchmark whose results change only with a behaviour number.

``python tools/write_golden_rows.py`` flies them. Rows that differ from the kept ones are written only if a
number of `wbf_mission.version.BEHAVIOUR` was raised; the commit says why. ``--out FILE``: elsewhere.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from geo.atomic import atomic_write
from geo.compiled import compiled_folder
from wbf_mission.bench.provenance import libraries
from wbf_mission.version import BEHAVIOUR

TABLE = Path(__file__).parents[1] / "tests" / "data" / "golden_rows.json"
NEAR = 1e-6
"""Relative difference of values that other versions of the libraries may give."""
_APART = "WRITE_GOLDEN_ROWS_APART"
_TAKES_MINUTES = ("Waterberry", "Miniberry-100", "-Days")


def flown() -> dict[str, Any]:
    """Fly the golden rows; return them by name, with the numbers and libraries that they are of."""
    from wbf_mission import BenchSpec, benchmark
    from wbf_mission.scenario import scenario_ids

    fixed = ["lawnmower", "adaptive-lawnmower", "spiral", "random-waypoint"]
    every = BenchSpec.of(
        ["WBF/Miniberry-10-v1"],
        planners=[*fixed, "greedy", "rolling-horizon"],
        estimators=["point", "adaptive-disk", "gp", "epidemic"],
        seeds=2,
    )
    short = [name for name in scenario_ids() if not any(part in name for part in _TAKES_MINUTES)]
    windy = [name for name in scenario_ids() if name.endswith("-Wind-v1")]
    kinds = BenchSpec.of([*short, *windy], planners=["spiral", "greedy"], estimators=["point"], seeds=1)
    rows = [row for spec in (every, kinds) for row in benchmark(spec)]
    return {
        "behaviour": BEHAVIOUR,
        "libraries": libraries(),
        "rows": {
            f"{row.scenario}, {row.planner}, {row.estimator}, seed {row.seed}": {
                "path_length_m": row.path_length_m,
                "flight_time_s": row.flight_time_s,
                "observations": row.observations,
                "score": row.score,
                "final_score": row.final_score,
            }
            for row in rows
        },
    }


def changes(kept: dict[str, Any], now: dict[str, Any]) -> Iterator[str]:
    """Yield how rows differ from the kept ones: to the bit where the libraries are the same."""
    within = 0.0 if kept["libraries"] == now["libraries"] else NEAR
    for name in sorted(kept["rows"].keys() | now["rows"].keys()):
        old, new = kept["rows"].get(name), now["rows"].get(name)
        if old is None or new is None:
            yield f"{name}: {'is new' if old is None else 'is gone'}"
            continue
        for value, was in old.items():
            there = new[value]
            same = was == there or (None not in (was, there) and abs(was - there) <= within * abs(was))
            if not same:
                yield f"{name}: {value} was {was} and is {there}"


def main() -> None:
    """Write the rows, in a process that finds nothing trained."""
    if _APART not in os.environ:
        with tempfile.TemporaryDirectory() as folder:
            caches = {_APART: "1", "XDG_CACHE_HOME": folder, "NUMBA_CACHE_DIR": str(compiled_folder())}
            sys.exit(subprocess.call([sys.executable, *sys.argv], env={**os.environ, **caches}))
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--out", type=Path, default=TABLE)
    out, now = options.parse_args().out, flown()
    if out == TABLE and TABLE.exists():
        kept = json.loads(TABLE.read_text())
        differing = list(changes(kept, now))
        if kept["behaviour"] == BEHAVIOUR and any(not text.endswith("is new") for text in differing):
            few = "\n".join(differing[:20])
            sys.exit(
                f"{few}\n{len(differing)} values differ: raise the number of the room that changed in"
                " wbf_mission/version.py, or find out what changed by mistake"
            )
    with atomic_write(out) as file:
        file.write(json.dumps(now, indent=1) + "\n")


if __name__ == "__main__":
    main()
