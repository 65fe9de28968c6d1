"""Treatment map of an estimate: zones to treat, to look at again, or to leave, by least expected cost.

A block is the smallest area that a sprayer can treat. `m` is the fraction of the block that needs treatment,
a random variable. ``treat`` is the cost of treatment, ``loss`` the cost of untreated land that needs
treatment, and ``look`` the cost of another look. The expected costs per hectare of the crop are::

    leave            loss E[m]
    treat            treat
    look, then act   look + E[min(treat, loss m)]

The value of a look is the expected value of perfect information, ``min(treat, loss E[m]) - E[min(treat, loss
m)]`` (Raiffa and Schlaifer, Applied Statistical Decision Theory, 1961). For a disease, m is the fraction of
sick plants; it has a beta distribution with the mean and deviation of the farmer's report. For a continuous
field, m is 1 if the block's mean value is below a threshold, else 0; the mean has a normal distribution.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray

from geo import Farm
from geo.texts import parse_number
from sensors.dynamics.soil import SoilParameters
from sensors.fields import Field, FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from wbf_mission.addons.treatment.gis import MapError, gis
from wbf_mission.maps.blocks import MapGrid
from wbf_mission.maps.field_maps import FieldMap, field_maps
from wbf_mission.maps.report import FarmReport, report_of_maps

Floats: TypeAlias = NDArray[np.float64]

NOTHING, HEALTHY, LOOK, TREAT = range(4)
"""Zone of a block; `NOTHING` is a block without the field's crops."""
_WORDS = {
    "disease": ("", "healthy", "look again", "treat"),
    "water": ("", "enough", "look again", "dry"),
    "continuous": ("", "enough", "look again", "too low"),
}
LOOK_SHARE = 0.1
"""Default cost of a look as a fraction of the treatment cost; assumes that drones are the cheaper tool."""
DRY_BELOW = 0.4
"""Default threshold of a continuous field, as a fraction of the field's range: an assumption."""
BLOCK_M = 4.0  # Default side of a block
_LEAST_BLOCKS = 30
_AMOUNT = re.compile(r"([-+.\de]+)\s*([^\s=,].{0,15})?", re.IGNORECASE)
_CERTAIN = 1e-12


@dataclass(frozen=True, slots=True)
class FieldCosts:
    """Costs per hectare in any common unit, treatment threshold, and application rate of one field."""

    treat: float  # Cost of treatment
    loss: float  # Cost of untreated land that needs treatment
    look: float  # Cost of another look
    below: float = DRY_BELOW  # Treatment threshold of a continuous field, in the field's unit
    rate: float = 200.0  # Application rate on treated land
    rate_unit: str = "L/ha"

    @classmethod
    def of(cls, field: Field) -> FieldCosts:
        """Return default costs, in the relative unit of the score's error costs.

        Treatment of a healthy plant corresponds to an estimate that is 1 too low, so `treat` is
        ``cost_below``. An untreated sick plant corresponds to an estimate that is 1 too high, so `loss` is
        ``cost_below + cost_above``. Both are multiplied by the field's weight.
        """
        weight, treat, regret = field.weight or 1.0, field.cost_below or 1.0, field.cost_above or 1.0
        below = field.to_unit(DRY_BELOW)
        costs = cls(weight * treat, weight * (treat + regret), weight * treat * LOOK_SHARE, below)
        return replace(costs, rate=10.0, rate_unit="mm") if is_water(field) else costs


def is_water(field: Field) -> bool:
    """Return whether irrigation treats a field: only "soil", even if other fields have soil dynamics."""
    return field.name == "soil" and isinstance(field.dynamics, SoilParameters)


