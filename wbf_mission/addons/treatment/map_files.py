"""Files of a treatment map for GIS, sprayer and farmer: GeoTIFF, GeoJSON, GeoPackage, Shapefile, HTML.

The page for the farmer has areas to treat and areas to look at again, with maps and costs. The page loads no
other files, so that it can be sent by mail and opened offline. A page fits A4 paper.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from geo import Farm
from geo.atomic import atomic_write
from sensors.fields import Field
from sensors.scoring.information import InformationModel
from wbf_mission.addons.base.archive import archive_of
from wbf_mission.addons.base.farm_drawing import FarmDrawing
from wbf_mission.addons.base.markup import html_document
from wbf_mission.addons.base.plots import rgb
from wbf_mission.addons.treatment.gis import UtmCells, gdal_errors, gis, raster
from wbf_mission.addons.treatment.treatment_map import (
    HEALTHY,
    LOOK,
    TREAT,
    FieldCosts,
    TreatmentMap,
    Zone,
    ZoneMap,
    is_water,
)
from wbf_mission.maps.report import percent
from wbf_mission.progress import Progress
from wbf_mission.results.files import write_json

PAGE, SUMMARY = "report.html", "map.json"
_VALUES, _RATES = ("map_", ".tif"), ("prescription_", ".zip")
NODATA = -9999.0
_STRIP = 512


def is_part(name: str) -> bool:
    """Return whether `name` is the name of a file that `write_map` may write."""
    many = any(name.startswith(start) and name.endswith(end) for start, end in (_VALUES, _RATES))
    return many or name in (PAGE, "zones.geojson", "zones.gpkg", "observations.parquet", SUMMARY)


def write_map(of: TreatmentMap, folder: Path, progress: Progress, **more: Any) -> list[Path]:
    """Write a treatment map into a folder, and return the files; `more` is added to the summary.

    Each field gets a map_NAME.tif and a prescription_NAME.zip. All fields share zones.geojson, zones.gpkg and
    report.html. Raises MapError if the extra ``gis`` is not installed, or the farm does not fit into UTM.
    """
    folder.mkdir(exist_ok=True)
    with gdal_errors(folder):
        names = [zones.field.name for zones in of.zone_maps]
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
            zones = [zone for zone in of.zones if zone.field == name]
            if zones:
                files.append(folder / name.join(_RATES))
                write_prescription(files[-1], of.farm, zones)
        progress("writing the map", steps - 1, steps)
    files += [folder / name for name in (PAGE, "observations.parquet", SUMMARY)]
    write_page(files[-3], of)
    progress("writing the map", steps, steps)
    of.observations.save(files[-2])
    write_json(files[-1], {**of.summary(), **more})
    return files


def write_geotiff(
    path: Path, farm: Farm, field: Field, model: InformationModel, *, deviation: bool, day: int
) -> UtmCells:
    """Write the estimate of one field as a cloud-optimised GeoTIFF, float32, and return its georeference.

    Band 1 is the value in the field's unit, band 2 the uncertainty. Cells outside the owner's land or without
    the field's crops are `NODATA`. If `deviation`, the uncertainty is a standard deviation; otherwise it is
    on the estimator's own scale. Raises MapError if rasterio is not installed, or `UtmCells.of` fails.
    """
    rasterio, copying = gis("rasterio"), gis("rasterio.shutil")
    cells = UtmCells.of(farm)
    k = model.fields.index(field.name)
    mask = field.mask(farm.grid())
    width = field.range[1] - field.range[0]
    profile = {
        "driver": "GTiff",
        "width": farm.width_cells,
        "height": farm.height_cells,
        "count": 2,
        "dtype": "float32",
        "nodata": NODATA,
        "crs": f"EPSG:{cells.epsg}",
        "transform": rasterio.Affine(*cells.affine),
        "tiled": True,
        "blockxsize": _STRIP,
        "blockysize": _STRIP,
        "BIGTIFF": "IF_SAFER",
    }
    # GDAL's COG driver can only copy an existing raster; this raster is a file on disk to save memory.
    plain = path.with_name(f".{path.name}.plain.tif")
    scale = "standard deviation" if deviation else "on the estimator's own scale"
    with warnings.catch_warnings():
        # rasterio warns about tiles that are larger than the raster.
        warnings.simplefilter("ignore", rasterio.errors.RasterioDeprecationWarning)
        try:
            with rasterio.open(plain, "w", **profile) as file:
                for top in range(0, farm.height_cells, _STRIP):
                    rows = slice(top, min(top + _STRIP, farm.height_cells))
                    value = field.to_unit(raster(model.value[k])[rows])
                    doubt = raster(model.uncertainty[k])[rows] * np.float32(width if deviation else 1.0)
                    for band, array in ((1, value), (2, doubt)):
                        part = np.where(raster(mask)[rows], array, np.float32(NODATA)).astype(np.float32)
                        window = rasterio.windows.Window(0, top, farm.width_cells, len(part))
                        file.write(part, band, window=window)
                file.descriptions = (f"{field.title}: value", f"{field.title}: uncertainty ({scale})")
                file.units = (field.unit, field.unit if deviation else "")
                file.update_tags(farm=farm.name, field=field.name, day=day, software="wbf-mission")
            copying.copy(
                plain,
                path,
                driver="COG",
                COMPRESS="DEFLATE",
                LEVEL="1",
                PREDICTOR="YES",
                NUM_THREADS="ALL_CPUS",
                OVERVIEW_RESAMPLING="AVERAGE",
            )
        finally:
            plain.unlink(missing_ok=True)
    return cells


def write_zones(folder: Path, farm: Farm, zones: Sequence[Zone]) -> list[Path]:
    """Write the zones of all fields to ``zones.geojson`` (RFC 7946) and ``zones.gpkg``; return the files."""
    columns: dict[str, list[Any]] = {
        "field": [zone.field for zone in zones],
        "zone": [zone.word for zone in zones],
        "area_ha": [round(zone.area_ha, 6) for zone in zones],
        "need": [round(zone.need, 6) for zone in zones],
        "gain": [zone.gain for zone in zones],
        "rate": [zone.rate for zone in zones],
        "rate_unit": [zone.rate_unit for zone in zones],
    }
    files = [folder / "zones.geojson", folder / "zones.gpkg"]
    _write(files[0], farm, zones, columns, driver="GeoJSON", RFC7946="YES", WRITE_NAME="NO")
    _write(files[1], farm, zones, columns, driver="GPKG", layer="zones")
    return files


def write_prescription(path: Path, farm: Farm, zones: Sequence[Zone]) -> None:
    """Write the zones of one field as a zipped Shapefile; the column RATE is 0 in untreated zones."""
    columns: dict[str, list[Any]] = {
        "RATE": [zone.rate for zone in zones],
        "UNIT": [zone.rate_unit for zone in zones],
        "ZONE": [zone.word for zone in zones],
        "AREA_HA": [round(zone.area_ha, 6) for zone in zones],
    }
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        shape = Path(folder) / f"{path.stem}.shp"
        _write(shape, farm, zones, columns, driver="ESRI Shapefile", encoding="UTF-8")
        parts = sorted(Path(folder).iterdir())
        path.write_bytes(archive_of({part.name: part.read_bytes() for part in parts}))


def _write(path: Path, farm: Farm, zones: Sequence[Zone], columns: dict[str, list[Any]], **how: Any) -> None:
    texts = [isinstance(next(iter(values), ""), str) for values in columns.values()]
    arrays = [
        np.array(values, np.object_ if text else np.float64)
        for text, values in zip(texts, columns.values(), strict=True)
    ]
    gis("pyogrio.raw").write(
        path,
        geometry=np.array(shapely.to_wkb(_to_wgs84(farm, [zone.polygon for zone in zones])), np.object_),
        field_data=arrays,
        fields=list(columns),
        geometry_type="Polygon",
        crs="EPSG:4326",
        **how,
    )


def _to_wgs84(farm: Farm, polygons: Sequence[shapely.Polygon]) -> NDArray[np.object_]:
    """Convert polygons from the farm's frame to longitude and latitude (degrees).

    Beyond the antimeridian, longitudes exceed 180 degrees, so that polygons stay connected.
    """
    origin = farm.frame.longitude_deg

    def transform(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        latitude, longitude = farm.frame.to_wgs84(xy[:, 0], xy[:, 1])
        return np.column_stack((origin + (longitude - origin + 180.0) % 360.0 - 180.0, latitude))

    return shapely.transform(np.array(polygons, np.object_), transform)


_COLOURS = {TREAT: "#b3261e", LOOK: "#f2b705", HEALTHY: "#8fc08b"}
_LISTED = 3  # Maximum number of zones of each kind in a table
_PAGE_MM = 250.0
_MAP_MM = 88.0
_MAP_WIDTH, _WIDE_MM, _NARROW_MM, _NARROW_FROM = "MAP", 84, 68, 3
_LEAST_SHARE = 1e-3  # Smaller fractions are written as "under" this fraction

_STYLE = """
@page { size: A4 portrait; margin: 10mm 12mm; }
* { box-sizing: border-box; }
body { font: 9pt/1.25 system-ui, "Segoe UI", Roboto, Arial, sans-serif; color: #1d1d1b; margin: 0 auto;
  max-width: 186mm; padding: 4mm 0; -webkit-print-color-adjust: exact; print-color-adjust: exact; }
