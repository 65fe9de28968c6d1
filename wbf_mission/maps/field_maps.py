"""Sums of an estimate over each pixel: the number of sick plants or the sum of values, and its variance.

*Number of sick plants.* This is the number of observed sick plants plus the expected number of unobserved
sick plants. The expected number is the sum of the class probabilities of being sick or, without class
probabilities, the sum of 1 - value over unobserved plants, divided by the mean of 1 - value over sick plants.

*Variance.* The plants of an outbreak are sick together. The variance of a sum over plants is therefore larger
than the sum of the plants' variances, by a factor of about the number of plants in an outbreak. Observations
reduce this factor: if every tenth plant is observed, the factor is at most ten.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from geo.grid import FarmGrid
from sensors.dynamics.epidemic import Outbreak, outbreak_of
from sensors.fields import PAPER_FIELDS, Field, FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel, column_strips, least_sick
from wbf_mission.maps import blocks
from wbf_mission.maps.blocks import COUNT, ILLNESS, SICK, SICK_BELOW, SPREAD, MapGrid

Floats = NDArray[np.float64]

SHARE_OF_A_HUMP = 0.05
"""Fraction of the farm over which the errors of a continuous field are fully correlated."""
_PRIOR_SICK = 10.0  # Weight of the epidemic model's mean illness, as a number of observed sick plants.
_DAY_BEFORE = 6  # Assumed day of an estimate without observations, as in the estimators.


@dataclass(frozen=True, slots=True, eq=False)
class _FieldCells:
    """Makes the masks of a field's cells; each mask is only for a strip of columns, to save memory."""

    field: Field
    grid: FarmGrid
    seen_x: NDArray[np.int64]  # The observed cells of the field
    seen_y: NDArray[np.int64]
    only_seen: bool

    def mask(self, columns: slice) -> NDArray[np.bool_]:
        """Return a new mask of the strip's cells that are summed."""
        mask = self.field.mask(self.grid, columns)
        if self.only_seen:
            mask[:] = False
            mask[self._seen(columns)] = True
        return mask

    def unseen(self, mask: NDArray[np.bool_], columns: slice) -> NDArray[np.bool_]:
        """Return a copy of `mask`, a mask of these columns, without the observed cells."""
        unseen = mask.copy()
        unseen[self._seen(columns)] = False
        return unseen

    def _seen(self, columns: slice) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        within = (self.seen_x >= columns.start) & (self.seen_x < columns.stop)
        return self.seen_x[within] - columns.start, self.seen_y[within]


@dataclass(frozen=True, slots=True, eq=False)
class FieldMap:
    """Sums of one field over each pixel of a `MapGrid`: float64[pixels along x, pixels along y]."""

    field: Field
    grid: MapGrid
    cells: Floats  # Number of the owner's cells with the field's crops.
    total: Floats  # Disease: expected number of sick plants; continuous field: sum of the values.
    least: Floats  # Minimum value of a pixel's cells; infinite in pixels without cells.
    # Sum of the variances of the cells, in squared units of `total`; None if the estimator states no variance
    variance: Floats | None
    # Number of observed cells, and number of observed sick cells
    seen: Floats
    seen_sick: Floats
    finds: NDArray[np.int32]  # Cells of the observed sick plants, int32[n, 2].
    together: float = 1.0  # Number of cells with fully correlated errors.
    # Number of unobserved plants that may be sick (`InformationModel.may_be_sick`), or None if the estimator
    # has no class probabilities
    may_be_sick: Floats | None = None
    # Continuous field: sum of the readings of the observed cells, or None for a disease or a true map
    seen_total: Floats | None = None

    @property
    def share(self) -> Floats:
        """Fraction of sick plants or mean value of each pixel, or NaN in pixels without cells."""
        return np.where(self.cells > 0, self.total / np.maximum(self.cells, 1.0), np.nan)

    @property
    def deviation(self) -> Floats | None:
        """Standard deviation of `share`, NaN in pixels without cells; None if `variance` is None."""
        if self.variance is None:
            return None
        cells = np.maximum(self.cells, 1.0)
        # A pixel smaller than an outbreak is sick or healthy as a whole.
        deviation = np.sqrt(self.variance * np.minimum(self.together, cells)) / cells
        return np.where(self.cells > 0, deviation, np.nan)


