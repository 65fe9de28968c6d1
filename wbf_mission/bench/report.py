"""A report of a benchmark as files: tables as Markdown and HTML, and the score over time as pictures."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from geo.atomic import atomic_write
from wbf_mission.bench.row import BenchRow
from wbf_mission.bench.standings import Interval, Standing, standings
from wbf_mission.plots import LINE_COLOURS, new_figure, save_figure

__all__ = [
    "ReportTable",
    "markdown_table",
    "score_over_time",
    "scores_at",
    "standing_table",
    "write_report",
]

_READING = (
    "Scores: 0 is perfect; the mean over the run and at its end, each with its interval of 95 % over the "
    "environments. Losses are means a cell at the end. Rank: the mean place among all rows on the same "
    "environment. Wins: on how many a row was the best, shared ones in parts."
)
_POINTS = 200
_MOST_LINES = 8
_FEWEST_FOR_A_BAND = 5


@dataclass(frozen=True, slots=True)
class ReportTable:
    """A table of texts; all columns but the first hold numbers."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def standing_table(title: str, found: Sequence[Standing]) -> ReportTable:
    """Return the standings of one scenario."""
    fields = list(dict.fromkeys(name for one in found for name in one.losses))
    losses = (f"loss {name}" for name in fields)
    header = ("planner, estimator", "run", "95 %", "end", "95 %", *losses, "rank", "wins", "runs", "CPU, s")
    rows = tuple(
        (
            f"{one.planner}, {one.estimator}",
            *_interval(one.score),
            *_interval(one.final_score),
            *(_number(one.losses.get(name, math.nan), 4) for name in fields),
            _number(one.rank, 1),
            f"{one.wins:.3g}",
            f"{one.runs}" + (f", {one.failed} failed" if one.failed else ""),
            _number(one.cpu_time_s, 2),
        )
        for one in found
    )
    return ReportTable(title, header, rows)


def _behind(found: Sequence[Standing]) -> ReportTable:
    """Return by how much the others are behind the best of each scenario."""
    rows = tuple(
        (f"{one.scenario}, {one.planner}, {one.estimator}", *_interval(one.behind))
        for one in found
        if math.isfinite(one.behind.low)
    )
    return ReportTable("Behind the best of the scenario, in pairs", ("run", "mean", "95 %"), rows)


