"""The store of an environment: a Zarr 3 group that is written day by day and read chunk by chunk.

Arrays are named after fields. A disease is an array ``[x, y]`` of onsets (days of infection), and a
continuous field is an array ``[day, x, y]``. One file (a shard), written atomically, holds a disease or a day
of a continuous field. A shard has chunks of `CHUNK_CELLS` squared, each compressed and with a checksum, so
that a window can be read without decoding the whole farm.
"""

from __future__ import annotations

import contextlib
import math
import os
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from geo.texts import one_line
from sensors.dynamics.epidemic import NO_HOST
from sensors.environment.environment import ArrayLayer, Environment, Provenance, T
from sensors.errors import EnvironmentDataError, FieldError
from sensors.field_files import field_from_table, field_to_table
from sensors.fields import FieldSet

if TYPE_CHECKING:
    import zarr

HEADER = "zarr.json"
FORMAT = "wbf-mission environment"
VERSION = 3
CHUNK_CELLS = 500
CACHED_BYTES = 64_000_000
"""Largest size in bytes of the decoded chunks that a stored environment caches."""

# These fill values never occur in data, so a missing file cannot be taken for data.
_NO_ONSET = -128
_NO_LEVEL = float("nan")


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Attributes of an environment's Zarr group. Equal headers mean equal data."""

    format: str
    version: int
    shape: tuple[int, int]
    days: tuple[int, ...]
    fields: tuple[dict[str, Any], ...]
    provenance: Provenance

    @classmethod
    def of(
        cls, shape: tuple[int, int], days: tuple[int, ...], fields: FieldSet, provenance: Provenance
    ) -> Header:
        """Return the header of an environment in the format's present version."""
        return cls(FORMAT, VERSION, shape, days, fields_to_tables(fields), provenance)


class _Group(msgspec.Struct, frozen=True):
    zarr_format: int
    node_type: str
    attributes: Header


class FormatVersion(msgspec.Struct, frozen=True):
    """Keys that the header of every version of the format has."""

    format: str
    version: int


class _AnyGroup(msgspec.Struct, frozen=True):
    attributes: FormatVersion


def fields_to_tables(fields: FieldSet) -> tuple[dict[str, Any], ...]:
    """Return the tables of plain values that stand for the fields in a header."""
    return tuple(field_to_table(field) for field in fields)


def fields_from_tables(tables: tuple[dict[str, Any], ...], where: str) -> FieldSet:
    """Return a header's fields; raise EnvironmentDataError, which names `where`, for an invalid field."""
    try:
        return FieldSet(tuple(field_from_table(table, where) for table in tables))
    except FieldError as error:
        text = str(error)
        raise EnvironmentDataError(text if text.startswith(where) else f"{where}: {text}") from None


class ChunkCache:
    """Thread-safe cache of the chunks used last, for cameras that move from cell to cell."""

    __slots__ = ("_bytes", "_chunks", "_limit", "_lock")

    def __init__(self, limit_bytes: int) -> None:
        self._limit = limit_bytes
        self._bytes = 0
        self._chunks: OrderedDict[tuple[str, int, int], NDArray[Any]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: tuple[str, int, int], decode: Callable[[], NDArray[Any]]) -> NDArray[Any]:
        """Return a chunk from the cache, or decode the chunk and cache it."""
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


@dataclass(eq=False, slots=True)
class ChunkedLayer(Generic[T]):
    """A layer that is on disk; its chunks are decoded on demand."""

    _name: str
    _shape: tuple[int, int]
    _chunk: tuple[int, int]
    _read: Callable[[slice, slice], NDArray[T]]
    _cache: ChunkCache

    def whole(self) -> NDArray[T]:
        """Decode and return the whole array, without caching its chunks."""
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
        """Return the values of n cells, [n]; chunks are decoded one by one."""
        width, height = self._chunk
        column, row = x // width, y // height
        at_x, at_y = int(column[0]), int(row[0])
        first = self._decoded(at_x, at_y)
        if x.size == 1 or ((column == at_x).all() and (row == at_y).all()):
            return first[x - at_x * width, y - at_y * height]
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


