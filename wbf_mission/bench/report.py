"""A report of a benchmark: a page of tables, and the score over time as pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from wbf_mission.bench.page import Page, Picture, Section, Table
from wbf_mission.bench.rows import BenchRow, by_pair
from wbf_mission.bench.standings import Interval, Standing, apart, standings, students_reach
from wbf_mission.pictures.plots import LINE_COLOURS, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

READING = (
    "Scores: 0 is perfect; the mean over the run and at its end, each with its interval of 95 % over the "
    "environments. Losses are means a cell at the end. Rank: the mean place among all rows on the same "
    "environment. Wins: on how many a row was the best, shared ones in parts."
)
SCORES = "Scores over the run and at its end"
_POINTS = 200
_MOST_LINES = 8
_FEWEST_FOR_A_BAND = 5


def standing_table(title: str, found: Sequence[Standing], *, whole: bool = False) -> Table:
    """Return the standings of one scenario; the `whole` table of several tells which and whose in columns."""
    fields = list(dict.fromkeys(name for one in found for name in one.losses))
    losses = (f"loss {name}" for name in fields)
    named = ("scenario", "planner or policy", "estimator") if whole else ("planner, estimator",)
    header = (*named, "run", "95 %", "end", "95 %", *losses, "rank", "wins", "runs", "CPU, s")
    rows = tuple(
        (
            *((one.scenario, one.planner, one.estimator) if whole else (f"{one.planner}, {one.estimator}",)),
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
    return Table(title, header, rows)


def _behind(found: Sequence[Standing]) -> Table:
    """Return by how much the others are behind the best of a scenario."""
    rows = tuple(
        (f"{one.planner}, {one.estimator}", *_interval(one.behind))
        for one in found
        if math.isfinite(one.behind.low)
    )
    return Table("Behind the best, in pairs of runs on the same environment", ("run", "mean", "95 %"), rows)


def _bad_answers(found: Sequence[Standing]) -> Table:
    """Return how many answers of a scenario's policies were not flown or came too late."""
    kinds = list(dict.fromkeys(kind for one in found for kind in one.bad_answers))
    rows = tuple(
        (
            f"{one.planner}, {one.estimator}",
            str(one.decisions),
            *(str(one.bad_answers.get(kind, 0)) for kind in kinds),
        )
        for one in found
        if one.bad_answers
    )
    return Table("Answers that were not flown, or came too late", ("policy, estimator", "all", *kinds), rows)


