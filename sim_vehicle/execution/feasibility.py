"""Feasibility checks of mission items before arming."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mission.model import Command, Frame
from sim_vehicle.autopilot import fixed_wing_procedures
from sim_vehicle.execution.items import (
    DO_COMMANDS,
    MAX_TURNS,
    NAV_COMMANDS,
    PLACED_COMMANDS,
    POSITION_COMMANDS,
    Settings,
    do_items,
    item_positions,
    number,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from geo.frame import LocalFrame
    from mission.model import MissionItem
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Position

# Plain integers replace enumeration members, because every prediction checks thousands of items.
_WAYPOINT = int(Command.NAV_WAYPOINT)
_FRAMES = frozenset({int(Frame.GLOBAL), int(Frame.GLOBAL_RELATIVE_ALT)})
_MAX_RADIUS_M = 5000.0
_TIMED = frozenset({16, 19, 82, 93, 112})


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
        return [("frame", f"frame {item.frame} is not supported (use 0 or 3)")]
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
        problems.append(("jump-target", f"jumps to item {first + 1:g} of {count}"))
    if command == Command.CONDITION_DISTANCE and first < 0.0:
        problems.append(("distance", f"distance {first:g} m is negative"))
    return problems


def _landing_problems(
    items: Sequence[MissionItem], positions: Sequence[Position], spec: VehicleSpec
) -> list[ItemProblem]:
    """List the problems of a fixed wing's landings; PX4 rejects an approach that is too steep.

    Only approaches from waypoints are checked, because a vehicle leaves a circle towards the landing anyway.
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
                reason = "no position before the landing, from which to approach"
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
