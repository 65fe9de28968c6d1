"""An array that grows at its end in amortised constant time per row."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray


class GrowingArray:
    """An array with amortised appending of rows.

    Examples
    --------
    >>> rows = GrowingArray((), np.int32)
    >>> rows.append([1, 2]); rows.append([3])
    >>> rows.array.tolist()
    [1, 2, 3]
    """

    def __init__(self, row_shape: tuple[int, ...], dtype: DTypeLike) -> None:
        self._buffer = np.empty((0, *row_shape), dtype)
        self._rows = 0

    def __len__(self) -> int:
        return self._rows

    @property
    def array(self) -> NDArray[Any]:
        """View of the current rows, without rows appended later."""
        return self._buffer[: self._rows]

    def append(self, rows: ArrayLike) -> None:
        """Append rows at the end."""
        new = np.asarray(rows)
        total = self._rows + len(new)
        if total > len(self._buffer):
            buffer = np.empty(
                (max(total, len(self._buffer) * 3 // 2), *self._buffer.shape[1:]), self._buffer.dtype
            )
            buffer[: self._rows] = self.array
            self._buffer = buffer
        self._buffer[self._rows : total] = new
        self._rows = total
