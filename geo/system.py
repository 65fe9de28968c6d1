"""Access to the operating system: clocks, threads, open files, available memory, and the user's cache folder.

Available memory is checked before a task begins, so that the system does not kill the process halfway. The
smallest of three limits applies: the machine's free memory, the memory of this process's control groups
(containers, batch systems; versions 1 and 2), and the address space limit (``ulimit -v``).
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Self, TypeVar

from geo.errors import WbfMissionError

if TYPE_CHECKING:
    from concurrent.futures import Future, ThreadPoolExecutor

_IMPORTED_S = time.perf_counter()
_Item = TypeVar("_Item")
_PARTS_PER_CORE = 8  # Several parts for each core balance the load


class Closing(ABC):
    """Context manager that calls `close` at the end of the ``with`` block."""

    @abstractmethod
    def close(self) -> None:
        """Close the object; a second call does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def steady_s() -> float:
    """Return the time (s) of a monotonic clock that runs on while the machine sleeps."""
    if sys.platform == "linux" and hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime(time.CLOCK_BOOTTIME)
    if sys.platform == "darwin":  # On macOS time.monotonic stops during sleep
        return time.clock_gettime(time.CLOCK_MONOTONIC)
    return time.monotonic()


def process_age_s() -> float:
    """Return the seconds since this process started, to a hundredth of a second.

    If the start time is unknown, return the seconds since this module was imported.
    """
    import psutil

    try:
        if sys.platform != "linux":
            return time.time() - float(psutil.Process().create_time())
        # On Linux psutil's start time is only exact to a second: it adds the boot time of /proc/stat.
        status = Path("/proc/self/stat").read_text(encoding="ascii", errors="replace")
        # Field 22 is the start time. Counting begins after the name, field 2, which may contain spaces.
        started_s = int(status.rpartition(")")[2].split()[19]) / os.sysconf("SC_CLK_TCK")
        return time.clock_gettime(time.CLOCK_BOOTTIME) - started_s
    except (OSError, ValueError, IndexError, AttributeError, psutil.Error):
        return time.perf_counter() - _IMPORTED_S


def use_memory_again() -> None:
    """Keep freed memory for reuse until `free_unused_memory` is called.

    In a run over Waterberry, zeroing fresh pages took a tenth of the CPU time.
    """
    _call_c(
        "mallopt",
        (-8, 2),  # M_ARENA_MAX: threads share two arenas; each arena keeps its freed memory.
        (-3, 32 * 2**20),  # M_MMAP_THRESHOLD, largest value: freed chunks of maps are kept, not unmapped.
        (-1, 2**31 - 1),  # M_TRIM_THRESHOLD: freed memory is not returned.
    )


def free_unused_memory() -> None:
    """Return freed memory to the system; on Linux the C library keeps memory that threads freed."""
    _call_c("malloc_trim", (0,))


def _call_c(function: str, *calls: tuple[int, ...]) -> None:
    """On Linux, call a function of the C library if the library has this function."""
    if sys.platform == "linux":
        import ctypes

        with contextlib.suppress(OSError, AttributeError):
            for arguments in calls:
                getattr(ctypes.CDLL(None), function)(*arguments)


def allow_open_files(number: int) -> None:
    """Raise this process's limit of open files to `number`, or to the system's maximum if that is less."""
    if sys.platform == "win32":
        return
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        wanted = number if hard == resource.RLIM_INFINITY else min(number, hard)
        if soft != resource.RLIM_INFINITY and soft < wanted:
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


class NotEnoughMemoryError(WbfMissionError, MemoryError):
    """Error of a task that needs more memory than is available; the text gives the memory needed."""


@dataclass(frozen=True, slots=True)
class AvailableMemory:
    """Memory that this process may still allocate, and the name of the limit."""

    bytes: int
    limited_by: str


def available_memory(root: Path = Path("/")) -> AvailableMemory | None:
    """Return the memory that this process may still allocate, or None if it is unknown.

    The files of control groups are read below the folder `root`.
    """
    limits = [*_machine(), *_control_groups(root), *_address_space()]
    return min(limits, key=lambda limit: limit.bytes, default=None)


@contextlib.contextmanager
def memory_bounded(more: int) -> Iterator[None]:
    """Limit this process's allocations in the block to `more` bytes; further allocations raise MemoryError.

    The limit is meant for reading untrusted files, which may claim any size. On systems other than Linux and
    FreeBSD there is no limit.
    """
    import psutil

    taken = _address_space_taken()
    if taken is None:
        yield
        return
    process = psutil.Process()
    soft, hard = process.rlimit(psutil.RLIMIT_AS)
    bound = taken + more if soft == psutil.RLIM_INFINITY else min(soft, taken + more)
    process.rlimit(psutil.RLIMIT_AS, (bound, hard))
    try:
        yield
    finally:
        process.rlimit(psutil.RLIMIT_AS, (soft, hard))