def costs_of(field_set: FieldSet, given: Mapping[str, Iterable[str]]) -> dict[str, FieldCosts]:
    """Return the costs of each field from texts of the form ``[FIELD=]NUMBER[UNIT]``.

    The keys of `given` are attributes of `FieldCosts`. If only treat or only loss is given, the other cost
    follows by the default ratio. The default of look is `LOOK_SHARE` of treat. Raises MapError if an entry
    cannot be read, is not positive, or names no field.

    >>> from sensors.fields import PAPER_FIELDS
    >>> costs = costs_of(PAPER_FIELDS, {"treat": ["300"], "rate": ["ccr=1.5kg/ha"]})
    >>> costs["ccr"].treat, costs["ccr"].look, costs["ccr"].rate, costs["ccr"].rate_unit, costs["soil"].rate
    (300.0, 30.0, 1.5, 'kg/ha', 10.0)
    >>> round(costs["ccr"].loss, 6), round(costs_of(PAPER_FIELDS, {"loss": ["2200"]})["ccr"].treat, 6)
    (3300.0, 200.0)
    """
    found = {field.name: FieldCosts.of(field) for field in field_set}
    known, priced = [attribute.name for attribute in fields(FieldCosts)], set[str]()
    for key in sorted(given, key=known.index):
        for text in given[key]:
            name, _, amount = text.rpartition("=")
            option = f"--{_OPTIONS[key]} {text}"
            if name and name not in field_set:
                raise MapError(f"{option}: no field {name!r}; the fields are {', '.join(field_set.names)}")
            values: dict[str, Any] = _read(option, amount, key)
            for of in (name,) if name else field_set.names:
                if key == "below" and field_set[of].kind == "disease":
                    continue
                before, changed = found[of], replace(found[of], **values)
                low, high = field_set[of].range
                if not low <= changed.below <= high:
                    raise MapError(f"{option}: {of} lies in {low:g}..{high:g}; give a number in this range")
                if key == "treat":
                    changed = replace(changed, loss=changed.treat * before.loss / before.treat)
                    priced.add(of)
                elif key == "loss" and of not in priced:
                    changed = replace(changed, treat=changed.loss * before.treat / before.loss)
                if key in ("treat", "loss"):
                    changed = replace(changed, look=LOOK_SHARE * changed.treat)
                found[of] = changed
    return found


_OPTIONS = {"treat": "treat-cost", "loss": "loss", "look": "look-cost", "below": "low-below", "rate": "rate"}


def _read(option: str, text: str, key: str) -> dict[str, float | str]:
    amount = _AMOUNT.fullmatch(text.strip())
    try:
        if amount is None or (amount[2] and key != "rate"):
            raise ValueError(f"{text[:40]!r} is not a number")
        value = parse_number(amount[1])
    except ValueError as error:
        raise MapError(f"{option}: {error}; give [FIELD=]NUMBER") from None
    low = {"look": 0.0, "below": -1e9}.get(key, 1e-9)
    if not low <= value <= 1e9:
        allowed = "0 or more" if key == "look" else "above 0"
        raise MapError(f"{option}: out of range; give a number {allowed}")
    return {key: value, **({"rate_unit": amount[2].strip()} if amount[2] else {})}


def block_grid(farm: Farm, block_m: float | None = None) -> MapGrid:
    """Return a `MapGrid` whose pixels are the blocks: about `block_m` metres a side, but at least one cell.

    The default is 4 m, or a thirtieth of the farm's longer side if that is less.
    """
    longest = max(farm.width_cells, farm.height_cells)
    if block_m is None:
        block_m = min(BLOCK_M, longest * farm.cell_size_m / _LEAST_BLOCKS)
    cells = min(max(1, round(block_m / farm.cell_size_m)), longest)
    return MapGrid((farm.width_cells, farm.height_cells), farm.cell_size_m, cells, 1)


