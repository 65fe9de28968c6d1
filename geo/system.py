"""Functions that differ between operating systems: clocks, memory and the limit of open files."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import time
from pathlib import Path

_IMPORTED_S = time.perf_counter()


def steady_s() -> float:
    """Return the time of a clock (s) that is never set and that also runs while the machine sleeps."""
    if sys.platform == "linux" and hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime(time.CLOCK_BOOTTIME)
    if sys.platform == "darwin":  # On macOS time.monotonic stops during sleep
        return time.clock_gettime(time.CLOCK_MONOTONIC)
    return time.monotonic()


def process_age_s() -> float:
    """Return the time since the start of this process (s), to a hundredth of a second.

    If the start time is unknown, the time since the import of this module is returned.
    """
    import psutil

    try:
        if sys.platform != "linux":
            return time.time() - float(psutil.Process().create_time())
        # psutil's start time on Linux is exact to a second only, as it adds the boot time from /proc/stat.
        status = Path("/proc/self/stat").read_text(encoding="ascii", errors="replace")
        # Field 22 is the start time; fields are counted after the name, which may contain spaces.
        started_s = int(status.rpartition(")")[2].split()[19]) / os.sysconf("SC_CLK_TCK")
        return time.clock_gettime(time.CLOCK_BOOTTIME) - started_s
    except (OSError, ValueError, IndexError, AttributeError, psutil.Error):
        return time.perf_counter() - _IMPORTED_S


def use_memory_again() -> None:
    """Keep free memory in this process until `free_unused_memory`, and collect garbage less often.

    Zeroing fresh pages took a tenth of the CPU time of a run over Waterberry, garbage collection a thirtieth.
    """
    gc.set_threshold(100_000, 20, 20)
    _call_c(
        "mallopt",
        (-8, 2),  # M_ARENA_MAX: arenas that threads share; each keeps memory of its own
        (-3, 32 * 2**20),  # M_MMAP_THRESHOLD, the largest that is allowed: chunks of maps
        (-1, 2**31 - 1),  # M_TRIM_THRESHOLD
    )


def free_unused_memory() -> None:
    """Return free memory to the system; the C library of Linux keeps that of threads."""
    _call_c("malloc_trim", (0,))


def _call_c(function: str, *calls: tuple[int, ...]) -> None:
    """Call a function of Linux's C library, if it has the function."""
    if sys.platform == "linux":
        import ctypes

        with contextlib.suppress(OSError, AttributeError):
            for arguments in calls:
                getattr(ctypes.CDLL(None), function)(*arguments)


def allow_open_files(number: int) -> None:
    """Raise the limit of open files of this process to `number`, as far as the system allows."""
    if sys.platform == "win32":
        return
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        wanted = number if hard == resource.RLIM_INFINITY else min(number, hard)
        if soft != resource.RLIM_INFINITY and soft < wanted:
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
