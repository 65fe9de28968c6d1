"""Generating environments."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from geo.grid import STRAWBERRY, TOMATO
from geo.seeds import root_seed, stream
from sensors.environment.environment import Environment, Provenance, grid_digest
from sensors.environment.epidemic import MAX_DAYS
from sensors.environment.model import DISEASES, Disease, EnvironmentModel
from sensors.environment.outbreak import simulate_outbreak
from sensors.environment.soil import draw_weather, soil_blocks, write_soil
from sensors.errors import EnvironmentDataError

if TYPE_CHECKING:
    from geo.grid import FarmGrid

Progress = Callable[[int, int], None]
_BYTES_A_CELL = 8
HOSTS: dict[Disease, int] = {"tylcv": TOMATO, "ccr": STRAWBERRY}
"""The crop, as in the crop map, that each disease infects."""


class _Steps:
    """Counts finished pieces of work and reports them."""

    def __init__(self, total: int, progress: Progress | None) -> None:
        self._done, self._total, self._progress = 0, total, progress

    def __call__(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self._total)


def _free_memory() -> int | None:
    try:
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        return None
    return None


def _check_memory(shape: tuple[int, int], days_in_memory: int) -> None:
    needed = shape[0] * shape[1] * (_BYTES_A_CELL + 4 * days_in_memory)
    free = _free_memory()
    if free is not None and needed > free:
        msg = (
            f"environment: {days_in_memory} days of {shape[0]} x {shape[1]} cells need {needed / 1e9:.1f} GB "
            f"of memory and {free / 1e9:.1f} GB are free; keep fewer days, or generate into a folder"
        )
        raise EnvironmentDataError(msg)


def _kept_days(days: int, keep_days: Iterable[int] | None) -> tuple[int, ...]:
    if not 0 <= days <= MAX_DAYS:
        raise EnvironmentDataError(f"environment: {days} days are not in 0..{MAX_DAYS}")
    kept = tuple(range(days + 1)) if keep_days is None else tuple(sorted({int(day) for day in keep_days}))
    if not kept:
        raise EnvironmentDataError("environment: keep_days is empty; keep at least one day")
    if kept[0] < 0 or kept[-1] > days:
        raise EnvironmentDataError(f"environment: keep_days {kept[0]}..{kept[-1]} are not in 0..{days}")
    return kept


def generate_environment(
    grid: FarmGrid,
    *,
    days: int = 15,
    seed: SeedSequence | int,
    model: EnvironmentModel | None = None,
    progress: Progress | None = None,
    keep_days: Iterable[int] | None = None,
    farm_name: str = "",
    directory: str | os.PathLike[str] | None = None,
) -> Environment:
    """Generate the environment of a farm over some days.

    The diseases and the soil use the streams "tylcv", "ccr" and "soil" of the seed (`geo.seeds`), so they are
    independent. The diseases are the same on every machine to the last bit; the soil may differ by a rounding
    error of float32. A day's state does not depend on how many days follow or are kept.

    Parameters
    ----------
    grid : FarmGrid
        Crops of all cells, the neighbours' included.
    days : int
        Number of steps, 0..126.
    seed : SeedSequence or int
        The seed.
    model : EnvironmentModel, optional
        Parameters; the benchmark's by default.
    progress : callable, optional
        Called as ``progress(done, total)`` after each piece of work. It may raise to stop.
    keep_days : iterable of int, optional
        Days to keep, all of 0..days by default. A kept day needs four bytes a cell (for the soil), the
        diseases need two bytes a cell for all days together.
    farm_name : str
        Recorded in the provenance.
    directory : path-like, optional
        Write the days to this folder while they are computed and return them memory-mapped, so that no day is
        held in memory. The folder appears complete or, after an error or Ctrl-C, not at all.

    Returns
    -------
    Environment

    Raises
    ------
    EnvironmentDataError
        If days are out of range, memory would not suffice, or the folder cannot be written.
    geo.seeds.SeedError
        If the seed is not usable.

    Examples
    --------
    >>> from geo.grid import FarmGrid
    >>> crop = np.full((12, 12), 2, np.int8)
    >>> grid = FarmGrid((12, 12), 0.3048, crop, np.ones((12, 12), np.bool_))
    >>> environment = generate_environment(grid, days=6, seed=7)
    >>> environment.days, environment.values(6).shape
    ((0, 1, 2, 3, 4, 5, 6), (3, 12, 12))
    """
    model = model or EnvironmentModel()
    root = root_seed(seed)
    kept = _kept_days(days, keep_days)
    shape = (int(grid.shape[0]), int(grid.shape[1]))
    entropy = np.atleast_1d(np.asarray(root.entropy, dtype=object)).tolist()
    provenance = Provenance(
        farm_name, grid_digest(grid), tuple(map(str, entropy)), tuple(int(word) for word in root.spawn_key)
    )
    _check_memory(shape, 0 if directory is not None else len(kept))
    step = _Steps(len(DISEASES) * kept[-1] + soil_blocks(shape), progress)
    weather = draw_weather(shape, kept[-1], model.soil, stream(root, "soil"))

    def outbreak(disease: Disease) -> NDArray[np.int8]:
        parameters = model.epidemic(disease)
        hosts = np.asarray(grid.crop) == HOSTS[disease]
        return simulate_outbreak(hosts, parameters, kept[-1], stream(root, disease), step)

    if directory is None:
        onset = {disease: outbreak(disease) for disease in DISEASES}
        soil = {day: np.empty(shape, np.float32) for day in kept}

        def keep(day: int, first_x: int, block: NDArray[np.float32]) -> None:
            soil[day][first_x : first_x + block.shape[0]] = block

        write_soil(shape, weather, model.soil, kept, keep, step)
        return Environment(model, onset, soil, provenance)

    from sensors.environment.storage import SoilFiles, environment_folder, write_header, write_onset

    with environment_folder(directory) as folder:
        for disease in DISEASES:
            write_onset(folder, disease, outbreak(disease))
        with SoilFiles(folder, shape, kept) as files:
            write_soil(shape, weather, model.soil, kept, files, step)
        write_header(folder, shape, kept, model, provenance)
    return Environment.load(directory)