@dataclass(frozen=True, slots=True, eq=False)
class ZoneMap:
    """Zones of one field; arrays are [blocks along x, blocks along y], NaN in blocks without crops."""

    of: FieldMap
    costs: FieldCosts
    zone: NDArray[np.uint8]
    need: Floats  # Fraction of the block that is expected to need treatment
    spread: Floats  # Standard deviation of this fraction
    gain: Floats  # Expected saving per hectare by perfect information
    hectares: Floats  # Area of the crop

    @property
    def field(self) -> Field:
        """Field of the map."""
        return self.of.field

    @property
    def block_m(self) -> float:
        """Side of a block (m)."""
        return self.of.grid.pixel * self.of.grid.cell_size_m

    def word(self, zone: int) -> str:
        """Return the word for a zone of this field, such as "dry" for `TREAT` if the field is water."""
        return _WORDS["water" if is_water(self.field) else self.field.kind][zone]

    def area_ha(self, zone: int) -> float:
        """Return the crop area in a zone (ha)."""
        return float(self.hectares[self.zone == zone].sum())

    def gain_of_looks(self, looked_at: Floats) -> float:
        """Return the expected saving from looks; `looked_at` is the number of cells looked at in each block.

        If the fraction of sick plants has a beta distribution (a, b), n looks reveal ``n / (n + a + b)`` of
        its variance (DeGroot, Optimal Statistical Decisions, 1970). In a continuous field a block has a
        single value, which one look reveals completely.
        """
        there = self.zone > NOTHING
        count, need, spread, area = (a[there] for a in (looked_at, self.need, self.spread, self.hectares))
        if self.field.kind == "disease":
            variance = np.minimum(spread**2, need * (1.0 - need))
            size = np.divide(need * (1.0 - need), variance, out=np.ones_like(need), where=variance > _CERTAIN)
            revealed = np.sqrt(variance * count / np.maximum(count + size - 1.0, _CERTAIN))
            limit = self.costs.treat / self.costs.loss
            gain = self.costs.loss * (np.minimum(limit, need) - _expected_least(need, revealed, limit))
            gain = np.maximum(gain, 0.0)
        else:
            gain = np.where(count > 0, self.gain[there], 0.0)
        return float((gain * area).sum())

    @property
    def expected_costs(self) -> dict[str, float]:
        """Expected total costs by strategy.

        "leave": treat nothing. "treat": treat all crops. "zones": look again at the `LOOK` zones, then take
        the best action in every block. "known": the best actions with perfect information.
        """
        there, costs = self.zone > NOTHING, self.costs
        need, gain, area = self.need[there], self.gain[there], self.hectares[there]
        leave = costs.loss * need
        act = np.minimum(leave, costs.treat)
        by_zone = np.where(self.zone[there] == LOOK, act - gain + costs.look, act)
        terms = {
            "leave": leave,
            "treat": np.full_like(leave, costs.treat),
            "zones": by_zone,
            "known": act - gain,
        }
        return {name: float((cost * area).sum()) for name, cost in terms.items()}


def zone_map(of: FieldMap, costs: FieldCosts) -> ZoneMap:
    """Return the zones of a field; no block is `LOOK` if the estimate has no deviation."""
    there = of.cells > 0
    mean, deviation = of.share[there], of.deviation
    spread = np.zeros_like(mean) if deviation is None else np.maximum(deviation[there], 0.0)
    limit = costs.treat / costs.loss
    if of.field.kind == "disease":
        need = mean.clip(0.0, 1.0)
        best = _expected_least(need, spread, limit)
    else:
        need = _below(mean, spread, float(of.field.from_unit(costs.below)))
        best = need * min(limit, 1.0)
    gain = costs.loss * np.maximum(np.minimum(limit, need) - best, 0.0)
    if deviation is None:
        gain[:] = 0.0
    zone = np.zeros(there.shape, np.uint8)
    needed = np.where(costs.loss * need > costs.treat, TREAT, HEALTHY)
    zone[there] = np.where(gain > costs.look, LOOK, needed)
    maps = np.full((3, *there.shape), np.nan)
    maps[:, there] = need, spread, gain
    hectares = of.cells * of.grid.cell_size_m**2 / 1e4
    return ZoneMap(of, costs, zone, maps[0], maps[1], maps[2], hectares)


