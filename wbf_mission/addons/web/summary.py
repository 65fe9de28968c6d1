"""Summary of a run on one sheet of paper: the flight, sick plants and their places, and the cost.

The summary of two runs shows their differences.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from mission.outcome import in_words
from sensors.fields import Field
from wbf_mission.addons.base.farm_drawing import FarmDrawing
from wbf_mission.addons.base.plots import ramp
from wbf_mission.maps.field_maps import FieldMap
from wbf_mission.maps.report import FieldReport, brief, percent
from wbf_mission.run.record import RunRecord

_BEGIN = '<section id="summary" aria-label="Summary">'
_STEPS = 100
_LEAST_SCALE = 0.02  # Minimum for the top of the colour scale, as a fraction of sick plants
_MOST_PIXELS = 0.995
_SICK = ("#e3ecd2", "#f6c66a", "#e2711d", "#8e1f1c", "#4a0b16")
_PATH_M = 0.002  # Minimum step of a drawn path, as a fraction of the farm's side
_DENSE_SIDES = 15.0  # Tracks of this length, in sides of the farm, cover the whole map
_SHEET_MM, _LINE_MM = 262.0, 4.5  # Height below the title, and height of a line
_LEAST_MM, _MOST_MM = 18.0, 84.0  # Minimum and maximum height of a map
_KEY_MM, _HEAD_MM = 12.0, 7.0  # Height of a field's key and heading, with gaps
_TOLD_WARNINGS = 4
_LONGEST_WARNING = 220


def run_title(record: RunRecord) -> str:
    """Return the title of a run: farm, planner or policy, estimator, vehicle."""
    parts = (_chooser(record), record.estimator, record.plan.vehicle.name)
    return f"{record.farm.name}: {', '.join(parts)}, seed {record.scenario.seed}"


def summary_of(record: RunRecord, *, notes: Sequence[str] = ()) -> str:
    """Return the summary of a run as an HTML element; `notes` concern the page below the summary."""
    facts, warnings = _facts(record), _shown_warnings(record)
    reports = _reports(record)
    shown = [field_map for field_map in record.maps if field_map.field.name in reports]
    lines = _lines(facts.values(), 100) + _lines(warnings, 115)
    height_mm = _map_height_mm(lines, len(shown), _KEY_MM)
    scales = {field_map.field.name: _scale([field_map]) for field_map in shown}
    fields = "".join(
        f'<div class="field"><div>{_map(record, field_map, scales[field_map.field.name], height_mm, reports)}'
        f"{_key(field_map.field, scales[field_map.field.name])}</div>"
        f"<div><h2>{escape(field_map.field.title)}</h2>{_about(reports[field_map.field.name])}</div></div>\n"
        for field_map in shown
    )
    title = f"{record.farm.name}: what the flight found"
    rows = "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in facts.items())
    listed = "".join(f"<li>{escape(warning)}</li>" for warning in warnings)
    listed = f'<ul class="warnings">{listed}</ul>\n' if listed else ""
    return (
        f'{_BEGIN}<h1>{escape(title)}</h1>\n<dl class="facts">{rows}</dl>\n'
        f"{listed}{fields}{_below(notes)}</section>"
    )


def comparison_of(first: RunRecord, second: RunRecord, *, notes: Sequence[str] = ()) -> str:
    """Return the summary of two runs over the same farm: their differences, and both maps."""
    facts = [_facts(one, short=True) for one in (first, second)]
    names = list(dict.fromkeys([*facts[0], *facts[1]]))
    rows = []
    for name in names:
        of_first, of_second = (each.get(name, "-") for each in facts)
        kind = "" if of_first == of_second else ' class="differs"'
        rows.append(
            f"<tr{kind}><th>{escape(name)}</th><td>{escape(of_first)}</td><td>{escape(of_second)}</td></tr>"
        )
    reports = [_reports(record) for record in (first, second)]
    pairs = [
        (first_map, second_map)
        for first_map in first.maps
        for second_map in second.maps
        if first_map.field.name == second_map.field.name
        and all(first_map.field.name in each for each in reports)
    ]
    lines = sum(_lines([max((each.get(name, "-") for each in facts), key=len)], 45) for name in names)
    height_mm = _map_height_mm(lines + 1, len(pairs), _KEY_MM + _HEAD_MM)
    fields = ""
    for pair in pairs:
        scale, field = _scale(pair), pair[0].field
        fields += f'<div class="field two"><h2>{escape(field.title)}</h2>'
        for record, shown, of, side in zip((first, second), pair, reports, "ab", strict=True):
            label = escape(brief(of[field.name]))
            fields += (
                f"<div>{_map(record, shown, scale, height_mm, of, side)}{_key(field, scale, label)}</div>"
            )
        fields += "</div>\n"
    return (
        f"{_BEGIN}<h1>{escape(first.farm.name)}: two runs</h1>\n"
        f"<table><tr><th></th><th>A</th><th>B</th></tr>{''.join(rows)}</table>\n{fields}"
        f"{_below(notes)}</section>"
    )


def _reports(record: RunRecord) -> dict[str, FieldReport]:
    return {} if record.report is None else {report.name: report for report in record.report.fields}


def _below(notes: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f'<nav class="below"><a href="#app">Replay it below</a><ul>{items}</ul></nav>\n'


def _chooser(record: RunRecord) -> str:
    mission = record.scenario.mission
    if mission.policy is not None:
        return str(mission.policy)
    return record.plan.planner or f"mission {mission.file}"


def _facts(record: RunRecord, *, short: bool = False) -> dict[str, str]:
    """Return the facts of a run in words, by name; `short` facts are for a comparison."""
    summary, scenario = record.summary(), record.scenario
    vehicles = list(dict.fromkeys(scenario.vehicle.names))
    count = summary["vehicles"]
    days = [day.day for day in record.days] or [scenario.farm.day]
    when = f"day {days[0]}" if len(days) == 1 else f"days {days[0]} to {days[-1]}"
    flights, seed = len(record.flights), str(scenario.seed)
    seen = f"{percent(summary['coverage'])} of the land to be seen"
    facts = {
        "path": _chooser(record),
        "vehicle": f"{count} x {', '.join(vehicles)}" if count > 1 else ", ".join(vehicles),
        "when": when if short else f"{when}, {flights} flight{'s' if flights != 1 else ''}",
        **({"flights": str(flights)} if short else {}),
        "outcome": in_words(record.outcome, record.reason),
        # Only the first path of a policy is known before the flight.
        "flown": record.flown(predicted=not short and scenario.mission.policy is None),
        "battery": _battery(record),
        "seen": f"{summary['observations']:,} readings, {seen}",
        "estimator": record.estimator if short else f"{record.estimator}, seed {seed}",
        **({"seed": seed} if short else {}),
    }
    if record.score is not None and record.final_score is not None:
        facts["score"] = (
            f"{record.score:.5f} over the run, {record.final_score:.5f} at its end (0 is perfect)"
        )
    for name, value in summary["losses"].items():
        if short and value is not None:
            facts[f"loss a cell, {name}"] = f"{value:.4g}"
    if short and record.warnings:
        facts["warnings"] = str(len(record.warnings))
    return facts


def _battery(record: RunRecord) -> str:
    used = [flight.battery_used for flight in record.flights if flight.battery_used is not None]
    if not used:
        return "not reported"
    if len(used) == 1:
        return f"{percent(used[0])} of one"
    return f"{sum(used):.1f} charges in {len(used)} flights, at most {percent(max(used))} of one in a flight"


def _shown_warnings(record: RunRecord) -> list[str]:
    """Return the first warnings, and a line with the number of further warnings."""
    warnings = record.warnings
    lines = [text if len(text) <= _LONGEST_WARNING else f"{text[:_LONGEST_WARNING]}..." for text in warnings]
    if len(lines) > _TOLD_WARNINGS:
        lines[_TOLD_WARNINGS - 1 :] = [f"and {len(lines) - _TOLD_WARNINGS + 1} more warnings"]
    return lines


def _lines(texts: Iterable[str], columns: int) -> int:
    """Return the approximate number of printed lines that texts take."""
    return sum(-(-len(text) // columns) for text in texts)


def _map_height_mm(lines: int, fields: int, beside_mm: float) -> float:
    """Return the height of maps for which all lines and fields fit on one sheet (mm)."""
    room_mm = (_SHEET_MM - _LINE_MM * lines) / max(fields, 1) - beside_mm
    return min(max(room_mm, _LEAST_MM), _MOST_MM)


def _about(report: FieldReport) -> str:
    """Describe the sickness of a field, its uncertainty, and the worst places."""
    disease = report.kind == "disease"
    write = _writer(report)
    sure = "the estimator gives no uncertainty"
    if report.low is not None and report.high is not None:
        sure = f"90 % sure: {write(report.low)} to {write(report.high)}"
    what = "of the plants are expected to be sick" if disease else "on average"
    if report.is_of_seen:
        what = "of the plants that were looked at are sick" if disease else "on average in observed cells"
        sure = "nothing is known of the rest"
    main = f"{write(report.expected)} {what}"
    interval = [
        "" if block.low is None or block.high is None else f"{write(block.low)} to {write(block.high)}"
        for block in report.blocks
    ]
    seen = f"{report.seen:,} of {report.cells:,} {'plants' if disease else 'cells'} were looked at"
    if disease:
        seen += f", {report.seen_sick:,} of these were sick"
    rows = "".join(
        f'<tr><td><span class="dot">{number}</span> {escape(block.name)}</td>'
        f'<td class="n">{block.latitude_deg:.5f}, {block.longitude_deg:.5f}</td>'
        f'<td class="n">{write(block.expected)}</td><td class="n">{interval[number - 1]}</td></tr>'
        for number, block in enumerate(report.blocks, start=1)
    )
    worst = "worst blocks" if disease else "lowest blocks"
    return (
        f'<p class="main">{main}</p><p>{sure}. {seen}.</p>'
        f'<table><tr><th>{worst}</th><th class="n">latitude, longitude</th><th class="n">'
        f'{"sick" if disease else "value"}</th><th class="n">90 %</th></tr>{rows}</table>'
    )


def _writer(report: FieldReport) -> Callable[[float], str]:
    """Return a function that formats a field's numbers: a percentage of plants, or a value with unit."""
    if report.kind == "disease":
        return percent
    return lambda value: f"{value:.3g} {report.unit}".rstrip()


