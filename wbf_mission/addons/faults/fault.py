"""Specifications of faults: kind, time and vehicle, as values and as text.

A fault is written ``KIND[=VALUE][,OPTION=VALUE...]``, for example ``loss=0.2,from=10,for=60`` or
``no-final-ack,times=1`` or ``gps-loss,at=airborne,from=5,for=20``. `KINDS` lists all kinds of faults. Kinds
of the mission protocol are failures that tests of ground stations inject. `FaultSession` applies the faults.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from geo.reading import UnreadableError, read_toml
from geo.texts import parse_number, parse_whole, unknown
from mission.link.codec.dialect import mavlink
from sim_vehicle.errors import VehicleError

if TYPE_CHECKING:
    from wbf_mission.cli.output import Output

Group = Literal["link", "message", "vehicle"]
ValueKind = Literal[
    "chance", "part", "seconds", "baud", "item", "message", "result", "command", "component", "none"
]


class FaultError(VehicleError, ValueError):
    """The specification of a fault is invalid."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of fault: the affected group, the kind of value, and a description.

    If there is no `default`, a fault must have a value, unless ``value`` is "none".
    """

    group: Group
    value: ValueKind
    text: str
    default: float | None = None


KINDS: dict[str, Kind] = {
    "link-loss": Kind("link", "none", "no frame passes the link"),
    "loss": Kind("link", "chance", "each frame is lost with this probability"),
    "duplicate": Kind("link", "chance", "each frame arrives twice with this probability"),
    "corrupt": Kind("link", "chance", "one byte of each frame is changed with this probability"),
    "delay": Kind("link", "seconds", "every frame is delayed by this time"),
    "jitter": Kind(
        "link", "seconds", "every frame is delayed by a random time, at most this; frames may change order"
    ),
    "bandwidth": Kind("link", "baud", "the link has this bit rate and a buffer of 16 KiB", 57600.0),
    "drop": Kind("message", "message", "messages of this name (or id) do not arrive"),
    "silence": Kind("message", "component", "the component (1: autopilot) neither receives nor sends", 1.0),
    "no-list": Kind("message", "none", "no answer to MISSION_REQUEST_LIST"),
    "no-count": Kind("message", "none", "no answer to MISSION_COUNT"),
    "no-request": Kind("message", "item", "this item is neither requested nor sent", 0.0),
    "wrong-sequence": Kind(
        "message", "item", "the next item is requested or sent in place of this item", 0.0
    ),
    "error-ack": Kind(
        "message", "item", "a MISSION_ACK with an error replaces this item or its request", 0.0
    ),
    "early-final-ack": Kind(
        "message", "item", "an accepting MISSION_ACK replaces the request for this item", 1.0
    ),
    "no-final-ack": Kind("message", "none", "the accepting MISSION_ACK is not sent"),
    "final-ack-error": Kind("message", "result", "the last MISSION_ACK has this result", 1.0),
    "refuse": Kind("message", "command", "commands with this number (400: arm) are denied"),
    "gps-loss": Kind("vehicle", "none", "the vehicle has no position"),
    "motor-failure": Kind("vehicle", "none", "a motor stops"),
    "dead-battery": Kind("vehicle", "none", "the battery is empty at once"),
    "low-battery": Kind("vehicle", "part", "the battery drains to this fraction or less", 0.1),
    "battery-change": Kind(
        "vehicle", "seconds", "a full battery is inserted this long after each landing", 20.0
    ),
    "reboot": Kind("vehicle", "none", "the autopilot reboots and continues the flight"),
    "stuck-camera": Kind("vehicle", "none", "the camera's shutter does not open, so images fail"),
}
"""All kinds of faults, keyed by name."""

TRIGGERS = ("start", "armed", "airborne", "landed", "upload", "download", "item:N")
"""Values of ``at``. Only the first occurrence of an event is a trigger."""

_ITEM = re.compile(r"item:[0-9]{1,5}")
_DIRECTIONS = ("up", "down", "both")
_RANGES: dict[ValueKind, tuple[float, float, str]] = {
    "chance": (0.0, 1.0, "a probability from 0 to 1"),
    "part": (0.0, 1.0, "a fraction from 0 to 1"),
    "command": (0.0, 65535.0, "the number of a command, such as 400"),
    "seconds": (0.0, 3600.0, "seconds from 0 to 3600"),
    "baud": (1.0, 1e9, "bits per second, such as 57600"),
    "item": (0.0, 65535.0, "an item number, from 0 up"),
    "message": (0.0, 16777215.0, "the name of a message, such as COMMAND_ACK"),
    "result": (1.0, 15.0, "a MAV_MISSION_RESULT from 1 to 15"),
    "component": (1.0, 255.0, "a component id from 1 to 255"),
}
_KEYS = {
    "from": "start_s",
    "for": "duration_s",
    "at": "trigger",
    "vehicle": "vehicle",
    "direction": "direction",
    "link": "link",
    "times": "times",
}


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault: kind, value, time, and the affected vehicle or link.

    Parameters
    ----------
    kind : str
        Name in `KINDS`.
    value : float, str or None
        Value, of the kind `Kind.value`; None is the default of the kind of fault. For ``drop``, this is the
        name or id of the message.
    start_s, duration_s : float
        Start in seconds after the trigger, and duration.
    trigger : str
        One of `TRIGGERS`; ``start`` is the start of the simulation.
    vehicle : int or None
        System id of the affected vehicle; None for all vehicles.
    direction : {"up", "down", "both"}
        Affected direction of link faults and ``drop``: to the vehicle, from the vehicle, or both.
    link : str or None
        Part of the names of the affected links (such as ``14550``), or the number of a link, from 1 to 999.
    times : int or None
        Maximum number of messages that a message fault affects.

    Raises
    ------
    FaultError
        If the kind does not exist, or a value is out of range.

    Examples
    --------
    >>> Fault("loss", 0.2, start_s=10.0).value
    0.2
    >>> Fault("loss", 2.0)
    Traceback (most recent call last):
    ...
    wbf_mission.addons.faults.fault.FaultError: fault loss: 2 is not a probability from 0 to 1
    """

    kind: str
    value: float | str | None = None
    start_s: float = 0.0
    duration_s: float = math.inf
    trigger: str = "start"
    vehicle: int | None = None
    direction: Literal["up", "down", "both"] = "both"
    link: str | None = None
    times: int | None = None

    def __post_init__(self) -> None:
        kind = KINDS.get(self.kind)
        if kind is None:
            raise FaultError(unknown("fault", self.kind, KINDS))
        object.__setattr__(self, "value", self._checked_value(kind))
        self._require(0.0 <= self.start_s < math.inf, f"from {self.start_s} is not 0 or more seconds")
        self._require(self.duration_s > 0.0, f"for {self.duration_s} is not a positive number of seconds")
        self._require(
            self.trigger in TRIGGERS[:-1] or _ITEM.fullmatch(self.trigger) is not None,
            f"at {self.trigger!r} is not one of {', '.join(TRIGGERS)}",
        )
        self._require(
            self.vehicle is None or 1 <= self.vehicle <= 255, f"vehicle {self.vehicle} is not 1 to 255"
        )
        self._require(self.direction in _DIRECTIONS, f"direction {self.direction!r} is not up, down or both")
        self._require(self.times is None or self.times >= 1, f"times {self.times} is not 1 or more")
        self._require(kind.group == "message" or self.times is None, "only message faults can have times")
        self._require(kind.group == "link" or self.link is None, "only link faults can have a link")
        self._require(
            kind.group == "link" or self.kind == "drop" or self.direction == "both",
            "only link faults and drop can have a direction",
        )

    def _require(self, condition: bool, text: str) -> None:
        if not condition:
            raise FaultError(f"fault {self.kind}: {text}")

    def _checked_value(self, kind: Kind) -> float | None:
        value = self.value
        if kind.value == "none":
            self._require(value is None, f"it takes no value, not {value!r}")
            return None
        if value is None:
            value = kind.default
        low, high, text = _RANGES[kind.value]
        self._require(value is not None, f"it needs a value: {text}")
        number = _message_id(value) if kind.value == "message" else _number(value)
        whole = kind.value in ("item", "message", "result", "command", "component")
        good = low <= number <= high and (not whole or number == int(number))
        self._require(
            good, f"{value:g} is not {text}" if isinstance(value, float) else f"{value} is not {text}"
        )
        return number

    @property
    def group(self) -> Group:
        """Group of things that the fault affects: link, message or vehicle."""
        return KINDS[self.kind].group

    @property
    def number(self) -> float:
        """Value of the fault; 0 for a kind without a value."""
        return self.value if isinstance(self.value, float) else 0.0

    def __str__(self) -> str:
        value = self.value
        if self.kind == "drop":
            value = mavlink.mavlink_map[int(self.number)].msgname
        parts = [self.kind if value is None else f"{self.kind}={_shortest(value)}"]
        plain = {"from": 0.0, "for": math.inf, "at": "start", "direction": "both"}
        for key, name in _KEYS.items():
            given = getattr(self, name)
            if given != plain.get(key):
                parts.append(f"{key}={_shortest(given)}")
        return ",".join(parts)