def _expected_least(mean: Floats, deviation: Floats, limit: float) -> Floats:
    """Return E[min(limit, s)] for a beta distribution of s; at the largest possible deviation, s is 0 or 1.

    For parameters a, b, t = limit, and the regularized incomplete beta function I::

        E[min(t, s)] = mean I_t(a + 1, b) + t (1 - I_t(a, b))
    """
    from scipy.special import betainc

    if limit >= 1.0:
        return mean
    variance, largest = deviation**2, mean * (1.0 - mean)
    sure, all_or_nothing = variance <= _CERTAIN, variance >= largest * (1.0 - 1e-9)
    size = np.divide(largest, variance, out=np.ones_like(mean), where=~sure & ~all_or_nothing) - 1.0
    a, b = np.maximum(mean * size, 1e-12), np.maximum((1.0 - mean) * size, 1e-12)
    least = mean * betainc(a + 1.0, b, limit) + limit * (1.0 - betainc(a, b, limit))
    least = np.where(all_or_nothing, mean * limit, least)
    return np.where(sure | (largest <= _CERTAIN), np.minimum(limit, mean), least)


def _below(mean: Floats, deviation: Floats, threshold: float) -> Floats:
    """Return the probability that a normally distributed value is below a threshold."""
    from scipy.special import ndtr

    known = deviation > _CERTAIN
    away = np.divide(threshold - mean, deviation, out=np.zeros_like(mean), where=known)
    return np.where(known, ndtr(away), (mean < threshold).astype(np.float64))


_LEAST_OF_A_BLOCK = 0.25  # Smallest area of a zone, as a fraction of a block


@dataclass(frozen=True, slots=True)
class Zone:
    """Connected area on which one field needs the same action."""

    field: str
    zone: int  # `LOOK`, `TREAT` or `HEALTHY`
    word: str
    polygon: shapely.Polygon  # Outline, metres in the farm's frame
    latitude_deg: float  # Latitude of a point inside
    longitude_deg: float
    area_ha: float  # Area of the polygon
    need: float  # Fraction of the zone that is expected to need treatment
    gain: float  # Expected saving by perfect information, in the unit of the costs
    rate: float  # Application rate, 0 without treatment
    rate_unit: str


def zones_of(farm: Farm, of: ZoneMap) -> tuple[Zone, ...]:
    """Return a field's zones: first to treat, then to look at again, then healthy; largest first."""
    found = [area for zone in (TREAT, LOOK, HEALTHY) for area in _zones(farm, of, zone)]
    return tuple(sorted(found, key=lambda area: (-area.zone, -area.area_ha)))


def _zones(farm: Farm, of: ZoneMap, zone: int) -> list[Zone]:
    from scipy import ndimage

    found, count = ndimage.label(of.zone == zone)
    labels = found.astype(np.int32)
    if not count:
        return []
    numbers, inside = labels.ravel(), labels.ravel() > 0
    weight = np.where(inside, of.hectares.ravel(), 0.0)
    hectares = np.bincount(numbers, weight, count + 1)
    need, gain = (
        np.bincount(numbers[inside], (share.ravel() * weight)[inside], count + 1)
        for share in (of.need, of.gain)
    )
    polygons, ids = _outlines(labels, of.block_m)
    land = farm.owner_area
    shapely.prepare(land)
    cut = np.where(shapely.contains(land, polygons), polygons, shapely.intersection(polygons, land))
    parts, of_parts = shapely.get_parts(cut, return_index=True)
    kept = (shapely.area(parts) >= _LEAST_OF_A_BLOCK * of.block_m**2) & (shapely.get_dimensions(parts) == 2)
    parts, numbers = parts[kept], ids[of_parts[kept]]
    whole = np.bincount(numbers, shapely.area(parts), count + 1)
    points = shapely.get_coordinates(shapely.point_on_surface(parts))
    latitude, longitude = farm.frame.to_wgs84(points[:, 0], points[:, 1])
    rate = of.costs.rate if zone == TREAT else 0.0
    return [
        Zone(
            of.field.name,
            zone,
            of.word(zone),
            part,
            float(latitude[k]),
            float(longitude[k]),
            part.area / 1e4,
            float(need[number] / hectares[number]),
            float(gain[number] * part.area / whole[number]),
            rate,
            of.costs.rate_unit,
        )
        for k, (part, number) in enumerate(zip(parts, numbers, strict=True))
    ]