def _map(
    record: RunRecord,
    of: FieldMap,
    scale: float,
    height_mm: float,
    reports: Mapping[str, FieldReport],
    side: str = "",
) -> str:
    """Draw the estimate of a field, the path flown, and the listed blocks."""
    drawing, grid, field = FarmDrawing.of(record.farm), of.grid, of.field
    share = of.share / scale
    pixels = np.zeros(share.shape, np.uint8)
    known = np.isfinite(share)
    pixels[known] = 1 + np.clip(np.rint(share[known] * (_STEPS - 1)), 0, _STEPS - 1).astype(np.uint8)
    palette = np.concatenate([np.zeros((1, 3), np.uint8), _ramp(field)])
    blocks = reports[field.name].blocks
    dots = "".join(drawing.dot(block.x_m, block.y_m, str(n)) for n, block in enumerate(blocks, start=1))
    over = _flown(record, drawing) + dots
    shows = f"Map of the estimate of {field.title}"
    name = f"{field.name}{side}"
    drawn = drawing.svg(name, shows, pixels, grid.pixel * grid.cell_size_m, palette, over)
    return drawn.replace("<svg ", f'<svg height="{height_mm:.1f}mm" ', 1)


def _flown(record: RunRecord, drawing: FarmDrawing) -> str:
    """Draw the tracks of all flights at the map's resolution."""
    step_m, paths, points = _PATH_M * 100.0 * drawing.unit, [], 0
    for flight in record.flights:
        x, y = flight.track.x_m, flight.track.y_m
        if len(x):
            along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
            _, kept = np.unique((along // step_m).astype(np.int64), return_index=True)
            points += len(kept)
            paths.append("M" + "L".join(f"{x[k]:.1f} {drawing.down(y[k]):.1f}" for k in kept))
    # Dense tracks must not hide the estimate.
    opacity = 0.55 if points * _PATH_M < _DENSE_SIDES else 0.2
    line = f'fill="none" stroke="#1f3b73" stroke-opacity="{opacity:g}"'
    return f'<path d="{"".join(paths)}" {line} stroke-width="{0.25 * drawing.unit:.3f}"/>'


def _scale(maps: Sequence[FieldMap]) -> float:
    """Return the maps' scale: a disease's highest fraction, at least `_LEAST_SCALE`; for other fields 1."""
    if maps[0].field.kind != "disease":
        return 1.0
    # A pixel at a border has few plants, so one sick plant there must not set the scale.
    highest = (float(np.nanquantile(one.share, _MOST_PIXELS)) for one in maps if np.isfinite(one.share).any())
    return max(_LEAST_SCALE, *highest, 0.0)


def _ramp(field: Field) -> NDArray[np.uint8]:
    """Return the colours of a field's map from 0 to its scale, uint8[`_STEPS`, 3]."""
    return ramp(_SICK if field.kind == "disease" else field.colours, _STEPS)


def _key(field: Field, scale: float, label: str = "") -> str:
    """Draw the colour key of a map."""
    bars = "".join(
        f'<rect x="{k}" width="1.05" height="1" fill="#{r:02x}{g:02x}{b:02x}"/>'
        for k, (r, g, b) in enumerate(_ramp(field)[:: _STEPS // 20].tolist())
    )
    bar = f'<svg viewBox="0 0 20 1" preserveAspectRatio="none" aria-hidden="true">{bars}</svg>'
    if field.kind == "disease":
        low, high = "0 %", f"{percent(scale)} sick"
    else:
        low, high = (f"{field.to_unit(one):.3g}" for one in (0.0, scale))
        high = f"{high} {'' if field.range == (0.0, 1.0) else field.unit}".rstrip()
    label = f"<strong>{label}</strong>" if label else ""
    return f'<p class="key">{label}<span>{low}</span>{bar}<span>{escape(high)}</span></p>'
