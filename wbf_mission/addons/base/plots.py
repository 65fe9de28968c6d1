"""Makes matplotlib figures, colours and drawings of farms, for all pictures."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from geo import Crop, Farm
from geo.atomic import atomic_write
from geo.frame import LocalFrame
from geo.linear_algebra import cos, sin
from mission.errors import MissionFileError
from mission.files.fence import geo_fence
from mission.model import MissionItem

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CROP_COLOURS: dict[str, str] = {
    Crop.NONE: "#f4f1ea",
    Crop.STRAWBERRY: "#e8a7a1",
    Crop.TOMATO: "#b7d39b",
    Crop.POND: "#8fbcd4",
    Crop.WETLAND: "#9ccfb8",
}
_FURTHER_CROPS = ("#d9c58b", "#c9b3d6", "#a8cfd0", "#e3b78c", "#c2c2b0", "#d8a8c2")
LINE_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c6d31")
"""Colours of curves: brown, and the palette of Okabe and Ito, readable with colour blindness."""
LAND = "#e9e6df"
FLOWN = "#c8102e"  # Colour of flown paths
WORST_COLOURS = ("#3d0a3a", "#f29e38", "#dfeaf2")  # Lost, infected, healthy: distinct without red and green
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


def rgb(colour: str) -> tuple[int, int, int]:
    """Return the red, green and blue of ``#rrggbb``, 0 to 255.

    >>> rgb("#0072b2")
    (0, 114, 178)
    """
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


def ramp(colours: Sequence[str], steps: int) -> NDArray[np.uint8]:
    """Return a gradient through the colours, uint8[steps, 3]."""
    stops = np.array([rgb(colour) for colour in colours], np.float64)
    at, places = np.linspace(0.0, len(stops) - 1.0, steps), np.arange(len(stops))
    parts = [np.interp(at, places, stops[:, part]) for part in range(3)]
    return np.rint(np.column_stack(parts)).astype(np.uint8)


def new_figure(width: float, height: float, *, dpi: int = 110) -> Figure:
    """Return a figure; `width` and `height` are in inches."""
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
    """Return a figure for print with constrained layout; `width` and `height` are in inches."""
    figure = new_figure(width, height, dpi=200)
    figure.set_layout_engine("constrained")
    return figure


def save_sheet(figure: Figure, paths: Sequence[Path]) -> None:
    """Write a figure to several files; each suffix selects the format."""
    for path in paths:
        save_figure(figure, path)


def shown_every(shape: Sequence[int]) -> int:
    """Return the step between the cells of a crop map that are drawn; 1 draws all cells."""
    return max(1, -(-max(shape) // MAX_PIXELS))


def crop_colours(crops: Sequence[str]) -> dict[str, str]:
    """Return the colour of each crop; crops outside the benchmark share a cycle of further colours."""
    further = itertools.cycle(_FURTHER_CROPS)
    return {crop: CROP_COLOURS.get(crop) or next(further) for crop in crops}


def draw_farm(axes: Axes, farm: Farm, *, legend: bool = True) -> None:
    """Draw crops, the owner's land and obstacles into ``axes`` (metres along the farm's axes).

    With `legend`, also draw home, the rally points, and a legend beside the map.
    """
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch as LegendPatch

    grid = farm.grid()
    width_m, height_m = (cells * grid.cell_size_m for cells in grid.shape)
    stride = shown_every(grid.shape)
    crops = grid.crop[::stride, ::stride]
    colour_of = crop_colours(grid.crops)
    colours = ListedColormap(list(colour_of.values()))
    norm = BoundaryNorm([number - 0.5 for number in range(len(colour_of) + 1)], len(colour_of))
    axes.imshow(
        crops.T,
        origin="lower",
        extent=(0.0, width_m, 0.0, height_m),
        interpolation="nearest",
        aspect="equal",
        cmap=colours,
        norm=norm,
        zorder=0,
    )
    shown = outline(axes, farm)
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
        # These handles keep the farm's artists out of a legend of paths that the caller adds.
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


def outline(axes: Axes, farm: Farm) -> dict[str, Artist]:
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


CIRCLE_CORNERS = 48
"""Number of corners of a circle drawn as a polygon; the sides are within 0.2 % of the radius."""


def fence_rings(items: Sequence[MissionItem], frame: LocalFrame) -> list[tuple[NDArray[np.float64], bool]]:
    """Return each outline of a geofence (float64[n, 2], m in `frame`) and whether it is an inclusion zone.

    Circles become polygons of `CIRCLE_CORNERS` corners. Outlines outside the range of the frame are left out.
    Invalid fence items give an empty list.
    """
    try:
        fence = geo_fence(items)
    except MissionFileError:
        return []
    found = []
    for polygon in fence["polygons"]:
        latitude, longitude = np.array(polygon["polygon"]).T
        found.append((np.stack(frame.from_wgs84(latitude, longitude), 1), polygon["inclusion"]))
    around = np.linspace(0.0, 2.0 * np.pi, CIRCLE_CORNERS, endpoint=False)
    for circle in fence["circles"]:
        centre = np.array(frame.from_wgs84(*circle["circle"]["center"]))
        corners = centre + circle["circle"]["radius"] * np.stack([cos(around), sin(around)], 1)
        found.append((corners, circle["inclusion"]))
    return [(ring, inclusion) for ring, inclusion in found if np.isfinite(ring).all()]
