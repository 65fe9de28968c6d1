"""Comparison of planners with estimators: path, truth, estimate, score over time, and tables."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from geo import Farm, FarmGrid
from sensors.field_files import load_field_set
from sensors.fields import FieldSet
from wbf_mission.addons.base.intervals import Interval, mean_intervals
from wbf_mission.addons.base.pages import Table
from wbf_mission.addons.base.plots import FLOWN, LAND, WORST_COLOURS, draw_farm, new_sheet, save_sheet
from wbf_mission.addons.base.standings import draw_mean_score, scores_at
from wbf_mission.addons.paper.shown import ShownRun
from wbf_mission.bench.rows import BenchRow, by_pair
from wbf_mission.scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_OTHERS = "#b9b6ae"
_ACROSS = 2
_WIDTH = 55  # Characters per line of a panel title
_PARTS = (0.1, 0.2, 0.5, 1.0)
_EARLY = 0.2
_STEPS = 501
_TOLERANCE, _FALL = 1e-6, 0.01  # Smallest fall and smallest visible fall, as fractions of the loss before
_LEAST_LOSS = 1e-12
"""Lower limit of a loss, against division by zero."""
_COLUMNS = ("path", "truth", "estimate", "score, 0 is perfect")


def plot_pairs(
    scenario: Scenario,
    estimator: str,
    shown: Mapping[tuple[str, str], ShownRun],
    rows: Sequence[BenchRow],
    colours: Mapping[str, str],
    paths: Sequence[Path],
) -> None:
    """Draw the runs of one estimator in one environment: a row of panels for each planner.

    Both diseases share a map: each is drawn on the plants that it can infect. `rows` are the results in this
    environment. `colours` has a colour for each planner, and `shown` a run for each planner and estimator.
    """
    farm = scenario.farm.load()
    fields = load_field_set(scenario.farm.fields)
    planners = [planner for planner in colours if (planner, estimator) in shown]
    own = [row for row in rows if row.estimator == estimator and row.scores]
    figure = new_sheet(9.2, 0.9 + 2.05 * len(planners))
    panels = figure.subplots(len(planners), 4, squeeze=False, width_ratios=(1.0, 1.0, 1.0, 1.35))
    lowest = min((min(row.scores) for row in own), default=-1.0)
    image = None
    for number, (planner, line) in enumerate(zip(planners, panels, strict=True)):
        run = shown[planner, estimator]
        draw_farm(line[0], farm, legend=False)
        line[0].plot(*run.path_m.T, color=FLOWN, linewidth=0.9)
        line[0].set_ylabel(f"{planner}\ny (m)", fontsize=8)
        for axes, values in ((line[1], run.truth), (line[2], run.estimate)):
            image = _show_health(axes, farm, fields, values)
        _score(line[3], planner, own, colours[planner], lowest)
        for axes, title in zip(line, _COLUMNS, strict=True):
            axes.tick_params(labelsize=7)
            axes.xaxis.label.set_size(8)
            if number == 0:
                axes.set_title(title, fontsize=9)
            if number < len(planners) - 1:
                axes.set_xlabel("")
                axes.tick_params(labelbottom=False)
        for axes in line[1:3]:
            axes.tick_params(labelleft=False)
    if image is not None:
        bar = figure.colorbar(
            image, ax=panels, location="bottom", fraction=0.015, shrink=0.4, aspect=50, pad=0.01
        )
        bar.set_ticks([0.0, 0.5, 1.0], labels=["lost", "infected", "healthy"])
        bar.ax.tick_params(labelsize=7)
    save_sheet(figure, paths)


def plot_scores(
    rows: Sequence[BenchRow], estimators: Sequence[str], colours: Mapping[str, str], paths: Sequence[Path]
) -> None:
    """Draw the mean score over time of all planners, one panel per estimator, with 95 % intervals."""
    across = min(len(estimators), _ACROSS)
    down = -(-len(estimators) // across)
    figure = new_sheet(4.4 * across, 0.5 + 3.1 * down)
    grid = figure.subplots(down, across, squeeze=False, sharey=True)
    panels = grid.flat[: len(estimators)]
    for unused in grid.flat[len(estimators) :]:
        unused.set_visible(False)
    pairs = by_pair(row for row in rows if row.scores)
    for axes, estimator in zip(panels, estimators, strict=True):
        for planner, colour in colours.items():
            if own := pairs.get((planner, estimator)):
                draw_mean_score(axes, own, planner, colour, alpha=0.13, linewidth=1.6)
        axes.set_title("\n".join(textwrap.wrap(estimator.replace(",", ", "), _WIDTH)), fontsize=9)
        axes.set_xlabel("time, s")
        axes.grid(alpha=0.3)
    grid[0, 0].set_ylim(top=0.0)  # The axis is shared: the limit is set after the last panel is drawn.
    for axes in grid[:, 0]:
        axes.set_ylabel("mean score, 0 is perfect")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=8, frameon=False)
    save_sheet(figure, paths)


def _show_health(axes: Axes, farm: Farm, fields: FieldSet, values: NDArray[np.float32]) -> Any:
    """Draw the health of the plants on the owner's land."""
    from matplotlib.colors import LinearSegmentedColormap

    grid: FarmGrid = farm.grid()
    stride = -(-max(grid.shape) // max(values.shape[1:]))
    pixels = np.full(values.shape[1:], np.nan, np.float32)
    for k, field in enumerate(fields):
        if field.kind == "disease":
            mask = field.mask(grid)[::stride, ::stride]
            pixels[mask] = values[k][mask]
    width_m, height_m = (cells * farm.cell_size_m for cells in grid.shape)
    axes.set_facecolor(LAND)
    axes.set_xlabel("x (m)")
    return axes.imshow(
        np.ma.masked_invalid(pixels).T,
        origin="lower",
        extent=(0.0, width_m, 0.0, height_m),
        interpolation="nearest",
        cmap=LinearSegmentedColormap.from_list("health", WORST_COLOURS),
        vmin=0.0,
        vmax=1.0,
    )


def _score(axes: Axes, planner: str, rows: Sequence[BenchRow], colour: str, lowest: float) -> None:
    """Draw the score of one planner over time; thin lines behind it are the other planners' scores."""
    for row in sorted(rows, key=lambda one: one.planner == planner):
        mine = row.planner == planner
        axes.plot(
            row.times_s,
            row.scores,
            color=colour if mine else _OTHERS,
            linewidth=1.6 if mine else 0.8,
            drawstyle="steps-post",
        )
    axes.set_xlim(left=0.0)
    axes.set_ylim(1.05 * lowest, 0.0)
    axes.set_xlabel("time, s")
    axes.grid(alpha=0.3)


def early_table(rows: Sequence[BenchRow]) -> Table:
    """Return the mean score of one scenario's rows at fractions of the time, with 95 % intervals."""
    good = [row for row in rows if row.scores]
    last_s = max((row.times_s[-1] for row in good), default=0.0)
    header = ("planner, estimator", *(f"at {part * last_s:.0f} s" for part in _PARTS))
    lines = []
    for (planner, estimator), own in by_pair(good).items():
        at = np.array([scores_at(row, np.array(_PARTS) * last_s) for row in own])
        cells = map(_interval, mean_intervals(at.T))
        lines.append((f"{planner}, {estimator}", *cells))
    return Table("Mean score at four times of the run", header, tuple(lines))


def lead_table(rows: Sequence[BenchRow]) -> Table:
    """Return a table of the planner with the best mean score at fractions of the time, and its lead.

    Leads are mean differences of pairs of runs in the same environment, with simultaneous 95 % intervals.
    """
    good = [row for row in rows if row.scores]
    last_s = max((row.times_s[-1] for row in good), default=0.0)
    at = {(row.planner, row.estimator, row.seed): row for row in good}
    planners = list(dict.fromkeys(row.planner for row in good))
    leads: list[tuple[str, str]] = []
    differences: list[NDArray[np.float64]] = []
    for estimator, part in itertools.product(dict.fromkeys(row.estimator for row in good), _PARTS):
        # Only environments in which every planner has a score are compared.
        seeds = [
            seed
            for seed in sorted({row.seed for row in good})
            if all((planner, estimator, seed) in at for planner in planners)
        ]
        if not seeds:
            continue
        time_s = np.array([part * last_s])
        scores = {
            planner: np.array([scores_at(at[planner, estimator, seed], time_s)[0] for seed in seeds])
            for planner in planners
        }
        first = max(planners, key=lambda planner: float(scores[planner].mean()))
        leads.append((f"{estimator}, at {part * last_s:.0f} s", first))
        differences += [scores[first] - scores[planner] for planner in planners]
    behind = iter(mean_intervals(differences, together=True))
    lines = []
    for name, first in leads:
        cells = [_interval(next(behind)) for _ in planners]
        cells[planners.index(first)] = "leads"
        lines.append((name, *cells))
    return Table("Leading planner, and its lead", ("estimator, time", *planners), tuple(lines))


def pair_table(rows: Sequence[BenchRow]) -> Table:
    """Return the paired differences between planners' mean scores over parts of the time and at the end.

    A difference is positive if the first planner is better. The 95 % intervals are simultaneous.
    """
    good = [row for row in rows if row.scores]
    last_s = max((row.times_s[-1] for row in good), default=0.0)
    at = {(row.planner, row.estimator, row.seed): row for row in good}
    times_s = np.linspace(0.0, last_s, _STEPS)
    early, half = times_s <= _EARLY * last_s, times_s <= 0.5 * last_s
    planners = list(dict.fromkeys(row.planner for row in good))
    names: list[str] = []
    differences: list[NDArray[np.float64]] = []
    for estimator, (one, other) in itertools.product(
        dict.fromkeys(row.estimator for row in good), itertools.combinations(planners, 2)
    ):
        pairs = [
            (at[one, estimator, seed], at[other, estimator, seed])
            for seed in sorted({row.seed for row in good})
            if (one, estimator, seed) in at and (other, estimator, seed) in at
        ]
        if not pairs:
            continue
        apart = np.array([scores_at(mine, times_s) - scores_at(theirs, times_s) for mine, theirs in pairs])
        names.append(f"{estimator}: {one} - {other}")
        differences += [apart[:, part].mean(axis=1) for part in (early, half, ~half)]
        differences.append(apart[:, -1])
    cells = iter(map(_interval, mean_intervals(differences, together=True)))
    lines = zip(names, cells, cells, cells, cells, strict=True)
    header = (
        "estimator: planners",
        f"first {_EARLY * last_s:.0f} s",
        f"first {0.5 * last_s:.0f} s",
        "the rest",
        "at the end",
    )
    return Table("Differences between planners, in pairs of runs", header, tuple(lines))


def fall_table(rows: Sequence[BenchRow]) -> Table:
    """Return a table: fraction of the scored times at which the score falls, and the largest fall."""
    lines = []
    for (planner, estimator), own in by_pair([row for row in rows if len(row.scores) > 1]).items():
        losses = [-np.array(row.scores) for row in own]
        rises = [np.diff(loss) / np.maximum(loss[:-1], _LEAST_LOSS) for loss in losses]
        falls = (np.array([100.0 * (rise > least).mean() for rise in rises]) for least in (_TOLERANCE, _FALL))
        worst = max(float(rise.max()) for rise in rises)
        cells = (f"{fall.mean():.1f} ({fall.min():.1f} to {fall.max():.1f})" for fall in falls)
        lines.append((f"{planner}, {estimator}", *cells, f"{100.0 * worst:.0f} %"))
    header = (
        "planner, estimator",
        "falls, % of the scored times (lowest to highest run)",
        f"by more than {100.0 * _FALL:.0f} % of the loss",
        "largest fall, % of the loss before it",
    )
    return Table("How often the score falls from one estimate to the next", header, tuple(lines))


def authors_table(rows: Iterable[BenchRow], shown: Mapping[tuple[str, str], ShownRun]) -> Table:
    """Return the final score of each run shown, by this program and by the paper's published code."""
    lines = tuple(
        (
            f"{row.planner}, {row.estimator}",
            "-" if row.final_score is None else f"{row.final_score:.4f}",
            f"{shown[row.planner, row.estimator].axis_max:.2f}",
        )
        for row in rows
        if (row.planner, row.estimator) in shown
    )
    header = ("planner, estimator", "score at the end", "by the published code")
    return Table("The runs that are shown", header, lines)


def _interval(one: Interval) -> str:
    if np.isnan(one.low):
        return f"{one.mean:.3f}"
    return f"{one.mean:.3f} ({one.low:.3f} to {one.high:.3f})"
