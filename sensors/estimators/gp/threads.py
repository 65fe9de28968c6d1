"""Threads for the Gaussian process, over tiles."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

_PARTS_PER_CORE = 8

Part = TypeVar("Part")


def in_parallel(work: Callable[[Sequence[Part]], None], items: Sequence[Part]) -> None:
    """Do work on all items, in parts on all cores; it has to release the interpreter's lock."""
    cores = os.cpu_count() or 1
    if len(items) < 2 or cores == 1:
        work(items)
        return
    size = max(1, len(items) // (_PARTS_PER_CORE * cores))
    parts = [items[start : start + size] for start in range(0, len(items), size)]
    with ThreadPoolExecutor(cores) as pool:
        for done in [pool.submit(work, part) for part in parts]:
            done.result()
