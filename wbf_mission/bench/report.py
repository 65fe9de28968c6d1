"""A report of a benchmark: a page of tables, and the score over time as pictures."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from wbf_mission.bench.cards import known_cards
from wbf_mission.bench.environments import Scored, scored
from wbf_mission.bench.intervals import Interval, doubt_in_words, mean_intervals, score_text
from wbf_mission.bench.page import Listing, Page, Picture, Section, Table
from wbf_mission.bench.requests import AskedFor
from wbf_mission.bench.rows import BenchRow, by_pair
from wbf_mission.bench.standings import Ratio, Standing, by_fixed, standings_of
from wbf_mission.bench.versions import apart, machines, what_was_run
from wbf_mission.pictures.plots import LINE_COLOURS, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

READING = (
    "Scores: 0 is perfect; the mean over the run and at its end, each with its interval of 95 % over the "
    "environments. The intervals of a table of differences hold together, all at once in 95 of 100 cases; so "
    "do those of ratios with one estimator. Only environments count of which all have a row; a run that "
    "failed counts as the worst score and the worst losses that any row has on its environment. Losses are "
    "means a cell. Rank: the mean place among all rows on the same environment. Wins: on how many a row was "
    "the best, shared ones in parts. Bad answers: the share of a policy's answers that were not flown, or "
    "came too late. How sure, how right: of the last estimate, on relevant cells that nobody looked at. Sick "
    "held is the part of the sick plants among those that may be sick, meant to be 90 %; healthy held, that "
    "of the healthy ones."
)
SCORES = "Scores over the run and at its end"
_POINTS = 200
_MOST_LINES = 8
_FEWEST_FOR_A_BAND = 5


def standing_table(title: str, found: Sequence[Standing], *, whole: bool = False) -> Table:
    """Return the standings of one scenario; the `whole` table of several tells which and whose in columns."""
    named = ("scenario", "planner or policy", "estimator") if whole else ("planner, estimator",)
    header = (*named, "run", "95 %", "end", "95 %", "rank", "wins", "runs", "bad answers", "CPU, s")
    rows = tuple(
        (
            *((one.scenario, one.planner, one.estimator) if whole else (_name(one),)),
            *_interval(one.score),
            *_interval(one.final_score),
            _number(one.rank, 1),
            f"{one.wins:.3g}",
            f"{one.environments}" + (f", {one.failed} failed" if one.failed else ""),
            "-" if math.isnan(one.bad_share) else f"{one.bad_share:.1%}",
            _number(one.cpu_time_s, 2),
        )
        for one in found
    )
    return Table(title, header, rows)


def field_table(found: Sequence[Standing]) -> Table:
    """Return the loss of each field in one scenario, over the run and at its end."""
    fields = list(dict.fromkeys(name for one in found for name in one.losses))
    rows = tuple(
        (
            _name(one),
            *(
                score_text(losses.get(name, math.nan))
                for name in fields
                for losses in (one.losses_over_run, one.losses)
            ),
        )
        for one in found
    )
    header = ("planner, estimator", *(f"{name}, {when}" for name in fields for when in ("run", "end")))
    return Table("Loss of each field, the mean a cell", header, rows)


def _name(one: Standing | Ratio) -> str:
    return f"{one.planner}, {one.estimator}"


def _by_fixed(ratios: Sequence[Ratio], when: str) -> Table:
    """Return losses divided by those of the best fixed planner, which stands in a line of its own."""
    names = list(ratios[0].ratios) if ratios else []
    lines: list[tuple[str, ...]] = []
    estimators: set[str] = set()
    for one in ratios:
        if one.estimator not in estimators:
            estimators.add(one.estimator)
            lines.append((f"the best fixed planner, {one.estimator}", *(one.best[name] for name in names)))
        lines.append((_name(one), *(_ratio(one.ratios[name]) for name in names)))
    title = f"Losses divided by those of the best fixed planner of each column, {when} (below 1 is better)"
    return Table(title, ("planner, estimator", *names), tuple(lines))


def _ratio(one: Interval) -> str:
    interval = "" if math.isnan(one.low) or one.low == one.high else f" ({one.low:.2f} to {one.high:.2f})"
    interval = interval.replace(" to inf", " or more")
    return _number(one.mean, 2) + interval


def worse_in_words(ratios: Sequence[Ratio], when: str) -> str:
    """Return which losses are larger with policies than with the best fixed planner, if that can be told."""
    worse: dict[str, list[str]] = {}
    for one in ratios:
        for name, ratio in one.ratios.items():
            if ratio.low > 1.0 and not one.fixed:
                told = f"{_name(one)} ({ratio.mean:.2f} times {one.best[name]})"
                worse.setdefault(name, []).append(told)
    told = "; ".join(f"{name} with {' and '.join(whose)}" for name, whose in worse.items())
    return f"Losses {when} that are larger than those of the best fixed planner: {told}." if worse else ""


def _behind(found: Sequence[Standing]) -> Table:
    """Return by how much the others are behind the best of a scenario."""
    rows = tuple((_name(one), *_interval(one.behind)) for one in found if math.isfinite(one.behind.low))
    return Table("Behind the best, in pairs of runs on the same environment", ("run", "mean", "95 %"), rows)


def _bad_answers(found: Sequence[Standing]) -> Table:
    """Return how many answers of a scenario's policies were not flown or came too late."""
    kinds = list(dict.fromkeys(kind for one in found for kind in one.bad_answers))
    rows = tuple(
        (_name(one), str(one.decisions), *(str(one.bad_answers.get(kind, 0)) for kind in kinds))
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
    """Draw the mean score of rows over time, of five and more with intervals of 95 %."""
    times_s, scores = score_over_time(rows)
    means = scores.mean(axis=0)
    axes.plot(times_s, means, color=colour, label=label, linewidth=linewidth)
    if len(rows) >= _FEWEST_FOR_A_BAND:
        band = mean_intervals(scores.T)
        limits = [one.low for one in band], [one.high for one in band]
        axes.fill_between(times_s, *limits, color=colour, alpha=alpha, linewidth=0.0)


def report_page(rows: Sequence[BenchRow], folder: Path, *, title: str, asked: AskedFor | None = None) -> Page:
    """Return the report, with a picture for each scenario written into a folder, which is made if need be.

    With what the rows were `asked` for, it holds the commands and specifications to repeat it from.
    """
    folder.mkdir(parents=True, exist_ok=True)
    told = apart(rows)
    sections = [_section(one, folder) for one in scored(told)]
    sections += [
        *_repeat(asked or AskedFor(), rows),
        Section("What flew", tables=(what_was_run(rows), machines(rows))),
    ]
    failures = _failures(told)
    if failures.rows:
        sections.append(Section("What failed", tables=(failures,)))
    return Page(title, READING, tuple(sections))


def _section(group: Scored, folder: Path) -> Section:
    """Return what the runs of one scenario tell, with their picture written."""
    found = standings_of(group)
    good = [row for own in group.rows for row in own if row.error is None]
    drawn = [row for row in good if row.times_s]
    pictures = (_plot(group.scenario, found, drawn, folder),) if drawn else ()
    over_run, at_end = by_fixed(group, over_run=True), by_fixed(group, over_run=False)
    text = [
        group.environments_in_words(),
        doubt_in_words(len(group.seeds)),
        worse_in_words(over_run, "over the run"),
        worse_in_words(at_end, "at its end"),
    ]
    tables = (
        standing_table(SCORES, found),
        field_table(found),
        _by_fixed(over_run, "over the run"),
        _by_fixed(at_end, "at its end"),
        _behind(found),
        _bad_answers(found),
        _calibration(good),
        _flown(good),
        _costs(good),
    )
    shown = tuple(one for one in tables if one.rows)
    return Section(group.scenario, " ".join(filter(None, text)), pictures, shown)


def _repeat(asked: AskedFor, rows: Sequence[BenchRow]) -> Iterator[Section]:
    """Return what was asked for, and the cards of the scenarios, as far as they are known."""
    if asked.asked:
        listings = []
        for one in asked.asked:
            listings.append(Listing(f"Asked for at {one.when}", one.command or "(from Python)", "text"))
            listings.append(Listing("As a file for bench run", one.specification, "toml"))
        yield Section("To repeat it", listings=tuple(listings))
    cards = [
        *asked.cards,
        *known_cards({row.scenario for row in rows} - {one.scenario for one in asked.cards}),
    ]
    if cards:
        yield Section("What the names mean", tables=tuple(one.table() for one in cards))


def _plot(scenario: str, found: Sequence[Standing], rows: Sequence[BenchRow], folder: Path) -> Picture:
    """Draw the mean score over time of the best rows, with intervals of 95 %."""
    figure = new_figure(8.0, 4.5)
    axes = figure.add_subplot()
    pairs = by_pair(rows)
    for one, colour in zip(found[:_MOST_LINES], LINE_COLOURS, strict=False):
        if own := pairs.get((one.planner, one.estimator)):
            draw_mean_score(axes, own, f"{one.planner}, {one.estimator}", colour, alpha=0.12)
    axes.set_xlabel("time, s")
    axes.set_ylabel("score, 0 is perfect")
    left_out = f" (the best {_MOST_LINES} of {len(found)})" if len(found) > _MOST_LINES else ""
    axes.set_title(f"{scenario}: mean score, with its interval of 95 %{left_out}", fontsize=10, loc="left")
    axes.set_ylim(top=0.0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="lower right")
    figure.tight_layout()
    name = re.sub(r"[^\w.+]+", "-", scenario.removesuffix(".toml")).strip("-")
    file = save_figure(figure, folder / f"{name}.png")
    return Picture(file.name, "Score over time")


_SURE = {
    "brier": "Brier",
    "log_loss": "log loss",
    "ece": "calibration error",
    "sick_held": "sick held",
    "healthy_held": "healthy held",
    "held": "in 90 %",
    "error": "error by variance",
}


def _calibration(good: Sequence[BenchRow]) -> Table:
    """Return how right a scenario's last estimates were in how sure they were."""
    fields = list(dict.fromkeys(name for row in good for name in row.losses))
    lines = []
    for pair, own in by_pair(good).items():
        for field in fields:
            each = ([row.calibration.get(f"{field}_{key}", math.nan) for row in own] for key in _SURE)
            means = mean_intervals(map(np.array, each))
            if any(math.isfinite(one.mean) for one in means):
                told = (f"{mean} ({limits})" for mean, limits in map(_interval, means))
                lines.append((", ".join(pair), field, *(one.replace(" (-)", "") for one in told)))
    header = ("planner, estimator", "field", *_SURE.values())
    return Table("How sure, how right", header, tuple(lines), texts=2)


def _flown(good: Sequence[BenchRow]) -> Table:
    """Return how long flights of one scenario took, and what of their budget, against the prediction."""
    table = []
    for planner in sorted({row.planner for row in good}):
        own = [row for row in good if row.planner == planner and row.flight_time_s and _is_predicted(row)]
        if not own:
            continue
        pairs = [(row.flight_time_s, row.predicted_time_s) for row in own]
        errors = np.array([flown / told - 1.0 for flown, told in pairs if flown and told])
        table.append(
            (
                planner,
                ", ".join(sorted({row.budget or "-" for row in own})),
                _mean(row.flight_time_s for row in own),
                _mean(row.predicted_time_s for row in own),
                f"{errors.mean():+.2%}" if len(errors) else "-",
                f"{np.abs(errors).max():.2%}" if len(errors) else "-",
                _mean(row.path_length_m for row in own),
                _mean((row.battery_used for row in own), "{:.1%}"),
            )
        )
    of_time = ("flown, s", "predicted, s", "mean error", "largest error")
    header = ("planner or policy", "budget of a flight", *of_time, "path, m", "battery")
    return Table("Planned and flown", header, tuple(table))


def _is_predicted(row: BenchRow) -> bool:
    """Return whether a row is held to its prediction; old rows of policies have that of their first path."""
    return row.decisions == 1 or row.budget is not None


def _mean(values: Iterable[float | None], form: str = "{:.1f}") -> str:
    known = [one for one in values if one is not None]
    return form.format(np.mean(known)) if known else "-"


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
    table = [(row.named, row.error) for row in rows if row.error is not None]
    return Table("Runs that failed", ("run", "cause"), tuple(table))


def _interval(one: Interval) -> tuple[str, str]:
    limits = "-" if math.isnan(one.low) else f"{score_text(one.low)} to {score_text(one.high)}"
    return score_text(one.mean), limits


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"