@media print { body { padding: 0; } }
h1 { font-size: 17pt; margin: 0; }
h2 { font-size: 12pt; margin: 0 0 0.5mm; }
p { margin: 0 0 0.8mm; }
.about, .small { color: #55534f; font-size: 8pt; }
section { display: grid; grid-template-columns: MAPmm 1fr; gap: 5mm; border-top: 0.4mm solid #1d1d1b;
  padding-top: 2mm; margin-top: 2mm; break-inside: avoid; }
svg { width: 100%; display: block; }
.main { font-size: 11pt; font-weight: 650; }
.bar { height: 3.2mm; margin: 1mm 0 0.6mm; border: 0.2mm solid #1d1d1b; }
.key { display: flex; flex-wrap: wrap; gap: 0 4mm; font-size: 8.5pt; margin-bottom: 1mm; }
.key svg { display: inline-block; width: 2.6mm; height: 2.6mm; border: 0.2mm solid #1d1d1b;
  margin-right: 1mm; }
table { border-collapse: collapse; width: 100%; font-size: 8.5pt; margin-bottom: 1.2mm; }
th { text-align: left; font-weight: 600; border-bottom: 0.2mm solid #1d1d1b; }
td, th { padding: 0.3mm 1mm 0.3mm 0; }
.n { text-align: right; font-variant-numeric: tabular-nums; }
.dot { display: inline-block; min-width: 3.6mm; line-height: 3.4mm; border-radius: 2mm;
  background: #1d1d1b; color: #fff; text-align: center; font-size: 7.5pt; }
@media screen and (max-width: 600px) { body { padding: 3mm; } section { display: block; } }
"""


def write_page(path: Path, of: TreatmentMap) -> None:
    """Write the page of a treatment map as an HTML file."""
    title = f"{of.farm.name}: what to treat"
    height_mm = min(_MAP_MM, _PAGE_MM / max(len(of.zone_maps), 1) - 6.0)
    sentences = of.report.rows()
    sections = "".join(
        _section(of, zone_map, sentences.get(zone_map.field.title, "")) for zone_map in of.zone_maps
    )
    source = f" Made from {escape(of.source)}." if of.source else ""
    notes = "".join(f" {escape(note)}." for note in of.notes)
    made = f"day {of.day}, estimated by {of.estimator} from {len(of.observations):,} readings"
    doubt = " This estimator gives no uncertainty, so no area is marked to be looked at again."
    about = f"{escape(made)}.{source}{notes}{'' if of.states_deviation else doubt}"
    map_mm = _WIDE_MM if len(of.zone_maps) < _NARROW_FROM else _NARROW_MM
    zones = "".join(f".zone{zone} {{ fill: {colour}; }}\n" for zone, colour in _COLOURS.items())
    style = (
        f"{_STYLE.replace(_MAP_WIDTH, str(map_mm))}{zones}section > svg {{ max-height: {height_mm:.1f}mm; }}"
    )
    body = f'<header><h1>{escape(title)}</h1>\n<p class="about">{about}</p></header>\n{sections}'
    with atomic_write(path) as file:
        file.write(html_document(title, body, style=style))


def _section(treatment: TreatmentMap, of: ZoneMap, sentence: str) -> str:
    zones = [zone for zone in treatment.zones if zone.field == of.field.name]
    # List the zones with the most area to treat, then the zones with the greatest saving by another look.
    worst = sorted((z for z in zones if z.zone == TREAT), key=lambda z: -z.need * z.area_ha)
    look = sorted((z for z in zones if z.zone == LOOK), key=lambda z: -z.gain)
    listed = [*worst[:_LISTED], *look[:_LISTED]]
    areas = {zone: of.area_ha(zone) for zone in (TREAT, LOOK, HEALTHY)}
    whole = sum(areas.values())
    bar, done = "", 0.0
    for zone, area in areas.items():
        width = 100.0 * area / whole
        bar += f'<rect class="zone{zone}" x="{done:.3f}" width="{width:.3f}" height="1"/>'
        done += width
    key = "".join(
        f'<span><svg viewBox="0 0 1 1"><rect class="zone{zone}" width="1" height="1"/></svg>'
        f"{of.word(zone)} {area_in_words(area)}, {percent(area / whole, _LEAST_SHARE)}</span>"
        for zone, area in areas.items()
    )
    return (
        f"<section>\n{_map(treatment.farm, of, listed)}\n<div><h2>{escape(of.field.title)}</h2>\n"
        f'<p class="main">{_main(of, zones)}</p>\n'
        f'<svg class="bar" viewBox="0 0 100 1" preserveAspectRatio="none">{bar}</svg>'
        f'<div class="key">{key}</div>\n'
        f"{_table(of, listed)}<p>{escape(sentence)}.</p>\n"
        f'<p class="small">{_costs(of)}</p></div>\n</section>\n'
    )


def _main(of: ZoneMap, zones: Sequence[Zone]) -> str:
    sprayed = sum(zone.area_ha for zone in zones if zone.zone == TREAT)
    verb = "Water" if is_water(of.field) else "Treat"
    if not sprayed:
        text = "Nothing to treat now" if of.field.kind == "disease" else "Nothing is too low now"
        return f"{text}."
    rate, unit = of.costs.rate, of.costs.rate_unit
    at = f"at {rate:g} {escape(unit)}"
    if unit.endswith("/ha"):
        at = f"{_number(rate * sprayed)} {escape(unit.removesuffix('/ha'))} {at}"
    elif unit == "mm":  # 1 mm is 10 m³ a hectare
        at = f"{_number(rate * sprayed * 10.0)} m³ {at}"
    return f"{verb} {area_in_words(sprayed)}: {at}."


def _table(of: ZoneMap, listed: Sequence[Zone]) -> str:
    if not listed:
        return ""
    what = "sick" if of.field.kind == "disease" else "probability"
    rows = "".join(
        f'<tr><td><span class="dot">{number}</span></td><td>{zone.word}</td>'
        f'<td class="n">{zone.latitude_deg:.5f}, {zone.longitude_deg:.5f}</td>'
        f'<td class="n">{area_in_words(zone.area_ha)}</td>'
        f'<td class="n">{percent(zone.need, _LEAST_SHARE)}</td></tr>'
        for number, zone in enumerate(listed, start=1)
    )
    return (
        '<table><tr><th></th><th>go to</th><th class="n">latitude, longitude</th><th class="n">area</th>'
        f'<th class="n">{what}</th></tr>{rows}</table>\n'
    )


def _costs(of: ZoneMap) -> str:
    costs, expected = of.costs, of.expected_costs
    relative = " (relative, not money: give your own costs)" if costs == FieldCosts.of(of.field) else ""
    below = f" (too low: below {costs.below:g})" if of.field.kind != "disease" else ""
    return (
        f"Costs per hectare{relative}: treatment {costs.treat:g}, untreated land that needs treatment "
        f"{costs.loss:g}{below}, another look {costs.look:g}."
        f" Expected total costs: {_number(expected['zones'])} by this map,"
        f" {_number(expected['leave'])} without treatment, {_number(expected['treat'])} if all is treated,"
        f" {_number(expected['known'])} with perfect information. Blocks of {of.block_m:.1f} m."
    )


def _map(farm: Farm, of: ZoneMap, listed: Sequence[Zone]) -> str:
    """Return the SVG map of the zones; the zones that the table lists are marked with their numbers."""
    drawing = FarmDrawing.of(farm)
    palette = np.zeros((4, 3), np.uint8)
    for zone, colour in _COLOURS.items():
        palette[zone] = rgb(colour)
    dots = "".join(
        drawing.dot(*farm.frame.from_wgs84(zone.latitude_deg, zone.longitude_deg), str(number))
        for number, zone in enumerate(listed, start=1)
    )
    shows = f"Map of {of.field.title}: areas to treat and areas to look at again"
    return drawing.svg(of.field.name, shows, of.zone, of.block_m, palette, dots)


def area_in_words(hectares: float) -> str:
    """Return an area as text: in square metres if it is below 0.1 ha, else in hectares."""
    if hectares >= 0.1:
        return f"{hectares:,.1f} ha" if hectares >= 10.0 else f"{hectares:.2f} ha"
    return f"{1e4 * hectares:,.0f} m²" if hectares >= 1e-3 else f"{1e4 * hectares:.2g} m²"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"
