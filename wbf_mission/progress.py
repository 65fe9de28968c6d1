"""Progress callbacks and a stopwatch for long tasks."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeAlias

Progress: TypeAlias = Callable[[str, float, float], None]
"""Callback ``progress(task, done, total)``."""


def silent(_what: str, _done: float, _total: float) -> None:
    """Ignore progress."""


class Stopwatch:
    """Wall time of each part of a run (s)."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._since = time.perf_counter()

    def lap(self, name: str) -> None:
        """Add the time since the last lap to the part `name`."""
        now = time.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self._since
        self._since = now