def score_over_time(rows: Sequence[BenchRow]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and, at each, the score of each run as it stood then.

    Parameters
    ----------
    rows : sequence of BenchRow
        With a history; before its first scored time a run has the score of that.

    Returns
    -------
    times_s : float64[t]
    scores : float64[runs, t]
    """
    last_s = max(row.times_s[-1] for row in rows)
    times_s = np.linspace(0.0, last_s, _POINTS)
    return times_s, np.array([scores_at(row, times_s) for row in rows])


def scores_at(row: BenchRow, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the score of a run as it stood at some times; before its first scored time that of it."""
    at = np.searchsorted(row.times_s, times_s, side="right") - 1
    scores: NDArray[np.float64] = np.array(row.scores)[np.maximum(at, 0)]
    return scores


def write_report(rows: Sequence[BenchRow], folder: Path, *, title: str) -> list[Path]:
    """Write ``report.md``, ``report.html`` and a picture for each scenario into a folder; return the files.

    Raises
    ------
    OSError
        If one cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    found = standings(rows)
    parts: list[tuple[ReportTable, Path | None]] = []
    for scenario in dict.fromkeys(one.scenario for one in found):
        here = [one for one in found if one.scenario == scenario]
        told = [row for row in rows if row.scenario == scenario and row.error is None and row.times_s]
        picture = _plot(scenario, here, told, folder) if told else None
        parts.append((standing_table(f"{scenario}: scores over the run and at its end", here), picture))
    tables = (_behind(found), _flown(rows), _costs(rows), _failures(rows))
    parts += [(table, None) for table in tables if table.rows]
    markdown, page = folder / "report.md", folder / "report.html"
    with atomic_write(markdown) as file:
        file.write(_markdown(title, parts))
    with atomic_write(page) as file:
        file.write(_html(title, parts))
    return [markdown, page, *(picture for _, picture in parts if picture is not None)]


def _plot(scenario: str, found: Sequence[Standing], rows: Sequence[BenchRow], folder: Path) -> Path:
    """Draw the mean score over time of the best rows, with Student's intervals."""
    figure = new_figure(8.0, 4.5)
    axes = figure.add_subplot()
    for one, colour in zip(found[:_MOST_LINES], LINE_COLOURS, strict=False):
        own = [row for row in rows if (row.planner, row.estimator) == (one.planner, one.estimator)]
        if not own:
            continue
        times_s, scores = score_over_time(own)
        means = scores.mean(axis=0)
        axes.plot(times_s, means, color=colour, label=f"{one.planner}, {one.estimator}")
        if len(own) >= _FEWEST_FOR_A_BAND:
            error = scores.std(axis=0, ddof=1) / np.sqrt(len(own)) * stats.t.ppf(0.975, len(own) - 1)
            axes.fill_between(times_s, means - error, means + error, color=colour, alpha=0.12, linewidth=0.0)
    axes.set_xlabel("time, s")
    axes.set_ylabel("score, 0 is perfect")
    left_out = f" (the best {_MOST_LINES} of {len(found)})" if len(found) > _MOST_LINES else ""
    axes.set_title(f"{scenario}: mean score, with its interval of 95 %{left_out}", fontsize=10, loc="left")
    axes.set_ylim(top=0.0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="lower right")
    figure.tight_layout()
    return save_figure(figure, folder / f"{scenario.replace('/', '-').removesuffix('.toml')}.png")


def _flown(rows: Sequence[BenchRow]) -> ReportTable:
    """How long plans took that nobody changed on the way."""
    table = []
    for scenario, planner in sorted({(row.scenario, row.planner) for row in rows}):
        pairs = [
            (row.flight_time_s, row.predicted_time_s, row.path_length_m)
            for row in rows
            if (row.scenario, row.planner) == (scenario, planner)
            if row.flight_time_s and row.predicted_time_s and row.error is None and row.decisions == 1
        ]
        if pairs:
            ratios = np.array([flown / predicted - 1.0 for flown, predicted, _ in pairs])
            length_m = float(np.mean([length for _, _, length in pairs if length is not None]))
            table.append(
                (
                    f"{scenario}, {planner}",
                    f"{np.mean([flown for flown, _, _ in pairs]):.1f}",
                    f"{np.mean([predicted for _, predicted, _ in pairs]):.1f}",
                    f"{ratios.mean():+.2%}",
                    f"{np.abs(ratios).max():.2%}",
                    f"{length_m:.1f}",
                )
            )
    header = ("scenario, planner", "flown, s", "predicted, s", "mean error", "largest error", "path, m")
    return ReportTable("Planned and flown", header, tuple(table))


def _costs(rows: Sequence[BenchRow]) -> ReportTable:
    """What the runs took, by their parts."""
    good = [row for row in rows if row.error is None]
    stages = list(dict.fromkeys(name for row in good for name in row.timings_s))
    table = []
    for pair in sorted({(row.scenario, row.planner, row.estimator) for row in good}):
        own = [row for row in good if (row.scenario, row.planner, row.estimator) == pair]
        cells = [np.mean([row.timings_s.get(name, 0.0) for row in own]) for name in stages]
        table.append(
            (
                ", ".join(pair),
                f"{np.mean([row.wall_time_s for row in own]):.2f}",
                f"{np.mean([row.cpu_time_s for row in own]):.2f}",
                *(f"{cell:.2f}" for cell in cells),
            )
        )
    return ReportTable("What a run takes, s", ("run", "wall", "CPU", *stages), tuple(table))


def _failures(rows: Sequence[BenchRow]) -> ReportTable:
    table = [
        (f"{row.scenario}, {row.planner}, {row.estimator}, seed {row.seed}", row.error)
        for row in rows
        if row.error is not None
    ]
    return ReportTable("Runs that failed", ("run", "cause"), tuple(table))


def _interval(one: Interval) -> tuple[str, str]:
    return _number(one.mean, 4), "-" if math.isnan(one.low) else f"{one.low:.4f} to {one.high:.4f}"


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def markdown_table(table: ReportTable) -> list[str]:
    """Return the lines of a table in Markdown, without its title."""

    def cells(row: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"

    return [
        cells(table.header),
        "|---" + "|--:" * (len(table.header) - 1) + "|",
        *map(cells, table.rows),
    ]


def _markdown(title: str, parts: Sequence[tuple[ReportTable, Path | None]]) -> str:
    lines = [f"# {title}", "", _READING]
    for table, picture in parts:
        lines += ["", f"## {table.title}", "", *markdown_table(table)]
        if picture is not None:
            lines += ["", f"![Score over time]({picture.name})"]
    return "\n".join(lines) + "\n"


_STYLE = (
    ":root{color-scheme:light dark;--text:#222;--page:#fff;--line:#ddd;--soft:#f5f5f3}"
    "@media (prefers-color-scheme:dark){:root{--text:#ddd;--page:#16181b;--line:#3a3d42;--soft:#202327}}"
    "body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:92em;padding:0 1em;"
    "color:var(--text);background:var(--page)}"
    ".wide{overflow-x:auto}"
    "table{border-collapse:collapse;font-variant-numeric:tabular-nums}"
    "th,td{padding:.25em .7em;border-bottom:1px solid var(--line);text-align:right;white-space:nowrap}"
    "th:first-child,td:first-child{text-align:left;position:sticky;left:0;background:var(--page)}"
    "tbody tr:hover td{background:var(--soft)}"
    "@media (max-width:40em){th:first-child,td:first-child{white-space:normal;min-width:8em}}"
    ".text td:last-child,.text th:last-child{text-align:left;white-space:normal}"
    "img{max-width:100%;background:#fff;border-radius:4px}"
)


def _html(title: str, parts: Sequence[tuple[ReportTable, Path | None]]) -> str:
    def cells(row: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in row) + "</tr>"

    name = html.escape(title)
    lines = ["<!doctype html>", '<html lang="en"><head><meta charset="utf-8">', f"<title>{name}</title>"]
    lines.append('<meta name="viewport" content="width=device-width, initial-scale=1">')
    lines += [f"<style>{_STYLE}</style></head><body>", f"<h1>{name}</h1>", f"<p>{html.escape(_READING)}</p>"]
    for table, picture in parts:
        kind = "wide text" if len(table.header) == 2 else "wide"
        lines += [f"<h2>{html.escape(table.title)}</h2>", f'<div class="{kind}"><table>']
        lines += ["<thead>", cells(table.header, "th"), "</thead><tbody>"]
        lines += [*(cells(row, "td") for row in table.rows), "</tbody></table></div>"]
        if picture is not None:
            lines.append(f'<p><img src="{html.escape(picture.name)}" alt="Score over time"></p>')
    return "\n".join([*lines, "</body></html>"]) + "\n"
