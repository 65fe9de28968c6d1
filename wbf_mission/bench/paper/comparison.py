"""The comparison figure: path, truth, estimate and score over time of each planner with each estimator."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from geo import Farm, FarmGrid
from geo.farms import get_farm
from sensors.field_files import load_field_set
from sensors.fields import FieldSet
from wbf_mission.bench.paper.sheet import new_sheet, save_sheet
from wbf_mission.bench.paper.shown import ShownRun
from wbf_mission.bench.report import score_over_time
from wbf_mission.bench.row import BenchRow
from wbf_mission.bench.standings import students_reach
from wbf_mission.pictures.path_plot import FLOWN
from wbf_mission.pictures.plots import LAND, WORST_COLOURS, draw_farm
from wbf_mission.scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_pairs", "plot_scores"]

_OTHERS = "#b9b6ae"
_FEWEST_FOR_A_BAND = 5
_ACROSS = 2
_WIDTH = 55  # letters of a title over a panel
_COLUMNS = ("path", "truth", "estimate", "score, 0 is perfect")


def plot_pairs(
    scenario: Scenario,
    estimator: str,
    shown: Mapping[tuple[str, str], ShownRun],
    rows: Sequence[BenchRow],
    colours: Mapping[str, str],
    paths: Sequence[Path],
) -> None:
    """Draw a line of pictures for each planner with one estimator, all in one environment.

    Both diseases are in one map, each on the plants that it can befall.

    Parameters
    ----------
    shown : mapping of (str, str) to ShownRun
        By planner and estimator.
    rows : sequence of BenchRow
        Of the environment that is shown.
    colours : mapping of str to str
        Of the planners.
    paths : sequence of Path
        The same picture as PNG, PDF, ... by suffix.
    """
    farm = get_farm(scenario.farm.name)
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
    """Draw the mean score over time of all planners, a panel for each estimator, with Student's intervals.

    Parameters
    ----------
    rows : sequence of BenchRow
    estimators : sequence of str
    colours : mapping of str to str
        Of the planners.
    paths : sequence of Path
        The same picture as PNG, PDF, ... by suffix.
    """
    across = min(len(estimators), _ACROSS)
    down = -(-len(estimators) // across)
    figure = new_sheet(4.4 * across, 0.5 + 3.1 * down)
    grid = figure.subplots(down, across, squeeze=False, sharey=True)
    panels = grid.flat[: len(estimators)]
    for unused in grid.flat[len(estimators) :]:
        unused.set_visible(False)
    for axes, estimator in zip(panels, estimators, strict=True):
        for planner, colour in colours.items():
            own = [row for row in rows if (row.planner, row.estimator) == (planner, estimator) and row.scores]
            if not own:
                continue
            times_s, scores = score_over_time(own)
            means = scores.mean(axis=0)
            axes.plot(times_s, means, color=colour, label=planner, linewidth=1.6)
            if len(own) >= _FEWEST_FOR_A_BAND:
                reach = students_reach(scores)
                axes.fill_between(
                    times_s, means - reach, means + reach, color=colour, alpha=0.13, linewidth=0.0
                )
        axes.set_title("\n".join(textwrap.wrap(estimator.replace(",", ", "), _WIDTH)), fontsize=9)
        axes.set_xlabel("time, s")
        axes.grid(alpha=0.3)
    grid[0, 0].set_ylim(top=0.0)  # of all, after all is drawn
    for axes in grid[:, 0]:
        axes.set_ylabel("mean score, 0 is perfect")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=8, frameon=False)
    save_sheet(figure, paths)


def _show_health(axes: Axes, farm: Farm, fields: FieldSet, values: NDArray[np.float32]) -> Any:
    """Draw how healthy the owner's plants are."""
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
    """Draw the score of one planner over time, the others thin behind it."""
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
