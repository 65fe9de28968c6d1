"""The environment E, the true state of the fields on each day, which planners and estimators cannot see."""

from __future__ import annotations

import hashlib
import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from geo.texts import unknown
from sensors.dynamics.epidemic import IMMUNE, NO_HOST, SUSCEPTIBLE, status_table, value_table
from sensors.errors import EnvironmentDataError
from sensors.fields import FieldSet
from sensors.lazy_fields import LARGE_FROM_CELLS, LazyFields

if TYPE_CHECKING:
    from numpy.random import SeedSequence

    from geo.grid import FarmGrid

_FEW = 8  # Up to this many cells, a loop is faster than array operations

T = TypeVar("T", bound=np.generic)
S_co = TypeVar("S_co", bound=np.generic, covariant=True)


class Layer(Protocol[S_co]):
    """Values of the farm's cells, as an array ``[x, y]``."""

    def whole(self) -> NDArray[S_co]:
        """Return the array, read-only."""

    def window(self, x: slice, y: slice) -> NDArray[S_co]:
        """Return a window of the array; both slices have a start and a stop on the farm and no step."""

    def cells(self, x: NDArray[np.integer], y: NDArray[np.integer]) -> NDArray[S_co]:
        """Return the values of n cells on the farm, [n]."""

    def cell(self, x: int, y: int) -> Any:
        """Return the value of a cell on the farm as a Python number."""


class ArrayLayer(Generic[T]):
    """A layer whose array is in memory or memory-mapped from a file."""

    __slots__ = ("_array",)

    def __init__(self, array: NDArray[T]) -> None:
        self._array = np.ascontiguousarray(array).view()
        self._array.flags.writeable = False

    def whole(self) -> NDArray[T]:
        """Return the array, read-only."""
        return self._array

    def window(self, x: slice, y: slice) -> NDArray[T]:
        """Return a view of a window of the array."""
        return self._array[x, y]

    def cells(self, x: NDArray[np.integer], y: NDArray[np.integer]) -> NDArray[T]:
        """Return the values of n cells, [n]."""
        return self._array[x, y]

    def cell(self, x: int, y: int) -> Any:
        """Return the value of a cell as a Python number."""
        return self._array.item(x, y)


@dataclass(frozen=True, slots=True)
class Provenance:
    """Origin of an environment: the farm and the seed.

    Parameters
    ----------
    farm : str
        Name of the farm; may be empty.
    grid_sha256 : str
        Digest of the crop map (`grid_digest`); may be empty.
    entropy : tuple of str
        Entropy of the seed sequence, as decimal integers.
    spawn_key : tuple of int
        Spawn key of the seed sequence.
    """

    farm: str = ""
    grid_sha256: str = ""
    entropy: tuple[str, ...] = ()
    spawn_key: tuple[int, ...] = ()

    @classmethod
    def of(cls, grid: FarmGrid, seed: SeedSequence, farm_name: str) -> Provenance:
        """Return the provenance of an environment with this farm and seed."""
        entropy = np.atleast_1d(np.asarray(seed.entropy, dtype=object)).tolist()
        return cls(
            farm_name,
            grid_digest(grid),
            tuple(map(str, entropy)),
            tuple(int(word) for word in seed.spawn_key),
        )


