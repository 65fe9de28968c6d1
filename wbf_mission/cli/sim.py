"""``wbf-mission sim``."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wbf_mission.cli import options
from wbf_mission.cli.output import Output

if TYPE_CHECKING:
    from mission.link.codec.signing import Signing
    from mission.link.tlog import TlogWriter
    from wbf_mission.simulator import Simulated

EXAMPLES = """
[bold]Examples[/bold]

wbf-mission sim --farm waterberry

wbf-mission sim --autopilot ardupilot --count 3 --speed 10

wbf-mission sim --listen tcpin:127.0.0.1:5760 --listen udpout:127.0.0.1:14550 --tlog flight.tlog

wbf-mission sim --fault loss=0.2 --fault gps-loss,at=airborne,from=20,for=10
"""
_LINKS = "Links and time"
_VEHICLE = "Vehicle and weather"


def sim_command(
    scenario_file: options.ScenarioFile = None,
    farm: options.Farm = None,
    vehicle: options.Vehicle = None,
    autopilot: options.Autopilot = None,
    parameter: options.Parameter = None,
    count: Annotated[
        int | None,
        typer.Option(
            help="How many vehicles, systems 1 to N, each at its own ports.  [default: one for each home]",
            rich_help_panel=_VEHICLE,
        ),
    ] = None,
    listen: Annotated[
        list[str] | None,
        typer.Option(
            help="Link for ground stations, with all vehicles behind it; may be repeated: udpin:, udpout: or"
            " tcpin:HOST:PORT, serial:DEVICE:BAUD.  [default: the autopilot's own simulator ports]",
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
        str | None,
        typer.Option(
            help="Simulated seconds per second of wall time, or max.  [default: 1]", rich_help_panel=_LINKS
        ),
    ] = None,
    signing_key: Annotated[
        str | None,
        typer.Option(
            envvar="WBF_MISSION_SIGNING_KEY",
            help="Hear only who signs with this key, and sign: 64 hexadecimal digits, a phrase, or @FILE that"
            " holds one.",
            rich_help_panel=_LINKS,
            show_default=False,
            show_envvar=True,
        ),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(
            help="Stop after so many simulated seconds.  [default: until Ctrl-C]", rich_help_panel=_LINKS
        ),
    ] = None,
    home: Annotated[
        list[str] | None,
        typer.Option(
            help="Start at LAT,LON[,ALT[,HEADING]]: degrees, metres above sea level, degrees; once for all or"
            " once for each vehicle.  [default: the farm's home]",
            rich_help_panel=_VEHICLE,
        ),
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option(help="Between vehicles that share a home, m.  [default: 4]", rich_help_panel=_VEHICLE),
    ] = None,
    wind: options.Wind = None,
    wind_shear: options.WindShear = None,
    turbulence: options.Turbulence = None,
    gps_noise: options.GpsNoise = None,
    baro_noise: options.BaroNoise = None,
    seed: options.Seed = None,
    day: options.Day = None,
    camera: Annotated[
        bool | None,
        typer.Option("--camera/--no-camera", help="Carry the leaf camera.", rich_help_panel="Leaf camera"),
    ] = None,
    camera_footprint: options.CameraFootprint = None,
    camera_noise: options.CameraNoise = None,
    false_positive_rate: options.FalsePositives = None,
    false_negative_rate: options.FalseNegatives = None,
    camera_fields: options.CameraFields = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            help="What goes wrong: KIND[=VALUE][,from=S][,for=S][,at=EVENT][,...], may be repeated; see"
            " --list-faults.",
            rich_help_panel="Faults",
        ),
    ] = None,
    list_faults: Annotated[
        bool, typer.Option("--list-faults", help="List the kinds of faults.", rich_help_panel="Faults")
    ] = False,
    tlog: Annotated[
        Path | None, typer.Option(help="Log every frame there.", rich_help_panel="Output", show_default=False)
    ] = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Run simulated vehicles with leaf cameras on UDP, TCP or serial lines, for ground stations and programs.

    It binds to loopback unless a link says otherwise. End it with Ctrl-C.
    """
    from sim_vehicle.faults.fault import parse_fault
    from sim_vehicle.host.server import Server
    from wbf_mission.scenario import Scenario, scenario_with
    from wbf_mission.sim_options import SimOptions, load_sim, parse_speed, sim_with
    from wbf_mission.simulator import make_components, parse_home

    output = Output(as_json=json, quiet=quiet)
    if list_faults:
        _list_faults(output)
        return
    base, given, planned = (
        (Scenario(), SimOptions(), ()) if scenario_file is None else load_sim(scenario_file)
    )
    faults = [*planned, *(parse_fault(text) for text in fault or ())]
    chosen = sim_with(
        given,
        {
            "count": count,
            "home": tuple(home or ()),
            "spacing_m": spacing,
            "listen": tuple(listen or ()),
            "connect": tuple(connect or ()),
            "speed": speed,
            "duration_s": duration,
            "camera": camera,
        },
    )
    scenario = scenario_with(
        base,
        {
            "farm": farm,
            "vehicle": vehicle,
            "autopilot": autopilot,
            "parameters": options.parameter_values(parameter),
            "seed": seed,
            "day": day,
            "camera_footprint": camera_footprint,
            "camera_noise": camera_noise,
            "false_positive_rate": false_positive_rate,
            "false_negative_rate": false_negative_rate,
            "camera_fields": options.field_names(camera_fields),
            "turbulence": options.turbulence_value(turbulence),
            "gps_noise_m": gps_noise,
            "baro_noise_m": baro_noise,
            **options.wind_values(wind),
            **options.shear_values(wind_shear),
        },
    )
    homes = [parse_home(text) for text in chosen.home]
    with output.progress() as progress:
        simulated = make_components(
            scenario,
            count=chosen.count,
            homes=homes,
            spacing_m=chosen.spacing_m,
            with_camera=chosen.camera,
            progress=progress,
        )
    log, tap = _log(tlog)
    try:
        with Server(
            simulated.components,
            [*chosen.listen, *chosen.connect] or simulated.fleet.urls,
            speed=parse_speed(chosen.speed),
            tap=tap,
            faults=faults,
            seed=scenario.seed,
            signing=_signing(signing_key),
        ) as server:
            output.note(_greeting(simulated, scenario.vehicle, server.urls))
            for wrong in faults:
                output.note(f"fault: {wrong}")
            stopped = server.run(limit_s=math.inf if chosen.duration_s is None else chosen.duration_s)
            seconds = server.now_s
    finally:
        if log is not None:
            log.close()
    first = simulated.vehicle
    values = {
        "simulated_s": seconds,
        "stopped": stopped.value,
        "outcome": first.outcome.value,
        "outcome_text": first.outcome_text,
        "vehicles": [
            {"system": v.system_id, "outcome": v.outcome.value, "outcome_text": v.outcome_text}
            for v in simulated.vehicles
        ],
        "pictures": simulated.pictures,
        "urls": list(server.urls),
        "tlog": str(tlog) if tlog else None,
    }
    rows = {key: str(value) for key, value in values.items() if key != "vehicles"}
    for one in simulated.vehicles[1:]:
        rows[f"vehicle {one.system_id}"] = f"{one.outcome.value} {one.outcome_text}".strip()
    output.result(values, rows, title="Simulator stopped")


