"""Arrays over a farm in files: one Zarr array in a ZIP archive, compressed without loss.

Most of an information model of a large farm is the same number, so it takes a fifth of its size in memory and
is written faster than it would be uncompressed. `read_array` reads it, and so does any other program by
``zarr.open_array(zarr.storage.ZipStore(path), mode="r")``.
"""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo.atomic import atomic_path
from geo.errors import WbfMissionError

SUFFIX = ".zarr.zip"
_CHUNK_CELLS = 4_000_000
_DIMENSIONS = ("day", "field", "x", "y")


class ArrayFileError(WbfMissionError, ValueError):
    """A file that is not an array of a run."""


def write_array(path: Path, array: NDArray[np.floating], fields: Sequence[str]) -> None:
    """Write an array over a farm, complete or not at all.

    Parameters
    ----------
    path : Path
        The file to make or replace.
    array : float[n, W, H] or float[days, n, W, H]
        Written as float32.
    fields : sequence of str
        Names of the n fields; kept as the attribute ``fields``.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    import zarr
    from zarr.codecs import BloscCodec
    from zarr.storage import ZipStore

    array = np.asarray(array, np.float32)
    *several, width, height = array.shape
    columns = max(1, min(width, _CHUNK_CELLS // max(1, height)))
    with atomic_path(path) as temporary, ZipStore(temporary, mode="w") as store:
        zarr.create_array(
            store,
            data=array,
            chunks=(*(1 for _ in several), columns, height),
            # The fastest codec of Blosc: it loses 10 % in size to the others and takes a third of their time.
            compressors=BloscCodec(cname="lz4", clevel=1, shuffle="shuffle", typesize=4),
            dimension_names=_DIMENSIONS[-array.ndim :],
            attributes={"fields": list(fields)},
        )


def read_array(path: Path, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Read an array of a known shape.

    Raises
    ------
    ArrayFileError
        If the file is not one that `write_array` wrote, or its shape is another one.
    """
    import zarr
    from zarr.storage import ZipStore

    if not zipfile.is_zipfile(path):
        msg = f"{path}: cannot be read as an array of a run: no file, or not an archive"
        raise ArrayFileError(msg)
    try:
        with ZipStore(path, mode="r") as store:
            stored: Any = zarr.open_array(store, mode="r", zarr_format=3)
            if stored.shape != shape or stored.dtype != np.float32:
                msg = f"{path}: {stored.dtype}{list(stored.shape)}, expected float32{list(shape)}"
                raise ArrayFileError(msg)
            return np.asarray(stored[:], np.float32)
    except ArrayFileError:
        raise
    except Exception as error:  # what zarr raises on hostile metadata is not bounded
        msg = f"{path}: not an array of a run ({type(error).__name__}: {error})"
        raise ArrayFileError(msg) from error
