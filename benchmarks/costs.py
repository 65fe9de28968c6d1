"""Processor time and memory of whole flights: growth with each quantity, and planning beside other libraries.

- *growth*: ``wbf-mission fly`` with one quantity varied at a time. The exponent is the slope of log cost over
  log size between the last two sizes, whole processes, start-up included. ``--picture`` draws all of them.
- *beside*: one flight on Miniberry-30 by our planners and policies, and by those of sgptools and PyPolo if
  `peers` has made their environments; the difference to `lawnmower` is the time of planning and deciding.

    python benchmarks/costs.py growth --picture docs/images/growth.png
    WBF_MISSION_PEERS=FOLDER python benchmarks/costs.py beside
"""

from __future__ import annotations

import json
import math
import os
import sys
from pathlib import Path

from common import options_of, print_table, scratch_folder
from peers import FOLDER

FLY = ("fly", "--quiet", "--no-files", "--json", "--estimator", "gp", "--score-points", "4")
SMALL = ("--farm", "1000000", "--planner", "random-waypoint", "--budget", "300s")
SERIES = {
    "cells": {
        n: ("--farm", str(n), "--planner", "random-waypoint", "--budget", "300s", "--no-cache")
        for n in (10**3, 10**4, 10**5, 10**6, 10**7)
    },
    "minutes of flight": {
        n: ("--farm", "waterberry", "--planner", "random-waypoint", "--budget", f"{n}min")
        for n in (2, 4, 8, 16)
    },
    "vehicles": {n: (*SMALL, "--vehicles", str(n)) for n in (1, 2, 4, 8)},
    "days": {n: (*SMALL, "--days", str(n)) for n in (1, 2, 4, 8)},
}
OURS = ("lawnmower", "spiral", "greedy", "rolling-horizon")
THEIRS = (
    "sgptools:method=HexCover",
    "sgptools:method=ContinuousSGP",
    "sgptools:method=CMA",
    "PyPolo:kernel=RBF",
)
SOUTH_WEST_DEG = (28.037, -82.15)
FOOT_DEG = 0.3048 / 111_320


def square_farm(cells: int, folder: Path) -> Path:
    """Write a farm of one square patch of tomatoes, with cells of one foot; return its file."""
    south, west = SOUTH_WEST_DEG
    north = south + math.sqrt(cells) * FOOT_DEG
    east = west + math.sqrt(cells) * FOOT_DEG / math.cos(math.radians(south))
    ring = [[west, south], [east, south], [east, north], [west, north], [west, south]]
    patch = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "properties": {"crop": "tomato"}, "geometry": patch}
    path = folder / f"{cells}.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}), encoding="utf-8")
    return path


def cost_of(options: tuple[str, ...], folder: Path) -> tuple[float, float]:
    """Fly in a process of its own; return processor time (s) with its children, and peak memory (MB)."""
    options = tuple(
        str(square_farm(int(option), folder)) if option.isdigit() and last == "--farm" else option
        for last, option in zip(("", *options), options, strict=False)
    )
    with (folder / "out.json").open("wb") as out:
        pid = os.posix_spawn(
            sys.executable,
            [sys.executable, "-m", "wbf_mission", *FLY, *options],
            os.environ,
            file_actions=[(os.POSIX_SPAWN_DUP2, out.fileno(), 1)],
        )
        _, status, usage = os.wait4(pid, 0)
    if status:
        sys.exit(f"failed: wbf-mission fly {' '.join(options)}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0


def slope(costs: dict[int, tuple[float, float]], part: int) -> float:
    """Return the exponent of a cost between the last two sizes."""
    (before, low), (last, high) = [(size, costs[size][part]) for size in sorted(costs)[-2:]]
    return math.log(high / low) / math.log(last / before)


def draw(grown: dict[str, dict[int, tuple[float, float]]], path: Path) -> None:
    """Draw both costs over each quantity as multiples of its smallest size, on logarithmic axes."""
    from matplotlib import pyplot

    figure, both = pyplot.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for part, (axes, title) in enumerate(zip(both, ("processor time, s", "peak memory, MB"), strict=True)):
        for name, costs in grown.items():
            sizes = sorted(costs)
            label = f"{name}: exponent {slope(costs, part):.2f}"
            axes.loglog(
                [size / sizes[0] for size in sizes], [costs[size][part] for size in sizes], "o-", label=label
            )
        axes.set(xlabel="size / smallest size", title=title)
        axes.grid(which="both", alpha=0.3)
        axes.legend(fontsize="small")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Print the tables."""
    parser = options_of(__doc__)
    parser.add_argument("part", choices=("growth", "beside"))
    parser.add_argument("--picture", type=Path, help="file of the picture")
    options = parser.parse_args()
    with scratch_folder() as folder:
        if options.part == "growth":
            grown = {}
            for name, sizes in SERIES.items():
                grown[name] = costs = {size: cost_of(fly, folder) for size, fly in sizes.items()}
                cells = {f"{size:,}": (f"{cpu_s:.1f}", f"{mb:.0f}") for size, (cpu_s, mb) in costs.items()}
                cells["exponent"] = f"{slope(costs, 0):.2f}", f"{slope(costs, 1):.2f}"
                print_table(
                    [{name: size, "CPU, s": cpu, "peak, MB": mb} for size, (cpu, mb) in cells.items()], name
                )
            if options.picture:
                draw(grown, options.picture)
            return
        theirs = [f"benchmarks/peers.py:{name}" for name in THEIRS] if FOLDER in os.environ else []
        rows, base_s = [], 0.0
        for name in (*OURS, *theirs):
            kind = "--policy" if name in OURS[2:] or "PyPolo" in name else "--planner"
            cpu_s, mb = cost_of(("--farm", "miniberry-30", "--vehicle", "ideal", kind, name), folder)
            base_s = base_s or cpu_s
            rows.append(
                {
                    "planner": name.rpartition("py:")[2],
                    "planning and deciding, CPU s": f"{cpu_s - base_s:.1f}",
                    "whole process, CPU s": f"{cpu_s:.1f}",
                    "peak, MB": f"{mb:.0f}",
                }
            )
        print_table(rows)


if __name__ == "__main__":
    main()
