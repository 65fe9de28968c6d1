"""Calls in processes of their own that can be given up at any time."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any, Generic, TypeVar

from geo.interrupts import ignore_interrupts, interrupts_held

_T = TypeVar("_T")
_POLL_S = 0.01
_HAND_OVER_S = 5.0
_LOOK_S = 2.0


class Processes:
    """Processes of our own that make calls.

    They leave Ctrl-C to this one, and do not run the caller's script again, as those of the standard library
    do. When this one is killed they end, too, whatever they do.

    As many calls as `most` may be open at a time; closed with more, loky ends with a traceback.
    """

    def __init__(self, workers: int) -> None:
        from joblib.externals.loky import ProcessPoolExecutor

        self.most = 2 * workers
        self._pool = ProcessPoolExecutor(workers, initializer=_begin, initargs=(os.getpid(),))
        self._open: set[Future[Any]] = set()

    def submit(self, function: Callable[..., _T], *arguments: Any) -> Future[_T]:
        """Have a call made; what is called is pickled by cloudpickle.

        BrokenProcessPool if a process was killed before.
        """
        with interrupts_held():
            future: Future[_T] = self._pool.submit(function, *arguments)
            self._open.add(future)
        future.add_done_callback(self._open.discard)
        return future

    def close(self) -> None:
        """End the processes, whatever they do."""
        until_s = time.monotonic() + _HAND_OVER_S
        while any(map(_waits, tuple(self._open))) and time.monotonic() < until_s:
            time.sleep(_POLL_S)
        self._pool.shutdown(wait=True, kill_workers=True)


class CallsAhead(Generic[_T]):
    """Makes calls in processes, by default one for each core, each call before its result is asked for.

    They are made as `Processes.submit` says. KeyboardInterrupt if it came while the processes started; they
    have ended.
    """

    def __init__(
        self, function: Callable[..., _T], arguments: Sequence[tuple[Any, ...]], processes: int | None = None
    ) -> None:
        from joblib import cpu_count

        self._processes = Processes(max(1, min(len(arguments), processes or cpu_count())))
        self._function = function
        self._arguments = list(arguments)
        self._futures: dict[int, Future[_T]] = {}
        self._submitted = 0
        try:
            self._submit()
        except KeyboardInterrupt:
            self.close()
            raise

    def result(self, number: int) -> _T:
        """Wait for a call and return what it returned; raises what it raised.

        Raises what the call raised, and BrokenProcessPool if a process was killed. Results are given once, in
        their order, from 0; what is left out is dropped.
        """
        while True:
            for skipped in [one for one in self._futures if one < number]:
                self._futures.pop(skipped).exception()
            if number < self._submitted:
                break
            self._submit()
        found = self._futures.pop(number).result()
        self._submit()
        return found

    def close(self) -> None:
        """End the processes, whatever they do."""
        self._processes.close()
        self._futures = {}

    def _submit(self) -> None:
        """Hand over as many calls as the processes take."""
        ahead = sum(not one.done() for one in self._futures.values())
        for arguments in self._arguments[self._submitted :][: self._processes.most - ahead]:
            self._futures[self._submitted] = self._processes.submit(self._function, *arguments)
            self._submitted += 1


def _begin(parent: int) -> None:
    """What a process of ours does first."""
    ignore_interrupts()
    threading.Thread(target=_end_with, args=(parent,), name="end with the parent", daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process soon after its parent; a killed one leaves its children to another parent."""
    while os.getppid() == parent:
        time.sleep(_LOOK_S)
    os._exit(1)


def _waits(future: Future[Any]) -> bool:
    """Return whether a call has not been handed to the processes yet."""
    return not (future.running() or future.done())
