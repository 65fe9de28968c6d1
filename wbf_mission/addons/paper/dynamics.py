"""Figure of the environment: fifteen days of two diseases and of soil moisture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sensors.fields import Field
from wbf_mission.addons.base.plots import LAND, new_sheet, save_sheet
from wbf_mission.progress import Progress, silent
from wbf_mission.run.resolve import make_environment
from wbf_mission.scenario import Scenario, scenario_with

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DAYS = tuple(range(1, 16))
_SHOWN = (1, 3, 6, 9, 12, 15)
_INFECTED, _LOST = "#d55e00", "#3d0a3a"
_WATER = "#1d91c0"
_PIXELS = 250
"""Maximum number of pixels along the longer side of a map: as many as fit the figure."""


class Dynamics:
    """Environments of a scenario's farm over `DAYS`, one for each seed.

    Raises WbfMissionError if the farm is unknown, or needs too much memory.
    """

    def __init__(self, scenario: Scenario, seeds: Sequence[int], progress: Progress = silent) -> None:
        self.farm = scenario.farm.load()
        # float32[n, W, H]: values of the first seed on the days shown.
        self.maps: dict[int, NDArray[np.float32]] = {}
        found = []
        for number, seed in enumerate(seeds):
            progress("environments", number, len(seeds))
            changed = {"seed": seed, "day": DAYS[0], "days": len(DAYS)}
            environment = make_environment(scenario_with(scenario, changed), self.farm)
            self.fields = environment.fields
            masks = [field.mask(self.farm.grid()) for field in self.fields]
            for day in DAYS:
                values = environment.values(day)
                if number == 0 and day in _SHOWN:
                    self.maps[day] = values.copy()
                each = [value[mask] for value, mask in zip(values, masks, strict=True)]
                found += [[(one < 0.75).mean(), (one < 0.25).mean(), one.mean()] for one in each]
        shape = len(seeds), len(DAYS), len(self.fields), 3
        # float64[seeds, days, n]: fraction infected or lost, fraction lost, mean of each field.
        self.sick, self.lost, self.level = np.moveaxis(np.array(found, np.float64).reshape(shape), -1, 0)
        progress("environments", len(seeds), len(seeds))


def plot_dynamics(dynamics: Dynamics, paths: Sequence[Path]) -> None:
    """Draw, for each field, a row of maps and a curve over the days."""
    fields = dynamics.fields
    left, right, low, high = _bounds(dynamics)
    part = slice(left, right), slice(low, high)
    figure = new_sheet(10.0, 0.6 + 1.3 * len(fields))
    panels = figure.subplots(
        len(fields), len(_SHOWN) + 1, squeeze=False, width_ratios=(*[1.0] * len(_SHOWN), 1.9)
    )
    for k, field in enumerate(fields):
        mask = field.mask(dynamics.farm.grid())
        for axes, day in zip(panels[k], _SHOWN, strict=False):
            image = _show(axes, dynamics.maps[day][k][part], mask[part], field)
            if k == 0:
                axes.set_title(f"day {day}", fontsize=9)
        panels[k, 0].set_ylabel(field.title.replace(" (", "\n("), fontsize=9)
        bar = figure.colorbar(image, ax=list(panels[k, : len(_SHOWN)]), fraction=0.025, pad=0.01)
        bar.ax.tick_params(labelsize=7)
        if field.kind == "disease":
            bar.set_ticks([0.0, 0.5, 1.0], labels=["healthy", "infected", "lost"])
        else:
            bar.set_label(field.unit, fontsize=8)
        _curves(panels[k, -1], dynamics, k)
    panels[-1, -1].set_xlabel("day", fontsize=9)
    save_sheet(figure, paths)


def _bounds(dynamics: Dynamics) -> tuple[int, int, int, int]:
    """Return the bounding box of a field's cells: first cell and end along x, then along y."""
    concerned = np.logical_or.reduce([field.mask(dynamics.farm.grid()) for field in dynamics.fields])
    x, y = (np.flatnonzero(concerned.any(axis=axis)) for axis in (1, 0))
    return int(x[0]), int(x[-1]) + 1, int(y[0]), int(y[-1]) + 1


def _show(axes: Axes, values: NDArray[np.float32], mask: NDArray[np.bool_], field: Field) -> Any:
    """Draw a field on one day: the severity of a disease, or the value of another field."""
    from matplotlib.colors import LinearSegmentedColormap

    sick = field.kind == "disease"
    pixels = _pixels(np.where(mask, 1.0 - values if sick else values, np.float32(np.nan)), highest=sick)
    axes.set_facecolor(LAND)
    axes.set_xticks([])
    axes.set_yticks([])
    return axes.imshow(
        np.ma.masked_invalid(pixels).T,
        origin="lower",
        interpolation="nearest",
        cmap="YlOrBr" if sick else LinearSegmentedColormap.from_list(field.name, field.colours),
        vmin=0.0,
        vmax=1.0,
    )


def _pixels(values: NDArray[np.float32], *, highest: bool) -> NDArray[np.float32]:
    """Return the highest or the mean value of each block of cells; NaN if the block has no values."""
    block = -(-max(values.shape) // _PIXELS)
    wide = np.pad(values, [(0, -side % block) for side in values.shape], constant_values=np.nan)
    parts = wide.reshape(wide.shape[0] // block, block, wide.shape[1] // block, block)
    known = np.isfinite(parts)
    if highest:
        found = np.where(known, parts, -np.inf).max(axis=(1, 3))
    else:
        counts = np.maximum(known.sum(axis=(1, 3)), 1)
        found = np.where(known, parts, 0.0).sum(axis=(1, 3)) / counts
    return np.where(known.any(axis=(1, 3)), found, np.nan).astype(np.float32)


def _curves(axes: Axes, dynamics: Dynamics, k: int) -> None:
    """Draw the mean of a field over the seeds, and the range from the lowest to the highest seed."""
    disease = dynamics.fields[k].kind == "disease"
    curves = (
        [("infected or lost", dynamics.sick, _INFECTED), ("lost", dynamics.lost, _LOST)]
        if disease
        else [("mean", dynamics.level, _WATER)]
    )
    for label, values, colour in curves:
        own = values[:, :, k] * (100.0 if disease else 1.0)
        axes.plot(DAYS, own.mean(axis=0), color=colour, linewidth=1.6, label=label)
        if len(own) > 1:
            axes.fill_between(DAYS, own.min(axis=0), own.max(axis=0), color=colour, alpha=0.15, linewidth=0.0)
    axes.set_ylabel("% of the plants" if disease else dynamics.fields[k].unit, fontsize=8)
    axes.yaxis.set_label_position("right")
    axes.yaxis.tick_right()
    axes.set_xlim(DAYS[0], DAYS[-1])
    axes.set_ylim(bottom=0.0, top=None if disease else 1.0)
    axes.set_xticks(_SHOWN)
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7, frameon=False, loc="upper left")
