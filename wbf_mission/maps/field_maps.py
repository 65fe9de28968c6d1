"""An estimate summed by pixels and blocks: how much of a field is sick, and how far that may be wrong.

*How much is sick.* The observed sick plants are counted. Of the others the expected number is taken: the sum
of their probabilities, if the estimator has them; else the sum of what its values lie below 1, divided by how
far a sick plant lies below it on average.

*How sure.* Plants of an outbreak are sick together, so the variance of a sum of plants is larger than the sum
of their variances, by about the number of plants in an outbreak, or in the part of it that
no look tells of: where every tenth plant is looked at, ten.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from sensors.dynamics.epidemic import Outbreak, outbreak_of
from sensors.fields import PAPER_FIELDS, Field, FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel, column_strips, least_sick
from wbf_mission.maps import blocks
from wbf_mission.maps.blocks import COUNT, ILLNESS, SICK, SICK_BELOW, SPREAD, MapGrid

Floats = NDArray[np.float64]

SHARE_OF_A_HUMP = 0.05
"""Part of the farm over which the errors of a continuous field are one."""
_PRIOR_SICK = 10.0
_DAY_BEFORE = 6  # that is assumed without observations, as estimators do


@dataclass(frozen=True, slots=True, eq=False)
class FieldMap:
    """One field by pixels (`MapGrid`), all arrays float64[pixels along x, pixels along y]."""

    field: Field
    grid: MapGrid
    cells: Floats  # The owner's cells with the field's crops
    total: Floats  # Of a disease the expected number of sick plants, else the sum of the values
    least: Floats  # The least value of a cell; infinite where there is no cell
    # The sum of the variances of the cells, in units of `total`; None if the estimator does not tell them
    variance: Floats | None
    # Observed cells, and how many of them were sick
    seen: Floats
    seen_sick: Floats
    finds: NDArray[np.int32]  # int32[n, 2]: the cells of the sick plants that were seen
    together: float = 1.0  # How many cells err as one
    # The plants that nobody looked at and that may be sick (`InformationModel.may_be_sick`); None if the
    # estimator has no class probabilities
    may_be_sick: Floats | None = None
    # Of a continuous field the sum of the readings of the observed cells; None where it was not kept
    seen_total: Floats | None = None

    @property
    def share(self) -> Floats:
        """The part of the plants that is sick, or the mean value; NaN where there is no cell."""
        share: Floats = np.where(self.cells > 0, self.total / np.maximum(self.cells, 1.0), np.nan)
        return share

    @property
    def deviation(self) -> Floats | None:
        """The standard deviation of `share`; None if nothing tells it, NaN where there is no cell."""
        if self.variance is None:
            return None
        cells = np.maximum(self.cells, 1.0)
        # A pixel smaller than an outbreak is sick or healthy as a whole.
        deviation = np.sqrt(self.variance * np.minimum(self.together, cells)) / cells
        return np.where(self.cells > 0, deviation, np.nan)


def together_cells(cells: float, seen: float, outbreak: Outbreak | None) -> float:
    """Return how many cells err as one, where so many of a field's cells were observed."""
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
    """Sum an estimate, float32[n, W, H] in the order of `fields`, by pixels.

    One whose values are not means needs its class probabilities. `states_deviation` tells whether its
    uncertainty is a standard deviation.
    With `only_seen` the cells that were not observed are left out. The last reading of a cell on the day of
    the estimate counts; by default that is the latest day that was observed. The pixels are those of `grid`,
    else of the pictures.
    """
    grid, cells = grid or MapGrid.of(farm), farm.grid()
    if day is None:
        day = int(observations.day.max()) if len(observations) else _DAY_BEFORE
    x, y, readings = _last_readings(observations[observations.day == day], farm.height_cells)
    probabilities = model.probabilities or {}
    maps = []
    for k, field in enumerate(fields):
        mask = field.mask(cells)
        outbreak = outbreak_of(field.epidemic, cells.shape, day) if field.kind == "disease" else None
        known = np.isfinite(readings[:, k]) & mask[x, y]
        seen_x, seen_y, seen = x[known], y[known], readings[known, k]
        if only_seen:
            mask = np.zeros_like(mask)
            mask[seen_x, seen_y] = True
        may_be = None
        if field.name in probabilities:
            open_ = mask.copy()
            open_[seen_x, seen_y] = False
            made, may_be = _from_probabilities(grid, mask, open_, model, k)
        else:
            deviation = model.uncertainty[k] if states_deviation else None
            made = _from_values(grid, mask, model.value[k], deviation, seen_x, seen_y, seen, outbreak)
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


