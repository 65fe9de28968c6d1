"""``wbf-mission plan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wbf_mission.cli import options
from wbf_mission.cli.output import Output, distance, duration
from wbf_mission.cli.targets import MISSION_SUFFIXES, Force, refuse_overwrite
from wbf_mission.scenario import CameraOptions, FarmOptions, MissionOptions, VehicleOptions, WeatherOptions

EXAMPLES = """
Examples

wbf-mission plan --farm miniberry-100 --planner spiral --budget 25min --out spiral.plan

wbf-mission plan --farm waterberry --planner lawnmower --budget 8000m --out rows.waypoints

wbf-mission plan --farm my-farm.geojson --planner adaptive-lawnmower --json
"""


@options.scenario_options(
    FarmOptions,
    MissionOptions,
    VehicleOptions,
    WeatherOptions,
    CameraOptions,
    without=(
        "day",
        "days",
        "flights_per_day",
        "vehicles",
        "mission",
        "turbulence",
        "gps_noise_m",
        "baro_noise_m",
        "camera_noise",
        "false_positive_rate",
        "false_negative_rate",
        "camera_fields",
    ),
)
def plan_command(
    given: options.Given,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Mission file: .plan (QGroundControl), .waypoints (WPL 110), .json (ours), .kml, .geojson.",
            rich_help_panel="Output",
            show_default=False,
        ),
    ] = None,
    force: Force = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Plan a mission within a budget and say what it takes: length, time, coverage, battery."""
    from mission.files import write_mission, writer_for
    from wbf_mission.flight import check_flight
    from wbf_mission.planning import plan

    output = Output(as_json=json, quiet=quiet)
    chosen = given.scenario()
    if given.file is not None or chosen.farm.fields:
        check_flight(chosen)
    inputs = [given.file, chosen.farm.name, *chosen.farm.fields, chosen.mission.file, chosen.vehicle.name]
    refuse_overwrite(out, inputs, suffixes=MISSION_SUFFIXES, force=force)
    if out is not None:
        writer_for(out)
    with output.progress() as progress:
        progress("planning", 0, 1)
        result = plan(chosen, progress=progress)
        progress("planning", 1, 1)
    for warning in result.warnings:
        output.warn(warning)
    if out is not None:
        write_mission(result.mission, out)
    values = {**result.summary(), "file": str(out) if out else None}
    battery = "none" if result.battery_used is None else f"{result.battery_used:.1%}"
    rows = {
        "farm": result.farm.name,
        "planner": result.planner or "none (mission file)",
        "vehicle": result.vehicle.name,
        "budget": result.budget_text,
        "waypoints": str(len(result.path_m)),
        "row spacing": "-" if result.spacing_m is None else distance(result.spacing_m),
        "length": distance(result.length_m),
        "predicted time": duration(result.prediction.duration_s),
        "coverage": f"{result.coverage:.2%} of the owner's land",
        "battery use": battery,
        "batteries": "never enough" if result.batteries is None else str(result.batteries),
        "file": str(out) if out else "not written (give --out FILE)",
    }
    output.result(values, rows, title="Plan")
