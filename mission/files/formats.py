"""Reading and writing mission files; the suffix of the name chooses the format."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from geo.atomic import atomic_write
from geo.reading import UnreadableError, read_file
from geo.texts import one_line
from mission.errors import MissionFileError
from mission.files import native, plan, views, waypoints
from mission.files.common import MAX_BYTES, Firmware
from mission.model import Mission


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
        Makes a mission from the content of a file; None if the format is only written.
    dumps : callable or None
        Makes the text of a file from a mission and a firmware; None if the format is only read.
    """

    name: str
    suffixes: tuple[str, ...]
    loads: Callable[[bytes], Mission] | None = None
    dumps: Callable[[Mission, Firmware], str] | None = None


_FORMATS: dict[str, MissionFormat] = {}


def register_format(mission_format: MissionFormat) -> None:
    """Add a format, or replace the one that has had its suffixes."""
    for suffix in mission_format.suffixes:
        _FORMATS[suffix.lower()] = mission_format


def mission_formats() -> tuple[MissionFormat, ...]:
    """Return the known formats.

    >>> [mission_format.suffixes[0] for mission_format in mission_formats()]
    ['.plan', '.waypoints', '.json', '.kml', '.geojson']
    """
    return tuple(dict.fromkeys(_FORMATS.values()))


register_format(MissionFormat("QGroundControl plan", (".plan",), plan.loads, plan.dumps))
register_format(
    MissionFormat("QGC WPL 110", (".waypoints", ".wpl", ".txt"), waypoints.loads, waypoints.dumps)
)
register_format(MissionFormat("wbf-mission JSON", (".json",), native.loads, native.dumps))
register_format(MissionFormat("KML", (".kml",), None, views.kml_dumps))
register_format(MissionFormat("GeoJSON", (".geojson",), None, views.geojson_dumps))


def _suffixes(*, writing: bool) -> str:
    names = [suffix for suffix, made in _FORMATS.items() if (made.dumps if writing else made.loads)]
    return ", ".join(names[:-1]) + " or " + names[-1]


def _found(path: str | os.PathLike[str], *, writing: bool) -> MissionFormat:
    """Return the format of a file's name, or raise MissionFileError where it is not read or not written."""
    suffix = Path(path).suffix.lower()
    found = _FORMATS.get(suffix)
    if found is None or (found.dumps if writing else found.loads) is None:
        does, ways = ("writer", "written to") if writing else ("reader", "read from")
        problem = f"no {does} for {found.name} files" if found else f"unknown suffix {suffix!r}"
        msg = f"{path}: {problem}; missions are {ways} {_suffixes(writing=writing)}"
        raise MissionFileError(one_line(msg))
    return found


def reader_for(path: str | os.PathLike[str]) -> Callable[[bytes], Mission]:
    """Return the function that reads files of this name, or raise MissionFileError."""
    loads = _found(path, writing=False).loads
    assert loads is not None
    return loads


def writer_for(path: str | os.PathLike[str]) -> Callable[[Mission, Firmware], str]:
    """Return the function that writes files of this name, or raise MissionFileError."""
    dumps = _found(path, writing=True).dumps
    assert dumps is not None
    return dumps


def read_mission(path: str | os.PathLike[str]) -> Mission:
    """Read a mission file.

    Parameters
    ----------
    path : path-like
        ``.plan`` (QGroundControl), ``.waypoints``, ``.wpl``, ``.txt`` (QGC WPL 110) or ``.json`` (ours).

    Returns
    -------
    Mission

    Raises
    ------
    MissionFileError
        If the file cannot be read, is larger than 64 MiB, is no mission of that kind, or holds impossible
        values. The message is one line with the file, the line or item, what is wrong, and what to do.
    """
    loads = reader_for(path)
    try:
        return loads(read_file(Path(path), MAX_BYTES))
    except UnreadableError as error:
        raise MissionFileError(one_line(f"{path}: cannot be read as a mission: {error}")) from error
    except MissionFileError as error:
        raise MissionFileError(one_line(f"{path}: {error}")) from None


def write_mission(
    mission: Mission, path: str | os.PathLike[str], *, firmware: Firmware = Firmware.PX4
) -> None:
    """Write a mission file; an older file of that name is replaced only when the new one is complete.

    Parameters
    ----------
    mission : Mission
        What to write.
    path : path-like
        ``.plan``, ``.waypoints``, ``.wpl``, ``.txt``, ``.json``, or for viewing ``.kml``, ``.geojson``.
    firmware : Firmware
        The autopilot that a ``.plan`` or waypoint list is meant for.

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
        text = dumps(mission, firmware)
        with atomic_write(path, newline="\n") as file:
            file.write(text)
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise MissionFileError(one_line(f"{path}: cannot be written: {reason}")) from error