def true_map(farm: Farm, field: Field, truth: NDArray[np.float32]) -> FieldMap:
    """Sum the true values [W, H] of a field by pixels."""
    grid = MapGrid.of(farm)
    sums, least = pixel_sums(grid, field.mask(farm.grid()), truth)
    nothing = np.zeros(grid.pixels)
    total = sums[..., SICK] if field.kind == "disease" else sums[..., COUNT] - sums[..., ILLNESS]
    return FieldMap(
        field, grid, sums[..., COUNT], total, least, None, nothing, nothing, np.empty((0, 2), np.int32)
    )


def _summing(grid: MapGrid) -> ModuleType:
    """Choose what sums: loading compiled code takes longer than all sums over a farm shown cell by cell."""
    if grid.pixel == 1:
        return blocks
    from wbf_mission.maps import block_sums

    return block_sums


def pixel_sums(grid: MapGrid, mask: NDArray[np.bool_], value: NDArray[np.float32]) -> tuple[Floats, Floats]:
    """Return the sums of values in 0..1 by pixels, float64[..., 4] in the order of `COUNT`, and the least."""
    sums, least = np.zeros((*grid.pixels, 4)), np.full(grid.pixels, np.inf)
    _summing(grid).sum_pixels(mask, value, grid.pixel, sums, least)
    return sums, least


def pixel_means(grid: MapGrid, mask: NDArray[np.bool_], value: NDArray[np.float32]) -> Floats:
    """Return the means of values over the pixels of a farm, NaN where the mask has no cell."""
    sums, _ = pixel_sums(grid, mask, value)
    count = sums[..., COUNT]
    return np.where(count > 0, 1.0 - sums[..., ILLNESS] / np.maximum(count, 1.0), np.nan)


def _from_probabilities(
    grid: MapGrid, mask: NDArray[np.bool_], open_: NDArray[np.bool_], model: InformationModel, k: int
) -> tuple[tuple[Floats, Floats | None, Floats, Floats], Floats]:
    """Return (sick plants, their variance, cells, least value) and the plants that may be sick, by pixels.

    `open_` marks the plants that were not observed. Afterwards it marks those that may be sick.
    """
    value = model.value[k]
    parts, sick = [], []
    # Strips of whole pixels save memory: the probabilities of a farm are as large as three fields.
    for columns in column_strips(len(mask), grid.pixel):
        (healthy, *_) = model.probabilities_in(model.fields[k], columns)
        strip = replace(grid, shape=healthy.shape)
        parts.append(pixel_sums(strip, mask[columns], healthy)[0])
        sick.append(1.0 - healthy[open_[columns]])
    sums, unseen = np.concatenate(parts), np.concatenate(sick)
    open_[open_] = unseen >= least_sick(unseen)
    may_be = pixel_sums(grid, open_, value)[0][..., COUNT]
    _, least = pixel_sums(grid, mask, value)
    return (sums[..., ILLNESS], sums[..., SPREAD], sums[..., COUNT], least), may_be


def _from_values(
    grid: MapGrid,
    mask: NDArray[np.bool_],
    value: NDArray[np.float32],
    deviation: NDArray[np.float32] | None,
    x: NDArray[np.int64],
    y: NDArray[np.int64],
    seen: Floats,
    outbreak: Outbreak | None,
) -> tuple[Floats, Floats | None, Floats, Floats]:
    """Return sick plants or the sum of values, its variance, the cells and the least value."""
    sums, least = pixel_sums(grid, mask, value)
    squares = None
    if deviation is not None:
        squares = np.zeros(grid.pixels)
        _summing(grid).sum_squares(mask, deviation, grid.pixel, squares)
    if outbreak is None:
        return sums[..., COUNT] - sums[..., ILLNESS], squares, sums[..., COUNT], least
    # Plants that were looked at are counted, the others are expected.
    at = (x // grid.pixel, y // grid.pixel)
    illness = sums[..., ILLNESS].copy()
    np.subtract.at(illness, at, 1.0 - value[x, y].astype(np.float64))
    sick = seen < SICK_BELOW
    a_plant = (_PRIOR_SICK * outbreak.illness + float((1.0 - seen[sick]).sum())) / (_PRIOR_SICK + sick.sum())
    total = np.clip(illness / a_plant, 0.0, sums[..., COUNT])
    np.add.at(total, at, sick.astype(np.float64))
    if squares is not None and deviation is not None:
        np.subtract.at(squares, at, deviation[x, y].astype(np.float64) ** 2)
        squares = np.maximum(squares, 0.0) / a_plant**2
    return total, squares, sums[..., COUNT], least


def _last_readings(
    observations: Observations, height: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Return the cells that were observed, and the last readings of each."""
    flat = observations.x.astype(np.int64) * height + observations.y
    _, first = np.unique(flat[::-1], return_index=True)
    last = len(flat) - 1 - first
    x, y = np.divmod(flat[last], height)
    return x, y, observations.values[last].astype(np.float64)
