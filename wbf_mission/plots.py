"""PNG pictures of a run: farm and paths, truth / estimate / uncertainty per field, score over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from geo import Crop, Farm, FarmGrid
from geo.atomic import atomic_write
from sensors.fields import PAPER_FIELDS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIELD_TITLES = {"tylcv": "TYLCV (tomato)", "ccr": "charcoal rot (strawberry)", "soil": "soil humidity"}
CROP_COLOURS = {
    Crop.NONE: "#f4f1ea",
    Crop.STRAWBERRY: "#e8a7a1",
    Crop.TOMATO: "#b7d39b",
    Crop.POND: "#8fbcd4",
    Crop.WETLAND: "#9ccfb8",
}
HEALTH_COLOURS = ["#5a0f14", "#f08a24", "#4f9d5d"]  # lost, infected, healthy
MAX_PIXELS = 600  # a picture shows no more cells a side than this; larger farms are drawn in blocks of cells


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=110, layout="constrained")


def _save(figure: Figure, path: Path) -> Path:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    with atomic_write(path, "wb") as stream:
        figure.savefig(stream, format="png")
    return path


def _stride(grid: FarmGrid) -> int:
    return max(1, -(-max(grid.shape) // MAX_PIXELS))


def _extent(grid: FarmGrid) -> tuple[float, float, float, float]:
    width, height = grid.shape
    return 0.0, width * grid.cell_size_m, 0.0, height * grid.cell_size_m


def _shrink(cells: NDArray[Any], stride: int, pick: Any) -> NDArray[Any]:
    """Return one value for each ``stride`` x ``stride`` block of cells, chosen by ``pick`` (np.min, ...)."""
    if stride == 1:
        return cells
    width, height = (size // stride * stride for size in cells.shape)
    blocks = cells[:width, :height].reshape(width // stride, stride, height // stride, stride)
    return np.asarray(pick(blocks, axis=(1, 3)))


def _show(axes: Axes, cells: NDArray[Any], grid: FarmGrid, **style: Any) -> Any:
    return axes.imshow(
        cells.T, origin="lower", extent=_extent(grid), interpolation="nearest", aspect="equal", **style
    )


def draw_farm(axes: Axes, farm: Farm) -> None:
    """Draw crops and the owner's land into ``axes`` (metres along the farm's axes)."""
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch as LegendPatch

    grid = farm.grid()
    stride = _stride(grid)
    crops = grid.crop[::stride, ::stride]
    levels = sorted(CROP_COLOURS)
    colours = ListedColormap([CROP_COLOURS[Crop(level)] for level in levels])
    norm = BoundaryNorm([level - 0.5 for level in levels] + [levels[-1] + 0.5], len(levels))
    _show(axes, crops, grid, cmap=colours, norm=norm, zorder=0)
    area = farm.owner_area
    for polygon in getattr(area, "geoms", [area]):
        x, y = polygon.exterior.xy
        axes.plot(x, y, color="#5b4636", linewidth=1.2, linestyle="--", zorder=2)
    for obstacle in farm.obstacles:
        x, y = obstacle.exterior.xy
        axes.fill(x, y, facecolor="none", edgecolor="#333333", hatch="xxx", linewidth=0.8, zorder=2)
    present = [Crop(int(code)) for code in np.unique(crops)]
    axes.legend(
        handles=[LegendPatch(color=CROP_COLOURS[crop], label=crop.name.lower()) for crop in present if crop],
        loc="upper left",
        fontsize=7,
        framealpha=0.85,
    )
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")


def plot_farm(farm: Farm, path: Path) -> Path:
    """Write a picture of the farm alone."""
    figure = _figure(7, 6)
    axes = figure.add_subplot()
    draw_farm(axes, farm)
    axes.set_title(farm.name)
    return _save(figure, path)


def plot_paths(
    farm: Farm,
    planned_m: NDArray[np.float64] | None,
    flown_m: NDArray[np.float64] | None,
    path: Path,
    title: str,
) -> Path:
    """Write the farm with the planned and the flown path ([n, 2], metres in the farm frame)."""
    figure = _figure(7.5, 6.4)
    axes = figure.add_subplot()
    draw_farm(axes, farm)
    crops = axes.get_legend()
    if planned_m is not None and len(planned_m):
        axes.plot(
            planned_m[:, 0],
            planned_m[:, 1],
            color="#1f4e79",
            linewidth=2.2,
            alpha=0.55,
            label="planned",
            zorder=3,
        )
    if flown_m is not None and len(flown_m):
        axes.plot(flown_m[:, 0], flown_m[:, 1], color="#c8102e", linewidth=0.8, label="flown", zorder=4)
        axes.plot(*flown_m[0], marker="o", color="black", markersize=4, linestyle="", label="start", zorder=5)
    axes.legend(loc="upper right", fontsize=7, framealpha=0.85)
    if crops is not None:
        axes.add_artist(crops)
    axes.set_title(title)
    return _save(figure, path)


def plot_field(
    farm: Farm,
    field: str,
    truth: NDArray[np.float32],
    estimate: NDArray[np.float32],
    uncertainty: NDArray[np.float32],
    path: Path,
    about: str = "",
) -> Path:
    """Write truth, estimate and uncertainty ([W, H] each) of one field; cells that are not scored are pale.

    On a farm of more cells than pixels a pixel shows the worst cell of its block for a disease, so that no
    outbreak falls between the pixels, and the mean for the soil; the uncertainty is the least of its block.
    """
    grid = farm.grid()
    stride = _stride(grid)
    mask = _shrink(PAPER_FIELDS[field].mask(grid), stride, np.any)
    figure = _figure(12, 3.5)
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    shade = np.where(mask, np.nan, 1.0)
    from matplotlib.colors import LinearSegmentedColormap

    pick = np.mean if field == "soil" else np.min
    colours = "YlGnBu" if field == "soil" else LinearSegmentedColormap.from_list("health", HEALTH_COLOURS)
    top = float(np.max(uncertainty)) or 1.0
    styles: tuple[dict[str, Any], ...] = (
        {"cmap": colours, "vmin": 0.0, "vmax": 1.0},
        {"cmap": colours, "vmin": 0.0, "vmax": 1.0},
        {"cmap": "magma", "vmin": 0.0, "vmax": top},
    )
    for axes, name, cells, style in zip(
        panels,
        ("truth", "estimate", "uncertainty"),
        (_shrink(truth, stride, pick), _shrink(estimate, stride, pick), _shrink(uncertainty, stride, np.min)),
        styles,
        strict=True,
    ):
        image = _show(axes, cells, grid, **style)
        _show(axes, shade, grid, cmap="gray", vmin=0.0, vmax=1.0, alpha=0.65)
        figure.colorbar(image, ax=axes, shrink=0.8)
        axes.set_title(f"{FIELD_TITLES[field]}: {name}", fontsize=9)
        axes.set_xlabel("x (m)")
    panels[0].set_ylabel("y (m)")
    figure.suptitle(about, fontsize=9)
    return _save(figure, path)


def plot_score(
    times_s: Sequence[float], scores: Sequence[float], losses: NDArray[np.float64], path: Path, title: str
) -> Path:
    """Write the score and the loss of each field ([c, 3]) over the time of the run."""
    figure = _figure(7.5, 5.2)
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.plot(times_s, scores, color="#1f4e79", drawstyle="steps-post")
    upper.set_ylabel("score (0 is perfect)")
    upper.set_title(title)
    for column, field in enumerate(PAPER_FIELDS.names):
        lower.plot(times_s, losses[:, column], label=FIELD_TITLES[field], drawstyle="steps-post")
    lower.set_ylabel("mean loss a cell")
    lower.set_xlabel("time since the start (s)")
    lower.legend(fontsize=7)
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    return _save(figure, path)
