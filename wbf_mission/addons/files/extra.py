"""Files of the simulated vehicle: component metadata, packed parameters, packed plans and logs.

Component metadata follow https://mavlink.io/en/services/component_metadata.html and ``parameter.schema.json``
of https://github.com/mavlink/mavlink/tree/master/component_metadata, in version 1, which PX4 also writes.
"""

from __future__ import annotations

import json
import lzma
import math
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache, partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, get_args
from urllib.parse import parse_qsl

from mission.link.codec.dialect import Message
from mission.link.codec.dialect import mavlink as m
from mission.model import MissionType
from sim_vehicle.autopilot.parameters import MavParameter, reference_parameters, table_rows
from sim_vehicle.mavlink.extras import VehicleExtra
from wbf_mission.addons.files.file_tree import FileTree, MadeFile, TakenFile
from wbf_mission.addons.files.ftp import FtpServer, checksum
from wbf_mission.addons.files.logs import FlightLogs, LogMessage, LogTransfer

if TYPE_CHECKING:
    from sim_vehicle.autopilot.mavlink_profile import MavlinkProfile
    from sim_vehicle.mavlink.parameters import ParameterSet
    from sim_vehicle.mavlink.plan_receiver import PlanReceiver
    from sim_vehicle.mavlink.wire_state import WireState

GENERAL_PATH = "/etc/extras/component_general.json.xz"
PARAMETERS_PATH = "/etc/extras/parameters.json.xz"
_TYPE_PARAMETERS = 1
# For each kind of choice: the name of the list of choices in the metadata, and the key of a choice's number.
_CHOICES = {"value": ("values", "value"), "bit": ("bitmask", "index")}
# Small XZ readers in ground stations support only CRC32 as checksum.
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 6, "dict_size": 1 << 16}]
_MAGIC, _MAGIC_WITH_DEFAULTS = 0x671B, 0x671C
_HEADER = struct.Struct("<HHH")
_INTEGERS = {8: (1, "<b"), 16: (2, "<h"), 32: (3, "<i")}
_FLOAT = (4, "<f")
_CODES = dict((*_INTEGERS.values(), _FLOAT))
_LONGEST_NAME = 16
_MOST = 65534

Details: TypeAlias = tuple[str, str]


# Results are cached: compressing a table takes time, and all vehicles of a fleet have almost equal tables.
@lru_cache(maxsize=16)
def _metadata(
    table: tuple[MavParameter, ...], defaults: tuple[float, ...], details: Details
) -> dict[str, bytes]:
    """Return the metadata files, keyed by path: the parameter file, and the general file that refers to it.

    `defaults` are the values of the parameters at start, each in the unit of its parameter. `table` describes
    parameters for which there are no details.
    """
    known = parameter_details(*details)
    entries = [
        _entry(parameter, default, known.get(parameter.name, {}))
        for parameter, default in zip(table, defaults, strict=True)
    ]
    parameters = _compressed({"version": 1, "parameters": entries})
    types = [{"type": _TYPE_PARAMETERS, "uri": uri(PARAMETERS_PATH), "fileCrc": checksum(parameters)}]
    return {GENERAL_PATH: _compressed({"version": 1, "metadataTypes": types}), PARAMETERS_PATH: parameters}


def uri(path: str) -> str:
    """Return the MAVLink FTP address of a vehicle's file.

    >>> uri(GENERAL_PATH)
    'mftp://etc/extras/component_general.json.xz'
    """
    return f"mftp:/{path}"


