"""Rows of numbers by the names of their columns, for compiled code and for what surrounds it.

The columns of a row are an `IntEnum`: code that handles whole arrays takes its members as indices, and a
kernel gets the row as a record with an attribute for each, ``state.position_x``. A record is one pointer, an
array seven numbers, and a column by its name is compiled twice as fast as one by its index.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Record", "record_of", "record_type", "records_of"]

Record = Any
"""A row in a kernel; its attributes are the columns in lower case."""


def record_type(*columns: type[IntEnum]) -> np.dtype[Any]:
    """Return the type of a row that has these columns, one after the other.

    Examples
    --------
    >>> record_type(IntEnum("Leg", ["LEFT_M", "HEADING"], start=0)).names
    ('left_m', 'heading')
    """
    names = [column.name.lower() for each in columns for column in each]
    return np.dtype((np.record, [(name, np.float64) for name in names]), align=True)


def record_of(row: NDArray[np.float64], kind: np.dtype[Any]) -> Record:
    """Return a row, float64[n], as a record that shares its memory."""
    return row.view(kind)[0]


def records_of(rows: NDArray[np.float64], kind: np.dtype[Any]) -> NDArray[Any]:
    """Return rows, float64[..., n], as an array of records that share their memory."""
    return rows.view(kind)[..., 0]
