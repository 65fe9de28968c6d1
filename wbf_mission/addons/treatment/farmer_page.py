"""Page for the farmer in one HTML file: areas to treat and areas to look at again, with maps and costs.

The page loads no other files, so that it can be sent by mail and opened offline. It fits A4 paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from geo import Farm
from geo.atomic import atomic_write
from wbf_mission.addons.base.farm_drawing import FarmDrawing
from wbf_mission.addons.base.markup import html_document
from wbf_mission.addons.base.plots import rgb
from wbf_mission.addons.treatment.treatment_map import TreatmentMap
from wbf_mission.addons.treatment.zone_shapes import Zone
from wbf_mission.addons.treatment.zones import HEALTHY, LOOK, TREAT, FieldCosts, ZoneMap, is_water
from wbf_mission.maps.report import percent

_COLOURS = {TREAT: "#b3261e", LOOK: "#f2b705", HEALTHY: "#8fc08b"}
_LISTED = 3  # Maximum number of zones of each kind in a table
_PAGE_MM = 250.0
_MAP_MM = 88.0
_MAP_WIDTH, _WIDE_MM, _NARROW_MM, _NARROW_FROM = "MAP", 84, 68, 3
_LEAST_SHARE = 1e-3  # Smallest share written with digits

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
    what = "sick" if of.field.kind == "disease" else "chance of it"
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
        f"Costs a hectare{relative}: treating {costs.treat:g}, untreated land that needs treatment "
        f"{costs.loss:g}{below}, another look {costs.look:g}."
        f" Expected total costs: {_number(expected['zones'])} by this map,"
        f" {_number(expected['leave'])} without treatment, {_number(expected['treat'])} if all is treated,"
        f" {_number(expected['known'])} with perfect information. Blocks of {of.block_m:.1f} m."
    )


def _map(farm: Farm, of: ZoneMap, listed: Sequence[Zone]) -> str:
    """Return the SVG map of the zones, with numbered marks on the listed zones."""
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
    """Return an area as text: in hectares, or if it is below 0.1 ha in square metres."""
    if hectares >= 0.1:
        return f"{hectares:,.1f} ha" if hectares >= 10.0 else f"{hectares:.2f} ha"
    return f"{1e4 * hectares:,.0f} m²" if hectares >= 1e-3 else f"{1e4 * hectares:.2g} m²"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"