def together_cells(cells: float, seen: float, outbreak: Outbreak | None) -> float:
    """Return the number of cells whose errors count as fully correlated.

    `cells` is the number of the field's cells, and `seen` the number of observed cells. `outbreak` is None
    for a continuous field.
    """
    if outbreak is None:
        return max(1.0, SHARE_OF_A_HUMP * cells)
    return max(1.0, min(outbreak.together, cells / max(seen, 1.0)))


def field_maps(
    farm: Farm,
    model: InformationModel,
    observations: Observations,
    *,
    fields: FieldSet = PAPER_FIELDS,
    states_deviation: bool = True,
    only_seen: bool = False,
    day: int | None = None,
    grid: MapGrid | None = None,
) -> tuple[FieldMap, ...]:
    """Return the map of each field: the sums of an estimate over each pixel.

    Only the last reading of each cell on `day` is used.

    Parameters
    ----------
    model : InformationModel
        Estimate in the order of `fields`. If its values are not means, it must have class probabilities.
    states_deviation : bool
        Whether the uncertainty of `model` is a standard deviation.
    only_seen : bool
        Leave out the cells without an observation.
    day : int, optional
        Day of the estimate; by default the last day with observations.
    grid : MapGrid, optional
        Grid of the pixels; by default the grid of the pictures.
    """
    grid, cells = grid or MapGrid.of(farm), farm.grid()
    if day is None:
        day = int(observations.day.max()) if len(observations) else _DAY_BEFORE
    today = observations[observations.day == day]
    flat = today.x.astype(np.int64) * farm.height_cells + today.y
    _, first = np.unique(flat[::-1], return_index=True)
    last = len(flat) - 1 - first
    x, y = np.divmod(flat[last], farm.height_cells)
    readings = today.values[last].astype(np.float64)
    probabilities = model.probabilities or {}
    maps = []
    for k, field in enumerate(fields):
        outbreak = outbreak_of(field.epidemic, cells.shape, day) if field.kind == "disease" else None
        known = np.isfinite(readings[:, k]) & field.mask(cells, (x, y))
        seen_x, seen_y, seen = x[known], y[known], readings[known, k]
        concerned = _FieldCells(field, cells, seen_x, seen_y, only_seen)
        may_be = None
        if field.name in probabilities:
            made, may_be = _from_probabilities(grid, concerned, model, k)
        else:
            deviation = model.uncertainty[k] if states_deviation else None
            made = _from_values(grid, concerned, model.value[k], deviation, seen, outbreak)
        total, variance, count, least = made
        sick = (seen < SICK_BELOW) & (field.kind == "disease")
        at = (seen_x // grid.pixel, seen_y // grid.pixel)
        all_seen, sick_seen, sum_seen = (np.zeros(grid.pixels) for _ in range(3))
        np.add.at(all_seen, at, 1.0)
        np.add.at(sick_seen, at, sick)
        np.add.at(sum_seen, at, np.clip(seen, 0.0, 1.0))
        finds = np.stack([seen_x[sick], seen_y[sick]], axis=1).astype(np.int32)
        together = together_cells(float(count.sum()), float(all_seen.sum()), outbreak)
        maps.append(
            FieldMap(
                field,
                grid,
                count,
                total,
                least,
                variance,
                all_seen,
                sick_seen,
                finds,
                together,
                may_be,
                None if field.kind == "disease" else sum_seen,
            )
        )
    return tuple(maps)


def true_map(farm: Farm, field: Field, truth: NDArray[np.float32], k: int) -> FieldMap:
    """Return the map of the true values of a field, which are `truth[k]` of `truth`, float32[n, W, H]."""
    grid, cells = MapGrid.of(farm), farm.grid()

    def summed(columns: slice, strip: MapGrid) -> tuple[Floats, Floats]:
        return pixel_sums(strip, field.mask(cells, columns), truth[k, columns])

    sums, least = _by_strips(grid, summed)
    total = sums[..., SICK] if field.kind == "disease" else sums[..., COUNT] - sums[..., ILLNESS]
    nothing = np.zeros(grid.pixels)
    return FieldMap(
        field, grid, sums[..., COUNT], total, least, None, nothing, nothing, np.empty((0, 2), np.int32)
    )


def _summing(grid: MapGrid) -> ModuleType:
    """Return the module that computes the sums: numpy for pixels of one cell, otherwise compiled code."""
    if grid.pixel == 1:
        return blocks
    from wbf_mission.maps import block_sums

    return block_sums


def pixel_sums(grid: MapGrid, mask: NDArray[np.bool_], value: NDArray[np.float32]) -> tuple[Floats, Floats]:
    """Return the sums of `block_sums.sum_pixels` and the minimum of each pixel, for values in 0..1."""
    sums, least = np.zeros((*grid.pixels, 4)), np.full(grid.pixels, np.inf)
    _summing(grid).sum_pixels(mask, value, grid.pixel, sums, least)
    return sums, least


def pixel_means(grid: MapGrid, mask: NDArray[np.bool_], value: NDArray[np.float32]) -> Floats:
    """Return the mean of the masked values in each pixel, or NaN in pixels without masked cells."""
    sums, _ = pixel_sums(grid, mask, value)
    count = sums[..., COUNT]
    return np.where(count > 0, 1.0 - sums[..., ILLNESS] / np.maximum(count, 1.0), np.nan)


def _by_strips(grid: MapGrid, sums: Callable[[slice, MapGrid], tuple[Floats, ...]]) -> tuple[Floats, ...]:
    """Return arrays over all pixels; `sums` computes them for each strip (its columns and its grid)."""
    parts = [
        sums(columns, replace(grid, shape=(columns.stop - columns.start, grid.shape[1])))
        for columns in column_strips(grid.shape[0], grid.pixel)
    ]
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


def _from_probabilities(
    grid: MapGrid, cells: _FieldCells, model: InformationModel, k: int
) -> tuple[tuple[Floats, Floats | None, Floats, Floats], Floats]:
    """Return for each pixel (sick plants, variance, cells, minimum value) and how many plants may be sick."""
    sick, counted = [], []

    def expected(columns: slice, strip: MapGrid) -> tuple[Floats, Floats]:
        (healthy, *_) = model.probabilities_in(model.fields[k], columns)
        mask = cells.mask(columns)
        sick.append(1.0 - healthy[cells.unseen(mask, columns)])
        counted.append(np.unique(sick[-1], return_counts=True))
        return pixel_sums(strip, mask, healthy)[0], pixel_sums(strip, mask, model.value[k, columns])[1]

    sums, least = _by_strips(grid, expected)
    least_sick_unseen = least_sick(*(np.concatenate(part) for part in zip(*counted, strict=True)))
    of_strips = iter(sick)

    def suspected(columns: slice, strip: MapGrid) -> tuple[Floats, Floats]:
        may_be = cells.unseen(cells.mask(columns), columns)
        may_be[may_be] = next(of_strips) >= least_sick_unseen
        return pixel_sums(strip, may_be, model.value[k, columns])

    may_be, _ = _by_strips(grid, suspected)
    return (sums[..., ILLNESS], sums[..., SPREAD], sums[..., COUNT], least), may_be[..., COUNT]


def _from_values(
    grid: MapGrid,
    cells: _FieldCells,
    value: NDArray[np.float32],
    deviation: NDArray[np.float32] | None,
    seen: Floats,
    outbreak: Outbreak | None,
) -> tuple[Floats, Floats | None, Floats, Floats]:
    """Return for each pixel (sick plants or sum of values, variance, number of cells, minimum value)."""

    def summed(columns: slice, strip: MapGrid) -> tuple[Floats, Floats, Floats]:
        mask, squares = cells.mask(columns), np.zeros(strip.pixels)
        if deviation is not None:
            _summing(strip).sum_squares(mask, deviation[columns], strip.pixel, squares)
        return *pixel_sums(strip, mask, value[columns]), squares

    sums, least, squares = _by_strips(grid, summed)
    variance = None if deviation is None else squares
    if outbreak is None:
        return sums[..., COUNT] - sums[..., ILLNESS], variance, sums[..., COUNT], least
    # Observed plants are counted; unobserved plants contribute their expected number.
    x, y = cells.seen_x, cells.seen_y
    at = (x // grid.pixel, y // grid.pixel)
    illness = sums[..., ILLNESS].copy()
    np.subtract.at(illness, at, 1.0 - value[x, y].astype(np.float64))
    sick = seen < SICK_BELOW
    a_plant = (_PRIOR_SICK * outbreak.illness + float((1.0 - seen[sick]).sum())) / (_PRIOR_SICK + sick.sum())
    total = np.clip(illness / a_plant, 0.0, sums[..., COUNT])
    np.add.at(total, at, sick.astype(np.float64))
    if variance is not None and deviation is not None:
        np.subtract.at(variance, at, deviation[x, y].astype(np.float64) ** 2)
        variance = np.maximum(variance, 0.0) / a_plant**2
    return total, variance, sums[..., COUNT], least