def score_over_time(rows: Sequence[BenchRow]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and float64[runs, times], the score of each run (with a history) as it stood then."""
    last_s = max(row.times_s[-1] for row in rows)
    times_s = np.linspace(0.0, last_s, _POINTS)
    return times_s, np.array([scores_at(row, times_s) for row in rows])


def scores_at(row: BenchRow, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the score of a run as it stood at some times; before its first scored time that of it."""
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
    """Draw the mean score of rows over time, of five and more with Student's intervals."""
    times_s, scores = score_over_time(rows)
    means = scores.mean(axis=0)
    axes.plot(times_s, means, color=colour, label=label, linewidth=linewidth)
    if len(rows) >= _FEWEST_FOR_A_BAND:
        reach = students_reach(scores)
        axes.fill_between(times_s, means - reach, means + reach, color=colour, alpha=alpha, linewidth=0.0)


def report_page(rows: Sequence[BenchRow], folder: Path, *, title: str) -> Page:
    """Return the report, with a picture for each scenario written into a folder, which is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = apart(rows)
    found = standings(rows)
    scenarios = list(dict.fromkeys(one.scenario for one in found))
    sections = [
        _section(
            scenario,
            [one for one in found if one.scenario == scenario],
            [row for row in rows if row.scenario == scenario and row.error is None],
            folder,
        )
        for scenario in scenarios
    ]
    failures = _failures(rows)
    if failures.rows:
        sections.append(Section("What failed", tables=(failures,)))
    return Page(title, READING, tuple(sections))


def _section(scenario: str, found: Sequence[Standing], good: Sequence[BenchRow], folder: Path) -> Section:
    """Return what the runs of one scenario tell, with their picture written."""
    told = [row for row in good if row.times_s]
    pictures = (Picture(_plot(scenario, found, told, folder).name, "Score over time"),) if told else ()
    tables = (
        standing_table(SCORES, found),
        _behind(found),
        _bad_answers(found),
        _flown(good),
        _costs(good),
    )
    return Section(scenario, pictures=pictures, tables=tuple(one for one in tables if one.rows))


def _plot(scenario: str, found: Sequence[Standing], rows: Sequence[BenchRow], folder: Path) -> Path:
    """Draw the mean score over time of the best rows, with Student's intervals."""
    figure = new_figure(8.0, 4.5)
    axes = figure.add_subplot()
    pairs = by_pair(rows)
    for one, colour in zip(found[:_MOST_LINES], LINE_COLOURS, strict=False):
        if own := pairs.get((one.planner, one.estimator)):
            draw_mean_score(axes, own, f"{one.planner}, {one.estimator}", colour, alpha=0.12)
    axes.set_xlabel("time, s")
    axes.set_ylabel("score, 0 is perfect")
    left_out = f" (the best {_MOST_LINES} of {len(found)})" if len(found) > _MOST_LINES else ""
    axes.set_title(
        f"{scenario}: mean score, with Student's interval of 95 %{left_out}", fontsize=10, loc="left"
    )
    axes.set_ylim(top=0.0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="lower right")
    figure.tight_layout()
    return save_figure(figure, folder / f"{scenario.replace('/', '-').removesuffix('.toml')}.png")


def _flown(good: Sequence[BenchRow]) -> Table:
    """Return how long plans of one scenario took that nobody changed on the way."""
    table = []
    for planner in sorted({row.planner for row in good}):
        pairs = [
            (row.flight_time_s, row.predicted_time_s, row.path_length_m)
            for row in good
            if row.planner == planner and row.flight_time_s and row.predicted_time_s and row.decisions == 1
        ]
        if pairs:
            ratios = np.array([flown / predicted - 1.0 for flown, predicted, _ in pairs])
            length_m = float(np.mean([length for _, _, length in pairs if length is not None]))
            table.append(
                (
                    planner,
                    f"{np.mean([flown for flown, _, _ in pairs]):.1f}",
                    f"{np.mean([predicted for _, predicted, _ in pairs]):.1f}",
                    f"{ratios.mean():+.2%}",
                    f"{np.abs(ratios).max():.2%}",
                    f"{length_m:.1f}",
                )
            )
    header = ("planner", "flown, s", "predicted, s", "mean error", "largest error", "path, m")
    return Table("Planned and flown", header, tuple(table))


def _costs(good: Sequence[BenchRow]) -> Table:
    """Return what runs of one scenario took in the mean, by their parts, the cheapest first."""
    stages = list(dict.fromkeys(name for row in good for name in row.timings_s))
    means = []
    for pair, own in by_pair(good).items():
        parts = ([row.timings_s.get(name, 0.0) for row in own] for name in stages)
        columns = ([row.wall_time_s for row in own], [row.cpu_time_s for row in own], *parts)
        means.append((", ".join(pair), [float(np.mean(one)) for one in columns]))
    lines = (
        (name, *(f"{one:.3f}" for one in cells)) for name, cells in sorted(means, key=lambda one: one[1][1])
    )
    header = ("planner, estimator", "wall", "CPU", *stages)
    return Table("What a run takes, s, and its parts, s of wall time", header, tuple(lines))


def _failures(rows: Sequence[BenchRow]) -> Table:
    table = [
        (f"{row.scenario}, {row.planner}, {row.estimator}, seed {row.seed}", row.error)
        for row in rows
        if row.error is not None
    ]
    return Table("Runs that failed", ("run", "cause"), tuple(table))


def _interval(one: Interval) -> tuple[str, str]:
    return _number(one.mean, 4), "-" if math.isnan(one.low) else f"{one.low:.4f} to {one.high:.4f}"


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"
