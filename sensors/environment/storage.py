"""Environments in folders: a header in JSON and NumPy arrays that can be memory-mapped."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from geo.atomic import atomic_directory
from sensors.environment.environment import Environment, Provenance
from sensors.environment.model import DISEASES, Disease, EnvironmentModel
from sensors.environment.outbreak import NO_HOST
from sensors.errors import EnvironmentDataError

HEADER = "environment.json"
FORMAT = "wbf-mission environment"
VERSION = 1


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The file ``environment.json``."""

    format: str
    version: int
    shape: tuple[int, int]
    days: tuple[int, ...]
    fields: tuple[str, ...]
    provenance: Provenance
    model: EnvironmentModel


def _soil_name(day: int) -> str:
    return f"soil-{day:03d}.npy"


@contextlib.contextmanager
def environment_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary folder that becomes the environment at `path` when the block ends well.

    Raises
    ------
    EnvironmentDataError
        If `path` is something else than a new or empty folder or an older environment, or cannot be written.
    """
    target = Path(path)
    try:
        if target.is_dir() and not (target / HEADER).is_file() and any(target.iterdir()):
            msg = f"{target}: this folder holds something else than an environment; give another one"
            raise EnvironmentDataError(msg)
        target.resolve().parent.mkdir(parents=True, exist_ok=True)
        with atomic_directory(target) as temporary:
            yield temporary
    except OSError as error:
        raise EnvironmentDataError(f"{target}: cannot be written: {error.strerror or error}") from error


class SoilFiles:
    """Writes the soil of several days at once, block by block, without holding a day in memory.

    Parameters
    ----------
    folder : Path
        Where.
    shape : tuple of int
        The farm, cells.
    days : collection of int
        The days; each is a file.
    """

    def __init__(self, folder: Path, shape: tuple[int, int], days: Collection[int]) -> None:
        self._stack = contextlib.ExitStack()
        self._files: dict[int, IO[bytes]] = {}
        header = {"descr": "<f4", "fortran_order": False, "shape": shape}
        with self._stack:
            for day in days:
                file = self._stack.enter_context((folder / _soil_name(day)).open("wb"))
                np.lib.format.write_array_header_1_0(file, header)
                self._start = file.tell()
                self._files[day] = file
            self._stack = self._stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def __call__(self, day: int, first_x: int, block: NDArray[np.float32]) -> None:
        """Append the rows from `first_x` on to a day; the first blocks of a day have to come first."""
        file = self._files[day]
        if file.tell() != self._start + 4 * first_x * block.shape[1]:
            raise EnvironmentDataError(f"soil of day {day}: rows from {first_x} on do not continue the file")
        file.write(np.ascontiguousarray(block, "<f4").data)


def write_header(
    folder: Path,
    shape: tuple[int, int],
    days: tuple[int, ...],
    model: EnvironmentModel,
    provenance: Provenance,
) -> None:
    """Write ``environment.json``."""
    header = Header(FORMAT, VERSION, shape, days, (*DISEASES, "soil"), provenance, model)
    text = msgspec.json.format(msgspec.json.encode(header), indent=2)
    (folder / HEADER).write_bytes(text + b"\n")


def write_onset(folder: Path, disease: Disease, onset: NDArray[np.int8]) -> None:
    """Write the days of infection of a disease."""
    np.save(folder / f"{disease}.npy", onset, allow_pickle=False)


def save_environment(environment: Environment, path: str | os.PathLike[str]) -> None:
    """Save an environment; see `Environment.save`."""
    with environment_folder(path) as folder:
        for disease in DISEASES:
            write_onset(folder, disease, environment.onset(disease))
        with SoilFiles(folder, environment.shape, environment.days) as files:
            for day in environment.days:
                files(day, 0, environment.soil(day))
        write_header(folder, environment.shape, environment.days, environment.model, environment.provenance)


def _read_header(path: Path) -> Header:
    try:
        header = msgspec.json.decode(path.read_bytes(), type=Header)
    except OSError as error:
        msg = f"{path}: cannot be read: {error.strerror}; an environment is a folder with this file"
        raise EnvironmentDataError(msg) from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise EnvironmentDataError(f"{path}: not the header of an environment: {error}") from error
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


def _read_array(path: Path, shape: tuple[int, int], dtype: str, mmap: bool) -> NDArray[np.generic]:
    try:
        array = np.load(path, mmap_mode="r" if mmap else None, allow_pickle=False)
    except OSError as error:
        raise EnvironmentDataError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, EOFError, SyntaxError) as error:
        raise EnvironmentDataError(
            f"{path}: not a complete NumPy array: {str(error).splitlines()[0]}"
        ) from error
    if not isinstance(array, np.ndarray):
        raise EnvironmentDataError(f"{path}: an archive instead of one NumPy array")
    if array.shape != shape or array.dtype.str != dtype or not array.flags.c_contiguous:
        wanted = f"{dtype}{list(shape)} in C order"
        msg = f"{path}: array is {array.dtype.str}{list(array.shape)} instead of {wanted}"
        raise EnvironmentDataError(msg)
    return array


def load_environment(path: str | os.PathLike[str], *, mmap: bool = True) -> Environment:
    """Load an environment; see `Environment.load`."""
    folder = Path(path)
    if not folder.is_dir():
        raise EnvironmentDataError(f"{folder}: no such folder; an environment is a folder with {HEADER}")
    header = _read_header(folder / HEADER)
    onset: dict[Disease, NDArray[np.int8]] = {}
    for disease in DISEASES:
        file = folder / f"{disease}.npy"
        array = _read_array(file, header.shape, "|i1", mmap).astype(np.int8, copy=False)
        if array.min() < NO_HOST:
            raise EnvironmentDataError(f"{file}: day of infection {array.min()} is less than {NO_HOST}")
        onset[disease] = array
    soil = {
        day: _read_array(folder / _soil_name(day), header.shape, "<f4", mmap).astype(np.float32, copy=False)
        for day in header.days
    }
    return Environment(header.model, onset, soil, header.provenance)
