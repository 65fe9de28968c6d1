"""The file of a run's maps in blocks of cells: arrays in one archive, read back without trust."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from geo.atomic import atomic_write
from sensors.fields import FieldSet
from wbf_mission.maps.blocks import MapGrid
from wbf_mission.maps.field_maps import FieldMap

__all__ = ["read_maps", "write_maps"]

_BLOCKS = ("cells", "total", "least", "variance", "seen", "seen_sick")
_ARRAYS = (*_BLOCKS, "finds", "together")
_MAX_MEMBER_BYTES = 64 * 2**20


def write_maps(path: Path, maps: dict[str, tuple[FieldMap, ...]]) -> None:
    """Write maps in blocks of cells: an array for each, named KIND.FIELD.ARRAY."""
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
    """Return the maps of a kind; none without a file.

    Raises
    ------
    ValueError
        If the file is no archive of such maps of this farm.
    """
    if not path.is_file():
        return ()
    try:
        with zipfile.ZipFile(path) as archive:
            if any(member.file_size > _MAX_MEMBER_BYTES for member in archive.infolist()):
                msg = f"an array is larger than {_MAX_MEMBER_BYTES // 2**20} MiB"
                raise ValueError(msg)
        with np.load(path, allow_pickle=False) as arrays:
            there = [name.split(".")[1] for name in arrays if name.startswith(f"{kind}.")]
            return tuple(_map(arrays, f"{kind}.{name}", fields[name], farm) for name in dict.fromkeys(there))
    except Exception as error:  # what numpy and zipfile raise on hostile archives is not bounded
        msg = f"{path}: cannot be read as the maps of a run ({type(error).__name__}: {error})"
        raise ValueError(msg) from error


def _map(arrays: Any, prefix: str, field: Any, farm: Farm) -> FieldMap:
    grid = MapGrid.of(farm)
    values: dict[str, Any] = {name: arrays.get(f"{prefix}.{name}") for name in _ARRAYS}
    for name in _BLOCKS:
        _check(prefix, name, values[name], grid.pixels, optional=name == "variance")
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
    """Refuse an array that is missing, or of another shape or type than the one that was written."""
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
        msg = f"{prefix}.{name} is {found}, not {np.dtype(wanted)}{list(shape)}"
        raise ValueError(msg)
