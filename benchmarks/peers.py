"""Score the planners of sgptools and PyPolo beside ours: same farms, budgets, observations, environments.

They take part by the contract of planners and policies of one's own (``benchmarks/peer_planners.py``), each
in a virtual environment that this script makes: sgptools brings TensorFlow, PyPolo an older NumPy and
PyTorch, 1 to 2 GB each. What they answered is kept there, so that a plan or a flight is decided once for all
estimators. Seconds are those that planning and all decisions of a flight take on one core, without the start
of a library; those of ours are measured on ``--timed`` environments.

    python benchmarks/peers.py --folder FOLDER [--scenarios WBF/Miniberry-30-v1] [--estimators gp,epidemic]
        [--seeds 10] [--out DIR] [--ours spiral,greedy] [--peers sgptools:method=CMA,PyPolo]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
import tomllib
import venv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from mission.planners.budget import parse_budget
from mission.policies.decision import Decision
from mission.policies.observation import PolicyObservation
from mission.policies.policy import Policy, Triggers, make_policy
from wbf_mission import fly
from wbf_mission.bench.benchmark import benchmark
from wbf_mission.bench.intervals import Interval, mean_interval, verdict
from wbf_mission.bench.rows import BenchRow
from wbf_mission.bench.spec import BenchSpec
from wbf_mission.bench.standings import compare, standings
from wbf_mission.own_code import own_choice
from wbf_mission.planning import plan
from wbf_mission.scenario import Choice, load_scenario, scenario_with
from wbf_mission.scenario.choice import choose, names_of, split_choices

HERE = Path(__file__).resolve().parent
PACKAGES = {
    "sgptools": ("sgptools==2.0.7",),
    # PyPolo calls what NumPy 2 has no more; later versions of bezier need NumPy 2.
    "pypolo": ("pypolo==0.0.3", "numpy<2", "bezier<2024.6", "torch==2.13.0"),
}
TUNED = HERE.parent / "missions" / "bench" / "tuned.toml"
"""The fixed planners that `benchmarks/tune_baselines.py` chose."""
OURS = "lawnmower,adaptive-lawnmower,spiral,random-waypoint,greedy,rolling-horizon,refining-lawnmower"
PEERS = ",".join(
    [
        "sgptools:method=ContinuousSGP,max_steps=5000",
        "sgptools:method=CMA",
        "sgptools:method=GreedySGP",
        "sgptools:method=HexCover",
        "PyPolo:kernel=RBF",
        "PyPolo:kernel=AK",
    ]
)


class Clocked:
    """A policy of which the seconds of its decisions are counted, of this process alone."""

    def __init__(self, policy: Policy) -> None:
        self._policy, self.spent_s = policy, 0.0

    @property
    def triggers(self) -> Triggers:
        """Those of the policy."""
        return self._policy.triggers

    def start(self) -> None:
        """Begin a flight."""
        self._policy.start()

    def decide(self, observation: PolicyObservation) -> Decision:
        """Decide as the policy does."""
        began_s = time.process_time()
        try:
            return self._policy.decide(observation)
        finally:
            self.spent_s += time.process_time() - began_s


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


def own_seconds(scenario: str, choice: Choice, seeds: Sequence[int]) -> list[float]:
    """Return the seconds of planning and deciding of one of ours, a flight each."""
    base, found = load_scenario(scenario), []
    for seed in seeds:
        if choice.name in names_of("planner"):
            began_s = time.process_time()
            plan(scenario_with(base, {"planner": choice, "seed": seed}))
            found.append(time.process_time() - began_s)
        else:
            clocked = Clocked(make_policy(choice.name, **choice.params))
            given = {"policy": clocked, "estimator": choose("gp", "estimator"), "seed": seed}
            fly(scenario_with(base, given))
            found.append(clocked.spent_s)
    return found


def peer_seconds(folder: Path, scenario: str, choice: Choice) -> list[float]:
    """Return the same of a peer, from what its answers cost: of sgptools a plan each, of PyPolo a flight."""
    limit = parse_budget(load_scenario(scenario).mission.budget or "")[0]
    found: dict[str, float] = {}
    times = folder / "answers" / "times.jsonl"
    for line in times.read_text(encoding="utf-8").splitlines() if times.exists() else ():
        told = json.loads(line)
        first = told["first"]
        if first["limit"] == limit and all(first.get(key) == value for key, value in choice.params.items()):
            key = json.dumps(first)
            found[key] = found.get(key, 0.0) + told["cpu_s"]
    return list(found.values())


def interval_text(found: Interval, digits: int = 4, sign: str = "") -> str:
    """Return a mean with its interval, without one where there is none."""
    one = f"{sign}.{digits}f"
    if np.isnan(found.low):
        return f"{found.mean:{one}}"
    return f"{found.mean:{one}} [{found.low:{one}}, {found.high:{one}}]"


def show(rows: Sequence[BenchRow], peers: Sequence[str], seconds: dict[tuple[str, str], list[float]]) -> None:
    """Print the standings, and what tells the best of ours from each peer and from the best fixed path."""
    console = Console(width=170)
    for scenario, estimator in sorted({(row.scenario, row.estimator) for row in rows}):
        some = [row for row in rows if (row.scenario, row.estimator) == (scenario, estimator)]
        found = standings(some)
        table = Table(title=f"{scenario}, {estimator}: score with its interval of 95 %; 0 is perfect")
        for name in ("planner", "run", "end", "planning, s", "runs", "failed"):
            table.add_column(name, justify="left" if name == "planner" else "right", no_wrap=True)
        for one in found:
            taken = mean_interval(np.array(seconds.get((scenario, one.planner), [])))
            scores = [interval_text(v) for v in (one.score, one.final_score)]
            table.add_row(
                one.planner, *scores, interval_text(taken, 2), str(one.environments), str(one.failed)
            )
        console.print(table)
        ours = [one for one in found if one.planner not in peers and one.environments]
        if not ours:
            continue
        best = max(ours, key=lambda one: one.score.mean).planner
        others = [one.planner for one in found if one.planner != best]
        table = Table(title=f"{best} less each of them: above 0 is better")
        for name in ("planner", "run", "", "end", " "):
            table.add_column(name, no_wrap=True)
        for pair in compare(some, best, others):
            cells = [
                text
                for v in (pair.score, pair.final_score)
                for text in (interval_text(v, 4, "+"), verdict(v))
            ]
            table.add_row(pair.against, *cells)
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
    parser.add_argument("--estimators", default="gp,epidemic")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--out", type=Path, help="a folder that keeps what was flown")
    parser.add_argument("--ours", default=OURS)
    parser.add_argument("--peers", default=PEERS)
    parser.add_argument("--timed", type=int, default=5, help="environments on which ours are timed")
    given = parser.parse_args()
    prepare(given.folder)
    peers = [peer(one) for one in split_choices(given.peers, "planner")]
    tuned = tomllib.loads(TUNED.read_text(encoding="utf-8"))["planners"]
    names = dict.fromkeys([*split_choices(given.ours, "planner"), *tuned])
    ours = [choose(one, "planner") for one in names]
    scenarios = given.scenarios.split(",")
    spec = BenchSpec.of(
        scenarios,
        [*ours, *peers],
        split_choices(given.estimators, "estimator"),
        list(range(given.first, given.first + given.seeds)),
    )
    rows = benchmark(
        spec, out=given.out, progress=lambda _, done, total: print(f"\r{done} of {total}", end="", flush=True)
    )
    print()
    timed = range(given.first, given.first + given.timed)
    seconds = {(name, str(one)): own_seconds(name, one, timed) for name in scenarios for one in ours}
    seconds |= {
        (name, str(one)): peer_seconds(given.folder, name, one) for name in scenarios for one in peers
    }
    show(rows, [str(one) for one in peers], seconds)


if __name__ == "__main__":
    main()
