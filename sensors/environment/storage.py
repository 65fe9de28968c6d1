"""Environments in folders: a Zarr 3 group, whose days are written one by one and read chunk by chunk.

Days of infection are arrays ``[x, y]``, the humidity is one array ``[day, x, y]``. Each day is one file (a
shard) that appears complete or not at all; within it, chunks of `CHUNK_CELLS` squared are compressed on their
own and carry a checksum, so that a window is read without the rest.
"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from sensors.dynamics.outbreak import NO_HOST
from sensors.environment.environment import Environment, Provenance
from sensors.environment.layers import ArrayLayer, ChunkCache, ChunkedLayer
from sensors.environment.model import DISEASES, Disease, EnvironmentModel
from sensors.errors import EnvironmentDataError

if TYPE_CHECKING:
    import zarr

HEADER = "zarr.json"
FORMAT = "wbf-mission environment"
VERSION = 2
CHUNK_CELLS = 500
CACHED_BYTES = 64_000_000
"""How much of a stored environment stays decoded for single cells."""

# Arrays start with values that none of our data has, so a missing file cannot be taken for data.
_NO_ONSET = -128
_NO_SOIL = float("nan")


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an environment is: the attributes of its group. Equal headers mean equal data."""

    format: str
    version: int
    shape: tuple[int, int]
    days: tuple[int, ...]
    fields: tuple[str, ...]
    provenance: Provenance
    model: EnvironmentModel


class _Group(msgspec.Struct, frozen=True):
    zarr_format: int
    node_type: str
    attributes: Header


def make_header(
    shape: tuple[int, int], days: tuple[int, ...], model: EnvironmentModel, provenance: Provenance
) -> Header:
    """Make the header of an environment of this version."""
    return Header(FORMAT, VERSION, shape, days, (*DISEASES, "soil"), provenance, model)


