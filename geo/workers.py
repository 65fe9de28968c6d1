"""Calls in processes of their own that can be given up at any time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any, Generic, TypeVar

from geo.interrupts import ignore_interrupts, interrupts_held

__all__ = ["CallsAhead"]

_T = TypeVar("_T")
_POLL_S = 0.01
_HAND_OVER_S = 5.0


class CallsAhead(Generic[_T]):
    """Makes calls in as many processes as there are cores, each before its result is asked for.

    The processes leave Ctrl-C to this one, and do not run the caller's script again, as those of the standard
    library do.

    Parameters
    ----------
    function : callable
        That can be pickled by cloudpickle.
    arguments : sequence of tuple
        Of each call.

    Raises
    ------
    KeyboardInterrupt
        If it came while the processes started; they have ended.
    """

    def __init__(self, function: Callable[..., _T], arguments: Sequence[tuple[Any, ...]]) -> None:
        from joblib import cpu_count
        from joblib.externals.loky import ProcessPoolExecutor

        workers = max(1, min(len(arguments), cpu_count()))
        self._pool = ProcessPoolExecutor(workers, initializer=ignore_interrupts)
        self._function = function
        self._arguments = list(arguments)
        self._futures: dict[int, Future[_T]] = {}
        self._submitted = 0
        # As many as the processes take over: closed with more, loky ends with a traceback.
        self._most = 2 * workers
        try:
            with interrupts_held():
                self._submit()
        except KeyboardInterrupt:
            self.close()
            raise

    def result(self, number: int) -> _T:
        """Wait for a call and return what it returned; raises what it raised.

        Parameters
        ----------
        number : int
            Of the call, from 0. Results are given once, in their order; what is left out is dropped.

        Raises
        ------
        concurrent.futures.process.BrokenProcessPool
            If a process was killed: nothing more is to be had.
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
        until_s = time.monotonic() + _HAND_OVER_S
        while any(_waits(one) for one in self._futures.values()) and time.monotonic() < until_s:
            time.sleep(_POLL_S)
        self._pool.shutdown(wait=True, kill_workers=True)
        self._futures = {}

    def _submit(self) -> None:
        """Hand over as many calls as the processes take."""
        ahead = sum(not one.done() for one in self._futures.values())
        for arguments in self._arguments[self._submitted :][: self._most - ahead]:
            self._futures[self._submitted] = self._pool.submit(self._function, *arguments)
            self._submitted += 1


def _waits(future: Future[Any]) -> bool:
    """Return whether a call has not been handed to the processes yet."""
    return not (future.running() or future.done())
