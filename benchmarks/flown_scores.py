"""What flying costs: the score of a planned path, and of the same path as vehicles fly it.

    python benchmarks/flown_scores.py [--farm waterberry --budget 12km --seeds 1] [--out table.md]

Each planner makes one path within the budget; without one it has the paper's length (0.4 steps for each of
the owner's cells). The ideal robot follows it to the cell: that is the planned score. Then every vehicle
flies it, in calm air and in wind.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from scratch import scratch_folder

from geo import get_farm
from geo.atomic import atomic_write
from mission.files import write_mission
from mission.planners import PlannedPath, planner_names
from wbf_mission.flight import fly
from wbf_mission.planning import MissionBuilder, plan
from wbf_mission.scenario import Scenario, scenario_with

WIND = {"wind_speed_m_s": 6.0, "wind_direction_deg": 240.0, "turbulence": "moderate"}
VEHICLES = (
    ("quad, PX4", {"vehicle": "mapping-quad", "autopilot": "px4"}),
    ("quad, ArduPilot", {"vehicle": "mapping-quad", "autopilot": "ardupilot"}),
    ("fixed wing, PX4", {"vehicle": "fixed-wing", "autopilot": "px4"}),
)

# Of those that use up the same budget.
PLANNERS = tuple(name for name in planner_names() if name != "survey")


@dataclass(frozen=True, slots=True)
class Row:
    """One flight: its loss at the end and over the run, its time and the cells it saw."""

    planner: str
    vehicle: str
    wind: bool
    seed: int
    outcome: str
    final: float
    whole: float
    time_s: float
    constant_s: float
    cells: int


def flights(farm: str, budget: str | None, planner: str, seed: int, speed_m_s: float) -> list[Row]:
    """Fly one path with all vehicles."""
    ideal = Scenario(farm=farm, planner=planner, vehicle="ideal", seed=seed, score_points=40, budget=budget)
    planned = plan(ideal)
    path = PlannedPath(planned.path_m, planned.spacing_m, planner)
    constant_s = planned.length_m / speed_m_s
    rows = [_row(ideal, planner, "ideal", False, constant_s)]
    with scratch_folder() as folder:
        for name, chosen in VEHICLES:
            scenario = scenario_with(replace(ideal, cruise_speed_m_s=speed_m_s), chosen)
            if chosen["vehicle"] == "fixed-wing":
                scenario = replace(scenario, cruise_speed_m_s=None)
            mission = MissionBuilder.of(scenario, get_farm(farm)).mission(path)
            file = folder / "path.plan"
            write_mission(mission, file)
            for wind in (False, True):
                flown = replace(scenario, cruise_speed_m_s=None, budget=None)
                flown = scenario_with(flown, {"mission": str(file)})
                weather = scenario_with(flown, WIND) if wind else flown
                rows.append(_row(weather, planner, name, wind, constant_s))
    return rows


def _row(scenario: Scenario, planner: str, vehicle: str, wind: bool, constant_s: float) -> Row:
    result = fly(scenario)
    summary = result.summary()
    return Row(
        planner=planner,
        vehicle=vehicle,
        wind=wind,
        seed=scenario.seed,
        outcome=summary["outcome"],
        final=-summary["final_score"],
        whole=-summary["score"],
        time_s=summary["flight_time_s"] if vehicle != "ideal" else constant_s,
        constant_s=constant_s,
        cells=summary["cells_observed"],
    )


def table(rows: list[Row]) -> str:
    """Return the means over the seeds as a Markdown table."""
    lines = [
        "| planner | vehicle | wind | time | cells seen | loss over the run | planned to flown |"
        " loss at the end | planned to flown |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    kinds = list(dict.fromkeys((row.planner, row.vehicle, row.wind) for row in rows))
    for planner, vehicle, wind in kinds:
        group = [row for row in rows if (row.planner, row.vehicle, row.wind) == (planner, vehicle, wind)]
        ideal = [row for row in rows if (row.planner, row.vehicle) == (planner, "ideal")]
        failed = sum(row.outcome != "completed" for row in group)
        cells = [
            planner,
            vehicle + (f" ({failed} not completed)" if failed else ""),
            "6 m/s, moderate" if wind else "calm",
            f"{_mean(group, 'time_s'):.0f} s",
            f"{_mean(group, 'cells'):.0f}",
        ]
        for name in ("whole", "final"):
            value, base = _mean(group, name), _mean(ideal, name)
            cells += [f"{value:.4f}", "planned" if vehicle == "ideal" else f"{value / base - 1.0:+.1%}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _mean(rows: list[Row], name: str) -> float:
    return float(np.mean([getattr(row, name) for row in rows]))


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--farm", default="miniberry-100")
    parser.add_argument("--budget", help="such as 12km")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--speed", type=float, default=5.0, help="of the quads, m/s")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, help="write the table there, too")
    options = parser.parse_args()
    jobs = [(planner, seed) for planner in PLANNERS for seed in range(options.seeds)]
    groups = Parallel(n_jobs=options.jobs)(
        delayed(flights)(options.farm, options.budget, planner, seed, options.speed) for planner, seed in jobs
    )
    rows = [row for group in groups for row in group]
    text = table(rows)
    sys.stdout.write(text + "\n")
    if options.out is not None:
        with atomic_write(options.out) as file:
            file.write(text + "\n")


if __name__ == "__main__":
    main()
