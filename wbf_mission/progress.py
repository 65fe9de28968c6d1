"""Progress callbacks and a stopwatch for long tasks."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

Progress: TypeAlias = Callable[[str, float, float], None]
"""Callback ``progress(task, done, total)``."""


def silent(_what: str, _done: float, _total: float) -> None:
    """Ignore progress."""


_IMPORTED_S = time.perf_counter()


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


def process_age_s() -> float:
    """Return the age of this process (s), to a hundredth of a second.

    On systems without ``/proc``, return the time since this module was imported.
    """
    try:
        stat = Path("/proc/self/stat").read_text(encoding="ascii", errors="replace")
        # Field 22 (starttime), counted from behind the process name, which may contain spaces.
        started_s = int(stat.rpartition(")")[2].split()[19]) / os.sysconf("SC_CLK_TCK")
        return time.clock_gettime(time.CLOCK_BOOTTIME) - started_s
    except (OSError, ValueError, IndexError, AttributeError):
        return time.perf_counter() - _IMPORTED_S
