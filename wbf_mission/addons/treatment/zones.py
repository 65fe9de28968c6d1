"""Where to treat, where to look again, and what is healthy: the action of least expected cost, by blocks.

A block is what a sprayer can act on; `m` is the part of it that needs treatment, and is not known exactly.
Per hectare of the crop, with the costs ``treat`` of treating, ``loss`` of land that needs it and is left, and
``look`` of another look::

    leave            loss E[m]
    treat            treat
    look, then act   look + E[min(treat, loss m)]

What a look is worth is the expected value of perfect information, ``min(treat, loss E[m]) - E[min(treat,
loss m)]`` (Raiffa and Schlaifer, Applied Statistical Decision Theory, 1961). Of a disease, m is the share of
sick plants, Beta-distributed with the mean and deviation that the farmer's report has, too. A continuous
field needs treatment where its value lies below a threshold, the whole block or nothing of it, with the
probability that a normal distribution gives.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from geo.texts import parse_number
from sensors.dynamics.soil import SoilParameters
from sensors.fields import Field, FieldSet
from wbf_mission.addons.treatment.gis import MapError
from wbf_mission.maps.blocks import MapGrid
from wbf_mission.maps.field_maps import FieldMap

Floats: TypeAlias = NDArray[np.float64]

NOTHING, HEALTHY, LOOK, TREAT = range(4)
"""What a block is; nothing grows on the first."""
_WORDS = {
    "disease": ("", "healthy", "look again", "treat"),
    "water": ("", "enough", "look again", "dry"),
    "continuous": ("", "enough", "look again", "too low"),
}
LOOK_SHARE = 0.1
"""A look costs this part of treating unless told: an assumption, drones being cheaper than sprayers."""
DRY_BELOW = 0.4
"""A continuous field needs treatment below this part of its range unless told: an assumption."""
BLOCK_M = 4.0
_LEAST_BLOCKS = 30
_AMOUNT = re.compile(r"([-+.\de]+)\s*([^\s=,].{0,15})?", re.IGNORECASE)
_CERTAIN = 1e-12


@dataclass(frozen=True, slots=True)
class FieldCosts:
    """What the actions cost per hectare, in any unit that is the same for all, and what treating takes.

    Parameters
    ----------
    treat, loss, look : float
        As in this module's text.
    below : float
        A continuous field needs treatment below this value, in its unit.
    rate : float
        Of the product that a treated hectare gets.
    rate_unit : str
        Of that.
    """

    treat: float
    loss: float
    look: float
    below: float = DRY_BELOW
    rate: float = 200.0
    rate_unit: str = "L/ha"

    @classmethod
    def of(cls, field: Field) -> FieldCosts:
        """Take them from the costs of errors in the score, which are relative.

        Treating what is healthy is an error of one below the truth, leaving what is sick one above it. So
        treating costs ``cost_below``, and land that needs it and is left ``cost_above`` more than that.
        """
        weight, treat, regret = field.weight or 1.0, field.cost_below or 1.0, field.cost_above or 1.0
        below = field.to_unit(DRY_BELOW)
        costs = cls(weight * treat, weight * (treat + regret), weight * treat * LOOK_SHARE, below)
        return replace(costs, rate=10.0, rate_unit="mm") if is_water(field) else costs


def is_water(field: Field) -> bool:
    """Tell whether what a field lacks is water; others may develop as the soil does."""
    return field.name == "soil" and isinstance(field.dynamics, SoilParameters)


def costs_of(field_set: FieldSet, given: Mapping[str, Iterable[str]]) -> dict[str, FieldCosts]:
    """Return the costs of each field: what was given, ``[FIELD=]NUMBER[UNIT]``, else the defaults.

    The keys of `given` are those of `FieldCosts`. Of treating and loss, what is not given keeps its
    proportion to what is; a look costs its share of treating.

    Raises
    ------
    MapError
        If an entry cannot be read, is not positive, or names no field.

    Examples
    --------
    >>> from sensors.fields import PAPER_FIELDS
    >>> costs = costs_of(PAPER_FIELDS, {"treat": ["300"], "rate": ["ccr=1.5kg/ha"]})
    >>> costs["ccr"].treat, costs["ccr"].look, costs["ccr"].rate, costs["ccr"].rate_unit, costs["soil"].rate
    (300.0, 30.0, 1.5, 'kg/ha', 10.0)
    >>> round(costs["ccr"].loss, 6), round(costs_of(PAPER_FIELDS, {"loss": ["2200"]})["ccr"].treat, 6)
    (3300.0, 200.0)
    """
    found = {field.name: FieldCosts.of(field) for field in field_set}
    known, priced = [one.name for one in fields(FieldCosts)], set[str]()
    for key in sorted(given, key=known.index):
        for text in given[key]:
            name, _, amount = text.rpartition("=")
            option = f"--{_OPTIONS[key]} {text}"
            if name and name not in field_set:
                raise MapError(f"{option}: no field {name!r}; the fields are {', '.join(field_set.names)}")
            values: dict[str, Any] = _read(option, amount, key)
            for one in (name,) if name else field_set.names:
                if key == "below" and field_set[one].kind == "disease":
                    continue
                before, changed = found[one], replace(found[one], **values)
                low, high = field_set[one].range
                if not low <= changed.below <= high:
                    raise MapError(f"{option}: {one} lies in {low:g}..{high:g}; give a number of these")
                if key == "treat":
                    changed = replace(changed, loss=changed.treat * before.loss / before.treat)
                    priced.add(one)
                elif key == "loss" and one not in priced:
                    changed = replace(changed, treat=changed.loss * before.treat / before.loss)
                if key in ("treat", "loss"):
                    changed = replace(changed, look=LOOK_SHARE * changed.treat)
                found[one] = changed
    return found


_OPTIONS = {
    "treat": "treat-cost",
    "loss": "loss",
    "look": "look-cost",
    "below": "low-below",
    "rate": "rate",
}


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
    """Return blocks of about so many metres a side, as pixels of a `MapGrid`.

    By default 4 m, on a farm of less than 120 m a thirtieth of its longer side; a cell at least.
    """
    longest = max(farm.width_cells, farm.height_cells)
    if block_m is None:
        block_m = min(BLOCK_M, longest * farm.cell_size_m / _LEAST_BLOCKS)
    cells = min(max(1, round(block_m / farm.cell_size_m)), longest)
    return MapGrid((farm.width_cells, farm.height_cells), farm.cell_size_m, cells, 1)


@dataclass(frozen=True, slots=True, eq=False)
class ZoneMap:
    """One field by blocks, all arrays [blocks along x, blocks along y]; NaN where nothing of it grows."""

    of: FieldMap
    costs: FieldCosts
    zone: NDArray[np.uint8]
    need: Floats  # The expected part that needs treatment
    spread: Floats  # Its standard deviation
    gain: Floats  # What knowing the block is worth per hectare
    hectares: Floats  # Of the crop in the block

    @property
    def field(self) -> Field:
        """Which field."""
        return self.of.field

    @property
    def block_m(self) -> float:
        """Side of a block."""
        return self.of.grid.pixel * self.of.grid.cell_size_m

    def word(self, zone: int) -> str:
        """Return what a zone is called."""
        return _WORDS["water" if is_water(self.field) else self.field.kind][zone]

    def area_ha(self, zone: int) -> float:
        """Return how much of the crop a zone has."""
        return float(self.hectares[self.zone == zone].sum())

    def gain_of_looks(self, looked_at: Floats) -> float:
        """Return what looks at so many cells of each block, float64[blocks along x, y], are expected to save.

        Of Beta-distributed shares of sick plants, n looks tell the part ``n / (n + a + b)`` of their variance
        (DeGroot, Optimal Statistical Decisions, 1970); of a continuous field, whose blocks lie within one
        value, one look tells all.
        """
        there = self.zone > NOTHING
        count, need, spread, area = (a[there] for a in (looked_at, self.need, self.spread, self.hectares))
        if self.field.kind == "disease":
            variance = np.minimum(spread**2, need * (1.0 - need))
            size = np.divide(need * (1.0 - need), variance, out=np.ones_like(need), where=variance > _CERTAIN)
            told = np.sqrt(variance * count / np.maximum(count + size - 1.0, _CERTAIN))
            limit = self.costs.treat / self.costs.loss
            gain = self.costs.loss * (np.minimum(limit, need) - _expected_least(need, told, limit))
            gain = np.maximum(gain, 0.0)
        else:
            gain = np.where(count > 0, self.gain[there], 0.0)
        return float((gain * area).sum())

    @property
    def expected_costs(self) -> dict[str, float]:
        """What is expected to be lost or spent: all left, all treated, by the zones, and if all were known.

        By the zones, what is to be looked at is looked at first, and then what is best is done.
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
        return {name: float((each * area).sum()) for name, each in terms.items()}


def zone_map(of: FieldMap, costs: FieldCosts) -> ZoneMap:
    """Decide block by block; a field whose doubt the estimator does not tell has nothing to look at again."""
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
    looks = gain > costs.look
    decided = np.where(looks, LOOK, np.where(costs.loss * need > costs.treat, TREAT, HEALTHY))
    zone = np.zeros(there.shape, np.uint8)
    zone[there] = decided
    full = {name: np.full(there.shape, np.nan) for name in ("need", "spread", "gain")}
    full["need"][there], full["spread"][there], full["gain"][there] = need, spread, gain
    return ZoneMap(of, costs, zone, **full, hectares=of.cells * of.grid.cell_size_m**2 / 1e4)


def _expected_least(mean: Floats, deviation: Floats, limit: float) -> Floats:
    """Return E[min(limit, s)] of Beta-distributed shares s; two values, 0 and 1, if the deviation is largest.

    With B(a, b) the distribution and I its distribution function::

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
    """Return the probability that values of a normal distribution lie below a threshold."""
    from scipy.special import ndtr

    known = deviation > _CERTAIN
    away = np.divide(threshold - mean, deviation, out=np.zeros_like(mean), where=known)
    return np.where(known, ndtr(away), (mean < threshold).astype(np.float64))
