"""Copying and clearing parts of rows in compiled code.

Loops that become part of their callers: numba takes long to compile each assignment to a slice.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geo.compiled import compiled

__all__ = ["clear", "copy"]

Floats = NDArray[np.float64]


@compiled(inline="always")
def copy(to: Floats, first: int, source: Floats, begin: int, count: int) -> None:
    """Copy ``count`` numbers, from ``begin`` of a row to ``first`` of another, without overlap."""
    for k in range(count):
        to[first + k] = source[begin + k]


@compiled(inline="always")
def clear(row: Floats, begin: int, end: int) -> None:
    """Set the numbers ``begin`` up to, not including, ``end`` of a row to 0."""
    for k in range(begin, end):
        row[k] = 0.0
