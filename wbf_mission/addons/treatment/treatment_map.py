"""Treatment map of an estimate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from geo import Farm
from sensors.fields import FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from wbf_mission.addons.treatment.gis import MapError
from wbf_mission.addons.treatment.zones import (
    HEALTHY,
    LOOK,
    TREAT,
    FieldCosts,
    Zone,
    ZoneMap,
    block_grid,
    zone_map,
    zones_of,
)
from wbf_mission.maps.field_maps import field_maps
from wbf_mission.maps.report import FarmReport, report_of_maps


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
    block_m: float | None = None  # Side of a block (m), see `zones.block_grid`
    source: str = ""  # Names of the input files or of the run, for the farmer's page
    notes: tuple[str, ...] = ()  # Notes on the input, for the user
    knows_only_seen: bool = False  # Whether the estimate covers only observed cells

    @cached_property
    def report(self) -> FarmReport:
        """Report for the farmer, as printed by `fly`."""
        return report_of_maps(self.farm, self._maps())

    @cached_property
    def zone_maps(self) -> tuple[ZoneMap, ...]:
        """Zone map of each field whose crops grow on the owner's land; raises MapError if none does."""
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