def _outlines(labels: NDArray[Any], block_m: float) -> tuple[NDArray[np.object_], NDArray[np.int64]]:
    """Return the outline of each labelled group of blocks (m, farm's frame), and the group's label."""
    features, rasterio = gis("rasterio.features"), gis("rasterio")
    scale = rasterio.Affine(block_m, 0.0, 0.0, 0.0, block_m, 0.0)
    rows = np.ascontiguousarray(labels.T)
    pairs = list(features.shapes(rows, mask=rows > 0, connectivity=4, transform=scale))
    polygons = np.array([shapely.geometry.shape(outline) for outline, _ in pairs], np.object_)
    return polygons, np.array([int(label) for _, label in pairs], np.int64)


@dataclass(frozen=True)
class TreatmentMap:
    """Treatment map of a farm: the estimate, the costs, and the zones derived from both."""

    farm: Farm
    fields: FieldSet
    model: InformationModel  # Estimate of all fields on `day`
    observations: Observations
    day: int
    estimator: str
    states_deviation: bool  # Whether the estimator's uncertainty is a standard deviation
    costs: Mapping[str, FieldCosts]  # By field name
    block_m: float | None = None  # Side of a block (m), see `block_grid`
    source: str = ""  # Names of the input files or of the run, for the farmer's page
    notes: tuple[str, ...] = ()  # Notes on the input, for the user
    knows_only_seen: bool = False  # Whether the estimate covers only the cells that were observed

    @cached_property
    def report(self) -> FarmReport:
        """Report for the farmer, as printed by `fly`."""
        return report_of_maps(self.farm, self._maps())

    @cached_property
    def zone_maps(self) -> tuple[ZoneMap, ...]:
        """Zone map of each field whose crops grow on the owner's land; MapError without such a field."""
        maps = self._maps(grid=block_grid(self.farm, self.block_m))
        found = tuple(zone_map(of, self.costs[of.field.name]) for of in maps if of.cells.any())
        if not found:
            crops = ", ".join(sorted({crop for field in self.fields for crop in field.crops}))
            raise MapError(f"farm {self.farm.name!r}: its owner grows no {crops}; give other --fields")
        return found

    @cached_property
    def zones(self) -> tuple[Zone, ...]:
        """Zones of all fields as polygons."""
        return tuple(zone for zones in self.zone_maps for zone in zones_of(self.farm, zones))

    def _maps(self, **how: Any) -> Any:
        return field_maps(
            self.farm,
            self.model,
            self.observations,
            fields=self.fields,
            states_deviation=self.states_deviation,
            only_seen=self.knows_only_seen,
            day=self.day,
            **how,
        )

    def summary(self) -> dict[str, Any]:
        """Return the summary as plain values, for JSON."""
        return {
            "farm": self.farm.name,
            "day": self.day,
            "estimator": self.estimator,
            "observations": len(self.observations),
            "source": self.source,
            "notes": list(self.notes),
            "fields": {zones.field.name: self._of_field(zones) for zones in self.zone_maps},
            "report": self.report.to_dict(),
        }

    def _of_field(self, of: ZoneMap) -> dict[str, Any]:
        costs = of.costs
        zones = {"treat": TREAT, "look_again": LOOK, "healthy": HEALTHY}
        return {
            "block_m": of.block_m,
            "area_ha": {name: of.area_ha(zone) for name, zone in zones.items()},
            "prescribed_ha": sum(
                zone.area_ha for zone in self.zones if zone.field == of.field.name and zone.zone == TREAT
            ),
            "rate": costs.rate,
            "rate_unit": costs.rate_unit,
            "costs_per_ha": {name: getattr(costs, name) for name in ("treat", "loss", "look")},
            "too_low_below": None if of.field.kind == "disease" else costs.below,
            "expected_costs": of.expected_costs,
        }
