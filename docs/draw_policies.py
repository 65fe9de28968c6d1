"""Draw the pictures of docs/policies.md: where each policy flies over the same sick farm.

    python docs/draw_policies.py policies.png --out docs/images

The flights are made as in `benchmarks/policies.py`, with the paper's robot and the estimator `epidemic`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
matplotlib.use("Agg")
from drawing import asked_for
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from policies import DAY, Case, Run, fly, made

from geo.farms import get_farm
from geo.seeds import child_seed
from sensors.environment import generate_environment
from sensors.fields import HEALTH_COLOURS, PAPER_FIELDS

SEED = 700_001
SMALL, LARGE = "miniberry-30", "miniberry-100"
PICTURES = {
    "policies.png": (
        ("adaptive-lawnmower", SMALL, 1),
        ("refining-lawnmower", SMALL, 1),
        ("greedy", SMALL, 1),
        ("orienteering", SMALL, 1),
        ("rolling-horizon", SMALL, 1),
        ("rolling-horizon", SMALL, 3),
    ),
    "policies-authors.png": (
        ("confidence-guided", SMALL, 1),
        ("grid-limited-randomness:order=end", SMALL, 1),
        ("grid-limited-randomness", SMALL, 1),
        ("confidence-guided", SMALL, 3),
        ("market", LARGE, 1),
        ("market", LARGE, 3),
    ),
}
TRACKS = ("#1f3b73", "#7a3b9a", "#0b7285")
FADED = 0.35


def draw_flight(axes: Axes, case: Case, name: str, run: Run) -> None:
    """Draw the truth of both crops, and the tracks with the first third of the steps dark."""
    farm = get_farm(case.farm)
    environment = generate_environment(
        farm.grid(), days=DAY, seed=child_seed(SEED, "environment"), keep_days=[DAY]
    )
    values = environment.values(DAY)
    health = np.where(PAPER_FIELDS["tylcv"].hosts(farm.grid()), values[0], values[1])
    axes.imshow(
        health.T,
        origin="lower",
        extent=(0, health.shape[0], 0, health.shape[1]),
        cmap=LinearSegmentedColormap.from_list("health", HEALTH_COLOURS),
        vmin=0.0,
        vmax=1.0,
        alpha=FADED,
    )
    for number, track in enumerate(run.tracks):
        x, y = track.T / farm.cell_size_m
        third = len(x) // 3
        colour = TRACKS[number % len(TRACKS)]
        axes.plot(x[third:], y[third:], color=colour, lw=0.8, alpha=0.55)
        axes.plot(x[: third + 1], y[: third + 1], color=colour, lw=1.6)
    crops = health.shape[1] / 2
    axes.axhline(crops, color="#555555", lw=0.6, ls=":")
    who = name if case.vehicles == 1 else f"{name}, {case.vehicles} vehicles"
    run_loss, end_loss = run.losses[:, 0].mean(), run.losses[-1, 0]
    axes.set_title(f"{who}\nloss: run {run_loss:.3f}, end {end_loss:.4f}", fontsize=9)
    axes.set_xticks([])
    axes.set_yticks([])


def main() -> int:
    """Fly and draw."""
    for picture in asked_for(__doc__, PICTURES):
        figure, grid = plt.subplots(2, 3, figsize=(10.0, 7.4), layout="constrained")
        for axes, (name, farm, vehicles) in zip(grid.flat, PICTURES[picture.name], strict=True):
            case = Case(farm, vehicles)
            draw_flight(axes, case, name, fly(case, made(name), SEED))
        figure.savefig(picture, dpi=110)
    return 0


if __name__ == "__main__":
    sys.exit(main())
