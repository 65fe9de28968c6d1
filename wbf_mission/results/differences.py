"""Zarr codec that stores differences of neighbouring cells; smooth fields then compress to a quarter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray
from zarr.abc.codec import ArrayArrayCodec
from zarr.registry import register_codec

if TYPE_CHECKING:
    from zarr.core.array_spec import ArraySpec
    from zarr.core.buffer import NDBuffer

NAME = "wbf_mission.differences"
_COLUMNS = 32


def differences(cells: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return differences along both axes of float32[..., W, H], whose bits are taken as integers modulo 2^32.

    In a smooth field, the differences are a few units in the last place of a value.

    Examples
    --------
    >>> smooth = np.linspace(0.5, 0.9, 12, dtype=np.float32).reshape(3, 4)
    >>> bool((sums(differences(smooth)) == smooth).all())
    True
    """
    bits = np.ascontiguousarray(cells).view(np.uint32)
    found = np.empty_like(bits)
    # A few columns fit into the processor's cache. With one column at a time, this thread would wait for the
    # interpreter's lock thousands of times while another thread draws.
    for first in range(0, bits.shape[-2], _COLUMNS):
        part = bits[..., first : first + _COLUMNS, :]
        along = part.copy()
        if first:
            along[..., 0, :] -= bits[..., first - 1, :]
        np.subtract(part[..., 1:, :], part[..., :-1, :], out=along[..., 1:, :])
        out = found[..., first : first + _COLUMNS, :]
        out[..., 0] = along[..., 0]
        np.subtract(along[..., 1:], along[..., :-1], out=out[..., 1:])
    return found.view(np.float32)


def sums(cells: NDArray[np.float32]) -> NDArray[np.float32]:
    """Invert `differences`, by sums along both axes."""
    bits = np.ascontiguousarray(cells).view(np.uint32)
    found = np.cumsum(bits, axis=-1, dtype=np.uint32)
    for x in range(1, bits.shape[-2]):
        found[..., x, :] += found[..., x - 1, :]
    return found.view(np.float32)


@dataclass(frozen=True)
class Differences(ArrayArrayCodec):
    """Codec that applies `differences` to each chunk."""

    is_fixed_size = True

    @classmethod
    def from_dict(cls, _data: dict[str, Any]) -> Self:
        """Return the codec; its entry in the metadata has no settings."""
        return cls()

    def to_dict(self) -> dict[str, Any]:
        """Return the codec's entry in the metadata of an array."""
        return {"name": NAME}

    def compute_encoded_size(self, input_byte_length: int, _chunk_spec: ArraySpec) -> int:
        """Return the size of an encoded chunk (bytes), which equals the size of the chunk."""
        return input_byte_length

    async def _encode_single(self, chunk_data: NDBuffer, _chunk_spec: ArraySpec) -> NDBuffer:
        return _changed(chunk_data, differences)

    async def _decode_single(self, chunk_data: NDBuffer, _chunk_spec: ArraySpec) -> NDBuffer:
        return _changed(chunk_data, sums)


def _changed(chunk: NDBuffer, change: Callable[[NDArray[np.float32]], NDArray[np.float32]]) -> NDBuffer:
    cells: Any = change(chunk.as_numpy_array())
    return chunk.from_ndarray_like(cells)


register_codec(NAME, Differences)
