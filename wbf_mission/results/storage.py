"""Arrays and tables in files: written atomically, validated on reading."""

from __future__ import annotations

import contextlib
import io
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from geo.atomic import atomic_path, atomic_write
from geo.errors import WbfMissionError
from sensors.fields import FieldSet
from sensors.lazy_fields import LazyFields
from sensors.observations import MAX_FILE_ROWS
from wbf_mission.maps.blocks import MapGrid
from wbf_mission.maps.field_maps import FieldMap

_BATCH_ROWS = 256
_MOST_PARTS, _MOST_VALUES, _MOST_BYTES = 1000, 50_000_000, 2**29


class ResultError(WbfMissionError, ValueError):
    """Raised if a folder has no result, or a result that cannot be read or must not be replaced."""


def write_table(path: Path, table: Any, *, group_rows: int | None = None) -> None:
    """Write a pyarrow table as Parquet, in row groups of `group_rows` rows."""
    import pyarrow.parquet as pq

    with atomic_write(path, "wb") as stream:
        pq.write_table(table, stream, compression="zstd", row_group_size=group_rows)


def table_bytes(table: Any) -> bytes:
    """Return a pyarrow table as the bytes of a Parquet file."""
    import pyarrow.parquet as pq

    stream = io.BytesIO()
    pq.write_table(table, stream, compression="zstd")
    return stream.getvalue()


def read_table(path: Path, columns: tuple[str, ...]) -> Any:
    """Read columns of a Parquet file as a pyarrow table."""
    with _opened(path, columns) as file:
        table = file.read(columns=list(columns))
        table.validate(full=True)
        empty = [name for name in columns if table.column(name).null_count]
        if empty:
            raise ResultError(f"{path}: column {empty[0]} has rows without a value")
        return table


def read_batches(path: Path, columns: tuple[str, ...], content: bytes | None = None) -> Iterator[Any]:
    """Read all columns of a Parquet file in pyarrow record batches of a few hundred rows.

    If the file's bytes are given as `content`, they are untrusted, so their unpacked size is limited.
    """
    with _opened(path, columns, content) as file:
        for batch in file.iter_batches(batch_size=_BATCH_ROWS):
            batch.validate(full=True)
            yield batch