class EnvironmentStore:
    """An environment's group on disk, possibly not finished.

    Parameters
    ----------
    folder : Path
        Where.
    header : Header
        What it holds.
    writable : bool
        Open it for writing.
    """

    def __init__(self, folder: Path, header: Header, *, writable: bool = False) -> None:
        self.folder = folder
        self.header = header
        self._mode: Literal["r", "r+"] = "r+" if writable else "r"
        self._arrays: dict[str, zarr.Array[Any]] = {}

    def create(self) -> None:
        """Write the group and its arrays, all empty."""
        import zarr
        from zarr.codecs import BloscCodec, Crc32cCodec

        header = self.header
        group = zarr.create_group(self.folder, zarr_format=3, attributes=msgspec.to_builtins(header))
        width, height = header.shape
        chunk = (min(CHUNK_CELLS, width), min(CHUNK_CELLS, height))
        shard = (-(-width // chunk[0]) * chunk[0], -(-height // chunk[1]) * chunk[1])
        for disease in DISEASES:
            group.create_array(
                disease,
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
        group.create_array(
            "soil",
            shape=(len(header.days), width, height),
            dtype="float32",
            chunks=(1, *chunk),
            shards=(1, *shard),
            fill_value=_NO_SOIL,
            dimension_names=("day", "x", "y"),
            compressors=[BloscCodec(typesize=4, cname="lz4", clevel=1, shuffle="shuffle"), Crc32cCodec()],
            config={"write_empty_chunks": True},
            attributes={"description": "humidity of the soil, 0 to 1"},
        )
        days = group.create_array("day", shape=(len(header.days),), dtype="int16", dimension_names=("day",))
        days[:] = np.array(header.days, np.int16)

    def file(self, name: str, day: int | None = None) -> Path:
        """Return the file that holds a disease, or the soil of a day."""
        if day is None:
            return self.folder / name / "c" / "0" / "0"
        return self.folder / name / "c" / str(self.header.days.index(day)) / "0" / "0"

    def array(self, name: str) -> zarr.Array[Any]:
        """Open an array, and check that it is what this version writes."""
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
        except Exception as error:  # what zarr raises on hostile metadata is not bounded
            msg = f"{path}: not the description of a Zarr array: {_one_line(error)}"
            raise EnvironmentDataError(msg) from error
        width, height = self.header.shape
        chunk = (min(CHUNK_CELLS, width), min(CHUNK_CELLS, height))
        wanted: tuple[Any, ...] = ((width, height), "|i1", chunk)
        if name == "soil":
            wanted = ((len(self.header.days), width, height), "<f4", (1, *chunk))
        if found != wanted:
            msg = f"{path}: array is {found[1]}{list(found[0])} in chunks of {found[2]} instead of " + (
                f"{wanted[1]}{list(wanted[0])} in chunks of {wanted[2]}"
            )
            raise EnvironmentDataError(msg)
        if not known:
            raise EnvironmentDataError(f"{path}: compressed in an unknown way; generate it again")
        self._arrays[name] = array
        return array

    def write_onset(self, disease: Disease, onset: NDArray[np.int8]) -> None:
        """Write the days of infection of a disease."""
        # An older file would be read to be changed, and could be damaged.
        self.file(disease).unlink(missing_ok=True)
        self.array(disease)[:] = onset

    def write_soil(self, day: int, soil: NDArray[np.float32]) -> None:
        """Write the humidity of a day."""
        self.file("soil", day).unlink(missing_ok=True)
        self.array("soil")[self.header.days.index(day)] = soil

    def read_onset(self, disease: Disease, x: slice, y: slice) -> NDArray[np.int8]:
        """Read days of infection of a window; EnvironmentDataError if they are damaged."""
        path = self.file(disease)
        onset: NDArray[np.int8] = self._read(path, disease, (x, y))
        if onset.min() < NO_HOST:
            raise EnvironmentDataError(f"{path}: day of infection {onset.min()} is less than {NO_HOST}")
        return onset

    def read_soil(self, day: int, x: slice, y: slice) -> NDArray[np.float32]:
        """Read the humidity of a window on a day; EnvironmentDataError if it is damaged."""
        path = self.file("soil", day)
        soil: NDArray[np.float32] = self._read(path, "soil", (self.header.days.index(day), x, y))
        if not (soil.min() >= 0.0 and soil.max() < math.inf):
            raise EnvironmentDataError(f"{path}: humidity on day {day} is negative or no number")
        return soil

    def saved_onset(self, disease: Disease) -> NDArray[np.int8] | None:
        """Return the days of infection if they were written and are good."""
        width, height = self.header.shape
        with contextlib.suppress(EnvironmentDataError):
            return self.read_onset(disease, slice(0, width), slice(0, height))
        return None

    def saved_soil(self, day: int) -> NDArray[np.float32] | None:
        """Return the humidity of a day if it was written and is good."""
        width, height = self.header.shape
        with contextlib.suppress(EnvironmentDataError):
            return self.read_soil(day, slice(0, width), slice(0, height))
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
        except Exception as error:  # a codec's error on damaged data is not bounded either
            msg = f"{path}: damaged: {_one_line(error)}; generate the environment again"
            raise EnvironmentDataError(msg) from error

    def check(self) -> None:
        """Check that all files are there and not cut off, without decoding more than a chunk of each.

        Raises
        ------
        EnvironmentDataError
            Naming the first file that is missing or damaged.
        """
        corner = slice(0, 1), slice(0, 1)
        for disease in DISEASES:
            self.read_onset(disease, *corner)
        for day in self.header.days:
            self.read_soil(day, *corner)

    def environment(self, *, lazy: bool = True) -> Environment:
        """Return the environment; the group has to be finished."""
        header = self.header
        cache = ChunkCache(CACHED_BYTES)
        chunk = (min(CHUNK_CELLS, header.shape[0]), min(CHUNK_CELLS, header.shape[1]))

        def onset(disease: Disease) -> ChunkedLayer[np.int8]:
            def read(x: slice, y: slice) -> NDArray[np.int8]:
                return self.read_onset(disease, x, y)

            return ChunkedLayer(disease, header.shape, chunk, read, cache)

        def soil(day: int) -> ChunkedLayer[np.float32]:
            def read(x: slice, y: slice) -> NDArray[np.float32]:
                return self.read_soil(day, x, y)

            return ChunkedLayer(f"soil {day}", header.shape, chunk, read, cache)

        onsets = {disease: onset(disease) for disease in DISEASES}
        soils = {day: soil(day) for day in header.days}
        if lazy:
            return Environment.from_layers(header.shape, header.model, onsets, soils, header.provenance)
        return Environment.from_layers(
            header.shape,
            header.model,
            {disease: ArrayLayer(layer.whole()) for disease, layer in onsets.items()},
            {day: ArrayLayer(layer.whole()) for day, layer in soils.items()},
            header.provenance,
        )


def _one_line(error: Exception) -> str:
    return (" ".join(str(error).split()) or type(error).__name__)[:200]


@contextlib.contextmanager
def unfinished_store(
    path: str | os.PathLike[str], header: Header, *, resume: bool = False
) -> Iterator[EnvironmentStore]:
    """Give a store beside `path` that takes its place when the block ends well.

    When the block ends with an exception, Ctrl-C included, an older environment at `path` stays as it was,
    and what was finished of the new one is kept for the next time.

    Parameters
    ----------
    path : path-like
        The environment's folder.
    header : Header
        What it is to hold.
    resume : bool
        Go on with what an earlier attempt at the same header left.

    Raises
    ------
    EnvironmentDataError
        If `path` is something else than a new or empty folder or an older environment, cannot be written, or
        another process is writing to it.
    """
    target = Path(path).resolve()
    try:
        _check_target(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        partial = target.with_name(f".{target.name}.partial")
        with _locked(partial):
            store = EnvironmentStore(partial, header, writable=True)
            if not (resume and _is_started(store)):
                for entry in partial.iterdir():
                    shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
                store.create()
            yield store
            for stray in partial.rglob("*.partial"):
                stray.unlink()
            _replace(partial, target)
    except OSError as error:
        raise EnvironmentDataError(f"{path}: cannot be written: {error.strerror or error}") from error


def _check_target(target: Path) -> None:
    if target.is_dir() and any(target.iterdir()):
        try:
            read_header(target)
        except EnvironmentDataError as error:
            if _looks_like_ours(target):
                return
            msg = f"{target}: this folder holds something else than an environment; give another one"
            raise EnvironmentDataError(msg) from error
    elif target.exists() and not target.is_dir():
        raise NotADirectoryError(20, "a file of this name is in the way")


def _looks_like_ours(target: Path) -> bool:
    """Whether a folder without a usable header is still an environment: of an older version, or damaged."""
    if (target / "environment.json").is_file() and (target / "tylcv.npy").is_file():
        return True
    return all((target / name / HEADER).is_file() for name in (*DISEASES, "soil"))


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    import fcntl

    while True:
        folder.mkdir(exist_ok=True)
        lock = os.open(folder, os.O_RDONLY)
        try:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                msg = f"{folder}: another process is writing this environment; wait for it"
                raise EnvironmentDataError(msg) from error
            # Whoever had the lock may have moved the folder to its place in the meantime.
            if folder.exists() and folder.stat().st_ino == os.fstat(lock).st_ino:
                yield
                return
        finally:
            os.close(lock)


def _is_started(store: EnvironmentStore) -> bool:
    try:
        if read_header(store.folder) != store.header:
            return False
        for name in (*DISEASES, "soil"):
            store.array(name)
    except EnvironmentDataError:
        return False
    return (store.folder / "day" / "c" / "0").is_file()


def _replace(partial: Path, target: Path) -> None:
    older = target.with_name(f".{target.name}.older")
    shutil.rmtree(older, ignore_errors=True)
    if target.exists():
        target.replace(older)
    try:
        partial.replace(target)
    except OSError:
        if older.exists():
            older.replace(target)
        raise
    shutil.rmtree(older, ignore_errors=True)


def save_environment(environment: Environment, path: str | os.PathLike[str]) -> None:
    """Save an environment; see `Environment.save`."""
    header = make_header(environment.shape, environment.days, environment.model, environment.provenance)
    with unfinished_store(path, header) as store:
        for disease in DISEASES:
            store.write_onset(disease, environment.onset(disease))
        for day in environment.days:
            store.write_soil(day, environment.soil(day))


def read_header(folder: Path) -> Header:
    """Read the header of an environment; EnvironmentDataError if there is none."""
    path = folder / HEADER
    try:
        group = msgspec.json.decode(path.read_bytes(), type=_Group)
    except OSError as error:
        msg = f"{path}: cannot be read: {error.strerror}; an environment is a folder with this file"
        raise EnvironmentDataError(msg) from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise EnvironmentDataError(f"{path}: not the header of an environment: {_one_line(error)}") from error
    header = group.attributes
    if (group.zarr_format, group.node_type) != (3, "group"):
        raise EnvironmentDataError(f"{path}: not a group of Zarr format 3")
    if header.format != FORMAT:
        raise EnvironmentDataError(f"{path}: format is {header.format!r} instead of {FORMAT!r}")
    if header.version != VERSION:
        msg = f"{path}: version {header.version} is not {VERSION}; generate the environment again"
        raise EnvironmentDataError(msg)
    if header.fields != (*DISEASES, "soil"):
        raise EnvironmentDataError(f"{path}: fields are {header.fields} instead of {(*DISEASES, 'soil')}")
    if min(header.shape) < 1:
        raise EnvironmentDataError(f"{path}: shape {header.shape} is not positive")
    if not header.days or min(header.days) < 0 or list(header.days) != sorted(set(header.days)):
        raise EnvironmentDataError(f"{path}: days {header.days} are not ascending days from 0")
    return header


def open_store(path: str | os.PathLike[str]) -> EnvironmentStore:
    """Open a finished environment and check that its arrays fit its header."""
    folder = Path(path)
    if not folder.is_dir():
        raise EnvironmentDataError(f"{folder}: no such folder; an environment is a folder with {HEADER}")
    store = EnvironmentStore(folder, read_header(folder))
    for name in (*DISEASES, "soil"):
        store.array(name)
    return store


def load_environment(path: str | os.PathLike[str], *, lazy: bool = True) -> Environment:
    """Load an environment; see `Environment.load`."""
    store = open_store(path)
    store.check()
    return store.environment(lazy=lazy)


def stored_environment(path: str | os.PathLike[str], header: Header) -> Environment | None:
    """Return the environment at `path` if it is the one of this header, and whole; otherwise None."""
    try:
        store = open_store(path)
        if store.header != header:
            return None
        store.check()
    except EnvironmentDataError:
        return None
    return store.environment()
