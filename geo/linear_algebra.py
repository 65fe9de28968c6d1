"""Linear algebra and elementary functions with the same results to the last bit on every processor.

OpenBLAS and numpy choose code by the processor, so their sums are rounded differently on different
processors. Here terms are added in the order of the index, and elementary functions come from the C library.
Products are computed in blocks of rows that fit the cache; the blocks do not change any sum. Use these
functions wherever results are recorded.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[Any]
_Values = TypeVar("_Values", bound=NDArray[Any])

# Small problems are left to numpy or Python, since importing the compiled code takes a second.
_SHALLOW = 4  # numpy computes products with at most this many terms per sum.
_LIGHT = 100_000  # Products with more multiplications load the compiled code.
_FEW = 64  # Elementary functions of at most this many numbers are computed in Python.


def _kernels() -> Any:
    from geo import linear_algebra_kernels

    return linear_algebra_kernels


def product(a: Floats, b: Floats, out: _Values | None = None) -> Any:
    """Return ``a @ b`` in float32 or float64; `a` is a stack of vectors, and `b` is a vector or matrix.

    If `out` is given, the product is written to this array [n, m] in C order.

    Examples
    --------
    >>> product(np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([10.0, 1.0])).tolist()
    [12.0, 34.0]
    """
    kind = np.result_type(a, b)
    left = np.ascontiguousarray(a.reshape(-1, a.shape[-1]), kind)
    right = np.ascontiguousarray(b[:, None] if b.ndim == 1 else b, kind)
    if left.shape[1] != right.shape[0]:
        raise ValueError(f"a product of {a.shape} and {b.shape}")
    found = np.empty((len(left), right.shape[1]), kind) if out is None else out
    found[...] = 0.0
    loaded = "geo.linear_algebra_kernels" in sys.modules
    if len(right) <= _SHALLOW or (found.size * len(right) <= _LIGHT and not loaded):
        for k, row in enumerate(right):
            found += left[:, k, None] * row
    else:
        add = _kernels().add_product
        add(kind.type(1.0), left, right, found, 0, len(left), 0, len(right), 0, right.shape[1])
    if out is not None:
        return out
    shaped = found.reshape(a.shape[:-1] + b.shape[1:])
    return shaped if shaped.ndim else shaped[()]


def cholesky(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lower Cholesky factor of a symmetric matrix, or raise `numpy.linalg.LinAlgError`."""
    factor: NDArray[np.float64] = _kernels().factor_of(np.ascontiguousarray(matrix, np.float64))
    if len(factor) and not factor[0, 0] > 0.0:
        raise np.linalg.LinAlgError("the matrix is not positive definite")
    return factor


def solve_lower(factor: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve ``factor x = right`` in `right`, float64[n, k] in C order, for a lower triangular `factor`."""
    _kernels().substitute_forward(factor, right, right.shape[1], False)
    return right


def solve_positive(matrix: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve ``matrix x = right`` for a symmetric `matrix`; `right` is a vector or matrix.

    Raise `numpy.linalg.LinAlgError` if the matrix is not positive definite.
    """
    factor = cholesky(matrix)
    columns = np.array(right[:, None] if right.ndim == 1 else right, np.float64, order="C")
    solve_lower(factor, columns)
    # The transposed factor becomes lower triangular when its rows and columns are reversed.
    turned = np.ascontiguousarray(factor.T[::-1, ::-1])
    found = solve_lower(turned, np.ascontiguousarray(columns[::-1]))[::-1]
    return np.ascontiguousarray(found).reshape(right.shape)


def inverse_of_factor(factor: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse of a matrix, given the matrix's lower Cholesky factor."""
    return _kernels().inverse_of_factor(factor)


def _elementwise(function: Callable[[float], float], kernel: str = "") -> Callable[..., Any]:
    """Turn a function of `math` into a function of arrays; `kernel` names the compiled loop."""

    def of_arrays(x: ArrayLike, out: NDArray[Any] | None = None) -> Any:
        values = np.asarray(x)
        if values.dtype != np.float32:
            values = values.astype(np.float64)
        found = np.empty(values.shape, values.dtype)
        if kernel and (values.size > _FEW or values.dtype == np.float32 or not _is_tame(values)):
            getattr(_kernels(), kernel)(np.ascontiguousarray(values).reshape(-1), found.reshape(-1))
        else:
            found.reshape(-1)[:] = [function(value) for value in values.reshape(-1).tolist()]
        if out is not None:
            out[...] = found
            return out
        return found if found.ndim else found[()]

    of_arrays.__name__ = function.__name__
    of_arrays.__doc__ = f"Return ``math.{function.__name__}`` of each number of an array, in its precision."
    return of_arrays


def _is_tame(values: Floats) -> bool:
    """Return whether `math.exp` and `math.log` accept all values: exp overflows above 709, log fails at 0."""
    return bool((np.abs(values) < 700.0).all()) and bool((values != 0.0).all())


def arctan2(y: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``math.atan2`` of each pair of elements of two vectors."""
    return np.array([math.atan2(*pair) for pair in zip(y.tolist(), x.tolist(), strict=True)])


exp = _elementwise(math.exp, "each_exp")
log = _elementwise(math.log, "each_log")
sin = _elementwise(math.sin, "each_sin")
cos = _elementwise(math.cos)
expm1 = _elementwise(math.expm1)
