"""Report of a benchmark: a page of tables, with the score over time as pictures."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geo.texts import file_stem
from wbf_mission.addons.base.intervals import Interval, mean_intervals, ratio_intervals
from wbf_mission.addons.base.pages import Listing, Page, Picture, Section, Table
from wbf_mission.addons.base.plots import LINE_COLOURS, new_figure, save_figure
from wbf_mission.addons.base.standings import (
    SCORES,
    Scored,
    Standing,
    apart,
    draw_mean_score,
    field_table,
    interval_cells,
    number_text,
    scored,
    standing_table,
    standings_of,
)
from wbf_mission.addons.boards.comparison import doubt_in_words
from wbf_mission.bench.requests import AskedFor, card_of
from wbf_mission.bench.rows import BenchRow, by_pair, commit_of, digest_of
from wbf_mission.scenario import load_scenario, scenario_ids

READING = (
    "Scores: 0 is perfect; a table has the mean over the run and the score at its end, each with a 95 %"
    " interval over the environments. The intervals of a table of differences are simultaneous: all hold"
    " together in 95 of 100 cases. So are the intervals of ratios with one estimator. An environment counts"
    " only if every planner and estimator has a row on it. A failed run counts as the worst score and the"
    " worst losses of any row on its environment. Losses are means per cell. Rank: the mean rank among all"
    " rows on the same environment. Wins: the number of environments on which a row was the best; ties are"
    " shared. Bad answers: the fraction of a policy's answers that were not flown or came too late. The table"
    " 'How sure, how right' is about the last estimate, on relevant cells that were not observed. The"
    " estimate's 90 % set has the plants that may be sick. Sick held is the fraction of the sick plants that"
    " are in this set, ideally 90 %; healthy held is the same fraction for the healthy plants."
)
_MOST_LINES = 8


def _behind(found: Sequence[Standing]) -> Table:
    """Return a table of the differences from the best score of a scenario."""
    known = (standing for standing in found if math.isfinite(standing.behind.low))
    rows = tuple((standing.named, *interval_cells(standing.behind)) for standing in known)
    return Table("Difference from the best score on the same environment", ("run", "mean", "95 %"), rows)


def _bad_answers(found: Sequence[Standing]) -> Table:
    """Return a table of the policies' answers that were not flown or came too late."""
    kinds = list(dict.fromkeys(kind for standing in found for kind in standing.bad_answers))
    rows = tuple(
        (policy.named, str(policy.decisions), *(str(policy.bad_answers.get(kind, 0)) for kind in kinds))
        for policy in found
        if policy.bad_answers
    )
    return Table("Answers that were not flown, or came too late", ("policy, estimator", "all", *kinds), rows)


def report_page(rows: Sequence[BenchRow], folder: Path, *, title: str, asked: AskedFor | None = None) -> Page:
    """Create `folder`, write a picture of each scenario into it, and return the report.

    If `asked` has the requests, the report lists the commands and specifications to repeat the benchmark.
    """
    folder.mkdir(parents=True, exist_ok=True)
    separated = apart(rows)
    sections = [_section(group, folder) for group in scored(separated)]
    sections += [
        *_repeat(asked or AskedFor(), rows),
        Section("What flew", tables=(_what_was_run(rows), _machines(rows))),
    ]
    failures = tuple((row.named, row.error) for row in separated if row.error is not None)
    if failures:
        sections.append(
            Section("What failed", tables=(Table("Runs that failed", ("run", "cause"), failures),))
        )
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
        ratio_table(over_run, "over the run"),
        ratio_table(at_end, "at its end"),
        _behind(found),
        _bad_answers(found),
        _calibration(good),
        _flown(good),
        _costs(good),
    )
    shown = tuple(table for table in tables if table.rows)
    return Section(group.scenario, " ".join(filter(None, text)), pictures, shown)


def _repeat(asked: AskedFor, rows: Sequence[BenchRow]) -> Iterator[Section]:
    """Yield a section of the requests and a section of the scenario cards, if these are known."""
    if asked.asked:
        listings = []
        for request in asked.asked:
            command = request.command or "(from Python)"
            listings.append(Listing(f"Requested at {request.when}", command, "text"))
            listings.append(Listing("The request as a file for bench run", request.specification, "toml"))
        yield Section("To repeat the benchmark", listings=tuple(listings))
    others = {row.scenario for row in rows} - {card.scenario for card in asked.cards}
    known = sorted(others.intersection(scenario_ids()))
    cards = [*asked.cards, *(card_of(name, load_scenario(name)) for name in known)]
    if cards:
        tables = [Table(card.scenario, ("what", "value"), tuple(card.entries().items())) for card in cards]
        yield Section("What the names mean", tables=tuple(tables))


