"""``wbf-mission benchmark``."""

from __future__ import annotations

from typing import Annotated

import typer

from wbf_mission.cli import options
from wbf_mission.cli.output import Output, duration
from wbf_mission.exit_codes import ExitCode
from wbf_mission.scenario import (
    CameraOptions,
    FarmOptions,
    MissionOptions,
    ScenarioError,
    ScoreOptions,
    VehicleOptions,
    WeatherOptions,
)
from wbf_mission.scenario.choice import choices_in

EXAMPLES = """
Examples

wbf-mission benchmark --farm miniberry-30 --vehicle ideal --seeds 10

wbf-mission benchmark --planners spiral,lawnmower --estimators gp --seeds 20 --jobs 2 --json
"""
_RUN = "What to run"


@options.scenario_options(
    FarmOptions,
    MissionOptions,
    ScoreOptions,
    VehicleOptions,
    WeatherOptions,
    CameraOptions,
    without=("planner", "mission", "seed"),
    defaults={"vehicle": "ideal"},
)
def benchmark_command(
    given: options.Given,
    planners: Annotated[
        str,
        typer.Option(
            help="Planners, separated by commas, such as lawnmower:direction=0.3,spiral.",
            rich_help_panel=_RUN,
        ),
    ] = "lawnmower,adaptive-lawnmower,spiral,random-waypoint",
    estimators: Annotated[
        str, typer.Option(help="Estimators, in the same way.", rich_help_panel=_RUN)
    ] = "adaptive-disk,gp",
    seeds: Annotated[
        int,
        typer.Option(
            help="How many environments: seeds 0, 1, ...",
            parser=options.whole_number_in(1, 100_000),
            min=1,
            max=100_000,
            rich_help_panel=_RUN,
        ),
    ] = 10,
    jobs: Annotated[
        int,
        options.processes(_RUN),
    ] = 1,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Fly planners against estimators over many environments and print one table.

    The environment of a seed is the same for every row, so the rows can be compared. Ctrl-C prints the rows
    of what was flown before.
    """
    from sensors.field_files import load_field_set
    from wbf_mission.benchmarking import BenchmarkInterrupted, benchmark

    output = Output(as_json=json, quiet=quiet)
    base = given.scenario()
    fields = load_field_set(base.farm.fields)
    if jobs == 0:
        msg = "--jobs 0 runs nothing: give a number of processes, or -1 for one per core"
        raise ScenarioError(msg)
    names = {"planner": choices_in(planners, "planner"), "estimator": choices_in(estimators, "estimator")}
    interrupted = False
    try:
        with output.progress() as progress:
            rows = benchmark(
                base, names["planner"], names["estimator"], range(seeds), jobs=jobs, progress=progress
            )
    except BenchmarkInterrupted as stop:
        rows, interrupted = stop.rows, True
        output.warn(f"{stop}; the table holds those")
    table = []
    for row in rows:
        values = row.summary()
        losses = values["losses_mean"]
        table.append(
            [
                row.planner,
                row.estimator,
                f"{values['score_mean']:.4f} ± {values['score_std']:.4f}",
                f"{values['final_score_mean']:.4f} ± {values['final_score_std']:.4f}",
                *(f"{loss:.4f}" for loss in losses.values()),
                f"{values['observations_mean']:.0f}",
                duration(values["wall_time_s"] / values["seeds"]),
            ]
        )
    header = [
        "planner",
        "estimator",
        "score, run",
        "score, end",
        *(field.name.upper() if field.kind == "disease" else field.name for field in fields),
        "observations",
        "wall a run",
    ]
    title = f"{base.farm.name}, {base.vehicle.name}, day {base.farm.day}, {seeds} environments"
    output.table([row.summary() for row in rows], header, table, title=f"{title} (score: 0 is perfect)")
    return ExitCode.INTERRUPTED if interrupted else ExitCode.GOOD