def _signing(key: str | None) -> Signing | None:
    """Return what signs with a key as it was typed, None without one."""
    if key is None:
        return None
    import time

    from geo.reading import UnreadableError, read_text
    from mission.errors import LinkError
    from mission.link.codec.signing import Signing, key_from_text

    if key.startswith("@"):
        try:
            key = read_text(Path(key[1:]))
        except UnreadableError as error:
            msg = f"signing key: {key[1:]} cannot be read: {error}"
            raise LinkError(msg) from error
    return Signing(key_from_text(key), clock=time.time)


def _log(path: Path | None) -> tuple[TlogWriter | None, Callable[[bytes, float], None] | None]:
    """Open the log, and return it with what writes a frame into it."""
    if path is None:
        return None, None
    from mission.link.tlog import TlogWriter
    from wbf_mission.flight import EPOCH_UNIX_S

    log = TlogWriter(path)
    write = log.write

    def tap(frame: bytes, now_s: float) -> None:
        write(frame, EPOCH_UNIX_S + now_s)

    return log, tap


def _greeting(simulated: Simulated, vehicle: str, urls: tuple[str, ...]) -> str:
    point = simulated.vehicle.home
    number = len(simulated.vehicles)
    who = (
        f"{vehicle} as {simulated.autopilot}"
        if number == 1
        else f"{number} x {vehicle} as {simulated.autopilot}"
    )
    shown = urls if len(urls) <= 8 else (*urls[:7], f"{len(urls) - 7} more")
    return (
        f"{who} at {point.latitude_deg:.6f}, {point.longitude_deg:.6f} on {', '.join(shown)}; Ctrl-C ends it"
    )


def _list_faults(output: Output) -> None:
    from sim_vehicle.faults.fault import KINDS, TRIGGERS

    rows = [
        [name, kind.group, "" if kind.value == "none" else kind.value, kind.text]
        for name, kind in KINDS.items()
    ]
    values = [dict(zip(("kind", "group", "value", "text"), row, strict=True)) for row in rows]
    output.table(values, ["fault", "of", "value", "what it does"], rows, title="Faults", left=True)
    output.note(f"when: from=SECONDS, for=SECONDS, at={'|'.join(TRIGGERS)}")
    output.note("where: vehicle=SYSTEM, direction=up|down|both, link=NAME|NUMBER; how often: times=N")
