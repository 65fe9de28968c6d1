"""Mission model shared by planners, mission files and the MAVLink mission protocol.

A parameter that is None stands for the vehicle's default value: NaN on the wire, ``null`` in a .plan file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import IntEnum

from mission.errors import MissionError


class Frame(IntEnum):
    """The coordinate frames (MAV_FRAME) that missions use."""

    GLOBAL = 0
    MISSION = 2
    GLOBAL_RELATIVE_ALT = 3
    GLOBAL_INT = 5
    GLOBAL_RELATIVE_ALT_INT = 6
    GLOBAL_TERRAIN_ALT = 10
    GLOBAL_TERRAIN_ALT_INT = 11


class Command(IntEnum):
    """The commands (MAV_CMD) that this program uses by name."""

    NAV_WAYPOINT = 16
    NAV_LOITER_UNLIM = 17
    NAV_LOITER_TURNS = 18
    NAV_LOITER_TIME = 19
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    NAV_LOITER_TO_ALT = 31
    NAV_SPLINE_WAYPOINT = 82
    NAV_DELAY = 93
    CONDITION_DELAY = 112
    CONDITION_DISTANCE = 114
    CONDITION_YAW = 115
    DO_SET_MODE = 176
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178
    DO_SET_HOME = 179
    DO_LAND_START = 189
    DO_SET_ROI_LOCATION = 195
    DO_SET_ROI_NONE = 197
    DO_SET_ROI = 201
    DO_SET_CAM_TRIGG_DIST = 206
    DO_SET_CAM_TRIGG_INTERVAL = 214
    IMAGE_START_CAPTURE = 2000
    IMAGE_STOP_CAPTURE = 2001
    NAV_FENCE_RETURN_POINT = 5000
    NAV_FENCE_POLYGON_VERTEX_INCLUSION = 5001
    NAV_FENCE_POLYGON_VERTEX_EXCLUSION = 5002
    NAV_FENCE_CIRCLE_INCLUSION = 5003
    NAV_FENCE_CIRCLE_EXCLUSION = 5004
    NAV_RALLY_POINT = 5100


class MissionType(IntEnum):
    """The three plans that a vehicle stores (MAV_MISSION_TYPE)."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


_FENCE_COMMANDS = range(Command.NAV_FENCE_RETURN_POINT, Command.NAV_FENCE_CIRCLE_EXCLUSION + 1)
GLOBAL_FRAMES = frozenset({0, 3, 5, 6, 10, 11})
RELATIVE_FRAMES = frozenset({3, 6})
DEGREES_E7 = 1e7
FLOAT32_MAX = 3.4028235e38
MAX_ITEMS = 65535  # MAVLink's sequence numbers and counts have 16 bits.
# The commands marked hasLocation in the MAVLink XML, except for 23 and 24, which use local frames.
_POSITION_COMMANDS = frozenset(
    {16, 17, 18, 19, 21, 22, 25, 31, 34, 35, 36, 80, 81, 82, 84, 85, 94}
    | {179, 188, 189, 192, 195, 201, 252, 611}
    | {4001, 4501, 5000, 5001, 5002, 5003, 5004, 5100, 30001, 43003}
    | set(range(31000, 31010))
)
# NAV_CONTINUE_AND_CHANGE_ALT has no latitude, but its z is an altitude in the frame of the item.
_ALTITUDE_COMMANDS = frozenset({30})


def has_position(command: int) -> bool:
    """Return whether x, y, z of a command are a position, not the parameters 5 to 7."""
    return command in _POSITION_COMMANDS


def plan_of(command: int) -> MissionType:
    """Return the plan that a command belongs to.

    >>> plan_of(5100).name
    'RALLY'
    """
    if command in _FENCE_COMMANDS:
        return MissionType.FENCE
    return MissionType.RALLY if command == Command.NAV_RALLY_POINT else MissionType.MISSION


