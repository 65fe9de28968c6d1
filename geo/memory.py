"""Foreseeing that memory will not do, instead of being killed half-way.

What counts is the least of: what the machine has free, what every control group around this process leaves
(containers, batch systems; versions 1 and 2), and the process's own limit of address space (``ulimit -v``).
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from geo.errors import WbfMissionError

_UNLIMITED = 1 << 60


class NotEnoughMemoryError(WbfMissionError, MemoryError):
    """A task that would not fit into memory; its text says what would be needed."""


@dataclass(frozen=True, slots=True)
class AvailableMemory:
    """How much more memory this process may take.

    Parameters
    ----------
    limited_by : str
        What sets this limit, in words.
    """

    bytes: int
    limited_by: str


def available_memory(root: Path = Path("/")) -> AvailableMemory | None:
    """Return how much memory this process may still take, None where the system does not tell.

    `root` is where ``proc`` and ``sys`` are found.
    """
    found = [*_machine(root), *_control_groups(root), *_address_space(root)]
    return min(found, key=lambda limit: limit.bytes, default=None)


@contextlib.contextmanager
def memory_bounded(more: int) -> Iterator[None]:
    """Let this process take at most so many bytes more: what wants them gets a MemoryError.

    For files of others whose size is only what they say. Where the system does not tell how much is taken,
    there is no bound.
    """
    import resource

    pages = _text(Path("/proc/self/statm")).split()
    if not pages:
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    taken = int(pages[0]) * resource.getpagesize()
    bound = taken + more if soft == resource.RLIM_INFINITY else min(soft, taken + more)
    resource.setrlimit(resource.RLIMIT_AS, (bound, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def require_memory(what: str, parts: Mapping[str, int], *, available: AvailableMemory | None = None) -> None:
    """Raise if a task's parts do not fit into memory together.

    `what` is the subject of the sentence of the NotEnoughMemoryError; parts of less than a tenth of the sum
    are not named. Where the system does not tell what is available, nothing is checked.

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
    """Return a number of bytes in decimal units.

    Examples
    --------
    >>> human_bytes(1_234_567_890), human_bytes(360_000_000), human_bytes(900)
    ('1.2 GB', '360 MB', '1 kB')
    """
    if size >= 1e9:
        return f"{size / 1e9:.1f} GB"
    return f"{size / 1e6:.0f} MB" if size >= 1e6 else f"{size / 1e3:.0f} kB"


def _machine(root: Path) -> Iterator[AvailableMemory]:
    table = _table(root / "proc/meminfo")
    if "MemAvailable" in table:
        yield AvailableMemory(table["MemAvailable"] * 1024, "what the machine has free")
    elif root == Path("/") and "SC_PHYS_PAGES" in os.sysconf_names:
        size = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        yield AvailableMemory(size, "the machine's memory")


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
    # A limit of any group above counts too; in a container the own group is mounted as the root.
    own = PurePosixPath(path.lstrip("/"))
    for group in (own, *own.parents):
        limit, usage = _number(base / group / limit_file), _number(base / group / usage_file)
        if limit is None or usage is None or limit >= _UNLIMITED:
            continue
        cached = _table(base / group / "memory.stat").get(reclaimable, 0)
        free = max(0, limit - max(0, usage - cached))
        yield AvailableMemory(free, f"control group limit {human_bytes(limit)}")


def _address_space(root: Path) -> Iterator[AvailableMemory]:
    try:
        import resource
    except ImportError:
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    pages = _text(root / "proc/self/statm").split()
    if limit == resource.RLIM_INFINITY or not pages:
        return
    free = max(0, limit - int(pages[0]) * resource.getpagesize())
    yield AvailableMemory(free, f"address space limit {human_bytes(limit)}")


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""


def _number(path: Path) -> int | None:
    text = _text(path).strip()
    return int(text) if text.isdecimal() else None


def _table(path: Path) -> dict[str, int]:
    """Read lines of a name and a number, as in ``meminfo`` and ``memory.stat``."""
    table = {}
    for line in _text(path).splitlines():
        words = line.replace(":", " ").split()
        if len(words) >= 2 and words[1].isdecimal():
            table[words[0]] = int(words[1])
    return table
