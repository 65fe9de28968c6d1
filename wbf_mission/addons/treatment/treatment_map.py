"""The treatment map: from an estimate to the files for GIS, sprayer and farmer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from geo import Farm
from sensors.fields import FieldSet
from sensors.observations import Observations
from sensors.scoring.information import InformationModel
from wbf_mission.addons.treatment.farmer_page import Page, write_page
from wbf_mission.addons.treatment.geotiff import write_geotiff
from wbf_mission.addons.treatment.gis import MapError, gdal_errors
from wbf_mission.addons.treatment.vector_files import write_prescription, write_zones
from wbf_mission.addons.treatment.zone_shapes import Zone, zones_of
from wbf_mission.addons.treatment.zones import HEALTHY, LOOK, TREAT, FieldCosts, ZoneMap, block_grid, zone_map
from wbf_mission.maps.field_maps import field_maps
from wbf_mission.maps.report import FarmReport, report_of_maps
from wbf_mission.progress import Progress
from wbf_mission.results.files import write_json

PAGE, SUMMARY = "report.html", "map.json"
_VALUES, _RATES = ("map_", ".tif"), ("prescription_", ".zip")


@dataclass(frozen=True)
class TreatmentMap:
    """What a treatment map is made from, and what it says.

    Parameters
    ----------
    model : InformationModel
        What is believed on `day`.
    states_deviation : bool
        Whether the estimator's uncertainty is a standard deviation.
    costs : mapping of str to FieldCosts
        By the names of the fields.
    block_m : float, optional
        Side of the blocks that a sprayer can act on, see `wbf_mission.addons.treatment.zones.block_grid`.
    source : str
        From what it was made, for the farmer.
    notes : tuple of str
        What to know of that.
    """

    farm: Farm
    fields: FieldSet
    model: InformationModel
    observations: Observations
    day: int
    estimator: str
    states_deviation: bool
    costs: Mapping[str, FieldCosts]
    block_m: float | None = None
    source: str = ""
    notes: tuple[str, ...] = ()
    knows_only_seen: bool = False  # Whether the estimate is of the cells that were observed alone

    @cached_property
    def report(self) -> FarmReport:
        """How much is sick, where, and how sure that is; as `fly` prints it."""
        return report_of_maps(self.farm, self._maps())

    @cached_property
    def zone_maps(self) -> tuple[ZoneMap, ...]:
        """The zones by blocks, of the fields whose crops the owner grows; MapError if there are none."""
        maps = self._maps(grid=block_grid(self.farm, self.block_m))
        found = tuple(zone_map(one, self.costs[one.field.name]) for one in maps if one.cells.any())
        if not found:
            crops = ", ".join(sorted({crop for field in self.fields for crop in field.crops}))
            raise MapError(
                f"farm {self.farm.name!r}: its owner grows nothing of {crops}; give other --fields"
            )
        return found

    @cached_property
    def zones(self) -> tuple[Zone, ...]:
        """The zones of all fields as polygons."""
        return tuple(zone for one in self.zone_maps for zone in zones_of(self.farm, one))

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
        """Return plain values, for JSON."""
        return {
            "farm": self.farm.name,
            "day": self.day,
            "estimator": self.estimator,
            "observations": len(self.observations),
            "source": self.source,
            "notes": list(self.notes),
            "fields": {one.field.name: self._of_field(one) for one in self.zone_maps},
            "report": self.report.to_dict(),
        }

    def _of_field(self, of: ZoneMap) -> dict[str, Any]:
        costs = of.costs
        return {
            "block_m": of.block_m,
            "area_ha": {name: of.area_ha(zone) for name, zone in _NAMED.items()},
            "prescribed_ha": sum(
                one.area_ha for one in self.zones if one.field == of.field.name and one.zone == TREAT
            ),
            "rate": costs.rate,
            "rate_unit": costs.rate_unit,
            "costs_per_ha": {name: getattr(costs, name) for name in ("treat", "loss", "look")},
            "too_low_below": None if of.field.kind == "disease" else costs.below,
            "expected_costs": of.expected_costs,
        }


_NAMED = {"treat": TREAT, "look_again": LOOK, "healthy": HEALTHY}


def is_part(name: str) -> bool:
    """Tell whether a name may be that of a file of a treatment map."""
    many = any(name.startswith(start) and name.endswith(end) for start, end in (_VALUES, _RATES))
    return name in _NAMES or many


_NAMES = frozenset({PAGE, "zones.geojson", "zones.gpkg", "observations.parquet", SUMMARY})


def write_whole_map(treatment: TreatmentMap, folder: Path, progress: Progress) -> list[Path]:
    """Write a treatment map, its readings and its summary; MapError as of `write_treatment_map`."""
    folder.mkdir(exist_ok=True)
    with gdal_errors(folder):
        files = write_treatment_map(treatment, folder, progress)
    files += [folder / "observations.parquet", folder / SUMMARY]
    treatment.observations.save(files[-2])
    write_json(files[-1], treatment.summary())
    return files


def write_treatment_map(of: TreatmentMap, folder: Path, progress: Progress) -> list[Path]:
    """Write all files but the summary into a folder that is there, and return them.

    For each field map_NAME.tif and prescription_NAME.zip; zones.geojson, zones.gpkg, report.html.

    Raises
    ------
    MapError
        If the extra ``gis`` is not installed, or the farm does not fit into UTM.
    """
    names = [one.field.name for one in of.zone_maps]
    steps = len(names) + 2
    progress("writing the map", 0, steps)
    files = []
    for number, name in enumerate(names, start=1):
        files.append(folder / name.join(_VALUES))
        deviation = of.states_deviation
        write_geotiff(files[-1], of.farm, of.fields[name], of.model, deviation=deviation, day=of.day)
        progress("writing the map", number, steps)
    files += write_zones(folder, of.farm, of.zones)
    for name in names:
        mine = [one for one in of.zones if one.field == name]
        if mine:
            files.append(folder / name.join(_RATES))
            write_prescription(files[-1], of.farm, mine)
    progress("writing the map", steps - 1, steps)
    files.append(folder / PAGE)
    about = f"day {of.day}, estimated by {of.estimator} from {len(of.observations):,} readings"
    page = Page(of.farm, of.zone_maps, of.zones, of.report, about, of.source, of.notes, of.states_deviation)
    write_page(files[-1], page)
    progress("writing the map", steps, steps)
    return files