@dataclass(frozen=True, slots=True)
class GeoPoint:
    """A position: degrees of WGS84 and metres above mean sea level."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0

    def __post_init__(self) -> None:
        check_place(self.latitude_deg, self.longitude_deg, self.altitude_m, "point")


def check_place(latitude_deg: float, longitude_deg: float, altitude_m: float, what: str) -> None:
    """Raise MissionError unless the position is finite and on the globe."""
    for name, value, limit in (
        ("latitude", latitude_deg, 90.0),
        ("longitude", longitude_deg, 180.0),
        ("altitude", altitude_m, 100_000.0),
    ):
        if not math.isfinite(value) or abs(value) > limit:
            raise MissionError(f"{what}: {name} {value} is outside -{limit:g}..{limit:g}")


@dataclass(frozen=True, slots=True)
class MissionItem:
    """A MAVLink mission item.

    Parameters
    ----------
    command : int
        MAV_CMD.
    frame : int
        MAV_FRAME. The INT frames 5, 6 and 11 become the equivalent frames 0, 3 and 10.
    param1, param2, param3, param4 : float or None
        Parameters of the command; None is the vehicle's default (NaN). The target of a DO_JUMP (param1) is
        an index into `Mission.items`, from 0, for every autopilot and file format.
    x, y : float
        Latitude and longitude in degrees, rounded to 1e-7 degree, if the frame is global and the command has
        a position. Otherwise parameters 5 and 6.
    z : float
        Altitude in metres in the frame if x and y are a position, otherwise parameter 7.
    autocontinue : bool
        Whether the vehicle continues with the next item when this item is complete.

    Raises
    ------
    MissionError
        If a number is not finite or out of its field's range, or the position is not on the globe.

    Examples
    --------
    >>> MissionItem.waypoint(28.05, -82.15, 10.0).z
    10.0
    """

    command: int
    frame: int = Frame.MISSION
    param1: float | None = 0.0
    param2: float | None = 0.0
    param3: float | None = 0.0
    param4: float | None = 0.0
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    autocontinue: bool = True

    def __post_init__(self) -> None:
        frame = {5: 0, 6: 3, 11: 10}.get(self.frame, self.frame)
        object.__setattr__(self, "frame", int(frame))
        object.__setattr__(self, "command", int(self.command))
        if not 0 <= self.command <= 65535:
            raise MissionError(f"mission item: command {self.command} is outside 0..65535")
        if not 0 <= self.frame <= 255:
            raise MissionError(f"mission item: frame {self.frame} is outside 0..255")
        for name in ("param1", "param2", "param3", "param4"):
            value = getattr(self, name)
            if value is None:
                continue
            if math.isnan(value):
                object.__setattr__(self, name, None)
            elif not math.isfinite(value) or abs(value) > FLOAT32_MAX:
                msg = f"mission item (command {self.command}): {name} {value} does not fit a 32-bit float"
                raise MissionError(msg)
        if self.has_position:
            check_place(self.x, self.y, self.z, f"mission item (command {self.command})")
            object.__setattr__(self, "x", round(self.x * DEGREES_E7) / DEGREES_E7)
            object.__setattr__(self, "y", round(self.y * DEGREES_E7) / DEGREES_E7)
            return
        for name, limit in (("x", 2147483647.0), ("y", 2147483647.0), ("z", FLOAT32_MAX)):
            value = getattr(self, name)
            if not math.isfinite(value) or abs(value) > limit:
                msg = f"mission item (command {self.command}): {name} {value} is not in -{limit:g}..{limit:g}"
                raise MissionError(msg)

    @property
    def has_position(self) -> bool:
        """Whether x, y, z are a latitude, a longitude and an altitude."""
        return self.frame in GLOBAL_FRAMES and has_position(self.command)

    @classmethod
    def waypoint(
        cls,
        latitude_deg: float,
        longitude_deg: float,
        altitude_m: float,
        *,
        hold_s: float = 0.0,
        acceptance_radius_m: float = 0.0,
        yaw_deg: float | None = None,
    ) -> MissionItem:
        """Return a NAV_WAYPOINT at an altitude above home; without `yaw_deg`, with the default heading."""
        return cls(
            Command.NAV_WAYPOINT,
            Frame.GLOBAL_RELATIVE_ALT,
            hold_s,
            acceptance_radius_m,
            0.0,
            yaw_deg,
            latitude_deg,
            longitude_deg,
            altitude_m,
        )

    def in_standard_frame(self) -> MissionItem:
        """Return the item, in frame MISSION if its command has no position.

        ArduPilot's tools write commands without a position in frame 0 or 3, which PX4 refuses. Every
        autopilot accepts frame MISSION.

        >>> MissionItem(Command.DO_CHANGE_SPEED, frame=3, param2=5.0).in_standard_frame().frame
        2
        """
        if self.frame not in GLOBAL_FRAMES or self.has_position or self.command in _ALTITUDE_COMMANDS:
            return self
        return replace(self, frame=Frame.MISSION)

    def wire_x(self) -> int:
        """Return ``x`` for MISSION_ITEM_INT: degE7 for a position, otherwise the parameter itself."""
        return round(self.x * DEGREES_E7) if self.has_position else int(self.x)

    def wire_y(self) -> int:
        """Return ``y`` for MISSION_ITEM_INT: degE7 for a position, otherwise the parameter itself."""
        return round(self.y * DEGREES_E7) if self.has_position else int(self.y)


@dataclass(frozen=True, slots=True)
class Mission:
    """Mission items, geofence, rally points and planned home of a vehicle.

    Parameters
    ----------
    items : tuple of MissionItem
        Mission items without home. ArduPilot's home item 0 is added only on transfer and in WPL files.
    home : GeoPoint or None
        Planned home position; relative altitudes are altitudes above home.
    fence, rally : tuple of MissionItem
        Geofence items (commands 5000 to 5004) and rally points (5100).
    cruise_speed_m_s, hover_speed_m_s : float
        Speeds for a ground station's time estimates.

    Raises
    ------
    MissionError
        If a plan has more than `MAX_ITEMS` items, or a speed is negative or not finite.
    """

    items: tuple[MissionItem, ...]
    home: GeoPoint | None = None
    fence: tuple[MissionItem, ...] = field(default=())
    rally: tuple[MissionItem, ...] = field(default=())
    cruise_speed_m_s: float = 15.0
    hover_speed_m_s: float = 5.0

    def __post_init__(self) -> None:
        for name in ("items", "fence", "rally"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
            count = len(getattr(self, name))
            if count > MAX_ITEMS:
                msg = f"mission: {name} has {count} items, but the maximum is {MAX_ITEMS}; fly it in parts"
                raise MissionError(msg)
        for name in ("cruise_speed_m_s", "hover_speed_m_s"):
            speed = getattr(self, name)
            if not math.isfinite(speed) or speed < 0.0:
                raise MissionError(f"mission: {name} is {speed}; give a speed of 0 m/s or more")

    def plan(self, mission_type: MissionType) -> tuple[MissionItem, ...]:
        """Return the items of one of the three plans."""
        return (self.items, self.fence, self.rally)[mission_type]
