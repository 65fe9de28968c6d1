"""Readers and writers of mission files; the suffix of the file name chooses the format.

Packages add formats by entry points of the group ``wbf_mission.mission_formats``. An entry point names a list
of `MissionFormat`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from geo.atomic import atomic_write
from geo.imports import entry_points, load_entry
from geo.reading import UnreadableError, read_file
from geo.texts import one_line
from mission.errors import MissionFileError
from mission.files import native, plan, waypoints
from mission.files.common import MAX_BYTES, POINTS_OF_KIND, Firmware, WithNotes, kind_of, wrong_kind
from mission.model import GeoPoint, Mission, MissionItem

_PLANS = {"items": "mission item", "fence": "fence item", "rally": "rally point"}
_FIELDS = {
    **{name: name for name in ("command", "frame", "param1", "param2", "param3", "param4", "autocontinue")},
    "x": "latitude or parameter 5",
    "y": "longitude or parameter 6",
    "z": "altitude or parameter 7",
}
_MOST_SHOWN = 5
_SAME_PLACE_DEG = 1e-7  # Resolution of positions in MAVLink


@dataclass(frozen=True, slots=True)
class Loss:
    """Description of a part of a mission that a file does not keep."""

    text: str
    changes_flight: bool = False


def differences(mission: Mission, kept: Mission) -> list[Loss]:
    """Return the differences between a mission and `kept`, the mission read back from its file."""
    found = [loss for name in _PLANS for loss in _of_plan(name, getattr(mission, name), getattr(kept, name))]
    if not _are_near(mission.home, kept.home):
        found.append(Loss(f"home, which is {_shown(mission.home)}, is written as {_shown(kept.home)}"))
    names = ("cruise_speed_m_s", "hover_speed_m_s")
    if any(getattr(mission, name) != getattr(kept, name) for name in names):
        found.append(Loss("the cruise and hover speeds for time estimates are not kept"))
    return found


def dropped(what: str, count: int, of: int) -> list[Loss]:
    """Return a list with the loss of `count` out of `of` items, or an empty list if `count` is 0.

    >>> dropped("fence item", 4, 4)[0].text
    'fence items are not kept (4 of 4)'
    """
    return [Loss(f"{what}s are not kept ({count} of {of})", True)] if count else []


def _of_plan(name: str, before: Sequence[MissionItem], after: Sequence[MissionItem]) -> list[Loss]:
    what = _PLANS[name]
    if len(before) != len(after):
        return dropped(what, len(before) - len(after), len(before))
    changed: dict[Loss, list[int]] = {}
    for number, (old, new) in enumerate(zip(before, after, strict=True), 1):
        for field in _FIELDS if old != new else ():
            if getattr(old, field) != getattr(new, field) and (name == "items" or field != "autocontinue"):
                changed.setdefault(_change(field, old, new), []).append(number)
    return [Loss(f"{loss.text} ({numbered(what, at)})", loss.changes_flight) for loss, at in changed.items()]


def _change(field: str, old: MissionItem, new: MissionItem) -> Loss:
    was, is_now = getattr(old, field), getattr(new, field)
    if field == "frame" and not old.has_position:
        return Loss("commands without a position are written in frame 2, with no effect on the flight")
    if was is None:
        return Loss(f"an unset {field} is written as {is_now:g}")
    return Loss(f"{_FIELDS[field]} is not kept", True)


def numbered(what: str, numbers: Sequence[int]) -> str:
    """Return a text with the numbers of up to five items.

    >>> numbered("mission item", [1, 2, 5, 6, 7, 9, 10]), numbered("rally point", [2])
    ('mission items 1, 2, 5, 6, 7 and 2 more', 'rally point 2')
    """
    shown = ", ".join(str(number) for number in islice(numbers, _MOST_SHOWN))
    more = len(numbers) - _MOST_SHOWN
    return f"{what}{'s' if len(numbers) > 1 else ''} {shown}" + (f" and {more} more" if more > 0 else "")


def _are_near(home: GeoPoint | None, kept: GeoPoint | None) -> bool:
    if home is None or kept is None:
        return home is kept
    return (
        abs(home.latitude_deg - kept.latitude_deg) <= _SAME_PLACE_DEG
        and abs(home.longitude_deg - kept.longitude_deg) <= _SAME_PLACE_DEG
        and home.altitude_m == kept.altitude_m
    )


def _shown(home: GeoPoint | None) -> Any:
    return (
        "unknown"
        if home is None
        else f"{home.latitude_deg:.7f}, {home.longitude_deg:.7f}, {home.altitude_m:g} m"
    )


class Drawn(Protocol):
    """Drawn or recorded paths. Each path can be turned into a mission."""

    @property
    def paths(self) -> Sequence[Any]:
        """The paths."""

    def mission(self, altitude_m: float | None, name: str | None) -> tuple[Mission, list[str]]:
        """Return a mission of the path `name` (None: the only path), and notes on the mission."""


Loads: TypeAlias = Callable[[bytes], "Mission | WithNotes | Drawn"]
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
        Converts the content of a file to a mission, a mission with notes, or a drawing. None: files of this
        format cannot be read.
    dumps : callable or None
        Converts a mission, for a firmware, to the content of a file. None: files cannot be written.
    hold : callable or None
        Returns the part of a mission that one file can hold. None: a file can hold the whole mission.
    losses : callable or None
        Returns the parts of a mission that a file does not keep, for a format that cannot be read back.
    """

    name: str
    suffixes: tuple[str, ...]
    loads: Loads | None = None
    dumps: Dumps | None = None
    hold: Callable[[Mission], Mission] | None = None
    losses: Callable[[Mission], Sequence[Loss]] | None = None


