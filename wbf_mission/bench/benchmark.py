"""Run a benchmark: fly the missing runs, store their rows, return all rows."""

from __future__ import annotations

import contextlib
import warnings
from pathlib import Path

from geo.processes import interrupts_noted
from wbf_mission.bench.engine import fly_all
from wbf_mission.bench.requests import keep_asked
from wbf_mission.bench.rows import BenchRow, BenchStore, build_of
from wbf_mission.bench.spec import BenchSpec
from wbf_mission.progress import Progress, silent


class BenchmarkInterrupted(KeyboardInterrupt):
    """Raised when Ctrl-C interrupts a benchmark.

    Parameters
    ----------
    rows : list of BenchRow
        Rows of the runs that ended before the interrupt.
    total : int
        Number of runs of the benchmark.
    """

    def __init__(self, rows: list[BenchRow], total: int) -> None:
        super().__init__(f"interrupted after {len(rows)} of {total} runs")
        self.rows = rows
        self.total = total


def benchmark(
    spec: BenchSpec,
    *,
    out: str | Path | None = None,
    jobs: int = 1,
    dask: str | None = None,
    retry: bool = False,
    command: str = "",
    progress: Progress | None = None,
) -> list[BenchRow]:
    """Fly every planner with every estimator in every scenario, on the environments of all seeds.

    A seed gives the same environment to all planners and estimators, so rows can be compared in pairs. The
    row of a failed run contains the cause.

    Parameters
    ----------
    out : path-like, optional
        Folder to which each row is written when its run ends. Runs with a row in the folder are not repeated.
    jobs : int
        Number of parallel processes; -1: one per core. In the rows, only the run times depend on `jobs`.
    dask : str, optional
        Address of the Dask scheduler that distributes the runs; ``local`` starts a scheduler on this machine
        with `jobs` workers.
    retry : bool
        Repeat failed runs.
    command : str
        Command line of the benchmark, stored in the folder with the specification.
    progress : callable, optional
        ``progress(what, done, total)``.

    Returns
    -------
    list of BenchRow
        Rows of all runs of the specification, ordered by scenario, planner, estimator and seed.

    Raises
    ------
    ResultError
        If the folder holds other files, or another process writes to the folder.
    ClusterError
        If Dask's scheduler or workers cannot be used, or are lost.
    OSError
        If the folder cannot be written.
    BenchmarkInterrupted
        At Ctrl-C, with the rows of the finished runs.
    """
    report = progress or silent
    runs = list(spec.runs())
    wanted = {run.key for run in runs}
    rows: dict[str, BenchRow] = {}
    interrupted = False
    with contextlib.ExitStack() as stack:
        store = None if out is None else stack.enter_context(BenchStore(Path(out)))
        if out is not None:
            keep_asked(Path(out), spec, command)
        done = {} if store is None else store.done
        missing = [run for run in runs if run.key not in done or (retry and not done[run.key])]
        kept = len(runs) - len(missing)
        try:
            with interrupts_noted(at_once=True) as answer_interrupt:
                for number, row in enumerate(fly_all(missing, jobs=jobs, dask=dask), kept + 1):
                    if store is None:
                        rows[row.key] = row
                    else:
                        store.add(row)
                    report("flying", number, len(runs))
                    answer_interrupt()
        except KeyboardInterrupt:
            interrupted = True
    if store is None:
        found = [rows[run.key] for run in runs if run.key in rows]
    else:
        found = [row for row in store.rows if row.key in wanted]
        names = {(run.scenario_id, run.planner, run.estimator, run.seed) for run in runs}
        others = [
            row
            for row in store.rows
            if row.key not in wanted and (row.scenario, row.planner, row.estimator, row.seed) in names
        ]
        if others:
            builds = "; ".join(dict.fromkeys(map(build_of, others)))
            msg = (
                f"{out}: {len(others)} rows with the names of these runs are kept, but do not count here:"
                f" they were flown with other behaviour numbers, code, parameters or files ({builds})"
            )
            warnings.warn(msg, stacklevel=2)
    if interrupted:
        raise BenchmarkInterrupted(found, len(runs))
    return found
