"""The figure of the farms: who grows what where."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from geo import Crop
from geo.farms import get_farm
from wbf_mission.bench.paper.sheet import new_sheet, save_sheet
from wbf_mission.pictures.plots import CROP_COLOURS, draw_farm

__all__ = ["FARMS", "plot_geometry"]

FARMS = ("waterberry", "miniberry-10", "miniberry-30", "miniberry-100")
"""The paper's, the full one first."""


def plot_geometry(paths: Sequence[Path]) -> None:
    """Draw the paper's farms: the full one large, the small ones beside it.

    Parameters
    ----------
    paths : sequence of Path
        The same picture as PNG, PDF, ... by suffix.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure = new_sheet(8.0, 5.2)
    panels = figure.add_gridspec(3, 2, width_ratios=(3.6, 1.0))
    farms = [get_farm(name) for name in FARMS]
    shown: set[Crop] = set()
    for number, farm in enumerate(farms):
        axes = figure.add_subplot(panels[:, 0] if number == 0 else panels[number - 1, 1])
        draw_farm(axes, farm, legend=False)
        shown |= {patch.crop for patch in farm.patches}
        cells = f"{farm.width_cells} x {farm.height_cells} cells of one square foot"
        axes.set_title(f"{farm.name}\n{cells}" if number == 0 else farm.name, fontsize=9)
        axes.tick_params(labelsize=7)
        if number:
            axes.set_ylabel("")
            if number < len(farms) - 1:
                axes.set_xlabel("")
    crops = sorted(shown - {Crop.NONE})
    handles: list[Any] = [Patch(color=CROP_COLOURS[crop], label=crop.name.lower()) for crop in crops]
    handles.append(Line2D([], [], color="#5b4636", linewidth=1.2, linestyle="--", label="the owner's land"))
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    save_sheet(figure, paths)
