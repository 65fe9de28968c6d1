"""Available memory, checked before a task begins, so that the system does not kill the process halfway.

The smallest limit applies: free memory of the machine, control groups of this process (containers, batch
systems; versions 1 and 2), and the address space limit (``ulimit -v``).
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import psutil

from geo.errors import WbfMissionError


class NotEnoughMemoryError(WbfMissionError, MemoryError):
    """A task that needs more memory than is available; the text gives the memory it needs."""


@dataclass(frozen=True, slots=True)
class AvailableMemory:
    """Memory that this process may still allocate, and the name of the limit."""

    bytes: int
    limited_by: str


def available_memory(root: Path = Path("/")) -> AvailableMemory | None:
    """Return the memory that this process may still allocate, or None if it is unknown.

    `root`: folder below which the files of control groups are read.
    """
    limits = [*_machine(), *_control_groups(root), *_address_space()]
    return min(limits, key=lambda limit: limit.bytes, default=None)


@contextlib.contextmanager
def memory_bounded(more: int) -> Iterator[None]:
    """Limit later allocations of this process to `more` bytes in total; beyond, MemoryError is raised.

    The limit is meant for reading untrusted files, which may declare any size. Systems other than Linux and
    FreeBSD have no such limit.
    """
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

    `what` is the subject of the error's sentence, which lists the parts of at least a tenth of the sum. If
    the available memory is unknown, nothing is checked.

    Examples
    --------
    >>> little = AvailableMemory(2 * 10**9, "RAM")
    >>> require_memory("a kite", {"string": 3 * 10**9}, available=little)
    Traceback (most recent call last):
    ...
    geo.memory.NotEnoughMemoryError: a kite needs 3.0 GB of memory (string 3.0 GB), available are 2.0 GB (RAM)
    """
    limit = available_memory() if available is None else available
    total = sum(parts.values())
    if limit is None or total <= limit.bytes:
        return
    large = sorted((item for item in parts.items() if item[1] * 10 >= total), key=lambda item: -item[1])
    named = ", ".join(f"{name} {human_bytes(size)}" for name, size in large)
    raise NotEnoughMemoryError(
        f"{what} needs {human_bytes(total)} of memory ({named}), "
        f"available are {human_bytes(limit.bytes)} ({limit.limited_by})"
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
    with contextlib.suppress(OSError):  # /proc may not be mounted
        yield AvailableMemory(psutil.virtual_memory().available, "what the machine has free")


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
    # Limits of parent groups apply too; in a container the process's group is mounted as the root.
    own = PurePosixPath(path.lstrip("/"))
    for group in (own, *own.parents):
        limit, usage = _text(base / group / limit_file).strip(), _text(base / group / usage_file).strip()
        if not (limit.isdecimal() and usage.isdecimal()):  # The limit is "max", or the group does not exist
            continue
        statistics = dict(line.split() for line in _text(base / group / "memory.stat").splitlines())
        free = int(limit) - max(0, int(usage) - int(statistics.get(reclaimable, 0)))
        yield AvailableMemory(max(0, free), f"control group limit {human_bytes(int(limit))}")


def _address_space() -> Iterator[AvailableMemory]:
    taken = _address_space_taken()
    if taken is not None:
        limit, _ = psutil.Process().rlimit(psutil.RLIMIT_AS)
        if limit != psutil.RLIM_INFINITY:
            yield AvailableMemory(max(0, limit - taken), f"address space limit {human_bytes(limit)}")


def _address_space_taken() -> int | None:
    """Return the address space of this process (bytes); None if it is unknown or cannot be limited."""
    with contextlib.suppress(OSError, psutil.Error):  # /proc may not be mounted
        if hasattr(psutil, "RLIMIT_AS"):
            return int(psutil.Process().memory_info().vms)
    return None


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""
