"""Files that a command is about to write: never over what it reads, never over something else by mistake."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from geo.errors import WbfMissionError
from wbf_mission.cli import options

__all__ = ["MISSION_SUFFIXES", "Force", "Overwrite", "TargetError", "refuse_overwrite"]

MISSION_SUFFIXES = (".plan", ".waypoints", ".wpl", ".kml")
"""Of files that hold nothing but missions; a .json, .txt or .geojson may hold anything."""

Overwrite = Annotated[
    bool,
    typer.Option(
        "--overwrite",
        help="Replace an existing file of any kind, not only of ours.",
        rich_help_panel=options.OUTPUT_PANEL,
    ),
]
"""Replaces files that are there; `Force` does not."""
Force = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Go on in spite of errors that the preflight check finds.",
        rich_help_panel=options.CHECK_PANEL,
    ),
]
"""Does what has errors; `Overwrite` does not."""


class TargetError(WbfMissionError, ValueError):
    """An output that would destroy a file, or that cannot be one."""


def refuse_overwrite(
    out: Path | None,
    inputs: Iterable[str | Path | None] = (),
    *,
    suffixes: tuple[str, ...] = (),
    overwrite: bool = False,
) -> None:
    """Raise TargetError if an output is one of the inputs, a file of another kind, a folder, or in no folder.

    Inputs that are no files are passed over. An existing file with another suffix than the command's (in
    lower case, if there are any) is somebody else's, and only replaced with `overwrite`; an input never is.

    >>> refuse_overwrite(Path("/dev/null"), ["miniberry-30", None])
    """
    if out is None:
        return
    if out.is_dir():
        msg = f"{out}: is a folder; give the name of a file"
        raise TargetError(msg)
    if not out.parent.is_dir():
        msg = f"{out}: there is no folder {out.parent}; make it, or give another name"
        raise TargetError(msg)
    if not out.exists():
        return
    for given in inputs:
        if given is not None and Path(given).exists() and out.samefile(given):
            msg = f"{out}: this is the file that is read; give another name for the output"
            raise TargetError(msg)
    if not overwrite and suffixes and out.is_file() and out.suffix.lower() not in suffixes:
        kinds = " or ".join(one for one in suffixes if one)
        msg = f"{out}: a file that is already there and is no {kinds}; give another name, or --overwrite"
        raise TargetError(msg)