def _plot(scenario: str, found: Sequence[Standing], rows: Sequence[BenchRow], folder: Path) -> Picture:
    """Draw the mean score over time, with 95 % bands, for the best pairs of planner and estimator."""
    figure = new_figure(8.0, 4.5)
    axes = figure.add_subplot()
    pairs = by_pair(rows)
    for standing, colour in zip(found[:_MOST_LINES], LINE_COLOURS, strict=False):
        if own := pairs.get((standing.planner, standing.estimator)):
            draw_mean_score(axes, own, standing.named, colour, alpha=0.12)
    axes.set_xlabel("time, s")
    axes.set_ylabel("score, 0 is perfect")
    left_out = f" (the best {_MOST_LINES} of {len(found)})" if len(found) > _MOST_LINES else ""
    axes.set_title(f"{scenario}: mean score with its 95 % interval{left_out}", fontsize=10, loc="left")
    axes.set_ylim(top=0.0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="lower right")
    figure.tight_layout()
    name = file_stem(scenario.removesuffix(".toml"), "scenario", r"\w.+")
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
                texts = (f"{mean} ({limits})" for mean, limits in map(interval_cells, means))
                lines.append((", ".join(pair), field, *(text.replace(" (-)", "") for text in texts)))
    header = ("planner, estimator", "field", *_SURE.values())
    return Table("How sure, how right", header, tuple(lines), texts=2)


def _flown(good: Sequence[BenchRow]) -> Table:
    """Return a table that compares a scenario's flights with their predictions: time, length and battery."""
    table = []
    for planner in sorted({row.planner for row in good}):
        own = [row for row in good if row.planner == planner and row.flight_time_s]
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


def _mean(values: Iterable[float | None], form: str = "{:.1f}") -> str:
    known = [value for value in values if value is not None]
    return form.format(np.mean(known)) if known else "-"


def _costs(good: Sequence[BenchRow]) -> Table:
    """Return a table of a scenario's mean computing times, total and by part, least CPU time first."""
    stages = list(dict.fromkeys(name for row in good for name in row.timings_s))
    means = []
    for pair, own in by_pair(good).items():
        parts = ([row.timings_s.get(name, 0.0) for row in own] for name in stages)
        columns = ([row.wall_time_s for row in own], [row.cpu_time_s for row in own], *parts)
        means.append((", ".join(pair), [float(np.mean(column)) for column in columns]))
    means.sort(key=lambda line: line[1][1])
    lines = ((name, *(f"{cell:.3f}" for cell in cells)) for name, cells in means)
    header = ("planner, estimator", "wall", "CPU", *stages)
    return Table("Computing time of a run, and wall time of its parts, s", header, tuple(lines))


def _what_was_run(rows: Sequence[BenchRow]) -> Table:
    """Return a table of the distinct versions, commits, digests and object parameters in the rows."""
    count: Counter[tuple[str, ...]] = Counter()
    for row in rows:
        python = ", ".join(f"{key} {row.versions[key]}" for key in ("python", "numpy") if key in row.versions)
        version = row.versions.get("wbf-mission", "-")
        count["wbf-mission", version, commit_of(row) or "-", digest_of(row, "code"), python] += 1
        count[f"scenario {row.scenario}", "-", "-", digest_of(row, "scenario"), ""] += 1
        for key in ("planner", "estimator"):
            if key in row.codes or key in row.objects:
                digest, words = row.codes.get(key, "-")[:12], row.objects.get(key, "")
                count[f"{key} {getattr(row, key)}", "-", "-", digest, words] += 1
    ordered = sorted(count.items(), key=lambda counted: (counted[0][0] != "wbf-mission", counted[0]))
    lines = tuple((*line, str(number)) for line, number in ordered)
    return Table("What was run", ("what", "version", "commit", "digest", "with", "rows"), lines)


