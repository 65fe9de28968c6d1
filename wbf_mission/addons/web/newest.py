"""Runs one job at a time; a newer one takes its place."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from typing import Generic, TypeVar

from geo.errors import WbfMissionError
from wbf_mission.progress import Progress

ANOTHER_PAGE, GIVEN_UP = "another page", "given up"
"""Why the planning of a draft ended."""
PATIENCE_S = 3.0
"""The next plan waits at most this long for one that is not wanted any more."""
T = TypeVar("T")


class SupersededError(WbfMissionError, RuntimeError):
    """The job is not wanted any more: a newer draft came, or the user gave it up."""

    def __init__(self, why: str = ANOTHER_PAGE) -> None:
        super().__init__(f"superseded: {why}")
        self.why = why


class NewestOnly(Generic[T]):
    """One job at a time in a thread of its own; a newer one takes its place.

    The caller of the older job gets an error at once; its thread ends at its next report of progress, for
    which the newer job waits `PATIENCE_S` seconds at most.

    >>> NewestOnly[int]().do("a sum", lambda progress: 3 + 4)
    7
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._job: _Job[T] | None = None

    def do(self, what: str, work: Callable[[Progress], T]) -> T:
        """Return what the work finds, or raise its error; who asks for the same shares it.

        SupersededError as soon as something else is asked for, or nothing any more (`stop`).
        """
        with self._lock:
            job = self._job
            if job is None or job.what != what:
                job = self._job = _Job(what, work, job)
        return job.result()

    def stop(self) -> None:
        """End what is under way."""
        with self._lock:
            if self._job is not None:
                self._job.stop(GIVEN_UP)
            self._job = None


class _Job(Generic[T]):
    def __init__(self, what: str, work: Callable[[Progress], T], before: _Job[T] | None) -> None:
        self.what, self._work, self._before = what, work, before
        self._future, self._idle = Future[T](), threading.Event()
        if before is not None:
            before.stop()
        threading.Thread(target=self._run, name="studio plan", daemon=True).start()

    def result(self) -> T:
        return self._future.result()

    def stop(self, why: str = ANOTHER_PAGE) -> None:
        """End the waiting for it."""
        with contextlib.suppress(InvalidStateError):
            self._future.set_exception(SupersededError(why))

    def _go_on(self, _what: str, _done: float, _total: float) -> None:
        """End the work at a report of its progress, if nobody waits for it any more."""
        if self._future.done():
            raise SupersededError

    def _run(self) -> None:
        if self._before is not None:
            # Two plans at once would each take longer; one that does not end is left to itself.
            self._before._idle.wait(PATIENCE_S)
            self._before = None
        with contextlib.suppress(InvalidStateError):  # Nobody waits any more
            if not self._future.done():
                try:
                    self._future.set_result(self._work(self._go_on))
                except BaseException as error:  # It is raised where the result is waited for
                    self._future.set_exception(error)
        self._idle.set()
