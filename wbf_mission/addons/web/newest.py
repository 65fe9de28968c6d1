"""Runs one job at a time; a newer job replaces the older."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from typing import Generic, TypeVar

from geo.errors import WbfMissionError
from wbf_mission.progress import Progress

ANOTHER_PAGE, GIVEN_UP = "another page", "given up"
"""Reasons why the planning of a draft ended early."""
PATIENCE_S = 3.0
"""Maximum time that a new job waits for the end of the cancelled job (s)."""
T = TypeVar("T")


class SupersededError(WbfMissionError, RuntimeError):
    """The job was cancelled by a newer draft or by the user."""

    def __init__(self, why: str = ANOTHER_PAGE) -> None:
        super().__init__(f"superseded: {why}")
        self.why = why


class NewestOnly(Generic[T]):
    """One job at a time in its own thread; a newer job replaces the older.

    The caller of the older job gets an error at once. The older thread ends at its next progress report. The
    newer job waits for the older thread, but at most `PATIENCE_S` seconds.

    >>> NewestOnly[int]().do("a sum", lambda progress: 3 + 4)
    7
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._job: _Job[T] | None = None

    def do(self, what: str, work: Callable[[Progress], T]) -> T:
        """Return the result of `work`, or raise its error; callers with equal `what` share a job.

        Raises SupersededError when another job is requested, or `stop` is called.
        """
        with self._lock:
            job = self._job
            if job is None or job.what != what:
                job = self._job = _Job(what, work, job)
        return job.result()

    def stop(self) -> None:
        """Cancel the current job."""
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
        """Cancel the job for all callers that wait for its result."""
        with contextlib.suppress(InvalidStateError):
            self._future.set_exception(SupersededError(why))

    def _go_on(self, _what: str, _done: float, _total: float) -> None:
        """End the work of a cancelled job at a progress report."""
        if self._future.done():
            raise SupersededError

    def _run(self) -> None:
        if self._before is not None:
            # Two plans at once would slow each other down; a job that does not end is abandoned.
            self._before._idle.wait(PATIENCE_S)
            self._before = None
        with contextlib.suppress(InvalidStateError):  # The job was cancelled meanwhile
            if not self._future.done():
                try:
                    self._future.set_result(self._work(self._go_on))
                except BaseException as error:  # Raised in `result`
                    self._future.set_exception(error)
        self._idle.set()
