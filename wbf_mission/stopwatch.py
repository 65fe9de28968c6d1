"""Wall time of a run, by its parts."""

from __future__ import annotations

import os
import time
from pathlib import Path

_IMPORTED_S = time.perf_counter()


class Stopwatch:
    """Wall seconds by part of a run.

    Attributes
    ----------
    seconds : dict of str to float
    """

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
