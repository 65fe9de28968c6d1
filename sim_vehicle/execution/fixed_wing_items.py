"""Mission items of vehicles that stay by circling: fixed wings."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mission.model import Command
from sim_vehicle.autopilot import fixed_wing_procedures
from sim_vehicle.motion.legs import KEEP, Circle, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mission.model import MissionItem
    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Position

_WAYPOINT = int(Command.NAV_WAYPOINT)
_SPLINE = int(Command.NAV_SPLINE_WAYPOINT)
_WITH_POSITION = frozenset({16, 17, 18, 19, 21, 31, 82})
_MOVES = frozenset({int(Command.NAV_RETURN_TO_LAUNCH), int(Command.NAV_TAKEOFF)})
_LOOK_AHEAD = 20
MAX_RADIUS_M = 5000.0
_FAR_M = 1e6


@dataclass(frozen=True, slots=True)
class FixedWingLeg:
    """The leg of one item as a fixed wing flies it, and what follows it."""

    leg: Leg
    wait_s: float | None = None
    """How long it circles once it is there; None goes on."""
    forever: bool = False
    """Whether it stays."""

    @property
    def goes_on(self) -> bool:
        """Whether the next item follows without a pause."""
        return self.wait_s is None and not self.forever


def lands(legs: Sequence[Leg]) -> bool:
    """Whether legs end on the ground."""
    return legs[-1].kind is LegKind.LAND


def circle_leg(
    centre: Position,
    speed: float,
    radius_m: float = 0.0,
    turns: float = 0.0,
    leave_to_m: tuple[float, float] | None = None,
) -> Leg:
    """Return the leg of a circle; a radius of 0 is the autopilot's own, positive is clockwise."""
    return Leg(centre, speed, kind=LegKind.LOITER, circle=Circle(radius_m or None, turns, leave_to_m))


def fixed_wing_leg(
    item: MissionItem,
    position: Position,
    speed: float,
    spec: VehicleSpec,
    ahead: Position | None,
    following: MissionItem | None = None,
) -> FixedWingLeg | None:
    """The leg of an item as a fixed wing flies it; None for an item that any other vehicle flies alike.

    ``ahead`` is the position after it, towards which a circle is left; ``following`` the item after it that
    moves the vehicle.
    """
    command = item.command
    zero = _towards_zero(item, position, following, spec)
    first, second, third = (value or 0.0 for value in (item.param1, item.param2, item.param3))
    if command == _SPLINE or (command == _WAYPOINT and first > 0.0):
        if command == _SPLINE or not fixed_wing_procedures(spec).holds_at_waypoints:
            radius = second if command == _WAYPOINT and second > 0.0 else spec.acceptance_radius_m
            return FixedWingLeg(Leg(position, speed, radius, KEEP))
        return FixedWingLeg(circle_leg(position, speed), wait_s=first)
    leads = zero or ahead
    leave = None if leads is None else leads[:2]
    if command == _WAYPOINT and zero is not None:
        radius = second or spec.acceptance_radius_m
        return FixedWingLeg(Leg(position, speed, radius, KEEP, circle=Circle(leave_to_m=leave)))
    if command == Command.NAV_LOITER_UNLIM:
        return FixedWingLeg(circle_leg(position, speed, third), forever=True)
    if command == Command.NAV_LOITER_TIME:
        return FixedWingLeg(circle_leg(position, speed, third), wait_s=first)
    if command == Command.NAV_LOITER_TURNS:
        return FixedWingLeg(circle_leg(position, speed, third, first, leave))
    if command == Command.NAV_LOITER_TO_ALT:
        leg = circle_leg(position, speed, second, leave_to_m=leave)
        return FixedWingLeg(replace(leg, kind=LegKind.LOITER_TO_HEIGHT))
    return None


def _towards_zero(
    item: MissionItem, position: Position, following: MissionItem | None, spec: VehicleSpec
) -> Position | None:
    """Return a far place towards 0 N 0 E, where the autopilot takes a return's coordinates for that.

    The bearing is that of ArduPilot's ``Location::get_bearing_to``: on a plane, with degrees of longitude as
    long as they are at the mean latitude.
    """
    if following is None or following.command != Command.NAV_RETURN_TO_LAUNCH:
        return None
    if not fixed_wing_procedures(spec).turns_to_zero or (item.x == 0.0 and item.y == 0.0):
        return None
    north, east = -item.x, -item.y * math.cos(math.radians(0.5 * item.x))
    share = _FAR_M / math.hypot(east, north)
    return position[0] + share * east, position[1] + share * north, position[2]


def next_move(items: Sequence[MissionItem], seq: int) -> MissionItem | None:
    """Return the item after ``seq`` that moves the vehicle, None if that is not sure or far on."""
    for item in items[seq + 1 : seq + 1 + _LOOK_AHEAD]:
        if item.command in _WITH_POSITION or item.command in _MOVES:
            return item
        if item.command == Command.DO_JUMP:
            return None
    return None


def next_position(items: Sequence[MissionItem], positions: Sequence[Position], seq: int) -> Position | None:
    """Return the position of the item after ``seq`` that is flown to, None if that is not sure or far on."""
    for following in range(seq + 1, min(seq + 1 + _LOOK_AHEAD, len(items))):
        command = items[following].command
        if command in _WITH_POSITION:
            return None if math.isnan(positions[following][0]) else positions[following]
        if command in (Command.DO_JUMP, Command.NAV_RETURN_TO_LAUNCH, Command.NAV_TAKEOFF):
            return None
    return None


def landing_problems(
    items: Sequence[MissionItem], positions: Sequence[Position], spec: VehicleSpec
) -> list[tuple[int, str]]:
    """List items and what is wrong with the landings there; PX4 refuses an approach that is too steep.

    Only an approach from a waypoint is judged: a circle is left where it points to the landing.
    """
    bound = fixed_wing_procedures(spec).steepest_approach(spec)
    if bound is None:
        return []
    parameter, steepest = bound
    problems: list[tuple[int, str]] = []
    before: tuple[int, Position] | None = None
    for seq, (item, position) in enumerate(zip(items, positions, strict=True)):
        if item.command == Command.NAV_LAND:
            if before is None:
                problems.append((seq, "no position before it to approach it from"))
            elif before[0] == _WAYPOINT and not math.isnan(position[0] + before[1][0]):
                distance = math.hypot(position[0] - before[1][0], position[1] - before[1][1])
                slope = math.degrees(math.atan2(before[1][2], max(distance, 1e-3)))
                if slope > steepest + 0.05:
                    reason = (
                        f"the approach of {slope:.1f} degrees is steeper than {parameter} {steepest:g}: "
                        "begin it farther away or lower"
                    )
                    problems.append((seq, reason))
        if item.command in _WITH_POSITION or item.command == Command.NAV_TAKEOFF:
            before = (item.command, position)
    return problems