class EnvironmentStore:
    """The Zarr group that holds an environment, complete or not."""

    def __init__(self, folder: Path, header: Header, *, writable: bool = False) -> None:
        self.folder = folder
        self.header = header
        self.fields = fields_from_tables(header.fields, str(folder / HEADER))
        self._mode: Literal["r", "r+"] = "r+" if writable else "r"
        self._arrays: dict[str, zarr.Array[Any]] = {}

    def create(self) -> None:
        """Write the group, with arrays that are still empty."""
        import zarr
        from zarr.codecs import BloscCodec, Crc32cCodec

        header = self.header
        group = zarr.create_group(self.folder, zarr_format=3, attributes=msgspec.to_builtins(header))
        width, height = header.shape
        chunk = self._chunk()
        shard = (-(-width // chunk[0]) * chunk[0], -(-height // chunk[1]) * chunk[1])
        for field in self.fields.diseases:
            group.create_array(
                field.name,
                shape=header.shape,
                dtype="int8",
                chunks=chunk,
                shards=shard,
                fill_value=_NO_ONSET,
                dimension_names=("x", "y"),
                compressors=[
                    BloscCodec(typesize=1, cname="lz4", clevel=5, shuffle="noshuffle"),
                    Crc32cCodec(),
                ],
                config={"write_empty_chunks": True},
                attributes={"description": "day of infection; 0 seed, -1 never, -2 no host"},
            )
        for field in self.fields.continuous:
            group.create_array(
                field.name,
                shape=(len(header.days), width, height),
                dtype="float32",
                chunks=(1, *chunk),
                shards=(1, *shard),
                fill_value=_NO_LEVEL,
                dimension_names=("day", "x", "y"),
                compressors=[BloscCodec(typesize=4, cname="lz4", clevel=1, shuffle="shuffle"), Crc32cCodec()],
                config={"write_empty_chunks": True},
                attributes={"description": f"{field.title}, 0 to 1"},
            )
        days = group.create_array("day", shape=(len(header.days),), dtype="int16", dimension_names=("day",))
        days[:] = np.array(header.days, np.int16)

    def file(self, name: str, day: int | None = None) -> Path:
        """Return the path of a disease's file or, given a day, of a continuous field's file."""
        if day is None:
            return self.folder / name / "c" / "0" / "0"
        return self.folder / name / "c" / str(self.header.days.index(day)) / "0" / "0"

    def array(self, name: str) -> zarr.Array[Any]:
        """Open a field's array, and check its shape, type and codecs."""
        if name in self._arrays:
            return self._arrays[name]
        import zarr
        from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, ShardingCodec

        path = self.folder / name / HEADER
        try:
            array = zarr.open_array(self.folder / name, mode=self._mode, zarr_format=3)
            codecs = [*array.metadata.codecs]  # type: ignore[union-attr]
            inner = [*codecs[0].codecs] if len(codecs) == 1 and isinstance(codecs[0], ShardingCodec) else []
            known = bool(inner) and all(isinstance(c, BytesCodec | BloscCodec | Crc32cCodec) for c in inner)
            found = (array.shape, array.dtype.str, array.chunks)
        except Exception as error:  # On hostile metadata zarr may raise any error
            msg = f"{path}: not the description of a Zarr array: {_reason(error)}"
            raise EnvironmentDataError(msg) from error
        width, height = self.header.shape
        chunk = self._chunk()
        wanted: tuple[Any, ...] = ((width, height), "|i1", chunk)
        if self.fields[name].kind == "continuous":
            wanted = ((len(self.header.days), width, height), "<f4", (1, *chunk))
        if found != wanted:
            msg = f"{path}: array is {found[1]}{list(found[0])} in chunks of {found[2]} instead of " + (
                f"{wanted[1]}{list(wanted[0])} in chunks of {wanted[2]}"
            )
            raise EnvironmentDataError(msg)
        if not known:
            raise EnvironmentDataError(f"{path}: unknown compression; generate the environment again")
        self._arrays[name] = array
        return array

    def write_onset(self, disease: str, onset: NDArray[np.int8]) -> None:
        """Write the onsets of a disease."""
        # zarr would read an older file in order to change it, but the older file may be damaged.
        self.file(disease).unlink(missing_ok=True)
        self.array(disease)[:] = onset

    def write_level(self, name: str, day: int, level: NDArray[np.float32]) -> None:
        """Write a day of a continuous field."""
        self.file(name, day).unlink(missing_ok=True)
        self.array(name)[self.header.days.index(day)] = level

    def read_onset(self, disease: str, x: slice, y: slice) -> NDArray[np.int8]:
        """Read the onsets of a disease in a window; raise EnvironmentDataError if they are damaged."""
        path = self.file(disease)
        onset: NDArray[np.int8] = self._read(path, disease, (x, y))
        if onset.min() < NO_HOST:
            raise EnvironmentDataError(f"{path}: day of infection {onset.min()} is less than {NO_HOST}")
        return onset

    def read_level(self, name: str, day: int, x: slice, y: slice) -> NDArray[np.float32]:
        """Read a window of a continuous field on a day; raise EnvironmentDataError if data are damaged."""
        path = self.file(name, day)
        level: NDArray[np.float32] = self._read(path, name, (self.header.days.index(day), x, y))
        if not (level.min() >= 0.0 and level.max() < math.inf):
            raise EnvironmentDataError(f"{path}: {name} on day {day} is negative or no number")
        return level

    def saved_onset(self, disease: str) -> NDArray[np.int8] | None:
        """Return the onsets of a disease if they are stored undamaged, or else None."""
        width, height = self.header.shape
        with contextlib.suppress(EnvironmentDataError):
            return self.read_onset(disease, slice(0, width), slice(0, height))
        return None

    def saved_level(self, name: str, day: int) -> NDArray[np.float32] | None:
        """Return a day of a continuous field if it is stored undamaged, or else None."""
        width, height = self.header.shape
        with contextlib.suppress(EnvironmentDataError):
            return self.read_level(name, day, slice(0, width), slice(0, height))
        return None

    def _read(self, path: Path, name: str, where: tuple[int | slice, ...]) -> NDArray[Any]:
        array = self.array(name)
        try:
            if not path.is_file():
                raise EnvironmentDataError(f"{path}: this file of the environment is missing")
            return np.asarray(array[where])
        except OSError as error:
            raise EnvironmentDataError(f"{path}: cannot be read: {error.strerror or error}") from error
        except EnvironmentDataError:
            raise
        except Exception as error:  # On damaged data a codec may raise any error
            msg = f"{path}: damaged: {_reason(error)}; generate the environment again"
            raise EnvironmentDataError(msg) from error

    def check(self) -> None:
        """Check that all files exist and are not truncated, by decoding one chunk of each file.

        If a file is missing or damaged, raise EnvironmentDataError, which names the file.
        """
        corner = slice(0, 1), slice(0, 1)
        for field in self.fields.diseases:
            self.read_onset(field.name, *corner)
        for field in self.fields.continuous:
            for day in self.header.days:
                self.read_level(field.name, day, *corner)

    def environment(self, *, lazy: bool = True) -> Environment:
        """Return the environment in a complete group; with `lazy`, data are decoded on demand."""
        header = self.header
        cache = ChunkCache(CACHED_BYTES)
        shape, chunk = header.shape, self._chunk()
        onset = {
            field.name: ChunkedLayer(field.name, shape, chunk, partial(self.read_onset, field.name), cache)
            for field in self.fields.diseases
        }
        levels = {
            (field.name, day): ChunkedLayer(
                f"{field.name} {day}", shape, chunk, partial(self.read_level, field.name, day), cache
            )
            for field in self.fields.continuous
            for day in header.days
        }
        if lazy:
            return Environment(header.shape, self.fields, header.days, onset, levels, header.provenance)
        return Environment(
            header.shape,
            self.fields,
            header.days,
            {name: ArrayLayer(layer.whole()) for name, layer in onset.items()},
            {key: ArrayLayer(layer.whole()) for key, layer in levels.items()},
            header.provenance,
        )

    def _chunk(self) -> tuple[int, int]:
        width, height = self.header.shape
        return min(CHUNK_CELLS, width), min(CHUNK_CELLS, height)


def read_header(folder: Path) -> Header:
    """Read the header of an environment; raise EnvironmentDataError if it is missing or invalid."""
    path = folder / HEADER
    try:
        data = path.read_bytes()
        # The version is checked first, because headers of other versions have other keys.
        found = msgspec.json.decode(data, type=_AnyGroup).attributes
        if found.format != FORMAT:
            raise EnvironmentDataError(f"{path}: format is {found.format!r} instead of {FORMAT!r}")
        if found.version != VERSION:
            msg = f"{path}: version {found.version} is not {VERSION}; generate the environment again"
            raise EnvironmentDataError(msg)
        group = msgspec.json.decode(data, type=_Group)
    except OSError as error:
        msg = f"{path}: cannot be read: {error.strerror}; an environment is a folder with this file"
        raise EnvironmentDataError(msg) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise EnvironmentDataError(f"{path}: not the header of an environment: {_reason(error)}") from error
    header = group.attributes
    if (group.zarr_format, group.node_type) != (3, "group"):
        raise EnvironmentDataError(f"{path}: not a group of Zarr format 3")
    fields_from_tables(header.fields, str(path))
    if min(header.shape) < 1:
        raise EnvironmentDataError(f"{path}: shape {header.shape} is not positive")
    if not header.days or min(header.days) < 0 or list(header.days) != sorted(set(header.days)):
        raise EnvironmentDataError(f"{path}: days {header.days} are not ascending days from 0")
    return header


def open_store(path: str | os.PathLike[str]) -> EnvironmentStore:
    """Open the store of a complete environment, and check that arrays match the header."""
    folder = Path(path)
    if not folder.is_dir():
        raise EnvironmentDataError(f"{folder}: no such folder; an environment is a folder with {HEADER}")
    store = EnvironmentStore(folder, read_header(folder))
    for name in store.fields.names:
        store.array(name)
    return store


def _reason(error: Exception) -> str:
    return one_line(str(error) or type(error).__name__, 200)
