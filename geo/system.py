"""What each operating system does in its own way: clocks, and the limit of open files."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from pathlib import Path

_IMPORTED_S = time.perf_counter()


def steady_s() -> float:
    """Return a clock (s) that nobody sets and that also runs while the machine sleeps."""
    if sys.platform == "linux" and hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime(time.CLOCK_BOOTTIME)
    if sys.platform == "darwin":  # its time.monotonic stands still during sleep
        return time.clock_gettime(time.CLOCK_MONOTONIC)
    return time.monotonic()


def process_age_s() -> float:
    """Return the time since the start of this process (s), to a hundredth of a second.

    Where the system hides the start, it is the time since this module was imported.
    """
    import psutil

    try:
        if sys.platform != "linux":
            return time.time() - float(psutil.Process().create_time())
        # psutil adds the time of the boot, which Linux gives in whole seconds.
        status = Path("/proc/self/stat").read_text(encoding="ascii", errors="replace")
        # Field 22, counted after the name, which may hold blanks.
        started_s = int(status.rpartition(")")[2].split()[19]) / os.sysconf("SC_CLK_TCK")
        return time.clock_gettime(time.CLOCK_BOOTTIME) - started_s
    except (OSError, ValueError, IndexError, AttributeError, psutil.Error):
        return time.perf_counter() - _IMPORTED_S


def allow_open_files(number: int) -> None:
    """Raise this process's limit of open files to `number` where it is lower and the system lets it."""
    if sys.platform == "win32":
        return
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        wanted = number if hard == resource.RLIM_INFINITY else min(number, hard)
        if soft != resource.RLIM_INFINITY and soft < wanted:
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
