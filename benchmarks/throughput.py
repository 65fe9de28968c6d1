"""Measure processor time per benchmark run, overhead of the benchmark engine, and memory growth.

The runs are on Miniberry-30 with 360 steps, scored at 36 times: the paper's four planners with two estimators
over many seeds. `wbf_mission.benchmark` flies them into a folder, the same as ``wbf-mission bench run``. The
reference is a plain loop with `wbf_mission.fly` over some seeds in this process; the scores must be equal.

    python benchmarks/throughput.py [--seeds 125] [--plain 5] [--jobs 1]

The output has the processor time per run, including child processes and their start-up, and the overhead
beyond the runs themselves (limit: 5 %). It also has the ratio to the plain loop, the peak memory of this
process after a quarter of the runs and at the end, and the time of 10,000 runs on two idle cores (limit: 15
minutes). The exit code is 1 if a limit is exceeded.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Sequence

from common import options_of, peak_mb, scratch_folder

from wbf_mission.bench.benchmark import benchmark
from wbf_mission.bench.rows import BenchRow
from wbf_mission.bench.spec import BenchSpec
from wbf_mission.flight import fly

SCENARIO = "WBF/Miniberry-30-Sweep-v1"
OVERHEAD_BAR, SWEEP_BAR_S, SWEEP_RUNS, CORES = 0.05, 900.0, 10_000, 2


def spent_s() -> float:
    """Return the processor time of this process and of its ended child processes (s)."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in usages)


def swept(spec: BenchSpec, jobs: int) -> tuple[Sequence[BenchRow], float, dict[float, float]]:
    """Fly the runs; return the rows, the processor time (s), and the peak memory by completed share."""
    memory: dict[float, float] = {}

    def note(_what: str, done: float, total: float) -> None:
        if done in (total // 4, total):
            memory[done / total] = peak_mb()

    with scratch_folder() as folder:
        begin = spent_s()
        rows = benchmark(spec, out=folder, jobs=jobs, progress=note)
        return rows, spent_s() - begin, memory


def plain_s(spec: BenchSpec, rows: Sequence[BenchRow]) -> float:
    """Fly the runs in a plain loop; return the processor time per run (s)."""
    scores = {row.key: row.score for row in rows}
    begin = time.process_time()
    for run in spec.runs():
        if fly(run.scenario).score != scores[run.key]:
            sys.exit(f"{run.planner}, {run.estimator}, seed {run.seed}: the score differs from that of `fly`")
    return (time.process_time() - begin) / len(spec)


def main() -> int:
    """Run the benchmark."""
    parser = options_of(__doc__)
    parser.add_argument("--seeds", type=int, default=125)
    parser.add_argument("--plain", type=int, default=5, help="seeds of the plain loop")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    # Imports and compilation happen once per process and are not part of a run's cost.
    swept(BenchSpec.of([SCENARIO], seeds=[options.seeds]), 1)
    rows, cpu_s, memory = swept(BenchSpec.of([SCENARIO], seeds=options.seeds), options.jobs)
    failed = [row for row in rows if row.error is not None]
    if failed:
        sys.exit(f"{len(failed)} runs failed: {failed[0].error}")
    own_s = sum(row.cpu_time_s for row in rows)
    each_s, overhead = cpu_s / len(rows), 1.0 - own_s / cpu_s
    sweep_s = SWEEP_RUNS * each_s / CORES
    print(f"{len(rows)} runs, {options.jobs} at a time: {each_s:.3f} s CPU a run, overhead {overhead:.1%}")
    print(f"most memory: {', '.join(f'{mb:.0f} MB at {part:.0%}' for part, mb in memory.items())}")
    print(f"{SWEEP_RUNS} runs on {CORES} free cores: {sweep_s / 60:.1f} min (bar {SWEEP_BAR_S / 60:.0f})")
    if options.plain:
        alone_s = plain_s(BenchSpec.of([SCENARIO], seeds=min(options.plain, options.seeds)), rows)
        print(f"plain loop of fly: {alone_s:.3f} s CPU a run, {alone_s / each_s:.1f} times as much")
    return 0 if overhead <= OVERHEAD_BAR and sweep_s <= SWEEP_BAR_S else 1


if __name__ == "__main__":
    sys.exit(main())
