"""PNG pictures of a run: the farm, one map sheet per field, and the score over time.

The sheet of a field shows cells, or pixels of several cells on a large farm (`maps.blocks`), with the flown
path and marks on observed sick plants. Colour scales run from light to dark (or back), for readers with
red-green colour blindness.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geo import Farm
from sensors.fields import PAPER_FIELDS, FieldSet
from wbf_mission.addons.base.plots import LAND, WORST_COLOURS, draw_farm, new_figure, outline, save_figure
from wbf_mission.maps.blocks import MapGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from sensors.estimation import ScoreHistory
    from wbf_mission.maps.field_maps import FieldMap

FINDS = "#0072b2"
PATH = "#3b3b3b"
_LARGEST_SHARE = 0.02  # Minimum for the top of the colour scale of sick plants on a large farm
_SHARE_RANGE = 50.0
_MARGIN = 0.04
_MOST_DAYS_NAMED = 12
_TITLES = {
    "disease": ("plants expected sick", "worst plant expected", "how sure: standard deviation", "truth"),
    "continuous": ("expected mean", "lowest value expected", "how sure: standard deviation", "truth"),
}


def plot_farm(farm: Farm, path: Path) -> Path:
    """Write a picture of a farm without paths."""
    figure = new_figure(7, 6)
    figure.set_layout_engine("constrained")
    axes = figure.add_subplot()
    draw_farm(axes, farm)
    axes.set_title(farm.name)
    return save_figure(figure, path)


def plot_field(
    farm: Farm,
    estimate: FieldMap,
    path: Path,
    *,
    truth: FieldMap | None = None,
    flown_m: NDArray[np.float64] | None = None,
    about: str = "",
) -> Path:
    """Write the map sheet of one field as a PNG file: estimate, minimum, standard deviation and truth.

    `truth` is the map of the true values, if known. `flown_m`, float64[n, 2], is the path over ground in the
    farm's frame. `about` is the first line of the title.
    """
    kind, grid = estimate.field.kind, estimate.grid
    left, low, right, high = farm.owner_area.bounds
    margin = _MARGIN * max(right - left, high - low)
    left, low = max(0.0, left - margin), max(0.0, low - margin)
    right = min(farm.width_cells * farm.cell_size_m, right + margin)
    high = min(farm.height_cells * farm.cell_size_m, high + margin)
    panel_height = min(max(4.9 * (high - low) / (right - left), 3.2), 6.5)
    figure = new_figure(12.0, 2.0 * panel_height + 1.3)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    figure.subplots_adjust(
        left=0.06, right=0.95, bottom=0.55 / figure.get_figheight(), top=1.0 - 0.95 / figure.get_figheight()
    )
    figure.subplots_adjust(wspace=0.12, hspace=0.14)
    of_share, of_least, of_deviation = _styles(estimate)
    shown = (
        (estimate.share, of_share),
        (np.where(np.isfinite(estimate.least), estimate.least, np.nan), of_least),
        (estimate.deviation, of_deviation),
        (None if truth is None else truth.share, of_share),
    )
    for number, (axes, name, (pixels, style)) in enumerate(
        zip(panels.flat, _TITLES[kind], shown, strict=True)
    ):
        axes.set_facecolor(LAND)
        outline(axes, farm)
        axes.set_title(name, fontsize=9, pad=12)
        axes.set_aspect("equal")
        axes.set_xlim(left, right)
        axes.set_ylim(low, high)
        if pixels is None:
            text = "not known" if number == 3 else "this estimator gives no standard deviation"
            axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", fontsize=9)
        else:
            _show(figure, axes, pixels, grid, style)
        _name_blocks(axes, grid, (left, right, low, high))
        if number < 2 and flown_m is not None and len(flown_m):
            label = "path flown"
            axes.plot(
                flown_m[:, 0], flown_m[:, 1], color=PATH, linewidth=0.6, alpha=0.7, label=label, zorder=3
            )
    _mark_finds(panels[0, 0], estimate)
    if panels[0, 0].get_legend_handles_labels()[0]:
        panels[0, 0].legend(loc="upper left", fontsize=7, framealpha=0.85)
    for axes in panels[1]:
        axes.set_xlabel("x (m)")
    for axes in panels[:, 0]:
        axes.set_ylabel("y (m)")
    side = grid.pixel * grid.cell_size_m
    how = "cell by cell" if grid.pixel == 1 else f"squares of {side:.0f} m"
    block = grid.block * grid.cell_size_m
    lines = f"{estimate.field.title}: {how}; letters and numbers name blocks of {block:.3g} m"
    figure.suptitle(f"{about}\n{lines}" if about else lines, fontsize=10)
    return save_figure(figure, path)


def _show(figure: Figure, axes: Axes, pixels: NDArray[np.float64], grid: MapGrid, style: _Style) -> None:
    # The last column and row of pixels may extend beyond the farm.
    right, top = (n * grid.pixel * grid.cell_size_m for n in pixels.shape)
    image = axes.imshow(
        np.ma.masked_invalid(pixels).T,
        origin="lower",
        extent=(0.0, right, 0.0, top),
        interpolation="nearest",
        aspect="equal",
        zorder=1,
        **style.image,
    )
    bar = figure.colorbar(image, ax=axes, fraction=0.04, pad=0.045, extend="neither")
    bar.set_label(style.label, fontsize=8)
    if style.ticks == "worst":
        bar.set_ticks([0.0, 0.5, 1.0], labels=["lost", "infected", "healthy"])
    elif style.ticks == "percent":
        from matplotlib.ticker import FuncFormatter

        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100.0 * share:.3g} %"))
        bar.ax.yaxis.set_minor_formatter("")
    bar.ax.tick_params(labelsize=7)


class _Style(NamedTuple):
    """Colours of a panel, as arguments of `imshow`; ticks and label of its colour bar."""

    image: dict[str, Any]
    ticks: str
    label: str


def _styles(of: FieldMap) -> tuple[_Style, _Style, _Style]:
    """Return the styles of a field's panels: mean (for a disease: fraction sick), minimum, deviation."""
    from matplotlib.colors import LinearSegmentedColormap, LogNorm

    field, deviation = of.field, of.deviation
    # Pixels at borders have few plants and large deviations, which would flatten the colour scale.
    whole = of.cells >= 0.9 * of.cells.max()
    most = 1.0 if deviation is None else float(np.max(deviation[whole], initial=0.0))
    doubt = {"cmap": "viridis", "vmin": 0.0, "vmax": max(most, 1e-6)}
    whole_range = {"vmin": 0.0, "vmax": 1.0}
    if field.kind != "disease":
        colours = LinearSegmentedColormap.from_list(field.name, field.colours)
        plain = _Style({"cmap": colours, **whole_range}, "plain", field.unit)
        return plain, plain, _Style(doubt, "plain", f"standard deviation, {field.unit}")
    if of.grid.pixel == 1:
        share = _Style({"cmap": "YlOrBr", **whole_range}, "percent", "probability of being sick")
    else:
        # On a large farm, a few plants in a thousand are sick; within an outbreak, nearly all plants are.
        top = max(_LARGEST_SHARE, float(np.nanmax(of.share, initial=0.0)))
        norm = LogNorm(top / _SHARE_RANGE, top, clip=True)
        share = _Style({"cmap": "YlOrBr", "norm": norm}, "percent", "fraction of plants that are sick")
    worst = {"cmap": LinearSegmentedColormap.from_list("worst", WORST_COLOURS), **whole_range}
    return (
        share,
        _Style(worst, "worst", ""),
        _Style(doubt, "percent", "standard deviation, percentage points"),
    )


