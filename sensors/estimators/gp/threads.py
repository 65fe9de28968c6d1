"""Threads for the Gaussian process: several over tiles, one within a matrix."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import lru_cache
from typing import Any, TypeVar

_PARTS_PER_CORE = 8

Part = TypeVar("Part")


@lru_cache(maxsize=1)
def _controller() -> Any:
    # SciPy brings linear algebra of its own, which has to be there to be found.
    import scipy.linalg  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def one_blas_thread() -> AbstractContextManager[Any]:
    """Keep linear algebra on one thread: over small matrices, threads wait for each other too long."""
    limited: AbstractContextManager[Any] = _controller().limit(limits=1, user_api="blas")
    return limited


def in_parallel(work: Callable[[Sequence[Part]], None], items: Sequence[Part]) -> None:
    """Do work on all items, in parts on all cores; it has to release the interpreter's lock."""
    cores = os.cpu_count() or 1
    if len(items) < 2 or cores == 1:
        with one_blas_thread():
            work(items)
        return
    size = max(1, len(items) // (_PARTS_PER_CORE * cores))
    parts = [items[start : start + size] for start in range(0, len(items), size)]
    with one_blas_thread(), ThreadPoolExecutor(cores) as pool:
        for done in [pool.submit(work, part) for part in parts]:
            done.result()
