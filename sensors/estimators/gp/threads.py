"""Threads for the Gaussian process: several over tiles, one within a matrix.

SciPy's own wrappers of LAPACK and BLAS keep the interpreter's lock; `ctypes` lets go of it. NumPy's do, too,
but are another library of which the last bits differ.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from sensors.estimators.gp.rbf import Floats

_PARTS_PER_CORE = 8

Part = TypeVar("Part")


@cache
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


@cache
def _function(library: str, name: str, arguments: int) -> Callable[..., None]:
    """Return a function of SciPy's linear algebra that takes pointers."""
    from numba.extending import get_cython_function_address

    address = get_cython_function_address(f"scipy.linalg.cython_{library}", name)
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)(address)


def factor_in_place(positive: NDArray[np.floating]) -> NDArray[np.floating]:
    """Write the lower Cholesky factor of a matrix over its lower triangle; what is above stays as it was."""
    size, failed = ctypes.byref(ctypes.c_int(len(positive))), ctypes.c_int()
    # LAPACK counts along columns first, and sees the transposed matrix: the upper factor of that.
    _function("lapack", "dpotrf", 5)(b"U", size, positive.ctypes.data, size, ctypes.byref(failed))
    if failed.value:
        msg = "the matrix is not positive definite"
        raise np.linalg.LinAlgError(msg)
    return positive


def outer_product(rows: NDArray[np.floating]) -> Floats:
    """Return ``rows @ rows.T``."""
    out = np.empty((len(rows), len(rows)))
    n, k = (ctypes.byref(ctypes.c_int(size)) for size in rows.shape)
    one, zero = ctypes.byref(ctypes.c_double(1.0)), ctypes.byref(ctypes.c_double(0.0))
    of_rows = rows.ctypes.data, k
    _function("blas", "dgemm", 13)(b"T", b"N", n, n, k, one, *of_rows, *of_rows, zero, out.ctypes.data, n)
    return out
