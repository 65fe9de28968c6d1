"""The user's cache folder, locks on its files, and the warning when it cannot be written."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import platformdirs

from geo.atomic import lock_file, unlock_file

_warned_of: set[Path] = set()


class CacheWarning(UserWarning):
    """A cache that cannot be written: its content is made anew in every run."""


def user_cache_folder(name: str) -> Path:
    """Return the folder NAME of the user's cache; it may not exist yet.

    The cache is below XDG_CACHE_HOME or ``~/.cache`` on Linux, ``~/Library/Caches`` on macOS, and
    ``%LOCALAPPDATA%`` on Windows.

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
    """Let one process make a file, while others wait, look for it again and find it.

    The lock is on a file beside it. Where nothing can be written, or a disk has no locks, nobody waits.
    """
    with ExitStack() as stack:
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            lock = stack.enter_context(path.with_name(f"{path.name}.lock").open("ab"))
            lock_file(lock.fileno(), wait=True)
            # Closing it is not enough where another thread has forked meanwhile.
            stack.callback(unlock_file, lock.fileno())
        yield


def warn_of_cache(folder: Path, error: Exception) -> None:
    """Warn that a folder keeps nothing, and why: once for each folder and process."""
    if folder in _warned_of:
        return
    _warned_of.add(folder)
    reason = str(error)
    if isinstance(error, OSError) and error.strerror:
        reason = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    msg = f"{folder}: cannot keep anything in this cache ({reason}); it is made anew in every run"
    warnings.warn(msg, CacheWarning, stacklevel=3)
