"""Report for the farmer after a flight: fraction of sick plants, worst blocks and 90 % intervals.

A cell counts as one plant. Figures cover the owner's cells with the field's crops, over the whole farm and
for each block (`wbf_mission.maps.blocks.MapGrid`).

The number of sick plants and its variance are computed in `maps.field_maps`. The 90 % interval of a disease
comes from a gamma distribution with the mean and variance of the number of unobserved sick plants. If the
estimator states no variance, only observed plants are counted.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from geo import Farm
from wbf_mission.maps.blocks import MapGrid
from wbf_mission.maps.field_maps import FieldMap

_LEAST_SHARE = 1e-4  # Smallest fraction written with digits


@dataclass(frozen=True, slots=True)
class BlockReport:
    """Figures of one block: name, centre, number of cells, and fraction of sick plants or mean value."""

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
    """Figures of one field."""

    name: str
    title: str
    kind: str  # Kind of the field: disease or continuous.
    cells: int  # Number of the owner's cells with the field's crops and an estimate.
    # Number of observed cells, and number of observed sick cells (0 in a continuous field)
    seen: int
    seen_sick: int
    expected: float  # Expected fraction of sick plants (disease) or mean value (continuous field).
    # Ends of the 90 % interval of `expected`, or None if the estimator has no variance
    low: float | None
    high: float | None
    blocks: tuple[BlockReport, ...]  # Blocks with the largest fractions of sick plants or lowest mean values.
    unit: str = ""  # Unit of the values; empty for the range 0..1.
    # Size of the smallest set of unobserved plants expected to hold 90 % of the unobserved sick plants
    may_be_sick: int | None = None

    @property
    def is_of_seen(self) -> bool:
        """Whether all cells were observed, so that the figures are counts and not estimates."""
        return self.seen >= self.cells


@dataclass(frozen=True, slots=True)
class FarmReport:
    """Figures of all fields with crops on the owner's land."""

    farm: str
    block_m: float
    fields: tuple[FieldReport, ...]

    def rows(self) -> dict[str, str]:
        """Return one sentence for each field, by the field's title."""
        return {field.title: _sentence(field) for field in self.fields}

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain values, for JSON."""
        return {
            "block_m": self.block_m,
            "fields": {
                field.name: {**asdict(field), "blocks": [asdict(b) for b in field.blocks]}
                for field in self.fields
            },
        }


def report_of_maps(farm: Farm, maps: tuple[FieldMap, ...]) -> FarmReport:
    """Return the report of the fields' maps; for a map without variance, only observed cells count."""
    stated = (field_map for field_map in map(_stated, maps) if field_map is not None)
    reports = tuple(_report(farm, field_map) for field_map in stated if field_map.cells.any())
    return FarmReport(farm.name, MapGrid.of(farm).block * farm.cell_size_m, reports)


def _stated(of: FieldMap) -> FieldMap | None:
    """Return the map for the report: the given map or, if it has no variance, a map of the observed cells.

    None if the given map has neither a variance nor sums of the observed cells.
    """
    if of.variance is not None:
        return of
    total = of.seen_sick if of.field.kind == "disease" else of.seen_total
    return None if total is None else replace(of, cells=of.seen, total=total)


_WORST_BLOCKS = 3
_LEAST_PART_OF_A_BLOCK = 0.1


def _report(farm: Farm, of: FieldMap) -> FieldReport:
    grid, field = of.grid, of.field
    cells = float(of.cells.sum())
    variance = None if of.variance is None else float(of.variance.sum())
    expected, low, high = _interval(of, cells, float(of.total.sum()), variance, float(of.seen_sick.sum()))
    by_cells, by_total, by_sick = (grid.by_block(part) for part in (of.cells, of.total, of.seen_sick))
    by_variance = None if of.variance is None else grid.by_block(of.variance)
    share = np.divide(by_total, by_cells, out=np.full_like(by_total, np.nan), where=by_cells > 0)
    # Blocks with few cells, such as those at a field's corner, are not worth a visit.
    large = by_cells >= min(_LEAST_PART_OF_A_BLOCK * grid.block**2, by_cells.max())
    worse = share if field.kind == "disease" else -share
    order = np.argsort(-np.where(large, worse, -np.inf), axis=None, kind="stable")[:_WORST_BLOCKS]
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
        "" if field.range == (0.0, 1.0) else field.unit,
        None if of.may_be_sick is None else int(of.may_be_sick.sum()),
    )


