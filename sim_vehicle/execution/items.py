"""Mission items: command sets, positions, effects on later items, and whether a vehicle can fly them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from mission.model import Command, Frame, MissionItem
from sim_vehicle.autopilot import fixed_wing_procedures
from sim_vehicle.motion.legs import ALONG, KEEP, Heading, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from geo.frame import LocalFrame
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Position

# Relays, servos, fence, gripper, sprayer, zoom, winch and scripts: without effect on the path.
OUTPUT_COMMANDS = frozenset(
    {181, 182, 183, 184, 187, 200, 202, 204, 207, 211, 212, 215, 216, 217, 218, 222, 223}
    | {531, 532, 534, 42600}
)
# Commands that are executed between two positions (DO and CONDITION commands).
DO_COMMANDS = OUTPUT_COMMANDS | frozenset(
    {112, 114, 115, 177, 178, 179, 189, 195, 197, 201, 203, 205, 206, 214, 530}
    | {1000, 1001, 2000, 2001, 2003, 2500, 2501}
)
CAMERA_COMMANDS = frozenset({203, 206, 214, 530, 2000, 2001, 2003})
# Regions of interest, at which the nose of the vehicle and the gimbal point.
ROI_COMMANDS = frozenset({195, 197, 201})
GIMBAL_COMMANDS = ROI_COMMANDS | {205, 1000, 1001}
EXTRA_COMMANDS = CAMERA_COMMANDS | GIMBAL_COMMANDS | OUTPUT_COMMANDS
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
# Frames of positions; largest radius of a circle; commands with a time in parameter 1.
_FRAMES = frozenset({int(Frame.GLOBAL), int(Frame.GLOBAL_RELATIVE_ALT), int(Frame.GLOBAL_TERRAIN_ALT)})
_MAX_RADIUS_M = 5000.0
_TIMED = frozenset({16, 19, 82, 93, 112})
# Plain integers replace enumeration members, because every prediction checks thousands of items.
_WAYPOINT = int(Command.NAV_WAYPOINT)


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

    `home_up_m` is the height of home above the frame's origin; the flat terrain is as high as the origin.
    """
    positions = np.full((len(items), 3), np.nan)
    index = [i for i, item in enumerate(items) if item.has_position]
    if index:
        latitude = np.array([items[i].x for i in index])
        longitude = np.array([items[i].y for i in index])
        x, y = frame.from_wgs84(latitude, longitude)
        grounds = {int(Frame.GLOBAL): frame.altitude_m, int(Frame.GLOBAL_TERRAIN_ALT): 0.0}
        ground = np.array([grounds.get(items[i].frame, -home_up_m) for i in index])
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

    The climb ends at the first value above 0 of `height_m`, the item's parameter 1 and the take-off height.
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


@dataclass(frozen=True, slots=True)
class ItemProblem:
    """Reason why a vehicle cannot fly an item or the mission.

    Examples
    --------
    >>> str(ItemProblem(3, 16, "altitude", "altitude -1.0 m above home is outside 0..500"))
    'item 4 (NAV_WAYPOINT): altitude -1.0 m above home is outside 0..500'
    """

    item: int | None
    """Item index from 0; None if the problem concerns the whole mission."""
    command: int
    """MAV_CMD of the item; 0 if the problem concerns the whole mission."""
    code: str
    """Kind of the problem, in hyphenated words."""
    reason: str

    def __str__(self) -> str:
        if self.item is None:
            return self.reason
        return f"item {self.item + 1} ({_name(self.command)}): {self.reason}"


def check_mission(
    items: Sequence[MissionItem],
    frame: LocalFrame,
    spec: VehicleSpec,
    *,
    needs_takeoff: bool = True,
    outside: Callable[[Position], str | None] | None = None,
    home_up_m: float = 0.0,
) -> list[ItemProblem]:
    """List the reasons why a vehicle cannot fly a mission; the list is empty if the vehicle can fly it.

    The checks cover commands, frames, parameters, altitudes, distances from home, jumps and the take-off.
    Energy is checked by `sim_vehicle.prediction.predict`.

    `items` does not contain home. `needs_takeoff` says that the vehicle cannot start on the ground without a
    take-off item. `outside` is a function that takes a position (east, north, up) and returns the reason why
    the fence excludes the position, or None. As in real autopilots, the fence check covers the positions, but
    not the paths between them. `home_up_m` is the height of home above the frame's origin.

    Examples
    --------
    >>> from geo.frame import LocalFrame
    >>> from mission.model import MissionItem
    >>> from sim_vehicle.airframe.catalog import get_vehicle
    >>> items = [MissionItem.waypoint(28.05, -82.15, 10.0)]
    >>> [str(problem) for problem in check_mission(items, LocalFrame(28.05, -82.15), get_vehicle("quad"))]
    ['item 1 (NAV_WAYPOINT): no take-off before it']
    """
    positions = item_positions(items, frame, home_up_m)
    problems = mission_problems(items, positions, spec, needs_takeoff=needs_takeoff)
    if outside is not None and not problems:
        for seq, (item, position) in enumerate(zip(items, positions, strict=True)):
            reason = (
                outside(position) if item.command in PLACED_COMMANDS and not math.isnan(position[0]) else None
            )
            if reason is not None:
                problems.append(ItemProblem(seq, item.command, "fence", f"outside the fence, {reason}"))
    return problems


