"""Mission items: command sets, positions, and effects on later items."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from mission.model import Command, Frame, MissionItem
from sim_vehicle.motion.legs import ALONG, KEEP, Heading, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from geo.frame import LocalFrame
    from sim_vehicle.motion.legs import Position

# Commands that are executed between two positions (DO and CONDITION commands).
DO_COMMANDS = frozenset(
    {112, 114, 115, 177, 178, 179, 189, 195, 197, 201, 203, 205, 206, 214, 530}
    | {1000, 1001, 2000, 2001, 2003, 2500, 2501}
)
CAMERA_COMMANDS = frozenset({203, 206, 214, 530, 2000, 2001, 2003})
# Regions of interest, at which the nose of the vehicle and the gimbal point.
ROI_COMMANDS = frozenset({195, 197, 201})
GIMBAL_COMMANDS = ROI_COMMANDS | {205, 1000, 1001}
CONDITIONS = frozenset({int(Command.CONDITION_DELAY), int(Command.CONDITION_DISTANCE)})
POSITION_COMMANDS = frozenset({16, 17, 18, 19, 31, 82})
# Positions, take-off and landing.
PLACED_COMMANDS = POSITION_COMMANDS | {21, 22}
# Positions at which the vehicle need not pause.
PASSED_COMMANDS = frozenset({16, 82})
NAV_COMMANDS = PLACED_COMMANDS | {20, 93}
HERE_COMMANDS = frozenset({17, 18, 19, 21, 22, 31})
MAX_TURNS = 100.0
# Default height and angle of the climb in a go-around, for missions without a take-off item (ArduPlane).
_CLIMB_M, _CLIMB_DEG = 30.0, 10.0


@dataclass(slots=True)
class Settings:
    """Speeds, heading and jump counts that mission items change for later items."""

    speed_m_s: float
    """Ground speed."""
    heading: Heading = ALONG
    """Heading on the way to the next position, unless that item sets a heading."""
    # Vertical speeds; None selects the vehicle's default.
    climb_m_s: float | None = None
    descent_m_s: float | None = None
    jumps: dict[int, int] = field(default_factory=dict)
    """Number of jumps already taken, by index of the jump item."""
    default_m_s: float = 0.0
    """Ground speed that DO_CHANGE_SPEED with -2 restores."""
    yaw_rad: float = field(default=0.0, compare=False)
    """Present heading, from which a relative CONDITION_YAW turns."""

    def copy(self) -> Settings:
        """Return an independent copy."""
        return replace(self, jumps=dict(self.jumps))


def number(value: float | None, default: float = 0.0) -> float:
    """Return a parameter, or `default` if the parameter is None."""
    return default if value is None else value


def item_positions(items: Sequence[MissionItem], frame: LocalFrame, home_up_m: float = 0.0) -> list[Position]:
    """Return the position of each item (east, north, up) in the frame; NaN for an item without a position.

    `home_up_m` is the height of home above the frame's origin; items with altitudes above home need it.
    """
    positions = np.full((len(items), 3), np.nan)
    index = [i for i, item in enumerate(items) if item.has_position]
    if index:
        latitude = np.array([items[i].x for i in index])
        longitude = np.array([items[i].y for i in index])
        x, y = frame.from_wgs84(latitude, longitude)
        ground = np.array([frame.altitude_m if items[i].frame == Frame.GLOBAL else -home_up_m for i in index])
        height = np.array([items[i].z for i in index]) - ground
        here = (latitude == 0.0) & (longitude == 0.0)
        if here.any():
            here &= np.array([items[i].command in HERE_COMMANDS for i in index])
        positions[index] = np.column_stack([np.where(here, np.nan, x), np.where(here, np.nan, y), height])
    return [(x, y, z) for x, y, z in positions.tolist()]


def do_items(
    items: Sequence[MissionItem], start: int, settings: Settings, top_speed_m_s: float
) -> tuple[list[int], int]:
    """Execute the items before the next position and change `settings` accordingly.

    Returns
    -------
    done : list of int
        Indices of the executed items, in order.
    next : int
        Index of the next item with a position or a condition; ``len(items)`` at the end, -1 in endless jumps.
    """
    done: list[int] = []
    seq = start
    while seq < len(items):
        item = items[seq]
        command = item.command
        if command not in DO_COMMANDS or command in CONDITIONS:
            return done, seq
        if len(done) > 2 * len(items) + 100:
            return done, -1
        done.append(seq)
        if command == Command.DO_JUMP:
            taken = settings.jumps.get(seq, 0)
            repeat = number(item.param2)
            if repeat < 0.0 or taken < repeat:
                settings.jumps[seq] = taken + 1
                seq = int(number(item.param1))
                continue
        elif command == Command.DO_CHANGE_SPEED:
            _change_speed(item, settings, top_speed_m_s)
        elif command == Command.CONDITION_YAW:
            settings.heading = Heading.fixed(_yaw(item, settings.yaw_rad))
        seq += 1
    return done, seq


def _change_speed(item: MissionItem, settings: Settings, top_speed_m_s: float) -> None:
    """Set the ground speed (types 0, 1), climb speed (2) or descent speed (3); -2 restores the default."""
    kind, speed = number(item.param1), number(item.param2, -1.0)
    wanted = speed if speed > 0.0 else None
    if wanted is None and speed != -2.0:
        return
    if kind in (0.0, 1.0):
        settings.speed_m_s = min(wanted or settings.default_m_s or settings.speed_m_s, top_speed_m_s)
    elif kind == 2.0:
        settings.climb_m_s = wanted
    elif kind == 3.0:
        settings.descent_m_s = wanted


def _yaw(item: MissionItem, yaw_rad: float) -> float:
    """Return the heading of a CONDITION_YAW; the turn direction to an absolute heading is ignored."""
    angle = math.radians(number(item.param1))
    if number(item.param4) == 0.0:
        return angle
    return yaw_rad + (-angle if number(item.param3) < 0.0 else angle)


def time_of_day_wait_s(item: MissionItem, unix_s: float) -> float:
    """Return the wait until a NAV_DELAY item's time of day: hour, minute, second (UTC); -1 means any.

    Examples
    --------
    >>> noon = 1_780_315_200.0
    >>> time_of_day_wait_s(MissionItem(93, 2, -1.0, 12.0, 30.0, 0.0), noon)
    1800.0
    >>> time_of_day_wait_s(MissionItem(93, 2, -1.0, -1.0, -1.0, 15.0), noon + 20.0)
    55.0
    """
    fields = [number(value, -1.0) for value in (item.param2, item.param3, item.param4)]
    period_s, wanted_s = 60.0, max(fields[2], 0.0)
    if fields[0] >= 0.0:
        period_s, wanted_s = 86_400.0, wanted_s + 3600.0 * fields[0] + 60.0 * max(fields[1], 0.0)
    elif fields[1] >= 0.0:
        period_s, wanted_s = 3600.0, wanted_s + 60.0 * fields[1]
    elif fields[2] < 0.0:
        return 0.0
    return (wanted_s - unix_s) % period_s


def condition_items(items: Sequence[MissionItem], start: int) -> list[int]:
    """Return the condition at `start` and the items that wait for it, up to the next position or jump."""
    group = []
    for seq in range(start, len(items)):
        command = items[seq].command
        if command not in DO_COMMANDS or command == Command.DO_JUMP:
            break
        group.append(seq)
    return group


def climb_leg(
    items: Sequence[MissionItem], seq: int, here: Position, speed: float, height_m: float | None
) -> Leg:
    """Return the straight climb of a go-around (ArduPlane's ``do_land``).

    The climb ends at `height_m`, else at parameter 1 of the landing item, else at the take-off height.
    """
    takeoffs = [item for item in items[:seq] if item.command == Command.NAV_TAKEOFF]
    top = height_m or 0.0
    if top <= 0.0:
        top = number(items[seq].param1)
    if top <= 0.0:
        top = takeoffs[-1].z if takeoffs and takeoffs[-1].z > 0.0 else _CLIMB_M
    pitch = number(takeoffs[-1].param1) if takeoffs else 0.0
    return Leg(
        (here[0], here[1], top),
        speed,
        heading=KEEP,
        kind=LegKind.TAKEOFF,
        pitch_rad=math.radians(pitch if pitch > 0.0 else _CLIMB_DEG),
    )


def landing_start(items: Sequence[MissionItem], positions: Sequence[Position], here: Position) -> int | None:
    """Return the nearest DO_LAND_START item, or None if the mission has none.

    A DO_LAND_START item without coordinates has the position of the next item with coordinates.
    """
    starts = [seq for seq, item in enumerate(items) if item.command == Command.DO_LAND_START]
    if len(starts) < 2:
        return starts[0] if starts else None

    def distance(seq: int) -> float:
        places = (place for place in positions[seq:] if not math.isnan(place[0]))
        x, y, _ = next(places, (math.inf, math.inf, 0.0))
        return math.hypot(x - here[0], y - here[1])

    return min(starts, key=distance)


def landing_restart(
    items: Sequence[MissionItem], positions: Sequence[Position], seq: int, here: Position
) -> int | None:
    """Return the item at which an aborted landing restarts: DO_LAND_START, else the previous position.

    Source: ArduPilot's ``AP_Landing::restart_landing_sequence``.
    """
    start = landing_start(items, positions, here)
    if start is not None:
        return start
    before = (
        index
        for index in range(seq - 1, -1, -1)
        if items[index].command in POSITION_COMMANDS and not math.isnan(positions[index][0])
    )
    return next(before, None)
