"""What the farmer wants to know after a flight: how much is sick, where, and how sure that is.

A cell stands for a plant. Everything is told for the owner's cells of the field's crops, for the whole farm
and by blocks (`wbf_mission.blocks.MapGrid`).

*How much is sick.* The observed sick plants are counted. Of the others the expected number is taken: the sum
of their probabilities, if the estimator has them; else the sum of what its values lie below 1, divided by how
far a sick plant lies below it on average.

*How sure.* Plants of an outbreak are sick together, so the variance of a sum of plants is larger than the sum
of their variances, by about the number of plants in an outbreak (`wbf_mission.outbreaks`), or in the part of
it that no look tells of: where every tenth plant is looked at, ten. The 90 % intervals are those of a gamma
distribution with the mean and variance of the plants that were not observed.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from sensors.fields import PAPER_FIELDS, Field, FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from wbf_mission.blocks import COUNT, ILLNESS, SICK, SICK_BELOW, SPREAD, MapGrid, sum_pixels, sum_squares
from wbf_mission.outbreaks import Outbreak, outbreak_of

Floats = NDArray[np.float64]

SHARE_OF_A_HUMP = 0.05
"""Part of the farm over which the errors of a continuous field are one."""
_INTERVAL = (0.05, 0.95)
_NORMAL_90 = 1.6449
_LEAST_SHAPE = 1e-6
_TOLD_BLOCKS = 3
_LEAST_PART_OF_A_BLOCK = 0.1
_PRIOR_SICK = 10.0
_DAY_BEFORE = 6  # that is assumed without observations, as estimators do


@dataclass(frozen=True, slots=True, eq=False)
class FieldMap:
    """One field by pixels (`MapGrid`), all arrays float64[pixels along x, pixels along y].

    Parameters
    ----------
    field : Field
    grid : MapGrid
    cells : float64
        The owner's cells with the field's crops.
    total : float64
        Of a disease the expected number of sick plants, else the sum of the values.
    least : float64
        The least value of a cell; infinite where there is no cell.
    variance : float64 or None
        The sum of the variances of the cells, in units of `total`; None if the estimator does not tell them.
    seen, seen_sick : float64
        Observed cells, and how many of them were sick.
    finds : int32[n, 2]
        The cells of the sick plants that were seen.
    together : float
        How many cells err as one.
    """

    field: Field
    grid: MapGrid
    cells: Floats
    total: Floats
    least: Floats
    variance: Floats | None
    seen: Floats
    seen_sick: Floats
    finds: NDArray[np.int32]
    together: float = 1.0

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


@dataclass(frozen=True, slots=True)
class BlockReport:
    """One block: name on the map, middle, number of cells, share of sick plants or mean value."""

    name: str
    latitude_deg: float
    longitude_deg: float
    x_m: float
    y_m: float
    cells: int
    expected: float
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class FieldReport:
    """What is believed of one field.

    Parameters
    ----------
    name, title, kind : str
        Of the field.
    cells : int
        The owner's cells with its crops.
    seen, seen_sick : int
        How many were observed, and how many of those were sick (0 of a continuous field).
    expected : float
        Of a disease the share of sick plants, else the mean value.
    low, high : float or None
        Its 90 % interval, None if the estimator does not tell how sure it is.
    blocks : tuple of BlockReport
        The worst ones: most sick plants, or the least values.
    """

    name: str
    title: str
    kind: str
    cells: int
    seen: int
    seen_sick: int
    expected: float
    low: float | None
    high: float | None
    blocks: tuple[BlockReport, ...]


@dataclass(frozen=True, slots=True)
class FarmReport:
    """What a flight tells the farmer; fields whose crops the owner does not grow are left out."""

    farm: str
    block_m: float
    fields: tuple[FieldReport, ...]

    def rows(self) -> dict[str, str]:
        """Return one sentence for each field, by its title."""
        return {field.title: _sentence(field) for field in self.fields}

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {
            "block_m": self.block_m,
            "fields": {
                field.name: {**asdict(field), "blocks": [asdict(b) for b in field.blocks]}
                for field in self.fields
            },
        }


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
) -> tuple[FieldMap, ...]:
    """Sum an estimate by pixels.

    Parameters
    ----------
    farm : Farm
    model : InformationModel
        The estimate, float32[n, W, H]. One whose values are not means needs its class probabilities.
    observations : Observations
        What was observed; the last reading of a cell counts.
    fields : FieldSet
        The fields of the model, in its order.
    states_deviation : bool
        Whether the model's uncertainty is a standard deviation.
    """
    grid, cells = MapGrid.of(farm), farm.grid()
    day = int(observations.day.max()) if len(observations) else _DAY_BEFORE
    x, y, readings = _last_readings(observations, farm.height_cells)
    probabilities = model.probabilities or {}
    maps = []
    for k, field in enumerate(fields):
        mask = field.mask(cells)
        outbreak = outbreak_of(field.epidemic, cells.shape, day) if field.kind == "disease" else None
        known = np.isfinite(readings[:, k]) & mask[x, y]
        seen_x, seen_y, seen = x[known], y[known], readings[known, k]
        if field.name in probabilities:
            made = _from_probabilities(grid, mask, probabilities[field.name][0], model.value[k])
        else:
            deviation = model.uncertainty[k] if states_deviation else None
            made = _from_values(grid, mask, model.value[k], deviation, seen_x, seen_y, seen, outbreak)
        total, variance, count, least = made
        sick = (seen < SICK_BELOW) & (field.kind == "disease")
        at = (seen_x // grid.pixel, seen_y // grid.pixel)
        all_seen, sick_seen = np.zeros(grid.pixels), np.zeros(grid.pixels)
        np.add.at(all_seen, at, 1.0)
        np.add.at(sick_seen, at, sick)
        finds = np.stack([seen_x[sick], seen_y[sick]], axis=1).astype(np.int32)
        together = together_cells(float(count.sum()), float(all_seen.sum()), outbreak)
        maps.append(
            FieldMap(field, grid, count, total, least, variance, all_seen, sick_seen, finds, together)
        )
    return tuple(maps)


def true_map(farm: Farm, field: Field, truth: NDArray[np.float32]) -> FieldMap:
    """Sum the true values [W, H] of a field by pixels."""
    grid = MapGrid.of(farm)
    sums, least = _sums(grid, field.mask(farm.grid()), truth)
    nothing = np.zeros(grid.pixels)
    total = sums[..., SICK] if field.kind == "disease" else sums[..., COUNT] - sums[..., ILLNESS]
    return FieldMap(
        field, grid, sums[..., COUNT], total, least, None, nothing, nothing, np.empty((0, 2), np.int32)
    )


def farm_report(
    farm: Farm,
    model: InformationModel,
    observations: Observations,
    *,
    fields: FieldSet = PAPER_FIELDS,
    states_deviation: bool = True,
) -> FarmReport:
    """Tell what an estimate says of the farm; parameters as of `field_maps`."""
    maps = field_maps(
        farm,
        model,
        observations,
        fields=fields,
        states_deviation=states_deviation,
    )
    return report_of_maps(farm, maps)


def report_of_maps(farm: Farm, maps: tuple[FieldMap, ...]) -> FarmReport:
    """Tell what the maps of the fields say."""
    told = tuple(_report(farm, one) for one in maps if one.cells.any())
    return FarmReport(farm.name, MapGrid.of(farm).block * farm.cell_size_m, told)


def _report(farm: Farm, of: FieldMap) -> FieldReport:
    grid, field = of.grid, of.field
    cells = float(of.cells.sum())
    variance = None if of.variance is None else float(of.variance.sum())
    expected, low, high = _interval(of, cells, float(of.total.sum()), variance, float(of.seen_sick.sum()))
    by_cells, by_total, by_sick = (grid.by_block(part) for part in (of.cells, of.total, of.seen_sick))
    by_variance = None if of.variance is None else grid.by_block(of.variance)
    share = np.divide(by_total, by_cells, out=np.full_like(by_total, np.nan), where=by_cells > 0)
    # A corner of a field is no block to send anybody to.
    large = by_cells >= min(_LEAST_PART_OF_A_BLOCK * grid.block**2, by_cells.max())
    worse = share if field.kind == "disease" else -share
    order = np.argsort(np.where(large, worse, -np.inf), axis=None)[::-1][:_TOLD_BLOCKS]
    blocks = []
    for i, j in zip(*np.unravel_index(order, share.shape), strict=True):
        if not large[i, j]:
            continue
        one_variance = None if by_variance is None else float(by_variance[i, j])
        numbers = _interval(
            of, float(by_cells[i, j]), float(by_total[i, j]), one_variance, float(by_sick[i, j])
        )
        x_m, y_m = (
            0.5 * (n * grid.block + min((n + 1) * grid.block, side)) * farm.cell_size_m
            for n, side in zip((int(i), int(j)), grid.shape, strict=True)
        )
        latitude, longitude = farm.frame.to_wgs84(x_m, y_m)
        blocks.append(
            BlockReport(
                grid.name(int(i), int(j)), latitude, longitude, x_m, y_m, int(by_cells[i, j]), *numbers
            )
        )
    return FieldReport(
        field.name,
        field.title,
        field.kind,
        int(cells),
        int(of.seen.sum()),
        int(of.seen_sick.sum()),
        expected,
        low,
        high,
        tuple(blocks),
    )


def _interval(
    of: FieldMap, cells: float, total: float, variance: float | None, sick: float
) -> tuple[float, float | None, float | None]:
    """Return the expected share or mean value, and its 90 % interval."""
    if variance is None:
        return total / cells, None, None
    spread = variance * min(of.together, cells)
    if of.field.kind == "disease":
        low, high = gamma_interval(max(total - sick, 0.0), spread)
        low, high = sick + low, sick + high
    else:
        low, high = (total + sign * _NORMAL_90 * math.sqrt(spread) for sign in (-1.0, 1.0))
    return total / cells, max(low / cells, 0.0), min(high / cells, 1.0)


def gamma_interval(mean: float, variance: float) -> tuple[float, float]:
    """Return the central 90 % of a gamma distribution, which may be widened to hold the mean.

    Examples
    --------
    >>> [round(end, 2) for end in gamma_interval(100.0, 25.0)], gamma_interval(3.0, 0.0)
    ([91.92, 108.36], (3.0, 3.0))
    """
    if mean <= 0.0 or variance <= 0.0:
        return max(mean, 0.0), max(mean, 0.0)
    from scipy.special import gammaincinv

    shape = min(max(mean / variance * mean, _LEAST_SHAPE), 1.0 / _LEAST_SHAPE)
    low, high = gammaincinv(shape, _INTERVAL) * (mean / shape)
    return min(float(low), mean), max(float(high), mean)


def _sums(grid: MapGrid, mask: NDArray[np.bool_], value: NDArray[np.float32]) -> tuple[Floats, Floats]:
    sums, least = np.zeros((*grid.pixels, 4)), np.full(grid.pixels, np.inf)
    sum_pixels(mask, value, grid.pixel, sums, least)
    return sums, least


def _from_probabilities(
    grid: MapGrid, mask: NDArray[np.bool_], healthy: NDArray[np.float32], value: NDArray[np.float32]
) -> tuple[Floats, Floats | None, Floats, Floats]:
    """Return sick plants, their variance, the cells and the least value."""
    sums, _ = _sums(grid, mask, healthy)
    _, least = _sums(grid, mask, value)
    return sums[..., ILLNESS], sums[..., SPREAD], sums[..., COUNT], least


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
    sums, least = _sums(grid, mask, value)
    squares = None
    if deviation is not None:
        squares = np.zeros(grid.pixels)
        sum_squares(mask, deviation, grid.pixel, squares)
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
    """Return the cells that were observed on the latest day, and the last readings of each."""
    if not len(observations):
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, observations.values.shape[1]))
    chosen = observations[observations.day == observations.day.max()]
    flat = chosen.x.astype(np.int64) * height + chosen.y
    _, first = np.unique(flat[::-1], return_index=True)
    last = len(flat) - 1 - first
    x, y = np.divmod(flat[last], height)
    return x, y, chosen.values[last].astype(np.float64)


def _percent(share: float) -> str:
    percent = 100.0 * share
    return f"{percent:.2g} %" if percent < 10.0 else f"{percent:.0f} %"


def _number(count: int) -> str:
    return f"{count:,}" if count < 1_000_000 else f"{count / 1e6:.1f} million"


def _sentence(field: FieldReport) -> str:
    """Return a field's report as a farmer reads it."""
    if field.kind == "disease":
        plants = "plant" if field.seen_sick == 1 else "plants"
        text = f"{_percent(field.expected)} of {_number(field.cells)} plants expected sick"
        if field.low is not None and field.high is not None:
            text += f" (90 %: {_percent(field.low)} to {_percent(field.high)})"
        text += f"; {_number(field.seen_sick)} sick {plants} seen among {_number(field.seen)} looked at"
        worst = [f"{_where(block)} {_percent(block.expected)}" for block in field.blocks]
        return f"{text}; worst blocks {', '.join(worst)}" if worst else text
    text = f"{field.expected:.2f} on average"
    if field.low is not None and field.high is not None:
        text += f" (90 %: {field.low:.2f} to {field.high:.2f})"
    lowest = [f"{_where(block)} {block.expected:.2f}" for block in field.blocks]
    return f"{text}; lowest blocks {', '.join(lowest)}" if lowest else text


def _where(block: BlockReport) -> str:
    return f"{block.name} ({block.latitude_deg:.5f}, {block.longitude_deg:.5f})"
