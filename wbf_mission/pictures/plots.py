"""PNG pictures of a run: the farm, one map sheet per field, and the score over time.

The sheet of a field shows cells, or pixels of several cells on a large farm (`maps.blocks`), with the flown
path and marks on observed sick plants. Colour scales run between light and dark, for readers with red-green
colour blindness.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from geo import Crop, Farm, FarmGrid
from geo.atomic import atomic_write
from sensors.fields import PAPER_FIELDS, FieldSet
from wbf_mission.maps.blocks import MapGrid

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from sensors.estimation import ScoreHistory
    from wbf_mission.maps.field_maps import FieldMap

CROP_COLOURS: dict[str, str] = {
    Crop.NONE: "#f4f1ea",
    Crop.STRAWBERRY: "#e8a7a1",
    Crop.TOMATO: "#b7d39b",
    Crop.POND: "#8fbcd4",
    Crop.WETLAND: "#9ccfb8",
}
_FURTHER_CROPS = ("#d9c58b", "#c9b3d6", "#a8cfd0", "#e3b78c", "#c2c2b0", "#d8a8c2")
LINE_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c6d31")
"""Colours of curves: the palette of Okabe and Ito, readable with colour blindness, and brown."""
LAND = "#e9e6df"
FINDS = "#0072b2"
PATH = "#3b3b3b"
WORST_COLOURS = ("#3d0a3a", "#f29e38", "#dfeaf2")  # Colours of lost, infected and healthy plants
MAX_PIXELS = 600  # Maximum number of cells along a side of a crop map
_HOME: dict[str, Any] = {"marker": "^", "color": "#d55e00", "markeredgecolor": "white", "markersize": 9}
_RALLY: dict[str, Any] = {"marker": "P", "color": "#0072b2", "markeredgecolor": "white", "markersize": 9}
_OBSTACLE: dict[str, Any] = {
    "facecolor": "none",
    "edgecolor": "#333333",
    "hatch": "xxx",
    "linewidth": 0.8,
    "zorder": 2,
}
_LOW_OBSTACLE: dict[str, Any] = {**_OBSTACLE, "hatch": "///"}
_LARGEST_SHARE = 0.02  # Minimum top of the colour scale of sick plants on a large farm
_SHARE_RANGE = 50.0
_MARGIN = 0.04
_MOST_DAYS_NAMED = 12
_TITLES = {
    "disease": ("plants expected sick", "worst plant expected", "how sure: deviation of the share", "truth"),
    "continuous": ("expected mean", "lowest value expected", "how sure: standard deviation", "truth"),
}


def new_figure(width: float, height: float, *, dpi: int = 110) -> Figure:
    """Return a figure; `width` and `height` in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=dpi)


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a figure atomically to a PNG file, or to a PDF file if the suffix is .pdf."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    with atomic_write(path, "wb") as stream:
        if path.suffix.lower() == ".pdf":
            figure.savefig(stream, format="pdf", metadata={"CreationDate": None})
        else:
            figure.savefig(stream, format="png")
    return path


def new_sheet(width: float, height: float) -> Figure:
    """Return a figure for print with constrained layout; `width` and `height` in inches."""
    figure = new_figure(width, height, dpi=200)
    figure.set_layout_engine("constrained")
    return figure


def save_sheet(figure: Figure, paths: Sequence[Path]) -> None:
    """Write a figure to several files; each suffix selects the format."""
    for path in paths:
        save_figure(figure, path)


