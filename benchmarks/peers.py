"""Score the planners of sgptools and PyPolo beside ours: same farms, budgets, observations, environments.

They take part by the contract of planners and policies of one's own (``benchmarks/peer_planners.py``), each
in a virtual environment that this script makes: sgptools brings TensorFlow, PyPolo an older NumPy and
PyTorch, 1 to 2 GB each. Everything flies one after the other, so that the seconds of planning can be
compared; those of a library's start are not counted.

    python benchmarks/peers.py --folder FOLDER [--scenarios WBF/Miniberry-30-v1] [--estimators gp]
        [--seeds 10] [--out DIR] [--ours spiral,greedy] [--peers sgptools:method=CMA,PyPolo]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import venv
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from wbf_mission.bench.benchmark import benchmark
from wbf_mission.bench.intervals import verdict
from wbf_mission.bench.rows import BenchRow
from wbf_mission.bench.spec import BenchSpec
from wbf_mission.bench.standings import compare, standings
from wbf_mission.own_code import own_choice
from wbf_mission.scenario import Choice
from wbf_mission.scenario.choice import choose, split_choices

HERE = Path(__file__).resolve().parent
PACKAGES = {
    "sgptools": ("sgptools==2.0.7",),
    # PyPolo calls what NumPy 2 has no more; later versions of bezier need NumPy 2.
    "pypolo": ("pypolo==0.0.3", "numpy<2", "bezier<2024.6", "torch==2.13.0"),
}
OURS = "lawnmower,adaptive-lawnmower,spiral,random-waypoint,greedy,refining-lawnmower"
PEERS = ",".join(
    [
        # The reach of each is the best of 0.3, 0.6 and 1.2 m on Miniberry-10, seeds 100 to 107.
        "sgptools:method=ContinuousSGP,reach_m=0.3",
        "sgptools:method=CMA,reach_m=0.3",
        "sgptools:method=GreedySGP,reach_m=0.6",
        "sgptools:method=HexCover,reach_m=1.2",
        "PyPolo:kernel=RBF",
        "PyPolo:kernel=AK",
    ]
)


def prepare(folder: Path) -> None:
    """Make the virtual environments that are missing, and tell the planners where they are."""
    for name, packages in PACKAGES.items():
        if not (folder / name / "made").exists():
            print(f"making {folder / name} with {', '.join(packages)}")
            venv.create(folder / name, with_pip=True, clear=True)
            python = folder / name / "bin" / "python"
            subprocess.run([python, "-m", "pip", "install", "--quiet", *packages], check=True)
            (folder / name / "made").touch()
    os.environ["WBF_MISSION_PEERS"] = str(folder.resolve())
    os.environ["WBF_MISSION_PEERS_WORKERS"] = str(HERE / "peer_workers")


def peer(text: str) -> Choice:
    """Return a planner of ``peer_planners.py``, its library started."""
    what = "planner" if text.startswith("sgptools") else "policy"
    choice = own_choice(f"{HERE / 'peer_planners.py'}:{text}", what)
    assert choice is not None
    module = sys.modules[choice.made.__module__]
    module.worker("sgptools" if what == "planner" else "pypolo")
    return choice


def planning_s(rows: Sequence[BenchRow]) -> float:
    """Return the seconds of planning and deciding of a run; a plan that is asked for again costs nothing."""
    return max(
        (row.timings_s.get("plan", 0.0) + row.timings_s.get("decide", 0.0) for row in rows), default=0.0
    )


def show(rows: Sequence[BenchRow], peers: Sequence[str]) -> None:
    """Print the standings, and what tells the best of ours from each peer."""
    console = Console(width=140)
    for scenario, estimator in sorted({(row.scenario, row.estimator) for row in rows}):
        some = [row for row in rows if (row.scenario, row.estimator) == (scenario, estimator)]
        found = standings(some)
        table = Table(title=f"{scenario}, {estimator}: score with its interval of 95 %; 0 is perfect")
        for name in ("planner", "run", "end", "planning, s", "runs", "failed"):
            table.add_column(name, justify="left" if name == "planner" else "right", no_wrap=True)
        for one in found:
            seconds = planning_s(
                [row for row in rows if (row.scenario, row.planner) == (scenario, one.planner)]
            )
            scores = [f"{v.mean:.4f} [{v.low:.4f}, {v.high:.4f}]" for v in (one.score, one.final_score)]
            table.add_row(one.planner, *scores, f"{seconds:.2f}", str(one.environments), str(one.failed))
        console.print(table)
        ours = [one for one in found if one.planner not in peers and one.environments]
        if not ours:
            continue
        best = max(ours, key=lambda one: one.score.mean).planner
        table = Table(title=f"{best} less each of them: above 0 is better")
        for name in ("planner", "run", "", "end", " "):
            table.add_column(name, no_wrap=True)
        for one in compare(some, best, peers):
            cells = [
                text
                for v in (one.score, one.final_score)
                for text in (f"{v.mean:+.4f} [{v.low:+.4f}, {v.high:+.4f}]", verdict(v))
            ]
            table.add_row(one.against, *cells)
        console.print(table)
    for cause in sorted({f"{row.planner}: {row.error}" for row in rows if row.error}):
        console.print(f"failed: {cause}")


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--folder", type=Path, required=True, help="where the virtual environments are or go")
    parser.add_argument("--scenarios", default="WBF/Miniberry-30-v1")
    parser.add_argument("--estimators", default="gp")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--out", type=Path, help="a folder that keeps what was flown")
    parser.add_argument("--ours", default=OURS)
    parser.add_argument("--peers", default=PEERS)
    given = parser.parse_args()
    prepare(given.folder)
    peers = [peer(one) for one in split_choices(given.peers, "planner")]
    ours = [choose(one, "planner") for one in split_choices(given.ours, "planner")]
    spec = BenchSpec.of(
        given.scenarios.split(","),
        [*ours, *peers],
        split_choices(given.estimators, "estimator"),
        list(range(given.first, given.first + given.seeds)),
    )
    rows = benchmark(
        spec, out=given.out, progress=lambda _, done, total: print(f"\r{done} of {total}", end="", flush=True)
    )
    print()
    show(rows, [str(one) for one in peers])


if __name__ == "__main__":
    main()
