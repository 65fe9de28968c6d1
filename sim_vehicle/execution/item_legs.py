"""Conversion of mission items, including circles and splines, into legs up to the next pause or decision."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from mission.model import Command, MissionItem
from sim_vehicle.autopilot import fixed_wing_procedures, flight_procedures
from sim_vehicle.execution.items import (
    CONDITIONS,
    DO_COMMANDS,
    MAX_TURNS,
    PASSED_COMMANDS,
    POSITION_COMMANDS,
    Settings,
    condition_items,
    do_items,
    number,
)
from sim_vehicle.execution.leg_follower import AfterLastLeg, LegPlan
from sim_vehicle.motion.legs import ALONG, KEEP, Circle, Heading, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Position

# Radius of a multirotor's circle if the item gives no radius.
_LOITER_RADIUS_M = 10.0
# Length of the chords of a spline, and the maximum number of chords.
_CHORD_M = 2.0
_MAX_CHORDS = 64
# Limit of a plan's length, needed because jumps can make a mission endless.
_MAX_LEGS = 4096
_LOOK_AHEAD = 20
# Distance of a far point that stands for a direction.
_FAR_M = 1e6
_NOWHERE = (0.0, 0.0, 0.0)
# These are plain integers, because comparing enumeration members is too slow for thousands of items.
_WAYPOINT = int(Command.NAV_WAYPOINT)
_SPLINE = int(Command.NAV_SPLINE_WAYPOINT)
_JUMP = int(Command.DO_JUMP)
# Items to whose position a vehicle can leave a circle, and all items that move the vehicle.
_EXIT_TARGETS = POSITION_COMMANDS | {int(Command.NAV_LAND)}
_MOVES = _EXIT_TARGETS | {int(Command.NAV_RETURN_TO_LAUNCH), int(Command.NAV_TAKEOFF)}
# Commands that change the plan when they are executed.
_CHANGE_PLAN = frozenset({115, 179, 195, 197, 201})
_TURNED_AT = frozenset({17, 19, 22, 31})


def plan_item_legs(
    items: Sequence[MissionItem],
    positions: Sequence[Position],
    seq: int,
    settings: Settings,
    spec: VehicleSpec,
    here: Position,
    return_point: Position = _NOWHERE,
) -> LegPlan:
    """Return the legs from item `seq` up to the next pause or decision; the item must have a position.

    `settings` is a copy that planning may change. `here` is the position of the vehicle. `return_point` is
    the destination of a return (east, north) and the minimum height on the way to it.
    """
    planner = _Planner(items, positions, settings, spec, here, return_point)
    at: int | None = seq
    while at is not None:
        planner.add_item(at)
        at = planner.next_after(at)
    return planner.plan


@dataclass(eq=False, slots=True)
class _Planner:
    """Planner of legs, item by item; the planned legs end at `_last` in the direction `_tangent`."""

    _items: Sequence[MissionItem]
    _positions: Sequence[Position]
    _settings: Settings
    _spec: VehicleSpec
    _last: Position
    _return_point: Position
    _tangent: Position = _NOWHERE
    plan: LegPlan = field(default_factory=LegPlan)

    def add_item(self, seq: int) -> None:
        """Add the legs of an item."""
        item, position, before = self._items[seq], self._positions[seq], self._last
        if math.isnan(position[0]):
            position = (before[0], before[1], position[2])
        if self._spec.circles and self._add_circling(item, seq, position):
            self._last = position
        elif item.command == _SPLINE:
            self._add_spline(item, seq, position)
            self._last = position
        else:
            self._last = x, y, z = self._add_straight(item, seq, position)
            waypoint = item.command == _WAYPOINT
            self._tangent = (x - before[0], y - before[1], z - before[2]) if waypoint else _NOWHERE
        self._settings.heading = ALONG

    def next_after(self, seq: int) -> int | None:
        """Return the item with which the plan continues after `seq`, or None if the plan ends at `seq`."""
        plan, items = self.plan, self._items
        if plan.after_last is not AfterLastLeg.NEXT:
            return None
        if len(plan.legs) >= _MAX_LEGS:
            plan.open = True
            return None
        following = seq + 1
        while following < len(items) and items[following].command not in PASSED_COMMANDS:
            done, following = do_items(items, following, self._settings, self._spec.top_speed_m_s)
            for item in (items[index] for index in done):
                vertical = item.command == Command.DO_CHANGE_SPEED and number(item.param1) > 1.0
                plan.unsure |= vertical or item.command in _CHANGE_PLAN
            if not 0 <= following < len(items) or items[following].command not in CONDITIONS:
                break
            plan.unsure = True
            # The plan leaves out conditions; a vehicle that reaches a condition plans its legs again.
            following = condition_items(items, following)[-1] + 1
        passes = 0 <= following < len(items) and items[following].command in PASSED_COMMANDS
        return following if passes else None

    def _wait(self, seconds: float) -> None:
        self.plan.after_last, self.plan.wait_s = AfterLastLeg.WAIT, seconds

    def _add_spline(self, item: MissionItem, seq: int, position: Position) -> None:
        hold, speed = number(item.param1), self._settings.speed_m_s
        path = (self._last, position, None if hold > 0.0 else self._position_after_spline(seq))
        legs, self._tangent = spline_legs(path, self._tangent, speed, self._settings.heading, self._spec)
        if hold > 0.0:
            legs[-1] = replace(legs[-1], radius_m=0.0)
            self._wait(hold)
        self.plan.extend(legs, seq, done=hold <= 0.0, speed=speed)

    def _position_after_spline(self, seq: int) -> Position | None:
        """Return the position to which the path continues after a spline waypoint, or None if it ends."""
        items, following = self._items, seq + 1
        while following < len(items) and items[following].command in DO_COMMANDS:
            if items[following].command == _JUMP:
                return None
            following += 1
        if following >= len(items) or items[following].command not in PASSED_COMMANDS:
            return None
        return None if math.isnan(self._positions[following][0]) else self._positions[following]

    def _add_straight(self, item: MissionItem, seq: int, position: Position) -> Position:
        """Add the legs of an item that all kinds of vehicles fly in the same way, and return their end."""
        plan, spec, settings, last = self.plan, self._spec, self._settings, self._last
        command, heading, speed = item.command, settings.heading, settings.speed_m_s
        x, y, _ = position
        if command == _WAYPOINT:
            if item.param4 is not None:
                heading = Heading.fixed(math.radians(item.param4))
            hold = item.param1 or 0.0
            radius = item.param2 or (0.0 if hold > 0.0 else spec.acceptance_radius_m)
            plan.add(Leg(position, speed, radius, heading), seq, done=hold <= 0.0)
            if hold > 0.0:
                self._wait(hold)
            return position
        if item.param4 is not None and command in _TURNED_AT:
            heading = Heading.fixed(math.radians(item.param4))
        if command == Command.NAV_TAKEOFF:
            legs = flight_procedures(spec).takeoff_legs(spec, last, position, speed, heading)
            if spec.circles:
                legs = [replace(leg, pitch_rad=math.radians(number(item.param1))) for leg in legs]
            plan.extend(legs, seq, done=True)
            return legs[-1].end_m
        if command == Command.NAV_RETURN_TO_LAUNCH:
            legs = flight_procedures(spec).return_legs(spec, last, speed, self._return_point)
            plan.extend(legs, seq)
            # A fixed wing may circle over home without landing.
            circles = spec.circles and not lands(legs)
            plan.after_last = AfterLastLeg.NEXT if circles else AfterLastLeg.TOUCHDOWN
            return self._return_point[0], self._return_point[1], 0.0
        if command == Command.NAV_LAND:
            plan.extend(flight_procedures(spec).landing_legs(spec, (x, y, last[2]), last, speed), seq)
            plan.after_last = AfterLastLeg.TOUCHDOWN
            return x, y, 0.0
        if command == Command.NAV_DELAY:
            plan.add(Leg(last, speed, heading=KEEP), seq)
            delay = number(item.param1)
            self._wait(delay if delay >= 0.0 else math.nan)
            return last
        if command == Command.NAV_LOITER_TURNS:
            legs = circle_legs(position, last, number(item.param1), number(item.param3), speed, spec)
            plan.extend(legs, seq, done=True)
            return legs[-1].end_m
        plan.add(Leg(position, speed, heading=heading), seq)
        self._wait(number(item.param1) if command == Command.NAV_LOITER_TIME else 0.0)
        if command == Command.NAV_LOITER_UNLIM:
            plan.after_last = AfterLastLeg.FOREVER
        return position

    # Fixed wings circle to hold a position.

    def _add_circling(self, item: MissionItem, seq: int, position: Position) -> bool:
        """Add the leg of an item that fixed wings fly in their own way; return False for other items."""
        command, spec, speed = item.command, self._spec, self._settings.speed_m_s
        first, second, third = (value or 0.0 for value in (item.param1, item.param2, item.param3))
        after, wait_s = AfterLastLeg.NEXT, 0.0
        ahead, zero = self._exit_targets(item, seq, position)
        leads = zero or ahead
        leave = None if leads is None else leads[:2]
        if command == _SPLINE or (command == _WAYPOINT and first > 0.0):
            if command == _SPLINE or not fixed_wing_procedures(spec).holds_at_waypoints:
                radius = second if command == _WAYPOINT and second > 0.0 else spec.acceptance_radius_m
                leg = Leg(position, speed, radius, KEEP)
            else:
                leg, after, wait_s = circle_leg(position, speed), AfterLastLeg.WAIT, first
        elif command == _WAYPOINT and zero is not None:
            radius = second or spec.acceptance_radius_m
            leg = Leg(position, speed, radius, KEEP, circle=Circle(leave_to_m=leave))
        elif command == Command.NAV_LOITER_UNLIM:
            leg, after = circle_leg(position, speed, third), AfterLastLeg.FOREVER
        elif command == Command.NAV_LOITER_TIME:
            leg, after, wait_s = circle_leg(position, speed, third), AfterLastLeg.WAIT, first
        elif command == Command.NAV_LOITER_TURNS:
            leg = circle_leg(position, speed, third, first, leave)
        elif command == Command.NAV_LOITER_TO_ALT:
            leg = replace(
                circle_leg(position, speed, second, leave_to_m=leave), kind=LegKind.LOITER_TO_HEIGHT
            )
        else:
            return False
        self.plan.add(leg, seq, done=after is AfterLastLeg.NEXT)
        self.plan.after_last, self.plan.wait_s = after, wait_s
        return True

    def _exit_targets(
        self, item: MissionItem, seq: int, position: Position
    ) -> tuple[Position | None, Position | None]:
        """Return the position to which the vehicle leaves a circle, and a far point in direction 0° N 0° E.

        The position is None if a jump or an item without a position comes first. The far point is None unless
        the autopilot turns towards the zero coordinates of a return item. The direction is computed with
        scaled longitudes, as in ArduPilot's ``Location::get_bearing_to``.
        """
        items = self._items
        for following in range(seq + 1, min(seq + 1 + _LOOK_AHEAD, len(items))):
            command = items[following].command
            if command == _JUMP:
                break
            if command in _EXIT_TARGETS:
                known = not math.isnan(self._positions[following][0])
                return self._positions[following] if known else None, None
            if command in _MOVES:
                returns = command == Command.NAV_RETURN_TO_LAUNCH
                if (
                    not returns
                    or not fixed_wing_procedures(self._spec).turns_to_zero
                    or item.x == item.y == 0.0
                ):
                    break
                north, east = -item.x, -item.y * math.cos(math.radians(0.5 * item.x))
                share = _FAR_M / math.hypot(east, north)
                return None, (position[0] + share * east, position[1] + share * north, position[2])
        return None, None


def lands(legs: Sequence[Leg]) -> bool:
    """Whether the legs end with a landing."""
    return legs[-1].kind is LegKind.LAND


def circle_leg(
    centre: Position,
    speed: float,
    radius_m: float = 0.0,
    turns: float = 0.0,
    leave_to_m: tuple[float, float] | None = None,
) -> Leg:
    """Return the leg of a circle; positive radii are clockwise, 0 stands for the autopilot's default."""
    return Leg(centre, speed, kind=LegKind.LOITER, circle=Circle(radius_m or None, turns, leave_to_m))


