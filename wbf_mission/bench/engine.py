"""Flies the runs of a benchmark, in this process or in several."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool

from geo.interrupts import ignore_interrupts
from geo.workers import CallsAhead
from wbf_mission.bench.row import BenchRow, failed_row, fly_run
from wbf_mission.bench.spec import BenchRun

__all__ = ["fly_all"]


def fly_all(runs: Sequence[BenchRun], *, jobs: int = 1) -> Iterator[BenchRow]:
    """Yield the row of each run as it ends, the same whatever the number of processes but for the costs.

    Parameters
    ----------
    runs : sequence of BenchRun
    jobs : int
        Processes at once; -1: one per core.

    Raises
    ------
    KeyboardInterrupt
        At Ctrl-C; the processes end.
    """
    from joblib import effective_n_jobs

    jobs = effective_n_jobs(jobs)
    if jobs == 1:
        yield from map(fly_run, runs)
        return
    remaining = list(runs)
    while remaining:
        done: set[str] = set()
        try:
            for row in _in_processes(remaining, jobs):
                done.add(row.key)
                yield row
        except BrokenProcessPool:
            remaining = [one for one in remaining if one.key not in done]
            # A process was killed, as by a lack of memory. It flew one of the first that are open: each of
            # them is flown by itself.
            for one in remaining[:jobs]:
                yield _alone(one)
            remaining = remaining[jobs:]
        else:
            return


def _in_processes(runs: Sequence[BenchRun], jobs: int) -> Iterator[BenchRow]:
    from joblib import Parallel, delayed

    parallel = Parallel(
        n_jobs=jobs, return_as="generator_unordered", batch_size=1, initializer=ignore_interrupts
    )
    yield from parallel(delayed(fly_run)(one) for one in runs)


def _alone(run: BenchRun) -> BenchRow:
    calls = CallsAhead(fly_run, [(run,)])
    try:
        return calls.result(0)
    except BrokenProcessPool:
        return failed_row(run, "the process that flew it was killed; is there enough memory for it?")
    finally:
        calls.close()
