"""Report of a benchmark: a page of tables, with the score over time as pictures."""

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
    "Scores: 0 is perfect; the mean over the run and the score at its end, each with its 95 % interval over"
    " the environments. The intervals of a table of differences are simultaneous: all hold at once in 95 of"
    " 100 cases. So are those of ratios with one estimator. An environment counts only if every planner and"
    " estimator has a row on it. A failed run counts as the worst score and the worst losses of any row on "
    "its environment. Losses are means per cell. Rank: the mean rank among all rows on the same "
    "environment. Wins: the number of environments on which a row was the best; ties are shared. Bad "
    "answers: the share of a policy's answers that were not flown or came too late. How sure, how right: of"
    " the last estimate, on relevant cells that were not observed. Plants that may be sick are those in the"
    " estimate's 90 % set: sick held is the share of the sick plants in this set, ideally 90 %; healthy "
    "held, of the healthy plants."
)
SCORES = "Scores over the run and at its end"
_POINTS = 200
_MOST_LINES = 8
_FEWEST_FOR_A_BAND = 5


def standing_table(title: str, found: Sequence[Standing], *, whole: bool = False) -> Table:
    """Return a table of standings; `whole` tables of several scenarios have a column for the scenario."""
    named = ("scenario", "planner or policy", "estimator") if whole else ("planner, estimator",)
    header = (*named, "run", "95 %", "end", "95 %", "rank", "wins", "runs", "bad answers", "CPU, s")
    rows = tuple(
        (
            *((standing.scenario, standing.planner, standing.estimator) if whole else (_name(standing),)),
            *_interval(standing.score),
            *_interval(standing.final_score),
            _number(standing.rank, 1),
            f"{standing.wins:.3g}",
            f"{standing.environments}" + (f", {standing.failed} failed" if standing.failed else ""),
            "-" if math.isnan(standing.bad_share) else f"{standing.bad_share:.1%}",
            _number(standing.cpu_time_s, 2),
        )
        for standing in found
    )
    return Table(title, header, rows)


def field_table(found: Sequence[Standing]) -> Table:
    """Return a table of the loss of each field in one scenario, over the run and at its end."""
    fields = list(dict.fromkeys(name for standing in found for name in standing.losses))
    rows = tuple(
        (
            _name(standing),
            *(
                score_text(losses.get(name, math.nan))
                for name in fields
                for losses in (standing.losses_over_run, standing.losses)
            ),
        )
        for standing in found
    )
    header = ("planner, estimator", *(f"{name}, {when}" for name in fields for when in ("run", "end")))
    return Table("Loss of each field, the mean a cell", header, rows)


def _name(of: Standing | Ratio) -> str:
    return f"{of.planner}, {of.estimator}"


def _by_fixed(ratios: Sequence[Ratio], when: str) -> Table:
    """Return a table of losses divided by those of the best fixed planner, named in a separate line."""
    names = list(ratios[0].ratios) if ratios else []
    lines: list[tuple[str, ...]] = []
    estimators: set[str] = set()
    for ratio in ratios:
        if ratio.estimator not in estimators:
            estimators.add(ratio.estimator)
            best = (ratio.best[name] for name in names)
            lines.append((f"the best fixed planner, {ratio.estimator}", *best))
        lines.append((_name(ratio), *(_ratio(ratio.ratios[name]) for name in names)))
    title = f"Losses divided by those of the best fixed planner of each column, {when} (below 1 is better)"
    return Table(title, ("planner, estimator", *names), tuple(lines))


def _ratio(ratio: Interval) -> str:
    low, high = ratio.low, ratio.high
    interval = "" if math.isnan(low) or low == high else f" ({low:.2f} to {high:.2f})"
    return _number(ratio.mean, 2) + interval.replace(" to inf", " or more")


def worse_in_words(ratios: Sequence[Ratio], when: str) -> str:
    """Return the losses of policies that exceed the best fixed planner's significantly, in words."""
    worse: dict[str, list[str]] = {}
    for policy in ratios:
        for name, ratio in policy.ratios.items():
            if ratio.low > 1.0 and not policy.fixed:
                text = f"{_name(policy)} ({ratio.mean:.2f} times {policy.best[name]})"
                worse.setdefault(name, []).append(text)
    listed = "; ".join(f"{name} with {' and '.join(policies)}" for name, policies in worse.items())
    return f"Losses {when} that are larger than those of the best fixed planner: {listed}." if worse else ""


def _behind(found: Sequence[Standing]) -> Table:
    """Return a table of the differences from the best score of a scenario."""
    known = (standing for standing in found if math.isfinite(standing.behind.low))
    rows = tuple((_name(standing), *_interval(standing.behind)) for standing in known)
    return Table("Behind the best, in pairs of runs on the same environment", ("run", "mean", "95 %"), rows)


def _bad_answers(found: Sequence[Standing]) -> Table:
    """Return a table of the policies' answers that were not flown or came too late."""
    kinds = list(dict.fromkeys(kind for standing in found for kind in standing.bad_answers))
    rows = tuple(
        (_name(policy), str(policy.decisions), *(str(policy.bad_answers.get(kind, 0)) for kind in kinds))
        for policy in found
        if policy.bad_answers
    )
    return Table("Answers that were not flown, or came too late", ("policy, estimator", "all", *kinds), rows)