def _shortest(value: object) -> str:
    return str(int(value)) if isinstance(value, float) and value == int(value) else str(value)


def _number(value: float | str | None) -> float:
    try:
        return parse_number(value) if isinstance(value, str) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return math.nan


def _message_id(value: float | str | None) -> float:
    """Return the id of a message by name or id; NaN if the dialect has no such message."""
    number = _number(value)
    if number in mavlink.mavlink_map:
        return number
    wanted = str(value).upper()
    found = [key for key, kind in mavlink.mavlink_map.items() if kind.msgname == wanted]
    return float(found[0]) if found else math.nan


def parse_fault(text: str) -> Fault:
    """Read a fault from ``KIND[=VALUE][,OPTION=VALUE...]``; FaultError if the text is invalid.

    The options are from, for (seconds), at (trigger), vehicle, direction, link and times; see `Fault`.

    >>> parse_fault("loss=0.2,from=10,for=60,direction=down")
    Fault(kind='loss', value=0.2, start_s=10.0, duration_s=60.0, trigger='start', vehicle=None, \
direction='down', link=None, times=None)
    >>> str(parse_fault("no-request=0,times=1"))
    'no-request=0,times=1'
    """
    first, *rest = [part.strip() for part in text.split(",")]
    kind, equals, value = first.partition("=")
    table: dict[str, Any] = {"kind": kind.strip()}
    if equals:
        table["value"] = value.strip()
    for part in rest:
        key, equals, value = part.partition("=")
        if not equals or key.strip() in ("kind", "value") or key.strip() in table:
            raise FaultError(f"fault {text!r}: {part!r} is not OPTION=VALUE; options are {', '.join(_KEYS)}")
        table[key.strip()] = value.strip()
    return fault_from(table)


