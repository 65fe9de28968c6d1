"""Reading and writing mission files; the ending of the name chooses the format.

Packages bring further formats by entry points of the group ``wbf_mission.mission_formats``; an entry is a
list of `MissionFormat`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from geo.atomic import atomic_write
from geo.imports import entry_points, load_entry
from geo.reading import UnreadableError, read_file
from geo.texts import one_line
from mission.errors import MissionFileError
from mission.files import native, plan, points, waypoints
from mission.files.common import MAX_BYTES, Firmware, WithNotes, wrong_kind
from mission.files.comparison import Loss, differences
from mission.files.drawn import Drawing
from mission.model import Mission

Loads: TypeAlias = Callable[[bytes], Mission | WithNotes | Drawing]
Dumps: TypeAlias = Callable[[Mission, Firmware], str | bytes]


@dataclass(frozen=True, slots=True)
class MissionFormat:
    """A file format.

    Parameters
    ----------
    name : str
        As a person would call it.
    suffixes : tuple of str
        In lower case, with the dot; the first is the usual one.
    loads : callable or None
        Makes a mission, perhaps with notes, or a drawing from the content of a file; None if the format is
        only written.
    dumps : callable or None
        Makes the content of a file from a mission and a firmware; None if the format is only read.
    hold : callable or None
        Returns the part of a mission that one file can hold; None if that is all of it.
    losses : callable or None
        Returns the losses of a mission, for a format that is only written.
    """

    name: str
    suffixes: tuple[str, ...]
    loads: Loads | None = None
    dumps: Dumps | None = None
    hold: Callable[[Mission], Mission] | None = None
    losses: Callable[[Mission], Sequence[Loss]] | None = None


ENTRY_POINT_GROUP = "wbf_mission.mission_formats"
_CORE = (
    MissionFormat("QGroundControl plan", (".plan",), plan.loads, plan.dumps),
    MissionFormat(
        "QGC WPL 110", (".waypoints", ".wpl", ".txt"), waypoints.loads, waypoints.dumps, waypoints.one_plan
    ),
    MissionFormat("fence or rally text", (".fen", ".ral"), points.loads),
    MissionFormat("wbf-mission JSON", (".json",), native.loads, native.dumps),
)
_FARM = "this is a farm file, no mission; plan a flight over it (wbf-mission plan --farm FILE)"
_FOREIGN = dict.fromkeys((".poly", ".shp", ".zip", ".gpkg", ".ndjson", ".jsonl"), _FARM)
"""Advice for files that are no missions, by their ending."""
_OLD = ".mission"


def _refuse(data: bytes) -> Mission:
    """Name the kind of a file that may be a mission of QGroundControl 3."""
    raise wrong_kind(data, "a mission of a kind that is read")


def mission_formats() -> tuple[MissionFormat, ...]:
    """Return the formats of the core, then those of installed packages.

    >>> [mission_format.suffixes[0] for mission_format in mission_formats()][:4]
    ['.plan', '.waypoints', '.fen', '.json']
    """
    return tuple(dict.fromkeys(_known().values()))


def _known(*, strict: bool = False) -> dict[str, MissionFormat]:
    """Return all formats by suffix; a package that cannot be loaded is left out, or an error if strict."""
    formats = list(_CORE)
    for entry in entry_points(ENTRY_POINT_GROUP):
        try:
            formats += load_entry(entry, f"the mission formats of {entry.name}", MissionFileError)
        except MissionFileError:
            if strict:
                raise
    known: dict[str, MissionFormat] = {}
    for mission_format in formats:
        for suffix in mission_format.suffixes:
            known.setdefault(suffix.lower(), mission_format)
    return known


def ending(path: str | os.PathLike[str]) -> str:
    """Return the ending of a name that chooses its format, in lower case.

    >>> ending("field.PLAN"), ending("my.field.wpml.kmz"), ending("field.doc")
    ('.plan', '.wpml.kmz', '.doc')
    """
    name = Path(path).name.lower()
    known = [suffix for suffix in _known() if name.endswith(suffix) and name != suffix]
    return max(known, key=len, default=Path(name).suffix)


def _found(path: str | os.PathLike[str], *, writing: bool) -> MissionFormat:
    """Return the format of a file's name, or raise MissionFileError where it is not read or not written."""
    suffix = ending(path)
    found = _known().get(suffix)
    if found is None or (found.dumps if writing else found.loads) is None:
        *suffixes, last = (
            name for name, known in _known(strict=True).items() if (known.dumps if writing else known.loads)
        )
        does, ways = ("writer", "written to") if writing else ("reader", "read from")
        problem = f"no {does} for {found.name} files" if found else f"unknown suffix {suffix!r}"
        msg = f"{path}: {problem}; missions are {ways} {', '.join(suffixes)} or {last}"
        if not writing and suffix in _FOREIGN:
            msg = f"{path}: {_FOREIGN[suffix]}"
        raise MissionFileError(one_line(msg))
    return found


