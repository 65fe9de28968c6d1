"""Processes of our own that can be given up at any time, and the signals that end them.

Ctrl-C comes at any moment and reaches every process of the terminal.
"""

from __future__ import annotations

import math
import os
import signal
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
_REPEATED_S = (
    1.0  # Longer than `timeout` takes for both signals, shorter than a user who means a second Ctrl-C
)
_POLL_S = 0.01
_HAND_OVER_S = 5.0  # loky hands a call over in milliseconds
_PARENT_POLL_S = 2.0


class Repeats:
    """Recognises a signal that repeats the last one: GNU `timeout` signals the process and its group."""

    def __init__(self) -> None:
        self._counted_s = -math.inf

    def is_repeat(self) -> bool:
        """Return whether the signal of now comes within a second of the last one that was no repeat."""
        now_s = time.monotonic()
        if now_s < self._counted_s + _REPEATED_S:
            return True
        self._counted_s = now_s
        return False


def ignore_interrupts() -> None:
    """Leave the signals, which reach the whole group, to the parent: the first thing that a worker does."""
    for number in INTERRUPTS:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def interrupts_noted(
    wake: Callable[[], None] | None = None, *, at_once: bool = False
) -> Iterator[Callable[[], None]]:
    """Note the KeyboardInterrupt of the first signal, and raise it at the end of the block.

    The yielded function raises a noted interrupt earlier. An exception raised by the signal's handler itself
    can be lost: compiled extensions drop some, as `hasattr` of the C API does. The second signal raises at
    once; signals within a second count as one. In other threads than the main one nothing is noted.

    Parameters
    ----------
    wake : callable, optional
        Called when a signal has come, to end a wait.
    at_once : bool
        Whether the first signal raises at once, too; it is noted in case that the exception is lost.
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
            # The second signal may have put the system's handler in place.
            if signal.getsignal(number) is note:
                signal.signal(number, handler)
    answer()


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold signals back while processes start, which inherit that; they are answered afterwards.

    Otherwise a signal would end a process that has not called `ignore_interrupts` yet.
    """
    # Windows has no mask of signals.
    if not hasattr(signal, "pthread_sigmask"):
        with interrupts_noted():
            yield
        return
    # It starts with the first process, and would let the signal through then.
    resource_tracker.ensure_running()
    # The mask is this thread's and that of processes it starts; another thread may get the signal.
    with interrupts_noted():
        before = signal.pthread_sigmask(signal.SIG_BLOCK, INTERRUPTS)
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Processes:
    """A pool of processes that make calls.

    They leave Ctrl-C to this process, do not run the caller's script again, as the standard library's do, and
    end soon after this process was killed.

    At most `most` calls may be open: closed with more, loky ends with a traceback.
    """

    def __init__(self, workers: int) -> None:
        from joblib.externals.loky import ProcessPoolExecutor

        self.most = 2 * workers
        self._pool = ProcessPoolExecutor(workers, initializer=_begin, initargs=(os.getpid(),))
        self._open: set[Future[Any]] = set()

    def submit(self, function: Callable[..., _T], *arguments: Any) -> Future[_T]:
        """Have a call made, pickled by cloudpickle; BrokenProcessPool if a process was killed before."""
        with interrupts_held():
            future: Future[_T] = self._pool.submit(function, *arguments)
            self._open.add(future)
        future.add_done_callback(self._open.discard)
        return future

    def close(self) -> None:
        """End the processes, whatever they do."""
        until_s = time.monotonic() + _HAND_OVER_S
        while any(not (future.running() or future.done()) for future in tuple(self._open)):
            if time.monotonic() >= until_s:
                break
            time.sleep(_POLL_S)
        self._pool.shutdown(wait=True, kill_workers=True)


class CallsAhead(Generic[_T]):
    """Makes calls in processes, by default one process a core, before their results are asked for.

    KeyboardInterrupt if it came while the processes started; they have ended then.
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
        """Wait for a call, and return its result or raise its exception.

        Results are given once, in their order, from 0; those left out are dropped. BrokenProcessPool if a
        process was killed.
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
        """End the processes, whatever they do."""
        self._processes.close()
        self._futures = {}

    def _submit(self) -> None:
        """Hand over as many calls as the processes take."""
        ahead = sum(not future.done() for future in self._futures.values())
        for arguments in self._arguments[self._submitted :][: self._processes.most - ahead]:
            self._futures[self._submitted] = self._processes.submit(self._function, *arguments)
            self._submitted += 1


def _begin(parent: int) -> None:
    ignore_interrupts()
    threading.Thread(target=_end_with, args=(parent,), name="end with the parent", daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process soon after its parent; a killed one leaves its children to another parent."""
    while os.getppid() == parent:
        time.sleep(_PARENT_POLL_S)
    os._exit(1)
