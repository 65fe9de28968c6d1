"""Pages of captions, pictures and tables, written as Markdown; also tables and curves of standings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from geo.atomic import atomic_write
from wbf_mission.addons.base.intervals import Interval, mean_intervals, score_text
from wbf_mission.addons.base.standings import Standing
from wbf_mission.bench.rows import BenchRow

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FENCE = "```"


@dataclass(frozen=True, slots=True)
class Table:
    """A table of texts; the first `texts` columns hold words, the other columns hold numbers."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    texts: int = 1


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture in the folder of the page."""

    file: str
    """File name; a PDF becomes a link, because browsers do not show a PDF as a picture."""
    shows: str
    """Alternative text."""


@dataclass(frozen=True, slots=True)
class Listing:
    """Preformatted lines, such as a command or a file."""

    title: str
    lines: str
    language: str = ""


@dataclass(frozen=True, slots=True)
class Section:
    """A section of a page, under its title."""

    title: str
    text: str = ""
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()
    listings: tuple[Listing, ...] = ()


@dataclass(frozen=True, slots=True)
class Page:
    """A page with a title, an introduction and sections; no text has markup."""

    title: str
    about: str
    sections: tuple[Section, ...]

    def write(self, path: Path) -> None:
        """Write the page as Markdown to `path`, which lies in the folder of its pictures."""
        with atomic_write(path) as file:
            file.writelines(f"{line}\n" for line in self._markdown())

    def _markdown(self) -> Iterator[str]:
        yield from (f"# {self.title}", "", self.about)
        for section in self.sections:
            yield from ("", f"## {section.title.translate(_ESCAPED)}")
            for picture in section.pictures:
                yield from ("", f"![{picture.shows}]({picture.file})")
            if section.text:
                yield from ("", section.text.translate(_ESCAPED))
            for listing in section.listings:
                fence = _FENCE * (listing.lines.count(_FENCE) + 1)
                yield from ("", f"### {listing.title}", "")
                yield from (f"{fence}{listing.language}", listing.lines, fence)
            for table in section.tables:
                yield from ("", f"### {table.title.translate(_ESCAPED)}", "", *_markdown_table(table))


# Names come from files of other people, so markup and links in names are escaped.
_ESCAPED = str.maketrans({"|": "\\|", "<": "&lt;", "[": "\\["})


def _markdown_table(table: Table) -> Iterator[str]:
    def cells(row: Sequence[str]) -> str:
        return "| " + " | ".join(cell.translate(_ESCAPED) for cell in row) + " |"

    yield cells(table.header)
    yield "|---" * table.texts + "|--:" * (len(table.header) - table.texts) + "|"
    yield from map(cells, table.rows)


SCORES = "Scores over the run and at its end"
_POINTS = 200
_FEWEST_FOR_A_BAND = 5


def standing_table(title: str, found: Sequence[Standing], *, whole: bool = False) -> Table:
    """Return a table of standings; with `whole`, it has a column `scenario` for several scenarios."""
    named = ("scenario", "planner or policy", "estimator") if whole else ("planner, estimator",)
    header = (*named, "run", "95 %", "end", "95 %", "rank", "wins", "runs", "bad answers", "CPU, s")
    rows = tuple(
        (
            *((standing.scenario, standing.planner, standing.estimator) if whole else (standing.named,)),
            *interval_cells(standing.score),
            *interval_cells(standing.final_score),
            number_text(standing.rank, 1),
            f"{standing.wins:.3g}",
            f"{standing.environments}" + (f", {standing.failed} failed" if standing.failed else ""),
            "-" if math.isnan(standing.bad_share) else f"{standing.bad_share:.1%}",
            number_text(standing.cpu_time_s, 2),
        )
        for standing in found
    )
    return Table(title, header, rows)


def field_table(found: Sequence[Standing]) -> Table:
    """Return a table of the loss of each field in one scenario, over the run and at its end."""
    fields = list(dict.fromkeys(name for standing in found for name in standing.losses))
    rows = tuple(
        (
            standing.named,
            *(
                score_text(losses.get(name, math.nan))
                for name in fields
                for losses in (standing.losses_over_run, standing.losses)
            ),
        )
        for standing in found
    )
    header = ("planner, estimator", *(f"{name}, {when}" for name in fields for when in ("run", "end")))
    return Table("Mean loss per cell of each field", header, rows)


def interval_cells(of: Interval) -> tuple[str, str]:
    """Return two table cells: a mean, and its interval."""
    limits = "-" if math.isnan(of.low) else f"{score_text(of.low)} to {score_text(of.high)}"
    return score_text(of.mean), limits


def number_text(value: float, digits: int) -> str:
    """Return a number with `digits` digits after the point; nan becomes "-"."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def score_over_time(rows: Sequence[BenchRow]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return evenly spaced times (s), and the rows' scores at these times, float64[runs, times]."""
    last_s = max(row.times_s[-1] for row in rows)
    times_s = np.linspace(0.0, last_s, _POINTS)
    return times_s, np.array([scores_at(row, times_s) for row in rows])


def scores_at(row: BenchRow, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the latest score of a run at each time, or the first score before the first scored time."""
    at = np.searchsorted(row.times_s, times_s, side="right") - 1
    scores: NDArray[np.float64] = np.array(row.scores)[np.maximum(at, 0)]
    return scores


def draw_mean_score(
    axes: Axes,
    rows: Sequence[BenchRow],
    label: str,
    colour: str,
    *,
    alpha: float,
    linewidth: float | None = None,
) -> None:
    """Draw the mean score of rows over time, with a 95 % band for five or more rows."""
    times_s, scores = score_over_time(rows)
    means = scores.mean(axis=0)
    axes.plot(times_s, means, color=colour, label=label, linewidth=linewidth)
    if len(rows) >= _FEWEST_FOR_A_BAND:
        band = mean_intervals(scores.T)
        limits = [interval.low for interval in band], [interval.high for interval in band]
        axes.fill_between(times_s, *limits, color=colour, alpha=alpha, linewidth=0.0)
