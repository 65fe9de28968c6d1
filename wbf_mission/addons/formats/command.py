"""Command ``wbf-mission convert``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import MISSION_SUFFIXES, Overwrite, option, refuse_overwrite
from wbf_mission.cli.output import Output, write_and_report

EXAMPLES = """
Examples
wbf-mission convert field.plan field.waypoints --autopilot ardupilot
wbf-mission convert field.plan field.wpml.kmz
wbf-mission convert "Google Earth.kml" field.plan --path "north side" --altitude 30
wbf-mission convert track.gpx track.plan --altitude 25 --json
"""


_READ = ".plan, .waypoints, .fen, .ral, .json, .kml, .kmz, .geojson, .gpx or .csv"


@options.speaks()
def convert_command(
    output: Output,
    source: Annotated[Path, typer.Argument(help=f"A mission or a drawn path: {_READ}.")],
    target: Annotated[Path, typer.Argument(help="File to write: one of these, or .wpml.kmz for DJI.")],
    autopilot: Annotated[
        Literal["px4", "ardupilot"],
        option("Autopilot for which a .plan or .waypoints file is written.", "--autopilot"),
    ] = "px4",
    altitude: Annotated[
        float | None,
        option("Height above home of waypoints from a drawn path, m.", "--altitude", parser=options.number),
    ] = None,
    path: Annotated[str | None, option("Name of the drawn path, if there are several.", "--path")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Convert a mission or a drawn path to another file format, and report losses."""
    from dataclasses import asdict, astuple

    from mission.files import Firmware, open_mission, writer_for
    from mission.model import Command

    refuse_overwrite(target, [source], suffixes=MISSION_SUFFIXES, overwrite=overwrite)
    writer_for(target)
    mission, notes = open_mission(source, altitude_m=altitude, drawn_path=path)
    firmware = Firmware[autopilot.upper()]
    kept, lost = write_and_report(output, mission, target, firmware)
    output.notes(notes)
    waypoints = sum(item.command == Command.NAV_WAYPOINT for item in kept.items)
    home = None if kept.home is None else astuple(kept.home)
    values = {
        "source": str(source),
        "file": str(target),
        "items": len(kept.items),
        "waypoints": waypoints,
        "fence": len(kept.fence),
        "rally": len(kept.rally),
        "home": home,
        "notes": notes,
        "losses": [asdict(loss) for loss in lost],
    }
    rows = {
        "items": f"{len(kept.items)} (waypoints: {waypoints})",
        "home": "unknown" if home is None else f"{home[0]:.7f}, {home[1]:.7f}, {home[2]:g} m above sea level",
        "fence items": str(len(kept.fence)),
        "rally points": str(len(kept.rally)),
        "losses": f"{len(lost)}, listed on stderr" if lost else "none",
        "file": str(target),
    }
    output.result(values, rows, title="Converted")


COMMAND = Command(convert_command, EXAMPLES)