def circle_legs(
    centre: Position, last: Position, turns: float, radius: float, speed: float, spec: VehicleSpec
) -> list[Leg]:
    """Return 10-degree chords of a circle that begins at the circle's point nearest to the vehicle.

    A positive radius is clockwise, a negative radius counter-clockwise, and 0 selects 10 m.
    """
    x, y, z = centre
    radius = radius or _LOITER_RADIUS_M
    sense = -1.0 if radius > 0.0 else 1.0
    radius = abs(radius)
    begin = math.atan2(last[1] - y, last[0] - x)
    chords = max(1, round(36.0 * turns))
    step = sense * math.radians(10.0)
    slow = min(speed, math.sqrt(0.5 * spec.acceleration_m_s2 * radius))
    accept = min(spec.acceptance_radius_m, 0.3 * radius * abs(step))
    return [
        Leg(
            (x + radius * math.cos(begin + k * step), y + radius * math.sin(begin + k * step), z),
            speed if k == 0 else slow,
            accept,
            kind=LegKind.ARC if k > 0 else LegKind.WAYPOINT,
        )
        for k in range(chords + 1)
    ]


def orbit_legs(
    centre: Position, last: Position, radius: float, speed: float, heading: Heading, spec: VehicleSpec
) -> list[Leg]:
    """Return the legs of an orbit order: with PX4 an endless circle, otherwise the chords of 100 circles.

    The vehicle flies to the circle at the cruise speed (PX4's ``FlightTaskOrbit``). `heading` applies to the
    endless circle; along chords the nose points ahead.
    """
    within = flight_procedures(spec).orbit_within_m
    legs = circle_legs(centre, last, MAX_TURNS if within is None else 0.0, radius, speed, spec)
    legs[0] = replace(legs[0], speed_m_s=max(speed, spec.cruise_speed_m_s))
    if within is not None:
        around = Leg(centre, speed, heading=heading, kind=LegKind.ORBIT, circle=Circle(radius))
        legs = [replace(legs[0], radius_m=within), around]
    return legs


