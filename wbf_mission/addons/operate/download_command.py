"""``wbf-mission download``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from geo.texts import duration
from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import MISSION_SUFFIXES, Overwrite, option, refuse_overwrite
from wbf_mission.cli.output import Output, write_and_report

EXAMPLES = """
Example
wbf-mission download --connect udpin:127.0.0.1:14550 --out onboard.plan
"""


@options.speaks()
def download_command(
    output: Output,
    out: Annotated[Path, option("Mission file to write: .plan, .waypoints, .json, .kml ...")],
    connect: options.Connect = "udpin:127.0.0.1:14550",
    system_id: options.SystemId = None,
    wait: options.Wait = 10.0,
    via: options.Via = "own",
    overwrite: Overwrite = False,
) -> None:
    """Download the mission, the fence and the rally points of a vehicle into a file."""
    from mission.files import Firmware, writer_for
    from mission.ground.link import download
    from wbf_mission.addons.base.links import via_named

    refuse_overwrite(out, suffixes=MISSION_SUFFIXES, overwrite=overwrite)
    writer_for(out)
    with output.progress() as progress:
        mission, report = download(
            connect,
            wait_s=wait,
            system_id=system_id,
            progress=progress,
            note=output.note,
            open_driver=via_named(via).driver,
        )
    firmware = Firmware(report.autopilot) if report.autopilot in set(Firmware) else Firmware.GENERIC
    write_and_report(output, mission, out, firmware)
    rows = {
        "vehicle": report.vehicle,
        **{name: f"{count} items" for name, count in report.items.items()},
        "time": duration(report.duration_s),
        "file": str(out),
    }
    values = report.summary()
    for of_uploads in ("verified", "accepted", "remarks", "texts"):
        del values[of_uploads]
    output.result({"file": str(out), **values}, rows, title="Downloaded")


COMMAND = Command(download_command, EXAMPLES)