def shown_every(shape: Sequence[int]) -> int:
    """Return the stride between the cells of a crop map that are shown."""
    return max(1, -(-max(shape) // MAX_PIXELS))


def _extent(grid: FarmGrid) -> tuple[float, float, float, float]:
    width, height = grid.shape
    return 0.0, width * grid.cell_size_m, 0.0, height * grid.cell_size_m


def crop_colours(crops: Sequence[str]) -> dict[str, str]:
    """Return the colour of each crop; crops outside the benchmark share a cycle of further colours."""
    further = itertools.cycle(_FURTHER_CROPS)
    return {crop: CROP_COLOURS.get(crop) or next(further) for crop in crops}


def draw_farm(axes: Axes, farm: Farm, *, legend: bool = True) -> None:
    """Draw crops, the owner's land and obstacles into ``axes`` (metres along the farm's axes).

    `legend`: draw home and the rally points, too, and a legend beside the map.
    """
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch as LegendPatch

    grid = farm.grid()
    stride = shown_every(grid.shape)
    crops = grid.crop[::stride, ::stride]
    colour_of = crop_colours(grid.crops)
    colours = ListedColormap(list(colour_of.values()))
    norm = BoundaryNorm([number - 0.5 for number in range(len(colour_of) + 1)], len(colour_of))
    axes.imshow(
        crops.T,
        origin="lower",
        extent=_extent(grid),
        interpolation="nearest",
        aspect="equal",
        cmap=colours,
        norm=norm,
        zorder=0,
    )
    shown = _outline(axes, farm)
    if legend:
        for number in reversed(np.unique(crops).tolist()):
            if number:
                crop = grid.crops[number]
                shown = {crop: LegendPatch(color=colour_of[crop]), **shown}
        (shown["home"],) = axes.plot(*farm.home_m, linestyle="none", zorder=5, clip_on=False, **_HOME)
        if farm.rally_m:
            (shown["rally point"],) = axes.plot(
                *np.transpose(farm.rally_m), linestyle="none", zorder=5, clip_on=False, **_RALLY
            )
        # Explicit handles keep the farm's artists out of the legend that a caller adds for paths.
        axes.legend(
            list(shown.values()),
            list(shown),
            loc="upper left",
            bbox_to_anchor=(1.02, 1.0),
            borderaxespad=0.0,
            fontsize=7,
            frameon=False,
        )
    for obstacle in farm.obstacles:
        if obstacle.height_m is not None:
            left, _, right, top = obstacle.polygon.bounds
            place = ((left + right) / 2, top)
            axes.annotate(
                f"{obstacle.height_m:g} m",
                *(place, (0, 2)),
                textcoords="offset points",
                fontsize=7,
                ha="center",
                zorder=4,
            )
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")


def _outline(axes: Axes, farm: Farm) -> dict[str, Artist]:
    """Draw the border of the owner's land and the obstacles; return their legend handles by label."""
    area = farm.owner_area
    shown: dict[str, Artist] = {}
    for polygon in getattr(area, "geoms", [area]):
        for ring in (polygon.exterior, *polygon.interiors):
            (shown["owner's border"],) = axes.plot(
                *ring.xy, color="#5b4636", linewidth=1.2, linestyle="--", zorder=2
            )
    for obstacle in farm.obstacles:
        low = obstacle.height_m is not None
        style = _LOW_OBSTACLE if low else _OBSTACLE
        name = "obstacle with a height" if low else "obstacle or no-fly zone"
        (shown[name],) = axes.fill(*obstacle.polygon.exterior.xy, **style)
    return shown


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

    Parameters
    ----------
    truth : FieldMap, optional
        Map of the true values, if known.
    flown_m : float64[n, 2], optional
        Path over ground, metres in the farm's frame.
    about : str
        First line of the title.
    """
    kind, grid = estimate.field.kind, estimate.grid
    left, right, low, high = _part_shown(farm)
    panel_height = min(max(4.9 * (high - low) / (right - left), 3.2), 6.5)
    figure = new_figure(12.0, 2.0 * panel_height + 1.3)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    figure.subplots_adjust(
        left=0.06, right=0.95, bottom=0.55 / figure.get_figheight(), top=1.0 - 0.95 / figure.get_figheight()
    )
    figure.subplots_adjust(wspace=0.12, hspace=0.14)
    share_style = _share_style(estimate)
    shown: tuple[tuple[NDArray[np.float64] | None, dict[str, Any], str, str], ...] = (
        (estimate.share, *share_style),
        (np.where(np.isfinite(estimate.least), estimate.least, np.nan), *_least_style(estimate)),
        (estimate.deviation, *_deviation_style(estimate)),
        (None if truth is None else truth.share, *share_style),
    )
    for number, (axes, name, (pixels, style, scale, unit)) in enumerate(
        zip(panels.flat, _TITLES[kind], shown, strict=True)
    ):
        axes.set_facecolor(LAND)
        _outline(axes, farm)
        axes.set_title(name, fontsize=9, pad=12)
        axes.set_aspect("equal")
        axes.set_xlim(left, right)
        axes.set_ylim(low, high)
        if pixels is None:
            text = "not known" if number == 3 else "this estimator does not tell how sure it is"
            axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", fontsize=9)
        else:
            _show(figure, axes, pixels, grid, style, scale, unit)
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


def _show(
    figure: Figure,
    axes: Axes,
    pixels: NDArray[np.float64],
    grid: MapGrid,
    style: dict[str, Any],
    scale: str,
    unit: str,
) -> None:
    # The last column and row of pixels may extend beyond the farm.
    extent = [0.0, 0.0, 0.0, 0.0]
    extent[1], extent[3] = (n * grid.pixel * grid.cell_size_m for n in pixels.shape)
    image = axes.imshow(
        np.ma.masked_invalid(pixels).T,
        origin="lower",
        extent=(extent[0], extent[1], extent[2], extent[3]),
        interpolation="nearest",
        aspect="equal",
        zorder=1,
        **style,
    )
    bar = figure.colorbar(image, ax=axes, fraction=0.04, pad=0.045, extend="neither")
    bar.set_label(unit, fontsize=8)
    if scale == "worst":
        bar.set_ticks([0.0, 0.5, 1.0], labels=["lost", "infected", "healthy"])
    elif scale == "percent":
        from matplotlib.ticker import FuncFormatter

        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100.0 * share:.3g} %"))
        bar.ax.yaxis.set_minor_formatter("")
    bar.ax.tick_params(labelsize=7)


def _share_style(of: FieldMap) -> tuple[dict[str, Any], str, str]:
    from matplotlib.colors import LinearSegmentedColormap, LogNorm

    if of.field.kind != "disease":
        colours = LinearSegmentedColormap.from_list(of.field.name, of.field.colours)
        return {"cmap": colours, "vmin": 0.0, "vmax": 1.0}, "plain", of.field.unit
    if of.grid.pixel == 1:
        return {"cmap": "YlOrBr", "vmin": 0.0, "vmax": 1.0}, "percent", "probability of being sick"
    # On a large farm a few plants in a thousand are sick, but nearly all plants within an outbreak.
    top = max(_LARGEST_SHARE, float(np.nanmax(of.share, initial=0.0)))
    norm = LogNorm(top / _SHARE_RANGE, top, clip=True)
    return {"cmap": "YlOrBr", "norm": norm}, "percent", "part of the plants that is sick"


def _least_style(of: FieldMap) -> tuple[dict[str, Any], str, str]:
    from matplotlib.colors import LinearSegmentedColormap

    if of.field.kind != "disease":
        style, _, unit = _share_style(of)
        return style, "plain", unit
    colours = LinearSegmentedColormap.from_list("worst", WORST_COLOURS)
    return {"cmap": colours, "vmin": 0.0, "vmax": 1.0}, "worst", ""


def _deviation_style(of: FieldMap) -> tuple[dict[str, Any], str, str]:
    deviation = of.deviation
    # Pixels with few plants, at borders, have large deviations that would flatten the colour scale.
    whole = of.cells >= 0.9 * of.cells.max()
    top = 1.0 if deviation is None else float(np.max(deviation[whole], initial=0.0))
    style = {"cmap": "viridis", "vmin": 0.0, "vmax": max(top, 1e-6)}
    if of.field.kind == "disease":
        return style, "percent", "standard deviation, percentage points"
    return style, "plain", f"standard deviation, {of.field.unit}"


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


def _part_shown(farm: Farm) -> tuple[float, float, float, float]:
    """Return the bounds of the owner's land with a margin (m): least x, greatest x, least y, greatest y."""
    left, low, right, high = farm.owner_area.bounds
    width, height = farm.width_cells * farm.cell_size_m, farm.height_cells * farm.cell_size_m
    margin = _MARGIN * max(right - left, high - low)
    return (
        max(0.0, left - margin),
        min(width, right + margin),
        max(0.0, low - margin),
        min(height, high + margin),
    )


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
