"""Compiled kernels of `geo.linear_algebra`; they add in index order, in blocks that fit the cache."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled

Floats = NDArray[Any]

# Rows and columns per block; measurements showed that a block of this size stays in the cache.
_BLOCK = 48
_PANEL = 512


@compiled(nogil=True, allocates=False)
def add_product(
    scale: float, a: Floats, b: Floats, out: Floats, i0: int, i1: int, k0: int, k1: int, j0: int, j1: int
) -> None:
    """Add ``scale a[i, k] b[k, j]`` to ``out[i, j]`` in the order of k; `scale` is 1 or -1.

    `scale` has the type of the arrays. Four rows and four terms are processed at a time, so that each number
    that is loaded serves in four sums.
    """
    for first in range(j0, j1, _PANEL):
        last = min(first + _PANEL, j1)
        width = last - first
        i = i0
        while i + 4 <= i1:
            out0, out1 = out[i, first:last], out[i + 1, first:last]
            out2, out3 = out[i + 2, first:last], out[i + 3, first:last]
            k = k0
            while k + 4 <= k1:
                a00, a01 = scale * a[i, k], scale * a[i, k + 1]
                a02, a03 = scale * a[i, k + 2], scale * a[i, k + 3]
                a10, a11 = scale * a[i + 1, k], scale * a[i + 1, k + 1]
                a12, a13 = scale * a[i + 1, k + 2], scale * a[i + 1, k + 3]
                a20, a21 = scale * a[i + 2, k], scale * a[i + 2, k + 1]
                a22, a23 = scale * a[i + 2, k + 2], scale * a[i + 2, k + 3]
                a30, a31 = scale * a[i + 3, k], scale * a[i + 3, k + 1]
                a32, a33 = scale * a[i + 3, k + 2], scale * a[i + 3, k + 3]
                b0, b1 = b[k, first:last], b[k + 1, first:last]
                b2, b3 = b[k + 2, first:last], b[k + 3, first:last]
                for j in range(width):
                    x0, x1, x2, x3 = b0[j], b1[j], b2[j], b3[j]
                    out0[j] = (((out0[j] + a00 * x0) + a01 * x1) + a02 * x2) + a03 * x3
                    out1[j] = (((out1[j] + a10 * x0) + a11 * x1) + a12 * x2) + a13 * x3
                    out2[j] = (((out2[j] + a20 * x0) + a21 * x1) + a22 * x2) + a23 * x3
                    out3[j] = (((out3[j] + a30 * x0) + a31 * x1) + a32 * x2) + a33 * x3
                k += 4
            while k < k1:
                a0, a1 = scale * a[i, k], scale * a[i + 1, k]
                a2, a3 = scale * a[i + 2, k], scale * a[i + 3, k]
                row = b[k, first:last]
                for j in range(width):
                    x = row[j]
                    out0[j] += a0 * x
                    out1[j] += a1 * x
                    out2[j] += a2 * x
                    out3[j] += a3 * x
                k += 1
            i += 4
        while i < i1:
            target = out[i, first:last]
            k = k0
            while k + 4 <= k1:
                a0, a1 = scale * a[i, k], scale * a[i, k + 1]
                a2, a3 = scale * a[i, k + 2], scale * a[i, k + 3]
                b0, b1 = b[k, first:last], b[k + 1, first:last]
                b2, b3 = b[k + 2, first:last], b[k + 3, first:last]
                for j in range(width):
                    target[j] = (((target[j] + a0 * b0[j]) + a1 * b1[j]) + a2 * b2[j]) + a3 * b3[j]
                k += 4
            while k < k1:
                a0, row = scale * a[i, k], b[k, first:last]
                for j in range(width):
                    target[j] += a0 * row[j]
                k += 1
            i += 1


@compiled(nogil=True, allocates=False)
def substitute_forward(factor: Floats, right: Floats, columns: int, triangular: bool) -> None:
    """Solve ``factor x = right`` in `right` for its first `columns` columns; `factor` is lower triangular.

    `triangular` says that `right` is itself a lower triangular matrix of the size of `factor`.
    """
    n, minus = len(factor), right.dtype.type(-1.0)
    for first in range(0, n, _BLOCK):
        last = min(first + _BLOCK, n)
        width = min(columns, last) if triangular else columns
        for i in range(first, last):
            add_product(minus, factor, right, right, i, i + 1, first, i, 0, width)
            inverse = right.dtype.type(1.0) / factor[i, i]
            for j in range(width):
                right[i, j] *= inverse
        add_product(minus, factor, right, right, last, n, first, last, 0, width)


@compiled(nogil=True)
def factor_of(matrix: Floats) -> Floats:
    """Return the lower Cholesky factor of a symmetric matrix; all NaN if none exists."""
    n = len(matrix)
    upper = matrix.copy()
    turned = upper.T
    for first in range(0, n, _BLOCK):
        last = min(first + _BLOCK, n)
        for i in range(first, last):
            add_product(-1.0, turned, upper, upper, i, i + 1, first, i, i, n)
            if not 0.0 < upper[i, i] < np.inf:
                upper[:] = np.nan
                return upper
            root = math.sqrt(upper[i, i])
            upper[i, i] = root
            inverse = 1.0 / root
            for j in range(i + 1, n):
                upper[i, j] *= inverse
        for i in range(last, n, _BLOCK):
            add_product(-1.0, turned, upper, upper, i, min(i + _BLOCK, n), first, last, i, n)
    factor = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            factor[i, j] = upper[j, i]
    return factor


@compiled(nogil=True)
def inverse_of_factor(factor: Floats) -> Floats:
    """Return the inverse of a matrix, given the matrix's lower Cholesky factor."""
    n = len(factor)
    half, inverse = np.eye(n), np.zeros((n, n))
    substitute_forward(factor, half, n, True)
    turned = half.T
    for first in range(0, n, _BLOCK):
        last = min(first + _BLOCK, n)
        for i in range(0, last, _BLOCK):
            add_product(1.0, turned, half, inverse, i, min(i + _BLOCK, last), first, last, i, last)
    for i in range(n):
        for j in range(i):
            inverse[i, j] = inverse[j, i]
    return inverse


@compiled(nogil=True, allocates=False)
def each_exp(x: Floats, out: Floats) -> None:
    """Write ``math.exp`` of each number of `x` to `out`."""
    for i in range(len(x)):
        out[i] = math.exp(x[i])


@compiled(nogil=True, allocates=False)
def each_log(x: Floats, out: Floats) -> None:
    """Write ``math.log`` of each number of `x` to `out`."""
    for i in range(len(x)):
        out[i] = math.log(x[i])


@compiled(nogil=True, allocates=False)
def each_sin(x: Floats, out: Floats) -> None:
    """Write ``math.sin`` of each number of `x` to `out`."""
    for i in range(len(x)):
        out[i] = math.sin(x[i])
