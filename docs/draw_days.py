"""Draw the picture of docs/days.md: truth and estimate at the end of each day, and the score over the days.

python docs/draw_days.py --out docs/images/days.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from numpy.typing import NDArray

import wbf_mission
from wbf_mission.addons.pictures.sheets import mark_days

ROOT = Path(__file__).parents[1]
OPTIONS = {
    "farm": "miniberry-30",
    "vehicle": "ideal",
    "policy": "greedy",
    "budget": "100steps",
    "day": 3,
    "days": 5,
    "seed": 5,
    "score_points": 25,
}
FIELD = "tylcv"


def show(axes: Axes, values: NDArray[np.float32], mask: NDArray[np.bool_], cell_m: float) -> None:
    """Draw the sickness of plants: 0 is healthy, 1 is lost."""
    pixels = np.where(mask, 1.0 - values, np.nan)
    width, height = pixels.shape
    extent = (0.0, width * cell_m, 0.0, height * cell_m)
    axes.imshow(pixels.T, origin="lower", extent=extent, cmap="YlOrBr", vmin=0.0, vmax=1.0)
    # The lower half of this farm does not grow the disease's crop.
    columns, rows = np.nonzero(mask)
    axes.set_xlim(columns.min() * cell_m, (columns.max() + 1) * cell_m)
    axes.set_ylim(rows.min() * cell_m, (rows.max() + 1) * cell_m)
    axes.set_xticks([])
    axes.set_yticks([])


def main() -> None:
    """Fly the days and draw them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images" / "days.png")
    out = parser.parse_args().out
    result = wbf_mission.fly(wbf_mission.Scenario(**OPTIONS))
    farm, k = result.farm, result.fields.index(FIELD)
    mask = result.fields[FIELD].mask(farm.grid())
    figure = plt.figure(figsize=(10.0, 4.6), layout="constrained", dpi=110)
    grid = figure.add_gridspec(3, len(result.days), height_ratios=(1.0, 1.0, 1.3))
    for column, (day, flight) in enumerate(zip(result.days, result.flights, strict=True)):
        assert day.truth is not None and day.model is not None
        for row, values in enumerate((day.truth[k], day.model.value[k])):
            axes = figure.add_subplot(grid[row, column])
            show(axes, values, mask, farm.cell_size_m)
            if not row:
                axes.set_title(f"day {day.day}", fontsize=9)
            else:
                axes.plot(flight.track.x_m, flight.track.y_m, color="#1f4e79", linewidth=0.7)
            if not column:
                axes.set_ylabel(("truth", "estimate")[row], fontsize=9)
    axes = figure.add_subplot(grid[2, :])
    history = result.history
    axes.plot(history.times_s, history.scores, color="#1f4e79", drawstyle="steps-post")
    mark_days((axes,), history)
    axes.set_ylabel("score", fontsize=9)
    axes.set_xlabel("time in the air since the first day (s)", fontsize=9)
    axes.grid(alpha=0.3)
    figure.savefig(out)


if __name__ == "__main__":
    main()
