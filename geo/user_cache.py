"""The user's cache folder, and the warning when it cannot be written."""

from __future__ import annotations

import warnings
from pathlib import Path

import platformdirs

_warned_of: set[Path] = set()


class CacheWarning(UserWarning):
    """Warning that a cache cannot be written, so that every run has to make its content again."""


def user_cache_folder(name: str) -> Path:
    """Return the folder `name` of the user's cache, which may not exist yet.

    The cache is below XDG_CACHE_HOME or ``~/.cache`` on Linux, ``~/Library/Caches`` on macOS, and
    ``%LOCALAPPDATA%`` on Windows.

    Examples
    --------
    >>> user_cache_folder("environments").parts[-1]
    'environments'
    """
    root = platformdirs.user_cache_path("wbf-mission", appauthor=False)
    # The XDG standard: a relative path in XDG_CACHE_HOME is ignored.
    if not root.is_absolute():
        root = Path.home() / ".cache" / "wbf-mission"
    return root / name


def warn_of_cache(folder: Path, error: Exception) -> None:
    """Warn that a cache folder cannot be written, and why; once per folder and process."""
    if folder in _warned_of:
        return
    _warned_of.add(folder)
    reason = str(error)
    if isinstance(error, OSError) and error.strerror:
        reason = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    msg = f"{folder}: cannot keep anything in this cache ({reason}); it is made anew in every run"
    warnings.warn(msg, CacheWarning, stacklevel=3)