class Environment:
    """The state of a farm's fields on the days that were kept.

    `generate_environment` and `load_environment` make environments. Day d is the state after d daily steps;
    day 0 is the initial state. Arrays are read-only and in the order of `fields`. A disease has a layer of
    onsets, and a continuous field has a layer of levels for each of `days`, which ascend.
    """

    __slots__ = ("_diseases", "_layers", "_levels", "_onset", "days", "fields", "provenance", "shape")

    def __init__(
        self,
        shape: tuple[int, int],
        fields: FieldSet,
        days: tuple[int, ...],
        onset: Mapping[str, Layer[np.int8]],
        levels: Mapping[tuple[str, int], Layer[np.float32]],
        provenance: Provenance,
    ) -> None:
        self.shape = shape
        self.fields = fields
        self.provenance = provenance
        self.days = days
        self._onset = onset
        self._levels = levels
        # For each day: index, layer and value table of each disease, index and layer of each other field.
        self._diseases = {
            day: [
                (fields.index(field.name), onset[field.name], value_table(field.epidemic, day))
                for field in fields.diseases
            ]
            for day in days
        }
        self._layers = {
            day: [(fields.index(field.name), levels[field.name, day]) for field in fields.continuous]
            for day in days
        }

    @classmethod
    def of_arrays(
        cls,
        fields: FieldSet,
        days: Iterable[int],
        onset: Mapping[str, NDArray[np.int8]],
        levels: Mapping[str, Mapping[int, NDArray[np.float32]]],
        provenance: Provenance | None = None,
    ) -> Environment:
        """Return an environment made of arrays such as `onset` and `level` return.

        Raise EnvironmentDataError if the shape or type of an array is wrong, or there is no day.
        """
        kept = tuple(sorted(days))
        if not kept:
            raise EnvironmentDataError("environment: no day is given; give at least one day")
        first_name = fields.names[0]
        first = onset[first_name] if first_name in onset else levels[first_name][kept[0]]
        if first.ndim != 2:
            raise EnvironmentDataError(f"environment: {first_name} has {first.ndim} axes instead of 2")
        shape = (first.shape[0], first.shape[1])
        layers = {
            (field.name, day): _layer(
                f"{field.name} of day {day}", levels[field.name][day], np.float32, shape
            )
            for field in fields.continuous
            for day in kept
        }
        infected = {
            field.name: _layer(f"onset of {field.name}", onset[field.name], np.int8, shape)
            for field in fields.diseases
        }
        return cls(shape, fields, kept, infected, layers, provenance or Provenance())

    def _check_day(self, day: int) -> None:
        if day not in self._diseases:
            kept = ", ".join(map(str, self.days))
            raise EnvironmentDataError(f"environment: day {day} is not kept; kept days: {kept}")

    def _onset_of(self, disease: str) -> Layer[np.int8]:
        if disease not in self._onset:
            raise EnvironmentDataError(f"environment: {unknown('disease', disease, self._onset)}")
        return self._onset[disease]

    def onset(self, disease: str) -> NDArray[np.int8]:
        """Return the day of infection of each cell, int8[W, H], read-only.

        The day is 0 for a seed, -1 for a cell never infected, and -2 for a cell without the crop.
        """
        return self._onset_of(disease).whole()

    def status(self, disease: str, day: int) -> NDArray[np.int8]:
        """Return the SIRV status of each cell on a kept day, a new array int8[W, H].

        Status 0 is susceptible, k > 0 infected with k days remaining, -1 removed, and -2 immune. Raise
        EnvironmentDataError if the disease is unknown or the day is not kept.
        """
        layer = self._onset_of(disease)
        self._check_day(day)
        table = status_table(self.fields[disease].epidemic, day)
        onset = layer.whole()
        status = np.where(onset == NO_HOST, np.int8(IMMUNE), np.int8(SUSCEPTIBLE))
        once_infected = np.flatnonzero(onset >= 0)
        status.reshape(-1)[once_infected] = table[onset.reshape(-1)[once_infected]]
        return status

    def level(self, name: str, day: int) -> NDArray[np.float32]:
        """Return the values of a continuous field on a kept day, float32[W, H], read-only."""
        self._check_day(day)
        if (name, day) not in self._levels:
            known = [field.name for field in self.fields.continuous]
            raise EnvironmentDataError(f"environment: {unknown('continuous field', name, known)}")
        return self._levels[name, day].whole()

    def values(self, day: int, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """Return the true values of all fields on a kept day, float32[n, W, H], in `out` if it is given.

        The value of a disease is 1.0 for healthy plants and land without host plants, 0.5 for infected plants
        and 0.0 for lost plants. Raise EnvironmentDataError if the day is not kept.
        """
        self._check_day(day)
        values = np.empty((len(self.fields), *self.shape), np.float32) if out is None else out
        self._fill(values, day, lambda layer: layer.whole())
        return values

    def truth(self, day: int) -> NDArray[np.float32]:
        """Return the true values on a kept day; on a large farm as a `LazyFields`, which takes no memory."""
        if self.shape[0] * self.shape[1] < LARGE_FROM_CELLS:
            return self.values(day)
        self._check_day(day)
        lazy = LazyFields((len(self.fields), *self.shape), partial(self._columns, day))
        return cast("NDArray[np.float32]", lazy)

    def _columns(self, day: int, field: int, columns: slice) -> NDArray[np.float32]:
        """Return one field's true values on a kept day in some columns of the farm, float32[columns, H]."""
        part = columns, slice(0, self.shape[1])
        values = np.empty((columns.stop - columns.start, self.shape[1]), np.float32)
        for index, layer, table in self._diseases[day]:
            if index == field:
                _fill_disease(values, layer.window(*part), table)
        for index, level in self._layers[day]:
            if index == field:
                values[:] = level.window(*part)
        return values

    def window(self, day: int, x: slice, y: slice) -> NDArray[np.float32]:
        """Return all fields' true values in a window of the farm on a kept day, as a new float32[n, w, h].

        The slices have no step; a missing start or stop means the farm's border. Only chunks in the window
        are decoded. Raise EnvironmentDataError if the day is not kept or the window is off the farm.

        Examples
        --------
        >>> from geo.farms import get_farm
        >>> from sensors.environment import generate_environment
        >>> environment = generate_environment(get_farm("miniberry-30").grid(), days=6, seed=7)
        >>> environment.window(6, slice(3, 13), slice(20, None)).shape
        (3, 10, 10)
        """
        self._check_day(day)
        part = tuple(
            _part(name, cells, size) for name, cells, size in zip("xy", (x, y), self.shape, strict=True)
        )
        values = np.empty((len(self.fields), *(cells.stop - cells.start for cells in part)), np.float32)
        self._fill(values, day, lambda layer: layer.window(*part))
        return values

    def _fill(
        self,
        values: NDArray[np.float32],
        day: int,
        read: Callable[[Layer[Any]], NDArray[Any]],
    ) -> None:
        for index, layer, table in self._diseases[day]:
            _fill_disease(values[index], read(layer), table)
        for index, level in self._layers[day]:
            values[index] = read(level)

    def sample(self, day: int, ix: ArrayLike, iy: ArrayLike) -> NDArray[np.float32]:
        """Return the true values at k cells on a kept day, float32[k, n]; only the cells' chunks are decoded.

        Raise EnvironmentDataError if a day is not kept, a cell is off the farm, or indices are not integers.
        """
        self._check_day(day)
        few = _few_cells(ix, iy, self.shape)
        if few:  # A camera takes few images between two positions
            return self._sample_few(day, few)
        x, y = np.broadcast_arrays(np.atleast_1d(ix), np.atleast_1d(iy))
        if x.ndim != 1 or x.dtype.kind not in "iu" or y.dtype.kind not in "iu":
            raise EnvironmentDataError("environment: cells to sample must be integers or lists of integers")
        samples = np.empty((x.size, len(self.fields)), np.float32)
        if x.size == 0:
            return samples
        width, height = self.shape
        if x.min() < 0 or y.min() < 0 or x.max() >= width or y.max() >= height:
            outside = np.flatnonzero((x < 0) | (y < 0) | (x >= width) | (y >= height))[0]
            cell = f"({x[outside]}, {y[outside]})"
            msg = f"environment: cell {cell} is outside the farm of {width} x {height} cells"
            raise EnvironmentDataError(msg)
        for index, layer, table in self._diseases[day]:
            # Read as unsigned bytes, the negative onsets NEVER and NO_HOST index the end of the table.
            samples[:, index] = table[layer.cells(x, y).view(np.uint8)]
        for index, level in self._layers[day]:
            samples[:, index] = level.cells(x, y)
        return samples

    def _sample_few(self, day: int, cells: list[tuple[int, int]]) -> NDArray[np.float32]:
        """Return true values at a few cells, float32[k, n]; a loop is faster than array operations here."""
        samples = np.empty((len(cells), len(self.fields)), np.float32)
        diseases, layers = self._diseases[day], self._layers[day]
        for k, (x, y) in enumerate(cells):
            for index, layer, table in diseases:
                samples[k, index] = table[layer.cell(x, y) & 0xFF]
            for index, level in layers:
                samples[k, index] = level.cell(x, y)
        return samples


def _fill_disease(field: NDArray[np.float32], onset: NDArray[np.int8], table: NDArray[np.float32]) -> None:
    """Fill `field`, float32[w, h], with the values of a disease; `table` gives the value for each onset."""
    field.fill(1.0)
    # Few cells are ever infected, so setting only these cells is several times faster than looking up all.
    if onset.flags.c_contiguous and field.flags.c_contiguous:
        once_infected = np.flatnonzero(onset >= 0)
        field.reshape(-1)[once_infected] = table[onset.reshape(-1)[once_infected]]
    else:
        infected = onset >= 0
        field[infected] = table[onset[infected]]


def _few_cells(ix: ArrayLike, iy: ArrayLike, shape: tuple[int, int]) -> list[tuple[int, int]]:
    """Return the cells of two short integer arrays as pairs; [] for other input or cells off the farm."""
    if not (isinstance(ix, np.ndarray) and isinstance(iy, np.ndarray)) or ix.ndim != 1 or ix.size > _FEW:
        return []
    if ix.shape != iy.shape or ix.dtype.kind not in "iu" or iy.dtype.kind not in "iu":
        return []
    width, height = shape
    cells = list(zip(ix.tolist(), iy.tolist(), strict=True))
    for x, y in cells:
        if not (0 <= x < width and 0 <= y < height):
            return []
    return cells


def _layer(name: str, array: NDArray[T], dtype: type[T], shape: tuple[int, int]) -> ArrayLayer[T]:
    if array.shape != shape or array.dtype != dtype:
        wanted = f"{np.dtype(dtype)}{list(shape)}"
        msg = f"environment: {name} is {array.dtype}{list(array.shape)} instead of {wanted}"
        raise EnvironmentDataError(msg)
    return ArrayLayer(array)


def _part(name: str, cells: slice, size: int) -> slice:
    start = 0 if cells.start is None else operator.index(cells.start)
    stop = size if cells.stop is None else operator.index(cells.stop)
    if cells.step not in (None, 1) or not 0 <= start < stop <= size:
        msg = f"environment: window {name} {start}:{stop} is not within 0:{size} of the farm, or has a step"
        raise EnvironmentDataError(msg)
    return slice(start, stop)


def grid_digest(grid: FarmGrid) -> str:
    """Return a hexadecimal SHA-256 of a crop map's shape, cells, and crops that the benchmark lacks."""
    digest = hashlib.sha256(f"{grid.shape[0]}x{grid.shape[1]};{grid.further_crops}".encode())
    digest.update(np.ascontiguousarray(grid.crop, np.int8).data)
    return digest.hexdigest()
