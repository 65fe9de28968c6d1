"""Conversion between mission items and MAVLink messages.

MISSION_ITEM_INT (73) carries positions in 1e-7 degrees, MISSION_ITEM (39) in 32-bit floats (resolution 0.4 to
1.7 m). Fields: https://mavlink.io/en/messages/common.html.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

from mission.autopilots.profile import Profile
from mission.link.codec.dialect import Message, mavlink
from mission.model import (
    DEGREES_E7,
    FLOAT32_MAX,
    GLOBAL_FRAMES,
    Command,
    Frame,
    GeoPoint,
    MissionItem,
    MissionType,
    has_position,
)

if TYPE_CHECKING:
    from typing_extensions import TypeIs

PARTIAL_LIST = mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_PARTIAL_LIST
WRITE_PARTIAL = mavlink.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST
ITEM = mavlink.MAVLINK_MSG_ID_MISSION_ITEM
REQUEST = mavlink.MAVLINK_MSG_ID_MISSION_REQUEST
LIST = mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST
COUNT = mavlink.MAVLINK_MSG_ID_MISSION_COUNT
CLEAR = mavlink.MAVLINK_MSG_ID_MISSION_CLEAR_ALL
ACK = mavlink.MAVLINK_MSG_ID_MISSION_ACK
REQUEST_INT = mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT
ITEM_INT = mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT

CLIENT_MESSAGES = frozenset({ITEM, REQUEST, COUNT, ACK, REQUEST_INT, ITEM_INT})
SERVER_MESSAGES = CLIENT_MESSAGES | {PARTIAL_LIST, WRITE_PARTIAL, LIST, CLEAR}

ItemMessage: TypeAlias = mavlink.MAVLink_mission_item_int_message | mavlink.MAVLink_mission_item_message
RequestMessage: TypeAlias = (
    mavlink.MAVLink_mission_request_int_message | mavlink.MAVLink_mission_request_message
)
PartialMessage: TypeAlias = (
    mavlink.MAVLink_mission_request_partial_list_message | mavlink.MAVLink_mission_write_partial_list_message
)
CountMessage: TypeAlias = mavlink.MAVLink_mission_count_message
AckMessage: TypeAlias = mavlink.MAVLink_mission_ack_message
MissionMessage: TypeAlias = (
    ItemMessage
    | RequestMessage
    | PartialMessage
    | CountMessage
    | AckMessage
    | mavlink.MAVLink_mission_request_list_message
    | mavlink.MAVLink_mission_clear_all_message
)

GROUND_STATION = (255, int(mavlink.MAV_COMP_ID_MISSIONPLANNER))
"""System and component id of a ground station."""
ALL_TYPES = 255
INT32_MAX = 2147483647.0
MAX_ITEMS = 65535

ACCEPTED = mavlink.MAV_MISSION_ACCEPTED
ERROR = mavlink.MAV_MISSION_ERROR
UNSUPPORTED_FRAME = mavlink.MAV_MISSION_UNSUPPORTED_FRAME
UNSUPPORTED = mavlink.MAV_MISSION_UNSUPPORTED
NO_SPACE = mavlink.MAV_MISSION_NO_SPACE
INVALID = mavlink.MAV_MISSION_INVALID
INVALID_PARAM1 = mavlink.MAV_MISSION_INVALID_PARAM1
INVALID_PARAM5_X = mavlink.MAV_MISSION_INVALID_PARAM5_X
INVALID_SEQUENCE = mavlink.MAV_MISSION_INVALID_SEQUENCE
DENIED = mavlink.MAV_MISSION_DENIED
OPERATION_CANCELLED = mavlink.MAV_MISSION_OPERATION_CANCELLED

_MEANINGS = {
    ACCEPTED: "accepted",
    ERROR: "error, perhaps because of another transfer; try again",
    UNSUPPORTED_FRAME: "the item's coordinate frame is not supported; use relative altitudes",
    UNSUPPORTED: "the item's command or this kind of plan is not supported",
    NO_SPACE: "too many items for the vehicle; send a shorter plan",
    INVALID: "a value or the kind of plan is invalid",
    6: "parameter 1 of an item is invalid",
    7: "parameter 2 of an item is invalid",
    8: "parameter 3 of an item is invalid",
    9: "parameter 4 of an item is invalid",
    10: "the latitude (x, parameter 5) of an item is invalid",
    11: "the longitude (y, parameter 6) of an item is invalid",
    12: "the altitude (z, parameter 7) of an item is invalid",
    INVALID_SEQUENCE: "an item came out of order",
    DENIED: "mission commands of this sender are not accepted; another station may be transferring a plan",
    OPERATION_CANCELLED: "the transfer was cancelled",
}


def ground_heartbeat() -> Message:
    """Return the HEARTBEAT of a ground station."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )


def command_long(target: tuple[int, int], command: int, *params: float) -> Message:
    """Return a COMMAND_LONG with confirmation 0; missing parameters are 0."""
    values = (*params, *[0.0] * (7 - len(params)))
    return mavlink.MAVLink_command_long_message(*target, int(command), 0, *values)


def to_server(message: Message) -> TypeIs[MissionMessage]:
    """Whether a message is a mission message that vehicles handle."""
    return type(message).id in SERVER_MESSAGES


def to_client(message: Message) -> TypeIs[ItemMessage | RequestMessage | CountMessage | AckMessage]:
    """Whether a message is a mission message that ground stations handle."""
    return type(message).id in CLIENT_MESSAGES


def is_item(message: Message) -> TypeIs[ItemMessage]:
    """Whether a message is a MISSION_ITEM_INT or MISSION_ITEM."""
    return type(message).id in (ITEM_INT, ITEM)


def is_request(message: Message) -> TypeIs[RequestMessage]:
    """Whether a message is a MISSION_REQUEST_INT or MISSION_REQUEST."""
    return type(message).id in (REQUEST_INT, REQUEST)


def is_partial(message: Message) -> TypeIs[PartialMessage]:
    """Whether a message is a MISSION_REQUEST_PARTIAL_LIST or MISSION_WRITE_PARTIAL_LIST."""
    return type(message).id in (PARTIAL_LIST, WRITE_PARTIAL)


def enum_name(enum: str, value: int, otherwise: str) -> str:
    """Return MAVLink's name of an enum value, or ``otherwise`` for an unknown value."""
    entry = mavlink.enums[enum].get(value)
    return otherwise if entry is None else entry.name


def result_text(result: int) -> str:
    """Return the meaning of a MAV_MISSION_RESULT as text.

    >>> result_text(13)
    'an item came out of order (MAV_MISSION_INVALID_SEQUENCE)'
    """
    name = enum_name("MAV_MISSION_RESULT", result, f"result {result}")
    return f"{_MEANINGS.get(result, 'unknown result')} ({name})"


def command_name(command: int) -> str:
    """Return the name of a MAV_CMD without the prefix.

    >>> command_name(16), command_name(4)
    ('NAV_WAYPOINT', 'command 4')
    """
    return enum_name("MAV_CMD", command, f"command {command}").removeprefix("MAV_CMD_")


def ack(target: tuple[int, int], result: int, mission_type: int, opaque_id: int = 0) -> AckMessage:
    """Return a MISSION_ACK with the plan id (0 for none)."""
    return mavlink.MAVLink_mission_ack_message(
        *target, result, mission_type=mission_type, opaque_id=opaque_id
    )


def count(target: tuple[int, int], number: int, mission_type: int, opaque_id: int = 0) -> CountMessage:
    """Return a MISSION_COUNT with the plan id (0 for none)."""
    return mavlink.MAVLink_mission_count_message(
        *target, number, mission_type=mission_type, opaque_id=opaque_id
    )


def clear_all(target: tuple[int, int], mission_type: int) -> Message:
    """Return a MISSION_CLEAR_ALL of one plan type, or of all plan types for 255."""
    return mavlink.MAVLink_mission_clear_all_message(*target, mission_type)


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def item_to_message(
    item: MissionItem,
    sequence: int,
    mission_type: int,
    target: tuple[int, int],
    *,
    current: bool = False,
    integer: bool = True,
    frame: int | None = None,
) -> ItemMessage:
    """Return the MISSION_ITEM_INT of an item, or the MISSION_ITEM if not ``integer``.

    Parameters that are None are sent as NaN. ``current`` marks the item at which the mission starts.
    ``frame`` overrides the frame of the item (5 and 6 mean the same as 0 and 3).
    """
    common = (
        target[0],
        target[1],
        sequence,
        item.frame if frame is None else frame,
        item.command,
        int(current),
        int(item.autocontinue),
        _number(item.param1),
        _number(item.param2),
        _number(item.param3),
        _number(item.param4),
    )
    if integer:
        return mavlink.MAVLink_mission_item_int_message(
            *common, item.wire_x(), item.wire_y(), item.z, mission_type
        )
    return mavlink.MAVLink_mission_item_message(*common, item.x, item.y, item.z, mission_type)