def _machines(rows: Sequence[BenchRow]) -> Table:
    """Return a table of the machines that computed the rows, with their total computing times."""
    found: dict[tuple[str, ...], list[BenchRow]] = {}
    for row in rows:
        machine = (row.hardware.get(key, "-") for key in ("processor", "cores", "memory_gb", "system"))
        found.setdefault(tuple(machine), []).append(row)
    lines = tuple(
        (
            *machine,
            str(len(own)),
            f"{sum(row.wall_time_s for row in own):.1f}",
            f"{sum(row.cpu_time_s for row in own):.1f}",
        )
        for machine, own in sorted(found.items())
    )
    header = ("processor", "cores", "memory, GB", "system", "rows", "wall time, s", "CPU time, s")
    return Table("Machines, and total time of all runs", header, lines)


WHOLE = "whole"
"""Key of the total score, beside the names of fields."""


@dataclass(frozen=True, slots=True)
class Ratio:
    """Losses of a planner or policy, divided by the losses of the best fixed planner with its estimator."""

    planner: str
    estimator: str
    fixed: bool
    """Whether `planner` is fixed: it decides only once, before the flight."""
    ratios: dict[str, Interval]
    """Ratio for `WHOLE` and each field; below 1 is better. Intervals with one estimator are simultaneous."""
    best: dict[str, str]
    """Best fixed planner, whose loss is the divisor, for `WHOLE` and for each field."""

    @property
    def named(self) -> str:
        """Names of the planner and the estimator."""
        return f"{self.planner}, {self.estimator}"


def by_fixed(group: Scored, *, over_run: bool) -> list[Ratio]:
    """Return each planner's losses divided by those of the best fixed planner, lowest ratio first.

    Each field has its own best fixed planner. Estimators without a fixed planner are skipped.
    """
    scores, losses = (group.scores, group.losses) if over_run else (group.final_scores, group.final_losses)
    tables = {WHOLE: -scores, **losses}
    found = []
    for estimator in sorted({estimator for _, estimator in group.pairs}):
        places = [k for k, pair in enumerate(group.pairs) if pair[1] == estimator]
        fixed = [k for k in places if _is_fixed(group.rows[k])]
        if not fixed:
            continue
        means = {name: [table[k].mean() for k in fixed] for name, table in tables.items()}
        best = {name: fixed[np.argmin(np.nan_to_num(mean, nan=np.inf))] for name, mean in means.items()}
        pairs = [(table[k], table[best[name]]) for k in places for name, table in tables.items()]
        ratios = iter(ratio_intervals(pairs, together=True))
        found += [
            Ratio(
                planner=group.pairs[k][0],
                estimator=estimator,
                fixed=k in fixed,
                ratios={name: next(ratios) for name in tables},
                best={name: group.pairs[which][0] for name, which in best.items()},
            )
            for k in places
        ]
    return sorted(found, key=lambda ratio: (ratio.estimator, ratio.ratios[WHOLE].mean))


def _is_fixed(rows: Sequence[BenchRow]) -> bool:
    good = [row.decisions for row in rows if row.error is None]
    return bool(good) and set(good) == {1}


def ratio_table(ratios: Sequence[Ratio], when: str) -> Table:
    """Return a table of loss ratios; for each estimator, an extra line names the best fixed planners."""
    names = list(ratios[0].ratios) if ratios else []
    lines: list[tuple[str, ...]] = []
    estimators: set[str] = set()
    for ratio in ratios:
        if ratio.estimator not in estimators:
            estimators.add(ratio.estimator)
            best = (ratio.best[name] for name in names)
            lines.append((f"the best fixed planner, {ratio.estimator}", *best))
        lines.append((ratio.named, *(_ratio(ratio.ratios[name]) for name in names)))
    title = f"Losses divided by those of the best fixed planner of each column, {when} (below 1 is better)"
    return Table(title, ("planner, estimator", *names), tuple(lines))


def _ratio(ratio: Interval) -> str:
    low, high = ratio.low, ratio.high
    interval = "" if math.isnan(low) or low == high else f" ({low:.2f} to {high:.2f})"
    return number_text(ratio.mean, 2) + interval.replace(" to inf", " or more")


def worse_in_words(ratios: Sequence[Ratio], when: str) -> str:
    """Return a sentence that lists policies with significantly larger losses than the best fixed planner."""
    worse: dict[str, list[str]] = {}
    for policy in ratios:
        for name, ratio in policy.ratios.items():
            if ratio.low > 1.0 and not policy.fixed:
                text = f"{policy.named} ({ratio.mean:.2f} times {policy.best[name]})"
                worse.setdefault(name, []).append(text)
    listed = "; ".join(f"{name} with {' and '.join(policies)}" for name, policies in worse.items())
    return f"Losses {when} that are larger than those of the best fixed planner: {listed}." if worse else ""
