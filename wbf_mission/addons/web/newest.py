"""Runs one job at a time; a newer one takes its place."""

from __future__ import annotations

import threading
from collections.abc import Callable
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
    """Runs one job at a time in a thread of its own; a newer one takes its place.

    Who waits for the older job gets an error at once. Its thread ends at its next report of progress;
    the newer job waits for that for `PATIENCE_S` seconds at most.

    Examples
    --------
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
        self._found: list[T] = []
        self._error: BaseException | None = None
        self._ended, self._idle = threading.Event(), threading.Event()
        if before is not None:
            before.stop()
        threading.Thread(target=self._run, name="studio plan", daemon=True).start()

    def result(self) -> T:
        self._ended.wait()
        if self._error is not None:
            raise self._error
        return self._found[0]

    def stop(self, why: str = ANOTHER_PAGE) -> None:
        """Tell who waits."""
        if not self._ended.is_set():
            self._error = SupersededError(why)
            self._ended.set()

    def _go_on(self, _what: str, _done: float, _total: float) -> None:
        """End the work at a report of its progress, if nobody waits for it any more."""
        if self._ended.is_set():
            raise SupersededError

    def _run(self) -> None:
        if self._before is not None:
            # Two plans at once would each take longer; one that does not end is left to itself.
            self._before._idle.wait(PATIENCE_S)
            self._before = None
        if not self._ended.is_set():
            try:
                self._found.append(self._work(self._go_on))
            except BaseException as error:  # It is raised where the result is waited for
                if not self._ended.is_set():
                    self._error = error
        self._ended.set()
        self._idle.set()