@cache
def parameter_details(name: str, package: str) -> Mapping[str, dict[str, Any]]:
    """Return ``parameter.schema.json`` entries, keyed by parameter, from ``lists/NAME*.csv`` of a package.

    >>> details = parameter_details("px4", "sim_vehicle.autopilot")["GF_ACTION"]
    >>> details["group"], details["values"][2], details["max"]
    ('Geofence', {'value': 2, 'description': 'Hold mode'}, 5.0)
    """
    choices: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for row in table_rows(f"{name}-choices", package):
        entry, number = _CHOICES[row["kind"]]
        labelled = {number: int(row["number"]), "description": row["label"]}
        choices.setdefault(row["choices"], {}).setdefault(entry, []).append(labelled)
    ranges = {known.name: (known.low, known.high) for known in reference_parameters(name, package=package)}
    details = {}
    for row in table_rows(f"{name}-details", package):
        low, high = ranges.get(row["name"], (-math.inf, math.inf))
        details[row["name"]] = {
            "group": row["group"],
            "min": low,
            "max": high,
            "decimalPlaces": int(row["decimals"]) if row["decimals"] else None,
            "increment": float(row["increment"]) if row["increment"] else None,
            "rebootRequired": True if row["reboot"] == "yes" else None,
            **choices.get(row["choices"], {}),
        }
    return details


def _entry(parameter: MavParameter, default: float, details: Mapping[str, Any]) -> dict[str, Any]:
    """Return the metadata of a parameter; for an integer parameter, all numbers in it are integers."""
    number: Callable[[float], float] = round if parameter.integer else float
    entry: dict[str, Any] = {
        "name": parameter.name,
        "type": f"Int{parameter.bits}" if parameter.integer else "Float",
        "default": default,
        "group": parameter.name.split("_", 1)[0],
        "min": parameter.low,
        "max": parameter.high,
        "units": parameter.unit or None,
    }
    entry |= details
    for key in ("default", "min", "max", "increment"):
        value = entry.get(key)
        entry[key] = number(value) if value is not None and math.isfinite(value) else None
    if "values" in entry:
        entry["values"] = [choice | {"value": number(choice["value"])} for choice in entry["values"]]
    return {key: value for key, value in entry.items() if value is not None}


def _compressed(value: object) -> bytes:
    text = json.dumps(value, separators=(",", ":"), sort_keys=True)
    return lzma.compress(text.encode("ascii"), lzma.FORMAT_XZ, lzma.CHECK_CRC32, filters=_FILTERS)


def asked_for(query: str) -> tuple[int, int, bool] | None:
    """Parse a query: first parameter, count (0 for all), and whether to add defaults; None if invalid.

    >>> asked_for("start=10&count=5&withdefaults=1")
    (10, 5, True)
    """
    start, count, defaults = 0, 0, False
    for key, text in parse_qsl(query, keep_blank_values=True):
        if not (text.isascii() and text.isdigit() and len(text) <= 5 and int(text) <= _MOST):
            return None
        if key == "start":
            start = int(text)
        elif key == "count":
            count = int(text)
        elif key == "withdefaults" and int(text) <= 1:
            defaults = text == "1"
        else:
            return None
    return start, count, defaults


def packed(parameters: ParameterSet, query: str, read_size: int) -> bytes | None:
    """Pack the parameters selected by `query`; None if the query is invalid.

    Padding ensures that no value is split between two reads of `read_size` bytes.
    """
    table = parameters.table
    asked = asked_for(query)
    if asked is None or asked[0] >= len(table):
        return None
    start, count, defaults = asked
    chosen = table[start : start + count] if count else table[start:]
    out = bytearray(_HEADER.pack(_MAGIC_WITH_DEFAULTS if defaults else _MAGIC, len(chosen), len(table)))
    before = ""
    for parameter in chosen:
        kind, code = _INTEGERS[parameter.bits] if parameter.integer else _FLOAT
        now = _bytes(parameter, code, parameters.value(parameter.name))
        first = _bytes(parameter, code, parameters.default(parameter.name))
        differs = defaults and first != now
        common = _common(before, parameter.name)
        rest = parameter.name[common:]
        entry = bytes([kind | differs << 4, common | len(rest) - 1 << 4]) + rest.encode("ascii") + now
        entry += first if differs else b""
        beyond = (len(out) + len(entry)) % read_size if read_size else 0
        if len(now) > 1 and 0 < beyond < len(now):
            out += bytes(len(now) - beyond)
        out += entry
        before = parameter.name
    return bytes(out)


