"""Fields of a large farm, which are read at each access and take no memory in between."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

Read = Callable[[int, slice], NDArray[Any]]
LARGE_FROM_CELLS = 1_000_000
"""For farms with at least this number of cells, truth and masks are read anew at each access."""


class LazyFields(NDArrayOperatorsMixin):
    """A read-only array [n, W, H] whose values are read anew at each access.

    Parameters
    ----------
    shape : tuple of int
        Number of fields, width and height of the farm.
    read : callable
        Function of a field's number and a slice of the farm's columns that returns an array [columns, H]. The
        slice has a start, a stop and no step.
    dtype : type
        Type of the elements.

    Examples
    --------
    >>> lazy = LazyFields((2, 4, 3), lambda field, columns: np.full((4, 3), field, np.float32)[columns])
    >>> lazy[1, 2:].shape, float(lazy[1, 0, 2]), (lazy - 1.0).max(), lazy[:, ::2].shape
    ((2, 3), 1.0, np.float32(0.0), (2, 2, 3))
    """

    ndim = 3

    def __init__(self, shape: tuple[int, int, int], read: Read, dtype: type = np.float32) -> None:
        self.shape, self._read, self.dtype = shape, read, np.dtype(dtype)

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: Any) -> Any:
        field, *rest = key if isinstance(key, tuple) else (key,)
        if field is Ellipsis:
            field, rest = slice(None), [slice(None)] * (2 - len(rest)) + rest
        if not isinstance(field, int | np.integer):
            return np.stack([self[(k, *rest)] for k in np.arange(len(self))[field]])
        if not -len(self) <= field < len(self):
            raise IndexError(f"field {field}: the array has {len(self)} fields")
        columns = slice(0, self.shape[1])
        if rest and isinstance(rest[0], slice) and rest[0].step in (None, 1):
            columns = slice(*rest[0].indices(self.shape[1])[:2])
            rest[0] = slice(None)
        return self._read(int(field) % len(self), columns)[tuple(rest)]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        found = np.empty(self.shape, self.dtype)
        for k, field in enumerate(found):
            field[:] = self[k]
        return found if dtype is None else found.astype(dtype, copy=False)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        arrays = [np.asarray(given) if given is self else given for given in inputs]
        return getattr(ufunc, method)(*arrays, **kwargs)

    def __getattr__(self, name: str) -> Any:
        # Other attributes, such as mean(), come from the array that is read
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(np.asarray(self), name)
