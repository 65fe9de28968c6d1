"""The folder where things that can be made again are kept, and what is said when they cannot be."""

from __future__ import annotations

import fcntl
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import platformdirs

_told: set[Path] = set()


class CacheWarning(UserWarning):
    """A cache that cannot be written to: what was to be kept there is made anew in every run."""


def user_cache_folder(name: str) -> Path:
    """Name the folder NAME of the user's cache, ``wbf-mission/NAME`` on Linux; it may not exist yet.

    The cache is where the system has it: below XDG_CACHE_HOME or ``~/.cache`` on Linux, ``~/Library/Caches``
    on macOS, ``%LOCALAPPDATA%`` on Windows.

    Examples
    --------
    >>> user_cache_folder("environments").parts[-1]
    'environments'
    """
    root = platformdirs.user_cache_path("wbf-mission", appauthor=False)
    # The standard says that relative paths in XDG_CACHE_HOME are to be ignored.
    if not root.is_absolute():
        root = Path.home() / ".cache" / "wbf-mission"
    return root / name


@contextmanager
def made_by_one(path: Path) -> Iterator[None]:
    """Keep other processes that make the same file waiting: they look for it again, and find it.

    The lock is on a file beside it. Where nothing can be written, or a disk has no locks, nobody waits.
    """
    with ExitStack() as stack:
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            lock = stack.enter_context(path.with_name(f"{path.name}.lock").open("ab"))
            fcntl.flock(lock, fcntl.LOCK_EX)
            # Closing it is not enough where another thread has forked meanwhile.
            stack.callback(fcntl.flock, lock, fcntl.LOCK_UN)
        yield


def warn_of_cache(folder: Path, error: Exception) -> None:
    """Say once for each folder and process that nothing can be kept in it, and why.

    An OSError is told by its reason and, if it has one, its file.
    """
    if folder in _told:
        return
    _told.add(folder)
    reason = str(error)
    if isinstance(error, OSError) and error.strerror:
        reason = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    msg = f"{folder}: cannot keep anything in this cache ({reason}); it is made anew in every run"
    warnings.warn(msg, CacheWarning, stacklevel=3)