def unpacked(data: bytes) -> list[tuple[str, float]] | None:
    """Parse an upload into names and values; None if the upload is damaged.

    The header of an upload has the file's length in the field that otherwise has the number of parameters.

    >>> unpacked(bytes.fromhex("1b67 0100 0c00 01 20 414243 07"))
    [('ABC', 7.0)]
    """
    if len(data) < _HEADER.size:
        return None
    magic, number, length = _HEADER.unpack_from(data)
    if magic != _MAGIC or length != len(data):
        return None
    found: list[tuple[str, float]] = []
    at, before = _HEADER.size, b""
    for _ in range(number):
        if at + 2 > length or data[at] not in _CODES:
            return None
        code = _CODES[data[at]]
        common, rest = data[at + 1] & 15, (data[at + 1] >> 4) + 1
        value_at = at + 2 + rest
        name = before[:common] + data[at + 2 : value_at]
        at = value_at + struct.calcsize(code)
        if common > len(before) or common + rest > _LONGEST_NAME or at > length or not name.isascii():
            return None
        (value,) = struct.unpack_from(code, data, value_at)
        found.append((name.decode("ascii"), float(value)))
        before = name
    return found


def _common(one: str, other: str) -> int:
    """Return the number of leading characters that are equal in two names."""
    return next((i for i, pair in enumerate(zip(one, other, strict=False)) if pair[0] != pair[1]), len(one))


def _bytes(parameter: MavParameter, code: str, value: float) -> bytes:
    """Pack a parameter's value as bytes of the parameter's type."""
    if not parameter.integer:
        return struct.pack(code, value)
    limit = 1 << parameter.bits - 1
    return struct.pack(code, min(max(round(value), -limit), limit - 1))


PLAN_PATHS = {
    MissionType.MISSION: "@MISSION/mission.dat",
    MissionType.FENCE: "@MISSION/fence.dat",
    MissionType.RALLY: "@MISSION/rally.dat",
}
"""Path of the file for each type of plan."""
_PLAN_MAGIC = 0x763D
_PLAN_HEADER = struct.Struct("<5H")  # Magic, type of plan, options, first item, number of items.
_ITEM = struct.Struct("<4f2if2H6B")
_PART = 1


_FIELDS = attrgetter(
    *("param1", "param2", "param3", "param4", "x", "y", "z", "seq", "command", "target_system"),
    *("target_component", "frame", "current", "autocontinue", "mission_type"),
)


class PackedPlan(NamedTuple):
    """An uploaded plan: its items replace the items from `start` on, or the whole plan if `start` is None."""

    items: tuple[m.MAVLink_mission_item_int_message, ...]
    start: int | None


def pack_plan(mission_type: MissionType, items: Sequence[m.MAVLink_mission_item_int_message]) -> bytes:
    """Pack a plan into the contents of its file.

    >>> pack_plan(MissionType.FENCE, []).hex()
    '3d760100000000000000'
    """
    header = _PLAN_HEADER.pack(_PLAN_MAGIC, mission_type, 0, 0, len(items))
    return header + b"".join(_ITEM.pack(*_FIELDS(item)) for item in items)


def unpack_plan(data: bytes, mission_type: MissionType) -> PackedPlan | None:
    """Parse an uploaded plan; None if the plan is of another type, or an item is missing.

    Only missions can be replaced in part, as in ArduPilot.
    """
    if len(data) < _PLAN_HEADER.size:
        return None
    magic, kind, options, start, number = _PLAN_HEADER.unpack_from(data)
    if magic != _PLAN_MAGIC or kind != mission_type or len(data) != _PLAN_HEADER.size + number * _ITEM.size:
        return None
    in_part = bool(options & _PART)
    if in_part and (mission_type is not MissionType.MISSION or number == 0 or start + number > 65535):
        return None
    first = start if in_part else 0
    items = []
    for place in range(number):
        packed = data[_PLAN_HEADER.size + place * _ITEM.size :][: _ITEM.size]
        if not any(packed):
            return None
        one, two, three, four, x, y, z, _, command, _, _, frame, current, goes_on, _ = _ITEM.unpack(packed)
        head = (0, 0, first + place, frame, command, current, goes_on)
        items.append(
            m.MAVLink_mission_item_int_message(*head, one, two, three, four, x, y, z, int(mission_type))
        )
    return PackedPlan(tuple(items), first if in_part else None)


