"""What the paper's figures have in common: a size for print, and the kinds of files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from wbf_mission.pictures.plots import new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["new_sheet", "save_sheet"]

_DPI = 200


def new_sheet(width: float, height: float) -> Figure:
    """Return a figure of so many inches, laid out so that nothing overlaps."""
    figure = new_figure(width, height, dpi=_DPI)
    figure.set_layout_engine("constrained")
    return figure


def save_sheet(figure: Figure, paths: Sequence[Path]) -> None:
    """Write a figure into files, the kind of each by its suffix (see `save_figure`)."""
    for path in paths:
        save_figure(figure, path)