def require_memory(what: str, parts: Mapping[str, int], *, available: AvailableMemory | None = None) -> None:
    """Raise NotEnoughMemoryError if the sum of `parts` (bytes) exceeds the available memory.

    The error's text begins with `what` and lists the parts that make up at least a tenth of the sum. If the
    available memory is unknown, nothing is checked.

    Examples
    --------
    >>> little = AvailableMemory(2 * 10**9, "RAM")
    >>> require_memory("a kite", {"string": 3 * 10**9}, available=little)
    Traceback (most recent call last):
    ...
    geo.system.NotEnoughMemoryError: a kite needs 3.0 GB of memory (string 3.0 GB), but 2.0 GB are free (RAM)
    """
    limit = available_memory() if available is None else available
    total = sum(parts.values())
    if limit is None or total <= limit.bytes:
        return
    large = sorted((item for item in parts.items() if item[1] * 10 >= total), key=lambda item: -item[1])
    named = ", ".join(f"{name} {human_bytes(size)}" for name, size in large)
    raise NotEnoughMemoryError(
        f"{what} needs {human_bytes(total)} of memory ({named}), "
        f"but {human_bytes(limit.bytes)} are free ({limit.limited_by})"
    )


def human_bytes(size: float) -> str:
    """Return a number of bytes as text in decimal units.

    Examples
    --------
    >>> human_bytes(1_234_567_890), human_bytes(360_000_000), human_bytes(900)
    ('1.2 GB', '360 MB', '1 kB')
    """
    if size >= 1e9:
        return f"{size / 1e9:.1f} GB"
    return f"{size / 1e6:.0f} MB" if size >= 1e6 else f"{size / 1e3:.0f} kB"


def _machine() -> Iterator[AvailableMemory]:
    import psutil

    with contextlib.suppress(OSError):  # /proc may not be mounted
        yield AvailableMemory(psutil.virtual_memory().available, "memory of the machine")


def _control_groups(root: Path) -> Iterator[AvailableMemory]:
    base = root / "sys/fs/cgroup"
    for line in _text(root / "proc/self/cgroup").splitlines():
        _, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
        if not controllers:
            yield from _groups(base, path, "memory.max", "memory.current", "inactive_file")
        elif "memory" in controllers.split(","):
            names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
            yield from _groups(base / "memory", path, *names)


def _groups(
    base: Path, path: str, limit_file: str, usage_file: str, reclaimable: str
) -> Iterator[AvailableMemory]:
    # Limits of parent control groups apply too. In a container, the mounted root is the process's own group.
    own = PurePosixPath(path.lstrip("/"))
    for group in (own, *own.parents):
        limit, usage = _text(base / group / limit_file).strip(), _text(base / group / usage_file).strip()
        if not (limit.isdecimal() and usage.isdecimal()):  # No limit ("max"), or no such group
            continue
        statistics = dict(line.split() for line in _text(base / group / "memory.stat").splitlines())
        free = int(limit) - max(0, int(usage) - int(statistics.get(reclaimable, 0)))
        yield AvailableMemory(max(0, free), f"control group limit {human_bytes(int(limit))}")


def _address_space() -> Iterator[AvailableMemory]:
    import psutil

    taken = _address_space_taken()
    if taken is not None:
        limit, _ = psutil.Process().rlimit(psutil.RLIMIT_AS)
        if limit != psutil.RLIM_INFINITY:
            yield AvailableMemory(max(0, limit - taken), f"address space limit {human_bytes(limit)}")


def _address_space_taken() -> int | None:
    """Return the bytes of this process's address space; None if it is unknown or cannot be limited."""
    import psutil

    with contextlib.suppress(OSError, psutil.Error):  # /proc may not be mounted
        if hasattr(psutil, "RLIMIT_AS"):
            return int(psutil.Process().memory_info().vms)
    return None


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""


_warned_of: set[Path] = set()


class CacheWarning(UserWarning):
    """Warning that a cache cannot be written; every run then has to make the cached content again."""


def user_cache_folder(name: str) -> Path:
    """Return the folder `name` of the user's cache, which may not exist yet.

    The cache is below XDG_CACHE_HOME or ``~/.cache`` on Linux, ``~/Library/Caches`` on macOS, and
    ``%LOCALAPPDATA%`` on Windows.

    Examples
    --------
    >>> user_cache_folder("environments").parts[-1]
    'environments'
    """
    import platformdirs

    root = platformdirs.user_cache_path("wbf-mission", appauthor=False)
    # The XDG standard requires that a relative path in XDG_CACHE_HOME is ignored.
    if not root.is_absolute():
        root = Path.home() / ".cache" / "wbf-mission"
    return root / name


def warn_of_cache(folder: Path, error: Exception) -> None:
    """Warn why a cache folder cannot be written; warn once per folder and process."""
    if folder in _warned_of:
        return
    _warned_of.add(folder)
    reason = str(error)
    if isinstance(error, OSError) and error.strerror:
        reason = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    msg = f"{folder}: cannot write this cache ({reason}); every run computes the content again"
    warnings.warn(msg, CacheWarning, stacklevel=3)


@cache
def _threads() -> ThreadPoolExecutor:
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(os.cpu_count() or 1, "parallel")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_threads.cache_clear)  # A forked process has no threads of its parent


def in_parallel(work: Callable[[Sequence[_Item]], None], items: Sequence[_Item]) -> None:
    """Call `work` with each part of the items, in threads on all cores.

    `work` must release the GIL, and must not call this function.
    """
    cores = os.cpu_count() or 1
    if not items:
        return
    if len(items) < 2 or cores == 1:
        work(items)
        return
    from concurrent.futures import wait

    size = max(1, len(items) // (_PARTS_PER_CORE * cores))
    starts = range(0, len(items), size)
    parts: list[Future[None]] = []
    try:
        parts.extend(_threads().submit(work, items[start : start + size]) for start in starts)
        for part in parts:
            part.result()
    finally:
        for part in parts:
            part.cancel()
        wait(parts)
