"""What installed packages offer under the name of a group, looked up once."""

from __future__ import annotations

import sys
from functools import lru_cache
from importlib import metadata
from pathlib import Path

__all__ = ["entry_points"]


def entry_points(group: str) -> metadata.EntryPoints:
    """Return the entry points of a group, as `importlib.metadata.entry_points` does in some milliseconds.

    They are looked up again when ``sys.path`` or one of its folders has changed.

    Examples
    --------
    >>> "spiral" in entry_points("wbf_mission.planners").names
    True
    """
    return _entry_points(group, tuple((one, _changed_ns(one)) for one in sys.path))


@lru_cache(maxsize=16)
def _entry_points(group: str, _path: tuple[tuple[str, int], ...]) -> metadata.EntryPoints:
    return metadata.entry_points(group=group)


def _changed_ns(folder: str) -> int:
    try:
        return Path(folder).stat().st_mtime_ns
    except OSError:
        return 0
