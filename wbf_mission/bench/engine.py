"""Flies the runs of a benchmark: in this process, in several, or on many machines."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from typing import Any, Protocol

from geo.workers import CallsAhead, Processes
from wbf_mission.bench.cluster import Cluster
from wbf_mission.bench.row import BenchRow, failed_row, fly_run
from wbf_mission.bench.spec import BenchRun

__all__ = ["fly_all"]


class _Workers(Protocol):
    """Who flies runs."""

    @property
    def most(self) -> int:
        """How many runs it is given at a time."""

    def submit(self, function: Callable[..., BenchRow], /, *arguments: Any) -> Future[BenchRow]:
        """Have a run flown."""


def fly_all(runs: Sequence[BenchRun], *, jobs: int = 1, dask: str | None = None) -> Iterator[BenchRow]:
    """Yield the row of each run as it ends, the same whoever flies them but for the costs.

    Parameters
    ----------
    runs : sequence of BenchRun
    jobs : int
        Processes at once; -1: one per core.
    dask : str, optional
        The address of a Dask scheduler whose workers fly them, such as ``tcp://10.0.0.1:8786``, or ``local``
        for one of this machine with `jobs` workers.

    Raises
    ------
    ClusterError
        If there is no such scheduler, its workers are not fit, or it is lost.
    KeyboardInterrupt
        At Ctrl-C; what is open is given up.
    """
    from joblib import effective_n_jobs

    jobs = effective_n_jobs(jobs)
    if dask is not None:
        with closing(Cluster(dask, jobs)) as cluster:
            for run, future in _ended(cluster, runs):
                row = cluster.result(future)
                yield failed_row(run, _KILLED) if row is None else row
    elif jobs == 1:
        yield from map(fly_run, runs)
    else:
        yield from _in_processes(runs, jobs)


_KILLED = "the process that flew it was killed; is there enough memory for it?"


def _ended(workers: _Workers, runs: Sequence[BenchRun]) -> Iterator[tuple[BenchRun, Future[BenchRow]]]:
    """Have runs flown, and yield them as they end."""
    waiting = iter(runs)
    flying: dict[Future[BenchRow], BenchRun] = {}
    while True:
        for run in waiting:
            flying[workers.submit(fly_run, run)] = run
            if len(flying) >= workers.most:
                break
        if not flying:
            return
        for future in wait(flying, return_when=FIRST_COMPLETED).done:
            yield flying.pop(future), future


def _in_processes(runs: Sequence[BenchRun], jobs: int) -> Iterator[BenchRow]:
    remaining = list(runs)
    while remaining:
        done: set[str] = set()
        try:
            with closing(Processes(jobs)) as processes:
                for run, future in _ended(processes, remaining):
                    row = future.result()
                    done.add(run.key)
                    yield row
        except BrokenProcessPool:
            remaining = [one for one in remaining if one.key not in done]
            # A process was killed, as by a lack of memory. It flew one of the first that are open: each of
            # them is flown by itself.
            yield from map(_alone, remaining[:jobs])
            remaining = remaining[jobs:]
        else:
            return


def _alone(run: BenchRun) -> BenchRow:
    with closing(CallsAhead(fly_run, [(run,)])) as calls:
        try:
            return calls.result(0)
        except BrokenProcessPool:
            return failed_row(run, _KILLED)
