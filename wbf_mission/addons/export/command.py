"""``wbf-mission export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from wbf_mission.cli import options
from wbf_mission.cli.command import Command
from wbf_mission.cli.options import OUTPUT_PANEL, Overwrite, TargetError, option, refuse_overwrite
from wbf_mission.cli.output import Output

EXAMPLES = """
Examples
wbf-mission export runs/mine --to mcap
wbf-mission export runs/mine --to kml --out flight.kml
wbf-mission export runs/mine --to geojson --overwrite --json
"""

_ESTIMATES = 20
To = Literal["mcap", "rerun", "gpx", "kml", "geojson", "csv"]


@options.speaks()
def export_command(
    output: Output,
    folder: Annotated[Path, typer.Argument(help="Folder of a finished run.", metavar="DIR")],
    to: Annotated[To, option("Format of the file.", "--to")],
    out: Annotated[
        Path | None,
        option("File to write.  [default: beside DIR, with the same name]", "--out", panel=OUTPUT_PANEL),
    ] = None,
    estimates: Annotated[
        int | None,
        option(
            "Approximate number of moments for which the estimate is recomputed and shown; 0 shows only the"
            " estimate at the end.  [default: 20]",
            "--estimates",
            parser=options.whole_number_in(0, 1000),
        ),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Export a finished run to a file for another tool: Foxglove, Rerun, Google Earth or a GIS."""
    from wbf_mission.addons.export.formats import FORMATS, export
    from wbf_mission.results.result import load_result

    chosen = FORMATS[to]
    if estimates is not None and not chosen.shows_estimates:
        shown = " or ".join(name for name, known in FORMATS.items() if known.shows_estimates)
        raise TargetError(f"--estimates has an effect only with --to {shown}: leave it out")
    path = out or folder.resolve().with_name(folder.resolve().name + chosen.suffix)
    log = folder / "flight.tlog"
    for file in chosen.files(path):
        refuse_overwrite(file, [log])
        if file.is_file() and not overwrite:
            raise TargetError(f"{file}: already exists; give another name (--out), or --overwrite")
    result = load_result(folder, probabilities=False, lazy=True)
    with output.progress() as progress:
        files = export(
            result,
            path,
            to,
            estimates=_ESTIMATES if estimates is None else estimates,
            log=log if log.is_file() else None,
            progress=progress,
        )
    values = {"folder": str(folder), "format": to, "files": [str(file) for file in files]}
    rows = {"format": f"{to} ({chosen.what})", "files": ", ".join(map(str, files))}
    output.result(values, rows, title="Exported")


COMMAND = Command(export_command, EXAMPLES)
