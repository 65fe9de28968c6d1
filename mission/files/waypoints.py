r"""QGC WPL 110 waypoint lists, the text files of Mission Planner, MAVProxy and pymavlink.

The first line is ``QGC WPL 110``; a row has twelve columns: seq, current, frame, command, param1 to param4, x
(latitude), y (longitude), z (altitude), autocontinue. Row 0 is home (frame 0, altitude above mean sea level).
A file holds one plan: a mission, a fence (commands 5000 to 5004) or rally points (5100). Only a mission has
a home row.

>>> from mission.model import GeoPoint
>>> mission = Mission((MissionItem.waypoint(28.05, -82.15, 10.0),), home=GeoPoint(28.0, -82.0, 30.0))
>>> print(dumps(mission).splitlines()[2].replace("\t", " "))
1 0 3 16 0.00000000 0.00000000 0.00000000 NaN 28.05000000 -82.15000000 10.00000000 1
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass, replace

import numpy as np

from geo.texts import parse_number
from mission.errors import MissionFileError
from mission.files.common import (
    WAYPOINTS_KIND,
    Firmware,
    Parameters,
    Place,
    WithNotes,
    check_jumps,
    decode_text,
    file_parameters,
    home_for_file,
    home_from_file,
    jump_target,
    kind_of,
    make_item,
    make_mission,
    resolve_jumps,
    wrong_kind,
)
from mission.model import MAX_ITEMS, Command, Frame, Mission, MissionItem

_FENCE = frozenset(range(5000, 5005))
_RALLY = frozenset({5100})
_LONGEST_LINE = 2000
_MOST_LINES = 500_000
_COLUMNS = (
    *("seq", "current", "frame", "command", "param1", "param2", "param3", "param4"),
    *("x (latitude)", "y (longitude)", "z (altitude)", "autocontinue"),
)
# MAV_CMD of each action number of WPL 100, which is older than MAV_CMD (pymavlink, mavwp.py).
_ACTIONS_100 = {2: 22, 3: 20, 4: 21, 24: 22, 26: 21, 25: 16, 27: 17}


@dataclass(frozen=True, slots=True)
class _Row:
    line: int
    seq: int
    frame: int
    command: int
    parameters: Parameters
    place: Place
    autocontinue: bool

    def item(self) -> MissionItem:
        return make_item(
            f"line {self.line}",
            self.command,
            self.frame,
            self.parameters,
            self.place,
            autocontinue=self.autocontinue,
        )


def loads(data: bytes) -> Mission | WithNotes:
    """Read a mission, a fence or rally points from the content of a waypoint list.

    The reader also accepts comments (``#``), any white space between columns, CRLF, headers of versions 100
    and 120, a missing home row, gaps in seq, a home row with command 0, and commands without a position in
    frame 0 or 3. Jump targets become indices of the mission's items.

    The first row is home if its seq is 0, and it has command 0 or is a waypoint in frame 0. Files of version
    120 from old QGroundControl have no home row. In files of version 120 from other programs, home is the
    only row in frame 0.

    MissionFileError names the line and the column that is damaged or invalid.
    """
    kind = kind_of(data)
    if kind != WAYPOINTS_KIND:
        raise wrong_kind(data, WAYPOINTS_KIND)
    if data.count(b"\n") + data.count(b"\r") > _MOST_LINES:
        raise MissionFileError(f"more than {_MOST_LINES} lines; a mission has at most {MAX_ITEMS} items")
    version, rows = _rows(decode_text(data))
    home, notes = None, list[str]()
    home_like = (Command.NAV_WAYPOINT, Frame.GLOBAL)
    if rows and rows[0].seq == 0 and (rows[0].command == 0 or (rows[0].command, rows[0].frame) == home_like):
        alone = not any(row.frame == Frame.GLOBAL and any(row.place[:2]) for row in rows[1:])
        if alone or version != "120":
            row = rows.pop(0)
            place = (math.nan if value is None else value for value in row.place)
            home = home_from_file(f"line {row.line}", *place)
        if version == "120":
            meaning = "home" if alone else "the first waypoint, not as home, as in QGroundControl"
            notes.append(f"version 120 does not mark home: row 0 is read as {meaning}")
    flown = [row for row in rows if row.command not in _FENCE | _RALLY]
    mission = make_mission(
        resolve_jumps([row.seq for row in flown], ((f"line {row.line}", row.item()) for row in flown), "seq"),
        home,
        fence=tuple(row.item() for row in rows if row.command in _FENCE),
        rally=tuple(row.item() for row in rows if row.command in _RALLY),
    )
    return WithNotes(mission, tuple(notes)) if notes else mission


def _rows(text: str) -> tuple[str, list[_Row]]:
    rows: list[_Row] = []
    version = ""
    for number, line in enumerate(io.StringIO(text, newline=None), start=1):
        if len(line) > _LONGEST_LINE:
            msg = f"line {number}: longer than {_LONGEST_LINE} characters; the file is damaged"
            raise MissionFileError(msg)
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if not version:
            version = words[2] if len(words) == 3 else ""
            if version not in ("100", "110", "120"):
                raise MissionFileError(
                    f"line {number}: version {' '.join(words)[:40]!r}, but only QGC WPL 100, 110 and 120 can"
                    " be read; save the file in one of these versions"
                )
            continue
        if len(rows) > MAX_ITEMS:
            msg = f"line {number}: more than {MAX_ITEMS} items, too many for MAVLink; fly them in parts"
            raise MissionFileError(msg)
        if version == "100" and len(words) == 13:
            words = _columns_of_100(words, number)
        rows.append(_row(words, number))
    return version, rows


def _columns_of_100(words: list[str], line: int) -> list[str]:
    """Return the columns of a WPL 100 row in the order of WPL 110."""
    action = _whole(words[2], line, "action")
    if action not in _ACTIONS_100:
        raise MissionFileError(
            f"line {line}: action {action} of WPL 100 is not known; save the file as WPL 110"
        )
    command = str(_ACTIONS_100[action])
    return [words[0], words[7], words[1], command, *(words[i] for i in (5, 6, 3, 4, 9, 8, 10, 12))]


def _row(words: list[str], line: int) -> _Row:
    if len(words) != len(_COLUMNS):
        msg = f"line {line}: {len(words)} columns instead of {len(_COLUMNS)}; correct or remove the line"
        raise MissionFileError(msg)
    seq, _, frame, command = (_whole(words[i], line, _COLUMNS[i]) for i in range(4))
    first, second, third, fourth, x, y, z = (_number(words[i], line, _COLUMNS[i]) for i in range(4, 11))
    return _Row(
        line=line,
        seq=seq,
        frame=frame,
        command=command,
        parameters=(first, second, third, fourth),
        place=(x, y, z),
        autocontinue=_whole(words[11], line, _COLUMNS[11]) != 0,
    )


def _number(word: str, line: int, column: str) -> float | None:
    """Return the number in a column, or None for NaN."""
    try:
        value = parse_number(word)
    except ValueError:
        raise MissionFileError(f"line {line}: {column} is {word[:40]!r}; give a number") from None
    return None if math.isnan(value) else value


def _whole(word: str, line: int, column: str) -> int:
    value = _number(word, line, column)
    if value is None or not value.is_integer() or abs(value) > 1e9:
        raise MissionFileError(f"line {line}: {column} is {word[:40]!r}; give a whole number")
    return int(value)


def dumps(mission: Mission, firmware: Firmware = Firmware.PX4) -> str:
    """Return a mission, a fence or rally points as the text of a waypoint list.

    The text holds one plan: a mission, a fence or rally points. Speeds are not kept. An unknown home is
    written as the first position of the mission. An unset parameter is written as NaN, or as 0 for ArduPilot.
    Numbers have at least eight decimals and are read back exactly.

    Raises MissionFileError if the mission holds more than one plan, if a fence command is among the items, or
    if the target of a jump is missing.
    """
    plans = {"mission items": mission.items, "fence items": mission.fence, "rally points": mission.rally}
    held = [f"{len(items)} {name}" for name, items in plans.items() if items]
    if len(held) > 1:
        msg = f"a waypoint list holds one plan, not {' and '.join(held)}; write a .plan or .json file"
        raise MissionFileError(msg)
    lines = ["QGC WPL 110"]
    if mission.fence or mission.rally:
        lines += [_line(seq, item, firmware) for seq, item in enumerate(mission.fence or mission.rally)]
        return "\n".join(lines) + "\n"
    check_jumps(mission)
    home = home_for_file(mission)
    home_item = MissionItem(
        Command.NAV_WAYPOINT, Frame.GLOBAL, x=home.latitude_deg, y=home.longitude_deg, z=home.altitude_m
    )
    lines.append(_line(0, home_item, firmware))
    for seq, item in enumerate(mission.items, start=1):
        if item.command in _FENCE | _RALLY:
            msg = f"item {seq}: command {item.command} belongs to a fence or rally plan, not to a mission"
            raise MissionFileError(msg)
        standard = item.in_standard_frame()
        if standard.command == Command.DO_JUMP:
            standard = replace(standard, param1=jump_target(item, f"item {seq}") + 1.0)
        lines.append(_line(seq, standard, firmware))
    return "\n".join(lines) + "\n"


def one_plan(mission: Mission) -> Mission:
    """Return the one plan that a file can hold: the first non-empty of mission, fence and rally points."""
    if mission.items:
        return replace(mission, fence=(), rally=())
    return replace(mission, rally=()) if mission.fence else mission


def _line(seq: int, item: MissionItem, firmware: Firmware) -> str:
    # Qt, Python, C and .NET can read NaN in this spelling. The older .NET Framework reads no other spelling.
    numbers = (*file_parameters(item, firmware), item.x, item.y, item.z)
    texts = (
        "NaN" if number is None else np.format_float_positional(float(number), unique=True, min_digits=8)
        for number in numbers
    )
    head = f"{seq}\t{int(seq == 0)}\t{item.frame}\t{item.command}\t"
    return head + "\t".join(texts) + f"\t{int(item.autocontinue)}"