def spline_legs(
    path: tuple[Position, Position, Position | None],
    tangent: Position,
    speed: float,
    heading: Heading,
    spec: VehicleSpec,
) -> tuple[list[Leg], Position]:
    """Return the legs along a cubic Hermite spline to a position, and the direction of arrival.

    As with ArduCopter's spline waypoints, the curve starts in the previous direction of arrival and ends
    parallel to the line from the previous to the next position. Both tangents have the length of the straight
    path, which prevents loops.

    `path` holds the start, the end, and the position after the end. If this last position is None, the curve
    ends along the straight line. `tangent` is the direction at the start, a zero vector for a straight start.
    """
    begin, end, ahead = path
    straight = (end[0] - begin[0], end[1] - begin[1], end[2] - begin[2])
    length = math.hypot(*straight)
    if length < 0.1:
        return [Leg(end, speed, spec.acceptance_radius_m, heading)], tangent
    leave = _scaled(tangent, length) or straight
    arrive = straight
    if ahead is not None:
        through = (ahead[0] - begin[0], ahead[1] - begin[1], ahead[2] - begin[2])
        arrive = _scaled(through, length) or straight
    chords = min(max(4, math.ceil(length / _CHORD_M)), _MAX_CHORDS)
    points = [begin]
    for k in range(1, chords + 1):
        t = k / chords
        a, b = (1.0 + 2.0 * t) * (1.0 - t) ** 2, t * (1.0 - t) ** 2
        c, d = t * t * (3.0 - 2.0 * t), t * t * (t - 1.0)
        x, y, z = (a * begin[i] + b * leave[i] + c * end[i] + d * arrive[i] for i in range(3))
        points.append((x, y, z))
    limits = [_curve_speed(points[k : k + 3], spec) for k in range(chords - 1)]
    legs: list[Leg] = []
    for k in range(1, chords + 1):
        slow = min(speed, *limits[max(0, k - 3) : k + 2])
        accept = min(spec.acceptance_radius_m, 0.45 * math.dist(points[k - 1], points[k]))
        legs.append(Leg(points[k], slow, accept, heading, LegKind.ARC))
    return legs, arrive


def _curve_speed(points: list[Position], spec: VehicleSpec) -> float:
    """Return the speed on a curve through three positions at half the acceleration limit."""
    (ax, ay, _), (bx, by, _), (cx, cy, _) = points
    before, after = math.hypot(bx - ax, by - ay), math.hypot(cx - bx, cy - by)
    turn = math.remainder(math.atan2(cy - by, cx - bx) - math.atan2(by - ay, bx - ax), 2.0 * math.pi)
    radius = 0.5 * (before + after) / max(abs(turn), 1e-6)
    return max(0.5, math.sqrt(0.5 * spec.acceleration_m_s2 * radius))


def _scaled(direction: Position, length: float) -> Position | None:
    size = math.hypot(*direction)
    if size < 1e-6:
        return None
    scale = length / size
    return direction[0] * scale, direction[1] * scale, direction[2] * scale
