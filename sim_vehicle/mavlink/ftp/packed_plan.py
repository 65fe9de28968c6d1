"""ArduPilot's packed plans: ``@MISSION/mission.dat``, ``fence.dat`` and ``rally.dat``.

A header, and MISSION_ITEM_INT after MISSION_ITEM_INT as they are on the wire, little-endian. Format:
ArduPilot's ``AP_Filesystem_Mission.cpp`` and ``.h``.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

from mission.link.codec.dialect import mavlink as m
from mission.model import MissionType

__all__ = ["PLAN_PATHS", "PackedPlan", "pack_plan", "unpack_plan"]

PLAN_PATHS = {
    MissionType.MISSION: "@MISSION/mission.dat",
    MissionType.FENCE: "@MISSION/fence.dat",
    MissionType.RALLY: "@MISSION/rally.dat",
}
"""The file of each plan."""
_MAGIC = 0x763D
_HEADER = struct.Struct("<5H")  # magic, kind of plan, options, first item, number of items
_ITEM = struct.Struct("<4f2if2H6B")
_PART = 1


@dataclass(frozen=True, slots=True)
class PackedPlan:
    """A plan as it was uploaded.

    Parameters
    ----------
    mission_type : MissionType
    items : tuple of MISSION_ITEM_INT
        Numbered from `start`.
    start : int or None
        The first item that they replace; None where they are a whole plan.
    """

    mission_type: MissionType
    items: tuple[m.MAVLink_mission_item_int_message, ...]
    start: int | None = None


def pack_plan(mission_type: MissionType, items: Sequence[m.MAVLink_mission_item_int_message]) -> bytes:
    """Pack a whole plan.

    Examples
    --------
    >>> pack_plan(MissionType.FENCE, []).hex()
    '3d760100000000000000'
    """
    return _HEADER.pack(_MAGIC, mission_type, 0, 0, len(items)) + b"".join(
        _ITEM.pack(
            item.param1,
            item.param2,
            item.param3,
            item.param4,
            item.x,
            item.y,
            item.z,
            item.seq,
            item.command,
            item.target_system,
            item.target_component,
            item.frame,
            item.current,
            item.autocontinue,
            item.mission_type,
        )
        for item in items
    )


def unpack_plan(data: bytes, mission_type: MissionType) -> PackedPlan | None:
    """Read an upload; None where it is no plan of this kind, or has gaps.

    Only a mission can be replaced in part, as in ArduPilot.
    """
    if len(data) < _HEADER.size:
        return None
    magic, kind, options, start, number = _HEADER.unpack_from(data)
    if magic != _MAGIC or kind != mission_type or len(data) != _HEADER.size + number * _ITEM.size:
        return None
    in_part = bool(options & _PART)
    if in_part and (mission_type is not MissionType.MISSION or number == 0 or start + number > 65535):
        return None
    first = start if in_part else 0
    items = []
    for place in range(number):
        packed = data[_HEADER.size + place * _ITEM.size :][: _ITEM.size]
        if not any(packed):
            return None
        fields = _ITEM.unpack(packed)
        param1, param2, param3, param4, x, y, z, _seq, command = fields[:9]
        frame, current, goes_on = fields[11:14]
        items.append(
            m.MAVLink_mission_item_int_message(
                0,
                0,
                first + place,
                frame,
                command,
                current,
                goes_on,
                param1,
                param2,
                param3,
                param4,
                x,
                y,
                z,
                int(mission_type),
            )
        )
    return PackedPlan(mission_type, tuple(items), first if in_part else None)
