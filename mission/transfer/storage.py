"""Rules by which autopilots accept and store mission items.

Sources: PX4 ``mavlink_mission.cpp`` (parse_mavlink_mission_item), ArduPilot ``AP_Mission.cpp``
(mavlink_int_to_mission_cmd, sanity_check_params), and observations of PX4 1.17 and ArduCopter 4.7.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from mission.autopilots.profile import Profile
from mission.errors import MissionError
from mission.model import Command, Frame, MissionItem, MissionType, has_position, plan_of
from mission.transfer import wire

_PARAMETERS = ("param1", "param2", "param3", "param4")
_INT_FRAMES = {0: 5, 3: 6, 10: 11}


class UncheckedItem(MissionItem):
    """Item with invalid numbers, which PX4 stores unchanged; no vehicle can fly such an item."""

    __slots__ = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", {5: 0, 6: 3, 11: 10}.get(self.frame, self.frame))

    @classmethod
    def of(cls, message: wire.ItemMessage) -> UncheckedItem | None:
        """Return the item of a message, or None if the position does not fit into a MISSION_ITEM_INT."""
        placed = message.frame in (0, 3, 5, 6, 10, 11) and has_position(message.command)
        scale = 1e7 if placed and type(message).id == wire.ITEM_INT else 1.0
        x, y = message.x / scale, message.y / scale
        limit = wire.INT32_MAX / (1e7 if placed else 1.0)
        if not (abs(x) <= limit and abs(y) <= limit):
            return None
        first, second, third, fourth = (
            None if math.isnan(value) else value for value in (getattr(message, name) for name in _PARAMETERS)
        )
        carry_on = bool(message.autocontinue)
        return cls(message.command, message.frame, first, second, third, fourth, x, y, message.z, carry_on)


def validate_numbers(message: wire.ItemMessage, profile: Profile) -> int:
    """Return the MAV_MISSION_RESULT for the numbers of a received item; some parameters must not be NaN."""
    if profile.nan_parameters is None:
        return int(wire.ACCEPTED)
    allowed = profile.nan_parameters.get(message.command, frozenset())
    for offset, name in enumerate(_PARAMETERS):
        value = getattr(message, name)
        if not math.isfinite(value) and not (math.isnan(value) and name in allowed):
            return int(wire.INVALID_PARAM1) + offset
    if math.isnan(message.z):
        return int(wire.INVALID_PARAM5_X) + 2
    return int(wire.ACCEPTED)


def validate_item(item: MissionItem, count: int, profile: Profile) -> int:
    """Return the MAV_MISSION_RESULT for command, frame and jump target of a received item.

    ``count`` is the number of items of the plan on the wire. Jump targets use the autopilot's numbering.

    >>> from mission.autopilots import PX4
    >>> validate_item(MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.GLOBAL_RELATIVE_ALT), 1, PX4)
    3
    """
    known = profile.unplaced if item.frame == Frame.MISSION else profile.placed
    without = item.frame == Frame.MISSION and known is not None and item.command in known
    judged = (has_position(item.command) and not without) or profile.strict_frames
    if profile.frames is not None and item.frame not in profile.frames and judged:
        return int(wire.UNSUPPORTED_FRAME)
    if known is not None and item.command not in known:
        return int(wire.UNSUPPORTED)
    if item.command == Command.DO_JUMP and profile.checks_jumps:
        target = int(item.param1 or 0.0)
        if not 0 < target < count:
            return int(wire.ERROR)
    roi = item.command == Command.DO_SET_ROI and item.frame != Frame.MISSION
    modes = profile.dialect.roi_modes
    if roi and modes is not None and item.param1 not in modes:
        return int(wire.INVALID_PARAM1)
    return int(wire.ACCEPTED)


def as_stored(item: MissionItem, profile: Profile) -> MissionItem:
    """Return the item as the autopilot stores and flies it.

    >>> from mission.autopilots import ARDUPILOT
    >>> as_stored(MissionItem(Command.NAV_RETURN_TO_LAUNCH), ARDUPILOT).frame
    0
    """
    changes: dict[str, Any] = {}
    lost = profile.lossy.get(item.command, frozenset())
    for name in _PARAMETERS:
        value = getattr(item, name)
        if (name in lost and value != 0.0) or (value is None and not profile.keeps_default):
            changes[name] = 0.0
    if not item.has_position:
        if not profile.keeps_frame and item.frame != Frame.GLOBAL:
            changes["frame"] = Frame.GLOBAL
        changes |= {name: 0.0 for name in ("x", "y", "z") if name in lost and getattr(item, name) != 0.0}
    kind = MissionType.MISSION
    if not item.autocontinue and kind not in profile.keeps_autocontinue and plan_of(item.command) is kind:
        changes["autocontinue"] = True  # The autopilot always continues after the item
    if profile.whole_seconds and item.command == Command.NAV_WAYPOINT and item.param1:
        changes["param1"] = float(min(65535, max(0, int(item.param1))))
    try:
        return replace(item, **changes) if changes else item
    except MissionError:  # Its numbers are no position in the frame of the autopilot's storage
        return item


def as_read_back(item: MissionItem, profile: Profile) -> MissionItem:
    """Return a stored item as the autopilot sends it in a download.

    >>> from mission.autopilots import ARDUPILOT
    >>> loiter = MissionItem(Command.NAV_LOITER_TIME, 3, 2.5, x=28.05, y=-82.15, z=10.0)
    >>> back = as_read_back(loiter, ARDUPILOT)
    >>> back.param1, back.param3
    (2.0, 1.0)
    """
    known = profile.read_back.get(item.command, {})
    changes: dict[str, Any] = {name: kind.of(getattr(item, name)) for name, kind in known.items()}
    if "frame" in changes:
        changes["frame"] = int(changes["frame"])
    kind = plan_of(item.command)
    if kind not in profile.keeps_autocontinue:
        changes["autocontinue"] = kind is MissionType.MISSION
    return replace(item, **changes) if changes else item


def frame_on_wire(item: MissionItem, profile: Profile, *, integer: bool) -> int:
    """Return the frame of an item in a download; PX4 uses the INT frames in MISSION_ITEM_INT."""
    return _INT_FRAMES.get(item.frame, item.frame) if integer and profile.int_frames else item.frame
