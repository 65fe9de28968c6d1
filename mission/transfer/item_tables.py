"""Which mission items autopilots know, and what they keep of them.

Sources: PX4 ``mavlink_mission.cpp`` (parse_mavlink_mission_item, format_mavlink_mission_item), ArduPilot
``AP_Mission.cpp`` (mavlink_int_to_mission_cmd, mission_cmd_to_mavlink_int), and what PX4 1.17 (SIH) and
ArduCopter 4.7 (SITL) were seen to do.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

from mission.model import Command, has_position


class ReadBack(Enum):
    """What comes back of a number of an item."""

    NOTHING = "nothing"
    """0."""
    WHOLE = "whole"
    """Without its fraction."""
    SIGN = "sign"
    """-1 for less than zero, otherwise 1."""
    FLAG = "flag"
    """1 for more than zero, otherwise 0."""

    def of(self, value: float | None) -> float:
        """The number that comes back for one that was sent; None is unset.

        >>> ReadBack.WHOLE.of(-2.7), ReadBack.SIGN.of(0.0), ReadBack.FLAG.of(None)
        (-2.0, 1.0, 0.0)
        """
        number = value or 0.0
        match self:
            case ReadBack.NOTHING:
                return 0.0
            case ReadBack.WHOLE:
                return float(int(number))
            case ReadBack.SIGN:
                return -1.0 if number < 0.0 else 1.0
            case ReadBack.FLAG:
                return float(number > 0.0)


# After PX4's parse_mavlink_mission_item: commands in a global frame, and in the frame MISSION.
PX4_PLACED = frozenset(
    {16, 17, 19, 21, 22, 31, 80, 84, 85, 195, 201, 4501, 5000, 5001, 5002, 5003, 5004, 5100}
)
PX4_UNPLACED = frozenset(
    {20, 80, 93, 112, 114, 177, 178, 179, 187, 189, 196, 197, 200, 201, 203, 204, 205, 206, 211, 214}
    | {260, 530, 531, 532, 1000, 1001, 2000, 2001, 2003, 2500, 2501, 3000, 42600}
)
# After ArduPilot's mavlink_int_to_mission_cmd; the camera's from version 4.4 on, DO_RETURN_PATH_START 4.6.
ARDUPILOT_PLACED = frozenset(
    {16, 17, 18, 19, 20, 21, 22, 30, 31, 82, 83, 84, 85, 92, 93, 94, 112, 114, 115, 177, 178, 179}
    | {181, 182, 183, 184, 188, 189, 191, 193, 194, 195, 197, 201, 202, 203, 205, 206, 207, 208, 210, 211}
    | {212, 213, 215, 216, 217, 218, 222, 223, 531, 532, 534, 600, 601, 1000, 2000, 2001, 2500, 2501, 3000}
    | {42600, 42702, 42703, 5000, 5001, 5002, 5003, 5004, 5100}
)
ARDUPILOT_UNPLACED = frozenset(
    command for command in ARDUPILOT_PLACED if not has_position(command)
) | frozenset({179, 188, 189, 191, 201})
_NOTHING, _WHOLE = ReadBack.NOTHING, ReadBack.WHOLE
_SIGN, _FLAG = ReadBack.SIGN, ReadBack.FLAG
_SECOND_ON = {"param2": _NOTHING, "param3": _NOTHING, "param4": _NOTHING}
_ALL = {"param1": _NOTHING, **_SECOND_ON}
_AREAS: Mapping[int, Mapping[str, ReadBack]] = {
    Command.NAV_FENCE_RETURN_POINT: _ALL,
    Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION: _SECOND_ON,
    Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION: _SECOND_ON,
    Command.NAV_FENCE_CIRCLE_INCLUSION: _SECOND_ON,
    Command.NAV_FENCE_CIRCLE_EXCLUSION: _SECOND_ON,
}
PX4_LOSSY: Mapping[int, frozenset[str]] = {
    Command.NAV_WAYPOINT: frozenset({"param3"}),
    Command.NAV_TAKEOFF: frozenset({"param1", "param2", "param3"}),
    Command.NAV_LAND: frozenset({"param1", "param2", "param3"}),
}
PX4_READ_BACK: Mapping[int, Mapping[str, ReadBack]] = {
    Command.NAV_LOITER_UNLIM: {"param1": _NOTHING, "param2": _NOTHING},
    Command.NAV_LOITER_TIME: {"param2": _FLAG, "param4": _FLAG},
    Command.NAV_LOITER_TO_ALT: {"param1": _FLAG, "param3": _NOTHING, "param4": _FLAG},
    Command.DO_SET_ROI_LOCATION: _ALL,
    Command.NAV_RALLY_POINT: _ALL,
    **_AREAS,
}
ARDUPILOT_LOSSY: Mapping[int, frozenset[str]] = {
    Command.NAV_WAYPOINT: frozenset({"param2", "param3", "param4"}),
    Command.NAV_TAKEOFF: frozenset({"param1", "param2", "param3", "param4", "x", "y", "frame"}),
    Command.NAV_LAND: frozenset({"param2", "param3", "param4"}),
    Command.NAV_RETURN_TO_LAUNCH: frozenset({"x", "y", "z", "param2", "param3", "param4"}),
    Command.DO_CHANGE_SPEED: frozenset({"param4"}),
    Command.DO_SET_CAM_TRIGG_DIST: frozenset({"param2", "param4"}),
    Command.DO_JUMP: frozenset({"param3", "param4"}),
}
# The altitude of a fence item comes back as 0 above sea level, that of a rally point in whole metres.
ARDUPILOT_READ_BACK: Mapping[int, Mapping[str, ReadBack]] = {
    Command.NAV_SPLINE_WAYPOINT: {"param1": _WHOLE, **_SECOND_ON},
    Command.NAV_LOITER_UNLIM: {**_ALL, "param3": _WHOLE},
    Command.NAV_LOITER_TURNS: {"param1": _WHOLE, "param2": _NOTHING, "param3": _WHOLE, "param4": _FLAG},
    Command.NAV_LOITER_TIME: {"param1": _WHOLE, "param2": _NOTHING, "param3": _SIGN, "param4": _FLAG},
    Command.NAV_LOITER_TO_ALT: {**_ALL, "param2": _WHOLE, "param4": _FLAG},
    Command.NAV_RETURN_TO_LAUNCH: {"param1": _NOTHING},
    Command.NAV_LAND: {"param1": _WHOLE},
    Command.CONDITION_DELAY: _SECOND_ON,
    Command.CONDITION_DISTANCE: _SECOND_ON,
    Command.DO_LAND_START: _ALL,
    Command.DO_SET_CAM_TRIGG_DIST: {"param3": _FLAG},
    Command.DO_SET_ROI_LOCATION: _SECOND_ON,
    Command.DO_SET_ROI: _SECOND_ON,
    Command.NAV_RALLY_POINT: {**_ALL, "z": _WHOLE},
    **{command: {**known, "z": _NOTHING, "frame": _NOTHING} for command, known in _AREAS.items()},
}