@contextlib.contextmanager
def _opened(path: Path, columns: tuple[str, ...], content: bytes | None = None) -> Iterator[Any]:
    """Open a Parquet file; any error on opening or reading becomes a ResultError.

    Readers must still validate tables, because pyarrow reports invalid text only on access.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path if content is None else pa.BufferReader(content)) as file:
            missing = [name for name in columns if name not in file.schema_arrow.names]
            if missing:
                raise ResultError(f"{path}: no column {missing[0]}")
            rows = file.metadata.num_rows
            if rows > MAX_FILE_ROWS:
                raise ResultError(f"{path}: claims {rows} rows, more than the limit of {MAX_FILE_ROWS}")
            if content is not None:
                _require_bounded(path, file.metadata)
            yield file
    except ResultError:
        raise
    # pyarrow raises ValueError for a column name that is not UTF-8.
    except (pa.ArrowException, OSError, ValueError) as error:
        msg = f"{path}: is not a Parquet file that can be read ({str(error).splitlines()[0]})"
        raise ResultError(msg) from None


def _require_bounded(path: Path, metadata: Any) -> None:
    """Raise ResultError if a table unpacks to too many values or bytes, as even a small file may."""
    groups, columns = metadata.num_row_groups, metadata.num_columns
    if max(groups, columns) > _MOST_PARTS:
        raise ResultError(f"{path}: has {groups} row groups of {columns} columns, too many to be read")
    chunks = [metadata.row_group(g).column(c) for g in range(groups) for c in range(columns)]
    values = sum(one.num_values for one in chunks)
    if values > _MOST_VALUES or sum(one.total_uncompressed_size for one in chunks) > _MOST_BYTES:
        raise ResultError(f"{path}: unpacks to {values} values, more than the limit of {_MOST_VALUES}")


SUFFIX = ".zarr.zip"
_CHUNK_CELLS = 1_000_000  # A chunk has 4 MB, and several copies of it exist while it is packed
_DIMENSIONS = ("day", "field", "x", "y")


class ArrayFileError(WbfMissionError, ValueError):
    """Raised if a file is not an array of a run."""


def write_array(
    path: Path, array: NDArray[np.floating] | list[NDArray[np.floating]], fields: Sequence[str]
) -> None:
    """Write one array over a farm, float[n, W, H], or one for each day, as float32 and atomically."""
    days = array if isinstance(array, list) else [array]
    shape = (len(days), *days[0].shape) if isinstance(array, list) else array.shape

    def strip(columns: slice) -> Iterator[NDArray[np.floating]]:
        return (day[k, columns] for day in days for k in range(len(day)))

    write_strips(path, strip, shape, fields)


def write_strips(
    path: Path,
    strip: Callable[[slice], Iterable[NDArray[np.floating]]],
    shape: tuple[int, ...],
    fields: Sequence[str],
) -> None:
    """Write an array as `write_array` does; `strip` yields the given columns of each plane [W, H]."""
    import zarr
    from zarr.codecs import BloscCodec
    from zarr.storage import ZipStore

    from wbf_mission.results.differences import Differences

    *several, width, height = shape
    columns = max(1, min(width, _CHUNK_CELLS // max(1, height)))
    with atomic_path(path) as temporary, ZipStore(temporary, mode="w") as store:
        stored = zarr.create_array(
            store,
            shape=shape,
            dtype=np.float32,
            chunks=(*(1 for _ in several), columns, height),
            filters=[Differences()],
            # This order of bits compresses well: in differences of smooth fields, most bit planes are zero.
            # Blocks of 1 MiB take half the time of Blosc's own choice, 32 KiB: zstd starts anew in each.
            compressors=BloscCodec(cname="zstd", clevel=1, shuffle="bitshuffle", typesize=4, blocksize=2**20),
            dimension_names=_DIMENSIONS[-len(shape) :],
            attributes={"fields": list(fields)},
            # By default, zarr would first compare each chunk with the fill value.
            config={"write_empty_chunks": True},
        )
        for first in range(0, width, columns):
            part = slice(first, min(first + columns, width))
            # zarr would copy ten chunks at once; it copies none if the value has the shape of a chunk.
            for where, values in zip(np.ndindex(*several), strip(part), strict=True):
                chunk = np.asarray(values, np.float32)[(np.newaxis,) * len(several)]
                stored[(*(slice(k, k + 1) for k in where), part)] = chunk
                del values, chunk  # Frees this plane before the next is made


def read_array(
    path: Path, shape: tuple[int, ...], field: int | None = None, columns: slice | None = None
) -> NDArray[np.float32]:
    """Read an array, or columns of a field; ArrayFileError if the array has another shape or is damaged."""
    import zarr
    from zarr.storage import ZipStore

    import wbf_mission.results.differences  # noqa: F401 (makes the codec known to zarr)

    if not zipfile.is_zipfile(path):
        raise ArrayFileError(f"{path}: cannot be read as an array of a run: no file, or not an archive")
    try:
        with ZipStore(path, mode="r") as store:
            stored: Any = zarr.open_array(store, mode="r", zarr_format=3)
            if stored.shape != shape or stored.dtype != np.float32:
                msg = f"{path}: {stored.dtype}{list(stored.shape)}, expected float32{list(shape)}"
                raise ArrayFileError(msg)
            columns = slice(0, shape[-2]) if columns is None else columns
            several = [(field,)] if field is not None else list(np.ndindex(shape[:-2]))
            found = np.empty((len(several), columns.stop - columns.start, shape[-1]), np.float32)
            # Chunks are read one by one, because zarr would unpack ten at once, with three copies of each.
            chunk = stored.chunks[-2]
            for out, where in zip(found, several, strict=True):
                for x in range(columns.start // chunk * chunk, columns.stop, chunk):
                    part = slice(max(x, columns.start), min(x + chunk, columns.stop))
                    out[part.start - columns.start : part.stop - columns.start] = stored[(*where, part)]
            return found[0] if field is not None else found.reshape(shape)
    except ArrayFileError:
        raise
    except Exception as error:  # zarr may raise anything on hostile metadata
        raise ArrayFileError(f"{path}: not an array of a run ({type(error).__name__}: {error})") from error


def lazy_array(path: Path, shape: tuple[int, int, int]) -> NDArray[np.float32]:
    """Return an array that is read at each access; this call and each access raise as `read_array` does."""
    read_array(path, shape, 0, slice(0, 0))
    lazy = LazyFields(shape, partial(read_array, path, shape))
    return cast("NDArray[np.float32]", lazy)


_OPTIONAL = ("variance", "may_be_sick", "seen_total")
_BLOCKS = ("cells", "total", "least", "seen", "seen_sick", *_OPTIONAL)
_ARRAYS = (*_BLOCKS, "finds", "together")
_MAX_MEMBER_BYTES = 64 * 2**20


def write_maps(path: Path, maps: dict[str, tuple[FieldMap, ...]]) -> None:
    """Write maps with one value per pixel; arrays are named KIND.FIELD.ARRAY."""
    arrays = {
        f"{kind}.{one.field.name}.{name}": getattr(one, name)
        for kind, of_kind in maps.items()
        for one in of_kind
        for name in _ARRAYS
        if getattr(one, name) is not None
    }
    with atomic_write(path, "wb") as stream:
        np.savez_compressed(stream, **arrays)


def read_maps(path: Path, kind: str, farm: Farm, fields: FieldSet) -> tuple[FieldMap, ...]:
    """Read the maps of a kind ("estimate" or "truth"); empty without a file."""
    if not path.is_file():
        return ()
    try:
        with zipfile.ZipFile(path) as archive:
            if any(member.file_size > _MAX_MEMBER_BYTES for member in archive.infolist()):
                raise ValueError(f"an array is larger than {_MAX_MEMBER_BYTES // 2**20} MiB")
        with np.load(path, allow_pickle=False) as arrays:
            there = [name.split(".")[1] for name in arrays if name.startswith(f"{kind}.")]
            return tuple(_map(arrays, f"{kind}.{name}", fields[name], farm) for name in dict.fromkeys(there))
    except Exception as error:  # numpy and zipfile may raise anything on hostile archives
        msg = f"{path}: cannot be read as the maps of a run ({type(error).__name__}: {error})"
        raise ValueError(msg) from error


def _map(arrays: Any, prefix: str, field: Any, farm: Farm) -> FieldMap:
    grid = MapGrid.of(farm)
    values: dict[str, Any] = {name: arrays.get(f"{prefix}.{name}") for name in _ARRAYS}
    for name in _BLOCKS:
        _check(prefix, name, values[name], grid.pixels, optional=name in _OPTIONAL)
    _check(prefix, "finds", values["finds"], (None, 2), integer=True)
    _check(prefix, "together", values["together"], ())
    return FieldMap(field, grid, **{**values, "together": float(values["together"])})


def _check(
    prefix: str,
    name: str,
    array: NDArray[Any] | None,
    shape: tuple[int | None, ...],
    *,
    optional: bool = False,
    integer: bool = False,
) -> None:
    """Raise an error if an array is missing, or its shape or type is wrong."""
    if array is None and optional:
        return
    wanted = np.int32 if integer else np.float64
    if (
        array is None
        or array.dtype != wanted
        or array.ndim != len(shape)
        or any(length not in (None, there) for length, there in zip(shape, array.shape, strict=True))
    ):
        found = "nothing" if array is None else f"{array.dtype}{list(array.shape)}"
        raise ValueError(f"{prefix}.{name} is {found}, not {np.dtype(wanted)}{list(shape)}")