_INTERVAL = (0.05, 0.95)
_NORMAL_90 = 1.6449
_LEAST_SHAPE = 1e-6


def _interval(
    of: FieldMap, cells: float, total: float, variance: float | None, sick: float
) -> tuple[float, float | None, float | None]:
    """Return the fraction of sick plants or the mean value, and the ends of its 90 % interval."""
    scaled = of.field.to_unit
    if variance is None:
        return scaled(total / cells), None, None
    spread = variance * min(of.together, cells)
    if of.field.kind == "disease":
        low, high = gamma_interval(max(total - sick, 0.0), spread)
        low, high = sick + low, sick + high
    else:
        low, high = (total + sign * _NORMAL_90 * math.sqrt(spread) for sign in (-1.0, 1.0))
    return scaled(total / cells), scaled(max(low / cells, 0.0)), scaled(min(high / cells, 1.0))


def gamma_interval(mean: float, variance: float) -> tuple[float, float]:
    """Return the central 90 % interval of a gamma distribution, widened to include the mean if necessary.

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


def brief(field: FieldReport) -> str:
    """Return the fraction of sick plants or the mean value as text, with its 90 % interval if known."""
    write = percent if field.kind == "disease" else _value_of(field)
    if field.is_of_seen:
        return f"{write(field.expected)} in the observed cells"
    if field.low is None or field.high is None:
        return write(field.expected)
    return f"{write(field.expected)} ({write(field.low)} to {write(field.high)})"


def _value_of(field: FieldReport) -> Callable[[float], str]:
    """Return a function that formats values of a continuous field."""
    return (lambda value: f"{value:.3g} {field.unit}") if field.unit else "{:.2f}".format


def percent(share: float, least: float = _LEAST_SHARE) -> str:
    """Return a fraction as a percentage with two digits; fractions in (0, `least`) become "under ...".

    >>> percent(0.0), percent(9.4e-9), percent(0.0213), percent(0.213)
    ('0 %', 'under 0.01 %', '2.1 %', '21 %')
    """
    if 0.0 < share < least:
        return f"under {100.0 * least:g} %"
    return f"{100.0 * share:.2g} %" if share < 0.1 else f"{100.0 * share:.0f} %"


def _number(count: int) -> str:
    return f"{count:,}" if count < 1_000_000 else f"{count / 1e6:.1f} million"


def _sentence(field: FieldReport) -> str:
    """Return a field's report as one sentence for the farmer."""
    if field.kind == "disease" and field.is_of_seen:
        text = f"{_number(field.seen_sick)} of the {_number(field.seen)} plants that were looked at are sick"
        text += f" ({percent(field.expected)}); nothing is known about other plants"
        worst = [f"{_where(block)} {percent(block.expected)}" for block in field.blocks]
        return f"{text}; worst blocks {', '.join(worst)}" if worst else text
    if field.kind == "disease":
        plants = "plant" if field.seen_sick == 1 else "plants"
        text = f"{percent(field.expected)} of {_number(field.cells)} plants expected sick"
        if field.low is not None and field.high is not None:
            text += f" (90 %: {percent(field.low)} to {percent(field.high)})"
        text += f"; {_number(field.seen_sick)} sick {plants} seen among {_number(field.seen)} looked at"
        # If more than half of the unobserved plants may be sick, that number does not help the farmer.
        if field.may_be_sick is not None and field.may_be_sick <= 0.5 * (field.cells - field.seen):
            text += f"; of the other plants, {_number(field.may_be_sick)} may be sick"
        worst = [f"{_where(block)} {percent(block.expected)}" for block in field.blocks]
        return f"{text}; worst blocks {', '.join(worst)}" if worst else text
    write = _value_of(field)
    where = f" in the {_number(field.seen)} cells that were looked at" if field.is_of_seen else ""
    text = f"{write(field.expected)} on average{where}"
    if field.low is not None and field.high is not None:
        text += f" (90 %: {write(field.low)} to {write(field.high)})"
    lowest = [f"{_where(block)} {write(block.expected)}" for block in field.blocks]
    return f"{text}; lowest blocks {', '.join(lowest)}" if lowest else text


def _where(block: BlockReport) -> str:
    return f"{block.name} ({block.latitude_deg:.5f}, {block.longitude_deg:.5f})"
