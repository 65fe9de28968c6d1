"""``wbf-mission sim``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from wbf_mission.cli import options
from wbf_mission.cli.output import Output

EXAMPLES = """
[bold]Examples[/bold]

wbf-mission sim --farm waterberry

wbf-mission sim --autopilot ardupilot --speed 10

wbf-mission sim --listen tcpin:127.0.0.1:5760 --listen udpout:127.0.0.1:14550 --tlog flight.tlog
"""
_LINKS = "Links and time"


def sim_command(
    farm: options.Farm = None,
    vehicle: options.Vehicle = None,
    autopilot: Annotated[
        str,
        typer.Option(
            help="px4 or ardupilot: whose ports, modes and habits.", rich_help_panel="Vehicle and weather"
        ),
    ] = "px4",
    listen: Annotated[
        list[str] | None,
        typer.Option(
            help="Link for ground stations, may be repeated: udpin:, udpout: or tcpin:HOST:PORT."
            "  [default: the autopilot's own simulator ports]",
            rich_help_panel=_LINKS,
        ),
    ] = None,
    connect: Annotated[
        list[str] | None,
        typer.Option(
            help="Link that we open: udpout:HOST:PORT or tcp:HOST:PORT; may be repeated.",
            rich_help_panel=_LINKS,
        ),
    ] = None,
    speed: Annotated[
        float, typer.Option(help="Simulated seconds per second of wall time.", rich_help_panel=_LINKS)
    ] = 1.0,
    duration: Annotated[
        float | None,
        typer.Option(
            help="Stop after so many simulated seconds.  [default: until Ctrl-C]", rich_help_panel=_LINKS
        ),
    ] = None,
    home: Annotated[
        str | None,
        typer.Option(
            help="Start at LAT,LON[,ALT[,HEADING]]: degrees, metres above sea level, degrees."
            "  [default: the farm's home]",
            rich_help_panel="Vehicle and weather",
        ),
    ] = None,
    wind: options.Wind = None,
    seed: options.Seed = None,
    day: options.Day = None,
    camera: Annotated[
        bool,
        typer.Option("--camera/--no-camera", help="Carry the leaf camera.", rich_help_panel="Leaf camera"),
    ] = True,
    camera_footprint: options.CameraFootprint = None,
    camera_noise: options.CameraNoise = None,
    false_positive_rate: options.FalsePositives = None,
    false_negative_rate: options.FalseNegatives = None,
    camera_fields: options.CameraFields = None,
    tlog: Annotated[
        Path | None, typer.Option(help="Log every frame there.", rich_help_panel="Output", show_default=False)
    ] = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Run the simulated vehicle with its leaf camera on UDP or TCP, for ground stations and MAVLink programs.

    It binds to loopback unless a link says otherwise. End it with Ctrl-C.
    """
    from sim_vehicle.server import Server, default_urls
    from wbf_mission.planning import wind_of
    from wbf_mission.scenario import Scenario, ScenarioError, scenario_with
    from wbf_mission.simulator import make_components, parse_home

    output = Output(as_json=json, quiet=quiet)
    if not (math.isfinite(speed) and 0.01 <= speed <= 1000.0):
        msg = f"--speed {speed} is out of range: give 0.01 to 1000 simulated seconds per second"
        raise ScenarioError(msg)
    if duration is not None and not 0.0 < duration < 1e9:
        msg = f"--duration {duration} is out of range: give a positive number of simulated seconds"
        raise ScenarioError(msg)
    scenario = scenario_with(
        Scenario(),
        {
            "farm": farm,
            "vehicle": vehicle,
            "seed": seed,
            "day": day,
            "camera_footprint": camera_footprint,
            "camera_noise": camera_noise,
            "false_positive_rate": false_positive_rate,
            "false_negative_rate": false_negative_rate,
            "camera_fields": options.field_names(camera_fields),
            **options.wind_values(wind),
        },
    )
    place = None if home is None else parse_home(home)
    with output.progress() as progress:
        simulated = make_components(
            scenario,
            autopilot=autopilot,
            home=place,
            wind=wind_of(scenario),
            with_camera=camera,
            progress=progress,
        )
    urls = [*(listen or []), *(connect or [])] or list(default_urls(simulated.autopilot))
    log = None
    tap = None
    if tlog is not None:
        from mission.link.tlog import TlogWriter
        from wbf_mission.flight import EPOCH_UNIX_S

        log = TlogWriter(tlog)
        write = log.write

        def tap(frame: bytes, now_s: float) -> None:
            write(frame, EPOCH_UNIX_S + now_s)

    try:
        with Server(simulated.components, urls, speed=speed, tap=tap) as server:
            point = simulated.home
            output.note(
                f"{scenario.vehicle} as {simulated.autopilot} "
                f"at {point.latitude_deg:.6f}, {point.longitude_deg:.6f} "
                f"on {', '.join(server.urls)}; Ctrl-C ends it"
            )
            stopped = server.run(limit_s=math.inf if duration is None else duration)
            seconds = server.now_s
    finally:
        if log is not None:
            log.close()
    state = simulated.vehicle.outcome.value
    values = {
        "simulated_s": seconds,
        "stopped": stopped.value,
        "outcome": state,
        "outcome_text": simulated.vehicle.outcome_text,
        "pictures": simulated.pictures,
        "urls": list(server.urls),
        "tlog": str(tlog) if tlog else None,
    }
    output.result(values, title="Simulator stopped")
