"""Flies the runs of a benchmark: in this process, in several, or on many machines."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from typing import Any, Protocol, TypeAlias, cast

from geo.workers import CallsAhead, Processes
from wbf_mission.bench.cluster import Cluster, ClusterError
from wbf_mission.bench.meaning import built_in_digest, is_own
from wbf_mission.bench.row import BenchRow, failed_row, fly_run
from wbf_mission.bench.spec import BenchRun

__all__ = ["fly_all"]


_Flown: TypeAlias = BenchRow | str


class _Workers(Protocol):
    """Who flies runs."""

    @property
    def most(self) -> int:
        """How many runs it is given at a time."""

    def submit(self, function: Callable[..., _Flown], /, *arguments: Any) -> Future[_Flown]:
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
                yield _row(run, cluster.result(future) or _KILLED)
    elif jobs == 1:
        yield from map(fly_run, runs)
    else:
        yield from _in_processes(runs, jobs)


_KILLED = "the process that flew it was killed; is there enough memory for it?"


def _ended(workers: _Workers, runs: Sequence[BenchRun]) -> Iterator[tuple[BenchRun, Future[_Flown]]]:
    """Have runs flown, and yield them as they end."""
    waiting = iter(runs)
    flying: dict[Future[_Flown], BenchRun] = {}
    while True:
        for run in waiting:
            flying[_submitted(workers, run)] = run
            if len(flying) >= workers.most:
                break
        if not flying:
            return
        for future in wait(flying, return_when=FIRST_COMPLETED).done:
            yield flying.pop(future), future


def _submitted(workers: _Workers, run: BenchRun) -> Future[_Flown]:
    """Have a run flown elsewhere; the result is its row, or why it has none."""
    try:
        sent = _packed(run)
    except Exception as error:  # a planner, policy or estimator of somebody's
        unsent: Future[_Flown] = Future()
        unsent.set_result(f"{_UNSENT}: {type(error).__name__}: {error}")
        return unsent
    return workers.submit(_fly_packed, *sent)


_UNSENT = "a planner, policy or estimator cannot be sent to another process"


def _row(run: BenchRun, given: _Flown) -> BenchRow:
    return failed_row(run, given) if isinstance(given, str) else given


def _packed(run: BenchRun) -> tuple[bytes, str]:
    """Return what `_fly_packed` takes: code that the other process cannot import goes with it.

    Dask itself would send classes by their names.
    """
    import cloudpickle

    known = cloudpickle.list_registry_pickle_by_value()
    own = [
        module
        for name, module in tuple(sys.modules.items())
        if name not in known and name != "__main__" and getattr(module, "__file__", None) and is_own(name)
    ]
    for module in own:
        cloudpickle.register_pickle_by_value(module)
    try:
        return cloudpickle.dumps((fly_run, run)), built_in_digest()
    finally:
        for module in own:
            cloudpickle.unregister_pickle_by_value(module)


def _fly_packed(sent: bytes, code: str) -> _Flown:
    """Fly a run that another process of the same user packed; return its row, or why it has none.

    Raises
    ------
    WbfMissionError
        If this process has other code than that one: its row would be another.
    """
    if code != built_in_digest():
        msg = "it has another wbf-mission; install the same version there"
        raise ClusterError(msg)
    try:
        function, run = pickle.loads(sent)  # noqa: S301 (of this command, over its own pool or scheduler)
    except Exception as error:
        return f"{_UNSENT}: {type(error).__name__}: {error}"
    return cast("BenchRow", function(run))


def _in_processes(runs: Sequence[BenchRun], jobs: int) -> Iterator[BenchRow]:
    remaining = list(runs)
    while remaining:
        done: set[str] = set()
        try:
            with closing(Processes(jobs)) as processes:
                for run, future in _ended(processes, remaining):
                    row = _row(run, future.result())
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
    with closing(CallsAhead(_fly_packed, [_packed(run)])) as calls:
        try:
            return _row(run, calls.result(0))
        except BrokenProcessPool:
            return failed_row(run, _KILLED)
