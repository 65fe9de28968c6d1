"""Draw the picture of docs/fleets.md: three quads over Miniberry-30, one of which fails on the way.

python docs/draw_fleet.py --out docs/images/fleet.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from wbf_mission import Scenario, Simulated, fly
from wbf_mission.addons.base.plots import draw_farm
from wbf_mission.results.result import Result

ROOT = Path(__file__).parents[1]
COLOURS = ("#1f3b73", "#c8102e", "#0b7285")
FAULT = "motor-failure,vehicle=2,at=airborne,from=40"
RUNS = (
    ("strips", (), "strips"),
    ("voronoi", (), "Voronoi cells"),
    ("strips", (FAULT,), "strips; vehicle 2 fails"),
)


def draw(axes: Axes, result: Result, title: str) -> None:
    """Draw the flown paths, with a cross at the last position of a vehicle that did not return."""
    draw_farm(axes, result.farm)
    for one, colour in zip(result.flights, COLOURS, strict=True):
        axes.plot(one.track.x_m, one.track.y_m, color=colour, linewidth=0.9, label=f"vehicle {one.system_id}")
        if not one.outcome.is_good:
            axes.plot(one.track.x_m[-1], one.track.y_m[-1], marker="x", color=colour, markersize=9)
    if axes.get_legend() is not None:
        axes.get_legend().remove()
    axes.set_title(title, fontsize=9)


def main() -> None:
    """Fly and draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images" / "fleet.png")
    out = parser.parse_args().out
    figure, panels = plt.subplots(1, len(RUNS), figsize=(10.5, 3.9), layout="constrained")
    for axes, (partition, faults, title) in zip(panels, RUNS, strict=True):
        scenario = Scenario(
            farm="miniberry-30", planner="lawnmower", vehicles=3, partition=partition, estimator="point"
        )
        draw(axes, fly(scenario, by=Simulated(faults=faults)), title)
    panels[0].legend(fontsize=6, loc="upper left")
    figure.savefig(out, dpi=110)


if __name__ == "__main__":
    main()
