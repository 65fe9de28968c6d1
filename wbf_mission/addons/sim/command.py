"""``wbf-mission sim``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from geo.texts import duration
from mission.outcome import in_words
from wbf_mission.addons.sim.options import LINKS, SimOptions, load_sim, parse_speed
from wbf_mission.cli import options, signals
from wbf_mission.cli.command import Command, provided
from wbf_mission.cli.live import LivePage
from wbf_mission.cli.options import Overwrite, option, refuse_overwrite
from wbf_mission.cli.output import Output
from wbf_mission.events import RunEnded
from wbf_mission.exit_codes import ExitCode
from wbf_mission.scenario import CameraOptions, ScenarioError
from wbf_mission.scenario.option import options_of
from wbf_mission.scenario.parts import CAMERA_OF_PLANS

if TYPE_CHECKING:
    from mission.link.codec.signing import Signing
    from wbf_mission.addons.base.pages import FollowedSimulation
    from wbf_mission.addons.base.simulator import Simulated

_SHOWN_LINKS = 8

EXAMPLES = """
Examples
wbf-mission sim --farm waterberry
wbf-mission sim --autopilot ardupilot --count 3 --speed 10
wbf-mission sim --listen tcpin:127.0.0.1:5760 --listen udpout:127.0.0.1:14550 --tlog flight.tlog
wbf-mission sim --count 3 --live 0 --open --control
wbf-mission sim --fault loss=0.2 --fault gps-loss,at=airborne,from=20,for=10
"""
BEGINNERS = (
    *("--farm", "--vehicle", "--autopilot", "--count", "--home", "--wind"),
    *("--listen", "--speed", "--fault", "--live", "--seed", "--tlog"),
)


@options.scenario_options(
    *("farm", "vehicle", "weather", "camera"),
    without=(
        "days",
        "flights_per_day",
        "vehicles",
        "separation",
        "radio_range_m",
        "camera_spacing_m",
        *CAMERA_OF_PLANS,
    ),
    more=(SimOptions,),
)
@options.speaks()
@options.gives("page", LivePage)
def sim_command(
    given: options.Given,
    output: Output,
    *,
    page: LivePage,
    signing_key: Annotated[
        str | None,
        option(
            "MAVLink signing key: 64 hexadecimal digits, a phrase, or @FILE with the key; the vehicles"
            " sign their messages, and accept only messages signed with this key.",
            panel=LINKS,
            envvar="WBF_MISSION_SIGNING_KEY",
            show_envvar=True,
        ),
    ] = None,
    fault: Annotated[
        list[str] | None,
        option(
            "Fault to simulate: KIND[=VALUE][,from=S][,for=S][,at=EVENT][,...]; may be repeated;"
            " --list-faults lists the kinds.",
            panel="Faults",
            metavar="TEXT",
        ),
    ] = None,
    list_faults: Annotated[
        bool, option("List the kinds of faults.", "--list-faults", panel="Faults")
    ] = False,
    tlog: Annotated[
        Path | None,
        option("Telemetry log (.tlog) of all frames; an existing .tlog is replaced.", panel="Output"),
    ] = None,
    overwrite: Overwrite = False,
    ready_file: Annotated[
        Path | None,
        option(
            "File for the links, one per line; written once the links can be used, removed at the end.",
            panel="Output",
        ),
    ] = None,
) -> int:
    """Run simulated vehicles with leaf cameras on UDP, TCP or serial lines, for ground stations and programs.

    Links use the loopback interface unless their address says otherwise. Stop the simulator with Ctrl-C or
    SIGTERM: the vehicles then send a last HEARTBEAT with the state POWEROFF, and the log is complete.
    """
    from geo.atomic import atomic_write
    from mission.link.tlog import TlogWriter
    from sim_vehicle.execution.state import EPOCH_UNIX_S
    from sim_vehicle.host.injection import fault_part, injection
    from sim_vehicle.host.server import Server
    from wbf_mission.addons.base.simulator import make_components, parse_home
    from wbf_mission.scenario import Scenario

    if list_faults:
        fault_part("kinds")(output)
        return ExitCode.GOOD
    base, in_file, planned = (Scenario(), SimOptions(), ()) if given.file is None else load_sim(given.file)
    injected = injection([*planned, *(fault or ())])
    chosen = replace(in_file, **given.others)
    with_camera = _with_camera(given, chosen.camera)
    scenario = given.change(base)
    inputs = [given.file, scenario.farm.name, scenario.vehicle.name]
    refuse_overwrite(tlog, inputs, suffixes=(".tlog",), overwrite=overwrite)
    refuse_overwrite(ready_file, [*inputs, tlog], suffixes=("", ".ready", ".txt"), overwrite=overwrite)
    homes = [parse_home(text) for text in chosen.home]
    count = chosen.count or len(homes) or 1
    injected.require_vehicles(range(chosen.system_id, chosen.system_id + count))
    with output.progress() as progress:
        simulated = make_components(
            scenario,
            count=chosen.count,
            homes=homes,
            spacing_m=chosen.spacing_m,
            first_system=chosen.system_id,
            with_camera=with_camera,
            cold=chosen.boot == "cold",
            sitl_rates=chosen.rates == "sitl",
            progress=progress,
        )
    output.notes(simulated.farm.notes, "farm")
    cleanup = ExitStack()
    log: TlogWriter | None = None

    def tap(frame: bytes, now_s: float) -> None:
        if log is not None:
            log.write(frame, EPOCH_UNIX_S + now_s)

    try:
        orders = page.orders(output)
        followed: FollowedSimulation | None = None
        if page.wanted:
            followed = provided("live.simulation")(simulated, scenario, output.events, orders)
        with (
            page.serve(output, output.events, orders),
            Server(
                [*simulated.components, *(() if followed is None else followed.components)],
                [*chosen.listen, *chosen.connect] or simulated.fleet.urls,
                speed=parse_speed(chosen.speed),
                tap=None if tlog is None else tap,
                faults=injected.faults,
                seed=scenario.seed,
                signing=_signing(signing_key),
            ) as server,
        ):
            if tlog is not None:
                # The log is opened only now, so that a failed start leaves an older log unchanged.
                log = TlogWriter(tlog)
                cleanup.callback(log.close)
            output.note(_greeting(simulated, scenario.vehicle.name, server.urls))
            for wrong in injected.faults:
                output.note(f"fault: {wrong}")
            if ready_file is not None:
                with atomic_write(ready_file) as file:
                    file.writelines(f"{url}\n" for url in server.urls)
                cleanup.callback(ready_file.unlink, missing_ok=True)
            limit_s = math.inf if chosen.duration_s is None else chosen.duration_s
            stopped = server.run(until=None if followed is None else followed.begin(), limit_s=limit_s)
            seconds = server.now_s
            output.events.tell(RunEnded(seconds, stopped.value, ""))
    finally:
        cleanup.close()
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
        "pictures": simulated.images,
        "urls": list(server.urls),
        "tlog": str(tlog) if tlog else None,
    }
    output.result(values, _rows(simulated, values), title="Simulator stopped")
    code = signals.exit_code(ExitCode.GOOD)
    return ExitCode.GOOD if code == ExitCode.INTERRUPTED else code  # Ctrl-C is the normal way to end `sim`


def _with_camera(given: options.Given, chosen: bool | None) -> bool | None:
    """Return whether vehicles carry a camera (None: as the autopilot does); camera options imply a camera."""
    defined = options_of(CameraOptions).values()
    asked = next((option.flag for option in defined if option.key in given.changes), None)
    if chosen is False and asked is not None:
        msg = f"{asked} has no effect without the camera: leave out {asked} or --no-camera"
        raise ScenarioError(msg)
    return chosen if asked is None else True


def _rows(simulated: Simulated, values: Mapping[str, Any]) -> dict[str, str]:
    """Return the rows of the result's table."""
    rows = {
        "simulated time": duration(values["simulated_s"]),
        "end": values["stopped"],
        "images": f"{values['pictures']:,}",
        "links": "\n".join(_some(values["urls"])),
        "log": values["tlog"] or "not written (give --tlog FILE)",
    }
    for vehicle in simulated.vehicles:
        rows[f"vehicle {vehicle.system_id}"] = in_words(vehicle.outcome, vehicle.outcome_text)
    return rows


def _some(urls: Sequence[str]) -> list[str]:
    """Return the links; if there are many, the first links and the number of further links."""
    return list(urls) if len(urls) <= _SHOWN_LINKS else [*urls[:7], f"{len(urls) - 7} more"]


def _signing(key: str | None) -> Signing | None:
    """Return the message signing for a key given on the command line; None without a key."""
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


def _greeting(simulated: Simulated, vehicle: str, urls: tuple[str, ...]) -> str:
    point, number = simulated.vehicle.home, len(simulated.vehicles)
    several = f"{number} x " if number > 1 else ""
    where = f"{point.latitude_deg:.6f}, {point.longitude_deg:.6f}"
    who = f"{several}{vehicle} as {simulated.fleet.autopilot.name} at {where}"
    return f"{who} on {', '.join(_some(urls))}; Ctrl-C ends it"


COMMAND = Command(sim_command, EXAMPLES, BEGINNERS)
