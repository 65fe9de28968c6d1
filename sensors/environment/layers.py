"""Layers: arrays over a farm, in memory or in compressed chunks on disk.

Chunks decoded for single cells are kept in a least-recently-used cache, so that a camera decodes each chunk
along its path only once.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", bound=np.generic)
S_co = TypeVar("S_co", bound=np.generic, covariant=True)

Read = Callable[[slice, slice], NDArray[T]]


class Layer(Protocol[S_co]):
    """An array over the farm, ``[x, y]``."""

    def whole(self) -> NDArray[S_co]:
        """Return the array, read-only."""

    def window(self, x: slice, y: slice) -> NDArray[S_co]:
        """Return a window; both slices have a start and a stop on the farm and no step."""

    def cells(self, x: NDArray[np.integer], y: NDArray[np.integer]) -> NDArray[S_co]:
        """Return the values of n cells on the farm, [n]."""

    def cell(self, x: int, y: int) -> Any:
        """Return the value of a cell on the farm as a Python number."""


class ArrayLayer(Generic[T]):
    """A layer in memory, or memory-mapped from a file."""

    __slots__ = ("_array",)

    def __init__(self, array: NDArray[T]) -> None:
        self._array = np.ascontiguousarray(array).view()
        self._array.flags.writeable = False

    def whole(self) -> NDArray[T]:
        """Return the array, read-only."""
        return self._array

    def window(self, x: slice, y: slice) -> NDArray[T]:
        """Return a view of the window."""
        part: NDArray[T] = self._array[x, y]
        return part

    def cells(self, x: NDArray[np.integer], y: NDArray[np.integer]) -> NDArray[T]:
        """Return the values of n cells, [n]."""
        found: NDArray[T] = self._array[x, y]
        return found

    def cell(self, x: int, y: int) -> Any:
        """Return the value of a cell as a Python number."""
        return self._array.item(x, y)


class ChunkCache:
    """Cache of the most recently used chunks, thread-safe."""

    __slots__ = ("_bytes", "_chunks", "_limit", "_lock")

    def __init__(self, limit_bytes: int) -> None:
        self._limit = limit_bytes
        self._bytes = 0
        self._chunks: OrderedDict[tuple[str, int, int], NDArray[Any]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: tuple[str, int, int], decode: Callable[[], NDArray[Any]]) -> NDArray[Any]:
        """Return a chunk, decoded now if it is not cached."""
        with self._lock:
            chunk = self._chunks.get(key)
            if chunk is not None:
                self._chunks.move_to_end(key)
                return chunk
        chunk = decode()
        with self._lock:
            if key not in self._chunks:
                self._chunks[key] = chunk
                self._bytes += chunk.nbytes
            while self._bytes > self._limit and len(self._chunks) > 1:
                self._bytes -= self._chunks.popitem(last=False)[1].nbytes
        return chunk


class ChunkedLayer(Generic[T]):
    """A layer on disk that is decoded on demand, chunk by chunk."""

    __slots__ = ("_cache", "_chunk", "_name", "_read", "_shape")

    def __init__(
        self, name: str, shape: tuple[int, int], chunk: tuple[int, int], read: Read[T], cache: ChunkCache
    ) -> None:
        self._name = name
        self._shape = shape
        self._chunk = chunk
        self._read = read
        self._cache = cache

    def whole(self) -> NDArray[T]:
        """Decode and return the whole array, without caching."""
        array = self._read(slice(0, self._shape[0]), slice(0, self._shape[1]))
        array.flags.writeable = False
        return array

    def window(self, x: slice, y: slice) -> NDArray[T]:
        """Decode the chunks that the window touches, and return the window."""
        return self._read(x, y)

    def _decoded(self, column: int, row: int) -> NDArray[T]:
        def decode() -> NDArray[Any]:
            start_x, start_y = column * self._chunk[0], row * self._chunk[1]
            return self._read(
                slice(start_x, min(start_x + self._chunk[0], self._shape[0])),
                slice(start_y, min(start_y + self._chunk[1], self._shape[1])),
            )

        return cast("NDArray[T]", self._cache.get((self._name, column, row), decode))

    def cell(self, x: int, y: int) -> Any:
        """Return the value of a cell as a Python number."""
        width, height = self._chunk
        (column, at_x), (row, at_y) = divmod(x, width), divmod(y, height)
        return self._decoded(column, row).item(at_x, at_y)

    def cells(self, x: NDArray[np.integer], y: NDArray[np.integer]) -> NDArray[T]:
        """Return the values of n cells, [n], decoded chunk by chunk."""
        width, height = self._chunk
        column, row = x // width, y // height
        at_x, at_y = int(column[0]), int(row[0])
        first = self._decoded(at_x, at_y)
        if x.size == 1 or ((column == at_x).all() and (row == at_y).all()):
            alone: NDArray[T] = first[x - at_x * width, y - at_y * height]
            return alone
        found: NDArray[T] = np.empty(x.size, first.dtype)
        number = column * np.int64(-(-self._shape[1] // height)) + row
        order = np.argsort(number, kind="stable")
        starts = np.flatnonzero(np.diff(number[order], prepend=-1))
        for start, stop in zip(starts, [*starts[1:], x.size], strict=True):
            part = order[start:stop]
            at_x, at_y = int(column[part[0]]), int(row[part[0]])
            chunk = self._decoded(at_x, at_y)
            found[part] = chunk[x[part] - at_x * width, y[part] - at_y * height]
        return found