def mission_problems(
    items: Sequence[MissionItem],
    positions: Sequence[tuple[float, float, float]],
    spec: VehicleSpec,
    *,
    needs_takeoff: bool = True,
) -> list[ItemProblem]:
    """List the problems of a mission as `check_mission` does, from known positions of the items."""
    if not items:
        return [ItemProblem(None, 0, "empty", "the mission is empty")]
    problems: list[ItemProblem] = []
    flying = not needs_takeoff or spec.drives
    for seq, (item, position) in enumerate(zip(items, positions, strict=True)):
        reasons = _item_problems(item, position, len(items), spec)
        if item.command == Command.NAV_TAKEOFF:
            flying = True
        elif not flying and item.command in POSITION_COMMANDS:
            reasons.append(("no-takeoff", "no take-off before it"))
            flying = True
        problems += [ItemProblem(seq, item.command, code, reason) for code, reason in reasons]
    if spec.circles:
        problems += _landing_problems(items, positions, spec)
    if not any(item.command in NAV_COMMANDS for item in items):
        problems.append(ItemProblem(None, 0, "no-position", "the mission has no position to fly to"))
    if not problems:
        settings = Settings(spec.cruise_speed_m_s)
        for seq in range(len(items)):
            if items[seq].command == Command.DO_JUMP and do_items(items, seq, settings.copy(), 1.0)[1] < 0:
                jump = int(Command.DO_JUMP)
                problems.append(ItemProblem(seq, jump, "jump-loop", "jumps never lead to a position"))
                break
    return problems


def _name(command: int) -> str:
    try:
        return Command(command).name
    except ValueError:
        return f"command {command}"


def _item_problems(
    item: MissionItem, position: tuple[float, float, float], count: int, spec: VehicleSpec
) -> list[tuple[str, str]]:
    """Return a code and a reason for each problem of an item."""
    command = item.command
    if command not in NAV_COMMANDS and command not in DO_COMMANDS:
        return [("unknown-command", "the vehicle does not know this command")]
    problems: list[tuple[str, str]] = []
    has_to_be_placed = command in PLACED_COMMANDS
    if has_to_be_placed and item.frame not in _FRAMES:
        return [("frame", f"frame {item.frame} is not supported (use 0, 3 or 10)")]
    if has_to_be_placed:
        x, y, z = position
        if not spec.reaches(z) and command != Command.NAV_LAND:
            reason = f"altitude {z:.1f} m above home is outside 0..{spec.max_altitude_m:g}"
            problems.append(("altitude", reason))
        if x * x + y * y > spec.max_distance_m * spec.max_distance_m:
            reason = f"{math.hypot(x, y):.0f} m from the start: the limit is {spec.max_distance_m:.0f} m"
            problems.append(("far-from-home", reason))
    first, second = number(item.param1), number(item.param2)
    if command == Command.NAV_DELAY and first < 0.0:
        day = (second, number(item.param3), number(item.param4))
        if any(not -1.0 <= value < limit for value, limit in zip(day, (24.0, 60.0, 60.0), strict=True)):
            problems.append(("time", "time of day {:g}:{:g}:{:g} does not exist".format(*day)))
    elif not 0.0 <= first <= 86_400.0 and command in _TIMED:
        problems.append(("time", f"time {first:g} s is outside 0..86400"))
    if command == _WAYPOINT:
        if not 0.0 <= second <= 10_000.0:
            problems.append(("radius", f"acceptance radius {second:g} m is outside 0..10000"))
        return problems
    if command == Command.NAV_LOITER_TURNS:
        if not 0.0 < first <= MAX_TURNS:
            problems.append(("turns", f"{first:g} turns are outside 0..{MAX_TURNS:g}"))
        radius = number(item.param3)
        most = _MAX_RADIUS_M if spec.circles else 1000.0
        if radius != 0.0 and not 0.5 <= abs(radius) <= most:
            problems.append(("radius", f"radius {radius:g} m is outside 0.5..{most:g}"))
    if command == Command.DO_JUMP and not (0.0 <= first < count and first == int(first)):
        problems.append(("jump-target", f"jumps to item {first + 1:g}: the mission has {count} items"))
    if command == Command.CONDITION_DISTANCE and first < 0.0:
        problems.append(("distance", f"distance {first:g} m is negative"))
    return problems


def _landing_problems(
    items: Sequence[MissionItem], positions: Sequence[Position], spec: VehicleSpec
) -> list[ItemProblem]:
    """List the problems of a fixed wing's landings; PX4 rejects an approach that is too steep.

    Only approaches from waypoints are checked: from a circle, the vehicle flies to the landing at any slope.
    """
    bound = fixed_wing_procedures(spec).steepest_approach(spec)
    if bound is None:
        return []
    parameter, steepest = bound
    problems: list[ItemProblem] = []
    before: tuple[int, Position] | None = None
    for seq, (item, position) in enumerate(zip(items, positions, strict=True)):
        reason = ""
        if item.command == Command.NAV_LAND:
            if before is None:
                reason = "no position before the landing: add a waypoint from which to approach"
            elif before[0] == _WAYPOINT and not math.isnan(position[0] + before[1][0]):
                distance = math.hypot(position[0] - before[1][0], position[1] - before[1][1])
                slope = math.degrees(math.atan2(before[1][2], max(distance, 1e-3)))
                if slope > steepest + 0.05:
                    reason = (
                        f"the approach of {slope:.1f} degrees is steeper than {parameter} {steepest:g}: "
                        "begin it farther away or lower"
                    )
        if reason:
            problems.append(ItemProblem(seq, int(Command.NAV_LAND), "approach", reason))
        if item.command in PLACED_COMMANDS:
            before = (item.command, position)
    return problems
