"""The environment E over days: what is really there, which planners and estimators never see."""

from __future__ import annotations

import hashlib
import operator
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sensors.dynamics.epidemic import IMMUNE, SUSCEPTIBLE
from sensors.dynamics.outbreak import NO_HOST, status_table, value_table
from sensors.environment.layers import ArrayLayer, Layer, T
from sensors.environment.model import DISEASES, Disease, EnvironmentModel
from sensors.errors import EnvironmentDataError

if TYPE_CHECKING:
    from geo.grid import FarmGrid


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where an environment comes from.

    Parameters
    ----------
    farm : str
        Name of the farm, or empty.
    grid_sha256 : str
        Digest of the crop map (`grid_digest`), or empty.
    entropy : tuple of str
        Entropy of the seed sequence, decimal integers.
    spawn_key : tuple of int
        Spawn key of the seed sequence.
    """

    farm: str = ""
    grid_sha256: str = ""
    entropy: tuple[str, ...] = ()
    spawn_key: tuple[int, ...] = ()


class Environment:
    """The state of a farm on some days; made by `generate_environment` or `Environment.load`.

    Day d is the state after d steps; day 0 is before the first one. All arrays are read-only.

    Parameters
    ----------
    model : EnvironmentModel
        What it was made with.
    onset : mapping of str to int8[W, H]
        Day of infection of each cell for "tylcv" and "ccr"; -1 never, -2 no host
        (`sensors.dynamics.outbreak`).
    soil : mapping of int to float32[W, H]
        Soil humidity of each kept day.
    provenance : Provenance
        Farm and seed.

    Raises
    ------
    EnvironmentDataError
        If the arrays do not fit each other.
    """

    __slots__ = ("_onset", "_soil", "_statuses", "_values", "days", "model", "provenance", "shape")

    def __init__(
        self,
        model: EnvironmentModel,
        onset: Mapping[Disease, NDArray[np.int8]],
        soil: Mapping[int, NDArray[np.float32]],
        provenance: Provenance | None = None,
    ) -> None:
        first = onset[DISEASES[0]]
        if first.ndim != 2:
            raise EnvironmentDataError(
                f"environment: onset of {DISEASES[0]} has {first.ndim} axes instead of 2"
            )
        shape = (first.shape[0], first.shape[1])
        if not soil:
            raise EnvironmentDataError("environment: it has no day; keep at least one")
        self._set_up(
            shape,
            model,
            {disease: _layer(f"onset of {disease}", onset[disease], np.int8, shape) for disease in DISEASES},
            {day: _layer(f"soil of day {day}", soil[day], np.float32, shape) for day in sorted(soil)},
            provenance or Provenance(),
        )

    def _set_up(
        self,
        shape: tuple[int, int],
        model: EnvironmentModel,
        onset: Mapping[Disease, Layer[np.int8]],
        soil: Mapping[int, Layer[np.float32]],
        provenance: Provenance,
    ) -> None:
        self.shape = shape
        self.model = model
        self.provenance = provenance
        self.days: tuple[int, ...] = tuple(soil)
        self._onset = onset
        self._soil = soil
        self._statuses = {
            (disease, day): status_table(model.epidemic(disease), day)
            for disease in DISEASES
            for day in self.days
        }
        self._values = {
            (disease, day): value_table(model.epidemic(disease), day)
            for disease in DISEASES
            for day in self.days
        }

    @classmethod
    def from_layers(
        cls,
        shape: tuple[int, int],
        model: EnvironmentModel,
        onset: Mapping[Disease, Layer[np.int8]],
        soil: Mapping[int, Layer[np.float32]],
        provenance: Provenance,
    ) -> Environment:
        """Make an environment that reads from layers; `soil` has its days in ascending order."""
        environment = cls.__new__(cls)
        environment._set_up(shape, model, onset, soil, provenance)
        return environment

    def _check_day(self, day: int) -> None:
        if day not in self._soil:
            kept = ", ".join(map(str, self.days))
            raise EnvironmentDataError(f"environment: day {day} is not kept; kept days: {kept}")

    def _onset_of(self, disease: Disease) -> Layer[np.int8]:
        if disease not in self._onset:
            raise EnvironmentDataError(
                f"environment: unknown disease {disease!r}; known: {', '.join(DISEASES)}"
            )
        return self._onset[disease]

    def onset(self, disease: Disease) -> NDArray[np.int8]:
        """Day of infection of each cell.

        Parameters
        ----------
        disease : {"tylcv", "ccr"}
            The disease.

        Returns
        -------
        int8[W, H]
            0 for the seeds, -1 for cells never infected, -2 for cells without the crop. Read-only.
        """
        return self._onset_of(disease).whole()

    def status(self, disease: Disease, day: int) -> NDArray[np.int8]:
        """SIRV status on a day.

        Parameters
        ----------
        disease : {"tylcv", "ccr"}
            The disease.
        day : int
            A kept day.

        Returns
        -------
        int8[W, H]
            0 susceptible, k > 0 infected with k days left, -1 removed, -2 immune. A new array.

        Raises
        ------
        EnvironmentDataError
            If the disease is unknown or the day not kept.
        """
        layer = self._onset_of(disease)
        self._check_day(day)
        onset = layer.whole()
        status = np.where(onset == NO_HOST, np.int8(IMMUNE), np.int8(SUSCEPTIBLE))
        once_infected = np.flatnonzero(onset >= 0)
        status.reshape(-1)[once_infected] = self._statuses[disease, day][onset.reshape(-1)[once_infected]]
        return status

    def soil(self, day: int) -> NDArray[np.float32]:
        """Soil humidity on a kept day: float32[W, H], read-only."""
        self._check_day(day)
        return self._soil[day].whole()

    def values(self, day: int, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """Give E on a day.

        Parameters
        ----------
        day : int
            A kept day.
        out : float32[3, W, H], optional
            Array to fill.

        Returns
        -------
        float32[3, W, H]
            TYLCV, CCR (1.0 healthy or no host, 0.5 infected, 0.0 destroyed) and soil humidity (0..1).

        Raises
        ------
        EnvironmentDataError
            If the day is not kept.
        """
        self._check_day(day)
        values = np.empty((3, *self.shape), np.float32) if out is None else out
        self._fill(values, day, lambda layer: layer.whole())
        return values

    def window(self, day: int, x: slice, y: slice) -> NDArray[np.float32]:
        """Give E on a part of the farm; of a stored environment only the chunks there are decoded.

        Parameters
        ----------
        day : int
            A kept day.
        x, y : slice
            Cells; no step, and an end that is not given is that of the farm.

        Returns
        -------
        float32[3, w, h]
            As `values` of that part. A new array.

        Raises
        ------
        EnvironmentDataError
            If the day is not kept or the window not on the farm.

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
        values = np.empty((3, *(cells.stop - cells.start for cells in part)), np.float32)
        self._fill(values, day, lambda layer: layer.window(*part))
        return values

    def _fill(
        self,
        values: NDArray[np.float32],
        day: int,
        read: Callable[[Layer[Any]], NDArray[Any]],
    ) -> None:
        for index, disease in enumerate(DISEASES):
            field = values[index]
            field.fill(1.0)
            onset = read(self._onset[disease])
            # Few cells are ever infected: setting these is several times faster than a table for all.
            if onset.flags.c_contiguous and field.flags.c_contiguous:
                once_infected = np.flatnonzero(onset >= 0)
                field.reshape(-1)[once_infected] = self._values[disease, day][
                    onset.reshape(-1)[once_infected]
                ]
            else:
                infected = onset >= 0
                field[infected] = self._values[disease, day][onset[infected]]
        values[2] = read(self._soil[day])

    def sample(self, day: int, ix: ArrayLike, iy: ArrayLike) -> NDArray[np.float32]:
        """Give E at some cells on a day, without building the whole day.

        Parameters
        ----------
        day : int
            A kept day.
        ix, iy : int or int[n]
            Cells.

        Returns
        -------
        float32[n, 3]
            TYLCV, CCR and soil humidity, as in `values`.

        Raises
        ------
        EnvironmentDataError
            If the day is not kept, or a cell lies outside the farm or is not given by integers.
        """
        self._check_day(day)
        x, y = np.broadcast_arrays(np.atleast_1d(ix), np.atleast_1d(iy))
        if x.ndim != 1 or x.dtype.kind not in "iu" or y.dtype.kind not in "iu":
            raise EnvironmentDataError("environment: cells to sample are not integers or lists of integers")
        samples = np.empty((x.size, 3), np.float32)
        if x.size == 0:
            return samples
        width, height = self.shape
        if x.min() < 0 or y.min() < 0 or x.max() >= width or y.max() >= height:
            outside = np.flatnonzero((x < 0) | (y < 0) | (x >= width) | (y >= height))[0]
            place = f"({x[outside]}, {y[outside]})"
            msg = f"environment: cell {place} is outside the farm of {width} x {height} cells"
            raise EnvironmentDataError(msg)
        for index, disease in enumerate(DISEASES):
            # As an unsigned byte, the codes of cells never infected and without host index the end of the
            # table.
            onset = self._onset[disease].cells(x, y)
            samples[:, index] = self._values[disease, day][onset.view(np.uint8)]
        samples[:, 2] = self._soil[day].cells(x, y)
        return samples

    def matches(self, grid: FarmGrid) -> bool:
        """Whether this environment was made for this crop map."""
        return self.shape == grid.shape and self.provenance.grid_sha256 == grid_digest(grid)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Save to a folder, which appears complete or not at all (`docs/environment.md` describes it).

        Parameters
        ----------
        path : path-like
            The folder; an older environment there is replaced, anything else is not.

        Raises
        ------
        EnvironmentDataError
            If the folder holds something else or cannot be written.
        """
        from sensors.environment.storage import save_environment

        save_environment(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, lazy: bool = True) -> Environment:
        """Load from a folder.

        Parameters
        ----------
        path : path-like
            A folder that `save` or `generate_environment` wrote.
        lazy : bool
            Decode what is used when it is used, instead of all at once.

        Raises
        ------
        EnvironmentDataError
            If a file is missing or is not what it claims; the text names the file. What is read later is
            checked then, with the same error.
        """
        from sensors.environment.storage import load_environment

        return load_environment(path, lazy=lazy)


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
        msg = f"environment: window {name} {start}:{stop} is not a part of the farm's 0:{size} without steps"
        raise EnvironmentDataError(msg)
    return slice(start, stop)


def grid_digest(grid: FarmGrid) -> str:
    """Digest of a crop map: SHA-256, hexadecimal, of its shape and its bytes."""
    digest = hashlib.sha256(f"{grid.shape[0]}x{grid.shape[1]};".encode())
    digest.update(np.ascontiguousarray(grid.crop, np.int8).data)
    return digest.hexdigest()
