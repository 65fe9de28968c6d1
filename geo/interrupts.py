"""Ctrl-C, which comes at any moment, and reaches every process of the terminal."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from types import FrameType

INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
REPEATED_S = 1.0


class Repeats:
    """Marks a signal that repeats the last one: GNU `timeout` sends each to the process and to its group."""

    def __init__(self) -> None:
        self._counted_s = -math.inf

    def is_repeat(self) -> bool:
        """Whether the signal that comes now is within a second of the last one that was none."""
        now_s = time.monotonic()
        if now_s < self._counted_s + REPEATED_S:
            return True
        self._counted_s = now_s
        return False


def ignore_interrupts() -> None:
    """Leave the signals to the process that waits: what a worker does first. They reach the whole group."""
    for number in INTERRUPTS:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def interrupts_noted(
    wake: Callable[[], None] | None = None, *, at_once: bool = False
) -> Iterator[Callable[[], None]]:
    """Note the KeyboardInterrupt of the first signal; raise it where the caller asks, or at the end.

    What is raised wherever a signal happens to come can be lost: compiled extensions drop exceptions in
    places, as `hasattr` of the C API does. The second signal's is raised at once; one that comes within a
    second repeats the first. Elsewhere than in the main thread signals stay as they are.

    `wake` is called when the signal has come, to end a wait. With `at_once` the first signal's is raised at
    once, too; it is noted in case that it is lost. What is yielded raises what was noted.
    """
    noted: list[KeyboardInterrupt] = []
    before: dict[int, Callable[[int, FrameType | None], object]] = {}
    seen = [0]
    repeats = Repeats()

    def note(number: int, frame: FrameType | None) -> None:
        if repeats.is_repeat():
            return
        seen[0] += 1
        try:
            before[number](number, frame)
        except KeyboardInterrupt as error:
            # The second one's, too: where it is lost, it is raised where the caller asks.
            noted[:] = [error]
            if at_once or seen[0] > 1:
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
            # Otherwise the second signal has put the system's in its place.
            if signal.getsignal(number) is note:
                signal.signal(number, handler)
    answer()


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold the signals back while processes start, which inherit that; they are answered afterwards.

    A process that has not come to `ignore_interrupts` yet would be ended by them.
    """
    # Who keeps track of the processes is started with the first of them, and lets the signal through then.
    resource_tracker.ensure_running()
    # The mask is that of this thread and of the processes that it starts; another thread may get the signal.
    with interrupts_noted():
        before = signal.pthread_sigmask(signal.SIG_BLOCK, INTERRUPTS)
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
