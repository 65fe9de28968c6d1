"""``wbf-mission upload`` and ``wbf-mission download``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wbf_mission.cli import options
from wbf_mission.cli.output import Output, duration
from wbf_mission.cli.targets import MISSION_SUFFIXES, Force, refuse_overwrite

_CONNECT_HELP = "Link to the vehicle: udpin:, udpout:, tcp: or tcpin:HOST:PORT, or serial:DEVICE:BAUD."
Connect = Annotated[str, typer.Option(help=_CONNECT_HELP)]


UPLOAD_EXAMPLES = """
Examples

wbf-mission upload spiral.plan --connect udpin:127.0.0.1:14550

wbf-mission upload rows.waypoints --connect tcp:127.0.0.1:5760 --via mavsdk
"""
DOWNLOAD_EXAMPLES = """
Example

wbf-mission download --connect udpin:127.0.0.1:14550 --out onboard.plan
"""


def upload_command(
    file: Annotated[Path, typer.Argument(help="Mission file: .plan, .waypoints or .json.")],
    connect: Connect = "udpin:127.0.0.1:14550",
    wait: options.Wait = 10.0,
    vehicle: Annotated[
        str | None,
        typer.Option(
            help="Vehicle that the plan is checked for: a name or a .toml file.  [default: a typical one of"
            " the kind that is heard]",
            autocompletion=options.complete("vehicle"),
            show_default=False,
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Send it though the preflight check finds errors.")
    ] = False,
    via: options.Via = "own",
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Check a mission file, upload it (mission, fence, rally points), download it again and compare."""
    from mission.files import read_mission
    from wbf_mission.cli.preflight import check_before_upload
    from wbf_mission.ground.link import upload
    from wbf_mission.live.via import via_named

    output = Output(as_json=json, quiet=quiet)
    mission = read_mission(file)
    checked = check_before_upload(output, mission, connect, vehicle=vehicle, wait_s=wait, force=force)
    with output.progress() as progress:
        report = upload(
            mission,
            connect,
            wait_s=wait,
            progress=progress,
            note=output.note,
            force=force,
            open_driver=via_named(via).driver,
        )
    rows = {
        "vehicle": f"system {report.system_id}, component {report.component_id}",
        **{name: f"{count} items, verified" for name, count in report.items.items()},
        "messages": f"{report.messages_sent} sent, {report.messages_received} received, "
        f"{report.retries} retries"
        if report.messages_sent
        else "not told by MAVSDK",
        "time": duration(report.duration_s),
    }
    findings = [finding.summary() for finding in checked.findings]
    output.result({"file": str(file), **report.summary(), "findings": findings}, rows, title="Uploaded")


def download_command(
    out: Annotated[Path, typer.Option(help="Mission file to write: .plan, .waypoints or .json.")],
    connect: Connect = "udpin:127.0.0.1:14550",
    wait: options.Wait = 10.0,
    via: options.Via = "own",
    force: Force = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Download the mission, the fence and the rally points of a vehicle into a file."""
    from mission.files import Firmware, write_mission, writer_for
    from wbf_mission.ground.link import download
    from wbf_mission.live.via import via_named

    output = Output(as_json=json, quiet=quiet)
    refuse_overwrite(out, suffixes=MISSION_SUFFIXES, force=force)
    writer_for(out)
    with output.progress() as progress:
        mission, report = download(
            connect, wait_s=wait, progress=progress, note=output.note, open_driver=via_named(via).driver
        )
    firmware = Firmware(report.autopilot) if report.autopilot in set(Firmware) else Firmware.GENERIC
    write_mission(mission, out, firmware=firmware)
    rows = {
        "vehicle": f"system {report.system_id}, component {report.component_id}",
        **{name: f"{count} items" for name, count in report.items.items()},
        "time": duration(report.duration_s),
        "file": str(out),
    }
    output.result({"file": str(out), **report.summary()}, rows, title="Downloaded")
