"""Worker processes that can be stopped at any time, and handling of the signals that interrupt a command.

Ctrl-C may arrive at any moment, and the terminal sends its signal to all processes of the command.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import resource_tracker
from types import FrameType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from concurrent.futures import Future

_T = TypeVar("_T")

# Windows has no SIGHUP.
INTERRUPTS = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else ()))
# GNU `timeout` sends two signals within a second. A user takes longer to press Ctrl-C a second time.
_REPEATED_S = 1.0
_POLL_S = 0.01
_HAND_OVER_S = 5.0  # loky hands a call to a process within milliseconds
_PARENT_POLL_S = 2.0


class Repeats:
    """Detects a repeated signal: GNU `timeout` sends one signal to the process and one to its group."""

    def __init__(self) -> None:
        self._counted_s = -math.inf

    def is_repeat(self) -> bool:
        """Return whether this signal repeats a signal that was counted less than a second ago."""
        now_s = time.monotonic()
        if now_s < self._counted_s + _REPEATED_S:
            return True
        self._counted_s = now_s
        return False


def ignore_interrupts() -> None:
    """Ignore interrupts in a worker process: all processes get them, and the parent handles them."""
    for number in INTERRUPTS:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def interrupts_noted(
    wake: Callable[[], None] | None = None, *, at_once: bool = False
) -> Iterator[Callable[[], None]]:
    """Defer the KeyboardInterrupt of the first signal to the end of the block.

    The yielded function raises a deferred interrupt before the end. A signal handler should not raise:
    compiled extensions drop some exceptions, for example in `hasattr` of the C API. The second signal raises
    immediately; signals within a second count as one. Outside the main thread nothing is deferred.

    Parameters
    ----------
    wake : callable, optional
        Called after a signal, to end a wait of the block.
    at_once : bool
        Whether the first signal raises immediately. The interrupt is deferred as well, in case the exception
        that was raised is lost.
    """
    noted: list[KeyboardInterrupt] = []
    before: dict[int, Callable[[int, FrameType | None], object]] = {}
    count = 0
    repeats = Repeats()

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal count
        if repeats.is_repeat():
            return
        count += 1
        try:
            before[number](number, frame)
        except KeyboardInterrupt as error:
            noted[:] = [error]
            if at_once or count > 1:
                raise
        if wake is not None:
            wake()

    def answer() -> None:
        if noted:
            raise noted.pop()

    if threading.current_thread() is threading.main_thread():
        before = {number: handler for number in INTERRUPTS if callable(handler := signal.getsignal(number))}
        for number in before:
            signal.signal(number, note)
    try:
        yield answer
    finally:
        for number, handler in before.items():
            # At a second signal the previous handler may have restored the system's default handler.
            if signal.getsignal(number) is note:
                signal.signal(number, handler)
    answer()


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Block signals while processes start; a new process inherits the signal mask.

    Without the mask a signal would end a new process before it calls `ignore_interrupts`. Signals to this
    process are handled after the block.
    """
    # Windows has no signal masks.
    if sys.platform == "win32" or not hasattr(signal, "pthread_sigmask"):
        with interrupts_noted():
            yield
        return
    # Starting the resource tracker unblocks the signals, so it is started before they are blocked.
    resource_tracker.ensure_running()
    # The mask applies only to this thread and processes that it starts; another thread may get the signal.
    with interrupts_noted():
        before = signal.pthread_sigmask(signal.SIG_BLOCK, INTERRUPTS)
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Processes:
    """A pool of worker processes.

    Workers ignore Ctrl-C and end soon after this process is killed. Unlike workers of the standard library,
    these workers do not run the caller's script again.

    Have no more than `most` calls pending: with more, loky prints a traceback when the pool is closed.
    """

    def __init__(self, workers: int) -> None:
        from joblib.externals.loky import ProcessPoolExecutor

        self.most = 2 * workers
        self._pool = ProcessPoolExecutor(workers, initializer=_begin, initargs=(os.getpid(),))
        self._open: set[Future[Any]] = set()

    def submit(self, function: Callable[..., _T], *arguments: Any) -> Future[_T]:
        """Submit a call, pickled by cloudpickle; raise BrokenProcessPool if a worker has been killed."""
        with interrupts_held():
            future: Future[_T] = self._pool.submit(function, *arguments)
            self._open.add(future)
        future.add_done_callback(self._open.discard)
        return future

    def close(self) -> None:
        """End the processes, including those with unfinished calls."""
        until_s = time.monotonic() + _HAND_OVER_S
        while any(not (future.running() or future.done()) for future in tuple(self._open)):
            if time.monotonic() >= until_s:
                break
            time.sleep(_POLL_S)
        self._pool.shutdown(wait=True, kill_workers=bool(self._open))


class CallsAhead(Generic[_T]):
    """Runs calls in worker processes (by default one per core) before the results are needed.

    If Ctrl-C arrives while the processes start, the constructor ends them and raises KeyboardInterrupt.
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
        """Wait for the call `number`, counted from 0, and return the call's result or raise its exception.

        Results can be fetched only once and in increasing order; results that are skipped are discarded.
        Raise BrokenProcessPool if a worker was killed.
        """
        while True:
            for skipped in [earlier for earlier in self._futures if earlier < number]:
                self._futures.pop(skipped).exception()
            if number < self._submitted:
                break
            self._submit()
        found = self._futures.pop(number).result()
        self._submit()
        return found

    def close(self) -> None:
        """End the processes, including those with unfinished calls."""
        self._processes.close()
        self._futures = {}

    def _submit(self) -> None:
        """Submit calls until as many calls are pending as the pool allows."""
        ahead = sum(not future.done() for future in self._futures.values())
        for arguments in self._arguments[self._submitted :][: self._processes.most - ahead]:
            self._futures[self._submitted] = self._processes.submit(self._function, *arguments)
            self._submitted += 1


def _begin(parent: int) -> None:
    ignore_interrupts()
    if sys.platform == "linux":  # Locks are then unlinked at once, so a killed worker leaves none behind
        multiprocessing.set_start_method("fork", force=True)
    threading.Thread(target=_end_with, args=(parent,), name="end with the parent", daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process soon after its parent process dies, when the parent's process id changes."""
    while os.getppid() == parent:
        time.sleep(_PARENT_POLL_S)
    os._exit(1)