# Other files in @SYS describe threads, memory, ports and storage of a flight controller: not simulated.
_TASKS_PATH = "@SYS/tasks.txt"


def vehicle_files(
    profile: MavlinkProfile, parameters: ParameterSet, logs: FlightLogs, plans: PlanReceiver
) -> FileTree:
    """Return the file tree of a vehicle; contents that take time are generated at the first read."""
    made: dict[str, MadeFile] = {}
    taken: dict[str, TakenFile] = {}
    if profile.component_metadata is not None:
        for path in (GENERAL_PATH, PARAMETERS_PATH):
            made[path] = _whole(partial(_metadata_file, parameters, profile.component_metadata, path))
    if profile.special_files:
        made["@PARAM/param.pck"] = partial(packed, parameters)
        taken["@PARAM/param.pck"] = partial(_take_parameters, parameters)
        for mission_type, path in PLAN_PATHS.items():
            made[path] = _whole(partial(_packed_plan, plans, mission_type))
            taken[path] = partial(_take_plan, plans, mission_type)
        # ArduPilot's task statistics (``AP_Scheduler.cpp``): the header line alone, since there are no tasks.
        made[_TASKS_PATH] = _whole(lambda: b"TasksV2\n")
    behaviour = profile.logs
    return FileTree(
        ("/", behaviour.directory),
        made=made,
        mounted={behaviour.directory: lambda: logs.files(by_date=behaviour.by_date)},
        taken=taken,
    )


def _whole(contents: Callable[[], bytes]) -> MadeFile:
    """Return a file whose contents are generated as a whole; a read with a query fails."""
    return lambda query, _read_size: None if query else contents()


def _take_parameters(parameters: ParameterSet, data: bytes) -> bool:
    values = unpacked(data)
    for name, value in values or ():
        parameters.change(name, value)
    return values is not None


def _packed_plan(plans: PlanReceiver, mission_type: MissionType) -> bytes:
    return pack_plan(mission_type, plans.server.items_on_wire(mission_type))


def _take_plan(plans: PlanReceiver, mission_type: MissionType, data: bytes) -> bool:
    plan = unpack_plan(data, mission_type)
    return plan is not None and plans.take_plan(mission_type, plan.items, plan.start)


def _metadata_file(parameters: ParameterSet, details: Details, path: str) -> bytes:
    defaults = tuple(parameters.default(parameter.name) for parameter in parameters.table)
    return _metadata(parameters.table, defaults, details)[path]


class Files(VehicleExtra):
    """Answers MAVLink FTP and LOG_REQUEST_*, and announces COMPONENT_METADATA."""

    capabilities = int(m.MAV_PROTOCOL_CAPABILITY_FTP)

    def __init__(self, state: WireState, parameters: ParameterSet, plans: PlanReceiver) -> None:
        super().__init__(state, parameters, plans)
        self._logs = FlightLogs(state.epoch_unix_s)
        transfer = LogTransfer(self._logs, state.pilot)
        ftp = FtpServer(vehicle_files(state.mavlink, parameters, self._logs, plans))
        self.timed = (ftp, transfer)
        self.handlers = {
            m.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL: ftp.receive,
            **{message.id: transfer.receive for message in get_args(LogMessage)},
        }

    def log_frame(self, frame: bytes, message_id: int, now_s: float) -> None:
        """Append a frame to the log of the current flight."""
        self._logs.write(frame, message_id, now_s, armed=self.state.pilot.armed)

    def metadata(self) -> tuple[Message, ...]:
        """Return the COMPONENT_METADATA message; empty if the autopilot has no metadata."""
        details = self.state.mavlink.component_metadata
        if details is None:
            return ()
        crc = checksum(_metadata_file(self.parameters, details, GENERAL_PATH))
        address = uri(GENERAL_PATH).encode()
        return (m.MAVLink_component_metadata_message(self.state.boot_ms, crc, address),)
