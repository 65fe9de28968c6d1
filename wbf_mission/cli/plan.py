"""``wbf-mission plan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wbf_mission.cli import options
from wbf_mission.cli.output import Output, distance, duration

EXAMPLES = """
[bold]Examples[/bold]

wbf-mission plan --farm miniberry-100 --planner spiral --budget 25min --out spiral.plan

wbf-mission plan --farm waterberry --planner lawnmower --budget 8000m --out rows.waypoints

wbf-mission plan --farm my-farm.geojson --planner adaptive-lawnmower --json
"""


def plan_command(
    farm: options.Farm = None,
    planner: options.Planner = None,
    budget: options.Budget = None,
    scenario: options.ScenarioFile = None,
    seed: options.Seed = None,
    vehicle: options.Vehicle = None,
    autopilot: options.Autopilot = None,
    parameter: options.Parameter = None,
    altitude: options.Altitude = None,
    cruise_speed: options.CruiseSpeed = None,
    acceptance_radius: options.AcceptanceRadius = None,
    wind: options.Wind = None,
    wind_shear: options.WindShear = None,
    camera_spacing: options.CameraSpacing = None,
    camera_footprint: options.CameraFootprint = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Mission file: .plan (QGroundControl), .waypoints (WPL 110), .json (ours), .kml, .geojson.",
            rich_help_panel="Output",
            show_default=False,
        ),
    ] = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Plan a mission within a budget and say what it takes: length, time, coverage, battery."""
    from mission.files import write_mission, writer_for
    from wbf_mission.planning import plan
    from wbf_mission.scenario import Scenario, load_scenario, scenario_with

    output = Output(as_json=json, quiet=quiet)
    if out is not None:
        writer_for(out)
    base = load_scenario(scenario) if scenario else Scenario()
    chosen = scenario_with(
        base,
        {
            "farm": farm,
            "planner": planner,
            "budget": budget,
            "seed": seed,
            "vehicle": vehicle,
            "autopilot": autopilot,
            "parameters": options.parameter_values(parameter),
            "altitude_m": altitude,
            "cruise_speed_m_s": cruise_speed,
            "acceptance_radius_m": acceptance_radius,
            "camera_spacing_m": camera_spacing,
            "camera_footprint": camera_footprint,
            **options.wind_values(wind),
            **options.shear_values(wind_shear),
        },
    )
    with output.progress() as progress:
        progress("planning", 0, 1)
        result = plan(chosen)
    for warning in result.warnings:
        output.warn(warning)
    if out is not None:
        write_mission(result.mission, out)
    values = {**result.summary(), "file": str(out) if out else None}
    battery = "none" if result.battery_used is None else f"{result.battery_used:.1%}"
    rows = {
        "farm": result.farm.name,
        "planner": chosen.planner,
        "vehicle": chosen.vehicle,
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
