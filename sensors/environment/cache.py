"""Two caches of environments, on disk between runs and in memory within a process.

An entry on disk is named by a digest of crop map, fields, seed, days and format version. Entries are written
atomically, so processes may share a cache. A damaged entry is generated again. The least recently used
entries are removed when the cache exceeds its limit.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
import time
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from numpy.random import SeedSequence

from geo.system import user_cache_folder, warn_of_cache
from sensors.environment.environment import Environment
from sensors.environment.generate import Progress, generate_environment, make_task
from sensors.environment.storage import save_environment
from sensors.environment.store import open_store
from sensors.errors import EnvironmentDataError
from sensors.fields import PAPER_FIELDS, FieldSet

if TYPE_CHECKING:
    from geo.grid import FarmGrid

LIMIT_VARIABLE = "WBF_MISSION_ENVIRONMENT_CACHE_MB"
DEFAULT_LIMIT_MB = 2000
CACHED_FROM_CELLS = 1_000_000
"""Farms with at least this number of cells are cached; on smaller farms generating is faster than reading."""

_ENTRY = re.compile(r"[0-9a-f]{32}")
_LEFTOVER = re.compile(r"\.[0-9a-f]{32}\.(partial|older)")
_LEFTOVER_AFTER_S = 3600.0


@dataclass(frozen=True, slots=True)
class EnvironmentCache:
    """A cache on disk; files in the cache's folder that are not cache entries are ignored."""

    folder: Path
    limit_bytes: int
    """Limit of the total size of all entries together; 0 turns the cache off."""

    @classmethod
    def of_user(cls) -> EnvironmentCache:
        """Return the cache in the user's cache folder (`geo.system`).

        The variable WBF_MISSION_ENVIRONMENT_CACHE_MB sets the limit (MB, default 2000); 0 turns it off.
        """
        text = os.environ.get(LIMIT_VARIABLE, "").strip() or str(DEFAULT_LIMIT_MB)
        if not (text.isascii() and text.isdecimal() and len(text) <= 9):
            msg = f"{LIMIT_VARIABLE}={text!r} is not a number of megabytes; give a number, or 0 for no cache"
            raise EnvironmentDataError(msg)
        return cls(user_cache_folder("environments"), int(text) * 1_000_000)

    @classmethod
    def off(cls) -> EnvironmentCache:
        """Return a cache that is turned off and stores nothing."""
        return cls(user_cache_folder("environments"), 0)

    def environment(
        self,
        grid: FarmGrid,
        *,
        day: int,
        last_day: int | None = None,
        seed: SeedSequence | int,
        fields: FieldSet = PAPER_FIELDS,
        farm_name: str = "",
        progress: Progress | None = None,
    ) -> tuple[Environment, bool]:
        """Return the environment of days `day` to `last_day` (default: `day`), and whether it was cached.

        An environment that is not cached is generated and saved. If the folder cannot be written, warn with
        `geo.system.CacheWarning`. Raise the errors of `generate_environment`.
        """
        last = day if last_day is None else last_day
        kept = range(day, last + 1)

        def generate() -> Environment:
            return generate_environment(
                grid,
                days=last,
                seed=seed,
                fields=fields,
                keep_days=kept,
                farm_name=farm_name,
                progress=progress,
            )

        if self.limit_bytes <= 0 or grid.crop.size < CACHED_FROM_CELLS:
            return generate(), False
        task = make_task(grid, days=last, seed=seed, fields=fields, keep_days=kept, farm_name=farm_name)
        header = task.header()
        path = self.folder / hashlib.sha256(msgspec.json.encode(header)).hexdigest()[:32]
        try:
            store = open_store(path)
            if store.header == header:
                environment = store.environment(lazy=False)
                with contextlib.suppress(OSError):
                    os.utime(path)
                return environment, True
        except EnvironmentDataError:
            shutil.rmtree(path, ignore_errors=True)
        environment = generate()
        try:
            save_environment(environment, path)
            self._shrink()
        except (EnvironmentDataError, OSError) as error:
            cause = error.__cause__ or error
            # Files that another process is writing for the same entry must not be removed.
            if isinstance(cause, OSError) and not isinstance(cause, BlockingIOError):
                shutil.rmtree(path.with_name(f".{path.name}.partial"), ignore_errors=True)
                warn_of_cache(self.folder, cause)
        return environment, False

    def _shrink(self) -> None:
        """Remove least recently used entries until all entries together are within the limit."""
        entries: list[tuple[float, int, Path]] = []
        for path in self.folder.iterdir():
            if _ENTRY.fullmatch(path.name):
                entries.append((_last_use(path), _size(path), path))
            elif _LEFTOVER.fullmatch(path.name) and _last_use(path) < time.time() - _LEFTOVER_AFTER_S:
                shutil.rmtree(path, ignore_errors=True)
        total = sum(size for _, size, _ in entries)
        for _, size, path in sorted(entries):
            if total <= self.limit_bytes:
                break
            shutil.rmtree(path, ignore_errors=True)
            total -= size


def _last_use(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def _size(path: Path) -> int:
    total = 0
    for folder, _, files in os.walk(path):
        for file in files:
            with contextlib.suppress(OSError):
                total += (Path(folder) / file).stat().st_size
    return total


MOST_ENVIRONMENTS = 2
MOST_CELLS = 100_000
"""Largest farm (cells) that is kept in memory. On larger farms, generating is short compared with a run."""


class EnvironmentMemory:
    """In-memory cache of the small environments that were used last.

    Examples
    --------
    >>> from geo.farms import get_farm
    >>> memory, grid = EnvironmentMemory(), get_farm("miniberry-10").grid()
    >>> first, _ = memory.environment(EnvironmentCache.off(), grid, day=6, last_day=6, seed=1)
    >>> memory.environment(EnvironmentCache.off(), grid, day=6, last_day=6, seed=1)[0] is first
    True
    """

    def __init__(self) -> None:
        self._kept: OrderedDict[bytes, Environment] = OrderedDict()

    def environment(
        self,
        cache: EnvironmentCache,
        grid: FarmGrid,
        *,
        day: int,
        last_day: int,
        seed: SeedSequence | int,
        fields: FieldSet = PAPER_FIELDS,
        progress: Progress | None = None,
    ) -> tuple[Environment, bool]:
        """Return an environment from memory or else from `cache`, and whether it was read from disk.

        Other callers get the same environment, so it must not be changed.
        """
        key = b""
        if grid.crop.size <= MOST_CELLS:
            task = make_task(
                grid, days=last_day, seed=seed, fields=fields, keep_days=range(day, last_day + 1)
            )
            key = msgspec.json.encode(task.header())
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key], False
        made = cache.environment(
            grid, day=day, last_day=last_day, seed=seed, fields=fields, progress=progress
        )
        if key:
            self._kept[key] = made[0]
            while len(self._kept) > MOST_ENVIRONMENTS:
                self._kept.popitem(last=False)
        return made