def _name_blocks(axes: Axes, grid: MapGrid, shown: tuple[float, float, float, float]) -> None:
    """Draw the letters of the block columns along the top and the row numbers along the right edge."""
    block = grid.block * grid.cell_size_m
    left, right, low, high = shown
    columns, rows = grid.blocks
    small: dict[str, Any] = {"fontsize": 6, "color": "#555555"}
    for i in range(columns):
        middle = (i + 0.5) * block
        if left <= middle <= right:
            above = high + 0.006 * (high - low)
            axes.text(middle, above, grid.name(i, 0)[:-1], ha="center", va="bottom", **small)
    for j in range(rows):
        middle = (j + 0.5) * block
        if low <= middle <= high:
            axes.text(right + 0.006 * (right - left), middle, str(j + 1), ha="left", va="center", **small)


def _mark_finds(axes: Axes, of: FieldMap) -> None:
    """Draw rings around the observed sick plants."""
    finds = of.finds
    if of.field.kind != "disease" or not len(finds):
        return
    positions = (finds + 0.5) * of.grid.cell_size_m
    size = float(np.clip(6000.0 / len(finds), 6.0, 60.0))
    plants = "plant" if len(finds) == 1 else "plants"
    axes.scatter(
        positions[:, 0],
        positions[:, 1],
        s=size,
        facecolors="none",
        edgecolors=FINDS,
        linewidths=1.2,
        label=f"{len(finds)} sick {plants} seen",
        zorder=4,
    )


def plot_score(
    history: ScoreHistory,
    path: Path,
    title: str,
    fields: FieldSet = PAPER_FIELDS,
) -> Path:
    """Write a picture of the score and of each field's loss over time, with lines between days."""
    times_s, losses = history.times_s, history.field_losses
    figure = new_figure(7.5, 5.2)
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.plot(times_s, history.scores, color="#1f4e79", drawstyle="steps-post")
    upper.set_ylabel("score (0 is perfect)")
    upper.set_title(title)
    for column, field in enumerate(fields):
        lower.plot(times_s, losses[:, column], label=field.title, drawstyle="steps-post")
    lower.set_ylabel("mean loss a cell")
    lower.set_xlabel("time since the start (s)")
    lower.legend(fontsize=7)
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    mark_days((upper, lower), history)
    return save_figure(figure, path)


def mark_days(panels: Sequence[Axes], history: ScoreHistory) -> None:
    """Draw a line at the start of each day, and label at most 12 days at the top."""
    first = [k for k, day in enumerate(history.days) if k == 0 or day != history.days[k - 1]]
    if len(first) < 2:
        return
    every = -(-len(first) // _MOST_DAYS_NAMED)
    for number, k in enumerate(first):
        time_s, day = history.times_s[k], history.days[k]
        for axes in panels:
            if number:
                axes.axvline(time_s, color="#555555", linewidth=0.8, linestyle=":")
        if number % every == 0:
            panels[0].annotate(
                f"day {day}",
                (time_s, 0.0),
                xycoords=("data", "axes fraction"),
                xytext=(3, 4),
                textcoords="offset points",
                fontsize=7,
                color="#555555",
            )