def score_over_time(rows: Sequence[BenchRow]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times (s) and the scores of rows with a history at these times, float64[runs, times]."""
    last_s = max(row.times_s[-1] for row in rows)
    times_s = np.linspace(0.0, last_s, _POINTS)
    return times_s, np.array([scores_at(row, times_s) for row in rows])


def scores_at(row: BenchRow, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the last score of a run at each time; before the first scored time, the first score."""
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


def report_page(rows: Sequence[BenchRow], folder: Path, *, title: str, asked: AskedFor | None = None) -> Page:
    """Write a picture of each scenario into `folder`, which is created, and return the report.

    With the requests in `asked`, the report lists the commands and specifications to repeat the benchmark.
    """
    folder.mkdir(parents=True, exist_ok=True)
    separated = apart(rows)
    sections = [_section(group, folder) for group in scored(separated)]
    sections += [
        *_repeat(asked or AskedFor(), rows),
        Section("What flew", tables=(what_was_run(rows), machines(rows))),
    ]
    failures = _failures(separated)
    if failures.rows:
        sections.append(Section("What failed", tables=(failures,)))
    return Page(title, READING, tuple(sections))


def _section(group: Scored, folder: Path) -> Section:
    """Return the section of one scenario, and write its picture."""
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
    shown = tuple(table for table in tables if table.rows)
    return Section(group.scenario, " ".join(filter(None, text)), pictures, shown)


def _repeat(asked: AskedFor, rows: Sequence[BenchRow]) -> Iterator[Section]:
    """Yield the sections of the requests and of the scenario cards, if known."""
    if asked.asked:
        listings = []
        for request in asked.asked:
            command = request.command or "(from Python)"
            listings.append(Listing(f"Asked for at {request.when}", command, "text"))
            listings.append(Listing("As a file for bench run", request.specification, "toml"))
        yield Section("To repeat it", listings=tuple(listings))
    cards = [
        *asked.cards,
        *known_cards({row.scenario for row in rows} - {card.scenario for card in asked.cards}),
    ]
    if cards:
        yield Section("What the names mean", tables=tuple(card.table() for card in cards))


def _plot(scenario: str, found: Sequence[Standing], rows: Sequence[BenchRow], folder: Path) -> Picture:
    """Draw the mean score over time of the best pairs, with 95 % bands."""
    figure = new_figure(8.0, 4.5)
    axes = figure.add_subplot()
    pairs = by_pair(rows)
    for standing, colour in zip(found[:_MOST_LINES], LINE_COLOURS, strict=False):
        if own := pairs.get((standing.planner, standing.estimator)):
            draw_mean_score(axes, own, _name(standing), colour, alpha=0.12)
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
    """Return a table of the calibration of a scenario's last estimates."""
    fields = list(dict.fromkeys(name for row in good for name in row.losses))
    lines = []
    for pair, own in by_pair(good).items():
        for field in fields:
            values = ([row.calibration.get(f"{field}_{key}", math.nan) for row in own] for key in _SURE)
            means = mean_intervals(map(np.array, values))
            if any(math.isfinite(interval.mean) for interval in means):
                texts = (f"{mean} ({limits})" for mean, limits in map(_interval, means))
                lines.append((", ".join(pair), field, *(text.replace(" (-)", "") for text in texts)))
    header = ("planner, estimator", "field", *_SURE.values())
    return Table("How sure, how right", header, tuple(lines), texts=2)


def _flown(good: Sequence[BenchRow]) -> Table:
    """Return a table of a scenario's flights against their predictions: time, length and battery."""
    table = []
    for planner in sorted({row.planner for row in good}):
        own = [row for row in good if row.planner == planner and row.flight_time_s and _is_predicted(row)]
        if not own:
            continue
        pairs = [(row.flight_time_s, row.predicted_time_s) for row in own]
        errors = np.array([flown / predicted - 1.0 for flown, predicted in pairs if flown and predicted])
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
    """Return whether a row predicts the whole flight; old rows of policies predict only the first path."""
    return row.decisions == 1 or row.budget is not None


def _mean(values: Iterable[float | None], form: str = "{:.1f}") -> str:
    known = [value for value in values if value is not None]
    return form.format(np.mean(known)) if known else "-"


def _costs(good: Sequence[BenchRow]) -> Table:
    """Return a table of the mean times of a scenario's runs, by part, the cheapest first."""
    stages = list(dict.fromkeys(name for row in good for name in row.timings_s))
    means = []
    for pair, own in by_pair(good).items():
        parts = ([row.timings_s.get(name, 0.0) for row in own] for name in stages)
        columns = ([row.wall_time_s for row in own], [row.cpu_time_s for row in own], *parts)
        means.append((", ".join(pair), [float(np.mean(column)) for column in columns]))
    means.sort(key=lambda line: line[1][1])
    lines = ((name, *(f"{cell:.3f}" for cell in cells)) for name, cells in means)
    header = ("planner, estimator", "wall", "CPU", *stages)
    return Table("What a run takes, s, and its parts, s of wall time", header, tuple(lines))


def _failures(rows: Sequence[BenchRow]) -> Table:
    table = [(row.named, row.error) for row in rows if row.error is not None]
    return Table("Runs that failed", ("run", "cause"), tuple(table))


def _interval(of: Interval) -> tuple[str, str]:
    limits = "-" if math.isnan(of.low) else f"{score_text(of.low)} to {score_text(of.high)}"
    return score_text(of.mean), limits


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"
