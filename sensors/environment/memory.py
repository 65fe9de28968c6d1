"""Environments kept in memory, for runs of one process that follow one another on the same one."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING

import msgspec
from numpy.random import SeedSequence

from sensors.environment.cache import EnvironmentCache
from sensors.environment.environment import Environment
from sensors.environment.generate import Progress, make_task
from sensors.fields import PAPER_FIELDS, FieldSet

if TYPE_CHECKING:
    from geo.grid import FarmGrid

__all__ = ["EnvironmentMemory"]

MOST_ENVIRONMENTS = 2
MOST_CELLS = 100_000
"""Larger farms are not kept: their runs take so long that an environment anew is nothing beside them."""


class EnvironmentMemory:
    """Keeps the small environments that were used last.

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
        """Return the environment that was kept, or the cache's, which is kept if it is small.

        Parameters
        ----------
        cache : EnvironmentCache
            Where it is taken from, or generated.
        grid, day, last_day, seed, fields, progress
            As for `EnvironmentCache.environment`.

        Returns
        -------
        environment : Environment
            Others have it, too: it is not to be changed.
        cached : bool
            Whether it came from the cache's folder.

        Raises
        ------
        EnvironmentDataError, geo.memory.NotEnoughMemoryError
            As `EnvironmentCache.environment`.
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