def reader_for(path: str | os.PathLike[str]) -> Loads:
    """Return the function that reads files of this name, or raise MissionFileError."""
    if ending(path) == _OLD:
        return _refuse
    loads = _found(path, writing=False).loads
    assert loads is not None
    return loads


def writer_for(path: str | os.PathLike[str]) -> Dumps:
    """Return the function that writes files of this name, or raise MissionFileError."""
    dumps = _found(path, writing=True).dumps
    assert dumps is not None
    return dumps


def read_mission(
    path: str | os.PathLike[str], *, altitude_m: float | None = None, drawn_path: str | None = None
) -> Mission:
    """Read a mission file, or make a mission of a path that somebody has drawn or recorded.

    Parameters
    ----------
    path : path-like
        ``.plan`` (QGroundControl), ``.waypoints``, ``.wpl``, ``.txt`` (QGC WPL 110), ``.json`` (ours), or a
        suffix of another of the `mission_formats`.
    altitude_m : float or None
        Metres above home of the waypoints of a drawn path, in place of what the file says.
    drawn_path : str or None
        Name of a drawn path, for a file that holds several.

    Returns
    -------
    Mission
        Of a drawn path waypoints only: no take-off, no landing, no home.

    Raises
    ------
    MissionFileError
        If the file cannot be read, is larger than 64 MiB, is no mission of that kind, or holds impossible
        values. The message is one line with the file, the line or item, what is wrong, and what to do.
    """
    return open_mission(path, altitude_m=altitude_m, drawn_path=drawn_path)[0]


def open_mission(
    path: str | os.PathLike[str], *, altitude_m: float | None = None, drawn_path: str | None = None
) -> tuple[Mission, list[str]]:
    """Read a mission file as `read_mission` does; return it with notes on how it was understood."""
    loads = reader_for(path)
    try:
        found = loads(read_file(Path(path), MAX_BYTES))
        if isinstance(found, Drawing):
            return found.mission(altitude_m, drawn_path)
        notes = list(found.notes) if isinstance(found, WithNotes) else []
        found = found.mission if isinstance(found, WithNotes) else found
    except UnreadableError as error:
        raise MissionFileError(one_line(f"{path}: cannot be read as a mission: {error}")) from error
    except MissionFileError as error:
        raise MissionFileError(one_line(f"{path}: {error}")) from None
    if altitude_m is not None or drawn_path is not None:
        msg = f"{path}: this is a mission, which has altitudes and one path; leave --altitude and --path out"
        raise MissionFileError(one_line(msg))
    return found, notes


def losses(
    mission: Mission, path: str | os.PathLike[str], *, firmware: Firmware = Firmware.PX4
) -> list[Loss]:
    """Return the losses of a mission in a file of this name.

    For a format that is also read, these are the differences to the mission that is read back; plans for
    which the file has no room (`fitted`) are among them.

    Raises
    ------
    MissionFileError
        If the format cannot hold the mission at all.

    Examples
    --------
    >>> [loss.text for loss in losses(Mission((), cruise_speed_m_s=9.0), "field.waypoints")]
    ['the speeds for estimates of time are not kept']
    """
    chosen = _found(path, writing=True)
    if chosen.losses is not None:
        return list(chosen.losses(mission))
    if chosen.loads is None or chosen.dumps is None:
        return []
    content = chosen.dumps(fitted(mission, path), firmware)
    back = chosen.loads(content.encode() if isinstance(content, str) else content)
    return differences(mission, back) if isinstance(back, Mission) else []


def fitted(mission: Mission, path: str | os.PathLike[str]) -> Mission:
    """Return the part of a mission that one file of this name can hold."""
    hold = _found(path, writing=True).hold
    return mission if hold is None else hold(mission)


def write_mission(
    mission: Mission, path: str | os.PathLike[str], *, firmware: Firmware = Firmware.PX4
) -> None:
    """Write a mission file; an older file of that name is replaced only when the new one is complete.

    Parameters
    ----------
    mission : Mission
    path : path-like
        ``.plan``, ``.waypoints``, ``.wpl``, ``.txt``, ``.json``, or a suffix of other `mission_formats`.
    firmware : Firmware
        The autopilot that will fly a ``.plan`` or waypoint list.

    Raises
    ------
    MissionFileError
        If the suffix is unknown, the format cannot hold the mission, or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from mission.model import MissionItem
    >>> mission = Mission((MissionItem.waypoint(28.05, -82.15, 10.0),))
    >>> path = Path(tempfile.mkdtemp()) / "short.json"
    >>> write_mission(mission, path)
    >>> read_mission(path) == mission
    True
    """
    dumps = writer_for(path)
    try:
        content = dumps(mission, firmware)
        with atomic_write(path, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise MissionFileError(one_line(f"{path}: cannot be written: {reason}")) from error
