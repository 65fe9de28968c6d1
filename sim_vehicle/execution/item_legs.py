"""From mission items to legs: what the vehicle flies without asking again, and what follows."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from mission.model import Command, MissionItem
from sim_vehicle.autopilot import fixed_wing_procedures, flight_procedures
from sim_vehicle.execution.items import (
    CONDITIONS,
    DO_COMMANDS,
    PASSED_COMMANDS,
    POSITION_COMMANDS,
    Settings,
    condition_items,
    do_items,
    number,
)
from sim_vehicle.execution.legs import AfterLastLeg, LegPlan, circle_leg, circle_legs, lands, spline_legs
from sim_vehicle.motion.legs import ALONG, KEEP, Circle, Heading, Leg, LegKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sim_vehicle.airframe.spec import VehicleSpec
    from sim_vehicle.motion.legs import Position

__all__ = ["plan_item_legs"]

_MAX_LEGS = 4096
_LOOK_AHEAD = 20
_FAR_M = 1e6
_NOWHERE = (0.0, 0.0, 0.0)
# Plain numbers: an enumeration's member costs too much where a plan is made over thousands of items.
_WAYPOINT = int(Command.NAV_WAYPOINT)
_SPLINE = int(Command.NAV_SPLINE_WAYPOINT)
_JUMP = int(Command.DO_JUMP)
# Ahead of a circle: where it may be left to, and what moves the vehicle besides.
_LED_TO = POSITION_COMMANDS | {int(Command.NAV_LAND)}
_MOVES = _LED_TO | {int(Command.NAV_RETURN_TO_LAUNCH), int(Command.NAV_TAKEOFF)}
# What the vehicle does with them is known only when they are executed.
_SURPRISING = frozenset({115, 179, 195, 197, 201})
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
    """Return the legs from item ``seq``, which has a position, as far as they are flown without a pause.

    ``settings`` is a copy to plan ahead with; ``here`` is where the vehicle is, ``return_point`` where it
    returns to and the least height of the path there.
    """
    planner = _Planner(items, positions, settings, spec, here, return_point)
    at: int | None = seq
    while at is not None:
        planner.add_item(at)
        at = planner.next_after(at)
    return planner.plan


class _Planner:
    """Plans item by item; ``last`` is where the legs end so far, ``tangent`` the direction there."""

    def __init__(
        self,
        items: Sequence[MissionItem],
        positions: Sequence[Position],
        settings: Settings,
        spec: VehicleSpec,
        here: Position,
        return_point: Position,
    ) -> None:
        self.plan = LegPlan()
        self._items = items
        self._positions = positions
        self._settings = settings
        self._spec = spec
        self._return_point = return_point
        self._last = here
        self._tangent = _NOWHERE

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
        """Return the item that is flown through to after this one; None where the plan ends."""
        plan, items = self.plan, self._items
        if plan.after_last is not AfterLastLeg.NEXT:
            return None
        if len(plan.legs) >= _MAX_LEGS:
            plan.open = True
            return None
        following = seq + 1
        while following < len(items) and items[following].command not in PASSED_COMMANDS:
            done, following = do_items(items, following, self._settings, self._spec.top_speed_m_s)
            plan.unsure |= any(_surprises(items[index]) for index in done)
            if not 0 <= following < len(items) or items[following].command not in CONDITIONS:
                break
            plan.unsure = True
            # What waits for a condition is not known now: the legs are planned again when it has changed
            # something.
            following = condition_items(items, following)[-1] + 1
        passes = 0 <= following < len(items) and items[following].command in PASSED_COMMANDS
        return following if passes else None

    def _wait(self, seconds: float) -> None:
        self.plan.after_last, self.plan.wait_s = AfterLastLeg.WAIT, seconds

    def _add_spline(self, item: MissionItem, seq: int, position: Position) -> None:
        hold, speed = number(item.param1), self._settings.speed_m_s
        path = (self._last, position, None if hold > 0.0 else self._passed_to(seq))
        legs, self._tangent = spline_legs(path, self._tangent, speed, self._settings.heading, self._spec)
        if hold > 0.0:
            legs[-1] = replace(legs[-1], radius_m=0.0)
            self._wait(hold)
        self.plan.extend(legs, seq, done=hold <= 0.0, speed=speed)

    def _passed_to(self, seq: int) -> Position | None:
        """Return the position after a spline waypoint that is flown through to, None when it stops there."""
        items, following = self._items, seq + 1
        while following < len(items) and items[following].command in DO_COMMANDS:
            if items[following].command == _JUMP:
                return None
            following += 1
        if following >= len(items) or items[following].command not in PASSED_COMMANDS:
            return None
        return None if math.isnan(self._positions[following][0]) else self._positions[following]

    def _add_straight(self, item: MissionItem, seq: int, position: Position) -> Position:
        """Add the legs of an item that any vehicle flies alike, and return where they end."""
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
            # A fixed wing may only circle over home.
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

    # Vehicles that stay by circling: fixed wings.

    def _add_circling(self, item: MissionItem, seq: int, position: Position) -> bool:
        """Add the leg of an item that a fixed wing flies in its own way; False for any other item."""
        command, spec, speed = item.command, self._spec, self._settings.speed_m_s
        first, second, third = (value or 0.0 for value in (item.param1, item.param2, item.param3))
        after, wait_s = AfterLastLeg.NEXT, 0.0
        ahead, zero = self._led_to(item, seq, position)
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

    def _led_to(
        self, item: MissionItem, seq: int, position: Position
    ) -> tuple[Position | None, Position | None]:
        """Return the next position, towards which a circle is left, and a far one towards 0 N 0 E.

        None where it is not sure or far on, and where the autopilot does not take the coordinates of a return
        for that place. The bearing is that of ArduPilot's ``Location::get_bearing_to``: on a plane, with
        degrees of longitude as long as they are at the mean latitude.
        """
        items = self._items
        for following in range(seq + 1, min(seq + 1 + _LOOK_AHEAD, len(items))):
            command = items[following].command
            if command == _JUMP:
                break
            if command in _LED_TO:
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


def _surprises(item: MissionItem) -> bool:
    vertical = item.command == Command.DO_CHANGE_SPEED and number(item.param1) > 1.0
    return vertical or item.command in _SURPRISING