def fault_from(table: Mapping[str, Any]) -> Fault:
    """Return a fault from a table with the keys kind, value and the options; FaultError if invalid."""
    kind = str(table.get("kind", ""))
    values: dict[str, Any] = {}
    for key, value in table.items():
        if key in ("kind", "value"):
            continue
        name = _KEYS.get(key)
        if name is None:
            raise FaultError(f"fault {kind}: {unknown('option', key, _KEYS)}")
        try:
            if name in ("start_s", "duration_s"):
                values[name] = parse_number(value) if isinstance(value, str) else float(value)
            elif name in ("vehicle", "times"):
                values[name] = parse_whole(value) if isinstance(value, str) else int(value)
            else:
                values[name] = str(value)
        except (TypeError, ValueError):
            raise FaultError(f"fault {kind}: {key} {value!r} is not a number") from None
    value = table.get("value")
    if value is not None and (isinstance(value, bool) or not isinstance(value, str | int | float)):
        raise FaultError(f"fault {kind}: value {value!r} is neither a number nor text")
    return Fault(kind, float(value) if isinstance(value, int) else value, **values)


def load_faults(path: Path | str) -> tuple[Fault, ...]:
    """Read the ``[[fault]]`` tables of a TOML file; FaultError names the file and the invalid fault."""
    try:
        table = read_toml(Path(path))
    except UnreadableError as error:
        raise FaultError(f"{path}: cannot be read as a table of faults: {error}; give a TOML file") from error
    return faults_of(table, str(path))


def faults_of(table: Mapping[str, Any], where: str) -> tuple[Fault, ...]:
    """Return the faults of a decoded TOML file; ``where`` is the file name for messages."""
    entries = table.get("fault", [])
    if not isinstance(entries, list) or not all(isinstance(entry, Mapping) for entry in entries):
        raise FaultError(f"{where}: faults must be written as [[fault]] tables")
    faults: list[Fault] = []
    for number, entry in enumerate(entries, 1):
        try:
            faults.append(fault_from(entry))
        except FaultError as error:
            raise FaultError(f"{where}: fault {number}: {error}") from error
    return tuple(faults)


def show_kinds(output: Output) -> None:
    """Print the kinds of faults and their options."""
    rows = [
        [name, kind.group, "" if kind.value == "none" else kind.value, kind.text]
        for name, kind in KINDS.items()
    ]
    values = [dict(zip(("kind", "group", "value", "text"), row, strict=True)) for row in rows]
    output.table(values, ["fault", "of", "value", "what it does"], rows, title="Faults", left=True)
    output.note(f"when: from=SECONDS, for=SECONDS, at={'|'.join(TRIGGERS)}")
    output.note("where: vehicle=SYSTEM, direction=up|down|both, link=NAME|NUMBER; how often: times=N")