ENTRY_POINT_GROUP = "wbf_mission.mission_formats"


def _read_text(data: bytes) -> Mission | WithNotes | Drawn:
    """Read a waypoint list; a file with its suffix may also hold a fence or rally points."""
    other = _known().get(POINTS_OF_KIND.get(kind_of(data), ""))
    return waypoints.loads(data) if other is None or other.loads is None else other.loads(data)


_CORE = (
    MissionFormat("QGroundControl plan", (".plan",), plan.loads, plan.dumps),
    MissionFormat(
        "QGC WPL 110", (".waypoints", ".wpl", ".txt"), _read_text, waypoints.dumps, waypoints.one_plan
    ),
    MissionFormat("wbf-mission JSON", (".json",), native.loads, native.dumps),
)
_FARM = "this is a farm file, not a mission; plan a flight over it (wbf-mission plan --farm FILE)"
_FOREIGN = dict.fromkeys((".poly", ".shp", ".zip", ".gpkg", ".ndjson", ".jsonl"), _FARM)
"""Advice for files without missions, by suffix."""
_OLD = ".mission"


def _refuse(data: bytes) -> Mission:
    """Raise MissionFileError for a .mission file (QGroundControl 3), which cannot be read."""
    raise wrong_kind(data, "a mission of a kind that can be read")


def mission_formats() -> tuple[MissionFormat, ...]:
    """Return the formats of the core, then the formats of installed packages.

    >>> [mission_format.suffixes[0] for mission_format in mission_formats()][:4]
    ['.plan', '.waypoints', '.json', '.fen']
    """
    return tuple(dict.fromkeys(_known().values()))


def _known(*, strict: bool = False) -> dict[str, MissionFormat]:
    """Return all formats by suffix; skip packages that cannot be loaded, or raise their error if `strict`."""
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
    """Return the format of a file name; raise MissionFileError if the format has no reader (or no writer)."""
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
    """Return the function that reads a file of this name, or raise MissionFileError."""
    if ending(path) == _OLD:
        return _refuse
    loads = _found(path, writing=False).loads
    assert loads is not None
    return loads


def writer_for(path: str | os.PathLike[str]) -> Dumps:
    """Return the function that makes the content of a file of this name, or raise MissionFileError."""
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
        suffix from `mission_formats`.
    altitude_m : float or None
        Altitude above home for the waypoints of a drawn path; it overrides the altitudes in the file.
    drawn_path : str or None
        Name of a drawn path, for a file that holds several.

    Returns
    -------
    Mission
        The mission. A mission of a drawn path has only waypoints: no take-off, no landing, no home.

    Raises
    ------
    MissionFileError
        If the file cannot be read, is larger than 64 MiB, is not a mission of that kind, or holds impossible
        values. The message is one line with the file, the line or item, what is wrong, and what to do.
    """
    return open_mission(path, altitude_m=altitude_m, drawn_path=drawn_path)[0]


def open_mission(
    path: str | os.PathLike[str], *, altitude_m: float | None = None, drawn_path: str | None = None
) -> tuple[Mission, list[str]]:
    """Read a mission file as `read_mission` does; return the mission, and notes on the file."""
    loads = reader_for(path)
    try:
        found = loads(read_file(Path(path), MAX_BYTES))
        if not isinstance(found, Mission | WithNotes):
            return found.mission(altitude_m, drawn_path)
        notes = list(found.notes) if isinstance(found, WithNotes) else []
        found = found.mission if isinstance(found, WithNotes) else found
    except UnreadableError as error:
        raise MissionFileError(one_line(f"{path}: cannot be read as a mission: {error}")) from error
    except MissionFileError as error:
        raise MissionFileError(one_line(f"{path}: {error}")) from None
    if altitude_m is not None or drawn_path is not None:
        msg = f"{path}: a mission has its own altitudes and only one path; leave --altitude and --path out"
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
    ['the cruise and hover speeds for time estimates are not kept']
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
        ``.plan``, ``.waypoints``, ``.wpl``, ``.txt``, ``.json``, or a suffix from `mission_formats`.
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
