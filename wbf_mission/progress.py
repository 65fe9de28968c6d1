"""How long work tells how far it is."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

Progress: TypeAlias = Callable[[str, float, float], None]
"""Takes what is being done, how much of it is done, and how much there is."""


def silent(_what: str, _done: float, _total: float) -> None:
    """Tell nobody."""


_IMPORTED_S = time.perf_counter()


class Stopwatch:
    """Wall seconds by part of a run."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._since = time.perf_counter()

    def lap(self, name: str) -> None:
        """Add the time since the last lap to a part."""
        now = time.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self._since
        self._since = now


def process_age_s() -> float:
    """Return how long ago this process was started, in seconds, to a hundredth.

    Where the system does not tell, it is the time since this module was imported.
    """
    try:
        told = Path("/proc/self/stat").read_text(encoding="ascii", errors="replace")
        # Field 22, counted after the name, which may hold blanks.
        started_s = int(told.rpartition(")")[2].split()[19]) / os.sysconf("SC_CLK_TCK")
        return time.clock_gettime(time.CLOCK_BOOTTIME) - started_s
    except (OSError, ValueError, IndexError, AttributeError):
        return time.perf_counter() - _IMPORTED_S
