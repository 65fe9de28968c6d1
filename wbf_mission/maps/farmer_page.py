"""One page for the farmer: what to treat, where to look again, how sure that is; whole in one HTML file.

Nothing is loaded from elsewhere, so that it can be sent by mail and opened in a field; it prints on A4.
"""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
import shapely

from geo import Farm
from geo.atomic import atomic_write
from wbf_mission.maps.blocks import MapGrid
from wbf_mission.maps.report import FarmReport
from wbf_mission.maps.zone_shapes import Zone
from wbf_mission.maps.zones import HEALTHY, LOOK, TREAT, FieldCosts, ZoneMap, is_water

_COLOURS = {TREAT: "#b3261e", LOOK: "#f2b705", HEALTHY: "#8fc08b"}
_TOLD = 3
_PAGE_MM = 250.0
_MAP_MM = 88.0
_MAP_WIDTH, _WIDE_MM, _NARROW_MM, _NARROW_FROM = "MAP", 84, 68, 3
_PER_HECTARE = "/ha"
_M3_PER_MM_HA = 10.0
_DECIMALS = 5
_LEAST_TOLD = 1e-3

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
.bar { display: flex; height: 3.2mm; margin: 1mm 0 0.6mm; border: 0.2mm solid #1d1d1b; }
.key { display: flex; flex-wrap: wrap; gap: 0 4mm; font-size: 8.5pt; margin-bottom: 1mm; }
.key i { display: inline-block; width: 2.6mm; height: 2.6mm; border: 0.2mm solid #1d1d1b; margin-right: 1mm; }
table { border-collapse: collapse; width: 100%; font-size: 8.5pt; margin-bottom: 1.2mm; }
th { text-align: left; font-weight: 600; border-bottom: 0.2mm solid #1d1d1b; }
td, th { padding: 0.3mm 1mm 0.3mm 0; }
.n { text-align: right; font-variant-numeric: tabular-nums; }
.dot { display: inline-block; min-width: 3.6mm; line-height: 3.4mm; border-radius: 2mm;
  background: #1d1d1b; color: #fff; text-align: center; font-size: 7.5pt; }
@media screen and (max-width: 600px) { body { padding: 3mm; } section { display: block; } }
"""


@dataclass(frozen=True, slots=True)
class Page:
    """What the page tells."""

    farm: Farm
    maps: Sequence[ZoneMap]
    zones: Sequence[Zone]
    report: FarmReport
    about: str
    source: str
    notes: Sequence[str]
    tells_doubt: bool  # Whether the estimator tells how sure it is


def write_page(path: Path, page: Page) -> None:
    """Write the page."""
    title = f"{page.farm.name}: what to treat"
    height_mm = min(_MAP_MM, _PAGE_MM / max(len(page.maps), 1) - 6.0)
    sections = "".join(_section(page, one, height_mm) for one in page.maps)
    source = f" Made from {escape(page.source)}." if page.source else ""
    notes = "".join(f" {escape(note)}." for note in page.notes)
    doubt = " It does not tell how sure it is, so nothing is marked to be looked at again."
    told = f"{escape(page.about)}.{source}{notes}{'' if page.tells_doubt else doubt}"
    map_mm = _WIDE_MM if len(page.maps) < _NARROW_FROM else _NARROW_MM
    with atomic_write(path) as file:
        file.write(
            f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n<title>{escape(title)}</title>\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"<style>{_STYLE.replace(_MAP_WIDTH, str(map_mm))}</style></head>\n<body>\n"
            f'<header><h1>{escape(title)}</h1>\n<p class="about">{told}</p></header>\n'
            f"{sections}</body></html>\n"
        )


def _section(page: Page, of: ZoneMap, height_mm: float) -> str:
    zones = [one for one in page.zones if one.field == of.field.name]
    told = _told(zones)
    areas = {zone: of.area_ha(zone) for zone in (TREAT, LOOK, HEALTHY)}
    whole = sum(areas.values())
    bar = "".join(
        f'<span style="width:{100.0 * area / whole:.3f}%;background:{_COLOURS[zone]}"></span>'
        for zone, area in areas.items()
    )
    key = "".join(
        f'<span><i style="background:{_COLOURS[zone]}"></i>{of.word(zone)} {area_in_words(area)},'
        f" {_percent(area / whole)}</span>"
        for zone, area in areas.items()
    )
    title, sentences = escape(of.field.title), page.report.rows()
    return (
        f"<section>\n{_map(page.farm, of, told, height_mm)}\n<div><h2>{title}</h2>\n"
        f'<p class="main">{_main(of, zones)}</p>\n<div class="bar">{bar}</div><div class="key">{key}</div>\n'
        f"{_table(of, told)}<p>{escape(sentences.get(of.field.title, ''))}.</p>\n"
        f'<p class="small">{_costs(of)}</p></div>\n</section>\n'
    )


def _told(zones: Sequence[Zone]) -> list[Zone]:
    """Return where to go: the zones with most need, then those where a look gains most."""
    worst = sorted((z for z in zones if z.zone == TREAT), key=lambda z: -z.need * z.area_ha)[:_TOLD]
    look = sorted((z for z in zones if z.zone == LOOK), key=lambda z: -z.gain)[:_TOLD]
    return [*worst, *look]


def _main(of: ZoneMap, zones: Sequence[Zone]) -> str:
    sprayed = sum(one.area_ha for one in zones if one.zone == TREAT)
    verb = "Water" if is_water(of.field) else "Treat"
    if not sprayed:
        text = "Nothing to treat now" if of.field.kind == "disease" else "Nothing is too low now"
        return f"{text}."
    rate, unit = of.costs.rate, of.costs.rate_unit
    at = f"at {rate:g} {escape(unit)}"
    if unit.endswith(_PER_HECTARE):
        at = f"{_number(rate * sprayed)} {escape(unit.removesuffix(_PER_HECTARE))} {at}"
    elif unit == "mm":
        at = f"{_number(rate * sprayed * _M3_PER_MM_HA)} m³ {at}"
    return f"{verb} {area_in_words(sprayed)}: {at}."


def _table(of: ZoneMap, told: Sequence[Zone]) -> str:
    if not told:
        return ""
    what = "sick" if of.field.kind == "disease" else "chance of it"
    rows = "".join(
        f'<tr><td><span class="dot">{number}</span></td><td>{one.word}</td>'
        f'<td class="n">{one.latitude_deg:.{_DECIMALS}f}, {one.longitude_deg:.{_DECIMALS}f}</td>'
        f'<td class="n">{area_in_words(one.area_ha)}</td><td class="n">{_percent(one.need)}</td></tr>'
        for number, one in enumerate(told, start=1)
    )
    return (
        '<table><tr><th></th><th>go to</th><th class="n">latitude, longitude</th><th class="n">area</th>'
        f'<th class="n">{what}</th></tr>{rows}</table>\n'
    )


def _costs(of: ZoneMap) -> str:
    costs, expected = of.costs, of.expected_costs
    relative = " (relative, not money: give yours)" if costs == FieldCosts.of(of.field) else ""
    below = f" (too low: below {costs.below:g})" if of.field.kind != "disease" else ""
    return (
        f"Costs a hectare{relative}: treating {costs.treat:g}, land that needs it and is left"
        f" {costs.loss:g}{below}, another look {costs.look:g}."
        f" Expected in all: {_number(expected['zones'])} by this map,"
        f" {_number(expected['leave'])} if nothing is done, {_number(expected['treat'])} if all is treated;"
        f" {_number(expected['known'])} if everything were known. Blocks of {of.block_m:.1f} m."
    )


@dataclass(frozen=True, slots=True)
class _View:
    """What is drawn of a farm: the owner's land, in metres, y downwards; `unit` is a hundredth of it."""

    farm: Farm
    left: float
    right: float
    top: float
    foot: float
    unit: float

    @classmethod
    def of(cls, farm: Farm) -> _View:
        """Look at the owner's land."""
        left, low, right, high = farm.owner_area.bounds
        height = farm.height_cells * farm.cell_size_m
        return cls(farm, left, right, height - high, height - low, max(right - left, high - low) / 100.0)

    def down(self, y_m: float) -> float:
        """Return how far down a y of the frame lies."""
        return self.farm.height_cells * self.farm.cell_size_m - y_m

    def text(self, x: float, y: float, text: str, size: float = 3.0, **how: str) -> str:
        """Write a text; its size is in units."""
        told = "".join(f' {name.replace("_", "-")}="{value}"' for name, value in how.items())
        return f'<text x="{x:.3f}" y="{y:.3f}" font-size="{size * self.unit:.3f}"{told}>{escape(text)}</text>'


def _map(farm: Farm, of: ZoneMap, told: Sequence[Zone], height_mm: float) -> str:
    """Draw the zones with the owner's border, the blocks of the report, scale and north."""
    view = _View.of(farm)
    unit, clip = view.unit, f"land-{of.field.name}"
    across, up = (n * of.block_m for n in of.zone.shape)
    border = "".join(_path(one, view) for one in shapely.get_parts(farm.owner_area))
    dots = "".join(_dot(view, one, number) for number, one in enumerate(told, start=1))
    wide, high = view.right - view.left + 6.0 * unit, view.foot - view.top + 13.0 * unit
    return (
        f'<svg viewBox="{view.left - 5.0 * unit:.3f} {view.top - 4.0 * unit:.3f} {wide:.3f} {high:.3f}"'
        f' style="max-height:{height_mm:.1f}mm" role="img"><clipPath id="{clip}"><path d="{border}"'
        f' clip-rule="evenodd"/></clipPath><image x="0" y="{view.down(up):.3f}" width="{across:.3f}"'
        f' height="{up:.3f}" preserveAspectRatio="none" clip-path="url(#{clip})"'
        f' style="image-rendering:pixelated" href="{_picture(of)}"/>'
        f'<path d="{border}" fill="none" stroke="#1d1d1b" stroke-width="{0.5 * unit:.3f}"/>'
        f"{_edges(view)}{dots}{_scale(view)}{_north(view)}</svg>"
    )


def _picture(of: ZoneMap) -> str:
    from PIL import Image

    palette = np.zeros((4, 3), np.uint8)
    for zone, colour in _COLOURS.items():
        palette[zone] = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    picture = Image.fromarray(np.ascontiguousarray(of.zone.T[::-1]))
    picture.putpalette(palette.ravel().tolist())
    file = io.BytesIO()
    picture.save(file, "PNG", transparency=0, optimize=True)
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"


def _path(polygon: shapely.Polygon, view: _View) -> str:
    return "".join(
        "M" + "L".join(f"{x:.2f} {view.down(y):.2f}" for x, y in shapely.get_coordinates(ring)) + "Z"
        for ring in (polygon.exterior, *polygon.interiors)
    )


def _edges(view: _View) -> str:
    """Name the blocks of the report along the edges, as in its sentences."""
    grid, unit = MapGrid.of(view.farm), view.unit
    side = grid.block * grid.cell_size_m
    how = {"size": 2.3, "text_anchor": "middle", "fill": "#55534f"}
    middles = [(k + 0.5) * side for k in range(max(grid.blocks))]
    texts = [
        view.text(x, view.top - 1.2 * unit, grid.name(k, 0)[:-1], **how)  # type: ignore[arg-type]
        for k, x in enumerate(middles)
        if view.left < x < view.right
    ]
    texts += [
        view.text(view.left - 2.6 * unit, view.down(y) + 0.8 * unit, str(k + 1), **how)  # type: ignore[arg-type]
        for k, y in enumerate(middles)
        if view.top < view.down(y) < view.foot
    ]
    return "".join(texts)


def _dot(view: _View, zone: Zone, number: int) -> str:
    x, y_m = view.farm.frame.from_wgs84(zone.latitude_deg, zone.longitude_deg)
    y, unit = view.down(y_m), view.unit
    return (
        f'<circle cx="{x:.3f}" cy="{y:.3f}" r="{2.2 * unit:.3f}" fill="#1d1d1b" stroke="#fff"'
        f' stroke-width="{0.4 * unit:.3f}"/>'
        + view.text(x, y + 1.05 * unit, str(number), text_anchor="middle", fill="#fff")
    )


def _scale(view: _View) -> str:
    """Draw a bar of a round length, of about a quarter of the map."""
    longest, unit = 0.3 * (view.right - view.left), view.unit
    power = 10.0 ** math.floor(math.log10(longest))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest)
    x, y = view.left, view.foot + 4.0 * unit
    return (
        f'<path d="M{x:.3f} {y - unit:.3f}V{y:.3f}H{x + length:.3f}V{y - unit:.3f}" fill="none"'
        f' stroke="#1d1d1b" stroke-width="{0.5 * unit:.3f}"/>'
        + view.text(x + length + unit, y, f"{length:g} m" if length < 1e3 else f"{length / 1e3:g} km")
    )


def _north(view: _View) -> str:
    """Draw an arrow to the north, which is up only where the farm's frame is not turned."""
    x, y = view.farm.frame.from_east_north(0.0, 1.0)
    turn, unit = math.degrees(math.atan2(x, y)), view.unit
    at = f"translate({view.right - 4.0 * unit:.3f} {view.foot + 4.8 * unit:.3f}) scale({unit:.4f})"
    return (
        f'<g transform="{at}"><path transform="rotate({turn:.2f})" d="M0 -3L1.6 3L0 1.8L-1.6 3Z"'
        ' fill="#1d1d1b"/><text x="2.4" y="1" font-size="3">N</text></g>'
    )


def area_in_words(hectares: float) -> str:
    """Return an area in hectares, a small one in square metres."""
    if hectares >= 0.1:
        return f"{hectares:,.1f} ha" if hectares >= 10.0 else f"{hectares:.2f} ha"
    return f"{1e4 * hectares:,.0f} m²" if hectares >= 1e-3 else f"{1e4 * hectares:.2g} m²"


def _percent(share: float) -> str:
    if 0.0 < share < _LEAST_TOLD:
        return f"under {100.0 * _LEAST_TOLD:g} %"
    return f"{100.0 * share:.2g} %" if share < 0.1 else f"{100.0 * share:.0f} %"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"