def _parameter(value: float) -> float | None:
    return None if math.isnan(value) else value


def item_from_message(message: ItemMessage) -> MissionItem:
    """Return the mission item of a MISSION_ITEM_INT or MISSION_ITEM.

    NaN in parameters 5 to 7 of a command without a position becomes 0 ("not used"). Raises MissionError if a
    number is infinite or the position is out of range; `refusal` returns the MAV_MISSION_RESULT to send.
    """
    placed = message.frame in GLOBAL_FRAMES and has_position(message.command)
    x, y, z = message.x, message.y, message.z
    if placed:
        if type(message).id == ITEM_INT:
            x, y = x / DEGREES_E7, y / DEGREES_E7
    else:
        x, y, z = (0.0 if math.isnan(value) else float(value) for value in (x, y, z))
    return MissionItem(
        message.command,
        message.frame,
        _parameter(message.param1),
        _parameter(message.param2),
        _parameter(message.param3),
        _parameter(message.param4),
        x,
        y,
        z,
        bool(message.autocontinue),
    )


def refusal(message: ItemMessage) -> int:
    """Return the MAV_MISSION_RESULT for a message that `item_from_message` refused."""
    for offset, value in enumerate((message.param1, message.param2, message.param3, message.param4)):
        if abs(value) > FLOAT32_MAX:
            return int(INVALID_PARAM1) + offset
    placed = message.frame in GLOBAL_FRAMES and has_position(message.command)
    scale = DEGREES_E7 if placed and message.id == ITEM_INT else 1.0
    limits = (90.0, 180.0, 100_000.0) if placed else (INT32_MAX, INT32_MAX, FLOAT32_MAX)
    for offset, value in enumerate((message.x / scale, message.y / scale, message.z)):
        if not abs(value) <= limits[offset]:
            return int(INVALID_PARAM5_X) + offset
    return int(INVALID)


_ITEM_BYTES = struct.Struct("<BHB4fiif")


def plan_checksum(items: Iterable[MissionItem]) -> int:
    """Return the opaque id of a plan, a CRC32 over its items.

    The hashed fields (frame, command, autocontinue, seven parameters) are the same as in PX4
    (``mavlink_mission.cpp``). An empty plan has the id 0, which MAVLink reserves for "none"; other plans
    never have the id 0.
    """
    checksum = 0
    empty = True
    for item in items:
        empty = False
        checksum = zlib.crc32(
            _ITEM_BYTES.pack(
                item.frame,
                item.command,
                item.autocontinue,
                _number(item.param1),
                _number(item.param2),
                _number(item.param3),
                _number(item.param4),
                item.wire_x(),
                item.wire_y(),
                item.z,
            ),
            checksum,
        )
    return 0 if empty else checksum or 1


def plan_type(number: int) -> MissionType | None:
    """Return the plan type of a MAV_MISSION_TYPE, None if unknown."""
    return MissionType(number) if 0 <= number <= 2 else None


def _shift_jump(item: MissionItem, by: int) -> MissionItem:
    if item.command != Command.DO_JUMP or item.param1 is None:
        return item
    return replace(item, param1=item.param1 + by)


def home_items(home: GeoPoint) -> tuple[MissionItem]:
    """Return home as a plan with one waypoint."""
    return (
        MissionItem(
            Command.NAV_WAYPOINT, Frame.GLOBAL, x=home.latitude_deg, y=home.longitude_deg, z=home.altitude_m
        ),
    )


def to_wire_order(
    items: tuple[MissionItem, ...], mission_type: MissionType, profile: Profile, home: GeoPoint | None = None
) -> tuple[MissionItem, ...]:
    """Return the items in the autopilot's numbering, which may have home as item 0 and shift jump targets."""
    if not profile.home_at_zero or mission_type != MissionType.MISSION or not items:
        return items
    first = home_items(GeoPoint(0.0, 0.0, 0.0) if home is None else home)
    return (*first, *(_shift_jump(item, 1) for item in items))


def from_wire_order(
    items: tuple[MissionItem, ...], mission_type: MissionType, profile: Profile
) -> tuple[tuple[MissionItem, ...], GeoPoint | None]:
    """Return the items without home, and home (or None), from items in the autopilot's numbering."""
    if not profile.home_at_zero or mission_type != MissionType.MISSION or not items:
        return items, None
    home = GeoPoint(items[0].x, items[0].y, items[0].z) if items[0].has_position else None
    return tuple(_shift_jump(item, -1) for item in items[1:]), home
