"""The environment E over days: what is really there, which planners and estimators never see."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sensors.environment.epidemic import IMMUNE, SUSCEPTIBLE
from sensors.environment.model import DISEASES, Disease, EnvironmentModel
from sensors.environment.outbreak import NO_HOST, status_table, value_table
from sensors.errors import EnvironmentDataError

if TYPE_CHECKING:
    from geo.grid import FarmGrid

_T = TypeVar("_T", bound=np.generic)


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
        (`sensors.environment.outbreak`).
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
        self.model = model
        self.provenance = provenance or Provenance()
        self.shape: tuple[int, int] = (first.shape[0], first.shape[1])
        self.days: tuple[int, ...] = tuple(sorted(soil))
        if not self.days:
            raise EnvironmentDataError("environment: it has no day; keep at least one")
        self._onset = {
            disease: self._checked(f"onset of {disease}", onset[disease], np.int8) for disease in DISEASES
        }
        self._soil = {day: self._checked(f"soil of day {day}", soil[day], np.float32) for day in self.days}
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

    def _checked(self, name: str, array: NDArray[_T], dtype: type[_T]) -> NDArray[_T]:
        if array.shape != self.shape or array.dtype != dtype:
            wanted = f"{np.dtype(dtype)}{list(self.shape)}"
            msg = f"environment: {name} is {array.dtype}{list(array.shape)} instead of {wanted}"
            raise EnvironmentDataError(msg)
        view = np.ascontiguousarray(array).view()
        view.flags.writeable = False
        return view

    def _check_day(self, day: int) -> None:
        if day not in self._soil:
            kept = ", ".join(map(str, self.days))
            raise EnvironmentDataError(f"environment: day {day} is not kept; kept days: {kept}")

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
        if disease not in self._onset:
            raise EnvironmentDataError(
                f"environment: unknown disease {disease!r}; known: {', '.join(DISEASES)}"
            )
        return self._onset[disease]

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
        onset = self.onset(disease)
        self._check_day(day)
        status = np.where(onset == NO_HOST, np.int8(IMMUNE), np.int8(SUSCEPTIBLE))
        once_infected = np.flatnonzero(onset >= 0)
        status.reshape(-1)[once_infected] = self._statuses[disease, day][onset.reshape(-1)[once_infected]]
        return status

    def soil(self, day: int) -> NDArray[np.float32]:
        """Soil humidity on a kept day: float32[W, H], read-only, not copied."""
        self._check_day(day)
        return self._soil[day]

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
        for index, disease in enumerate(DISEASES):
            field = values[index]
            field.fill(1.0)
            onset = self._onset[disease].reshape(-1)
            # Few cells are ever infected: setting these is several times faster than a table for all.
            once_infected = np.flatnonzero(onset >= 0)
            field.reshape(-1)[once_infected] = self._values[disease, day][onset[once_infected]]
        values[2] = self._soil[day]
        return values

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
            samples[:, index] = self._values[disease, day][self._onset[disease][x, y].view(np.uint8)]
        samples[:, 2] = self._soil[day][x, y]
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
    def load(cls, path: str | os.PathLike[str], mmap: bool = True) -> Environment:
        """Load from a folder.

        Parameters
        ----------
        path : path-like
            A folder that `save` or `generate_environment` wrote.
        mmap : bool
            Map the files into memory and read what is used, instead of all at once.

        Raises
        ------
        EnvironmentDataError
            If a file is missing or is not what it claims; the text names the file.
        """
        from sensors.environment.storage import load_environment

        return load_environment(path, mmap=mmap)


def grid_digest(grid: FarmGrid) -> str:
    """Digest of a crop map: SHA-256, hexadecimal, of its shape and its bytes."""
    digest = hashlib.sha256(f"{grid.shape[0]}x{grid.shape[1]};".encode())
    digest.update(np.ascontiguousarray(grid.crop, np.int8).data)
    return digest.hexdigest()
