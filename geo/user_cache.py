"""Where things that can be made again are kept for the user between runs."""

from __future__ import annotations

import os
from pathlib import Path


def user_cache_folder(name: str) -> Path:
    """Return ``wbf-mission/NAME`` below XDG_CACHE_HOME or ``~/.cache``; it may not exist yet.

    Examples
    --------
    >>> user_cache_folder("environments").parts[-2:]
    ('wbf-mission', 'environments')
    """
    base = os.environ.get("XDG_CACHE_HOME")
    # The standard says that relative paths there are to be ignored.
    root = Path(base) if base and Path(base).is_absolute() else Path.home() / ".cache"
    return root / "wbf-mission" / name
