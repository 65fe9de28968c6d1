"""Readers and writers of mission files; the suffix of the file name chooses the format.

Packages add formats by entry points of the group ``wbf_mission.mission_formats``. An entry point names a list
of `MissionFormat`.
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
    """A format of mission files.

    Parameters
    ----------
    name : str
        Name for messages.
    suffixes : tuple of str
        Suffixes in lower case, with the dot; the first is the usual suffix.
    loads : callable or None
        Function from the content of a file to a mission, a mission with notes, or a drawing; None if the
        format cannot be read.
    dumps : callable or None
        Function from a mission and a firmware to the content of a file; None if the format cannot be written.
    hold : callable or None
        Function that returns the part of a mission that one file can hold; None if a file holds all parts.
    losses : callable or None
        Function that returns the losses of a mission, for a format that cannot be read back.
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
"""Advice for files without missions, by suffix."""
_OLD = ".mission"


def _refuse(data: bytes) -> Mission:
    """Raise MissionFileError for a .mission file (QGroundControl 3), which cannot be read."""
    raise wrong_kind(data, "a mission of a kind that is read")


def mission_formats() -> tuple[MissionFormat, ...]:
    """Return the formats of the core, then those of installed packages.

    >>> [mission_format.suffixes[0] for mission_format in mission_formats()][:4]
    ['.plan', '.waypoints', '.fen', '.json']
    """
    return tuple(dict.fromkeys(_known().values()))


def _known(*, strict: bool = False) -> dict[str, MissionFormat]:
    """Return all formats by suffix; a broken package is left out, or with `strict` raises its error."""
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
    """Return the suffix that chooses the format of a file, in lower case.

    >>> ending("field.PLAN"), ending("my.field.wpml.kmz"), ending("field.doc")
    ('.plan', '.wpml.kmz', '.doc')
    """
    name = Path(path).name.lower()
    known = [suffix for suffix in _known() if name.endswith(suffix) and name != suffix]
    return max(known, key=len, default=Path(name).suffix)


def _found(path: str | os.PathLike[str], *, writing: bool) -> MissionFormat:
    """Return the format of a file name; MissionFileError if reading (`writing`: writing) is unsupported."""
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
    """Return the `MissionFormat.loads` of a file name, or raise MissionFileError."""
    if ending(path) == _OLD:
        return _refuse
    loads = _found(path, writing=False).loads
    assert loads is not None
    return loads


def writer_for(path: str | os.PathLike[str]) -> Dumps:
    """Return the `MissionFormat.dumps` of a file name, or raise MissionFileError."""
    dumps = _found(path, writing=True).dumps
    assert dumps is not None
    return dumps


def read_mission(
    path: str | os.PathLike[str], *, altitude_m: float | None = None, drawn_path: str | None = None
) -> Mission:
    """Read a mission file, or make a mission from a drawn or recorded path.

    Parameters
    ----------
    path : path-like
        ``.plan`` (QGroundControl), ``.waypoints``, ``.wpl``, ``.txt`` (QGC WPL 110), ``.json`` (native), or a
        suffix of another of the `mission_formats`.
    altitude_m : float or None
        Altitude above home for the waypoints of a drawn path; it overrides the altitudes in the file.
    drawn_path : str or None
        Name of a drawn path, for a file that holds several.

    Returns
    -------
    Mission
        The mission. A drawn path gives waypoints only: no take-off, no landing, no home.

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
    """Read a mission file like `read_mission`; return the mission and notes on the file."""
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
    """Return the parts of a mission that a file of this name would not keep.

    For a format that can be read, the losses are the differences between the mission and the mission read
    back, including plans that the file cannot hold (`fitted`).

    Raises
    ------
    MissionFileError
        If the format cannot hold the mission.

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
    """Write a mission file; an existing file is replaced only when the new file is complete.

    Parameters
    ----------
    mission : Mission
    path : path-like
        ``.plan``, ``.waypoints``, ``.wpl``, ``.txt``, ``.json``, or a suffix of other `mission_formats`.
    firmware : Firmware
        Autopilot that a ``.plan`` or waypoint list is written for.

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
